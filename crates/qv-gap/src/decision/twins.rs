//! Whether two factors of the same joints are one cause reported as two.
//!
//! The law of an actuator (`law`) multiplies its gains, its strength and what its torque sensor reads. If the factor at fault is
//! one that the library lacks, two others together are as good as it: a weak motor is a weak kp and, beside that, an equally weak
//! kd; a weak kd is a strong kp on a weak motor, which leave kp as it was. Two faults of the same joints that happen to
//! be of one size, or to undo each other, are much less likely than that.

use super::doubt::Doubt;
use super::evidence::Candidate;

/// Two of what is accused (each with its value) that are one, and how they stand to each other. Logarithms of factors that differ by less than
/// the share `alike` of the larger one are taken for equal or for inverse.
pub fn twins(alike: f64, is_factor: impl Fn(&str) -> bool, accused: &[(&Candidate, f64)]) -> Option<Doubt> {
    let logarithm = |(c, value): &(&Candidate, f64)| {
        let is_one = c.extent.is_none() && is_factor(&c.effect) && *value > -1.0 && *value != 0.0;
        is_one.then(|| value.ln_1p())
    };
    let factors: Vec<(&Candidate, f64)> = accused.iter().filter_map(|a| Some((a.0, logarithm(a)?))).collect();
    for (k, (one, first)) in factors.iter().enumerate() {
        for (other, second) in &factors[k + 1..] {
            let most = alike * first.abs().max(second.abs());
            let are_inverse = match ((first - second).abs() < most, (first + second).abs() < most) {
                (true, _) => false,
                (_, true) => true,
                _ => continue,
            };
            if same_members(one, other) {
                return Some(Doubt::Twins { effects: [one, other].map(|c| c.effect.clone()), are_inverse });
            }
        }
    }
    None
}

fn same_members(one: &Candidate, other: &Candidate) -> bool {
    let [mut one, mut other] = [one, other].map(|c| c.members.clone());
    one.sort_unstable();
    other.sort_unstable();
    one == other
}
