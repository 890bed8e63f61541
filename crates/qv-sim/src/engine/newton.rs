//! The constrained acceleration: Newton's method on MuJoCo's convex primal cost (documentation, Computation,
//! "Primal problem"), each lane with its own line search and its own end.
//!
//! The cost is `1/2 (a - a_s)ᵀ M (a - a_s) + s(J a - a_ref)`. All constraints here act on one branch of the tree, so the
//! Hessian has the packed pattern of the mass matrix, and joint friction only touches its diagonal.

use super::array::Array;
use super::block::{Block, Work};
use super::cost::{contact_hessian, evaluate, friction_force, limit_force, project};
use super::dynamics::{HEAD, factor, multiply_packed, plus, solve};
use super::line_search::line_search;
use super::rows::{ActsOn, ContactRows, Rows};
use super::scratch::NewtonSettings;
use super::start::start_cheaper;
use super::topology::Topology;
use crate::lanes::{Mask, Real};
use crate::options::WarmStart;

/// Solves for `work.newton.a`, starting from `block.warm`. On return `ma` is the mass matrix times it.
#[inline(always)]
pub(crate) fn newton<L: Real, const D: usize>(settings: &NewtonSettings, block: &Block<L>, work: &mut Work<L>) {
    let topology = settings.topology;
    work.newton.a.copy_from_slice(&block.warm);
    if settings.warm_start == WarmStart::Cheaper {
        start_cheaper::<L, D>(settings, block, work);
    }
    multiply_packed(topology, &work.mass_matrix, &work.newton.a, &mut work.newton.ma);
    start_residuals::<L, D>(settings, work);
    evaluate_contacts::<L, D>(work);
    let threshold = threshold(settings, work);
    let mut done = block.faulty;
    for _ in 0..settings.iterations {
        gradient::<L, D>(settings, block, work);
        let mut squared = L::zero();
        for &entry in &work.newton.gradient {
            squared += entry * entry;
        }
        // Written so that NaN ends a lane rather than keeping the others waiting.
        done = done | !threshold.lt(squared);
        if done.all() {
            break;
        }
        hessian::<L, D>(settings, block, work);
        factor(topology, &mut work.hessian);
        let scratch = &mut work.newton;
        for (search, &gradient) in scratch.search.iter_mut().zip(scratch.gradient.iter()) {
            *search = -gradient;
        }
        solve(topology, &work.hessian, &mut work.newton.search);
        multiply_packed(topology, &work.mass_matrix, &work.newton.search, &mut work.newton.m_search);
        search_residuals::<L, D>(settings, work);
        let (step, evaluated) = line_search::<L, D>(settings, done, block, work);
        let scratch = &mut work.newton;
        add_scaled(&mut scratch.a, step, &scratch.search);
        add_scaled(&mut scratch.ma, step, &scratch.m_search);
        for &slot in &work.live {
            for k in 0..D {
                let change = step * scratch.along[slot][k];
                scratch.residual[slot][k] += change;
            }
        }
        if evaluated {
            std::mem::swap(&mut scratch.contact, &mut scratch.trial);
        } else {
            evaluate_contacts::<L, D>(work);
        }
    }
}

#[inline(always)]
fn add_scaled<L: Real>(target: &mut Array<L>, factor: L, own: &Array<L>) {
    for (entry, &own) in target.iter_mut().zip(own.iter()) {
        *entry += factor * own;
    }
}

#[inline(always)]
fn evaluate_contacts<L: Real, const D: usize>(work: &mut Work<L>) {
    for &slot in &work.live {
        let scratch = &mut work.newton;
        evaluate::<L, D>(&work.rows.contacts[slot], &scratch.residual[slot], &mut scratch.contact[slot]);
    }
}

/// Square of the gradient's length at which a lane is done: the tolerance times the forces at play.
#[inline(always)]
fn threshold<L: Real>(settings: &NewtonSettings, work: &Work<L>) -> L {
    let mut squared = L::splat(1e-6);
    for &force in &work.smooth {
        squared += force * force;
    }
    squared * L::splat(settings.tolerance * settings.tolerance)
}

#[inline(always)]
fn start_residuals<L: Real, const D: usize>(settings: &NewtonSettings, work: &mut Work<L>) {
    for &slot in &work.live {
        let rows = &work.rows.contacts[slot];
        let mut value = project::<L, D>(settings.topology, &settings.slots[slot], rows, &work.newton.a);
        for k in 0..D {
            value[k] -= rows.reference[k];
        }
        work.newton.residual[slot] = value;
    }
}

