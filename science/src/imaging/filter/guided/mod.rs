//! The guided filter (He, Sun and Tang 2013) of a binary map `p` with a grey guide `I`, restricted to valid pixels.
//!
//! In each window of `(2r + 1)^2` px: `a = cov(I, p) / (var(I) + eps)`, `b = mean(p) - a mean(I)`. The result at a
//! pixel is `mean(a) I + mean(b)` over all windows that contain it. Pixels outside the image and pixels that the slice
//! does not cover are excluded: they are in no sum and no count, and no window is centred on them.
//!
//! Exactness: the guide is an integer (0..=65535), so the window sums of `I`, `I^2`, `p` and `I p` are exact, and `var`
//! and `cov` are computed from them in double precision; with `eps` = 1e-6 single precision would lose 6 % of it. `a`
//! and `b` are rounded to multiples of a power of two (2^-20 in `subsampled`, 2^-18 in `reference`, 2^-13 to 2^-18 in
//! `integer`) and summed exactly. So the result does not depend on the tiling, and where `p` is constant within reach
//! the result is exactly that constant.
//!
//! Three kernels compute the filter. The first that supports the parameters is used:
//!
//! | kernel | method | radius | `eps` |
//! |---|---|---|---|
//! | [`subsampled`] | coefficients on a grid of 4 px (the fast guided filter, He and Sun 2015) | 24 to 63 | from 0.05 |
//! | [`integer`] | per pixel, 32-bit sums | up to 127 | as far as the sums fit |
//! | [`reference`](mod@reference) | per pixel, `f64` sums | any | any |

mod constant_regions;
mod integer;
mod reference;
mod subsampled;
mod window;

use crate::imaging::{Plane, Rect, simd::Avx2};
pub use window::Guide;

use integer::Integer;
use reference::Reference;
use subsampled::Subsampled;

/// A tile gets the same results as the whole image when its origin is a multiple of this, px, along both axes.
pub const GRID: usize = subsampled::CELL;

/// A guided filter of given radius and regularisation, with its buffers.
#[derive(Debug)]
pub struct GuidedFilter {
    radius: usize,
    kernel: Kernel,
}

#[derive(Debug)]
enum Kernel {
    Subsampled(Box<Subsampled>),
    Integer(Box<Integer>),
    Reference(Reference),
}

impl GuidedFilter {
    /// A guided filter with windows of `(2 * radius + 1)^2` px and regularisation `eps` for intensities in 0..1.
    pub fn new(radius: usize, eps: f64) -> Self {
        Self::with(Avx2::detect(), radius, eps)
    }

    fn with(simd: Option<Avx2>, radius: usize, eps: f64) -> Self {
        let subsampled = Subsampled::new(simd, radius, eps).map(|kernel| Kernel::Subsampled(Box::new(kernel)));
        let kernel = subsampled.unwrap_or_else(|| Self::per_pixel(simd, radius, eps));
        Self { radius, kernel }
    }

    /// The kernel that computes coefficients for each pixel.
    fn per_pixel(simd: Option<Avx2>, radius: usize, eps: f64) -> Kernel {
        match Integer::new(simd, radius, eps) {
            Some(kernel) => Kernel::Integer(Box::new(kernel)),
            None => Kernel::Reference(Reference::new(radius, eps)),
        }
    }

    /// Radius of the support of a result, px.
    pub fn reach(&self) -> usize {
        match &self.kernel {
            Kernel::Subsampled(kernel) => kernel.reach(),
            Kernel::Integer(_) | Kernel::Reference(_) => 2 * self.radius,
        }
    }

    /// Filters `map` (true = 1) inside `inner`. `out` receives `inner.width * inner.height` results, row-major, with 0
    /// at invalid pixels. The results are not clamped.
    ///
    /// The edges of the guide count as the edges of the image: where the image continues, pass [`GuidedFilter::reach`]
    /// px more around `inner`.
    ///
    /// # Example
    /// ```
    /// use pinstack_science::imaging::{Plane, Rect, filter::guided::{Guide, GuidedFilter}};
    ///
    /// // the map follows an edge of the guide but for one pixel, which the filter corrects
    /// let grey = Plane::from_fn(32, 32, |x, _| if x < 16 { 0 } else { u16::MAX });
    /// let map = Plane::from_fn(32, 32, |x, y| x >= 16 || (x, y) == (4, 16));
    /// let (valid, mut out) = (vec![0..32; 32], [0.0; 32]);
    /// let row = Rect { x: 0, y: 16, width: 32, height: 1 };
    /// GuidedFilter::new(5, 1e-4).apply(Guide { grey: &grey, valid: &valid }, &map, row, &mut out);
    /// assert!(out[4] < 0.1 && out[15] < 0.1 && out[16] > 0.9);
    /// ```
    pub fn apply(&mut self, guide: Guide<'_>, map: &Plane<bool>, inner: Rect, out: &mut [f32]) {
        let mut rows = self.rows(guide, map, inner);
        for out in out.chunks_exact_mut(inner.width.max(1)) {
            rows.next(out);
        }
    }

    /// The same row by row, for callers that process each row while it is in the cache.
    pub fn rows<'a>(&'a mut self, guide: Guide<'a>, map: &'a Plane<bool>, inner: Rect) -> FilteredRows<'a> {
        match &mut self.kernel {
            Kernel::Subsampled(filter) => filter.start(guide, map, inner),
            Kernel::Integer(filter) => filter.start(guide, inner),
            Kernel::Reference(filter) => filter.start(guide, map, inner),
        }
        FilteredRows { kernel: &mut self.kernel, guide, map, left: if inner.width == 0 { 0 } else { inner.height } }
    }
}

/// The rows of results, from the top down.
#[derive(Debug)]
pub struct FilteredRows<'a> {
    kernel: &'a mut Kernel,
    guide: Guide<'a>,
    map: &'a Plane<bool>,
    left: usize,
}

impl FilteredRows<'_> {
    /// Writes the next row to `out`. After the last row `out` is unchanged.
    ///
    /// # Panics
    /// When the length of `out` is not that of a row of `inner`.
    pub fn next(&mut self, out: &mut [f32]) {
        if self.left == 0 {
            return;
        }
        self.left -= 1;
        match self.kernel {
            Kernel::Subsampled(filter) => filter.row(self.guide, out),
            Kernel::Integer(filter) => filter.row(self.guide, self.map, out),
            Kernel::Reference(filter) => filter.row(out),
        }
    }
}

#[cfg(test)]
mod tests;
