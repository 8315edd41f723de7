//! Vector instructions, detected at run time.
//!
//! Most kernels are plain loops over slices. [`run`] compiles such a loop a second time for AVX2. That needs no second
//! source and gives the same bits, because Rust never fuses a multiplication and an addition. Kernels that the compiler
//! does not vectorise are written by hand next to a portable form, and tests compare the bits of both.

mod lanes;
mod scan;

pub use lanes::{bytes_of, bytes_of_mut};
pub use scan::{prefix, prefix_u32, prefix_u64};

/// Proof that the CPU has AVX2: a value exists only in that case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Avx2(());

impl Avx2 {
    /// The proof, if the CPU has AVX2.
    #[inline]
    pub fn detect() -> Option<Self> {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Some(Self(()));
        }
        None
    }
}

/// The integer part of `value`, clamped to 0 and `max`; 0 for NaN. `as` gives the same, but the compiler does not
/// vectorise it well: loops over samples take several times as long.
#[inline(always)]
pub fn truncated(value: f32, max: u16) -> i32 {
    let clamped = value.max(0.0).min(f32::from(max));
    // SAFETY: `max` of a number and 0 is a number even for NaN, and what is between 0 and 65,535 fits.
    unsafe { clamped.to_int_unchecked() }
}

/// Runs `work`, compiled for AVX2 if there is proof that the CPU has it. `work` is a closure marked
/// `#[inline(always)]`, whose loops the compiler vectorises.
#[inline(always)]
pub fn run<R>(simd: Option<Avx2>, work: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if simd.is_some() {
        #[target_feature(enable = "avx2")]
        fn vectorised<R>(work: impl FnOnce() -> R) -> R {
            work()
        }
        // SAFETY: a value of `Avx2` exists only where the CPU has AVX2.
        return unsafe { vectorised(work) };
    }
    let _ = simd;
    work()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_integer_part_is_that_of_a_clamped_cast() {
        let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0, -3.7, 0.4999, 0.5, 254.999, 255.0, 255.5, 7e9];
        for value in values.into_iter().chain((0..4000).map(|k| k as f32 * 0.0837 - 20.0)) {
            assert_eq!(truncated(value, 255), i32::from(value as u8), "{value}");
            assert_eq!(truncated(300.0 * value, u16::MAX), i32::from((300.0 * value) as u16), "300 x {value}");
        }
    }
}
