//! The contact sheet of the demo: a page that shows its results beside the truth, and the pictures that only the page
//! needs.

use std::path::Path;

use anyhow::{Context, Result};
use maud::{DOCTYPE, PreEscaped, html};

use super::{files::write_png, truth::Score};
use pinstack_science::{
    fusion::height::relief::relief,
    imaging::{Plane, Raster, Samples},
    synth::Rig,
};

/// Its file.
pub(super) const FILE: &str = "contact-sheet.html";

/// A checkerboard is what transparent pixels show.
const STYLE: &str = "body{font:14px sans-serif;margin:16px;display:grid;gap:16px;\
    grid-template-columns:repeat(auto-fill,minmax(380px,1fr))}figure{margin:0}\
    img{width:100%;background:repeating-conic-gradient(#ddd 0 25%,#fff 0 50%) 0/16px 16px}";

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
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head { meta charset="utf-8"; title { "pinstack demo" } style { (PreEscaped(STYLE)) } }
            body {
                @for (file, caption) in &cells {
                    figure { a href=(file) { img src=(file) alt=(caption); } figcaption { (caption) } }
                }
            }
        }
    };
    let path = out.join(FILE);
    std::fs::write(&path, page.into_string()).with_context(|| format!("cannot write {}", path.display()))
}

/// The values of a height map, which is grey.
fn values(heights: &Raster) -> Plane<u16> {
    let data = match &heights.samples {
        Samples::Eight(samples) => samples.iter().step_by(heights.channels).copied().map(u16::from).collect(),
        Samples::Sixteen(samples) => samples.iter().step_by(heights.channels).copied().collect(),
    };
    Plane { width: heights.width, height: heights.height, data }
}
