//! The samples of a raster, of 8 or 16 bits, and their types as a trait, so that a kernel is written once for both.

use std::ops::{Add, AddAssign, Mul};

use super::simd;

/// Bits per sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Depth {
    /// 0..=255.
    Eight,
    /// 0..=65535.
    Sixteen,
}

impl Depth {
    /// Full scale.
    pub fn max(self) -> f32 {
        match self {
            Self::Eight => 255.0,
            Self::Sixteen => 65_535.0,
        }
    }

    /// Bytes per sample.
    pub fn bytes(self) -> usize {
        match self {
            Self::Eight => 1,
            Self::Sixteen => 2,
        }
    }
}

/// The samples of a raster, interleaved.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// 8 bits.
    Eight(Vec<u8>),
    /// 16 bits, native endian.
    Sixteen(Vec<u16>),
}

mod sealed {
    /// Implemented by `u8` and `u16` alone: vector code reads and writes samples as the bytes they are.
    pub trait Sealed {}
    impl Sealed for u8 {}
    impl Sealed for u16 {}
}

/// Integers for sums of samples: narrow ones, of which a vector holds more.
pub trait Sum: Copy + Default + Send + From<u8> + Add<Output = Self> + AddAssign + Mul<Output = Self> {
    /// The sum as a float; exact.
    fn value(self) -> f32;
}

impl Sum for u16 {
    #[inline(always)]
    fn value(self) -> f32 {
        f32::from(self)
    }
}

impl Sum for i32 {
    /// Exact up to 2^24: 256 samples of 16 bits are less.
    #[inline(always)]
    fn value(self) -> f32 {
        self as f32
    }
}

/// An integer sample, `u8` or `u16`. Kernels compute in `f32` or in exact integers and round once at the end.
///
/// The trait is sealed: vector code relies on samples without padding for which every bit pattern is valid. No other
/// crate can implement it:
///
/// ```compile_fail,E0277
/// # use pinstack_science::imaging::{Depth, Sample, Samples};
/// #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
/// struct Padded(u8, u16);
/// impl From<Padded> for i32 {
///     fn from(_: Padded) -> Self { 0 }
/// }
/// impl From<Padded> for u32 {
///     fn from(_: Padded) -> Self { 0 }
/// }
/// impl From<Padded> for f32 {
///     fn from(_: Padded) -> Self { 0.0 }
/// }
/// impl Sample for Padded {
///     const DEPTH: Depth = Depth::Sixteen;
///     const BYTES: usize = 2;
///     const TO_SIXTEEN: u32 = 1;
///     type Sum = i32;
///     fn rounded(_: f32) -> Self { Self::default() }
///     fn of(_: &Samples) -> Option<&[Self]> { None }
///     fn from_samples(_: Samples) -> Option<Vec<Self>> { None }
///     fn wrap(_: Vec<Self>) -> Samples { Samples::Eight(Vec::new()) }
/// }
/// ```
pub trait Sample:
    sealed::Sealed + Copy + Default + Ord + Into<f32> + Into<u32> + std::fmt::Debug + Send + Sync + 'static
{
    /// Bits per sample.
    const DEPTH: Depth;
    /// Bytes per sample.
    const BYTES: usize;
    /// The factor from this full scale to that of 16 bits: 257 or 1.
    const TO_SIXTEEN: u32;
    /// The smallest integers that hold the sum of 256 samples.
    type Sum: Sum + From<Self>;

    /// The sample as a float, 0 to full scale.
    #[inline(always)]
    fn value(self) -> f32 {
        self.into()
    }

    /// The sample as an integer, 0 to full scale.
    #[inline(always)]
    fn integer(self) -> u32 {
        self.into()
    }

    /// The nearest sample (halves round up), clamped to 0 and full scale; NaN gives 0.
    fn rounded(value: f32) -> Self;

    /// The samples of a raster, if they have this type.
    fn of(samples: &Samples) -> Option<&[Self]>;

    /// The samples of a raster without a copy, when they are of this kind.
    fn from_samples(samples: Samples) -> Option<Vec<Self>>;

    /// Samples of this type as those of a raster.
    fn wrap(samples: Vec<Self>) -> Samples;
}

/// The samples of one type, which are those of one variant of [`Samples`].
macro_rules! sample {
    ($type:ty, $depth:ident, $to_sixteen:literal, $sum:ty) => {
        impl Sample for $type {
            const DEPTH: Depth = Depth::$depth;
            const BYTES: usize = size_of::<$type>();
            const TO_SIXTEEN: u32 = $to_sixteen;
            type Sum = $sum;

            #[inline(always)]
            fn rounded(value: f32) -> Self {
                simd::truncated(value + 0.5, <$type>::MAX.into()) as Self
            }

            fn of(samples: &Samples) -> Option<&[Self]> {
                if let Samples::$depth(samples) = samples { Some(samples) } else { None }
            }

            fn from_samples(samples: Samples) -> Option<Vec<Self>> {
                if let Samples::$depth(samples) = samples { Some(samples) } else { None }
            }

            fn wrap(samples: Vec<Self>) -> Samples {
                Samples::$depth(samples)
            }
        }
    };
}

sample!(u8, Eight, 257, u16);
sample!(u16, Sixteen, 1, i32);
