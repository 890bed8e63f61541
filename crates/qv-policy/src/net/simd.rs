//! Sixteen single-precision numbers in whatever registers the processor has.
//!
//! Fused multiply-adds are exactly rounded on all of them (without the hardware, by `f32::mul_add`), so that the same sums in the same
//! order have the same bits on every processor.

/// Numbers in a [`Wide`].
pub(super) const WIDTH: usize = 16;

/// Sixteen numbers.
///
/// # Safety
/// Values exist only inside functions compiled for the features of the type; pointers are to [`WIDTH`] numbers.
pub(super) trait Wide: Copy {
    /// Rows of a product that are worked on at once, so that sums stay in registers.
    const ROWS: usize;
    unsafe fn splat(value: f32) -> Self;
    unsafe fn load(from: *const f32) -> Self;
    unsafe fn store(self, to: *mut f32);
    /// `self + a * b`, rounded once.
    unsafe fn fused(self, a: Self, b: Self) -> Self;
}

/// Any processor.
#[derive(Clone, Copy)]
pub(super) struct Plain([f32; WIDTH]);

impl Wide for Plain {
    const ROWS: usize = 1;
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Self([value; WIDTH])
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        Self(unsafe { *from.cast() })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe { *to.cast() = self.0 };
    }
    #[inline(always)]
    unsafe fn fused(mut self, a: Self, b: Self) -> Self {
        for k in 0..WIDTH {
            self.0[k] = a.0[k].mul_add(b.0[k], self.0[k]);
        }
        self
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    use super::Wide;
    use std::arch::x86_64::*;

    /// One register of AVX-512.
    #[derive(Clone, Copy)]
    pub struct Avx512(__m512);

    impl Wide for Avx512 {
        const ROWS: usize = 6;
        #[inline(always)]
        unsafe fn splat(value: f32) -> Self {
            Self(unsafe { _mm512_set1_ps(value) })
        }
        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self {
            Self(unsafe { _mm512_loadu_ps(from) })
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut f32) {
            unsafe { _mm512_storeu_ps(to, self.0) };
        }
        #[inline(always)]
        unsafe fn fused(self, a: Self, b: Self) -> Self {
            Self(unsafe { _mm512_fmadd_ps(a.0, b.0, self.0) })
        }
    }

    /// Two registers of AVX2.
    #[derive(Clone, Copy)]
    pub struct Avx2(__m256, __m256);

    impl Wide for Avx2 {
        const ROWS: usize = 3;
        #[inline(always)]
        unsafe fn splat(value: f32) -> Self {
            let value = unsafe { _mm256_set1_ps(value) };
            Self(value, value)
        }
        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self {
            unsafe { Self(_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(8))) }
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut f32) {
            unsafe {
                _mm256_storeu_ps(to, self.0);
                _mm256_storeu_ps(to.add(8), self.1);
            }
        }
        #[inline(always)]
        unsafe fn fused(self, a: Self, b: Self) -> Self {
            unsafe { Self(_mm256_fmadd_ps(a.0, b.0, self.0), _mm256_fmadd_ps(a.1, b.1, self.1)) }
        }
    }
}

#[cfg(target_arch = "aarch64")]
pub(super) mod arm {
    use super::Wide;
    use std::arch::aarch64::*;

    /// Four registers of NEON.
    #[derive(Clone, Copy)]
    pub struct Neon([float32x4_t; 4]);

    impl Wide for Neon {
        const ROWS: usize = 3;
        #[inline(always)]
        unsafe fn splat(value: f32) -> Self {
            Self([unsafe { vdupq_n_f32(value) }; 4])
        }
        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self {
            unsafe { Self([vld1q_f32(from), vld1q_f32(from.add(4)), vld1q_f32(from.add(8)), vld1q_f32(from.add(12))]) }
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut f32) {
            for k in 0..4 {
                unsafe { vst1q_f32(to.add(4 * k), self.0[k]) };
            }
        }
        #[inline(always)]
        unsafe fn fused(mut self, a: Self, b: Self) -> Self {
            for k in 0..4 {
                self.0[k] = unsafe { vfmaq_f32(self.0[k], a.0[k], b.0[k]) };
            }
            self
        }
    }
}
