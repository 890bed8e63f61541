//! What the policy is and what it was trained under, as a table.

use qv_page::parts::card;
use qv_page::{Table, escape};
use qv_policy::policy::PolicyFile;
use std::fmt::Display;

/// The section.
pub fn table(policy: &PolicyFile) -> String {
    let (commands, under) = (&policy.commands, &policy.trained_under);
    let range = |[low, high]: [f32; 2], unit: &str| format!("{low} to {high} {unit}");
    let mut rows = vec![
        ("robot", format!("{} (model {})", policy.robot, policy.model_hash)),
        ("rate", format!("{} Hz; physics at {:.0} Hz", policy.rate, 1.0 / policy.timestep)),
        ("position gains", same(&policy.kp, "N m/rad")),
        ("velocity gains", same(&policy.kd, "N m s/rad")),
        ("target for an action of one", same(&policy.action_scale, "rad")),
        (
            "stand",
            policy
                .joints
                .iter()
                .zip(&policy.stand)
                .map(|(name, angle)| format!("{name} {angle}"))
                .collect::<Vec<_>>()
                .join(", "),
        ),
        ("order of joints", policy.joints.join(", ")),
        ("observation", policy.observation.join("; ")),
        ("ground", policy.ground.clone()),
        ("commands forwards", range(commands.vx, "m/s")),
        ("commands to the left", range(commands.vy, "m/s")),
        ("commands to turn", range(commands.wz, "rad/s")),
        ("a new command each", format!("{} s; {:.0} % say: stand", commands.every, 100.0 * commands.stand)),
        (
            "pushes",
            match under.push {
                0.0 => "none".into(),
                push => format!("up to {push} m/s, each {} s on average", under.push_every),
            },
        ),
        ("start", format!("joints ± {} rad, speed ± {} m/s", under.start_angle, under.start_speed)),
    ];
    let drawn =
        under.parameters.iter().map(|p| (p, "")).chain(under.together.iter().map(|p| (p, ", one value for all")));
    let drawn: Vec<String> = drawn.map(|((name, [low, high]), how)| format!("{name}: {low} to {high}{how}")).collect();
    rows.push(("differs from robot to robot", if drawn.is_empty() { "nothing".into() } else { drawn.join("; ") }));
    let mut table = Table::default();
    rows.iter().for_each(|(what, is)| _ = table.row(&[(*what).to_string(), escape(is)]));
    format!("<h2>The policy</h2>{}", card(&table.to_html_as("facts")))
}

/// One number where all are the same, else all of them.
fn same<T: PartialEq + Display>(values: &[T], unit: &str) -> String {
    match values.split_first() {
        Some((first, rest)) if rest.iter().all(|x| x == first) => format!("{first} {unit}"),
        _ => values.iter().map(T::to_string).collect::<Vec<_>>().join(", ") + " " + unit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::walk::example::file;

    #[test]
    fn gains_are_told_once_where_they_are_the_same() {
        let mut policy = file();
        assert!(table(&policy).contains("<td>30 N m/rad"));
        policy.kp[1] = 31.0;
        assert!(table(&policy).contains("<td>30, 31, 30,") && table(&policy).states("0.5 m/s"));
    }
}
