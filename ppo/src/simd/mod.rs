//! Run-time choice of the instruction set, and the one place with `unsafe` in this crate.
//!
//! A [`Kernel`] is ordinary generic code, inlined into a function compiled for AVX-512, AVX2 or the baseline. Most
//! kernels are plain loops over slices that the compiler vectorises once it may use the wide registers. Only the
//! micro-kernel of the matrix product and the transposition name vectors, through [`Simd`]: the accumulators of the one
//! must stay in registers, and the other is nothing but shuffles.
//!
//! `unsafe` is needed for two things: calling a function compiled for an instruction set (sound because the set was
//! detected), and raw loads and stores (sound because [`tile`] and [`transpose`] check every bound before them).

mod peak;
mod sets;
mod tile;

use std::sync::OnceLock;

pub(crate) use peak::FmaLoop;
pub(crate) use sets::Simd;
pub(crate) use tile::{Left, tile, transpose};

/// Columns of a packed panel, see [`crate::matrix`].
pub(crate) const PANEL: usize = 32;

/// Code that can be compiled for each instruction set. `run` must be `#[inline(always)]`.
pub(crate) trait Kernel {
    /// What the code returns.
    type Output;
    /// The code.
    fn run<S: Simd>(self) -> Self::Output;
}

/// An instruction set this crate has code for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    /// What the target guarantees.
    Baseline,
    /// AVX2 and FMA.
    Avx2,
    /// AVX-512 F, VL, DQ and BW.
    Avx512,
}

/// The best instruction set of this processor.
pub(crate) fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(|| {
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            let avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512bw");
            if avx2 && avx512 {
                return Level::Avx512;
            } else if avx2 {
                return Level::Avx2;
            }
        }
        Level::Baseline
    })
}

/// Name of the instruction set the learner uses on this processor: `baseline`, `avx2` or `avx512`. Results differ in
/// their last bits between them.
pub fn instruction_set() -> &'static str {
    match level() {
        Level::Baseline => "baseline",
        Level::Avx2 => "avx2",
        Level::Avx512 => "avx512",
    }
}

/// Runs a kernel on the best instruction set of this processor.
#[inline]
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    dispatch_on(level(), kernel)
}

/// Runs a kernel on an instruction set, at most the processor's best.
#[inline]
pub(crate) fn dispatch_on<K: Kernel>(wanted: Level, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    match (wanted, level()) {
        // SAFETY: `level` found the features on this processor.
        (Level::Avx512, Level::Avx512) => return unsafe { sets::with_avx512(kernel) },
        (Level::Avx2, Level::Avx2 | Level::Avx512) => return unsafe { sets::with_avx2(kernel) },
        _ => {}
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = wanted;
    kernel.run::<sets::Baseline>()
}
