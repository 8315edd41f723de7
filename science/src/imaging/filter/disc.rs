//! Blur by a disc: the defocus of a thin lens with a round aperture.
//!
//! The blurred value is a sum of chords, each the difference of two column sums, so the cost grows with the radius and
//! not with its square. `synth/disc.rs` implements the same blur independently on purpose: the rendered truth must not
//! share code with the method that it judges.

use crate::imaging::{
    Plane, Rect,
    simd::{self, Avx2},
};

/// Above this radius, px, the image is blurred at half its size, above twice this radius at a quarter, and so on: a
/// blurred image has no detail that the smaller size would lose.
const COARSE_ABOVE: f32 = 8.0;

/// A disc of given radius.
#[derive(Debug, Clone)]
pub struct Disc {
    /// Half of the chord in each pixel column, averaged over the width of the column.
    half_chords: Vec<f32>,
    inverse_area: f32,
    /// How many times the image is halved first.
    halvings: usize,
    simd: Option<Avx2>,
}

impl Disc {
    /// A disc of `radius` px. Up to half a pixel it has no effect.
    pub fn new(radius: f32) -> Self {
        let halvings = (0..5).find(|&k| radius / ((1u32 << k) as f32) <= COARSE_ABOVE).unwrap_or(5);
        let radius = radius / (1u32 << halvings) as f32;
        let simd = Avx2::detect();
        if radius <= 0.5 {
            return Self { half_chords: vec![0.5], inverse_area: 1.0, halvings: 0, simd };
        }
        // summing whole pixels widens the disc by the second moment of a pixel: 1/12 per axis; that of a disc is r^2 /
        // 4
        let radius = f64::from((radius * radius - 1.0 / 3.0).max(0.3).sqrt());
        let reach = (radius - 0.5).ceil() as i64;
        // area under the circle's upper arc from 0 to y
        let primitive = |y: f64| {
            let y = y.clamp(-radius, radius);
            0.5 * (y * (radius * radius - y * y).max(0.0).sqrt() + radius * radius * (y / radius).asin())
        };
        let chord = |row: i64| (primitive(row as f64 + 0.5) - primitive(row as f64 - 0.5)) as f32;
        let half_chords: Vec<f32> = (-reach..=reach).map(chord).collect();
        let inverse_area = 1.0 / (2.0 * half_chords.iter().sum::<f32>());
        Self { half_chords, inverse_area, halvings, simd }
    }

    /// Radius of the support of a blurred value, px.
    pub fn reach(&self) -> usize {
        (self.half_chords.len() / 2 + 2) << self.halvings
    }

    /// Side of the squares, counted from the top left of a plane, that are averaged first, px; 1 for small discs.
    pub fn square_side(&self) -> usize {
        1 << self.halvings
    }

    /// The part of a `width` x `height` image that the blurred `rect` depends on, extended to whole squares of the
    /// image: a plane that is cut out there gives the same blurred pixels as any larger one.
    pub fn window(&self, rect: Rect, width: usize, height: usize) -> Rect {
        rect.grown(self.reach(), width, height).in_squares(self.square_side(), width, height)
    }

    /// The blurred plane, of the same size. Beyond the border the border pixel is repeated.
    pub fn blurred(&self, plane: &Plane<f32>) -> Plane<f32> {
        self.blurred_in(plane, Rect::whole(plane.width, plane.height))
    }

    /// The rectangle `rect` of the blurred plane.
    pub fn blurred_in(&self, plane: &Plane<f32>, rect: Rect) -> Plane<f32> {
        if self.half_chords.len() == 1 || plane.data.is_empty() {
            return plane.crop(rect);
        }
        if self.halvings == 0 {
            let seen = rect.grown(self.reach(), plane.width, plane.height);
            let inner = Rect { x: rect.x - seen.x, y: rect.y - seen.y, ..rect };
            return match seen == Rect::whole(plane.width, plane.height) {
                true => self.at_full_size(plane, inner),
                false => self.at_full_size(&plane.crop(seen), inner),
            };
        }
        // each square becomes one pixel
        let side = self.square_side();
        let seen = self.window(rect, plane.width, plane.height);
        let mut small = match seen == Rect::whole(plane.width, plane.height) {
            true => halved(plane, self.simd),
            false => halved(&plane.crop(seen), self.simd),
        };
        for _ in 1..self.halvings {
            small = halved(&small, self.simd);
        }
        let blurred = self.at_full_size(&small, Rect::whole(small.width, small.height));
        let inner = Rect { x: rect.x - seen.x, y: rect.y - seen.y, ..rect };
        enlarged(&blurred, side, inner)
    }

