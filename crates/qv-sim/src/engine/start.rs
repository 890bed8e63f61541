//! Where a contact solve starts when it may choose (MuJoCo does it alike).

use super::array::Array;
use super::block::{Block, Work};
use super::cost::{evaluate, friction_force, limit_force, project};
use super::dynamics::{factor, multiply_packed, solve};
use super::rows::Rows;
use super::scratch::{ContactEvaluation, NewtonSettings};
use crate::lanes::Real;

/// Replaces the last acceleration by the one without constraints, in lanes where that costs less.
#[inline(always)]
pub(super) fn start_cheaper<L: Real, const D: usize>(settings: &NewtonSettings, block: &Block<L>, work: &mut Work<L>) {
    let topology = settings.topology;
    work.hessian.copy_from_slice(&work.mass_matrix);
    factor(topology, &mut work.hessian);
    work.newton.search.copy_from_slice(&work.smooth);
    solve(topology, &work.hessian, &mut work.newton.search);
    multiply_packed(topology, &work.mass_matrix, &work.newton.a, &mut work.newton.ma);
    let scratch = &work.newton;
    let mut quadratic = L::zero();
    for i in 0..topology.nv {
        quadratic += (scratch.a[i] - scratch.search[i]) * (scratch.ma[i] - work.smooth[i]);
    }
    let last = L::splat(0.5) * quadratic + constraint_cost::<L, D>(settings, block, &scratch.a, work);
    let free = constraint_cost::<L, D>(settings, block, &scratch.search, work);
    let cheaper = free.lt(last);
    let scratch = &mut work.newton;
    for (a, &free) in scratch.a.iter_mut().zip(scratch.search.iter()) {
        *a = L::select(cheaper, free, *a);
    }
}

/// Cost of all constraints at an acceleration.
#[inline(always)]
fn constraint_cost<L: Real, const D: usize>(
    settings: &NewtonSettings,
    block: &Block<L>,
    a: &Array<L>,
    work: &Work<L>,
) -> L {
    let Rows { contacts, friction_reference, friction_weight, friction_limit, limits, .. } = &work.rows;
    let (zero, half) = (L::zero(), L::splat(0.5));
    let mut sum = zero;
    if block.any_coulomb {
        for i in settings.topology.base_dofs..settings.topology.nv {
            // `1/2 f r` while it holds; beyond, the line that goes on from there.
            let residual = a[i] - friction_reference[i];
            let (force, holds) = friction_force(friction_weight[i], friction_limit[i], residual);
            let weight = friction_weight[i];
            let beyond = -(force * residual) - half * force * force / weight;
            sum += L::select(holds, half * weight * residual * residual, beyond);
        }
    }
    for row in limits {
        let residual = row.sign * a[row.dof] - row.reference;
        let (force, _) = limit_force(row, a[row.dof]);
        sum -= half * force * residual;
    }
    for &slot in &work.live {
        let rows = &contacts[slot];
        let mut residual = project::<L, D>(settings.topology, &settings.slots[slot], rows, a);
        for k in 0..D {
            residual[k] -= rows.reference[k];
        }
        let mut z = ContactEvaluation::new();
        evaluate::<L, D>(rows, &residual, &mut z);
        let mut bottom = zero;
        for k in 0..D {
            bottom += rows.weight[k] * residual[k] * residual[k];
        }
        // On the cone `inverse` is one over the tangential length.
        let above = z.normal - rows.cone / z.inverse;
        let cone = rows.scale * above * above;
        sum += half * L::select(z.bottom, bottom, L::select(z.middle, cone, zero));
    }
    sum
}
