//! Calibration without a target: from stacks of the object itself.
//!
//! In: the front-lit slices of one or several views that one rig took at the same setting. Out: a [`Calibration`], as
//! from a dot target.
//!
//! | step | module | what it does |
//! |---|---|---|
//! | pictures | `picture` | fine detail of each slice at several resolutions |
//! | registration | `view`, `pair`, `window` | windows that slices 1, 2, 3, 5 and 8 apart share, each with its covariance |
//! | focus | `perspective` | where each window is in focus; what is far from it counts little |
//! | start | `refine` | the profile that a refinement starts from |
//! | geometry | `network`, `model`, `normal`, `banded`, `transform` | one fit of all transforms to all windows |
//! | brightness | `gains` | the gains that follow from neighbouring slices |
//! | capture mode | `capture_mode` | what brightness and parallax show of what moved |
//! | report | `report` | uncertainties, capture mode, camera, verdict |
//!
//! A stack shows a place sharply in few slices only, so errors of neighbours add up along the stack. Growth and
//! rotation by the rail ([`model::NetworkModel::FreeShifts`]) keep them small. What is left is included in the stated
//! standard deviations, and no calibration by stacks is graded better than usable. The method is described in
//! `docs/method/CALIBRATION_BY_STACKS.md`.

mod banded;
mod capture_mode;
mod gains;
mod matched;
mod model;
mod network;
mod normal;
mod pair;
mod perspective;
mod picture;
mod refine;
mod report;
#[cfg(test)]
mod tests;
mod transform;
mod view;
mod window;

use super::result::Calibration;
use super::transform_models::Frame;
use crate::imaging::Slices;
use crate::types::calibration_options::{CalibrationOptions, ModelChoice};
use crate::types::{Control, Error, ErrorKind, Interrupted};
use capture_mode::Shown;
use matched::Pair;
use model::{MODELS, NetworkModel, REFINING};
use network::{GROUPS, Network, NetworkFit};
use pair::LEAST_WINDOWS;
pub use refine::Revision;

/// Most slices that are registered, of all views together: of more views, some are passed over.
const MAX_SLICES: usize = 1200;
/// Views from which whole views are left out in turn to find the uncertainty, and not places of the image.
const MANY_VIEWS: usize = 6;
/// A simpler model is kept up to this factor above the scatter of the most complex one ...
const SCATTER_TOLERANCE: f64 = 1.15;
/// ... and if no two slices are displaced against it, over all views, by more than under the most complex one, px.
const MISFIT_TOLERANCE: f64 = 0.05;

/// Most memory that registration takes, bytes: the pictures of slices that are compared, at four thirds of the first
/// level each and with copies while they are made, and the windows.
pub const STACKS_BYTES: usize =
    picture::MAX_PIXELS * 4 * 4 / 3 * (view::LAGS[view::LAGS.len() - 1] + 3) + MAX_SLICES * 5 * 560 * 96;

/// Calibrates a rig from stacks of objects: `views` are the front-lit slices of stacks that were taken at the same
/// rail positions with the same camera, in the same order.
///
/// The reference slice is `options.reference_index`, by default the middle one. Homographies map slice px to
/// reference-slice px, as from a dot target. With a lens that moves they hold for what is in focus.
///
/// # Errors
/// - [`Interrupted::Cancelled`] when `control` cancels the work.
/// - [`ErrorKind::TargetNotFound`], with a sentence that names the slices, when slices share too little detail.
/// - [`ErrorKind::SizeMismatch`], [`ErrorKind::SliceCountMismatch`] when views or slices do not belong together.
/// - [`ErrorKind::InvalidParameter`] for fewer than three slices, or options that do not fit.
/// - Errors of [`Slices::load`].
///
/// # Example
/// ```
/// use std::sync::Arc;
///
/// use pinstack_science::calibration::calibrate_by_stacks;
/// use pinstack_science::synth::{Light, Rendered, Rig, Scene, Stage};
/// use pinstack_science::types::{NoControl, calibration_options::CalibrationOptions};
///
/// let rig = Rig { softness_px: 0.5, ..Rig::sized(420, 280, 5) };
/// let slices = Rendered::scene(Arc::new(Stage::new(&rig, &Scene::weave(1))), Light::Front);
/// let calibration = calibrate_by_stacks(&[&slices], &CalibrationOptions::default(), &NoControl)?;
/// let error_px = calibration.slices[0].homography.corner_distance(&rig.homography(0), 420, 280);
/// assert!(error_px < 1.0, "{error_px}");
/// # Ok::<(), pinstack_science::types::Interrupted>(())
/// ```
pub fn calibrate_by_stacks(
    views: &[&dyn Slices],
    options: &CalibrationOptions,
    control: &dyn Control,
) -> Result<Calibration, Interrupted> {
    calibrate(views, None, options, control)
}

