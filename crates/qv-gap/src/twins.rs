//! Whether two factors of the same joints are one cause told as two.
//!
//! The law of an actuator (`law`) multiplies its gains, its strength and what its torque sensor reads. If the factor at fault is
//! one that the library lacks, two others together are as good as it: a weak motor is a weak kp and, beside that, an equally weak
//! kd; a weak kd is a strong kp on a weak motor, which leave kp as it was. Two faults of the same joints that happen to
//! be of one size, or to undo each other, are much less likely than that.

use crate::doubt::Named;
use crate::library::{Effect, Scope};

/// How much the logarithms of two factors differ that are taken for equal or for inverse, as a share of the larger one.
const ALIKE: f64 = 1.0 / 3.0;

/// Two of what is accused that are one, and how they stand to each other.
pub fn twins(library: &[Effect], accused: &[Named]) -> Option<String> {
    let factors: Vec<(&Named, f64)> = accused.iter().filter_map(|a| Some((a, logarithm(library, a)?))).collect();
    for (k, (one, first)) in factors.iter().enumerate() {
        for (other, second) in &factors[k + 1..] {
            let most = ALIKE * first.abs().max(second.abs());
            let how = if (first - second).abs() < most {
                "are off by the same share"
            } else if (first + second).abs() < most {
                "undo each other"
            } else {
                continue;
            };
            if same_members(one, other) {
                let [one, other] = [one, other].map(|n| n.effect.replace('_', " "));
                return Some(format!("{one} and {other} of the same joints {how}: they stand for one other cause"));
            }
        }
    }
    None
}

/// Logarithm of the factor that a steady effect of joints is, if it is one.
fn logarithm(library: &[Effect], named: &Named) -> Option<f64> {
    let is_factor = |e: &Effect| e.scope == Scope::Joints && e.unit == "1" && !e.absolute && e.axes.len() == 1;
    let effect = library.iter().find(|e| e.name == named.effect)?;
    let value = named.steady()?;
    (is_factor(effect) && value > -1.0 && value != 0.0).then(|| value.ln_1p())
}

fn same_members(one: &Named, other: &Named) -> bool {
    let [mut one, mut other] = [one, other].map(|n| n.group.members.clone());
    one.sort_unstable();
    other.sort_unstable();
    one == other
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::{Extent, Group};
    use crate::library::built_in;

    fn named(effect: &str, members: &[usize], value: f64) -> Named {
        let group = Group { effect: 0, members: members.to_vec(), names: Vec::new() };
        Named { effect: effect.into(), group, values: vec![value], extent: None }
    }

    #[test]
    fn factors_that_are_equal_or_inverse_are_one_cause() {
        let legs = [0, 3, 6];
        let told = |a: Named, b: Named| twins(&built_in(), &[a, b]);
        let weak = told(named("motor_gain_kp", &legs, -0.26), named("motor_gain_kd", &[6, 3, 0], -0.23));
        assert!(weak.unwrap().contains("motor gain kp and motor gain kd of the same joints are off by the same share"));
        let inverse = told(named("motor_gain_kd", &legs, 0.31), named("motor_strength", &legs, -0.183));
        assert!(inverse.unwrap().contains("undo each other"));
        // Two sizes, other joints, a friction of the same number.
        assert_eq!(told(named("motor_gain_kp", &legs, -0.26), named("motor_gain_kd", &legs, -0.1)), None);
        assert_eq!(told(named("motor_gain_kp", &legs, -0.26), named("motor_gain_kd", &[0], -0.26)), None);
        assert_eq!(told(named("motor_gain_kp", &legs, 0.2), named("joint_coulomb_friction", &legs, 0.2)), None);
    }

    #[test]
    fn what_acts_for_a_while_is_no_factor() {
        let mut while_hot = named("motor_strength", &[0], -0.2);
        while_hot.extent = Some(Extent::Time([2.0, 5.0]));
        assert_eq!(twins(&built_in(), &[while_hot, named("motor_gain_kp", &[0], -0.2)]), None);
        assert_eq!(twins(&built_in(), &[]), None);
    }
}
