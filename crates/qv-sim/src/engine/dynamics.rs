//! Mass matrix, bias forces, and the factorisation that both linear solves use.

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
        let row = &mut work.mass_matrix[topology.row[i]..][..columns.len()];
        // The base's axes are known to be half empty: its columns are parts of the force.
        let base = topology.base_dofs.min(columns.len());
        for k in 0..base {
            row[k] = if k < 3 { force[3 + k] } else { dot(angular(&work.subspace[k]), angular(&force)) };
        }
        if topology.dense {
            row[base..].fill(L::zero());
            let path = &topology.bodies[body].path;
            for &k in path.iter().filter(|&&k| k >= base && k <= i) {
                row[k] = dot6(&work.subspace[k], &force);
            }
        } else {
            for (entry, &k) in row[base..].iter_mut().zip(&columns[base..]) {
                *entry = dot6(&work.subspace[k], &force);
            }
        }
        row[columns.len() - 1] += block.armature[i];
    }
}

/// Degrees of freedom of a free base: the head of every row, long enough to be worth unrolling.
pub(crate) const HEAD: usize = 6;

#[inline(always)]
pub(crate) fn head<L>(row: &[L]) -> &[L; HEAD] {
    row.first_chunk().expect("a row with the six columns of the base")
}

#[inline(always)]
pub(crate) fn head_mut<L>(row: &mut [L]) -> &mut [L; HEAD] {
    row.first_chunk_mut().expect("a row with the six columns of the base")
}

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

/// `target -= factor * row` over as many entries as `target` has. The lengths below a leg are spelled out: a loop
/// costs more than they do.
#[inline(always)]
fn subtract<L: Real>(target: &mut [L], factor: L, row: &[L]) {
    match (target, row) {
        ([], _) => {}
        ([a], [x, ..]) => *a -= factor * *x,
        ([a, b], [x, y, ..]) => {
            *a -= factor * *x;
            *b -= factor * *y;
        }
        (target, row) => {
            for (entry, &own) in target.iter_mut().zip(row) {
                *entry -= factor * own;
            }
        }
    }
}

/// Factors a packed matrix in place as Lᵀ D L (Featherstone table 6.3); diagonals become the inverses of D.
#[inline(always)]
pub(crate) fn factor<L: Real>(topology: &Topology, matrix: &mut [L]) {
    for i in (topology.base_dofs..topology.nv).rev() {
        let columns = &topology.columns[i];
        let last = columns.len() - 1;
        // Rows of ancestors come before this one, so that the slice can be split here.
        let (above, below) = matrix.split_at_mut(topology.row[i]);
        let row = &mut below[..=last];
        let inverse = L::one() / row[last];
        row[last] = inverse;
        let base = topology.base_dofs;
        for k in (base..last).rev() {
            let factor = row[k] * inverse;
            let target = &mut above[topology.row[columns[k]]..][..=k];
            if base == HEAD {
                *head_mut(target) = minus(*head(target), factor, *head(row));
            }
            subtract(&mut target[base..], factor, &row[base..]);
            row[k] = factor;
        }
        if base == HEAD {
            let own = *head(row);
            for k in 0..HEAD {
                // All six columns, though those above the diagonal mean nothing: whole registers are cheaper.
                let target = head_mut(&mut above[HEAD * k..]);
                let factor = own[k] * inverse;
                *target = minus(*target, factor, own);
                row[k] = factor;
            }
        }
    }
    for i in (0..topology.base_dofs).rev() {
        let (above, below) = matrix.split_at_mut(topology.row[i]);
        let row = &mut below[..=i];
        let inverse = L::one() / row[i];
        row[i] = inverse;
        for k in (0..i).rev() {
            let factor = row[k] * inverse;
            subtract(&mut above[topology.row[k]..][..=k], factor, row);
            row[k] = factor;
        }
    }
}

/// Solves with a factored matrix, in place.
#[inline(always)]
pub(crate) fn solve<L: Real>(topology: &Topology, factored: &[L], x: &mut [L]) {
    let base = topology.base_dofs;
    for i in (0..topology.nv).rev() {
        let columns = &topology.columns[i];
        let last = columns.len() - 1;
        let row = &factored[topology.row[i]..][..=last];
        let value = x[i];
        let start = if base == HEAD && last >= HEAD {
            *head_mut(x) = minus(*head(x), value, *head(row));
            HEAD
        } else {
            0
        };
        for k in start..last {
            x[columns[k]] -= row[k] * value;
        }
        x[i] = value * row[last];
    }
    for i in 0..topology.nv {
        let columns = &topology.columns[i];
        let last = columns.len() - 1;
        let row = &factored[topology.row[i]..][..=last];
        let mut sum = x[i];
        let start = if base == HEAD && last >= HEAD {
            let (x, row) = (head(x), head(row));
            for k in 0..HEAD {
                sum -= row[k] * x[k];
            }
            HEAD
        } else {
            0
        };
        for k in start..last {
            sum -= row[k] * x[columns[k]];
        }
        x[i] = sum;
    }
}

/// `out = matrix * x` for a packed symmetric matrix.
#[inline(always)]
pub(crate) fn multiply_packed<L: Real>(topology: &Topology, matrix: &[L], x: &[L], out: &mut [L]) {
    let base = topology.base_dofs;
    for i in 0..topology.nv {
        let columns = &topology.columns[i];
        let last = columns.len() - 1;
        let row = &matrix[topology.row[i]..][..=last];
        let own = x[i];
        let mut sum = row[last] * own;
        let start = if base == HEAD && last >= HEAD {
            let (x, row) = (head(x), head(row));
            for k in 0..HEAD {
                sum += row[k] * x[k];
            }
            *head_mut(out) = plus(*head(out), own, *row);
            HEAD
        } else {
            0
        };
        for k in start..last {
            sum += row[k] * x[columns[k]];
            out[columns[k]] += row[k] * own;
        }
        // Rows below add to `out[i]` later; everything above is complete.
        out[i] = sum;
    }
}
