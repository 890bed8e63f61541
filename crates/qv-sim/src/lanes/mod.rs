//! Numbers that hold one value per environment.
//!
//! The engine is written once, over [`Real`]. A scalar steps one environment; a vector register steps as many as it
//! has lanes. Every operation is an exactly rounded IEEE one (no fused multiply-add, no library transcendental), so an
//! environment gets the same bits in any lane of any width.
//!
//! Our own thin wrapper because `wide` picks its registers when it is compiled: a portable build would never use
//! AVX-512. Here the register is chosen when the program runs.

#[cfg(target_arch = "x86_64")]
mod avx;
mod scalar;
mod trig;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx::{F32x8, F32x16, F64x4, F64x8};
pub(crate) use trig::sin_cos;

use std::fmt::Debug;
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, Neg, Not, Sub, SubAssign};

/// The scalar type of a simulation: `f64` or `f32`.
pub trait Scalar: Real<Scalar = Self, Mask = bool> + Debug + PartialOrd + 'static {
    /// Rounds to this type.
    fn from_f64(value: f64) -> Self;
    /// Exact conversion.
    fn to_f64(self) -> f64;
    /// `1.5 * 2^(mantissa bits)`: adding and subtracting it rounds to the nearest integer.
    const ROUNDER: f64;
    /// Default tolerance of the contact solver on the scaled gradient.
    const TOLERANCE: f64;
}

/// A truth value per lane.
pub trait Mask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> + Debug {
    /// The same value in all lanes.
    fn splat(value: bool) -> Self;
    /// Whether any lane is true.
    fn any(self) -> bool;
    /// Whether all lanes are true.
    fn all(self) -> bool;
}

/// A number per lane. Arithmetic is exactly rounded in every lane.
pub trait Real:
    Copy
    + Send
    + Sync
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + 'static
{
    /// Type of one lane.
    type Scalar: Scalar;
    /// Result of a comparison.
    type Mask: Mask + Send + Sync + 'static;
    /// Number of environments in one value.
    const LANES: usize;

    /// The same value in all lanes.
    fn splat(value: f64) -> Self;
    /// Value of one lane.
    fn lane(&self, lane: usize) -> Self::Scalar;
    /// Writes one lane.
    fn set_lane(&mut self, lane: usize, value: Self::Scalar);
    /// Square root.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// `if self < other { self } else { other }` (so NaN gives `other`).
    fn min(self, other: Self) -> Self;
    /// `if self > other { self } else { other }`.
    fn max(self, other: Self) -> Self;
    /// `self < other`; false on NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`; false on NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `if mask { yes } else { no }` in each lane.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// A mask lane.
    fn mask_lane(mask: Self::Mask, lane: usize) -> bool;
    /// Runs `body` compiled for the registers that this type needs.
    ///
    /// # Safety
    /// The processor must have the features of the type.
    unsafe fn with_features<B: Kernel<Self>>(body: B);

    /// Zero in all lanes.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }
    /// One in all lanes.
    #[inline(always)]
    fn one() -> Self {
        Self::splat(1.0)
    }
    /// Limits to `low..=high`.
    #[inline(always)]
    fn clamp(self, low: Self, high: Self) -> Self {
        self.max(low).min(high)
    }
    /// Nearest integer, ties to even, for magnitudes below 2^21.
    #[inline(always)]
    fn round(self) -> Self {
        let rounder = Self::splat(<Self::Scalar as Scalar>::ROUNDER);
        (self + rounder) - rounder
    }
}

/// Work to be compiled for a register type, see [`Real::with_features`].
pub trait Kernel<L> {
    /// Does the work. Implementations are `#[inline(always)]`, so that the caller's features reach them.
    fn run(self);
}

/// Puts a number into a lane.
pub(crate) fn set<L: Real>(target: &mut L, lane: usize, value: f64) {
    target.set_lane(lane, L::Scalar::from_f64(value));
}

/// Puts a truth value into a lane.
pub(crate) fn set_mask<L: Real>(mask: &mut L::Mask, lane: usize, value: bool) {
    // Masks of a register type have no lane access: make one by a comparison.
    let mut numbers = L::select(*mask, L::one(), L::zero());
    set(&mut numbers, lane, f64::from(value));
    *mask = L::zero().lt(numbers);
}
