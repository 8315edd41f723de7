//! The surface of a reconstruction: the visual hull of the masks, from the cameras that COLMAP found.

use std::{fs, path::Path};

use super::process::unwritable;
use crate::{
    contract::{
        Fault, JobError,
        reconstruction::{ReconstructedHull, ReconstructionFinding},
    },
    jobs::masked_views::MaskedViews,
};
use pinstack_science::{
    hull::{self, Hull, HullOptions},
    photogrammetry::poses::{PoseReport, colmap_views},
    types::{Control, Interrupted, error::ErrorKind},
};

/// The hull, or why there is none.
pub(super) enum Surface {
    /// There is one. It has the unit of the model.
    Made(Box<Hull>, ReconstructedHull),
    /// Masks and cameras do not give one.
    Impossible(ReconstructionFinding),
    /// No view has a mask.
    WithoutMasks,
}

/// Makes the hull from the pictures in `folder` and the cameras of the model in `text`.
///
/// # Errors
/// [`JobError::Cancelled`], and the errors of the disk.
pub(super) fn surface(
    folder: &Path,
    text: &Path,
    poses: Option<&PoseReport>,
    control: &dyn Control,
) -> Result<Surface, JobError> {
    let [images, cameras] = ["images.txt", "cameras.txt"].map(|name| fs::read(text.join(name)));
    let (images, cameras) = (images.map_err(|e| unwritable(&e))?, cameras.map_err(|e| unwritable(&e))?);
    let views = colmap_views(("images.txt", &images), ("cameras.txt", &cameras)).map_err(Fault::from)?;
    let views = MaskedViews::of(folder, views).map_err(Fault::from)?;
    if views.cameras.is_empty() {
        return Ok(Surface::WithoutMasks);
    }
    match hull::from_views(&views.cameras, &views, &HullOptions::default(), control) {
        Ok(hull) => {
            let figures = figures(&hull, &views, poses);
            Ok(Surface::Made(Box::new(hull), figures))
        }
        Err(Interrupted::Failed(error)) if error.kind == ErrorKind::InvalidPoses => {
            let code = "no_surface".to_owned();
            let detail = format!("there is no surface from the masks: {}", error.detail);
            Ok(Surface::Impossible(ReconstructionFinding { code, detail, views: Vec::new() }))
        }
        Err(Interrupted::Failed(error)) => Err(Fault::from(error).into()),
        Err(Interrupted::Cancelled(cancelled)) => Err(cancelled.into()),
    }
}

fn figures(hull: &Hull, views: &MaskedViews, poses: Option<&PoseReport>) -> ReconstructedHull {
    let scale = poses.map_or(1.0, |report| report.scale.per_file_unit);
    let of = &hull.summary;
    let left_out = of.empty_views.iter().chain(&of.contradicting_views).filter_map(|&view| views.names.get(view));
    ReconstructedHull {
        volume: of.volume * scale.powi(3),
        area: of.area * scale.powi(2),
        size: of.size.map(|side| side * scale),
        cell: of.cell * scale,
        triangles: u32::try_from(of.triangles).unwrap_or(u32::MAX),
        left_out: left_out.cloned().collect(),
    }
}
