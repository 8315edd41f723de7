//! Labels without single ones among others and without frayed borders.

use rayon::prelude::*;

use super::pictures::Pictures;
use crate::{
    fusion::UNCOVERED,
    imaging::{
        Plane, Sample,
        simd::{self, Avx2},
    },
};

/// The median over five columns of the medians over five rows: single labels and frayed borders go. A pixel keeps its
/// label where the new one's slice does not cover it.
pub(super) fn calmed<S: Sample, const C: usize>(pictures: &Pictures<'_, S, C>, labels: &Plane<u16>) -> Plane<u16> {
    let (width, height) = (labels.width, labels.height);
    let simd = Avx2::detect();
    let mut across = vec![0u16; width * height];
    across.par_chunks_mut(width).enumerate().for_each_init(Vec::new, |line: &mut Vec<u16>, (y, out)| {
        let row = labels.row(y);
        line.clear();
        line.extend([row[0]; 2]);
        line.extend_from_slice(row);
        line.extend([row[width - 1]; 2]);
        simd::run(
            simd,
            #[inline(always)]
            || middles(std::array::from_fn(|by| &line[by..by + width]), out),
        );
    });
    let mut calm = Plane { width, height, data: vec![0u16; width * height] };
    calm.data.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let rows = [-2, -1, 0, 1, 2].map(|d: isize| {
            let y = y.saturating_add_signed(d).min(height - 1);
            &across[y * width..(y + 1) * width]
        });
        simd::run(
            simd,
            #[inline(always)]
            || middles(rows, out),
        );
        for (x, (new, &old)) in out.iter_mut().zip(labels.row(y)).enumerate() {
            let known = *new != UNCOVERED && old != UNCOVERED;
            if *new != old && !(known && pictures.coverage(usize::from(*new)).span(y).contains(&x)) {
                *new = old;
            }
        }
    });
    calm
}

/// The median of five rows, pixel by pixel.
#[inline(always)]
fn middles([a, b, c, d, e]: [&[u16]; 5], out: &mut [u16]) {
    for (((((out, a), b), c), d), e) in out.iter_mut().zip(a).zip(b).zip(c).zip(d).zip(e) {
        *out = middle([*a, *b, *c, *d, *e]);
    }
}

/// The median of five.
#[inline(always)]
fn middle([a, b, c, d, e]: [u16; 5]) -> u16 {
    let (a, b) = (a.min(b), a.max(b));
    let (c, d) = (c.min(d), c.max(d));
    // of four, the least and the greatest are not the median
    let (low, high) = (a.max(c), b.min(d));
    let (low, high) = (low.min(high), low.max(high));
    e.clamp(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_five_is_their_median() {
        for code in 0..3125u16 {
            let values = [code % 5, code / 5 % 5, code / 25 % 5, code / 125 % 5, code / 625];
            let mut sorted = values;
            sorted.sort_unstable();
            assert_eq!(middle(values), sorted[2], "{values:?}");
        }
    }
}
