//! How far to go along a search direction of the contact solver, each lane for itself.

use super::block::{Block, Work};
use super::cost::{contact_hessian, evaluate, friction_force, limit_force};
use super::rows::Rows;
use super::scratch::NewtonSettings;
use crate::lanes::{Mask, Real, Scalar};
use crate::options::LineSearch;

/// Step length along the search direction: 1 where that is near the minimum, else the root of the derivative by
/// bracketed Newton. Lanes that are done get 0. Also whether `trial` holds the contacts at that step in all lanes.
#[inline(always)]
pub(super) fn line_search<L: Real, const D: usize>(
    settings: &NewtonSettings,
    done: L::Mask,
    block: &Block<L>,
    work: &mut Work<L>,
) -> (L, bool) {
    let (mut slope, mut curvature, mut start) = (L::zero(), L::zero(), L::zero());
    let scratch = &work.newton;
    let forces = scratch.ma.iter().zip(work.smooth.iter()).zip(scratch.m_search.iter()).zip(scratch.gradient.iter());
    for (&search, (((&ma, &smooth), &m_search), &gradient)) in scratch.search.iter().zip(forces) {
        slope += search * (ma - smooth);
        curvature += search * m_search;
        start += search * gradient;
    }
    // A derivative this much smaller than at the start is close enough.
    let enough = L::splat(1e-2) * start.abs();
    let mut step = L::select(done, L::zero(), L::one());
    let (mut low, mut high) = (L::zero(), L::splat(<L::Scalar as Scalar>::ROUNDER));
    let mut settled = done;
    for _ in 0..settings.line_search_iterations {
        evaluate_trial::<L, D>(step, work);
        let first = slope + step * curvature + constraint_slope::<L, D>(settings, step, block, work);
        settled = settled | !enough.lt(first.abs());
        if settled.all() {
            return (step, true);
        }
        let second = curvature + constraint_curvature::<L, D>(settings, step, block, work);
        let short = first.lt(L::zero());
        low = L::select(short & !settled, step, low);
        high = L::select(!short & !settled, step, high);
        let newton = step - first / second;
        let inside = low.lt(newton) & newton.lt(high);
        let mut middle = (low + high.min(L::splat(4.0) * low + L::one())) * L::splat(0.5);
        if settings.line_search == LineSearch::Apex && !(inside | settled).all() {
            middle = nearest_apex::<L, D>(low, high, middle, work);
        }
        step = L::select(settled, step, L::select(inside, newton, middle));
    }
    (step, false)
}

/// Where along the search direction a contact's tangential residual is least: there, friction turns round within a short
/// step, which halving finds late. The one strictly between `low` and `high` that is nearest to `middle`, else that.
#[inline(always)]
fn nearest_apex<L: Real, const D: usize>(low: L, high: L, middle: L, work: &Work<L>) -> L {
    let mut nearest = middle;
    let mut least = L::splat(<L::Scalar as Scalar>::ROUNDER);
    for &slot in &work.live {
        let rows = &work.rows.contacts[slot];
        let (residual, along) = (&work.newton.residual[slot], &work.newton.along[slot]);
        let (mut across, mut squared) = (L::zero(), L::zero());
        for k in 1..D {
            let weight = rows.friction[k - 1] * rows.friction[k - 1];
            across += weight * residual[k] * along[k];
            squared += weight * along[k] * along[k];
        }
        let apex = -across / squared;
        let apart = (apex - middle).abs();
        let better = low.lt(apex) & apex.lt(high) & apart.lt(least) & rows.active;
        nearest = L::select(better, apex, nearest);
        least = L::select(better, apart, least);
    }
    nearest
}

#[inline(always)]
fn evaluate_trial<L: Real, const D: usize>(step: L, work: &mut Work<L>) {
    for &slot in &work.live {
        let rows = &work.rows.contacts[slot];
        let mut residual = work.newton.residual[slot];
        for k in 0..D {
            let change = step * work.newton.along[slot][k];
            residual[k] += change;
        }
        evaluate::<L, D>(rows, &residual, &mut work.newton.trial[slot]);
    }
}

/// Derivative of the constraints' cost along the search direction, at the trial step.
#[inline(always)]
fn constraint_slope<L: Real, const D: usize>(
    settings: &NewtonSettings,
    step: L,
    block: &Block<L>,
    work: &Work<L>,
) -> L {
    let Rows { friction_reference, friction_weight, friction_limit, limits, .. } = &work.rows;
    let scratch = &work.newton;
    let mut sum = L::zero();
    if block.any_coulomb {
        for i in settings.topology.base_dofs..settings.topology.nv {
            let residual = scratch.a[i] + step * scratch.search[i] - friction_reference[i];
            sum -= friction_force(friction_weight[i], friction_limit[i], residual).0 * scratch.search[i];
        }
    }
    for row in limits {
        let (force, _) = limit_force(row, scratch.a[row.dof] + step * scratch.search[row.dof]);
        sum -= force * row.sign * scratch.search[row.dof];
    }
    for &slot in &work.live {
        for k in 0..D {
            sum -= scratch.trial[slot].force[k] * scratch.along[slot][k];
        }
    }
    sum
}

/// Second derivative of the constraints' cost along the search direction, at the trial step.
#[inline(always)]
fn constraint_curvature<L: Real, const D: usize>(
    settings: &NewtonSettings,
    step: L,
    block: &Block<L>,
    work: &Work<L>,
) -> L {
    let Rows { contacts, friction_reference, friction_weight, friction_limit, limits, .. } = &work.rows;
    let scratch = &work.newton;
    let mut sum = L::zero();
    if block.any_coulomb {
        for i in settings.topology.base_dofs..settings.topology.nv {
            let direction = scratch.search[i];
            let residual = scratch.a[i] + step * direction - friction_reference[i];
            let (_, holds) = friction_force(friction_weight[i], friction_limit[i], residual);
            sum += L::select(holds, friction_weight[i] * direction * direction, L::zero());
        }
    }
    for row in limits {
        let direction = scratch.search[row.dof];
        let (_, pushes) = limit_force(row, scratch.a[row.dof] + step * direction);
        sum += L::select(pushes, row.weight * direction * direction, L::zero());
    }
    for &slot in &work.live {
        let along = &scratch.along[slot];
        let hessian = contact_hessian::<L, D>(&contacts[slot], &scratch.trial[slot]);
        for i in 0..D {
            for j in 0..D {
                sum += along[i] * hessian[i][j] * along[j];
            }
        }
    }
    sum
}
