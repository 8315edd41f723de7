//! Renders the zips that the demo uploads.

use std::{fs::File, io::BufWriter, path::Path};

use anyhow::{Context, Result};
use rayon::prelude::*;

use pinstack_science::{
    archive::pack,
    imaging::{Raster, codec},
    synth::{DotTarget, Light, Rig, Stage, render_target},
};

/// JPEG quality of the slices, that of the setting "fine" of cameras.
const QUALITY: u8 = 95;

/// Renders the dot target at every rail position into a zip.
///
/// # Errors
/// When the zip cannot be written.
pub(super) fn write_target(rig: &Rig, target: &DotTarget, path: &Path) -> Result<()> {
    let slices = (0..rig.slices()).into_par_iter().map(|i| {
        let name = format!("dots_{:02}.jpg", i + 1);
        (name, jpeg(&render_target(rig, target, i)))
    });
    write_zip(slices.collect(), path)
}

/// Renders the scene at every rail position with front and back light into a zip.
///
/// # Errors
/// When the zip cannot be written.
pub(super) fn write_stack(slices: usize, stage: &Stage, path: &Path) -> Result<()> {
    let mut members = Vec::new();
    for (folder, light) in [("front", Light::Front), ("back", Light::Back)] {
        for i in 0..slices {
            members.push((format!("{folder}/slice_{:02}.jpg", i + 1), jpeg(&stage.render(light, i))));
        }
    }
    write_zip(members, path)
}

fn jpeg(picture: &Raster) -> Vec<u8> {
    codec::encode_jpeg(picture, QUALITY)
}

fn write_zip(members: Vec<(String, Vec<u8>)>, path: &Path) -> Result<()> {
    let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
    pack(BufWriter::new(file), members.into_iter()).with_context(|| format!("cannot write {}", path.display()))
}
