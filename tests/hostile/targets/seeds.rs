//! Seeds: valid inputs that the fuzzer mutates. The rest of the corpus is in files.

use std::io::Cursor;

use pinstack::{
    contract::{
        Name,
        profile::{Profile, ProfileSource},
    },
    http::profiles::file::ProfileFile,
    store::digest::{optics_digest, profile_digest},
};
use pinstack_science::{
    archive::{self, npy, npz},
    imaging::{
        Raster,
        codec::{self, Metadata},
    },
    types::profile::{HomographyModel, ProfileInput, ProfileSlice},
};
use serde_json::json;

use super::pictures::{pattern, png};

type Seeds = Vec<(String, Vec<u8>)>;

fn named<const N: usize>(seeds: [(&str, Vec<u8>); N]) -> Seeds {
    seeds.into_iter().map(|(name, bytes)| (name.to_owned(), bytes)).collect()
}

fn zip(members: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    archive::pack(&mut out, members.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.clone()))).expect("a zip");
    out.into_inner()
}

/// Two slices of the size of the profile `rig/lens`.
fn stack() -> Vec<u8> {
    zip(&[("front/a_1.png", png(24, 18, 3)), ("front/a_2.png", png(24, 18, 3))])
}

/// A 16-bit picture.
fn deep() -> Raster {
    Raster::sixteen(9, 7, 1, (0..63).map(|i| i * 977).collect())
}

fn tiff(raster: &Raster, metadata: &Metadata) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    codec::encode_tiff(&mut out, raster, metadata).expect("a TIFF");
    out.into_inner()
}

/// Zips of scans, in several layouts.
pub fn scans() -> Seeds {
    let pictures = |names: &[&'static str]| -> Vec<u8> {
        let members: Vec<(&str, Vec<u8>)> = names.iter().map(|name| (*name, png(4, 3, 1))).collect();
        zip(&members)
    };
    let listed = br#"{"views": [{"label": "side", "pan_deg": 20, "tilt_deg": -6, "front": ["b.png", "a.png"]}]}"#;
    named([
        (
            "folders",
            pictures(&[
                "v/pan0_tilt0/front/1.png",
                "v/pan0_tilt0/front/2.png",
                "v/pan9_tilt0/front/1.png",
                "v/pan9_tilt0/front/2.png",
            ]),
        ),
        (
            "steps",
            pictures(&[
                "_x_1_y_0_step_-4_.png",
                "_x_1_y_0_step_4_.png",
                "_x_1_y_9_step_-4_.png",
                "_x_1_y_9_step_4_.png",
            ]),
        ),
        ("listed", zip(&[("manifest.json", listed.to_vec()), ("a.png", png(4, 3, 1)), ("b.png", png(4, 3, 1))])),
    ])
}

/// Lists of names.
pub fn names() -> Seeds {
    named([
        (
            "trees",
            b"with_backlight/x=6/y=120/1.jpg\nwith_backlight/x=6/y=120/2.jpg\nwithout_backlight/x=6/y=120/1.jpg\n\
            without_backlight/x=6/y=120/2.jpg\nnotes.txt\n"
                .to_vec(),
        ),
        (
            "lights",
            b"view01_front_03.jpg\nview01_front_04.jpg\nview01_back_03.jpg\nview01_back_04.jpg\nview02_front_03.jpg\n\
            view02_front_04.jpg\nview02_back_03.jpg\nview02_back_04.jpg\n"
                .to_vec(),
        ),
        (
            "steps",
            b"RAW/_x_00190_y_00000_step_-08000_.jpg\nRAW/_x_00190_y_00000_step_00000_.jpg\n\
            RAW/_x_00190_y_00100_step_-08000_.jpg\nRAW/_x_00190_y_00100_step_00000_.jpg\n"
                .to_vec(),
        ),
        (
            "siblings",
            b"s/a_1/1.jpg\ns/a_1/2.jpg\ns/a_1_back/1.jpg\ns/a_1_back/2.jpg\ns/front/back/1.jpg\ns/a.nef\n".to_vec(),
        ),
    ])
}

