//! Small vectors and matrices over lanes.
//!
//! Spatial vectors (Featherstone, Rigid Body Dynamics Algorithms, ch. 2) are `[angular; linear]`, in world axes, about
//! the origin of the base, so that single precision does not lose a robot that is far from the world's origin.
//!
//! No `array::map` or `from_fn` here or elsewhere in the hot path: their closures are compiled without the features of
//! the register, and every operation in them becomes a call.

use crate::lanes::Real;

pub(crate) type V3<L> = [L; 3];
/// Row-major 3 x 3.
pub(crate) type M3<L> = [L; 9];
/// Angular part, then linear part.
pub(crate) type V6<L> = [L; 6];
/// Mass, first moment (3), second moment about the origin xx, yy, zz, xy, xz, yz.
pub(crate) type Inertia<L> = [L; 10];

#[inline(always)]
pub(crate) fn splat3<L: Real>(v: [f64; 3]) -> V3<L> {
    [L::splat(v[0]), L::splat(v[1]), L::splat(v[2])]
}

#[inline(always)]
pub(crate) fn splat9<L: Real>(m: &[f64; 9]) -> M3<L> {
    let mut out = [L::zero(); 9];
    for i in 0..9 {
        out[i] = L::splat(m[i]);
    }
    out
}

#[inline(always)]
pub(crate) fn add<L: Real>(a: V3<L>, b: V3<L>) -> V3<L> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(crate) fn sub<L: Real>(a: V3<L>, b: V3<L>) -> V3<L> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(crate) fn scale<L: Real>(a: V3<L>, k: L) -> V3<L> {
    [a[0] * k, a[1] * k, a[2] * k]
}

#[inline(always)]
pub(crate) fn dot<L: Real>(a: V3<L>, b: V3<L>) -> L {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn cross<L: Real>(a: V3<L>, b: V3<L>) -> V3<L> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub(crate) fn rotate<L: Real>(m: &M3<L>, v: V3<L>) -> V3<L> {
    [
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    ]
}

#[inline(always)]
pub(crate) fn rotate_back<L: Real>(m: &M3<L>, v: V3<L>) -> V3<L> {
    [
        m[0] * v[0] + m[3] * v[1] + m[6] * v[2],
        m[1] * v[0] + m[4] * v[1] + m[7] * v[2],
        m[2] * v[0] + m[5] * v[1] + m[8] * v[2],
    ]
}

#[inline(always)]
pub(crate) fn multiply<L: Real>(a: &M3<L>, b: &M3<L>) -> M3<L> {
    let mut out = [L::zero(); 9];
    for i in 0..3 {
        for j in 0..3 {
            out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
        }
    }
    out
}

/// Rotation matrix of a unit quaternion w, x, y, z.
#[inline(always)]
pub(crate) fn matrix_of_quaternion<L: Real>(q: [L; 4]) -> M3<L> {
    let [w, x, y, z] = q;
    let two = L::splat(2.0);
    let one = L::one();
    [
        one - two * (y * y + z * z),
        two * (x * y - w * z),
        two * (x * z + w * y),
        two * (x * y + w * z),
        one - two * (x * x + z * z),
        two * (y * z - w * x),
        two * (x * z - w * y),
        two * (y * z + w * x),
        one - two * (x * x + y * y),
    ]
}

/// Two unit vectors that make a right-handed frame with unit `n` (Duff et al., JCGT 6(1), 2017).
#[inline(always)]
pub(crate) fn tangents<L: Real>(n: V3<L>) -> (V3<L>, V3<L>) {
    let sign = L::select(n[2].lt(L::zero()), -L::one(), L::one());
    let a = -L::one() / (sign + n[2]);
    let b = n[0] * n[1] * a;
    ([L::one() + sign * n[0] * n[0] * a, sign * b, -(sign * n[0])], [b, sign + n[1] * n[1] * a, -n[1]])
}

#[inline(always)]
pub(crate) fn angular<L: Real>(a: &V6<L>) -> V3<L> {
    [a[0], a[1], a[2]]
}

#[inline(always)]
pub(crate) fn linear<L: Real>(a: &V6<L>) -> V3<L> {
    [a[3], a[4], a[5]]
}

#[inline(always)]
pub(crate) fn join<L: Real>(w: V3<L>, v: V3<L>) -> V6<L> {
    [w[0], w[1], w[2], v[0], v[1], v[2]]
}

#[inline(always)]
pub(crate) fn add6<L: Real>(a: V6<L>, b: V6<L>) -> V6<L> {
    let mut out = a;
    for i in 0..6 {
        out[i] += b[i];
    }
    out
}

#[inline(always)]
pub(crate) fn scale6<L: Real>(a: &V6<L>, k: L) -> V6<L> {
    [a[0] * k, a[1] * k, a[2] * k, a[3] * k, a[4] * k, a[5] * k]
}

#[inline(always)]
pub(crate) fn dot6<L: Real>(a: &V6<L>, b: &V6<L>) -> L {
    ((a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])) + (a[4] * b[4] + a[5] * b[5])
}

/// Motion cross product `a x m` (Featherstone eq. 2.31).
#[inline(always)]
pub(crate) fn cross_motion<L: Real>(a: &V6<L>, m: &V6<L>) -> V6<L> {
    let (w, v, mw, mv) = (angular(a), linear(a), angular(m), linear(m));
    join(cross(w, mw), add(cross(w, mv), cross(v, mw)))
}

/// Force cross product `a x* f` (Featherstone eq. 2.32).
#[inline(always)]
pub(crate) fn cross_force<L: Real>(a: &V6<L>, f: &V6<L>) -> V6<L> {
    let (w, v, n, l) = (angular(a), linear(a), angular(f), linear(f));
    join(add(cross(w, n), cross(v, l)), cross(w, l))
}

/// Spatial inertia times motion.
#[inline(always)]
pub(crate) fn inertia_times<L: Real>(i: &Inertia<L>, m: &V6<L>) -> V6<L> {
    let (w, v) = (angular(m), linear(m));
    let h = [i[1], i[2], i[3]];
    let rotational = [
        i[4] * w[0] + i[7] * w[1] + i[8] * w[2],
        i[7] * w[0] + i[5] * w[1] + i[9] * w[2],
        i[8] * w[0] + i[9] * w[1] + i[6] * w[2],
    ];
    join(add(rotational, cross(h, v)), add(scale(v, i[0]), cross(w, h)))
}
