//! Numbers, units and names as people read them.

use crate::report::{ParameterEstimate, UNKNOWN};
pub use qv_page::{escape, fixed, percent, significant};

/// Factor and unit in which to show a quantity of this name, unit and size.
pub(super) fn shown_in<'a>(name: &str, unit: &'a str, size: f64) -> (f64, &'a str) {
    // Instants and places are read beside the recording's own axes.
    let on_an_axis =
        ["start", "end", "duration", "onset", "x_min", "x_max", "y_min", "y_max"].iter().any(|n| name.ends_with(n));
    let ratio = ["scale", "strength"].iter().any(|n| name.ends_with(n));
    match unit {
        "s" if !on_an_axis && size < 1.0 => (1e3, "ms"),
        "rad" if size < 0.3 => (1e3, "mrad"),
        "rad/s" if size < 0.3 => (1e3, "mrad/s"),
        "m" if !on_an_axis && size < 0.3 => (1e3, "mm"),
        "1" if ratio => (100.0, "%"),
        "1" => (1.0, ""),
        other => (1.0, other),
    }
}

/// Value, unit and interval of a parameter that was found, such as `10.1 ms (9.6 to 10.6)`.
pub(super) fn size(p: &ParameterEstimate) -> String {
    if !p.value.is_finite() {
        return "–".into();
    }
    let largest = p.ci95.iter().copied().filter(|x| x.is_finite()).fold(p.value.abs(), |m, x| m.max(x.abs()));
    let (factor, unit) = shown_in(&p.name, &p.unit, largest);
    let half = 0.5 * factor * (p.ci95[1] - p.ci95[0]);
    let decimals = if half.is_finite() && half > 0.0 { decimals_for(half) } else { None };
    let write = |x: f64| decimals.map_or_else(|| significant(factor * x, 3), |d| fixed(factor * x, d));
    // A ratio is a deviation, whose sign is said.
    let plus = if unit == "%" && p.value > 0.0 { "+" } else { "" };
    let space = if unit.is_empty() { "" } else { " " };
    let value = format!("{plus}{}{space}{unit}", write(p.value));
    if p.ci95.iter().all(|x| x.is_finite()) {
        format!("{value} ({} to {})", write(p.ci95[0]), write(p.ci95[1]))
    } else {
        value
    }
}

/// Decimals at which an uncertainty of this size has one digit, or two when the first is small.
fn decimals_for(half: f64) -> Option<usize> {
    let magnitude = half.log10().floor();
    let extra = if half / 10f64.powf(magnitude) < 2.5 { 1.0 } else { 0.0 };
    let decimals = extra - magnitude;
    (decimals < 9.0).then_some(decimals.max(0.0) as usize)
}

/// A single value with its unit.
pub(super) fn amount(name: &str, value: f64, unit: &str) -> String {
    // A scale that is stated as it is reads better as a factor.
    let (factor, unit) = if unit == "1" { (1.0, "") } else { shown_in(name, unit, value.abs()) };
    if value.is_finite() && value.abs() >= 1e9 {
        return "no limit".into();
    }
    let number = significant(factor * value, 4);
    // Values that were set by hand are round.
    let number = if number.contains('.') && !number.contains('e') {
        number.trim_end_matches('0').trim_end_matches('.')
    } else {
        &number
    };
    format!("{number} {unit}").trim_end().to_owned()
}

/// An effect's or parameter's name as words.
pub fn words(name: &str) -> String {
    if name == UNKNOWN {
        return "None of the library".into();
    }
    let spoken: Vec<&str> = name
        .split(['_', '.'])
        .map(|word| match word {
            "com" => "centre of mass",
            "imu" => "IMU",
            "gyro" => "gyroscope",
            other => other,
        })
        .collect();
    let text = spoken.join(" ");
    let mut letters = text.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(name: &str, value: f64, ci95: [f64; 2], unit: &str) -> String {
        size(&ParameterEstimate { name: name.into(), value, ci95, unit: unit.into() })
    }

    #[test]
    fn sizes_read_as_people_write_them() {
        assert_eq!(estimate("lag", 0.010_123, [0.0096, 0.0106], "s"), "10.1 ms (9.6 to 10.6)");
        assert_eq!(estimate("strength", -0.4071, [-0.425, -0.389], "1"), "−40.7 % (−42.5 to −38.9)");
        assert_eq!(estimate("kp_scale", 0.1, [0.06, 0.14], "1"), "+10 % (6 to 14)");
        assert_eq!(estimate("friction", 0.3214, [0.29, 0.35], "1"), "0.32 (0.29 to 0.35)");
        assert_eq!(estimate("payload_mass", 2.184, [2.02, 2.35], "kg"), "2.18 kg (2.02 to 2.35)");
        assert_eq!(estimate("start", 3.2041, [3.15, 3.26], "s"), "3.20 s (3.15 to 3.26)");
        assert_eq!(estimate("armature", 0.01234, [0.0113, 0.0134], "kg m²"), "0.0123 kg m² (0.0113 to 0.0134)");
        assert_eq!(estimate("com_x", 0.0301, [0.021, 0.039], "m"), "30 mm (21 to 39)");
        assert_eq!(estimate("lag", 0.0101, [f64::NAN, 0.02], "s"), "10.1 ms");
        assert_eq!(estimate("lag", f64::NAN, [f64::NAN; 2], "s"), "–");
        assert_eq!(estimate("lag", 0.01, [0.01, 0.01], "s"), "10.0 ms (10.0 to 10.0)");
    }

    #[test]
    fn amounts_have_units_that_fit() {
        assert_eq!(amount("lag", 0.0101, "s"), "10.1 ms");
        assert_eq!(amount("kp_scale", 0.75, "1"), "0.75");
        assert_eq!(amount("position_torque_limit", 1e9, "N m"), "no limit");
    }

    #[test]
    fn names_become_words() {
        assert_eq!(words("com_offset"), "Centre of mass offset");
        assert_eq!(words("imu_tilt"), "IMU tilt");
        assert_eq!(words(""), "");
    }
}
