//! The contact sheet of the demo: a page that shows its results beside the truth, and the pictures that only the page
//! needs.

use std::path::Path;

use anyhow::{Context, Result};

use super::{files::write_png, truth::Score};
use crate::cli::sheet::{self, Cell};
use pinstack_science::{
    fusion::height::relief::relief,
    imaging::{Plane, Raster, Samples},
    synth::Rig,
};

/// Its file.
pub(super) const FILE: &str = "contact-sheet.html";

/// Writes the page and its pictures into `out`, where the results are. `height` is the height map.
pub(super) fn write(out: &Path, rig: &Rig, score: &Score, height: &Raster) -> Result<()> {
    let pictures = [
        ("first-slice.png", &score.first_slice),
        ("last-slice.png", &score.last_slice),
        ("truth.png", &score.truth),
        ("difference.png", &score.difference),
        ("relief.png", &relief(&values(height))),
    ];
    for (name, picture) in pictures {
        write_png(&out.join(name), picture)?;
    }
    let cells = [
        ("overlay.png", format!("dots found in slice {} (reference)", rig.reference)),
        ("first-slice.png", "front light, first slice".to_owned()),
        ("last-slice.png", format!("front light, last slice ({})", rig.slices() - 1)),
        ("image.png", format!("fused and cut out: {:.1} dB", score.psnr_fused)),
        ("truth.png", "truth".to_owned()),
        ("difference.png", "difference from truth, 4 times".to_owned()),
        ("backlight.png", "fused back light".to_owned()),
        ("mask.png", format!("mask: IoU {:.4}", score.iou)),
        ("relief.png", "height map: shaded relief".to_owned()),
    ];
    let cells = cells.map(|(file, caption)| Cell { file: file.to_owned(), picture: file.to_owned(), caption });
    let page = sheet::page("pinstack demo", &cells);
    let path = out.join(FILE);
    std::fs::write(&path, page).with_context(|| format!("cannot write {}", path.display()))
}

/// The values of a height map, which is grey.
fn values(heights: &Raster) -> Plane<u16> {
    let data = match &heights.samples {
        Samples::Eight(samples) => samples.iter().step_by(heights.channels).copied().map(u16::from).collect(),
        Samples::Sixteen(samples) => samples.iter().step_by(heights.channels).copied().collect(),
    };
    Plane { width: heights.width, height: heights.height, data }
}