    /// The blurred rectangle `rect`, without halving.
    fn at_full_size(&self, plane: &Plane<f32>, rect: Rect) -> Plane<f32> {
        let reach = self.half_chords.len() / 2;
        let pad = reach + 2;
        let (sums, bases) = self.sum_up(plane, reach, pad);
        let (width, stride) = (rect.width, plane.width + 2 * reach);
        let chord = |(column, half): (usize, &f32)| {
            // a chord is centred on its pixel
            let below = pad as f32 + 0.5 + half;
            let last = below as usize;
            let first = 2 * pad - last;
            let row = |y: usize| y * stride + column;
            let (inner, outer) = ([row(first + 1), row(last)], [row(first), row(last + 1)]);
            Chord { inner, outer, share: below - last as f32 }
        };
        let chords: Vec<Chord> = self.half_chords.iter().enumerate().map(chord).collect();
        let bases = &bases[rect.x..rect.x + width];
        let mut out = Plane::filled(width, rect.height, 0.0f32);
        simd::run(
            self.simd,
            #[inline(always)]
            || {
                for (y, out) in (rect.y..).zip(out.data.chunks_exact_mut(width.max(1))) {
                    add_chords(&chords, &sums[y * stride + rect.x..], bases, self.inverse_area, out);
                }
            },
        );
        out
    }

    /// Column sums: a chord is the difference of two of them. The border is repeated, `reach` columns on both sides and
    /// `pad` rows above and below. To keep the sums small, the first pixel of a column is subtracted from each value;
    /// the second result holds what those pixels add to the chords.
    fn sum_up(&self, plane: &Plane<f32>, reach: usize, pad: usize) -> (Vec<f32>, Vec<f32>) {
        let (width, height) = (plane.width, plane.height);
        let stride = width + 2 * reach;
        let repeated = |row: &[f32], line: &mut Vec<f32>| {
            line.clear();
            line.resize(reach, row[0]);
            line.extend_from_slice(row);
            line.resize(stride, row[width - 1]);
        };
        let (mut first, mut line) = (Vec::new(), Vec::new());
        repeated(plane.row(0), &mut first);
        let rows = height + 2 * pad + 1;
        let mut sums = vec![0.0f32; stride * rows];
        // rows up to here repeat the first one, so their sums are zero
        for y in pad + 1..rows - 1 {
            repeated(plane.row((y - pad).min(height - 1)), &mut line);
            let (above, below) = sums.split_at_mut((y + 1) * stride);
            let (above, below) = (&above[y * stride..], &mut below[..stride]);
            let (first, line) = (&first[..], &line[..]);
            simd::run(
                self.simd,
                #[inline(always)]
                || {
                    for (((below, above), value), first) in below.iter_mut().zip(above).zip(line).zip(first) {
                        *below = above + (value - first);
                    }
                },
            );
        }
        let mut bases = vec![0.0f32; width];
        for (k, &half) in self.half_chords.iter().enumerate() {
            bases.iter_mut().zip(&first[k..]).for_each(|(base, first)| *base += 2.0 * half * first);
        }
        (sums, bases)
    }
}

/// One pixel column of a disc, as column sums at its two ends: `inner` for the whole pixels within it, `outer` for one
/// more pixel at either end. The outer pixels count with the weight `share`. A sum is given by its offset from the sum
/// at the top left of the disc.
struct Chord {
    inner: [usize; 2],
    outer: [usize; 2],
    share: f32,
}

