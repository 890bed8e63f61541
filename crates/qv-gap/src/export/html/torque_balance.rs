//! Torque balance of a robot with a fixed base: what explains it, pushes, friction and rotor of each joint.

use super::words::{escape, fixed, percent, significant, size, words};
use crate::report::TorqueBalance;
use qv_held::JointRow;
use qv_page::Table;
use qv_page::parts::titled_card;

/// Rows of the set at most.
const MOST: usize = 12;
/// Standard deviations of a 95 % interval.
const INTERVAL: f64 = 1.96;

/// The tables under their heading.
pub(super) fn torque_balance(balance: &TorqueBalance) -> String {
    let mut text = String::from("<h2>Torque balance</h2><div class=\"stack\">");
    if !balance.set.is_empty() {
        text += &titled_card("Hypotheses that explain the recording as well as the best one", &set(balance));
    }
    if !balance.events.is_empty() {
        text += &titled_card("External torques", &events(balance));
    }
    if !balance.joints.is_empty() {
        text += &titled_card("Friction and rotor inertia of each joint", &joints(&balance.joints));
    }
    text + "</div>"
}

fn set(balance: &TorqueBalance) -> String {
    let heads = ["effect", "part", "size", "p (size)", "p (held-out blocks)", "p (bandwidth)", "share of the excess"];
    let mut table = Table::with_left(&heads, &[1, 2]);
    for member in balance.set.iter().take(MOST) {
        let sizes: Vec<String> = member.parameters.iter().map(size).collect();
        table.row(&[
            escape(&words(&member.effect)),
            escape(&member.scope.join(", ")),
            escape(&sizes.join("; ")),
            significant(member.tests.p_size, 2),
            significant(member.tests.p_blocks, 2),
            significant(member.tests.p_bandwidth, 2),
            percent(member.tests.share),
        ]);
    }
    table.to_html()
}

fn events(balance: &TorqueBalance) -> String {
    let mut table = Table::with_left(&["joint", "from, s", "until, s", "mean torque, N m", "p"], &[]);
    for event in &balance.events {
        table.row(&[
            escape(&event.joint),
            fixed(event.time[0], 2),
            fixed(event.time[1], 2),
            significant(event.torque, 3),
            significant(event.p, 2),
        ]);
    }
    table.to_html()
}

fn joints(rows: &[JointRow]) -> String {
    let heads = [
        "joint",
        "Coulomb, N m",
        "viscous, N m s/rad",
        "armature, kg m²",
        "usual speed, rad/s",
        "torque rms, N m",
        "residual of the model, N m",
        "residual with these, N m",
    ];
    let mut table = Table::with_left(&heads, &[]);
    let figure = |[value, deviation, stated]: [f64; 3]| {
        format!(
            "{} ± {} (model {})",
            significant(value, 3),
            significant(INTERVAL * deviation, 2),
            significant(stated, 3)
        )
    };
    for row in rows {
        let [torque, before, after] = row.torque.map(|x| significant(x, 3));
        table.row(&[
            escape(&row.joint),
            figure(row.coulomb),
            figure(row.viscous),
            figure(row.armature),
            significant(row.excitation[0], 3),
            torque,
            before,
            after,
        ]);
    }
    table.to_html()
}
