//! Run-time choice of the instruction set, and the one place with `unsafe` in this crate.
//!
//! A [`Kernel`] is ordinary generic code, inlined into a function compiled for AVX-512, AVX2 or the baseline. Most
//! kernels are plain loops over slices that the compiler vectorises once it may use the wide registers. Only the
//! micro-kernel of the matrix product names vectors, through [`Simd`], because its accumulators must stay in registers.
//!
//! `unsafe` is needed for two things: calling a function compiled for an instruction set (sound because the set was
//! detected), and the micro-kernel's raw loads and stores (sound because [`tile`] checks every bound before it).

use std::sync::OnceLock;

/// Columns of a packed panel, see [`crate::matrix`].
pub(crate) const PANEL: usize = 32;

/// Code that can be compiled for each instruction set. `run` must be `#[inline(always)]`.
pub(crate) trait Kernel {
    /// What the code returns.
    type Output;
    /// The code.
    fn run<S: Simd>(self) -> Self::Output;
}

/// Vector operations of one instruction set.
///
/// # Safety
/// The methods may only run where the instruction set is present: inside [`Kernel::run`].
pub(crate) unsafe trait Simd: Copy {
    /// A vector of `f32`.
    type Vector: Copy;
    /// Its length.
    const LANES: usize;
    /// Rows of the largest micro-kernel: with two vectors a row, accumulators and operands fill the registers.
    const ROWS: usize;
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
    /// `a * b + c`; fused where that is one instruction.
    fn fma(a: f32, b: f32, c: f32) -> f32;
    /// `a * b + c` in `f64`.
    fn fma64(a: f64, b: f64, c: f64) -> f64;
}

/// Any processor: four lanes, which SSE and NEON have.
#[derive(Clone, Copy)]
pub(crate) struct Baseline;

unsafe impl Simd for Baseline {
    type Vector = [f32; 4];
    const LANES: usize = 4;
    const ROWS: usize = 4;
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
    fn fma(a: f32, b: f32, c: f32) -> f32 {
        if cfg!(target_arch = "aarch64") {
            a.mul_add(b, c)
        } else {
            a * b + c
        }
    }
    #[inline(always)]
    fn fma64(a: f64, b: f64, c: f64) -> f64 {
        if cfg!(target_arch = "aarch64") {
            a.mul_add(b, c)
        } else {
            a * b + c
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Kernel, Simd};
    use std::arch::x86_64::*;

    /// AVX2 with FMA.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2;

    unsafe impl Simd for Avx2 {
        type Vector = __m256;
        const LANES: usize = 8;
        const ROWS: usize = 6;
        #[inline(always)]
        unsafe fn zero() -> Self::Vector {
            unsafe { _mm256_setzero_ps() }
        }
        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self::Vector {
            unsafe { _mm256_loadu_ps(from) }
        }
        #[inline(always)]
        unsafe fn store(to: *mut f32, value: Self::Vector) {
            unsafe { _mm256_storeu_ps(to, value) }
        }
        #[inline(always)]
        unsafe fn multiply_add(scalar: f32, x: Self::Vector, sum: Self::Vector) -> Self::Vector {
            unsafe { _mm256_fmadd_ps(_mm256_set1_ps(scalar), x, sum) }
        }
        #[inline(always)]
        unsafe fn add(x: Self::Vector, y: Self::Vector) -> Self::Vector {
            unsafe { _mm256_add_ps(x, y) }
        }
        #[inline(always)]
        fn fma(a: f32, b: f32, c: f32) -> f32 {
            a.mul_add(b, c)
        }
        #[inline(always)]
        fn fma64(a: f64, b: f64, c: f64) -> f64 {
            a.mul_add(b, c)
        }
    }

    /// AVX-512 (F, VL, DQ, BW).
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512;

    unsafe impl Simd for Avx512 {
        type Vector = __m512;
        const LANES: usize = 16;
        const ROWS: usize = 12;
        #[inline(always)]
        unsafe fn zero() -> Self::Vector {
            unsafe { _mm512_setzero_ps() }
        }
        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self::Vector {
            unsafe { _mm512_loadu_ps(from) }
        }
        #[inline(always)]
        unsafe fn store(to: *mut f32, value: Self::Vector) {
            unsafe { _mm512_storeu_ps(to, value) }
        }
        #[inline(always)]
        unsafe fn multiply_add(scalar: f32, x: Self::Vector, sum: Self::Vector) -> Self::Vector {
            unsafe { _mm512_fmadd_ps(_mm512_set1_ps(scalar), x, sum) }
        }
        #[inline(always)]
        unsafe fn add(x: Self::Vector, y: Self::Vector) -> Self::Vector {
            unsafe { _mm512_add_ps(x, y) }
        }
        #[inline(always)]
        fn fma(a: f32, b: f32, c: f32) -> f32 {
            a.mul_add(b, c)
        }
        #[inline(always)]
        fn fma64(a: f64, b: f64, c: f64) -> f64 {
            a.mul_add(b, c)
        }
    }

    #[target_feature(enable = "avx2,fma")]
    pub(super) fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<Avx2>()
    }

    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
    pub(super) fn with_avx512<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<Avx512>()
    }
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
        (Level::Avx512, Level::Avx512) => return unsafe { x86::with_avx512(kernel) },
        (Level::Avx2, Level::Avx2 | Level::Avx512) => return unsafe { x86::with_avx2(kernel) },
        _ => {}
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = wanted;
    kernel.run::<Baseline>()
}

