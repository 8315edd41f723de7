//! The bundle of a run for a reconstruction program, as a folder. Images and masks are links to the results where the
//! file system has them, else copies.

use std::{fs, path::Path};

use anyhow::{Context, Result};

use super::{fused::Fused, output::Output};
use crate::cli::local::{View, name_of};
use pinstack_science::photogrammetry::bundle::{self, BundleScan, BundleView, Content, Layout};

/// The layout of this name.
pub(super) fn layout(text: &str) -> Result<Layout, String> {
    let known = || Layout::ALL.map(Layout::name).join(", ");
    Layout::ALL.into_iter().find(|layout| layout.name() == text).ok_or_else(|| format!("choose one of {}", known()))
}

/// Writes the bundle of the stacks that were fused, and returns the name of its folder.
///
/// # Errors
/// What [`bundle::plan`] refuses; when a file cannot be written.
pub(super) fn write(layout: Layout, output: &Output, views: &[View], fused: &[Fused]) -> Result<String> {
    let name = format!("bundle-{}", layout.name());
    let folder = output.folder.join(&name);
    for entry in bundle::plan(layout, &described(output, views, fused))? {
        let path = folder.join(&entry.path);
        let parent = path.parent().unwrap_or(&folder);
        fs::create_dir_all(parent).with_context(|| format!("cannot make the folder {}", parent.display()))?;
        let result = |at: usize, what: &str| {
            let file = fused.get(at).and_then(|fused| Some(fused.folder.join(fused.files.get(what)?)));
            file.with_context(|| format!("the bundle refers to {}, which no stack has", entry.path))
        };
        match &entry.content {
            Content::Text(text) => {
                fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?
            }
            Content::Image(at) => place(&result(*at, "image")?, &path)?,
            Content::Mask(at) => place(&result(*at, "mask")?, &path)?,
        }
    }
    Ok(name)
}

fn place(from: &Path, to: &Path) -> Result<()> {
    let _ = fs::remove_file(to);
    if fs::hard_link(from, to).is_err() {
        fs::copy(from, to).with_context(|| format!("cannot write {}", to.display()))?;
    }
    Ok(())
}

/// All stacks have one profile and one crop, so one camera.
fn described(output: &Output, views: &[View], fused: &[Fused]) -> BundleScan {
    let image = fused.first().map(|fused| &fused.image);
    let canvas = fused.first().map_or([1, 1], |fused| [fused.slices.width, fused.slices.height]);
    let offset = image.map_or([0, 0], |image| image.crop_offset_px);
    let view = |fused: &Fused| BundleView {
        stem: fused.name.clone(),
        extension: fused
            .files
            .get("image")
            .and_then(|file| file.rsplit_once('.'))
            .map_or("png", |(_, end)| end)
            .to_owned(),
        bit_depth: fused.image.bit_depth,
        has_mask: fused.files.contains_key("mask"),
        angles: views.iter().find(|view| view.name == fused.name).and_then(|view| view.angles),
    };
    BundleScan {
        name: name_of(&output.folder),
        width: image.map_or(0, |image| image.width),
        height: image.map_or(0, |image| image.height),
        intrinsics: image.and_then(|image| image.intrinsics),
        canvas_centre_px: [0, 1].map(|axis| (f64::from(canvas[axis]) - 1.0) / 2.0 - f64::from(offset[axis])),
        radius_mm: None,
        pan_is_clockwise: false,
        views: fused.iter().map(view).collect(),
    }
}
