//! Second pass: tile by tile, in parallel, into the picture.

use std::sync::Mutex;

use rayon::prelude::*;

use super::{Run, align::Aligned, locked, presence::Presence, tile::Blender};
use crate::{
    imaging::{Rect, Sample},
    types::Interrupted,
};

/// Largest side of a tile, px. Larger tiles waste less on the surroundings that the filters look at, smaller
/// ones meet fewer slices.
pub(super) const TILE: usize = 512;

/// What the second pass makes.
pub(super) struct Blended<S> {
    /// Interleaved samples of the canvas.
    pub pixels: Vec<S>,
    /// Pixels with a sample that had to be clamped.
    pub clamped: usize,
}

/// Runs the second pass of guided filtering.
pub(super) fn blend<S: Sample, const C: usize>(run: &Run<'_>, aligned: &Aligned) -> Result<Blended<S>, Interrupted> {
    let presence = Presence::new(&aligned.index, aligned.coverages.len());
    let blender = || Blender::<S>::new(&run.plan.params);
    in_tiles::<S, C, _>(run, "fusing", blender, |blender, rect, out| {
        blender.tile::<C>(rect, aligned, &presence, run.control, out)
    })
}

/// Makes a picture tile by tile, in parallel; `stage` is what its progress is called. `tile` fuses a rectangle into the samples it is given, interleaved, with
/// what `tools` has made for its thread, and says in how many pixels a sample had to be clamped.
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

    Ok(Blended { pixels, clamped: clamped.into_iter().sum() })
}

/// `length` cut into as few and as equal pieces of at most `most` as can be: (start, length) each.
fn pieces(length: usize, most: usize) -> Vec<(usize, usize)> {
    let count = length.div_ceil(most).max(1);
    (0..count)
        .map(|i| {
            let (start, end) = (i * length / count, (i + 1) * length / count);
            (start, end - start)
        })
        .collect()
}
