//! What the processor can do at best.

use super::{Kernel, Simd, dispatch};

/// Fused multiply-adds on independent registers, `rounds` times [`FmaLoop::operations_per_round`].
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
