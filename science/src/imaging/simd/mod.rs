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
