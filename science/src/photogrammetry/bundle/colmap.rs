//! COLMAP: masks by name, a model with the known camera and poses, and a list of pairs to match.

use std::fmt::Write;

use super::{
    camera::Camera,
    entries::{Bundle, Entry, text},
    pose, readme,
};

/// The files.
pub(super) fn files(bundle: &Bundle<'_>) -> Vec<Entry> {
    let mut out = vec![text("README.txt", readme(bundle))];
    if let Some(camera) = &bundle.camera
        && bundle.poses.is_some()
    {
        out.push(text("sparse/0/cameras.txt", cameras(camera)));
        out.push(text("sparse/0/images.txt", images(bundle)));
        out.push(text("sparse/0/points3D.txt", "# none: COLMAP triangulates them\n".to_owned()));
    }
    if let Some(poses) = &bundle.poses {
        out.push(text("pairs.txt", pairs(bundle, poses)));
    }
    out.extend(bundle.pictures(|view| format!("masks/{}.png", view.file())));
    out
}

/// Model and parameters. COLMAP counts from the corner of the top-left pixel.
fn parameters(camera: &Camera) -> (&'static str, Vec<f64>) {
    let (f, [cx, cy], [k1, k2]) = (camera.focal, camera.centre_by_corner(), camera.radial);
    match camera.is_distorted() {
        true => ("RADIAL", vec![f, cx, cy, k1, k2]),
        false => ("PINHOLE", vec![f, f, cx, cy]),
    }
}

fn joined(numbers: &[f64], separator: &str) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(separator)
}

fn cameras(camera: &Camera) -> String {
    let (model, parameters) = parameters(camera);
    let [width, height] = camera.size;
    format!("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 {model} {width} {height} {}\n", joined(&parameters, " "))
}

/// One view per two lines; the second, for observations, is empty. The ids are those that the feature extractor gives:
/// by the order of the names.
fn images(bundle: &Bundle<'_>) -> String {
    let mut out = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[]\n".to_owned();
    let mut posed: Vec<_> = bundle.posed().map(|(view, pose)| (view.file(), pose)).collect();
    posed.sort_by(|a, b| a.0.cmp(&b.0));
    for (at, (file, pose)) in posed.into_iter().enumerate() {
        let [x, y, z] = pose.translation().into();
        // writing to a String cannot fail
        let _ = writeln!(out, "{} {} {x} {y} {z} 1 {file}\n", at + 1, joined(&pose.quaternion(), " "));
    }
    out
}

fn pairs(bundle: &Bundle<'_>, poses: &[pose::Pose]) -> String {
    let file = |at: usize| bundle.scan.views[at].file();
    pose::pairs(poses).into_iter().map(|(a, b)| format!("{} {}\n", file(a), file(b))).collect()
}

fn readme(bundle: &Bundle<'_>) -> String {
    let mut out = readme::begin(bundle, "COLMAP (3.8 or newer)", "masks/{image}.png");
    out.push_str(&readme::deep_images(bundle, "COLMAP 3 (unlike COLMAP 4)"));
    let masks = match bundle.scan.views.iter().any(|view| view.has_mask) {
        true => " \\\n    --ImageReader.mask_path masks",
        false => "",
    };
    let missing = bundle.without_mask();
    if missing > 0 && missing < bundle.scan.views.len() {
        out.push_str(&format!(
            "{} no mask. COLMAP 3 takes the whole image of these; COLMAP 4 reports MASK_ERROR for them: remove them from images/, or \
             run without --ImageReader.mask_path.\n\n",
            readme::views_have(missing)
        ));
    }
    let camera = bundle.camera.as_ref().map(parameters);
    let refined = u8::from(bundle.camera.is_some_and(|camera| !camera.is_fixed()));
    let (given, refine) = match &camera {
        Some((model, parameters)) => (
            format!(
                " \\\n    --ImageReader.camera_model {model} --ImageReader.camera_params {}",
                joined(parameters, ",")
            ),
            format!(
                " \\\n    --Mapper.ba_refine_focal_length {refined} --Mapper.ba_refine_principal_point 0 \\\n    \
                 --Mapper.ba_refine_extra_params 0"
            ),
        ),
        None => (" \\\n    --ImageReader.camera_model SIMPLE_PINHOLE".to_owned(), String::new()),
    };
    let matcher = match bundle.poses {
        Some(_) => "colmap matches_importer --database_path database.db --match_list_path pairs.txt --match_type pairs",
        None => "colmap exhaustive_matcher --database_path database.db",
    };
    let _ = write!(
        out,
        "Run in this folder (without a GPU, add --SiftExtraction.use_gpu 0 and --SiftMatching.use_gpu 0):\n\n\
         colmap feature_extractor --database_path database.db --image_path images{masks} \\\n    \
         --ImageReader.single_camera 1{given}\n\
         {matcher}\n\
         mkdir -p model\n\
         colmap mapper --database_path database.db --image_path images --output_path model{refine}\n"
    );
    if camera.is_some() && bundle.poses.is_some() {
        out.push_str(
            "\nOr, with the poses of the turntable instead of the mapper:\n\nmkdir -p triangulated\ncolmap \
             point_triangulator --database_path database.db --image_path images \\\n    --input_path sparse/0 \
             --output_path triangulated\n",
        );
        if refined == 1 {
            out.push_str(
                "mkdir -p refined\ncolmap bundle_adjuster --input_path triangulated --output_path refined \\\n    \
                 --BundleAdjustment.refine_focal_length 1 --BundleAdjustment.refine_principal_point 0 \\\n    \
                 --BundleAdjustment.refine_extra_params 0\n",
            );
        }
    }
    out
}
