//! The cost of constraints at a residual: forces, and how they change.

use super::array::Array;
use super::block::Work;
use super::dynamics::HEAD;
use super::rows::{ActsOn, ContactRows, LimitRow};
use super::scratch::ContactEvaluation;
use super::topology::Topology;
use crate::lanes::{Mask, Real};

#[inline(always)]
pub(super) fn evaluate<L: Real, const D: usize>(
    rows: &ContactRows<L>,
    residual: &[L; 6],
    out: &mut ContactEvaluation<L>,
) {
    let zero = L::zero();
    let mu = rows.cone;
    let normal = residual[0] * mu;
    let mut squared = zero;
    for k in 1..D {
        let u = residual[k] * rows.friction[k - 1];
        out.u[k - 1] = u;
        squared += u * u;
    }
    let tangent = squared.sqrt();
    let top = (mu * tangent).le(normal);
    let inside = (mu * normal + tangent).le(zero);
    let bottom = inside & !top & rows.active;
    let middle = !top & !inside & rows.active;
    for k in 0..D {
        out.force[k] = L::select(bottom, -(rows.weight[k] * residual[k]), zero);
    }
    let mut inverse = L::one();
    if middle.any() {
        inverse = L::one() / L::select(middle, tangent, L::one());
        let slide = rows.scale * mu * (normal - mu * tangent);
        out.force[0] = L::select(middle, -slide, out.force[0]);
        for k in 1..D {
            let sliding = slide * out.u[k - 1] * inverse * rows.friction[k - 1];
            out.force[k] = L::select(middle, sliding, out.force[k]);
        }
    }
    (out.bottom, out.middle, out.normal, out.inverse) = (bottom, middle, normal, inverse);
}

/// The cost's Hessian for one contact, `[row][column]`, symmetric.
#[inline(always)]
pub(super) fn contact_hessian<L: Real, const D: usize>(rows: &ContactRows<L>, z: &ContactEvaluation<L>) -> [[L; 6]; 6] {
    let zero = L::zero();
    let mut out = [[zero; 6]; 6];
    for i in 0..D {
        out[i][i] = L::select(z.bottom, rows.weight[i], zero);
    }
    // Mostly nothing slides, and the rest is zero.
    if !z.middle.any() {
        return out;
    }
    let mu = rows.cone;
    let curvature = mu * z.normal * z.inverse * z.inverse * z.inverse;
    let diagonal = mu * mu - mu * z.normal * z.inverse;
    for i in 0..D {
        let scale_i = if i == 0 { mu } else { rows.friction[i - 1] };
        for j in 0..=i {
            let scale_j = if j == 0 { mu } else { rows.friction[j - 1] };
            let raw = if i == 0 {
                L::one()
            } else if j == 0 {
                -(mu * z.u[i - 1] * z.inverse)
            } else {
                let own = if i == j { diagonal } else { zero };
                curvature * z.u[i - 1] * z.u[j - 1] + own
            };
            let cone = rows.scale * scale_i * scale_j * raw;
            out[i][j] = L::select(z.middle, cone, out[i][j]);
            out[j][i] = out[i][j];
        }
    }
    out
}

/// Force of joint friction and whether it holds (is in its quadratic part).
#[inline(always)]
pub(super) fn friction_force<L: Real>(weight: L, most: L, residual: L) -> (L, L::Mask) {
    let free = -(weight * residual);
    let holds = free.abs().lt(most);
    (free.max(-most).min(most), holds)
}

#[inline(always)]
pub(super) fn limit_force<L: Real>(row: &LimitRow<L>, acceleration: L) -> (L, L::Mask) {
    let residual = row.sign * acceleration - row.reference;
    let pushes = residual.lt(L::zero()) & row.active;
    (L::select(pushes, -(row.weight * residual), L::zero()), pushes)
}

#[inline(always)]
pub(super) fn project<L: Real, const D: usize>(
    topology: &Topology,
    slot: &ActsOn,
    rows: &ContactRows<L>,
    x: &Array<L>,
) -> [L; 6] {
    let columns = topology.force_columns(slot.body);
    let count = columns.len();
    let mut out = [L::zero(); 6];
    let start = if topology.base_dofs == HEAD {
        let x: &[L; HEAD] = x.chunk(0);
        for k in 0..D {
            let row: &[L; HEAD] = rows.jacobian.chunk(k * count);
            for j in 0..HEAD {
                out[k] += row[j] * x[j];
            }
        }
        HEAD
    } else {
        0
    };
    for (position, &column) in columns.iter().enumerate().skip(start) {
        for k in 0..D {
            out[k] += rows.jacobian[k * count + position] * x[column];
        }
    }
    out
}

/// Normal force of a live contact at the solution \[N\].
#[inline(always)]
pub(crate) fn normal_force<L: Real>(slot: usize, work: &Work<L>) -> L {
    work.newton.contact[slot].force[0]
}

/// Force of a live contact at the solution along its normal and its two tangents \[N\].
#[inline(always)]
pub(crate) fn contact_force<L: Real>(slot: usize, work: &Work<L>) -> [L; 3] {
    let force = &work.newton.contact[slot].force;
    [force[0], force[1], force[2]]
}