/// Camera poses in the formats of text, a binary file of COLMAP, and zips of COLMAP models.
pub fn poses() -> Seeds {
    let centre = |k: u64| 1.0 + k as f64;
    let mut binary = 3_u64.to_le_bytes().to_vec();
    for view in 0..3_u64 {
        binary.extend(u32::try_from(view + 1).unwrap_or(1).to_le_bytes());
        for value in [1.0, 0.0, 0.0, 0.0, centre(view), 2.0, 3.0] {
            binary.extend(f64::to_le_bytes(value));
        }
        binary.extend(1_u32.to_le_bytes());
        binary.extend(format!("pan{view:03}_tilt00.png\0").as_bytes());
        binary.extend(0_u64.to_le_bytes());
    }
    let colmap = "# Image list\n1 1 0 0 0 1 2 3 1 pan000_tilt00.png\n\n2 0.995 0.1 0 0 2 2 3 1 pan020_tilt00.png\n\n3 1 0 0 0 3 1 3 1 a.png\n\n";
    let csv = "name,x,y,z,pan_deg,tilt_deg\na.png,1,0,0,0,0\nb.png,0,1,0,90,0\nc.png,-1,0,0,180,0\nd.png,0,0,1,0,90\n";
    let sfm = json!({ "version": ["1", "2", "8"],
        "views": [{ "viewId": "1", "poseId": "1", "intrinsicId": "4", "path": "pan000_tilt00.png" }],
        "intrinsics": [{ "intrinsicId": "4", "width": "99", "sensorWidth": "36", "focalLength": "65" },
            { "intrinsicId": "5", "pxFocalLength": ["990", "1010"] }],
        "poses": [{ "poseId": "1", "pose": { "transform": {
            "rotation": ["1", "0", "0", "0", "1", "0", "0", "0", "1"], "center": ["1", "2", "3"] } } }] });
    let openmvg = json!({ "sfm_data_version": "0.3",
        "views": [{ "key": 0, "value": { "ptr_wrapper": { "data": { "filename": "a.png", "id_view": 0, "id_pose": 0, "id_intrinsic": 0 } } } }],
        "intrinsics": [{ "key": 0, "value": { "ptr_wrapper": { "data": { "focal_length": [990.0, 1010.0] } } } }],
        "extrinsics": [{ "key": 0, "value": { "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "center": [1, 2, 3] } }] });
    let metashape = "<document><chunk><sensors><sensor id=\"0\"><calibration class=\"adjusted\"><f>1000</f></calibration></sensor>\
        </sensors><cameras><camera id=\"0\" sensor_id=\"0\" label=\"pan000_tilt00\"><transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1\
        </transform></camera></cameras></chunk></document>";
    let pinhole = [1000.0, 1001.0, 50.0, 40.0].map(f64::to_le_bytes).concat();
    let cameras = [&[1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0][..], &[9; 16], &pinhole].concat();
    let cameras_text = b"# Camera list\n1 SIMPLE_RADIAL 99 66 1000 50 33 0.1\n".to_vec();
    named([
        ("colmap_text_model", zip(&[("0/images.txt", colmap.into()), ("0/cameras.txt", cameras_text)])),
        ("colmap_binary_model", zip(&[("images.bin", binary.clone()), ("cameras.bin", cameras)])),
        ("colmap_text", colmap.into()),
        ("colmap_binary", binary),
        ("csv", csv.into()),
        ("alicevision", sfm.to_string().into_bytes()),
        ("openmvg", openmvg.to_string().into_bytes()),
        ("metashape", metashape.into()),
    ])
}

/// JPEG, PNG and TIFF with metadata.
pub fn pictures() -> Seeds {
    let exif =
        [&b"II*\0\x08\0\0\0\x02\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\x0F\x01\x02\0\x04\0\0\0abc\0\0\0\0\0"[..]].concat();
    let metadata = Metadata { icc: Some([&[0; 16][..], b"RGB ", &[0; 112]].concat()), exif: Some(exif) };
    let mut deep_png = Vec::new();
    codec::encode_png(&mut deep_png, &deep(), &metadata).expect("a PNG");
    let mut colour_png = Vec::new();
    codec::encode_png(&mut colour_png, &pattern(9, 7, 3), &metadata).expect("a PNG");
    named([
        ("grey.png", png(9, 7, 1)),
        ("colour.png", colour_png),
        ("alpha.png", png(9, 7, 4)),
        ("deep.png", deep_png),
        ("grey.jpg", codec::encode_jpeg(&pattern(17, 9, 1), 90)),
        ("colour.jpg", codec::encode_jpeg(&pattern(17, 9, 3), 60)),
        ("progressive.jpg", include_bytes!("../../../science/src/imaging/codec/testdata/progressive.jpg").to_vec()),
        ("baseline.jpg", include_bytes!("../../../science/src/imaging/codec/testdata/baseline.jpg").to_vec()),
        ("restart.jpg", include_bytes!("../../../science/src/imaging/codec/testdata/restart.jpg").to_vec()),
        ("deep.tif", tiff(&deep(), &metadata)),
        ("colour.tif", tiff(&pattern(9, 7, 3), &metadata)),
        ("alpha.tif", tiff(&pattern(9, 7, 4), &Metadata::default())),
    ])
}

/// Zips of a few slices.
pub fn archives() -> Seeds {
    let jpeg = || codec::encode_jpeg(&pattern(16, 16, 1), 80);
    let manifest = br#"{"front": ["b.png", "a.png"], "back": []}"#.to_vec();
    named([
        ("two.zip", zip(&[("a.png", png(4, 4, 1)), ("b.png", png(4, 4, 1))])),
        (
            "jpeg.zip",
            zip(&[("x/front/a_2.jpg", jpeg()), ("x/front/a_10.jpg", jpeg()), ("x/readme.txt", b"hi".to_vec())]),
        ),
        (
            "both.zip",
            zip(&[
                ("front/a.png", png(3, 3, 3)),
                ("front/b.png", png(3, 3, 3)),
                ("back\\a.png", png(3, 3, 1)),
                ("back\\b.png", png(3, 3, 1)),
            ]),
        ),
        ("manifest.zip", zip(&[("a.png", png(4, 4, 1)), ("b.png", png(4, 4, 1)), ("manifest.json", manifest)])),
        ("nested.zip", zip(&[("a.png", png(4, 4, 1)), ("b.png", png(4, 4, 1)), ("inner.zip", stack())])),
    ])
}

/// Orders of slices.
pub fn manifests() -> Seeds {
    named([
        ("all", br#"{"front": ["a2.png", "front/a1.png"], "back": ["b1.png", "b2.png"]}"#.to_vec()),
        ("foreign", br#"{"name": "another program"}"#.to_vec()),
        ("twice", br#"{"front": ["a1.png", "a1.png"], "back": ["b1.png", "b2.png"]}"#.to_vec()),
        ("outside", br#"{"front": ["../a1.png"], "back": []}"#.to_vec()),
    ])
}

fn input() -> ProfileInput {
    let given = json!({
        "image_width": 640, "image_height": 480, "reference_index": 1,
        "homographies": [[1.01, 0, -3.2, 0, 1.01, -2.4, 0, 0, 1], [1, 0, 0, 0, 1, 0, 0, 0, 1], [0.99, 0, 3.2, 0, 0.99, 2.4, 0, 0, 1]],
        "rail_positions_mm": [0.0, 0.5, 1.0], "gains": [1.0, 1.0, 0.98], "pixel_pitch_mm": 0.004,
        "capture_mode": "fixed_lens", "principal_distance_mm": 130.0, "principal_point_px": [319.5, 239.5],
        "magnification": 1.0, "note": "measured"
    });
    serde_json::from_value(given).expect("a profile")
}

/// A profile as another server exports it.
fn exported() -> Vec<u8> {
    let input = input();
    let profile = Profile {
        rig: Name::new("rig").expect("a name"),
        lens: Name::new("lens").expect("a name"),
        revision: 3,
        digest: profile_digest(&input),
        optics_digest: optics_digest(&input),
        created_at: "2026-01-02T03:04:05Z".parse().expect("a time"),
        source: ProfileSource::Upload,
        calibration_id: None,
        origin: None,
        model: HomographyModel::Given,
        warnings: Vec::new(),
        principal_distance_px: input.principal_distance_px(),
        slice_count: 3,
        slices: ProfileSlice::all_given(&input),
        input,
    };
    serde_json::to_vec(&ProfileFile::of(profile).expect("JSON")).expect("JSON")
}

/// Profiles, rig parameters, matrices and an exported profile.
pub fn profiles() -> Seeds {
    let rig = json!({
        "image_width": 5760, "image_height": 3840, "reference_index": 1, "slice_count": 3, "rail_step_mm": -0.5,
        "focal_mm": 65, "magnification": 1.0, "pixel_pitch_mm": 0.00625, "capture_mode": "moving_lens",
        "principal_point_px": [2880.0, 1920.0], "drift_px_per_mm": [0.1, -0.2], "gains": "none", "note": "n"
    });
    let matrices = br#"[[1.01,0,-3,0,1.01,-2,0,0,1],[2,0,0,0,2,0,0,0,2],[0.99,0,3,1e-9,0.99,2,0,0,-1]]"#;
    named([
        ("input", serde_json::to_vec(&input()).expect("JSON")),
        ("exported", exported()),
        ("rig", rig.to_string().into_bytes()),
        ("matrices", matrices.to_vec()),
    ])
}

/// Arrays and zips of arrays.
pub fn numpy() -> Seeds {
    let stack = || input().homographies.iter().flat_map(|h| h.0).collect::<Vec<_>>();
    let array = npy::of_floats(&[3, 3, 3], stack());
    let mut fortran = array.clone();
    let at = fortran.windows(5).position(|w| w == b"False").expect("C order");
    fortran[at..at + 5].copy_from_slice(b"True ");
    let arrays = [("homographies", array.clone()), ("gains", npy::of_floats(&[3], [1.0; 3]))];
    let unnamed = [("h", array.clone()), ("n", npy::of_integers(&[], [3]))];
    named([
        ("array.npy", array),
        ("flat.npy", npy::of_floats(&[3, 9], stack())),
        ("fortran.npy", fortran),
        ("arrays.npz", npz::packed(arrays).expect("a zip")),
        ("unnamed.npz", npz::packed(unnamed).expect("a zip")),
    ])
}

/// Options as JSON and as a query.
pub fn options() -> Seeds {
    let all = json!({
        "mask": "required", "mask_threshold": 0.4, "mask_min_blob_px": 9, "mask_min_hole_px": 9, "format": "tiff",
        "bit_depth": 16, "crop": "1,2,3,4", "under_alpha": "keep", "method": "guided", "r1": 20, "eps1": 0.3, "r2": 7,
        "eps2": 1e-6, "average": 31, "r_g": 5, "sigma_g": 5.0, "label": "a", "scan": "s", "pan_deg": 10.5,
        "tilt_deg": -3, "keep_days": 7, "profile_revision": 2
    });
    let calibration = json!({
        "reference_index": 3, "target_pitch_mm": 0.5, "pixel_pitch_mm": 0.004, "rail_positions_mm": [0, 1, 2],
        "focal_mm": 65, "capture_mode": "fixed_lens", "model": "affine", "allow_new_size": true, "note": "n"
    });
    named([
        ("all", all.to_string().into_bytes()),
        ("calibration", calibration.to_string().into_bytes()),
        (
            "query",
            b"mask=auto&mask_threshold=0.25&bit_depth=8&crop=valid&r1=10&eps2=1e-5&label=a%20b&scan=x&pan_deg=1e1"
                .to_vec(),
        ),
        ("calibration-query", b"target_pitch_mm=0.5&rail_step_mm=-0.1&model=rail_linear&allow_new_size=true".to_vec()),
    ])
}

/// Forms.
pub fn forms() -> Seeds {
    let part = |name: &str, rest: &str, body: &[u8]| {
        [format!("--XX\r\nContent-Disposition: form-data; name=\"{name}\"{rest}\r\n\r\n").as_bytes(), body, b"\r\n"]
            .concat()
    };
    let form = |parts: &[Vec<u8>]| [b"\n\n", parts.concat().as_slice(), b"--XX--\r\n"].concat();
    let file = || part("stack", "; filename=\"a.zip\"\r\nContent-Type: application/zip", &stack());
    named([
        ("whole", form(&[part("rig", "", b"rig"), part("lens", "", b"lens"), part("options", "", br#"{"mask":"none"}"#), file()])),
        ("file-first", form(&[file(), part("lens", "", b"lens"), part("rig", "", b"rig")])),
        ("no-file", form(&[part("rig", "", b"rig"), part("lens", "", b"lens")])),
        ("unknown", form(&[part("rig", "", b"rig"), part("lens", "", b"lens"), part("what", "", b"x"), file()])),
        (
            "quoted",
            [b"Content-Type: multipart/form-data; boundary=\"a b\"\n\n--a b\r\nContent-Disposition: form-data; name=rig\r\n\r\nrig\r\n--a b--".as_slice()]
                .concat(),
        ),
    ])
}

/// Resumable uploads.
pub fn tus() -> Seeds {
    // rig, lens, {"mask":"none"}, a.zip
    let about = "Upload-Metadata: rig cmln,lens bGVucw==,options eyJtYXNrIjoibm9uZSJ9,filename YS56aXA=\n";
    let whole = stack();
    let cut = whole.len() / 2;
    let begin = format!("Upload-Length: {}\n{about}", whole.len());
    let piece = "Content-Type: application/offset+octet-stream\n";
    let pieces = [begin.as_bytes(), piece.as_bytes(), b"\n", &whole[..cut], b"\n----\n\n", &whole[cut..]].concat();
    // sha256 of nothing, and of "abc" in SHA-1
    let wrong = "Upload-Checksum: sha256 47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=\n";
    let right = "Upload-Checksum: sha1 qZk+NkcGgWq6PiVxeFDCbJzQ2J0=\n";
    named([
        ("pieces", pieces),
        (
            "calibration",
            b"Upload-Length: 9\nUpload-Metadata: rig cmln,lens bGVucw==,purpose Y2FsaWJyYXRpb24=\n\n\n----\n\nabc"
                .to_vec(),
        ),
        ("wrong-checksum", format!("Upload-Length: 9\n{about}\n\n----\n{wrong}\nabc").into_bytes()),
        ("right-checksum", format!("Upload-Length: 9\n{about}\n\n----\n{right}\nabc").into_bytes()),
        ("other-offset", format!("Upload-Length: 9\n{about}\n\n----\nUpload-Offset: 5\n\nabc").into_bytes()),
        ("defer", format!("Upload-Defer-Length: 1\n{about}\n").into_bytes()),
    ])
}
