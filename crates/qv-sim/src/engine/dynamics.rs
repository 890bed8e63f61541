//! Mass matrix, bias forces, and the factorisation that both linear solves use.

use super::array::Array;
use super::block::{Block, Work};
use super::topology::Topology;
use super::vector::*;
use crate::lanes::Real;

/// Coriolis, centrifugal, gyroscopic and gravity forces (recursive Newton-Euler, Featherstone table 5.1) into
/// `work.bias`, and the composite inertias of the subtrees into `work.inertia`.
#[inline(always)]
pub(crate) fn bias_forces<L: Real>(topology: &Topology, gravity: [f64; 3], block: &Block<L>, work: &mut Work<L>) {
    let count = topology.bodies.len();
    for (index, body) in topology.bodies.iter().enumerate() {
        let upward = join([L::zero(); 3], splat3([-gravity[0], -gravity[1], -gravity[2]]));
        let acceleration = match (body.joint, body.parent) {
            (None, _) => {
                // The base's own term: v x w of its linear velocity, because its angular axes turn with it.
                let velocity = &work.velocity[0];
                add6(upward, join([L::zero(); 3], cross(linear(velocity), angular(velocity))))
            }
            (Some(_), parent) => {
                let before = parent.map_or(upward, |p| work.acceleration[p]);
                let motion = scale6(&work.subspace[body.dof], block.v[body.dof]);
                add6(before, cross_motion(&work.velocity[index], &motion))
            }
        };
        work.acceleration[index] = acceleration;
        let inertia = &work.inertia[index];
        let momentum = inertia_times(inertia, &work.velocity[index]);
        work.force[index] = add6(inertia_times(inertia, &acceleration), cross_force(&work.velocity[index], &momentum));
    }
    for index in (0..count).rev() {
        let body = &topology.bodies[index];
        let force = work.force[index];
        let own = if body.joint.is_some() { 1 } else { 6 };
        for dof in body.dof..body.dof + own {
            work.bias[dof] = dot6(&work.subspace[dof], &force);
        }
        if let Some(parent) = body.parent {
            work.force[parent] = add6(work.force[parent], force);
            let inertia = work.inertia[index];
            for k in 0..10 {
                work.inertia[parent][k] += inertia[k];
            }
        }
    }
}

/// Mass matrix by composite rigid bodies (Featherstone table 6.2), packed, with armature. Needs the composite inertias.
#[inline(always)]
pub(crate) fn mass_matrix<L: Real>(topology: &Topology, block: &Block<L>, work: &mut Work<L>) {
    for i in 0..topology.nv {
        let body = topology.dof_body[i];
        let force = inertia_times(&work.inertia[body], &work.subspace[i]);
        let columns = &topology.columns[i];
        let row = topology.row[i];
        // The base's axes are known to be half empty: its columns are parts of the force.
        let base = topology.base_dofs.min(columns.len());
        for k in 0..base {
            work.mass_matrix[row + k] =
                if k < 3 { force[3 + k] } else { dot(angular(&work.subspace[k]), angular(&force)) };
        }
        if topology.dense {
            work.mass_matrix.part_mut(row + base..row + columns.len()).fill(L::zero());
            let path = &topology.bodies[body].path;
            for &k in path.iter().filter(|&&k| k >= base && k <= i) {
                work.mass_matrix[row + k] = dot6(&work.subspace[k], &force);
            }
        } else {
            for position in base..columns.len() {
                work.mass_matrix[row + position] = dot6(&work.subspace[columns[position]], &force);
            }
        }
        work.mass_matrix[row + columns.len() - 1] += block.armature[i];
    }
}

/// Degrees of freedom of a free base: the head of every row, long enough to be worth unrolling.
pub(crate) const HEAD: usize = 6;

/// `target + factor * own`. By value, so that the compiler sees that the two do not overlap.
#[inline(always)]
pub(crate) fn plus<L: Real>(mut target: [L; HEAD], factor: L, own: [L; HEAD]) -> [L; HEAD] {
    for j in 0..HEAD {
        target[j] += factor * own[j];
    }
    target
}

/// `target - factor * own`.
#[inline(always)]
fn minus<L: Real>(mut target: [L; HEAD], factor: L, own: [L; HEAD]) -> [L; HEAD] {
    for j in 0..HEAD {
        target[j] -= factor * own[j];
    }
    target
}