/// The left operand of [`tile`], a matrix in panels, see [`crate::matrix::Panels`].
#[derive(Clone, Copy)]
pub(crate) struct Left<'a> {
    /// The elements.
    pub data: &'a [f32],
    /// Floats from a panel to the next.
    pub panel: usize,
    /// The operand is the transpose of what is stored.
    pub transposed: bool,
}

/// The output of [`tile`].
pub(crate) struct Out<'a> {
    /// The elements, from the first one of the tile.
    pub data: &'a mut [f32],
    /// Floats from a row to the next.
    pub stride: usize,
    /// Add to what is there instead of replacing it.
    pub accumulate: bool,
}

/// `out (rows x columns) = left (rows x depth) * panel (depth x columns)`; `columns` is at most [`PANEL`] and the
/// panel's rows lie [`PANEL`] apart.
#[inline(always)]
pub(crate) fn tile<S: Simd>(left: Left, rows: usize, depth: usize, panel: &[f32], columns: usize, out: Out) {
    if rows == 0 || depth == 0 || columns == 0 {
        return;
    }
    let (stored_rows, stored_columns) = if left.transposed { (depth, rows) } else { (rows, depth) };
    let last = (stored_columns - 1) / PANEL * left.panel + (stored_rows - 1) * PANEL + (stored_columns - 1) % PANEL;
    assert!(last < left.data.len() && stored_rows * PANEL <= left.panel && panel.len() >= depth * PANEL);
    assert!(columns <= PANEL && (rows - 1) * out.stride + columns <= out.data.len());
    let mut row = 0;
    while row < rows {
        let mut count = (rows - row).min(S::ROWS);
        if left.transposed {
            count = count.min(PANEL - row % PANEL);
        }
        // SAFETY: the asserts above bound the rows, the depth and the columns of all three operands: `block` reads
        // `count` rows of the left operand from `row` on and whole rows of the panel, and writes `count` rows of as many
        // columns as there are, those of an incomplete vector by way of a buffer.
        unsafe {
            let offset = if left.transposed {
                row / PANEL * left.panel + row % PANEL
            } else {
                row * PANEL
            };
            let a = left.data.as_ptr().add(offset);
            let c = out.data.as_mut_ptr().add(row * out.stride);
            let mut column = 0;
            while column < columns {
                let wide = columns - column > S::LANES;
                let width = if wide { 2 * S::LANES } else { S::LANES };
                let b = panel.as_ptr().add(column);
                if column + width <= columns {
                    block::<S>(
                        left,
                        count,
                        wide,
                        depth,
                        a,
                        b,
                        c.add(column),
                        out.stride,
                        out.accumulate,
                    );
                } else {
                    let mut full = [0.0; 12 * PANEL];
                    block::<S>(left, count, wide, depth, a, b, full.as_mut_ptr(), PANEL, false);
                    for i in 0..count {
                        for j in column..columns {
                            let to = c.add(i * out.stride + j);
                            let before = if out.accumulate { *to } else { 0.0 };
                            *to = before + full[i * PANEL + j - column];
                        }
                    }
                }
                column += width;
            }
        }
        row += count;
    }
}

