//! `pinstack hull`: the visual hull of a scan, from an unpacked bundle or the folder of a COLMAP model.

use std::{
    fs::{self, File},
    io::BufWriter,
    path::{Path, PathBuf},
};

use anyhow::{Context, anyhow, bail};
use clap::Args;
use serde_json::json;

use super::output::{note, say};
use crate::jobs::masked_views::MaskedViews;
use pinstack_science::{
    hull::{self, HullOptions, HullSummary, MAX_RESOLUTION, write_glb, write_ply},
    photogrammetry::poses::{COLMAP_MODEL, KnownScale, LengthUnit, PoseOptions, colmap_views, read, report},
    types::NoControl,
};

/// Make the visual hull of a scan from its masks and poses: a closed, coloured mesh as PLY and GLB
#[derive(Debug, Args)]
pub struct Hull {
    /// Folder with images/ and masks/, as an unpacked bundle for COLMAP has them
    folder: PathBuf,
    /// Folder with the poses, images and cameras as .txt or .bin [default: sparse/0 of the folder]
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    /// Folder for hull.ply and hull.glb [default: the folder of the scan]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Cells along the longest side of the hull [default: 512, or the pixels there if they are fewer]
    #[arg(long, value_name = "CELLS", value_parser = clap::value_parser!(u32).range(16..=MAX_RESOLUTION as i64))]
    resolution: Option<u32>,
    /// Views that may see a point of the hull outside of their mask: 1 if a mask is wrong
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=3))]
    tolerated: u32,
    /// Known distance from the centre of the turntable to the centre of projection, mm: gives the scale
    #[arg(long, value_name = "MM", value_parser = super::poses::length)]
    radius_mm: Option<f64>,
    /// Instead of --radius-mm: length of the unit of the poses, mm; 1 for the poses of a bundle with a known radius
    #[arg(long, value_name = "MM", value_parser = super::poses::length, conflicts_with = "radius_mm")]
    mm_per_unit: Option<f64>,
    /// Use views whose masks contradict the others, too
    #[arg(long)]
    all_views: bool,
    /// Leave colours out
    #[arg(long)]
    no_colours: bool,
    /// Print the figures as JSON
    #[arg(long)]
    json: bool,
}

impl Hull {
    /// Runs the command.
    ///
    /// # Errors
    /// When the model or a picture cannot be read, the masks and poses give no hull, or a file cannot be written.
    pub fn run(self) -> anyhow::Result<()> {
        let model = self.model.clone().unwrap_or_else(|| self.folder.join("sparse/0"));
        let [images, cameras] = COLMAP_MODEL.map(|names| model_file(&model, names));
        let (images, cameras) = (images?, cameras?);
        let views = colmap_views((images.0, &images.1), (cameras.0, &cameras.1));
        let views = views.map_err(|error| anyhow!("{}: {}", model.display(), error.detail))?;
        let posed = views.len();
        let scan = MaskedViews::of(&self.folder, views)?;
        for name in &scan.without_mask {
            note(format!("{name}: no masks/{name}.png, the view was left out"));
        }
        let options = HullOptions {
            resolution: self.resolution.map(|cells| cells as usize),
            tolerated: self.tolerated as usize,
            leave_out: !self.all_views,
            mm_per_unit: self.scale(&images.1)?,
            colours: !self.no_colours,
            ..HullOptions::default()
        };
        let hull = hull::from_views(&scan.cameras, &scan, &options, &NoControl)?;
        let out = self.out.as_ref().unwrap_or(&self.folder);
        fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
        let [ply, glb] = ["hull.ply", "hull.glb"].map(|name| out.join(name));
        write(&ply, |file| write_ply(&hull.mesh, file))?;
        write(&glb, |file| write_glb(&hull.mesh, hull.summary.is_mm, file))?;
        let HullSummary { empty_views, contradicting_views, .. } = &hull.summary;
        let used = scan.cameras.len() - empty_views.len() - contradicting_views.len();
        for view in empty_views {
            note(format!("{}: the mask is empty, the view was left out", scan.names[*view]));
        }
        for view in contradicting_views {
            note(format!("{}: mask or pose contradicts the other views, the view was left out", scan.names[*view]));
        }
        if self.json {
            let summary =
                json!({ "posed_views": posed, "used_views": used, "hull": hull.summary, "ply": ply, "glb": glb });
            say(serde_json::to_string_pretty(&summary)?);
        } else {
            say(format!("{used} of {posed} views, poses from {}", model.display()));
            say(text(&hull.summary));
            say(format!("{}, {}", ply.display(), glb.display()));
        }
        Ok(())
    }