/// Factors a packed matrix in place as Lᵀ D L (Featherstone table 6.3); diagonals become the inverses of D.
#[inline(always)]
pub(crate) fn factor<L: Real>(topology: &Topology, matrix: &mut Array<L>) {
    let base = topology.base_dofs;
    for i in (base..topology.nv).rev() {
        let columns = &topology.columns[i];
        let (row, last) = (topology.row[i], columns.len() - 1);
        let inverse = L::one() / matrix[row + last];
        matrix[row + last] = inverse;
        for k in (base..last).rev() {
            let factor = matrix[row + k] * inverse;
            let target = topology.row[columns[k]];
            if base == HEAD {
                *matrix.chunk_mut(target) = minus(*matrix.chunk(target), factor, *matrix.chunk(row));
            }
            for j in base..=k {
                let change = factor * matrix[row + j];
                matrix[target + j] -= change;
            }
            matrix[row + k] = factor;
        }
        if base == HEAD {
            let own: [L; HEAD] = *matrix.chunk(row);
            let mut scaled = own;
            for k in 0..HEAD {
                // All six columns, though those above the diagonal mean nothing: whole registers are cheaper.
                scaled[k] = own[k] * inverse;
                *matrix.chunk_mut(HEAD * k) = minus(*matrix.chunk(HEAD * k), scaled[k], own);
            }
            *matrix.chunk_mut(row) = scaled;
        }
    }
    if base == HEAD {
        factor_base(matrix.chunk_mut(0));
    }
}

#[inline(always)]
fn factor_base<L: Real>(rows: &mut [L; HEAD * HEAD]) {
    for i in (0..HEAD).rev() {
        let inverse = L::one() / rows[HEAD * i + i];
        rows[HEAD * i + i] = inverse;
        for k in (0..i).rev() {
            let factor = rows[HEAD * i + k] * inverse;
            for j in 0..=k {
                let change = factor * rows[HEAD * i + j];
                rows[HEAD * k + j] -= change;
            }
            rows[HEAD * i + k] = factor;
        }
    }
}

/// Solves with a factored matrix, in place.
#[inline(always)]
pub(crate) fn solve<L: Real>(topology: &Topology, factored: &Array<L>, x: &mut Array<L>) {
    let base = topology.base_dofs;
    for i in (base..topology.nv).rev() {
        let columns = &topology.columns[i];
        let (row, last) = (topology.row[i], columns.len() - 1);
        let value = x[i];
        for k in base..last {
            x[columns[k]] -= factored[row + k] * value;
        }
        if base == HEAD {
            *x.chunk_mut(0) = minus(*x.chunk(0), value, *factored.chunk(row));
        }
        x[i] = value * factored[row + last];
    }
    if base == HEAD {
        *x.chunk_mut(0) = solve_base(factored.chunk(0), *x.chunk(0));
    }
    for i in base..topology.nv {
        let columns = &topology.columns[i];
        let (row, last) = (topology.row[i], columns.len() - 1);
        let mut sum = x[i];
        for k in 0..base {
            sum -= factored[row + k] * x[k];
        }
        for k in base..last {
            sum -= factored[row + k] * x[columns[k]];
        }
        x[i] = sum;
    }
}

#[inline(always)]
fn solve_base<L: Real>(rows: &[L; HEAD * HEAD], mut x: [L; HEAD]) -> [L; HEAD] {
    for i in (0..HEAD).rev() {
        for k in 0..i {
            let change = rows[HEAD * i + k] * x[i];
            x[k] -= change;
        }
        x[i] = x[i] * rows[HEAD * i + i];
    }
    for i in 0..HEAD {
        for k in 0..i {
            let change = rows[HEAD * i + k] * x[k];
            x[i] -= change;
        }
    }
    x
}

/// `out = matrix * x` for a packed symmetric matrix.
#[inline(always)]
pub(crate) fn multiply_packed<L: Real>(topology: &Topology, matrix: &Array<L>, x: &Array<L>, out: &mut Array<L>) {
    let base = topology.base_dofs;
    if base == HEAD {
        *out.chunk_mut(0) = multiply_base(matrix.chunk(0), *x.chunk(0));
    }
    for i in base..topology.nv {
        let columns = &topology.columns[i];
        let (row, last) = (topology.row[i], columns.len() - 1);
        let own = x[i];
        let mut sum = matrix[row + last] * own;
        if base == HEAD {
            let entries: [L; HEAD] = *matrix.chunk(row);
            for k in 0..HEAD {
                sum += entries[k] * x[k];
            }
            *out.chunk_mut(0) = plus(*out.chunk(0), own, entries);
        }
        for k in base..last {
            let entry = matrix[row + k];
            sum += entry * x[columns[k]];
            out[columns[k]] += entry * own;
        }
        // Rows below add to `out[i]` later; everything above is complete.
        out[i] = sum;
    }
}

#[inline(always)]
fn multiply_base<L: Real>(rows: &[L; HEAD * HEAD], x: [L; HEAD]) -> [L; HEAD] {
    let mut out = [L::zero(); HEAD];
    for i in 0..HEAD {
        out[i] = rows[HEAD * i + i] * x[i];
        for k in 0..i {
            out[i] += rows[HEAD * i + k] * x[k];
            out[k] += rows[HEAD * i + k] * x[i];
        }
    }
    out
}
