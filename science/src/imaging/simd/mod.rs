//! Vector instructions that not every CPU has, found out when the program runs.
//!
//! Most kernels are plain loops over slices. [`run`] compiles such a loop a second time for AVX2, which needs no second
//! source and gives the same bits, because Rust never contracts a multiplication and an addition into one rounding.
//! What a compiler does not find by itself is written by hand beside a portable form, and tests hold the two equal.

mod lanes;
mod scan;

pub use lanes::{bytes_of, bytes_of_mut};
pub use scan::{prefix, prefix_u32, prefix_u64};

/// Proof that the CPU has AVX2: there is none without it.
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

/// Does `work`, compiled for AVX2 where there is proof that the CPU has it. `work` is a closure marked
/// `#[inline(always)]`, whose loops the compiler turns into vector code.
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
