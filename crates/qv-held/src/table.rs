//! Friction and rotor of each joint, by its balance in the recording itself.

use crate::balance::{Balance, Column, Kind, Robot, Term};
use crate::evidence::JointRow;
use crate::gram::{Gram, Layout, assemble};
use crate::hypothesis::{Direction, Nuisance};
use crate::signal::quantile;
use crate::study::{autocorrelation_time, fit, free_fit, reduced, residual};
use qv_fit::linear::{Cholesky, squared};

/// Terms that are free; the last is no figure of the table.
const FREE: [Term; 4] = [Term::Coulomb, Term::Viscous, Term::Armature, Term::Offset];

/// A row for each joint whose balance was recorded. Masses are free within their tolerances.
pub(crate) fn joint_rows(robot: &Robot, balance: &Balance, nuisance: &Nuisance) -> Vec<JointRow> {
    let of_balance = balance.equations.iter().enumerate().filter(|(_, e)| e.kind == Kind::Balance);
    of_balance.filter_map(|(e, _)| row(robot, balance, e, nuisance)).collect()
}

fn row(robot: &Robot, balance: &Balance, e: usize, nuisance: &Nuisance) -> Option<JointRow> {
    let (layout, equation) = (Layout::of(robot), &balance.equations[e]);
    let (joint, rows) = (equation.joint, balance.time.len());
    let gram = Gram::of(&equation.values, 0..rows);
    // Gains may not be free, with which nothing at all would balance.
    let kept: Vec<usize> = (0..equation.columns.len()).filter(|&c| !is_of_drive(equation.columns[c])).collect();
    let columns: Vec<Vec<f64>> =
        kept.iter().chain([&equation.columns.len()]).map(|&c| equation.values[c].clone()).collect();
    let free = residual(&columns, &free_fit(&Gram::of(&columns, 0..rows)));
    let (noise, kappa) = ((squared(&free) / rows as f64).max(1e-18), autocorrelation_time(&free));
    let sum = assemble(layout, std::slice::from_ref(equation), &[1.0 / noise], std::slice::from_ref(&gram));
    let place = |term: Term| layout.place(Column::Joint(joint, term));
    let is_free = |d: &Direction| FREE.iter().any(|&term| d.iter().any(|x| x.0 == place(term)));
    // What the joint's equation does not see has no say.
    let is_seen = |d: &Direction| d.iter().any(|x| sum[(x.0, x.0)] > 0.0);
    let kept: Vec<usize> = (0..nuisance.directions.len())
        .filter(|&k| is_seen(&nuisance.directions[k]) && !is_free(&nuisance.directions[k]))
        .collect();
    let uncertain = Nuisance {
        directions: kept.iter().map(|&k| nuisance.directions[k].clone()).collect(),
        tolerances: kept.iter().map(|&k| nuisance.tolerances[k]).collect(),
    };
    let reduced = reduced(&sum, &vec![0.0; layout.width()], Some((&uncertain, kappa)));
    let directions: Vec<Direction> = FREE.iter().map(|&term| vec![(place(term), 1.0)]).collect();
    let own = fit(&reduced, &directions)?;
    let covariance = Cholesky::new(&own.information)?.inverse();
    let figure = |k: usize, stated: f64| [stated + own.size[k], (kappa * covariance[(k, k)]).sqrt(), stated];
    let column = |term: Term| -> Vec<f64> {
        let at = equation.columns.iter().position(|c| *c == Column::Joint(joint, term));
        at.map_or(Vec::new(), |at| equation.values[at].clone())
    };
    let rms = |values: &[f64]| (squared(values) / values.len().max(1) as f64).sqrt();
    let left = equation.values.last()?;
    let torque: Vec<f64> = left.iter().zip(&equation.modelled).map(|(a, b)| a + b).collect();
    Some(JointRow {
        joint: robot.model.joint_names()[joint].clone(),
        coulomb: figure(0, robot.coulomb[joint]),
        viscous: figure(1, robot.viscous[joint]),
        armature: figure(2, robot.armature[joint]),
        excitation: [
            quantile(column(Term::Viscous).iter().map(|v| v.abs()).collect(), 0.95),
            rms(&column(Term::Armature)),
        ],
        torque: [rms(&torque), rms(left), (own.loss[1].max(0.0) * noise / rows as f64).sqrt()],
    })
}

fn is_of_drive(column: Column) -> bool {
    use Term::{KdScale, KpScale, Strength, TorqueScale};
    matches!(column, Column::Joint(_, KpScale | KdScale | Strength | TorqueScale))
}