    /// Length of the unit of the poses, mm.
    fn scale(&self, images: &[u8]) -> anyhow::Result<Option<f64>> {
        let Some(mm) = self.radius_mm else { return Ok(self.mm_per_unit) };
        let options = PoseOptions { scale: Some(KnownScale::Radius { mm }), ..PoseOptions::default() };
        let scale =
            read(images, None).and_then(|found| report(&found, &options)).map_err(|error| anyhow!(error.detail))?;
        match scale.scale.unit {
            LengthUnit::Mm => Ok(Some(scale.scale.per_file_unit)),
            LengthUnit::Radius => bail!("the cameras lie on no sphere or circle, so --radius-mm gives no scale"),
        }
    }
}

fn text(summary: &HullSummary) -> String {
    let HullSummary { volume, area, size: [x, y, z], cell, vertices, triangles, removed_parts, .. } = summary;
    let unit = if summary.is_mm { "mm" } else { "units of the poses" };
    let removed = match removed_parts {
        0 => String::new(),
        parts => format!("; {parts} tiny parts removed"),
    };
    format!(
        "size {x:.4} x {y:.4} x {z:.4}, area {area:.4}, volume {volume:.4} (lengths in {unit})\n{vertices} vertices, \
         {triangles} triangles, cells of {cell:.5}{removed}"
    )
}

