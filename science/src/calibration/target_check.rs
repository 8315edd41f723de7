//! Recognises an image of a dot target.

use super::{detection, statistics::range};
use crate::{
    imaging::{Raster, thumbnail},
    types::{Cancelled, Control},
};

/// Longer side of the reduced copy that is searched, px. Every stack is searched, so the copy is small; 80 columns of
/// dots are still found in it.
const SIDE: usize = 600;
/// Least number of dots.
const MIN_DOTS: usize = 60;
/// Least share of the grid positions spanned by the dots that must hold a dot.
const FILLED: f64 = 0.7;
/// Least share of the image that the dots must span.
const SPANNED: f64 = 0.2;

/// The number of dots when `picture` shows a dot target, else `None`. Objects with some regular dots (connectors of a
/// circuit board, rows of hairs) do not count: the dots must fill a grid, and the grid must fill the image.
///
/// # Errors
/// When the work is cancelled.
///
/// # Example
/// ```
/// use pinstack_science::calibration::dot_target;
/// use pinstack_science::synth::{DotTarget, Rig, render_target};
/// use pinstack_science::types::NoControl;
///
/// let rig = Rig::sized(600, 400, 5);
/// let picture = render_target(&rig, &DotTarget::for_rig(&rig, 18), 2);
/// assert!(dot_target(&picture, &NoControl)?.is_some_and(|dots| dots > 100));
/// # Ok::<(), pinstack_science::types::Cancelled>(())
/// ```
pub fn dot_target(picture: &Raster, control: &dyn Control) -> Result<Option<usize>, Cancelled> {
    let picture = thumbnail::luma(picture, SIDE);
    let Some((_, lattice)) = detection::detect_grid(&picture, control)? else { return Ok(None) };
    let span = |(low, high): (f64, f64)| (high - low).max(0.0);
    let places = &lattice.places;
    let cells = [0, 1].map(|axis| 1.0 + span(range(places.keys().map(|label| f64::from(label[axis])))));
    let extent = [0, 1].map(|axis| span(range(places.values().map(|place| place[axis]))));
    let is_filled = places.len() as f64 >= FILLED * cells[0] * cells[1];
    let is_wide = extent[0] * extent[1] >= SPANNED * (picture.width * picture.height) as f64;
    Ok((places.len() >= MIN_DOTS && is_filled && is_wide).then_some(places.len()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        synth::{DotTarget, Light, Rig, Scene, Stage, render_target},
        types::NoControl,
    };

    #[test]
    fn coarse_and_fine_targets_are_recognised() {
        let rig = Rig::sized(1500, 1000, 5);
        for (columns, dots) in [(12, 60), (30, 400), (80, 3000)] {
            let target = render_target(&rig, &DotTarget::for_rig(&rig, columns), 2);
            let found = dot_target(&target, &NoControl).unwrap();
            assert!(found.is_some_and(|found| found >= dots), "{columns} columns: {found:?}");
        }
    }

    fn no_targets(scenes: impl IntoIterator<Item = Scene>) {
        let rig = Rig::sized(600, 400, 5);
        for scene in scenes {
            let picture = Stage::new(&rig, &scene).render(Light::Front, 2);
            assert_eq!(dot_target(&picture, &NoControl).unwrap(), None, "{scene:?}");
        }
    }

    #[test]
    fn objects_are_no_targets() {
        no_targets([Scene::insect(3), Scene::weave(1)]);
    }

    #[test]
    #[ignore = "more cases of a test"]
    fn more_objects_are_no_targets() {
        no_targets([Scene::flower(5), Scene::plates(1), Scene::wing(2)]);
    }
}
