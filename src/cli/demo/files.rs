//! Writes what is rendered: the zips that the demo uploads, and pictures.

use std::{fs::File, io::BufWriter, path::Path};

use anyhow::{Context, Result};
use rayon::prelude::*;

use pinstack_science::{
    archive::pack,
    imaging::{
        Raster,
        codec::{self, Metadata},
    },
    synth::{DotTarget, Light, Rig, Stage, render_target},
};

/// JPEG quality of the slices, that of the setting "fine" of cameras.
const QUALITY: u8 = 95;

/// Dots of the target from left to right.
pub(super) const TARGET_COLUMNS: usize = 19;

/// Renders the dot target at every rail position into a zip.
pub(super) fn write_target(rig: &Rig, target: &DotTarget, path: &Path) -> Result<()> {
    let slices = (0..rig.slices()).into_par_iter().map(|i| {
        let name = format!("dots_{:02}.jpg", i + 1);
        (name, jpeg(&render_target(rig, target, i)))
    });
    write_zip(slices.collect::<Vec<_>>().into_iter(), path)
}

/// Renders the scene at every rail position with front and back light into a zip.
pub(super) fn write_stack(stage: &Stage, path: &Path) -> Result<()> {
    write_zip(stack_members(stage).into_iter(), path)
}

/// The slices of a stack as the camera stores them: `front/slice_01.jpg`, ..., `back/slice_01.jpg`, ...
pub(super) fn stack_members(stage: &Stage) -> Vec<(String, Vec<u8>)> {
    let lights = [("front", Light::Front), ("back", Light::Back)];
    let all: Vec<_> = lights.into_iter().flat_map(|light| (0..stage.rig().slices()).map(move |i| (light, i))).collect();
    let slice = |((folder, light), i): ((&str, Light), usize)| {
        (format!("{folder}/slice_{:02}.jpg", i + 1), jpeg(&stage.render(light, i)))
    };
    all.into_par_iter().map(slice).collect()
}

fn jpeg(picture: &Raster) -> Vec<u8> {
    codec::encode_jpeg(picture, QUALITY)
}

/// Writes a zip. Members are made one after the other, so a scan need not fit into the memory.
pub(super) fn write_zip(members: impl Iterator<Item = (String, Vec<u8>)>, path: &Path) -> Result<()> {
    let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
    pack(BufWriter::new(file), members).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes a picture.
pub(super) fn write_png(path: &Path, picture: &Raster) -> Result<()> {
    let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
    codec::encode_png(&mut BufWriter::new(file), picture, &Metadata::default())
        .with_context(|| format!("cannot write {}", path.display()))
}