/// Chooses the micro-kernel.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "the operands of a matrix product")]
unsafe fn block<S: Simd>(
    left: Left,
    rows: usize,
    wide: bool,
    depth: usize,
    a: *const f32,
    b: *const f32,
    c: *mut f32,
    c_stride: usize,
    accumulate: bool,
) {
    macro_rules! choose {
        ($($rows:literal)*) => {
            match (rows, wide, left.transposed) {
                $(
                    ($rows, true, false) => micro::<S, $rows, 2, false>(depth, a, left.panel, b, c, c_stride, accumulate),
                    ($rows, false, false) => micro::<S, $rows, 1, false>(depth, a, left.panel, b, c, c_stride, accumulate),
                    ($rows, true, true) => micro::<S, $rows, 2, true>(depth, a, left.panel, b, c, c_stride, accumulate),
                    ($rows, false, true) => micro::<S, $rows, 1, true>(depth, a, left.panel, b, c, c_stride, accumulate),
                )*
                _ => unreachable!("rows are at most S::ROWS"),
            }
        };
    }
    unsafe { choose!(1 2 3 4 5 6 7 8 9 10 11 12) }
}

/// `R` rows of `V` vectors, held in registers over the depth.
#[inline(always)]
unsafe fn micro<S: Simd, const R: usize, const V: usize, const TRANSPOSED: bool>(
    depth: usize,
    a: *const f32,
    a_panel: usize,
    b: *const f32,
    c: *mut f32,
    c_stride: usize,
    accumulate: bool,
) {
    unsafe {
        let mut sums = [[S::zero(); V]; R];
        let mut start = 0;
        while start < depth {
            // Along the rows of the left operand a panel ends after so many columns; down its columns it does not.
            let end = if TRANSPOSED { depth } else { depth.min(start + PANEL) };
            let a = if TRANSPOSED { a } else { a.add(start / PANEL * a_panel) };
            let b = b.add(start * PANEL);
            for k in 0..end - start {
                let mut x = [S::zero(); V];
                for (j, x) in x.iter_mut().enumerate() {
                    *x = S::load(b.add(k * PANEL + j * S::LANES));
                }
                for (i, sums) in sums.iter_mut().enumerate() {
                    let scalar = if TRANSPOSED {
                        *a.add(k * PANEL + i)
                    } else {
                        *a.add(i * PANEL + k)
                    };
                    for (sum, &x) in sums.iter_mut().zip(&x) {
                        *sum = S::multiply_add(scalar, x, *sum);
                    }
                }
            }
            start = end;
        }
        for (i, sums) in sums.iter().enumerate() {
            for (j, &sum) in sums.iter().enumerate() {
                let to = c.add(i * c_stride + j * S::LANES);
                let sum = if accumulate { S::add(S::load(to), sum) } else { sum };
                S::store(to, sum);
            }
        }
    }
}

/// Fused multiply-adds on independent registers, `rounds` times [`FmaLoop::operations_per_round`]: what the processor
/// can do at best.
pub(crate) struct FmaLoop {
    pub rounds: u64,
}

impl FmaLoop {
    /// Accumulators: enough to hide the latency of two units, few enough to stay in registers.
    const SUMS: usize = 12;

    /// Floating-point operations of a round.
    pub(crate) fn operations_per_round() -> f64 {
        struct Lanes;
        impl Kernel for Lanes {
            type Output = usize;
            #[inline(always)]
            fn run<S: Simd>(self) -> usize {
                S::LANES
            }
        }
        (2 * Self::SUMS * dispatch(Lanes)) as f64
    }
}

impl Kernel for FmaLoop {
    type Output = f32;

    #[inline(always)]
    fn run<S: Simd>(self) -> f32 {
        let factor = std::hint::black_box(0.5_f32);
        let mut first = [0.0; 16];
        // SAFETY: the buffer holds a vector of every instruction set.
        unsafe {
            let mut sums = [S::zero(); Self::SUMS];
            let x = S::load(std::hint::black_box([1.0; 16]).as_ptr());
            for _ in 0..self.rounds {
                for sum in &mut sums {
                    *sum = S::multiply_add(factor, *sum, x);
                }
            }
            let total = sums.iter().fold(S::zero(), |total, &sum| S::add(total, sum));
            S::store(first.as_mut_ptr(), total);
        }
        first[0]
    }
}
