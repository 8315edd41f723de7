//! Writes what a user of a real rig would have, and the truth beside it.

use std::{
    fs::{self, File},
    io::BufWriter,
    path::Path,
};

use anyhow::{Context, Result};

use super::{
    super::files::{stack_members, write_png, write_target, write_zip},
    setup::Setup,
};
use crate::cli::output::note;
use pinstack_science::{
    imaging::{Raster, Samples},
    photogrammetry::bundle::{self, Content, Layout},
    synth::turntable::Surface,
};

/// Length of the edges of the true surface, mm.
const SURFACE_EDGE_MM: f64 = 0.1;

/// The slices of the dot target.
pub(super) const TARGET: &str = "target.zip";
/// The slices of all views, one of which has a fault.
pub(super) const SCAN: &str = "scan.zip";
/// The view with the fault, photographed again.
pub(super) const RETAKE: &str = "retake.zip";
/// The bundle of an ideal camera, and the true surface.
pub(super) const TRUTH: &str = "truth";

/// Renders all files into `out`.
pub(super) fn write(setup: &Setup, out: &Path) -> Result<()> {
    note("rendering the dot target");
    write_target(&setup.rig, &setup.target(), &out.join(TARGET))?;
    note(format!("rendering {} views", setup.views.len()));
    let knocked = setup.knocked_view();
    let members = setup.views.iter().flat_map(|&angles| {
        let stage = if angles == knocked { setup.knocked_stage() } else { setup.stage(angles) };
        let folder = angles.file_stem();
        stack_members(&stage).into_iter().map(move |(name, file)| (format!("{folder}/{name}"), file))
    });
    write_zip(members, &out.join(SCAN))?;
    write_zip(stack_members(&setup.stage(knocked)).into_iter(), &out.join(RETAKE))?;
    note("rendering the truth");
    write_truth(setup, &out.join(TRUTH))
}

/// Where the ideal image of a view is.
pub(super) fn true_image(name: &str) -> String {
    format!("{TRUTH}/images/{name}.png")
}

/// Where the true mask of a view is, with the name that COLMAP expects.
pub(super) fn true_mask(name: &str) -> String {
    format!("{TRUTH}/masks/{name}.png.png")
}

/// A bundle for COLMAP of what an ideal camera, with everything in focus, would have taken, and `surface.ply`.
fn write_truth(setup: &Setup, folder: &Path) -> Result<()> {
    for folder in ["images", "masks", "sparse/0"].map(|name| folder.join(name)) {
        fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    let ideal = setup.ideal();
    for entry in bundle::plan(Layout::Colmap, &ideal)? {
        let path = folder.join(&entry.path);
        match entry.content {
            Content::Text(text) => {
                fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
            }
            Content::Image(at) => {
                let mut seen = setup.stage(setup.views[at]).truth();
                black_outside(&mut seen.sharp, &seen.mask.data);
                write_png(&path, &seen.sharp)?;
                let mask = Raster::eight(seen.mask.width, seen.mask.height, 1, seen.mask.data);
                write_png(&folder.join(format!("masks/{}.png.png", ideal.views[at].stem)), &mask)?;
            }
            // written beside its image, so that each view is rendered once
            Content::Mask(_) => {}
        }
    }
    let path = folder.join("surface.ply");
    let file = File::create(&path).with_context(|| format!("cannot write {}", path.display()))?;
    let surface = Surface::of(&setup.specimen, SURFACE_EDGE_MM);
    surface.write_ply(BufWriter::new(file)).with_context(|| format!("cannot write {}", path.display()))
}

/// Paints what is not the object black, as the service does.
fn black_outside(picture: &mut Raster, mask: &[u8]) {
    if let Samples::Eight(samples) = &mut picture.samples {
        for (pixel, _) in samples.chunks_exact_mut(picture.channels).zip(mask).filter(|(_, mask)| **mask == 0) {
            pixel.fill(0);
        }
    }
}
