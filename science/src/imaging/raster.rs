//! Image types: [`Plane`] (one channel of any type), [`Raster`] (interleaved 8 or 16-bit samples) and [`Rect`].

use rayon::prelude::*;

use super::{
    grey,
    sample::{Depth, Samples},
};

/// One channel, row-major, without padding: sample (x, y) is `data[y * width + x]`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plane<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` samples.
    pub data: Vec<T>,
}

impl<T: Copy> Plane<T> {
    /// A plane with the same value everywhere.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, data: vec![value; width * height] }
    }

    /// A plane with the values of a function of (x, y).
    pub fn from_fn(width: usize, height: usize, mut value: impl FnMut(usize, usize) -> T) -> Self {
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                data.push(value(x, y));
            }
        }
        Self { width, height, data }
    }

    /// The sample at (x, y).
    ///
    /// # Panics
    /// When (x, y) is outside.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> T {
        debug_assert!(x < self.width);
        self.data[y * self.width + x]
    }

    /// Row `y`.
    #[inline]
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// Row `y`, mutable.
    #[inline]
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[y * self.width..(y + 1) * self.width]
    }

    /// The samples of `rect`.
    ///
    /// # Panics
    /// When `rect` is not inside the plane.
    pub fn crop(&self, rect: Rect) -> Self {
        let data = cropped(&self.data, (self.width, 1), rect);
        Self { width: rect.width, height: rect.height, data }
    }

    /// A plane of the same size with `value` applied to each sample.
    pub fn map<U>(&self, value: impl FnMut(T) -> U) -> Plane<U> {
        Plane { width: self.width, height: self.height, data: self.data.iter().copied().map(value).collect() }
    }

    /// The same as [`Plane::map`], by all threads: for planes of the size of a picture.
    pub fn par_map<U: Send>(&self, value: impl Fn(T) -> U + Sync) -> Plane<U>
    where
        T: Sync,
    {
        let data = self.data.par_iter().map(|sample| value(*sample)).collect();
        Plane { width: self.width, height: self.height, data }
    }
}

/// A rectangle of pixels: columns `x..x + width`, rows `y..y + height`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rect {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Rect {
    /// All of a `width` x `height` image.
    pub fn whole(width: usize, height: usize) -> Self {
        Self { x: 0, y: 0, width, height }
    }

    /// Extended by `margin` px on every side, and clipped to a `width` x `height` image.
    #[must_use]
    pub fn grown(self, margin: usize, width: usize, height: usize) -> Self {
        let (x, y) = (self.x.saturating_sub(margin), self.y.saturating_sub(margin));
        Self {
            x,
            y,
            width: (self.x + self.width + margin).min(width) - x,
            height: (self.y + self.height + margin).min(height) - y,
        }
    }

    /// The smallest rectangle that contains both.
    #[must_use]
    pub fn joined(self, other: Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        Self { x, y, width: right - x, height: bottom - y }
    }

    /// Extended to whole squares of `side` px, counted from the top left of a `width` x `height` image, and clipped to
    /// that image.
    #[must_use]
    pub fn in_squares(self, side: usize, width: usize, height: usize) -> Self {
        let (x, y) = (self.x / side * side, self.y / side * side);
        Self {
            x,
            y,
            width: (self.x + self.width).next_multiple_of(side).min(width) - x,
            height: (self.y + self.height).next_multiple_of(side).min(height) - y,
        }
    }
}

/// An image as stored in files: interleaved, gamma-encoded samples. Sample `c` of pixel (x, y) is at
/// `(y * width + x) * channels + c`.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 1 grey, 3 RGB, 4 RGBA with straight alpha.
    pub channels: usize,
    /// `width * height * channels` samples.
    pub samples: Samples,
}

impl Raster {
    /// A raster of 8-bit samples.
    ///
    /// # Panics
    /// When the number of samples differs from `width * height * channels`.
    pub fn eight(width: usize, height: usize, channels: usize, samples: Vec<u8>) -> Self {
        assert_eq!(samples.len(), width * height * channels, "the number of samples does not match the shape");
        Self { width, height, channels, samples: Samples::Eight(samples) }
    }

    /// A raster of 16-bit samples.
    ///
    /// # Panics
    /// When the number of samples differs from `width * height * channels`.
    pub fn sixteen(width: usize, height: usize, channels: usize, samples: Vec<u16>) -> Self {
        assert_eq!(samples.len(), width * height * channels, "the number of samples does not match the shape");
        Self { width, height, channels, samples: Samples::Sixteen(samples) }
    }

    /// Bits per sample.
    pub fn depth(&self) -> Depth {
        match self.samples {
            Samples::Eight(_) => Depth::Eight,
            Samples::Sixteen(_) => Depth::Sixteen,
        }
    }

    /// Rec. 601 luma of every pixel (see [`LUMA`](super::LUMA)), 0..255 at either depth. Alpha is ignored.
    pub fn luma(&self) -> Plane<f32> {
        let mut plane = Plane::filled(self.width, self.height, 0.0);
        match &self.samples {
            Samples::Eight(s) => grey::luma_row(s, self.channels, &mut plane.data),
            Samples::Sixteen(s) => grey::luma_row(s, self.channels, &mut plane.data),
        }
        plane
    }

    /// The pixels of `rect`.
    ///
    /// # Panics
    /// When `rect` is not inside the raster.
    pub fn crop(&self, rect: Rect) -> Self {
        let shape = (self.width, self.channels);
        match &self.samples {
            Samples::Eight(s) => Self::eight(rect.width, rect.height, self.channels, cropped(s, shape, rect)),
            Samples::Sixteen(s) => Self::sixteen(rect.width, rect.height, self.channels, cropped(s, shape, rect)),
        }
    }
}

/// The samples of `rect`, of rows of `width` pixels of `channels` samples.
fn cropped<S: Copy>(samples: &[S], (width, channels): (usize, usize), rect: Rect) -> Vec<S> {
    let mut out = Vec::with_capacity(rect.width * rect.height * channels);
    for y in rect.y..rect.y + rect.height {
        out.extend_from_slice(&samples[y * width * channels..][rect.x * channels..(rect.x + rect.width) * channels]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_is_extended_to_whole_squares_within_the_image() {
        let rect = |x, y, width, height| Rect { x, y, width, height };
        assert_eq!(rect(5, 8, 4, 1).in_squares(4, 30, 20), rect(4, 8, 8, 4));
        assert_eq!(rect(4, 8, 8, 4).in_squares(4, 30, 20), rect(4, 8, 8, 4));
        assert_eq!(rect(27, 13, 3, 6).in_squares(8, 30, 20), rect(24, 8, 6, 12));
    }

    #[test]
    fn a_crop_has_the_samples_of_its_rectangle() {
        let rect = Rect { x: 1, y: 1, width: 2, height: 2 };
        let plane = Plane::from_fn(4, 3, |x, y| (10 * y + x) as u8);
        assert_eq!(plane.crop(rect), Plane { width: 2, height: 2, data: vec![11, 12, 21, 22] });
        let grey = Raster::eight(4, 3, 1, plane.data.clone());
        assert_eq!(grey.crop(rect), Raster::eight(2, 2, 1, vec![11, 12, 21, 22]));
        let pairs = Raster::sixteen(2, 3, 2, (0..12).collect());
        let column = Rect { x: 1, y: 0, width: 1, height: 3 };
        assert_eq!(pairs.crop(column), Raster::sixteen(1, 3, 2, vec![2, 3, 6, 7, 10, 11]));
        assert_eq!(pairs.crop(Rect::whole(2, 3)), pairs);
    }
}
