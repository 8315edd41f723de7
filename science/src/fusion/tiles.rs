//! The driver of the second pass: makes an image tile by tile, in parallel.

use std::sync::Mutex;

use rayon::prelude::*;

use super::{
    align::Aligned,
    lock::{Spare, locked},
    plan::UNCOVERED,
    run::Run,
};
use crate::{
    imaging::{Rect, Sample},
    types::Interrupted,
};

/// Largest side of a tile, px. Filters look beyond a tile, so large tiles waste less; small tiles meet fewer slices.
pub(super) const TILE: usize = 512;

/// What the second pass makes.
pub(super) struct Blended<S> {
    /// Interleaved samples of the canvas.
    pub pixels: Vec<S>,
    /// Fraction of the fused and covered pixels that have a sample that was clamped.
    pub clamped: f64,
    /// Whether the stack contradicts the plan about its near end.
    pub contradicts_profile: bool,
}

/// Makes an image of `C` channels, tile by tile; `stage` names its progress. Every pixel within `margin` px of a shown
/// pixel is fused.
///
/// `tile` fuses a rectangle into an interleaved buffer and returns the number of pixels with a clamped sample. `tools`
/// makes its buffers, once per thread.
pub(super) fn in_tiles<S: Sample, const C: usize, T: Send>(
    (run, aligned, margin): (&Run<'_>, &Aligned, usize),
    stage: &'static str,
    tools: impl Fn() -> T + Sync,
    tile: impl Fn(&mut T, Rect, &mut Vec<S>) -> Result<usize, Interrupted> + Sync,
) -> Result<Blended<S>, Interrupted> {
    let (width, height) = (run.plan.width, run.plan.height);
    let (columns, rows) = (pieces(width, run.tile), pieces(height, run.tile));
    let tiles: Vec<(usize, Rect)> = rows
        .iter()
        .enumerate()
        .flat_map(|(row, &(y, height))| columns.iter().map(move |&(x, width)| (row, Rect { x, y, width, height })))
        .collect();

    let mut pixels = run.unfused::<S, C>(aligned)?;
    let mut rest = pixels.as_mut_slice();
    let mut bands = Vec::new();
    for &(_, height) in &rows {
        let (band, below) = rest.split_at_mut(height * width * C);
        bands.push(Mutex::new(band));
        rest = below;
    }

    let (done, spare) = (Mutex::new(0), Spare::new());
    run.control.progress(stage, 0, tiles.len());
    let counts = tiles
        .par_iter()
        .with_max_len(1)
        .map(|&(row, rect)| -> Result<[usize; 2], Interrupted> {
            run.control.check()?;
            let counts = match run.part_to_fuse(rect, margin) {
                None => [0, 0],
                Some(part) => spare.with(
                    || (tools(), Vec::new()),
                    |(tools, out)| {
                        let clamped = tile(tools, part, out)?;
                        let mut band = locked(&bands[row]);
                        for (y, line) in out.chunks_exact(part.width * C).enumerate() {
                            let start = ((part.y - rect.y + y) * width + part.x) * C;
                            band[start..start + line.len()].copy_from_slice(line);
                        }
                        Ok::<_, Interrupted>([part.width * part.height, clamped])
                    },
                )?,
            };
            let mut done = locked(&done);
            *done += 1;
            run.control.progress(stage, *done, tiles.len());
            Ok(counts)
        })
        .collect::<Result<Vec<_>, Interrupted>>()?;
    drop(bands);

    let [fused, clamped] = counts.into_iter().fold([0, 0], |[a, b], [c, d]| [a + c, b + d]);
    let covered = aligned.index.data.par_iter().filter(|&&slice| slice != UNCOVERED).count();
    let clamped = clamped as f64 / fused.min(covered).max(1) as f64;
    Ok(Blended { pixels, clamped, contradicts_profile: false })
}

/// `length` divided into the fewest pieces of at most `max`, as equal as possible: (start, length) of each.
fn pieces(length: usize, max: usize) -> Vec<(usize, usize)> {
    let count = length.div_ceil(max).max(1);
    (0..count)
        .map(|i| {
            let (start, end) = (i * length / count, (i + 1) * length / count);
            (start, end - start)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        fusion::{
            FusionRequest, Plan,
            align::{self, focus_measure::FocusMeasure},
            sample_format::FormattedSlices,
        },
        imaging::{Plane, Raster},
        types::{NoControl, fusion_options::GuidedParams},
    };

    #[test]
    fn the_clamped_fraction_is_that_of_the_pixels_that_were_fused() {
        let ramp = (0..90 * 60).map(|at| (at % 251) as u8).collect();
        let rasters = [Raster::eight(90, 60, 1, ramp)];
        let shown = Plane::from_fn(90, 60, |x, y| u8::from((40..50).contains(&x) && (20..30).contains(&y)));
        let (slices, plan, folder) = (&&rasters[..], Plan::aligned(90, 60, 1), std::env::temp_dir());
        let request = FusionRequest { shown: Some(&shown), ..FusionRequest::default() };
        let run = Run {
            slices: FormattedSlices::open(slices, &plan).unwrap(),
            plan: &plan,
            request: &request,
            scratch_dir: &folder,
            control: &NoControl,
            decision_map: None,
            tile: 32,
        };
        let measure = FocusMeasure::saliency(&GuidedParams::default());
        let aligned = align::align::<u8, 1>(&run, measure, None).unwrap();
        // 18 x 18 px are fused, or 34 x 34 px; of each, 10 x 10 px are clamped
        for (margin, side) in [(4, 18.0), (12, 34.0)] {
            let tile = |(): &mut (), rect: Rect, out: &mut Vec<u8>| -> Result<usize, Interrupted> {
                out.clear();
                out.resize(rect.width * rect.height, 0);
                Ok(shown.crop(rect).data.iter().filter(|&&shown| shown != 0).count())
            };
            let blended = in_tiles::<u8, 1, _>((&run, &aligned, margin), "fusing", || (), tile).unwrap();
            assert_eq!(blended.clamped, 100.0 / (side * side), "margin {margin}");
        }
    }
}
