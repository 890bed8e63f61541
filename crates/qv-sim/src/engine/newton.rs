//! The constrained acceleration: Newton's method on MuJoCo's convex primal cost (documentation, Computation,
//! "Primal problem"), each lane with its own line search and its own end.
//!
//! The cost is `1/2 (a - a_s)ᵀ M (a - a_s) + s(J a - a_ref)`. All constraints here act on one branch of the tree, so the
//! Hessian has the packed pattern of the mass matrix, and joint friction only touches its diagonal.

use super::block::{Block, Slot, Work};
use super::constraint::{ContactRows, LimitRow, Rows};
use super::dynamics::{factor, multiply_packed, solve};
use super::topology::Topology;
use crate::lanes::{Mask, Real, Scalar};

/// Vectors of the solver.
#[derive(Debug, Clone)]
pub(crate) struct Scratch<L: Real> {
    /// Acceleration, the unknown.
    pub a: Vec<L>,
    /// Mass matrix times `a`.
    pub ma: Vec<L>,
    gradient: Vec<L>,
    search: Vec<L>,
    m_search: Vec<L>,
    /// `J a - a_ref` and `J search`, `[slot][6]`.
    residual: Vec<[L; 6]>,
    along: Vec<[L; 6]>,
}

impl<L: Real> Scratch<L> {
    pub fn new(topology: &Topology) -> Self {
        let zero = vec![L::zero(); topology.nv];
        Self {
            a: zero.clone(),
            ma: zero.clone(),
            gradient: zero.clone(),
            search: zero.clone(),
            m_search: zero,
            residual: Vec::new(),
            along: Vec::new(),
        }
    }
}

/// Where a contact's residual lies in its cone's cost (MuJoCo's zones).
struct Zones<L: Real> {
    /// Inside the polar cone: plain quadratic.
    bottom: L::Mask,
    /// On the cone.
    middle: L::Mask,
    /// N = residual[0] * cone.
    normal: L,
    /// Length of the scaled tangential residual.
    tangent: L,
    /// Scaled tangential residual.
    u: [L; 5],
    /// `D_0 / (mu² (1 + mu²))`.
    scale: L,
}

#[inline(always)]
fn zones<L: Real>(rows: &ContactRows<L>, dimension: usize, residual: &[L; 6]) -> Zones<L> {
    let mu = rows.cone;
    let normal = residual[0] * mu;
    let mut u = [L::zero(); 5];
    let mut squared = L::zero();
    for k in 1..dimension {
        u[k - 1] = residual[k] * rows.friction[k - 1];
        squared += u[k - 1] * u[k - 1];
    }
    let tangent = squared.sqrt();
    let top = (mu * tangent).le(normal);
    let bottom = (mu * normal + tangent).le(L::zero()) & !top;
    let middle = !top & !bottom & rows.active;
    let square = mu * mu;
    let scale = rows.weight[0] / (square * (L::one() + square));
    Zones { bottom: bottom & rows.active, middle, normal, tangent, u, scale }
}

/// Force of a contact, minus the gradient of its cost.
#[inline(always)]
fn contact_force<L: Real>(rows: &ContactRows<L>, dimension: usize, residual: &[L; 6]) -> [L; 6] {
    let z = zones(rows, dimension, residual);
    let zero = L::zero();
    let mu = rows.cone;
    let slide = z.scale * (z.normal - mu * z.tangent);
    let mut force = [zero; 6];
    force[0] = L::select(z.middle, -(slide * mu), L::select(z.bottom, -(rows.weight[0] * residual[0]), zero));
    let inverse = L::one() / L::select(z.middle, z.tangent, L::one());
    for k in 1..dimension {
        let sliding = slide * mu * z.u[k - 1] * inverse * rows.friction[k - 1];
        force[k] = L::select(z.middle, sliding, L::select(z.bottom, -(rows.weight[k] * residual[k]), zero));
    }
    force
}

