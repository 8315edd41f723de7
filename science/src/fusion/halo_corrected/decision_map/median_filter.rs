//! A separable 5 x 5 median filter for decision maps: removes single outliers and smooths ragged borders.

use rayon::prelude::*;

use super::super::warped_slices::WarpedSlices;
use crate::{
    fusion::plan::UNCOVERED,
    imaging::{
        Plane, Sample,
        simd::{self, Avx2},
    },
};

/// How far around a pixel the filter looks, px.
pub(super) const MEDIAN_REACH: usize = 2;

/// The median over five rows of the medians over five columns; beyond the canvas its border is repeated. A pixel keeps
/// its slice where the new slice does not cover it.
pub(super) fn median_filter<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &Plane<u16>,
) -> Plane<u16> {
    let (width, height) = (map.width, map.height);
    let simd = Avx2::detect();
    let mut across = vec![0u16; width * height];
    across.par_chunks_mut(width).enumerate().for_each_init(Vec::new, |line: &mut Vec<u16>, (y, out)| {
        let row = map.row(y);
        line.clear();
        line.extend([row[0]; 2]);
        line.extend_from_slice(row);
        line.extend([row[width - 1]; 2]);
        simd::run(
            simd,
            #[inline(always)]
            || medians(std::array::from_fn(|by| &line[by..by + width]), out),
        );
    });
    let mut filtered = Plane { width, height, data: vec![0u16; width * height] };
    filtered.data.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let rows = [-2, -1, 0, 1, 2].map(|d: isize| {
            let y = y.saturating_add_signed(d).min(height - 1);
            &across[y * width..(y + 1) * width]
        });
        simd::run(
            simd,
            #[inline(always)]
            || medians(rows, out),
        );
        for (x, (new, &old)) in out.iter_mut().zip(map.row(y)).enumerate() {
            let known = *new != UNCOVERED && old != UNCOVERED;
            if *new != old && !(known && slices.coverage(usize::from(*new)).span(y).contains(&x)) {
                *new = old;
            }
        }
    });
    filtered
}

/// The median of five rows, pixel by pixel.
#[inline(always)]
fn medians([a, b, c, d, e]: [&[u16]; 5], out: &mut [u16]) {
    for (((((out, a), b), c), d), e) in out.iter_mut().zip(a).zip(b).zip(c).zip(d).zip(e) {
        *out = median([*a, *b, *c, *d, *e]);
    }
}

#[inline(always)]
fn median([a, b, c, d, e]: [u16; 5]) -> u16 {
    let (a, b) = (a.min(b), a.max(b));
    let (c, d) = (c.min(d), c.max(d));
    // the least and the greatest of the first four cannot be the median of five
    let (low, high) = (a.max(c), b.min(d));
    let (low, high) = (low.min(high), low.max(high));
    e.clamp(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_five_is_the_middle_of_the_sorted_values() {
        for code in 0..3125u16 {
            let values = [code % 5, code / 5 % 5, code / 25 % 5, code / 125 % 5, code / 625];
            let mut sorted = values;
            sorted.sort_unstable();
            assert_eq!(median(values), sorted[2], "{values:?}");
        }
    }
}
