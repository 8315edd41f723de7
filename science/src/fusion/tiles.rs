//! The driver of the second pass: makes an image tile by tile, in parallel.

use std::sync::Mutex;

use rayon::prelude::*;

use super::run::{Run, locked};
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
    /// Number of pixels with a sample that was clamped.
    pub clamped: usize,
    /// Whether the stack contradicts the plan about its near end.
    pub contradicts_near_end: bool,
}

/// Makes an image of `C` channels, tile by tile; `stage` names its progress.
///
/// `tile` fuses a rectangle into an interleaved buffer and returns the number of pixels with a clamped sample. `tools`
/// makes its buffers, once per thread.
pub(super) fn in_tiles<S: Sample, const C: usize, T>(
    run: &Run<'_>,
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

    let mut pixels = vec![S::default(); width * height * C];
    let mut rest = pixels.as_mut_slice();
    let mut bands = Vec::new();
    for &(_, height) in &rows {
        let (band, below) = rest.split_at_mut(height * width * C);
        bands.push(Mutex::new(band));
        rest = below;
    }

    let done = Mutex::new(0);
    run.control.progress(stage, 0, tiles.len());
    let clamped = tiles
        .par_iter()
        .with_max_len(1)
        .map_init(
            || (tools(), Vec::new()),
            |(tools, out), &(row, rect)| -> Result<usize, Interrupted> {
                run.control.check()?;
                let clamped = tile(tools, rect, out)?;
                let mut band = locked(&bands[row]);
                for (y, line) in out.chunks_exact(rect.width * C).enumerate() {
                    let start = (y * width + rect.x) * C;
                    band[start..start + line.len()].copy_from_slice(line);
                }
                drop(band);
                let mut done = locked(&done);
                *done += 1;
                run.control.progress(stage, *done, tiles.len());
                Ok(clamped)
            },
        )
        .collect::<Result<Vec<_>, Interrupted>>()?;
    drop(bands);

    Ok(Blended { pixels, clamped: clamped.into_iter().sum(), contradicts_near_end: false })
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
