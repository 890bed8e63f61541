//! Torques of each joint over time, as they were recorded and as they are predicted: for plots.

use crate::balance::{Balance, Column, Equation, Kind, Robot, Term};
use crate::events::left;
use crate::gram::Layout;
use serde::{Deserialize, Serialize};

/// Torques of a joint at the rows of its balance, all through one filter.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TorqueTrace {
    /// Joint.
    pub joint: String,
    /// Times \[s\], run after run.
    pub time: Vec<f64>,
    /// Run that each row is of, from 0.
    pub run: Vec<usize>,
    /// Speed of the joint \[rad/s\].
    pub speed: Vec<f64>,
    /// Recorded torque \[N m\].
    pub measured: Vec<f64>,
    /// Torque of the robot as its references show it \[N m\].
    pub predicted: Vec<f64>,
    /// The same with what is named as the cause \[N m\]; empty without.
    pub corrected: Vec<f64>,
    /// Recorded torque less that of links and rotor of the model \[N m\].
    pub friction: Vec<f64>,
}

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
