//! One environment: plain `f64` and `f32`.

use super::{Kernel, Mask, Real, Scalar};

impl Mask for bool {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        value
    }
    #[inline(always)]
    fn any(self) -> bool {
        self
    }
    #[inline(always)]
    fn all(self) -> bool {
        self
    }
}

macro_rules! scalar {
    ($t:ty, $rounder:expr, $tolerance:expr) => {
        impl Scalar for $t {
            const ROUNDER: f64 = $rounder;
            const TOLERANCE: f64 = $tolerance;
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as $t
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }
        }

        impl Real for $t {
            type Scalar = $t;
            type Mask = bool;
            const LANES: usize = 1;

            #[inline(always)]
            fn splat(value: f64) -> Self {
                value as $t
            }
            #[inline(always)]
            fn lane(&self, _: usize) -> $t {
                *self
            }
            #[inline(always)]
            fn set_lane(&mut self, _: usize, value: $t) {
                *self = value;
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$t>::sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                <$t>::abs(self)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn le(self, other: Self) -> bool {
                self <= other
            }
            #[inline(always)]
            fn select(mask: bool, yes: Self, no: Self) -> Self {
                if mask { yes } else { no }
            }
            #[inline(always)]
            fn mask_lane(mask: bool, _: usize) -> bool {
                mask
            }
            #[inline(always)]
            unsafe fn with_features<B: Kernel<Self>>(body: B) {
                // The same operations in a richer instruction encoding: fewer moves, same bits.
                #[cfg(target_arch = "x86_64")]
                {
                    #[target_feature(enable = "avx2")]
                    fn compiled<B: Kernel<$t>>(body: B) {
                        body.run();
                    }
                    if is_x86_feature_detected!("avx2") {
                        return unsafe { compiled(body) };
                    }
                }
                body.run();
            }
        }
    };
}

scalar!(f64, 6755399441055744.0, 1e-6);
scalar!(f32, 12582912.0, 1e-5);
