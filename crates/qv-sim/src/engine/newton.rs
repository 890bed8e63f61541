//! The constrained acceleration: Newton's method on MuJoCo's convex primal cost (documentation, Computation,
//! "Primal problem"), each lane with its own line search and its own end.
//!
//! The cost is `1/2 (a - a_s)ᵀ M (a - a_s) + s(J a - a_ref)`. All constraints here act on one branch of the tree, so the
//! Hessian has the packed pattern of the mass matrix, and joint friction only touches its diagonal.

use super::array::Array;
use super::block::{ActsOn, Block, Work};
use super::constraint::{ContactRows, LimitRow, Rows};
use super::dynamics::{HEAD, factor, multiply_packed, plus, solve};
use super::line_search::line_search;
use super::start::start_cheaper;
use super::topology::Topology;
use crate::lanes::{Mask, Real};
use crate::options::{LineSearch, WarmStart};

/// Vectors of the solver.
#[derive(Debug, Clone)]
pub(crate) struct Scratch<L: Real> {
    /// Acceleration, the unknown.
    pub a: Array<L>,
    /// Mass matrix times `a`.
    pub ma: Array<L>,
    pub gradient: Array<L>,
    pub search: Array<L>,
    pub m_search: Array<L>,
    /// `J a - a_ref` and `J search`, `[slot][6]`.
    pub residual: Array<[L; 6]>,
    pub along: Array<[L; 6]>,
    /// Contact forces at the residuals and where those lie, and the same at a trial step.
    pub(super) contact: Array<Evaluated<L>>,
    pub(super) trial: Array<Evaluated<L>>,
}

impl<L: Real> Scratch<L> {
    pub fn new(topology: &Topology, slots: usize) -> Self {
        let zero: Array<L> = vec![L::zero(); topology.nv].into();
        Self {
            a: zero.clone(),
            ma: zero.clone(),
            gradient: zero.clone(),
            search: zero.clone(),
            m_search: zero,
            residual: vec![[L::zero(); 6]; slots].into(),
            along: vec![[L::zero(); 6]; slots].into(),
            contact: vec![Evaluated::new(); slots].into(),
            trial: vec![Evaluated::new(); slots].into(),
        }
    }
}

/// A contact at one residual: its force, and where the residual lies in the cone's cost (MuJoCo's zones).
#[derive(Debug, Clone, Copy)]
pub(super) struct Evaluated<L: Real> {
    /// Minus the gradient of the cost.
    pub force: [L; 6],
    /// Inside the polar cone: plain quadratic.
    pub bottom: L::Mask,
    /// On the cone.
    pub middle: L::Mask,
    /// N = residual[0] * cone.
    pub normal: L,
    /// One over the length of the scaled tangential residual where `middle`, else 1.
    pub inverse: L,
    /// Scaled tangential residual.
    pub u: [L; 5],
}

impl<L: Real> Evaluated<L> {
    pub fn new() -> Self {
        let (zero, never) = (L::zero(), L::Mask::splat(false));
        let (force, u) = ([zero; 6], [zero; 5]);
        Self { force, bottom: never, middle: never, normal: zero, inverse: zero, u }
    }
}

#[inline(always)]
pub(super) fn evaluate<L: Real, const D: usize>(rows: &ContactRows<L>, residual: &[L; 6], out: &mut Evaluated<L>) {
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
pub(super) fn contact_hessian<L: Real, const D: usize>(rows: &ContactRows<L>, z: &Evaluated<L>) -> [[L; 6]; 6] {
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

/// Settings of the solver.
pub(crate) struct NewtonSettings<'a> {
    pub topology: &'a Topology,
    pub slots: &'a [ActsOn],
    pub iterations: usize,
    pub tolerance: f64,
    pub line_search: LineSearch,
    /// Most steps of a line search.
    pub line_search_iterations: usize,
    pub warm_start: WarmStart,
}

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