/// Refines the homographies of a profile by stacks of objects: the rig has drifted, or the camera was taken off. The
/// rest is as for [`calibrate_by_stacks`], but gains, distortion, scale and camera are those of the profile, and so are
/// the homographies if the stacks show no drift. The findings say how far the image corners moved.
///
/// `options.model` is that of the change; the reference slice and the rail positions are those of the profile.
///
/// # Errors
/// As [`calibrate_by_stacks`]; [`ErrorKind::SizeMismatch`] and [`ErrorKind::SliceCountMismatch`] too when the profile
/// is for other slices; [`ErrorKind::InvalidProfile`] when a homography of it is singular.
pub fn refine_by_stacks(
    views: &[&dyn Slices],
    from: &Revision<'_>,
    options: &CalibrationOptions,
    control: &dyn Control,
) -> Result<Calibration, Interrupted> {
    let options = CalibrationOptions { reference_index: Some(from.input.reference_index), ..options.clone() };
    calibrate(views, Some(from), &options, control)
}

fn calibrate(
    views: &[&dyn Slices],
    from: Option<&Revision<'_>>,
    options: &CalibrationOptions,
    control: &dyn Control,
) -> Result<Calibration, Interrupted> {
    from.zip(views.first()).map_or(Ok(()), |(from, first)| from.check_count(*first))?;
    let (count, reference) = checked(views, options)?;
    let given = match from {
        Some(from) => from.input.rail_positions_mm.clone(),
        None => super::rail_positions(options, count)?,
    };
    let positions = given.clone().unwrap_or_else(|| (0..count).map(|i| i as f64).collect());
    let offsets: Vec<f64> = positions.iter().map(|z| z - positions[reference]).collect();
    let every = (views.len() * count).div_ceil(MAX_SLICES).max(1);
    let views: Vec<&dyn Slices> = views.iter().step_by(every).copied().collect();
    let first = views[0].load(0)?;
    let size = [first.width, first.height];
    drop(first);
    from.map_or(Ok(()), |from| from.check_size(size))?;

    let (mut pairs, focus) = registered(&views, size, control)?;
    require_connected(views[0], &pairs, count, reference)?;
    let beyond = perspective::weigh(&mut pairs, &focus, &offsets, from.is_some());
    let frame = Frame::new(size[0], size[1]);
    let start = from.map_or_else(|| Ok(vec![[0.0; 8]; count]), |from| from.transforms(&frame))?;
    if let Some(from) = from {
        from.undistort(&mut pairs, &frame);
    }
    let groups = groups(&pairs, views.len());
    let network = Network {
        pairs: &pairs,
        groups: &groups,
        beyond: &beyond,
        offsets: &offsets,
        reference,
        start: &start,
        start_growth: refine::growth(&start, &offsets),
        bend: if from.is_some() { perspective::NO_BEND } else { perspective::bend(options.capture_mode) },
        centre: [0.0; 2],
        frame: &frame,
        size: size.map(|v| v as u32),
    };
    let models: &[NetworkModel] = if from.is_some() { &REFINING } else { &MODELS };
    let has_parallax = from.is_some_and(Revision::has_parallax);
    let fits = models.iter().filter_map(|model| Some((*model, network.fit(*model, has_parallax)?)));
    let mut fits: Vec<(NetworkModel, NetworkFit)> = fits.collect();
    let mut chosen = chosen(&fits, options.model).ok_or_else(|| too_plain(views.len()))?;
    let refined = match from {
        Some(revision) => {
            let (changed, moved) = refine::changed(&mut fits, chosen, &start, &frame, network.size);
            chosen = changed;
            Some(report::Refined { revision, moved })
        }
        None => None,
    };
    // asked for under the model that expects nothing of the rail, and only reported
    let parallax = network.fit(NetworkModel::FreeSimilarities, true).and_then(|fit| fit.parallax);
    let measured = gains::gains(&pairs, count, reference);
    let shown = Shown::of(&fits[chosen].1.parameters, &offsets, &measured, parallax);
    let gains = from.map_or(measured, |from| (0..count).map(|slice| from.input.gain(slice)).collect());
    let facts = report::Facts {
        slices: views[0],
        views: views.len(),
        pairs: &pairs,
        fits: &fits,
        chosen,
        refined,
        shown,
        gains: &gains,
        positions: &positions,
        in_mm: given.is_some(),
        reference,
        frame: &frame,
        size: size.map(|v| v as u32),
    };
    report::calibration(&facts, options)
}

/// That the windows do not determine the transforms.
fn too_plain(views: usize) -> Error {
    let detail = format!(
        "the slices share too little detail to calibrate from them{}: photograph an object with fine detail all over the \
         picture and at all depths (a weave, a rough stone, a circuit board), or a dot target",
        if views == 1 { ", and there is only one view" } else { "" }
    );
    Error::new(ErrorKind::TargetNotFound, detail)
}