/// Lower triangle of the cost's Hessian for one contact, `[row][column]`.
#[inline(always)]
fn contact_hessian<L: Real>(rows: &ContactRows<L>, dimension: usize, residual: &[L; 6]) -> [[L; 6]; 6] {
    let z = zones(rows, dimension, residual);
    let zero = L::zero();
    let mu = rows.cone;
    let inverse = L::one() / L::select(z.middle, z.tangent, L::one());
    let curvature = mu * z.normal * inverse * inverse * inverse;
    let diagonal = mu * mu - mu * z.normal * inverse;
    let mut out = [[zero; 6]; 6];
    for i in 0..dimension {
        let scale_i = if i == 0 { mu } else { rows.friction[i - 1] };
        for j in 0..=i {
            let scale_j = if j == 0 { mu } else { rows.friction[j - 1] };
            let raw = if i == 0 {
                L::one()
            } else if j == 0 {
                -(mu * z.u[i - 1] * inverse)
            } else {
                let own = if i == j { diagonal } else { zero };
                curvature * z.u[i - 1] * z.u[j - 1] + own
            };
            let cone = z.scale * scale_i * scale_j * raw;
            let plain = if i == j { rows.weight[i] } else { zero };
            out[i][j] = L::select(z.middle, cone, L::select(z.bottom, plain, zero));
        }
    }
    out
}

/// Force of joint friction and whether it holds (is in its quadratic part).
#[inline(always)]
fn friction_force<L: Real>(weight: f64, most: L, residual: L) -> (L, L::Mask) {
    let free = -(L::splat(weight) * residual);
    let holds = free.abs().lt(most);
    (free.max(-most).min(most), holds)
}

#[inline(always)]
fn limit_force<L: Real>(row: &LimitRow<L>, acceleration: L) -> (L, L::Mask) {
    let residual = row.sign * acceleration - row.reference;
    let pushes = residual.lt(L::zero()) & row.active;
    (L::select(pushes, -(row.weight * residual), L::zero()), pushes)
}

/// Settings of the solver.
pub(crate) struct NewtonSettings<'a> {
    pub topology: &'a Topology,
    pub slots: &'a [Slot],
    pub iterations: usize,
    pub tolerance: f64,
}

/// Solves for `work.newton.a`, starting from `block.warm`. On return `ma` holds the sum of all forces.
#[inline(always)]
pub(crate) fn newton<L: Real>(settings: &NewtonSettings, block: &Block<L>, work: &mut Work<L>) {
    let topology = settings.topology;
    let nv = topology.nv;
    work.newton.a.copy_from_slice(&block.warm);
    multiply_packed(topology, &work.mass_matrix, &work.newton.a, &mut work.newton.ma);
    start_residuals(settings, work);
    let threshold = threshold(settings, work);
    let mut done = block.faulty;
    for _ in 0..settings.iterations {
        gradient(settings, block, work);
        let mut squared = L::zero();
        for i in 0..nv {
            squared += work.newton.gradient[i] * work.newton.gradient[i];
        }
        // Written so that NaN ends a lane rather than keeping the others waiting.
        done = done | !threshold.lt(squared);
        if done.all() {
            break;
        }
        hessian(settings, block, work);
        factor(topology, &mut work.hessian);
        for i in 0..nv {
            work.newton.search[i] = -work.newton.gradient[i];
        }
        solve(topology, &work.hessian, &mut work.newton.search);
        multiply_packed(topology, &work.mass_matrix, &work.newton.search, &mut work.newton.m_search);
        search_residuals(settings, work);
        let step = line_search(settings, done, block, work);
        let scratch = &mut work.newton;
        for i in 0..nv {
            scratch.a[i] += step * scratch.search[i];
            scratch.ma[i] += step * scratch.m_search[i];
        }
        for &slot in &work.live {
            for k in 0..work.rows.dimension {
                let change = step * scratch.along[slot][k];
                scratch.residual[slot][k] += change;
            }
        }
    }
}

/// Square of the gradient's length at which a lane is done: the tolerance times the forces at play.
#[inline(always)]
fn threshold<L: Real>(settings: &NewtonSettings, work: &Work<L>) -> L {
    let mut squared = L::splat(1e-6);
    for i in 0..settings.topology.nv {
        squared += work.smooth[i] * work.smooth[i];
    }
    squared * L::splat(settings.tolerance * settings.tolerance)
}

#[inline(always)]
fn project<L: Real>(topology: &Topology, slot: &Slot, rows: &ContactRows<L>, dimension: usize, x: &[L]) -> [L; 6] {
    let columns = topology.force_columns(slot.body);
    let mut out = [L::zero(); 6];
    for k in 0..dimension {
        let row = &rows.jacobian[k * columns.len()..][..columns.len()];
        let mut sum = L::zero();
        for (&entry, &column) in row.iter().zip(columns) {
            sum += entry * x[column];
        }
        out[k] = sum;
    }
    out
}

