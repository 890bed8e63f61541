//! Names and friction of labels, from the file that `--labels` names.

use crate::Failure;
use crate::outcome::about;
use qv_core::Material;
use std::fs;
use std::path::Path;

/// As many materials as there are labels: those given, and nameless ones.
pub fn fitting(given: Option<Vec<Material>>, labels: usize) -> Vec<Material> {
    let mut out = given.unwrap_or_default();
    for index in out.len()..labels {
        out.push(Material { name: format!("label {}", index + 1), friction: None });
    }
    out
}

/// Materials of a file with `[[label]]` tables; their indices go from 1 without a gap.
pub fn materials(path: &Path) -> Result<Vec<Material>, Failure> {
    let text = fs::read_to_string(path).map_err(|e| about(path, format!("expected labels in TOML, found {e}")))?;
    let document: toml::Table = text.parse().map_err(|e| about(path, format!("expected labels in TOML, found {e}")))?;
    let list = document.get("label").and_then(toml::Value::as_array).filter(|list| !list.is_empty());
    let list = list.ok_or_else(|| about(path, "expected tables [[label]], found none"))?;
    let mut out: Vec<Option<Material>> = vec![None; list.len()];
    for (number, label) in list.iter().enumerate() {
        let at = |what: &str, found: Option<&toml::Value>| {
            let found = found.map_or("none".into(), ToString::to_string);
            about(path, format!("label {}: expected {what}, found {found}", number + 1))
        };
        let index = label.get("index").and_then(toml::Value::as_integer).and_then(|i| usize::try_from(i - 1).ok());
        let place = index.and_then(|i| out.get_mut(i)).filter(|place| place.is_none());
        let place =
            place.ok_or_else(|| at("an index of its own from 1 to the number of labels", label.get("index")))?;
        let name = label.get("name").and_then(toml::Value::as_str).ok_or_else(|| at("a name", label.get("name")))?;
        let friction = match label.get("friction") {
            None => None,
            Some(value) => {
                let number =
                    value.as_float().or(value.as_integer().map(|i| i as f64)).filter(|f| *f >= 0.0 && f.is_finite());
                Some(number.ok_or_else(|| at("a friction of at least 0", Some(value)))?)
            }
        };
        *place = Some(Material { name: name.into(), friction });
    }
    Ok(out.into_iter().flatten().collect())
}
