//! The inner loops: sums of cells, coefficients of windows, interpolation between cells.

use super::cell_window::CELL;
use crate::imaging::filter::guided::window::{SCALE, float, rounded};

/// Coefficients are stored in units of 2^-20.
pub(super) const UNIT: f64 = 1_048_576.0;
/// Between the middles of which cells a pixel lies: the first of them, and the share of the second.
pub(super) fn between(y: usize) -> (isize, f32) {
    let first = (y + CELL / 2) / CELL;
    (first as isize - 1, SHARES[(y + CELL / 2) % CELL])
}

/// Shares of the second of two cells in the pixels between their middles.
const SHARES: [f32; CELL] = [0.125, 0.375, 0.625, 0.875];

#[inline(always)]
pub(super) fn spread(cells: &[f32], out: &mut [f32]) {
    for (out, pair) in out.as_chunks_mut::<CELL>().0.iter_mut().zip(cells.windows(2)) {
        *out = SHARES.map(|share| pair[0] + share * (pair[1] - pair[0]));
    }
}

/// Cells that are summed up at a time.
const REGION: usize = 8;

/// Sums of `I`, `I p`, `p` and `I^2` over the cells of four rows.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
pub(super) fn sum_cells(grey: [&[u16]; CELL], map: [&[bool]; CELL], [i, ip, p, ii]: [&mut [u64]; 4]) {
    let mut x = 0;
    while x < i.len() {
        let cells = REGION.min(i.len() - x);
        let (mut of_i, mut of_ip, mut of_p, mut of_ii) =
            ([0u32; REGION * CELL], [0u32; REGION * CELL], [0u32; REGION * CELL], [0u64; REGION * CELL]);
        for (grey, map) in grey.iter().zip(&map) {
            let (grey, map) = (&grey[x * CELL..(x + cells) * CELL], &map[x * CELL..(x + cells) * CELL]);
            for k in 0..cells * CELL {
                let (value, inside) = (u32::from(grey[k]), u32::from(map[k]));
                of_i[k] += value;
                of_p[k] += inside;
                of_ip[k] += value & 0u32.wrapping_sub(inside);
            }
            for k in 0..cells * CELL {
                of_ii[k] += u64::from(grey[k]) * u64::from(grey[k]);
            }
        }
        for cell in 0..cells {
            let of = |sums: &[u32; REGION * CELL]| u64::from(sums[cell * CELL..(cell + 1) * CELL].iter().sum::<u32>());
            (i[x + cell], ip[x + cell], p[x + cell]) = (of(&of_i), of(&of_ip), of(&of_p));
            ii[x + cell] = of_ii[cell * CELL..(cell + 1) * CELL].iter().sum();
        }
        x += cells;
    }
}

/// Coefficients of windows from their sums, times the number of valid pixels of the cell in the middle.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
pub(super) fn lines([i, ip, p, ii, n]: [&[u64]; 5], own: &[u64], eps: f64, a: &mut [u64], b: &mut [u64]) {
    let count = a.len();
    let (i, ip, p, ii, n) = (&i[..count], &ip[..count], &p[..count], &ii[..count], &n[..count]);
    let (own, b) = (&own[..count], &mut b[..count]);
    let (scaled_eps, scaled_unit) = (eps * SCALE * SCALE, SCALE * UNIT);
    for x in 0..count {
        // all below 2^52
        let (i, ip, p, ii, n) = (float(i[x]), float(ip[x]), float(p[x]), float(ii[x]), float(n[x]));
        // where the map is the same everywhere both products are the same, bit for bit, and a = 0
        let covariance = n * ip - i * p;
        let variance = n * ii - i * i;
        let divisor = variance + scaled_eps * (n * n);
        let divisor = if n > 0.0 { divisor } else { 1.0 };
        let slope = covariance * scaled_unit / divisor;
        let offset = (p * UNIT - slope * i * (1.0 / SCALE)) / if n > 0.0 { n } else { 1.0 };
        let whole = |value: f64| i64::from(rounded(value)).cast_unsigned();
        a[x] = whole(slope).wrapping_mul(own[x]);
        b[x] = whole(offset).wrapping_mul(own[x]);
    }
}