#[inline(always)]
fn search_residuals<L: Real, const D: usize>(settings: &NewtonSettings, work: &mut Work<L>) {
    for &slot in &work.live {
        let rows = &work.rows.contacts[slot];
        work.newton.along[slot] = project::<L, D>(settings.topology, &settings.slots[slot], rows, &work.newton.search);
    }
}

/// `M a - smooth - Jᵀ force`.
#[inline(always)]
fn gradient<L: Real, const D: usize>(settings: &NewtonSettings, block: &Block<L>, work: &mut Work<L>) {
    let topology = settings.topology;
    let Rows { contacts, friction_reference, friction_weight, friction_limit, limits, .. } = &work.rows;
    let scratch = &mut work.newton;
    for ((gradient, &ma), &smooth) in scratch.gradient.iter_mut().zip(scratch.ma.iter()).zip(work.smooth.iter()) {
        *gradient = ma - smooth;
    }
    if block.any_coulomb {
        for i in topology.base_dofs..topology.nv {
            let residual = scratch.a[i] - friction_reference[i];
            scratch.gradient[i] -= friction_force(friction_weight[i], friction_limit[i], residual).0;
        }
    }
    for row in limits {
        scratch.gradient[row.dof] -= row.sign * limit_force(row, scratch.a[row.dof]).0;
    }
    for &slot in &work.live {
        let rows = &contacts[slot];
        let force = scratch.contact[slot].force;
        let columns = topology.force_columns(settings.slots[slot].body);
        let count = columns.len();
        let start = if topology.base_dofs == HEAD {
            let mut sum = *scratch.gradient.chunk(0);
            for k in 0..D {
                sum = plus(sum, -force[k], *rows.jacobian.chunk(k * count));
            }
            *scratch.gradient.chunk_mut(0) = sum;
            HEAD
        } else {
            0
        };
        for (position, &column) in columns.iter().enumerate().skip(start) {
            let mut sum = scratch.gradient[column];
            for k in 0..D {
                sum -= rows.jacobian[k * count + position] * force[k];
            }
            scratch.gradient[column] = sum;
        }
    }
}

/// `M + Jᵀ H J`, packed.
#[inline(always)]
fn hessian<L: Real, const D: usize>(settings: &NewtonSettings, block: &Block<L>, work: &mut Work<L>) {
    let topology = settings.topology;
    work.hessian.copy_from_slice(&work.mass_matrix);
    let diagonal = |i: usize| topology.row[i] + topology.columns[i].len() - 1;
    let Rows { contacts, friction_reference, friction_weight, friction_limit, limits, .. } = &work.rows;
    if block.any_coulomb {
        for i in topology.base_dofs..topology.nv {
            let residual = work.newton.a[i] - friction_reference[i];
            let (_, holds) = friction_force(friction_weight[i], friction_limit[i], residual);
            work.hessian[diagonal(i)] += L::select(holds, friction_weight[i], L::zero());
        }
    }
    for row in limits {
        let (_, pushes) = limit_force(row, work.newton.a[row.dof]);
        work.hessian[diagonal(row.dof)] += L::select(pushes, row.weight, L::zero());
    }
    for &slot in &work.live {
        let rows = &contacts[slot];
        let local = contact_hessian::<L, D>(rows, &work.newton.contact[slot]);
        let sliding = work.newton.contact[slot].middle.any();
        add_contact::<L, D>(topology, &settings.slots[slot], rows, sliding, &local, &mut work.hessian);
    }
}

#[inline(always)]
fn add_contact<L: Real, const D: usize>(
    topology: &Topology,
    slot: &ActsOn,
    rows: &ContactRows<L>,
    sliding: bool,
    local: &[[L; 6]; 6],
    hessian: &mut Array<L>,
) {
    let columns = topology.force_columns(slot.body);
    let count = columns.len();
    let base = topology.base_dofs;
    for (i, &row) in columns.iter().enumerate() {
        // local * J for column i.
        let mut weighted = [L::zero(); D];
        for k in 0..D {
            weighted[k] = local[k][k] * rows.jacobian[k * count + i];
        }
        // Off the cone the matrix is diagonal; the zeros beside it would add nothing.
        if sliding {
            for k in 0..D {
                for m in 0..D {
                    if m != k {
                        weighted[k] += local[k][m] * rows.jacobian[m * count + i];
                    }
                }
            }
        }
        let start = topology.row[row];
        if base == HEAD {
            let mut sum = *hessian.chunk(start);
            for k in 0..D {
                sum = plus(sum, weighted[k], *rows.jacobian.chunk(k * count));
            }
            *hessian.chunk_mut(start) = sum;
        }
        for j in base..i + 1 {
            let mut sum = hessian[start + j];
            for k in 0..D {
                sum += weighted[k] * rows.jacobian[k * count + j];
            }
            hessian[start + j] = sum;
        }
    }
}