#[inline(always)]
fn start_residuals<L: Real>(settings: &NewtonSettings, work: &mut Work<L>) {
    work.newton.residual.resize(settings.slots.len(), [L::zero(); 6]);
    work.newton.along.resize(settings.slots.len(), [L::zero(); 6]);
    let dimension = work.rows.dimension;
    for &slot in &work.live {
        let rows = &work.rows.contacts[slot];
        let mut value = project(settings.topology, &settings.slots[slot], rows, dimension, &work.newton.a);
        for k in 0..dimension {
            value[k] -= rows.reference[k];
        }
        work.newton.residual[slot] = value;
    }
}

#[inline(always)]
fn search_residuals<L: Real>(settings: &NewtonSettings, work: &mut Work<L>) {
    let dimension = work.rows.dimension;
    for &slot in &work.live {
        let rows = &work.rows.contacts[slot];
        work.newton.along[slot] =
            project(settings.topology, &settings.slots[slot], rows, dimension, &work.newton.search);
    }
}

/// `M a - smooth - Jᵀ force`.
#[inline(always)]
fn gradient<L: Real>(settings: &NewtonSettings, block: &Block<L>, work: &mut Work<L>) {
    let topology = settings.topology;
    let Rows { dimension, contacts, friction_reference, friction_weight, limits } = &work.rows;
    let scratch = &mut work.newton;
    for i in 0..topology.nv {
        scratch.gradient[i] = scratch.ma[i] - work.smooth[i];
    }
    if block.any_coulomb {
        for i in topology.base_dofs..topology.nv {
            let residual = scratch.a[i] - friction_reference[i];
            scratch.gradient[i] -= friction_force(friction_weight[i], block.coulomb[i], residual).0;
        }
    }
    for row in limits {
        scratch.gradient[row.dof] -= row.sign * limit_force(row, scratch.a[row.dof]).0;
    }
    for &slot in &work.live {
        let rows = &contacts[slot];
        let force = contact_force(rows, *dimension, &scratch.residual[slot]);
        let columns = topology.force_columns(settings.slots[slot].body);
        for (position, &column) in columns.iter().enumerate() {
            let mut sum = L::zero();
            for k in 0..*dimension {
                sum += rows.jacobian[k * columns.len() + position] * force[k];
            }
            scratch.gradient[column] -= sum;
        }
    }
}

/// `M + Jᵀ H J`, packed.
#[inline(always)]
fn hessian<L: Real>(settings: &NewtonSettings, block: &Block<L>, work: &mut Work<L>) {
    let topology = settings.topology;
    work.hessian.copy_from_slice(&work.mass_matrix);
    let diagonal = |i: usize| topology.row[i] + topology.columns[i].len() - 1;
    let Rows { dimension, contacts, friction_reference, friction_weight, limits } = &work.rows;
    if block.any_coulomb {
        for i in topology.base_dofs..topology.nv {
            let residual = work.newton.a[i] - friction_reference[i];
            let (_, holds) = friction_force(friction_weight[i], block.coulomb[i], residual);
            work.hessian[diagonal(i)] += L::select(holds, L::splat(friction_weight[i]), L::zero());
        }
    }
    for row in limits {
        let (_, pushes) = limit_force(row, work.newton.a[row.dof]);
        work.hessian[diagonal(row.dof)] += L::select(pushes, row.weight, L::zero());
    }
    for &slot in &work.live {
        let rows = &contacts[slot];
        let local = contact_hessian(rows, *dimension, &work.newton.residual[slot]);
        add_contact(topology, &settings.slots[slot], rows, *dimension, &local, &mut work.hessian);
    }
}

#[inline(always)]
fn add_contact<L: Real>(
    topology: &Topology,
    slot: &Slot,
    rows: &ContactRows<L>,
    dimension: usize,
    local: &[[L; 6]; 6],
    hessian: &mut [L],
) {
    let columns = topology.force_columns(slot.body);
    let count = columns.len();
    for (i, &row) in columns.iter().enumerate() {
        // local * J for column i; local is symmetric with its lower triangle filled.
        let mut weighted = [L::zero(); 6];
        for k in 0..dimension {
            let mut sum = L::zero();
            for m in 0..dimension {
                let entry = if m <= k { local[k][m] } else { local[m][k] };
                sum += entry * rows.jacobian[m * count + i];
            }
            weighted[k] = sum;
        }
        let target = &mut hessian[topology.row[row]..][..=i];
        for (j, entry) in target.iter_mut().enumerate() {
            let mut sum = L::zero();
            for k in 0..dimension {
                sum += weighted[k] * rows.jacobian[k * count + j];
            }
            *entry += sum;
        }
    }
}

