//! A study of a robot that differs a little from that of another study: only what that changes is simulated anew.

use crate::GapError;
use crate::inference::linearised::{EXTRA, LinearisedProblem, LinearisedWindow};
use crate::jacobian::{changes, with_law};
use crate::problem::columns::{Column, Columns};
use qv_fit::Matrix;
use qv_fit::linear::gram;
use qv_rollout::law::Reading;
use qv_rollout::{Overrides, Rollout, Window};
use qv_rollout::{TracedResiduals, compare_and_trace};

impl<'a> LinearisedProblem<'a> {
    /// The study of `rollout`, whose robot is this one's but for the sizes of a few effects. Residuals and the sensitivities of these effects
    /// are simulated anew; the null, the other sensitivities, the recorder's alignment and how deep feet sink in are kept, which such a step
    /// hardly changes. `None` where that cannot be: a window can no longer be simulated, or the columns are others.
    ///
    /// # Errors
    /// When the simulator refuses.
    pub fn moved(mut self, mut rollout: Rollout<'a>, columns: Columns) -> Result<Option<Self>, GapError> {
        let unit = |all: &Columns, c: &Column| {
            let unit = &all.units[c.unit];
            (unit.effect, unit.axis, unit.member, unit.moves.clone(), c.level)
        };
        let alike = |a: &Column, b: &Column| unit(&self.columns, a) == unit(&columns, b);
        let same = self.columns.columns.len() == columns.columns.len()
            && self.columns.columns.iter().zip(&columns.columns).all(|(a, b)| alike(a, b));
        if !same {
            return Ok(None);
        }
        rollout.cut = self.rollout.cut;
        rollout.depth = self.rollout.depth;
        let other = |id: usize| rollout.nominal[id] != self.rollout.nominal[id];
        let is_moved = |c: &Column| columns.units[c.unit].moves.iter().any(|m| other(m.0));
        let moved: Vec<usize> = (0..columns.columns.len()).filter(|&k| is_moved(&columns.columns[k])).collect();
        (self.rollout, self.columns) = (rollout, columns);
        self.tolerance = self.tolerances();
        let whole = self.see_again(&moved)?;
        Ok(whole.then_some(self))
    }

    /// Simulates the nominal robot and some of the columns anew. Returns whether every window can be simulated.
    fn see_again(&mut self, moved: &[usize]) -> Result<bool, GapError> {
        let windows: Vec<&Window> = self.seen.iter().map(|s| &s.window).collect();
        let readings: Vec<Reading> = windows.iter().map(|w| self.parts[w.run].reading()).collect();
        let TracedResiduals { residuals: base, traces } =
            compare_and_trace(&self.rollout, &self.rollout.numerics, &windows, &[Overrides::new()])?;
        let raw = with_law(&self.rollout, &readings, &windows, &[Overrides::new()], base.values).remove(0);
        let some: Vec<&Column> = moved.iter().map(|&k| &self.columns.columns[k]).collect();
        let mut steps = base.steps;
        let found = changes(&self.rollout, &self.columns, &some, (&windows, &readings, &raw), &mut steps)?;
        self.count(steps);
        if raw.iter().any(|r| r.is_empty()) || found.iter().flatten().any(Option::is_none) {
            return Ok(false);
        }
        let columns_of = |(seen, found): (&LinearisedWindow, &Vec<Option<_>>)| {
            self.whitener(seen).differences(seen.index, &found.iter().flatten().collect::<Vec<_>>())
        };
        let columns: Vec<Matrix> = self.seen.iter().zip(&found).map(columns_of).collect();
        for (((seen, raw), trace), columns) in self.seen.iter_mut().zip(raw).zip(traces).zip(columns) {
            seen.trace = trace;
            for (from, &k) in moved.iter().enumerate() {
                seen.j.col_as_slice_mut(EXTRA + k).copy_from_slice(columns.col_as_slice(from));
            }
            seen.h = gram(&seen.j);
            seen.residual = self.parts[seen.window.run].whitener.residual(seen.index, &raw);
            seen.raw = raw;
            if self.is_relative {
                seen.weigh();
            }
        }
        for (normals, residuals) in self.replicates.iter_mut().zip(&self.ghost_residuals) {
            let normal = |(r, s): (&Option<Vec<f64>>, &LinearisedWindow)| r.as_ref().map(|r| s.normal_of(r));
            *normals = residuals.iter().zip(&self.seen).map(normal).collect();
        }
        Ok(true)
    }
}