/// Pixels whose sums are kept in registers.
const PART: usize = 32;

/// The same in narrow rectangles.
const NARROW: usize = 8;

/// Blurs a row; `sums` begin at the top left of the disc of its first pixel.
#[inline(always)]
fn add_chords(chords: &[Chord], sums: &[f32], bases: &[f32], share: f32, out: &mut [f32]) {
    // the last part overlaps the one before: rows are often short, and single pixels are slow
    let count = out.len();
    let mut x = 0;
    while x + NARROW < count && count >= PART {
        let at = x.min(count - PART);
        out[at..at + PART].copy_from_slice(&chords_of::<PART>(chords, sums, bases, share, at));
        x = at + PART;
    }
    while x < count && count >= NARROW {
        let at = x.min(count - NARROW);
        out[at..at + NARROW].copy_from_slice(&chords_of::<NARROW>(chords, sums, bases, share, at));
        x = at + NARROW;
    }
    for (x, out) in out.iter_mut().enumerate().skip(x) {
        [*out] = chords_of(chords, sums, bases, share, x);
    }
}

/// The blurred pixels starting at `x`.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn chords_of<const N: usize>(chords: &[Chord], sums: &[f32], bases: &[f32], share: f32, x: usize) -> [f32; N] {
    let mut blurred = [0.0; N];
    blurred.copy_from_slice(&bases[x..x + N]);
    for chord in chords {
        let row = |start: usize| &sums[start + x..start + x + N];
        let ([i0, i1], [o0, o1]) = (chord.inner.map(row), chord.outer.map(row));
        for k in 0..N {
            let (inner, outer) = (i1[k] - i0[k], o1[k] - o0[k]);
            blurred[k] += inner + chord.share * (outer - inner);
        }
    }
    blurred.map(|sum| sum * share)
}

/// Means of 2x2 pixels; a last odd row or column is repeated.
fn halved(plane: &Plane<f32>, simd: Option<Avx2>) -> Plane<f32> {
    let (width, height) = (plane.width.div_ceil(2), plane.height.div_ceil(2));
    let mut out = Plane::filled(width, height, 0.0f32);
    let mut sums = vec![0.0f32; 2 * width];
    for y in 0..height {
        let (above, below) = (plane.row(2 * y), plane.row((2 * y + 1).min(plane.height - 1)));
        let out = out.row_mut(y);
        simd::run(
            simd,
            #[inline(always)]
            || {
                for (sum, (above, below)) in sums.iter_mut().zip(above.iter().zip(below)) {
                    *sum = above + below;
                }
                if plane.width % 2 == 1 {
                    sums[plane.width] = sums[plane.width - 1];
                }
                for (out, pair) in out.iter_mut().zip(sums.as_chunks::<2>().0) {
                    *out = 0.25 * (pair[0] + pair[1]);
                }
            },
        );
    }
    out
}

