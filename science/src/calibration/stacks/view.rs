//! One view: its slices in order, each registered with the slices before it.

use std::collections::VecDeque;

use nalgebra::Matrix3;
use rayon::prelude::*;

use super::matched::{Pair, WindowMatch};
use super::pair::{Registered, Registration};
use super::picture::{Cells, Picture};
use super::transform::{matrix, parameters};
use crate::calibration::statistics::median;
use crate::calibration::transform_models::{self, Frame, Match, Parameters, TransformModel};
use crate::imaging::{Raster, Slices};
use crate::types::{Control, Error, ErrorKind, Interrupted};

/// Distances of the slices that are compared, in slices. Distant ones keep the errors of neighbours from adding up.
pub(super) const LAGS: [usize; 5] = [1, 2, 3, 5, 8];

/// What registration found in a view.
pub(super) struct View {
    /// The pairs that share windows.
    pub pairs: Vec<Pair>,
    /// Per slice the measurements of its cells.
    pub cells: Vec<Cells>,
}

/// Registers the slices of a view. `done` is called after each slice.
///
/// # Errors
/// [`Interrupted::Cancelled`]; errors of [`Slices::load`]; an error that names a slice of another size.
pub(super) fn register(
    number: usize,
    slices: &dyn Slices,
    size: [usize; 2],
    control: &dyn Control,
    done: &dyn Fn(),
) -> Result<View, Interrupted> {
    let frame = Frame::new(size[0], size[1]);
    let count = slices.count();
    let mut recent: VecDeque<Picture> = VecDeque::new();
    let mut neighbours: Vec<Option<Parameters>> = Vec::new();
    let (mut pairs, mut cells) = (Vec::new(), Vec::new());
    let mut next = Some(load(slices, 0, size)?);
    while let Some(raster) = next.take() {
        control.check()?;
        let index = cells.len();
        let picture = Picture::of(&raster);
        cells.push(picture.cells.clone());
        let (found, loaded) = rayon::join(
            || with_earlier(&picture, index, &recent, &mut neighbours, &frame),
            || (index + 1 < count).then(|| load(slices, index + 1, size)).transpose(),
        );
        for (lag, registered) in found {
            let slices = [index - lag, index];
            let brightness = brightness(&cells[slices[0]], &cells[slices[1]]);
            pairs.push(Pair { view: number, slices, windows: registered.windows, brightness });
        }
        next = loaded?;
        recent.push_front(picture);
        recent.truncate(LAGS[LAGS.len() - 1]);
        done();
    }
    Ok(View { pairs, cells })
}

fn load(slices: &dyn Slices, index: usize, size: [usize; 2]) -> Result<Raster, Error> {
    let raster = slices.load(index)?;
    if [raster.width, raster.height] == size {
        return Ok(raster);
    }
    let name = slices.name(index);
    let detail = format!(
        "{name} is {} x {} px, but the first slice is {} x {} px: all slices of all views must have the same size",
        raster.width, raster.height, size[0], size[1]
    );
    Err(Error::new(ErrorKind::SizeMismatch, detail).in_file(name, Some(index as u32)))
}

/// Registers slice `index` with the slices before it, the nearest first in `recent`. Adds the map from its neighbour
/// to `neighbours`. Returns the distances with what was found.
fn with_earlier(
    picture: &Picture,
    index: usize,
    recent: &VecDeque<Picture>,
    neighbours: &mut Vec<Option<Parameters>>,
    frame: &Frame,
) -> Vec<(usize, Registered)> {
    let Some(neighbour) = recent.front() else { return Vec::new() };
    let nearest = Registration { first: neighbour, second: picture, frame }.run(None);
    neighbours.push(nearest.as_ref().map(|found| refined(found, frame)));
    // from slice `index - lag`, by the maps of the neighbours between
    let chained = |lag: usize| -> Option<Parameters> {
        let maps = neighbours.get(index.checked_sub(lag)?..)?;
        let product = maps.iter().try_fold(Matrix3::identity(), |sum, map| Some(matrix(map.as_ref()?) * sum))?;
        Some(parameters(&product))
    };
    let far = LAGS[1..].par_iter().filter_map(|&lag| {
        let first = recent.get(lag - 1)?;
        Some((lag, Registration { first, second: picture, frame }.run(Some(chained(lag)?))?))
    });
    let far: Vec<(usize, Registered)> = far.collect();
    nearest.map(|found| (1, found)).into_iter().chain(far).collect()
}

/// The map of a pair by all its windows.
fn refined(found: &Registered, frame: &Frame) -> Parameters {
    let sigma = |w: &WindowMatch| (2.0 / w.information.trace()).sqrt();
    let matches: Vec<Match> = found
        .windows
        .iter()
        .map(|w| Match { base: w.first, here: w.second, sigma: sigma(w).max(1e-2 / frame.half) })
        .collect();
    let fit = transform_models::fit(TransformModel::Similarity, &matches);
    fit.map_or(found.map, |fit| TransformModel::Similarity.parameters(&fit.free))
}

/// Darkest mean of a cell whose brightness counts, grey levels of 255.
const DARK: f32 = 4.0;

/// `ln` of the brightness of the second slice over the first: the median of the cells, with its standard deviation.
fn brightness(first: &Cells, second: &Cells) -> Option<[f64; 2]> {
    let ratio = |(a, b): (&f32, &f32)| (*a > DARK && *b > DARK).then(|| f64::from(*b / *a).ln());
    let mut ratios: Vec<f64> = first.brightness.iter().zip(&second.brightness).filter_map(ratio).collect();
    if ratios.len() < 8 {
        return None;
    }
    let middle = median(&mut ratios);
    let mut off: Vec<f64> = ratios.iter().map(|r| (r - middle).abs()).collect();
    let spread = 1.48 * median(&mut off);
    Some([middle, (1.25 * spread / (ratios.len() as f64).sqrt()).max(1e-4)])
}
