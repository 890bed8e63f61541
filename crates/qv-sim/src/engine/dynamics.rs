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
    if topology.base_dofs == HEAD {
        factor_base(matrix.first_chunk_mut().expect("rows of the base"));
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
pub(crate) fn solve<L: Real>(topology: &Topology, factored: &[L], x: &mut [L]) {
    let base = topology.base_dofs;
    for i in (base..topology.nv).rev() {
        let (row, ancestors) = below_base(topology, factored, i);
        let value = x[i];
        for (&entry, &column) in row[base..].iter().zip(ancestors) {
            x[column] -= entry * value;
        }
        if base == HEAD {
            *head_mut(x) = minus(*head(x), value, *head(row));
        }
        x[i] = value * row[row.len() - 1];
    }
    if base == HEAD {
        let rows = factored.first_chunk().expect("rows of the base");
        *head_mut(x) = solve_base(rows, *head(x));
    }
    for i in base..topology.nv {
        let (row, ancestors) = below_base(topology, factored, i);
        let mut sum = x[i];
        if base == HEAD {
            let (x, row) = (head(x), head(row));
            for k in 0..HEAD {
                sum -= row[k] * x[k];
            }
        }
        for (&entry, &column) in row[base..].iter().zip(ancestors) {
            sum -= entry * x[column];
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

/// A row that is not the base's: its entries, and the columns between base and diagonal.
#[inline(always)]
fn below_base<'a, L>(topology: &'a Topology, matrix: &'a [L], i: usize) -> (&'a [L], &'a [usize]) {
    let columns = &topology.columns[i];
    let last = columns.len() - 1;
    (&matrix[topology.row[i]..][..=last], &columns[topology.base_dofs..last])
}

/// `out = matrix * x` for a packed symmetric matrix.
#[inline(always)]
pub(crate) fn multiply_packed<L: Real>(topology: &Topology, matrix: &[L], x: &[L], out: &mut [L]) {
    let base = topology.base_dofs;
    if base == HEAD {
        let rows = matrix.first_chunk().expect("rows of the base");
        *head_mut(out) = multiply_base(rows, *head(x));
    }
    for i in base..topology.nv {
        let (row, ancestors) = below_base(topology, matrix, i);
        let own = x[i];
        let mut sum = row[row.len() - 1] * own;
        if base == HEAD {
            let (x, row) = (head(x), head(row));
            for k in 0..HEAD {
                sum += row[k] * x[k];
            }
            *head_mut(out) = plus(*head(out), own, *row);
        }
        for (&entry, &column) in row[base..].iter().zip(ancestors) {
            sum += entry * x[column];
            out[column] += entry * own;
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
