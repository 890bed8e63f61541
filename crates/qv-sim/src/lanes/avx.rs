//! Four to sixteen environments: AVX2 and AVX-512 registers.
//!
//! A value of one of these types exists only inside a batch that found the processor's features (see `batch`), and
//! that is what makes the intrinsics below sound.

use super::{Kernel, Mask, Real};
use std::arch::x86_64::*;
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, Neg, Not, Sub, SubAssign};

macro_rules! operator {
    ($name:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for $name {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}

macro_rules! register {
    ($name:ident, $scalar:ty, $register:ty, $lanes:expr, $features:literal, $mask:ident,
     $set1:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $sqrt:ident, $min:ident, $max:ident,
     $andnot:ident, $xor:ident, $less:expr, $less_equal:expr, $select:expr) => {
        #[derive(Clone, Copy, Debug)]
        #[repr(transparent)]
        pub struct $name($register);

        operator!($name, Add, add, $add);
        operator!($name, Sub, sub, $sub);
        operator!($name, Mul, mul, $mul);
        operator!($name, Div, div, $div);

        impl Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self(unsafe { $xor(self.0, $set1(-0.0)) })
            }
        }
        impl AddAssign for $name {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }
        impl SubAssign for $name {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }

        impl Real for $name {
            type Scalar = $scalar;
            type Mask = $mask;
            const LANES: usize = $lanes;

            #[inline(always)]
            fn splat(value: f64) -> Self {
                Self(unsafe { $set1(value as $scalar) })
            }
            #[inline(always)]
            fn lane(&self, lane: usize) -> $scalar {
                assert!(lane < $lanes);
                // The register is an array of scalars in memory.
                unsafe { *(self as *const Self).cast::<$scalar>().add(lane) }
            }
            #[inline(always)]
            fn set_lane(&mut self, lane: usize, value: $scalar) {
                assert!(lane < $lanes);
                unsafe { *(self as *mut Self).cast::<$scalar>().add(lane) = value };
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(unsafe { $sqrt(self.0) })
            }
            #[inline(always)]
            fn abs(self) -> Self {
                Self(unsafe { $andnot($set1(-0.0), self.0) })
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                Self(unsafe { $min(self.0, other.0) })
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                Self(unsafe { $max(self.0, other.0) })
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask {
                $mask(unsafe { $less(self.0, other.0) })
            }
            #[inline(always)]
            fn le(self, other: Self) -> $mask {
                $mask(unsafe { $less_equal(self.0, other.0) })
            }
            #[inline(always)]
            fn select(mask: $mask, yes: Self, no: Self) -> Self {
                Self(unsafe { $select(no.0, yes.0, mask.0) })
            }
            #[inline(always)]
            fn mask_lane(mask: $mask, lane: usize) -> bool {
                (mask.bits() >> lane) & 1 == 1
            }
            #[inline(always)]
            unsafe fn with_features<B: Kernel<Self>>(body: B) {
                #[target_feature(enable = $features)]
                fn compiled<B: Kernel<$name>>(body: B) {
                    body.run();
                }
                unsafe { compiled(body) }
            }
        }
    };
}

macro_rules! bit_mask {
    ($name:ident, $bits:ty) => {
        /// One bit per lane.
        #[derive(Clone, Copy, Debug)]
        pub struct $name($bits);
        impl $name {
            #[inline(always)]
            fn bits(self) -> u32 {
                self.0 as u32
            }
        }
        impl Mask for $name {
            #[inline(always)]
            fn splat(value: bool) -> Self {
                Self(if value { <$bits>::MAX } else { 0 })
            }
            #[inline(always)]
            fn any(self) -> bool {
                self.0 != 0
            }
            #[inline(always)]
            fn all(self) -> bool {
                self.0 == <$bits>::MAX
            }
        }
        impl BitAnd for $name {
            type Output = Self;
            #[inline(always)]
            fn bitand(self, other: Self) -> Self {
                Self(self.0 & other.0)
            }
        }
        impl BitOr for $name {
            type Output = Self;
            #[inline(always)]
            fn bitor(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }
        }
        impl Not for $name {
            type Output = Self;
            #[inline(always)]
            fn not(self) -> Self {
                Self(!self.0)
            }
        }
    };
}

macro_rules! wide_mask {
    ($name:ident, $register:ty, $set1:ident, $and:ident, $or:ident, $xor:ident, $movemask:ident, $full:expr, $ones:expr) => {
        /// A register of all-ones or all-zeros lanes.
        #[derive(Clone, Copy, Debug)]
        pub struct $name($register);
        impl $name {
            #[inline(always)]
            fn bits(self) -> u32 {
                unsafe { $movemask(self.0) as u32 }
            }
        }
        impl Mask for $name {
            #[inline(always)]
            fn splat(value: bool) -> Self {
                Self(unsafe { $set1(if value { $ones } else { 0.0 }) })
            }
            #[inline(always)]
            fn any(self) -> bool {
                self.bits() != 0
            }
            #[inline(always)]
            fn all(self) -> bool {
                self.bits() == $full
            }
        }
        operator!($name, BitAnd, bitand, $and);
        operator!($name, BitOr, bitor, $or);
        impl Not for $name {
            type Output = Self;
            #[inline(always)]
            fn not(self) -> Self {
                Self(unsafe { $xor(self.0, $set1($ones)) })
            }
        }
    };
}

bit_mask!(Bits8, u8);
bit_mask!(Bits16, u16);
wide_mask!(
    Wide4,
    __m256d,
    _mm256_set1_pd,
    _mm256_and_pd,
    _mm256_or_pd,
    _mm256_xor_pd,
    _mm256_movemask_pd,
    0xf,
    f64::from_bits(u64::MAX)
);
wide_mask!(
    Wide8,
    __m256,
    _mm256_set1_ps,
    _mm256_and_ps,
    _mm256_or_ps,
    _mm256_xor_ps,
    _mm256_movemask_ps,
    0xff,
    f32::from_bits(u32::MAX)
);

register!(
    F64x8,
    f64,
    __m512d,
    8,
    "avx512f,avx512dq",
    Bits8,
    _mm512_set1_pd,
    _mm512_add_pd,
    _mm512_sub_pd,
    _mm512_mul_pd,
    _mm512_div_pd,
    _mm512_sqrt_pd,
    _mm512_min_pd,
    _mm512_max_pd,
    _mm512_andnot_pd,
    _mm512_xor_pd,
    _mm512_cmp_pd_mask::<_CMP_LT_OQ>,
    _mm512_cmp_pd_mask::<_CMP_LE_OQ>,
    |no, yes, mask| _mm512_mask_blend_pd(mask, no, yes)
);
register!(
    F32x16,
    f32,
    __m512,
    16,
    "avx512f,avx512dq",
    Bits16,
    _mm512_set1_ps,
    _mm512_add_ps,
    _mm512_sub_ps,
    _mm512_mul_ps,
    _mm512_div_ps,
    _mm512_sqrt_ps,
    _mm512_min_ps,
    _mm512_max_ps,
    _mm512_andnot_ps,
    _mm512_xor_ps,
    _mm512_cmp_ps_mask::<_CMP_LT_OQ>,
    _mm512_cmp_ps_mask::<_CMP_LE_OQ>,
    |no, yes, mask| _mm512_mask_blend_ps(mask, no, yes)
);
register!(
    F64x4,
    f64,
    __m256d,
    4,
    "avx2",
    Wide4,
    _mm256_set1_pd,
    _mm256_add_pd,
    _mm256_sub_pd,
    _mm256_mul_pd,
    _mm256_div_pd,
    _mm256_sqrt_pd,
    _mm256_min_pd,
    _mm256_max_pd,
    _mm256_andnot_pd,
    _mm256_xor_pd,
    _mm256_cmp_pd::<_CMP_LT_OQ>,
    _mm256_cmp_pd::<_CMP_LE_OQ>,
    _mm256_blendv_pd
);
register!(
    F32x8,
    f32,
    __m256,
    8,
    "avx2",
    Wide8,
    _mm256_set1_ps,
    _mm256_add_ps,
    _mm256_sub_ps,
    _mm256_mul_ps,
    _mm256_div_ps,
    _mm256_sqrt_ps,
    _mm256_min_ps,
    _mm256_max_ps,
    _mm256_andnot_ps,
    _mm256_xor_ps,
    _mm256_cmp_ps::<_CMP_LT_OQ>,
    _mm256_cmp_ps::<_CMP_LE_OQ>,
    _mm256_blendv_ps
);
