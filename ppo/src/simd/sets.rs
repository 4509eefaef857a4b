//! The instruction sets and their vector operations.

use super::PANEL;

/// Side of the blocks that [`Simd::transpose`] works on.
pub(crate) const BLOCK: usize = 8;

/// Vector operations of one instruction set.
///
/// # Safety
/// The methods may only run where the instruction set is present: inside [`super::Kernel::run`].
pub(crate) unsafe trait Simd: Copy {
    /// A vector of `f32`.
    type Vector: Copy;
    /// Its length.
    const LANES: usize;
    /// Rows of the largest micro-kernel: with two vectors a row, accumulators and operands fill the registers.
    const ROWS: usize;
    /// Whether `a * b + c` is one instruction, with one rounding.
    const FUSED: bool;
    /// All lanes zero.
    unsafe fn zero() -> Self::Vector;
    /// Lanes from memory.
    unsafe fn load(from: *const f32) -> Self::Vector;
    /// Lanes to memory.
    unsafe fn store(to: *mut f32, value: Self::Vector);
    /// `scalar * x + sum`.
    unsafe fn multiply_add(scalar: f32, x: Self::Vector, sum: Self::Vector) -> Self::Vector;
    /// `x + y`.
    unsafe fn add(x: Self::Vector, y: Self::Vector) -> Self::Vector;
    /// Writes the transpose of [`BLOCK`] rows of as many columns; rows lie [`PANEL`] apart in both.
    unsafe fn transpose(from: *const f32, to: *mut f32);
    /// `a * b + c`; fused where that is one instruction.
    #[inline(always)]
    fn fma(a: f32, b: f32, c: f32) -> f32 {
        if Self::FUSED { a.mul_add(b, c) } else { a * b + c }
    }
    /// `a * b + c` in `f64`.
    #[inline(always)]
    fn fma64(a: f64, b: f64, c: f64) -> f64 {
        if Self::FUSED { a.mul_add(b, c) } else { a * b + c }
    }
}

/// Any processor: four lanes, which SSE and NEON have.
#[derive(Clone, Copy)]
pub(crate) struct Baseline;

// SAFETY: nothing here needs more than the target has.
unsafe impl Simd for Baseline {
    type Vector = [f32; 4];
    const LANES: usize = 4;
    const ROWS: usize = 4;
    const FUSED: bool = cfg!(target_arch = "aarch64");
    #[inline(always)]
    unsafe fn zero() -> Self::Vector {
        [0.0; 4]
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self::Vector {
        unsafe { from.cast::<[f32; 4]>().read_unaligned() }
    }
    #[inline(always)]
    unsafe fn store(to: *mut f32, value: Self::Vector) {
        unsafe { to.cast::<[f32; 4]>().write_unaligned(value) }
    }
    #[inline(always)]
    unsafe fn multiply_add(scalar: f32, x: Self::Vector, sum: Self::Vector) -> Self::Vector {
        std::array::from_fn(|i| Self::fma(scalar, x[i], sum[i]))
    }
    #[inline(always)]
    unsafe fn add(x: Self::Vector, y: Self::Vector) -> Self::Vector {
        std::array::from_fn(|i| x[i] + y[i])
    }
    #[inline(always)]
    unsafe fn transpose(from: *const f32, to: *mut f32) {
        for i in 0..BLOCK {
            for j in 0..BLOCK {
                unsafe { *to.add(j * PANEL + i) = *from.add(i * PANEL + j) };
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{with_avx2, with_avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::{BLOCK, PANEL, Simd};
    use crate::simd::Kernel;

    /// An instruction set with fused multiply-adds: its vector, lanes, rows and intrinsics, and the function that
    /// compiles a kernel for it.
    macro_rules! instruction_set {
        (
            $name:ident, $features:literal, $with:ident, $vector:ident, $lanes:literal lanes, $rows:literal rows,
            $zero:ident, $load:ident, $store:ident, $broadcast:ident, $multiply_add:ident, $add:ident
        ) => {
            #[derive(Clone, Copy)]
            pub(crate) struct $name;

            // SAFETY: the methods run inside a kernel, which only the function below calls.
            unsafe impl Simd for $name {
                type Vector = $vector;
                const LANES: usize = $lanes;
                const ROWS: usize = $rows;
                const FUSED: bool = true;
                #[inline(always)]
                unsafe fn zero() -> Self::Vector {
                    unsafe { $zero() }
                }
                #[inline(always)]
                unsafe fn load(from: *const f32) -> Self::Vector {
                    unsafe { $load(from) }
                }
                #[inline(always)]
                unsafe fn store(to: *mut f32, value: Self::Vector) {
                    unsafe { $store(to, value) }
                }
                #[inline(always)]
                unsafe fn multiply_add(scalar: f32, x: Self::Vector, sum: Self::Vector) -> Self::Vector {
                    unsafe { $multiply_add($broadcast(scalar), x, sum) }
                }
                #[inline(always)]
                unsafe fn add(x: Self::Vector, y: Self::Vector) -> Self::Vector {
                    unsafe { $add(x, y) }
                }
                #[inline(always)]
                unsafe fn transpose(from: *const f32, to: *mut f32) {
                    unsafe { transpose(from, to) }
                }
            }

            #[target_feature(enable = $features)]
            pub(crate) fn $with<K: Kernel>(kernel: K) -> K::Output {
                kernel.run::<$name>()
            }
        };
    }

    instruction_set!(
        Avx2, "avx2,fma", with_avx2, __m256, 8 lanes, 6 rows, _mm256_setzero_ps, _mm256_loadu_ps, _mm256_storeu_ps,
        _mm256_set1_ps, _mm256_fmadd_ps, _mm256_add_ps
    );
    instruction_set!(
        Avx512, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma", with_avx512, __m512, 16 lanes, 12 rows,
        _mm512_setzero_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_set1_ps, _mm512_fmadd_ps, _mm512_add_ps
    );

    /// Pairs of rows are interleaved, then pairs of pairs, then halves change places.
    #[inline(always)]
    unsafe fn transpose(from: *const f32, to: *mut f32) {
        unsafe {
            let rows: [__m256; BLOCK] = std::array::from_fn(|i| _mm256_loadu_ps(from.add(i * PANEL)));
            let pairs: [__m256; BLOCK] = std::array::from_fn(|i| {
                let (a, b) = (rows[i & !1], rows[i | 1]);
                if i % 2 == 0 {
                    _mm256_unpacklo_ps(a, b)
                } else {
                    _mm256_unpackhi_ps(a, b)
                }
            });
            let fours: [__m256; BLOCK] = std::array::from_fn(|i| {
                let first = (i & 4) + (i & 2) / 2;
                let (a, b) = (pairs[first], pairs[first + 2]);
                if i % 2 == 0 {
                    _mm256_shuffle_ps::<0x44>(a, b)
                } else {
                    _mm256_shuffle_ps::<0xee>(a, b)
                }
            });
            for i in 0..BLOCK {
                let (a, b) = (fours[i % 4], fours[i % 4 + 4]);
                let column = if i < 4 {
                    _mm256_permute2f128_ps::<0x20>(a, b)
                } else {
                    _mm256_permute2f128_ps::<0x31>(a, b)
                };
                _mm256_storeu_ps(to.add(i * PANEL), column);
            }
        }
    }
}