/// Step length along the search direction: 1 where that is near the minimum, else the root of the derivative by
/// bracketed Newton. Lanes that are done get 0.
#[inline(always)]
fn line_search<L: Real>(settings: &NewtonSettings, done: L::Mask, block: &Block<L>, work: &Work<L>) -> L {
    const STEPS: usize = 12;
    let (mut slope, mut curvature) = (L::zero(), L::zero());
    let scratch = &work.newton;
    for i in 0..settings.topology.nv {
        slope += scratch.search[i] * (scratch.ma[i] - work.smooth[i]);
        curvature += scratch.search[i] * scratch.m_search[i];
    }
    let mut start = L::zero();
    for i in 0..settings.topology.nv {
        start += scratch.search[i] * scratch.gradient[i];
    }
    // A derivative this much smaller than at the start is close enough.
    let enough = L::splat(1e-2) * start.abs();
    let mut step = L::one();
    let (mut low, mut high) = (L::zero(), L::splat(<L::Scalar as Scalar>::ROUNDER));
    let mut settled = done;
    for _ in 0..STEPS {
        let (first, second) = derivatives(settings, step, slope, curvature, block, work);
        settled = settled | !enough.lt(first.abs());
        if settled.all() {
            break;
        }
        let short = first.lt(L::zero());
        low = L::select(short & !settled, step, low);
        high = L::select(!short & !settled, step, high);
        let newton = step - first / second;
        let inside = low.lt(newton) & newton.lt(high);
        let middle = (low + high.min(L::splat(4.0) * low + L::one())) * L::splat(0.5);
        step = L::select(settled, step, L::select(inside, newton, middle));
    }
    L::select(done, L::zero(), step)
}

/// First and second derivative of the cost along the search direction.
#[inline(always)]
fn derivatives<L: Real>(
    settings: &NewtonSettings,
    step: L,
    slope: L,
    curvature: L,
    block: &Block<L>,
    work: &Work<L>,
) -> (L, L) {
    let topology = settings.topology;
    let Rows { dimension, contacts, friction_reference, friction_weight, limits } = &work.rows;
    let scratch = &work.newton;
    let (mut first, mut second) = (slope + step * curvature, curvature);
    if block.any_coulomb {
        for i in topology.base_dofs..topology.nv {
            let direction = scratch.search[i];
            let residual = scratch.a[i] + step * direction - friction_reference[i];
            let (force, holds) = friction_force(friction_weight[i], block.coulomb[i], residual);
            first -= force * direction;
            second += L::select(holds, L::splat(friction_weight[i]) * direction * direction, L::zero());
        }
    }
    for row in limits {
        let direction = row.sign * scratch.search[row.dof];
        let (force, pushes) = limit_force(row, scratch.a[row.dof] + step * scratch.search[row.dof]);
        first -= force * direction;
        second += L::select(pushes, row.weight * direction * direction, L::zero());
    }
    for &slot in &work.live {
        let rows = &contacts[slot];
        let along = &scratch.along[slot];
        let mut residual = scratch.residual[slot];
        for k in 0..*dimension {
            residual[k] += step * along[k];
        }
        let force = contact_force(rows, *dimension, &residual);
        let hessian = contact_hessian(rows, *dimension, &residual);
        for i in 0..*dimension {
            first -= force[i] * along[i];
            let mut sum = hessian[i][i] * along[i];
            for j in 0..i {
                sum += (hessian[i][j] + hessian[i][j]) * along[j];
            }
            second += along[i] * sum;
        }
    }
    (first, second)
}

/// Normal force of a live contact at the solution \[N\].
#[inline(always)]
pub(crate) fn normal_force<L: Real>(slot: usize, work: &Work<L>) -> L {
    let rows = &work.rows.contacts[slot];
    contact_force(rows, work.rows.dimension, &work.newton.residual[slot])[0]
}
