//! The numbers that the moving view draws, rounded to what a screen shows.

use qv_policy::play::WalkTrace;
use serde_json::{Value, json};

/// A number with some digits; what is not finite is a gap.
fn round(x: f32, digits: i32) -> Value {
    let scale = 10f64.powi(digits);
    let rounded = (f64::from(x) * scale).round() / scale;
    match rounded.is_finite() {
        true if digits == 0 => json!(rounded as i64),
        true => json!(rounded),
        false => Value::Null,
    }
}

fn rounded(values: impl Iterator<Item = f32>, digits: i32) -> Value {
    values.map(|x| round(x, digits)).collect::<Vec<_>>().into()
}

/// Points in space as whole millimetres, one flat list for each time.
fn places(rows: &[Vec<[f32; 3]>]) -> Value {
    rows.iter().map(|row| rounded(row.iter().flatten().map(|x| 1e3 * x), 0)).collect::<Vec<_>>().into()
}

/// All that the view draws.
pub fn data(played: &WalkTrace) -> Value {
    let three = |rows: &[[f32; 3]], digits: i32| -> Vec<Value> {
        (0..3).map(|k| rounded(rows.iter().map(|row| row[k]), digits)).collect()
    };
    let mut done = three(&played.velocity, 3);
    done[2] = rounded(played.turning.iter().map(|t| t[2]), 3);
    let ground = played.ground.as_ref().map(|patch| {
        let heights: Vec<Value> = patch.heights.iter().map(|h| h.map_or(Value::Null, |h| round(1e3 * h, 0))).collect();
        json!({"origin": rounded(patch.origin.into_iter(), 3), "spacing": round(patch.spacing, 4), "size": patch.size, "heights": heights})
    });
    let down = |foot: usize| -> Vec<u8> {
        played.foot_forces.iter().map(|forces| u8::from(forces.get(foot).is_some_and(|f| *f > 0.0))).collect()
    };
    json!({
        "rate": round(played.rate, 3), "steps": played.q.len(), "fell": played.fell,
        "parents": played.parents, "footLinks": played.foot_links,
        "commands": three(&played.commands, 3), "done": done,
        "base": played.q.iter().map(|q| rounded(q[..7].iter().copied(), 3)).collect::<Vec<_>>(),
        "links": places(&played.link_positions), "feetAt": places(&played.foot_positions),
        "down": (0..played.feet.len()).map(down).collect::<Vec<_>>(), "ground": ground,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::walk::example::made_up;

    #[test]
    fn numbers_are_rounded_and_gaps_are_null() {
        assert_eq!([round(1.23456, 2), round(f32::NAN, 2), round(-0.6, 0)], [json!(1.23), Value::Null, json!(-1)]);
        let data = data(&made_up(50));
        assert_eq!(data["links"][0].as_array().unwrap().len(), 3 * 13);
        assert_eq!(data["base"][49][0], json!(0.49));
        assert_eq!((&data["down"][0][0], &data["down"][0][20]), (&json!(1), &json!(0)));
    }
}