/// The rectangle `rect` of a plane, interpolated bilinearly from `small`, which holds the means of its `side` x `side`
/// blocks.
fn enlarged(small: &Plane<f32>, side: usize, rect: Rect) -> Plane<f32> {
    let taps = |part: std::ops::Range<usize>, count: usize| -> Vec<(usize, usize, f32)> {
        part.map(|x| {
            let at = ((x as f32 + 0.5) / side as f32 - 0.5).clamp(0.0, count as f32 - 1.0);
            let whole = at as usize;
            (whole, (whole + 1).min(count - 1), at - whole as f32)
        })
        .collect()
    };
    let columns = taps(rect.x..rect.x + rect.width, small.width);
    let rows = taps(rect.y..rect.y + rect.height, small.height);
    let mut out = Plane::filled(rect.width, rect.height, 0.0);
    let mut between = vec![0.0f32; small.width];
    for (y, &(above, below, share)) in rows.iter().enumerate() {
        for (out, (a, b)) in between.iter_mut().zip(small.row(above).iter().zip(small.row(below))) {
            *out = a + share * (b - a);
        }
        for (out, &(left, right, share)) in out.row_mut(y).iter_mut().zip(&columns) {
            *out = between[left] + share * (between[right] - between[left]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_stays_and_small_radii_change_nothing() {
        let flat = Plane::filled(37, 21, 93.0f32);
        for radius in [0.3, 0.6, 1.0, 3.7, 11.9, 13.0, 30.0] {
            let blurred = Disc::new(radius).blurred(&flat);
            assert!(blurred.data.iter().all(|v| (v - 93.0).abs() < 1e-3), "radius {radius}");
        }
        let speckle = Plane::from_fn(9, 7, |x, y| ((x * 31 + y * 17) % 97) as f32);
        assert_eq!(Disc::new(0.4).blurred(&speckle), speckle);
    }

    #[test]
    fn a_point_becomes_a_disc_of_the_radius() {
        for radius in [1.5f32, 4.0, 9.3, 14.0, 26.0] {
            let middle = 64;
            let point = Plane::from_fn(129, 129, |x, y| if (x, y) == (middle, middle) { 1e4f32 } else { 0.0 });
            let disc = Disc::new(radius);
            let spread = disc.blurred(&point);
            let (mut sum, mut second) = (0.0f64, 0.0f64);
            for y in 0..129usize {
                for x in 0..129usize {
                    let value = f64::from(spread.at(x, y));
                    let distance = ((x as f64 - 64.0).powi(2) + (y as f64 - 64.0).powi(2)).sqrt();
                    sum += value;
                    second += value * distance * distance;
                    let far = distance > f64::from(radius) + f64::from(2 << disc.halvings);
                    assert!(!far || value.abs() < 0.01, "radius {radius}: {value} at {distance}");
                }
            }
            assert!((sum / 1e4 - 1.0).abs() < 1e-3, "radius {radius} keeps {sum}");
            // a disc's mean squared radius is r^2 / 2
            let measured = (2.0 * second / sum).sqrt();
            assert!((measured / f64::from(radius) - 1.0).abs() < 0.05, "radius {radius} came out as {measured}");
        }
    }

    #[test]
    fn a_rectangle_is_blurred_like_the_whole_plane() {
        let speckle = Plane::from_fn(191, 147, |x, y| ((x * 7919 + y * 104_729 + x * y * 31) % 251) as f32);
        for radius in [0.4f32, 1.7, 6.0, 14.0, 27.0] {
            let disc = Disc::new(radius);
            let whole = disc.blurred(&speckle);
            for rect in [Rect { x: 93, y: 75, width: 20, height: 11 }, Rect { x: 172, y: 0, width: 19, height: 147 }] {
                let part = disc.blurred_in(&speckle, rect);
                assert_eq!((part.width, part.height), (rect.width, rect.height));
                for y in 0..rect.height {
                    for x in 0..rect.width {
                        let away = part.at(x, y) - whole.at(rect.x + x, rect.y + y);
                        assert!(away.abs() < 1e-3, "radius {radius}: {away} away at {x}, {y} of {rect:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_window_cut_out_of_the_plane_gives_the_blurred_pixels_of_the_plane() {
        let speckle = Plane::from_fn(191, 147, |x, y| ((x * 7919 + y * 104_729 + x * y * 31) % 251) as f32);
        for radius in [0.4f32, 6.0, 14.0, 27.0, 51.0] {
            let disc = Disc::new(radius);
            let whole = disc.blurred(&speckle);
            for rect in [Rect { x: 93, y: 75, width: 20, height: 11 }, Rect { x: 171, y: 3, width: 20, height: 99 }] {
                let window = disc.window(rect, 191, 147);
                let inner = Rect { x: rect.x - window.x, y: rect.y - window.y, ..rect };
                let part = disc.blurred_in(&speckle.crop(window), inner);
                let most = part.data.iter().zip(&whole.crop(rect).data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(most < 1e-3, "radius {radius}: {most} away in {rect:?}");
            }
        }
    }
}
