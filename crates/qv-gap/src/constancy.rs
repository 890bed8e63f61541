//! Whether what is accused of joints is the same at all speeds, loads and times. A friction that fades with speed is Coulomb friction
//! of no one size: each window, asked for itself, wants another.
//!
//! Each window and joint asks for a change of the accused value, `(b - H d) / h` with the deviations `d` at their best over all
//! windows. These are regressed on speed, load and time with weights `h`; the error of the slope is that of White (1980,
//! Econometrica 48, 817), robust against windows that nothing explains.

use crate::columns::Group;
use crate::rest::mean_of;
use crate::search::fitted;
use crate::study::{EXTRA, Seen, Study};

/// What a joint asks for in a window.
struct Asked {
    /// Change of the value.
    change: f64,
    /// Weight.
    weight: f64,
    /// Speed, load, time.
    known: [f64; 3],
}

/// What the accused value depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Dependence {
    /// Speed, load or time.
    pub on: &'static str,
    /// Slope over its standard error.
    pub errors: f64,
    /// Change of the value over two standard deviations of the factor.
    pub change: f64,
}

const FACTORS: [&str; 3] = ["speed", "load", "time"];

/// How the value of an effect of joints that was accused depends on each factor, in the study of the corrected robot.
pub fn dependences(study: &Study, name: &str, group: &Group) -> Vec<Dependence> {
    let asked = asked(study, name, group);
    (0..FACTORS.len()).filter_map(|f| dependence(&asked, f)).collect()
}

fn asked(study: &Study, name: &str, group: &Group) -> Vec<Asked> {
    let columns = &study.columns;
    let Some(effect) = columns.effects.iter().position(|e| e.name == name) else { return Vec::new() };
    let Ok(marginal) = study.marginal(fitted) else { return Vec::new() };
    let deviations = marginal.deviations(&study.nominal(fitted));
    let of_group = Group { effect, ..group.clone() };
    let units: Vec<usize> = columns.units_of(&of_group, 0).filter(|&u| columns.units[u].absent.is_finite()).collect();
    let mut all = Vec::new();
    for seen in study.seen.iter().filter(|s| fitted(s) > 0.0) {
        let asks = seen.nominal().b;
        for &unit in &units {
            let Some(column) = columns.column(unit, 0) else { continue };
            let step = columns.columns[column].value - columns.units[unit].absent;
            let (joint, column) = (columns.units[unit].member, EXTRA + column);
            let weight = seen.h[(column, column)] / (step * step);
            let across = seen.h.view((column, 0), (1, deviations.len()));
            let force = asks[column] - (across * &deviations)[(0, 0)];
            if weight > 0.0 {
                all.push(Asked { change: force / step / weight, weight, known: known(study, seen, joint) });
            }
        }
    }
    all
}

fn known(study: &Study, seen: &Seen, joint: usize) -> [f64; 3] {
    let measured = &seen.window.view.measured;
    let mean = |series| mean_of(study, seen, joint, series, f64::abs);
    [mean(&measured.velocity), mean(&measured.torque), seen.window.start]
}

fn dependence(asked: &[Asked], factor: usize) -> Option<Dependence> {
    let total: f64 = asked.iter().map(|a| a.weight).sum();
    let mean = |of: &dyn Fn(&Asked) -> f64| asked.iter().map(|a| a.weight * of(a)).sum::<f64>() / total;
    let centre = mean(&|a| a.known[factor]);
    let middle = mean(&|a| a.change);
    let spread = mean(&|a| (a.known[factor] - centre).powi(2)).sqrt();
    if !(total > 0.0 && spread > 0.0) {
        return None;
    }
    let z = |a: &Asked| (a.known[factor] - centre) / spread;
    let slope = mean(&|a| z(a) * (a.change - middle));
    let left = |a: &Asked| a.change - middle - slope * z(a);
    let variance: f64 = asked.iter().map(|a| (a.weight * z(a) * left(a)).powi(2)).sum::<f64>() / (total * total);
    let (on, change) = (FACTORS[factor], 2.0 * slope);
    (variance > 0.0).then(|| Dependence { on, errors: slope / variance.sqrt(), change })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Two hundred windows that ask for 0.1 per unit of speed and for nothing else, with noise.
    fn asked(slope: f64) -> Vec<Asked> {
        let mut random = Random::new(3, 1);
        let mut one = || {
            let known = [random.uniform(), random.uniform(), random.uniform()];
            let change = slope * known[0] + 0.1 * (random.uniform() - 0.5);
            Asked { change, weight: 0.5 + random.uniform(), known }
        };
        (0..200).map(|_| one()).collect()
    }

    #[test]
    fn a_value_that_changes_with_speed_is_told_and_no_other() {
        let of = |asked: &[Asked]| -> Vec<Dependence> { (0..3).filter_map(|f| dependence(asked, f)).collect() };
        let changing = of(&asked(0.1));
        assert!(changing[0].errors > 10.0, "{changing:?}");
        // Two standard deviations of what lies evenly between 0 and 1.
        assert!((changing[0].change - 0.1 * 2.0 / 12f64.sqrt()).abs() < 0.01, "{changing:?}");
        assert!(changing[1..].iter().all(|d| d.errors.abs() < 3.0), "{changing:?}");
        assert!(of(&asked(0.0)).iter().all(|d| d.errors.abs() < 3.0));
    }

    #[test]
    fn windows_that_are_all_alike_say_nothing() {
        let alike: Vec<Asked> = (0..5).map(|_| Asked { change: 1.0, weight: 1.0, known: [2.0; 3] }).collect();
        assert!((0..3).all(|f| dependence(&alike, f).is_none()));
        assert_eq!(dependence(&[], 0), None);
    }
}