/// Number of slices of each view, and index of the reference slice.
fn checked(views: &[&dyn Slices], options: &CalibrationOptions) -> Result<(usize, usize), Error> {
    let invalid = |detail: String| Err(Error::new(ErrorKind::InvalidParameter, detail));
    let count = views.first().map_or(0, |view| view.count());
    if count < 3 {
        return invalid(format!("a calibration by stacks needs at least 3 slices, but there are {count}"));
    }
    if let Some(view) = views.iter().find(|view| view.count() != count) {
        let detail = format!(
            "the first stack has {count} slices, but the one of {} has {}: stacks that are to give one profile must \
             have the same number of slices; calibrate them one by one",
            view.name(0),
            view.count()
        );
        return Err(Error::new(ErrorKind::SliceCountMismatch, detail));
    }
    if matches!(options.model, ModelChoice::Affine | ModelChoice::Homography) {
        return invalid(
            "stacks determine at most scale, rotation and shift per slice: give model=auto, similarity or \
                        rail_linear"
                .into(),
        );
    }
    let reference = options.reference_index.map_or(count / 2, |index| index as usize);
    if reference >= count {
        return invalid(format!(
            "reference_index is {reference}, but the stacks have {count} slices: use an index from 0 to {}",
            count - 1
        ));
    }
    Ok((count, reference))
}

/// The pairs of all views, and per view and cell the slice in which it is in focus.
type RegisteredViews = (Vec<Pair>, Vec<Vec<Option<f64>>>);

fn registered(views: &[&dyn Slices], size: [usize; 2], control: &dyn Control) -> Result<RegisteredViews, Interrupted> {
    let total = views.iter().map(|view| view.count()).sum();
    let (mut pairs, mut focus) = (Vec::new(), Vec::new());
    let done = std::cell::Cell::new(0);
    control.progress("registering", 0, total);
    for (number, view) in views.iter().enumerate() {
        let found = view::register(number, *view, size, control, &|| {
            done.set(done.get() + 1);
            control.progress("registering", done.get(), total);
        })?;
        pairs.extend(found.pairs);
        focus.push(perspective::focus(&found.cells));
    }
    Ok((pairs, focus))
}

/// Checks that every slice is registered with the reference slice, over others if need be.
fn require_connected(slices: &dyn Slices, pairs: &[Pair], count: usize, reference: usize) -> Result<(), Error> {
    let mut reached = vec![false; count];
    reached[reference] = true;
    loop {
        let before = reached.iter().filter(|r| **r).count();
        for pair in pairs.iter().filter(|pair| pair.windows.len() >= LEAST_WINDOWS) {
            let [a, b] = pair.slices;
            let either = reached[a] || reached[b];
            (reached[a], reached[b]) = (either, either);
        }
        if before == reached.iter().filter(|r| **r).count() {
            break;
        }
    }
    let apart: Vec<usize> = (0..count).filter(|&slice| !reached[slice]).collect();
    let Some(&first) = apart.first() else { return Ok(()) };
    let name = slices.name(first);
    let detail = format!(
        "{name} (slice {first}){} shares too little detail with its neighbours to calibrate from the pictures: check \
         that it shows the same view and is not empty, take smaller steps, or photograph an object with fine detail all \
         over the picture, or a dot target",
        match apart.len() {
            1 => String::new(),
            n => format!(" and {} more", n - 1),
        }
    );
    Err(Error::new(ErrorKind::TargetNotFound, detail).in_file(name, Some(first as u32)))
}

/// Per pair and window the group with which it is left out: views where there are many, else places of the image.
fn groups(pairs: &[Pair], views: usize) -> Vec<Vec<u8>> {
    const SIDE: f64 = 4.0;
    let bounds = |axis: usize| {
        let values = || pairs.iter().flat_map(|p| &p.windows).map(|w| w.first[axis]);
        [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)]
    };
    let bounds = [bounds(0), bounds(1)];
    let place = |at: [f64; 2]| {
        let [x, y] = [0, 1].map(|a| {
            let [low, high] = bounds[a];
            ((SIDE * (at[a] - low) / (high - low).max(1e-12)) as usize).min(SIDE as usize - 1)
        });
        y * SIDE as usize + x
    };
    let of_pair = |pair: &Pair| {
        let of_window = |window: &matched::WindowMatch| match views >= MANY_VIEWS {
            true => (pair.view * GROUPS.min(views) / views) as u8,
            false => place(window.first) as u8,
        };
        pair.windows.iter().map(of_window).collect()
    };
    pairs.iter().map(of_pair).collect()
}

/// Index of the fit to use, of those that change the start: the simplest that agrees with the windows about as well as
/// the most complex one, or the one that was asked for.
fn chosen(fits: &[(NetworkModel, NetworkFit)], requested: ModelChoice) -> Option<usize> {
    let wanted = match requested {
        ModelChoice::RailLinear => Some(NetworkModel::Rail),
        ModelChoice::Similarity => Some(NetworkModel::FreeSimilarities),
        ModelChoice::Auto | ModelChoice::Affine | ModelChoice::Homography => None,
    };
    if wanted.is_some() {
        return fits.iter().position(|(model, _)| Some(*model) == wanted);
    }
    let (_, best) = fits.last()?;
    fits.iter().position(|(model, fit)| {
        *model != NetworkModel::Unchanged
            && fit.scatter <= SCATTER_TOLERANCE * best.scatter
            && fit.misfit <= best.misfit + MISFIT_TOLERANCE
    })
}
