//! Torques of each joint over time, as they were recorded and as they are predicted: for plots.

use crate::balance::{Balance, Column, Equation, Kind, Robot, Term};
use crate::events::left;
use crate::evidence::TorqueTrace;
use crate::gram::Layout;

/// Traces of all balances without a cause; `none` has what each equation leaves.
pub(crate) fn traces(robot: &Robot, balance: &Balance, none: &[Vec<f64>]) -> Vec<TorqueTrace> {
    let of = |(e, equation): (usize, &Equation)| {
        let j = equation.joint;
        let column = |term: Term| {
            let at = equation.columns.iter().position(|c| *c == Column::Joint(j, term));
            at.map_or(vec![0.0; balance.time.len()], |at| equation.values[at].clone())
        };
        let stated = &equation.values[equation.columns.len()];
        let measured: Vec<f64> = stated.iter().zip(&equation.modelled).map(|(a, b)| a + b).collect();
        let mut friction = stated.clone();
        qv_fit::linear::add_scaled(&mut friction, robot.coulomb[j], &column(Term::Coulomb));
        qv_fit::linear::add_scaled(&mut friction, robot.viscous[j], &column(Term::Viscous));
        TorqueTrace {
            joint: robot.model.joint_names()[j].clone(),
            time: balance.time.clone(),
            run: balance.run.clone(),
            speed: column(Term::Viscous),
            predicted: qv_fit::linear::minus(&measured, &none[e]),
            corrected: Vec::new(),
            measured,
            friction,
        }
    };
    balance.equations.iter().enumerate().filter(|(_, e)| e.kind == Kind::Balance).map(of).collect()
}

/// What balances leave with values of all columns, in the order of the traces.
pub(crate) fn torques_left(balance: &Balance, layout: Layout, values: &[f64]) -> Vec<Vec<f64>> {
    balance.equations.iter().filter(|e| e.kind == Kind::Balance).map(|e| left(e, layout, values)).collect()
}