/// The first of these files that a model has: its name and content.
fn model_file(model: &Path, names: [&'static str; 2]) -> anyhow::Result<(&'static str, Vec<u8>)> {
    let [binary, text] = names;
    let name = names.into_iter().find(|name| model.join(name).is_file()).ok_or_else(|| {
        anyhow!("{} has no {binary} or {text}; name the folder of a COLMAP model with --model", model.display())
    })?;
    let path = model.join(name);
    Ok((name, fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?))
}

fn write(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>) -> anyhow::Result<()> {
    let cannot = || format!("cannot write {}", path.display());
    let mut file = BufWriter::new(File::create(path).with_context(cannot)?);
    write(&mut file).with_context(cannot)?;
    file.into_inner().map_err(|error| error.into_error()).with_context(cannot)?.sync_all().with_context(cannot)
}

#[cfg(test)]
mod tests {
    use pinstack_science::{
        imaging::{Raster, codec},
        photogrammetry::bundle::{self, BundleScan, BundleView, Content, Layout},
        types::{intrinsics::Intrinsics, view::ViewAngles},
    };

    use super::*;

    const SIDE: u32 = 120;
    const FOCAL_PX: f64 = 1000.0;
    const RADIUS_MM: f64 = 100.0;
    /// Radius of the ball at the origin.
    const BALL_MM: f64 = 4.0;

    /// The unpacked bundle of a scan of a ball.
    fn bundle_of_a_ball(folder: &Path) {
        let view = |at: usize| ViewAngles { pan_deg: 30.0 * (at % 12) as f64, tilt_deg: 25.0 * (at / 12) as f64 };
        let views = (0..24).map(|at| BundleView {
            stem: view(at).file_stem(),
            extension: "png".into(),
            bit_depth: 8,
            has_mask: true,
            angles: Some(view(at)),
        });
        let scan = BundleScan {
            name: "ball".into(),
            width: SIDE,
            height: SIDE,
            intrinsics: Some(Intrinsics {
                principal_distance_px: FOCAL_PX,
                principal_distance_mm: FOCAL_PX / 10.0,
                principal_distance_sigma_mm: None,
                pixel_pitch_mm: 0.1,
                principal_point_px: None,
                distortion: None,
            }),
            canvas_centre_px: [f64::from(SIDE - 1) / 2.0; 2],
            radius_mm: Some(RADIUS_MM),
            pan_is_clockwise: false,
            views: views.collect(),
        };
        // the picture of the ball is a disc in each view
        let radius = FOCAL_PX * BALL_MM / (RADIUS_MM * RADIUS_MM - BALL_MM * BALL_MM).sqrt();
        let disc = |at: u32| {
            let [x, y] = [at % SIDE, at / SIDE].map(|value| f64::from(value) - f64::from(SIDE - 1) / 2.0);
            (255.0 * (radius - x.hypot(y) + 0.5).clamp(0.0, 1.0)).round() as u8
        };
        let mask = Raster::eight(SIDE as usize, SIDE as usize, 1, (0..SIDE * SIDE).map(disc).collect());
        // as results are: transparent and black beside the object
        let pixel = |at: u32| if disc(at) == 255 { [200, 90, 30, 255] } else { [0; 4] };
        let image = Raster::eight(SIDE as usize, SIDE as usize, 4, (0..SIDE * SIDE).flat_map(pixel).collect());
        for entry in bundle::plan(Layout::Colmap, &scan).expect("a bundle") {
            let path = folder.join(&entry.path);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            let file = fs::File::create(&path).expect("made");
            let write = |picture| codec::encode_png(&file, picture, &codec::Metadata::default()).expect("written");
            match entry.content {
                Content::Text(text) => fs::write(&path, text).expect("written"),
                Content::Image(_) => write(&image),
                Content::Mask(_) => write(&mask),
            }
        }
    }

    fn hull_of(folder: &Path) -> Hull {
        Hull {
            folder: folder.to_owned(),
            model: None,
            out: None,
            resolution: None,
            tolerated: 0,
            radius_mm: Some(2.0 * RADIUS_MM),
            mm_per_unit: None,
            all_views: false,
            no_colours: false,
            json: true,
        }
    }

    #[test]
    fn an_unpacked_bundle_becomes_a_coloured_mesh_in_mm() {
        let folder = tempfile::tempdir().expect("a folder");
        bundle_of_a_ball(folder.path());
        let out = folder.path().join("out");
        // a view without a mask is left out
        fs::remove_file(folder.path().join("masks/pan030_tilt00.png.png")).expect("removed");
        Hull { out: Some(out.clone()), ..hull_of(folder.path()) }.run().expect("a hull");
        let glb = fs::read(out.join("hull.glb")).expect("written");
        assert_eq!(&glb[..4], b"glTF");
        let ply = fs::read(out.join("hull.ply")).expect("written");
        let end = ply.windows(11).position(|window| window == b"end_header\n").expect("a header") + 11;
        let header = str::from_utf8(&ply[..end]).expect("text");
        let count = header.lines().find_map(|line| line.strip_prefix("element vertex ")).expect("a number");
        let mut farthest = 0.0_f64;
        for vertex in ply[end..].chunks_exact(15).take(count.parse().expect("a number")) {
            let float = |at: usize| f64::from(f32::from_le_bytes(vertex[at..at + 4].try_into().expect("four bytes")));
            // twice as large as the poses of the bundle say, because the radius is
            let error = float(0).hypot(float(4)).hypot(float(8)) - 2.0 * BALL_MM;
            farthest = farthest.max(error.abs());
            assert_eq!(vertex[12..], [200, 90, 30]);
        }
        // two pixels
        assert!(farthest < 0.4, "{farthest} mm");
    }

    #[test]
    fn what_is_missing_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let refused = || hull_of(folder.path()).run().expect_err("a refusal").to_string();
        assert!(refused().contains("has no images.bin or images.txt"), "{}", refused());
        bundle_of_a_ball(folder.path());
        fs::remove_dir_all(folder.path().join("masks")).expect("removed");
        assert!(refused().starts_with("0 of 0 views have a mask"), "{}", refused());
    }
}
