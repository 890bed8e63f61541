//! What a label says of friction before the robot has walked: a table, or the answers of a language model.

use crate::ContactError;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Frictions that are looked at; a prior beyond them is put at the nearer end.
pub const RANGE: [f64; 2] = [0.03, 1.5];
/// Least and greatest standard deviation, as a share of the mean.
const SPREAD: [f64; 2] = [0.1, 1.0];
/// Mean and standard deviation for a label that nobody knows.
const UNKNOWN: [f64; 2] = [0.6, 0.35];
/// How the source of a prior that was changed ends.
const PUT: &str = "put within range";
const TABLE: &str = include_str!("priors.toml");

/// A row of the table.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Name in lower case, words joined by `_`.
    pub name: String,
    /// Other names of the same.
    #[serde(default)]
    pub aliases: Vec<String>,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
    /// Where it is from.
    pub source: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    material: Vec<Entry>,
}

/// What is believed of one label: friction is lognormal with this mean and standard deviation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prior {
    /// The label, as the mesh has it.
    pub label: String,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
    /// Where it is from.
    pub source: String,
}

impl Prior {
    /// A prior with mean and spread put within what friction can be; `source` shows if it was.
    ///
    /// # Errors
    /// When a number is not finite or not above 0.
    pub fn new(label: &str, mean: f64, sd: f64, source: &str, file: &str) -> Result<Self, ContactError> {
        for (what, x) in [("mean", mean), ("sd", sd)] {
            if !(x.is_finite() && x > 0.0) {
                return Err(ContactError::prior(file, format!("{what} of `{label}` above 0"), x.to_string()));
            }
        }
        let held = mean.clamp(RANGE[0], RANGE[1]);
        let spread = sd.clamp(SPREAD[0] * held, SPREAD[1] * held);
        let source =
            if held == mean && spread == sd { source.to_string() } else { format!("{source}; {mean} with {sd} {PUT}") };
        Ok(Self { label: label.into(), mean: held, sd: spread, source })
    }

    /// As wide as a prior may be, with the same mean.
    pub fn wide(&self) -> Self {
        Self { sd: SPREAD[1] * self.mean, ..self.clone() }
    }

    /// Whether the numbers that were given could not be.
    pub(crate) fn is_put_within_range(&self) -> bool {
        self.source.ends_with(PUT)
    }

    /// Mean and standard deviation of the logarithm.
    pub fn log_moments(&self) -> [f64; 2] {
        let variance = (1.0 + (self.sd / self.mean).powi(2)).ln();
        [self.mean.ln() - 0.5 * variance, variance.sqrt()]
    }
}

/// The table that comes with the crate.
pub fn built_in() -> Vec<Entry> {
    parse(TABLE, "priors.toml").expect("the table is tested")
}

/// A table of the same form: `[[material]]` with `name`, `aliases`, `mean`, `sd`, `source`.
///
/// # Errors
/// When the text is no such table, or a number is not above 0.
pub fn parse(text: &str, file: &str) -> Result<Vec<Entry>, ContactError> {
    let table: Table =
        toml::from_str(text).map_err(|e| ContactError::prior(file, "a table of materials", e.to_string()))?;
    for entry in &table.material {
        Prior::new(&entry.name, entry.mean, entry.sd, "", file)?;
    }
    Ok(table.material)
}

/// The prior of each label: by its whole name, else by the longest name or alias that its words contain, else wide.
pub fn from_table(labels: &[String], table: &[Entry]) -> Result<Vec<Prior>, ContactError> {
    labels.iter().map(|label| of_label(label, table)).collect()
}

fn of_label(label: &str, table: &[Entry]) -> Result<Prior, ContactError> {
    let wanted = normal(label);
    let names = |e: &Entry| std::iter::once(e.name.clone()).chain(e.aliases.clone()).map(|n| normal(&n));
    let whole = table.iter().find(|e| names(e).any(|n| n == wanted));
    let padded = format!("_{wanted}_");
    let part = || {
        let longest = |e: &Entry| names(e).filter(|n| padded.contains(&format!("_{n}_"))).map(|n| n.len()).max();
        let fits = table.iter().filter_map(|e| Some((longest(e)?, e)));
        // The first of the longest ones.
        fits.fold(None, |best: Option<(usize, &Entry)>, x| if best.is_none_or(|b| x.0 > b.0) { Some(x) } else { best })
    };
    match whole.or_else(|| part().map(|(_, e)| e)) {
        Some(e) => Prior::new(label, e.mean, e.sd, &format!("{}: {}", e.name, e.source), "table of materials"),
        None => Prior::new(label, UNKNOWN[0], UNKNOWN[1], "unknown label: wide", "table of materials"),
    }
}

/// Lower case, all but letters and digits `_`.
fn normal(name: &str) -> String {
    let mapped: String = name.chars().map(|c| if c.is_alphanumeric() { c.to_ascii_lowercase() } else { '_' }).collect();
    mapped.split('_').filter(|word| !word.is_empty()).collect::<Vec<_>>().join("_")
}

/// What a language model is asked about labels.
pub fn question(labels: &[String]) -> String {
    let names = labels.iter().map(|l| format!("\"{l}\"")).collect::<Vec<_>>().join(", ");
    format!(
        "A legged robot with rubber feet walks on these ground materials: {names}. For each give the Coulomb friction \
         coefficient of a rubber foot on it and its standard deviation, as your knowledge of the material reports. Answer \
         with JSON alone: {{\"LABEL\": {{\"mean\": NUMBER, \"sd\": NUMBER}}, ...}} with every label once."
    )
}

/// Body of a request to an OpenAI-compatible endpoint (`/chat/completions`).
pub fn request(model: &str, labels: &[String]) -> Value {
    json!({"model": model, "temperature": 0, "messages": [{"role": "user", "content": question(labels)}]})
}

/// The answer in what such an endpoint returns.
///
/// # Errors
/// When there is none.
pub fn answer_of(response: &str) -> Result<String, ContactError> {
    let wrong = |found: String| ContactError::prior("answer", "choices[0].message.content in a JSON response", found);
    let value: Value = serde_json::from_str(response).map_err(|e| wrong(e.to_string()))?;
    let content = value.pointer("/choices/0/message/content").and_then(Value::as_str);
    Ok(content.ok_or_else(|| wrong(shortened(response)))?.to_string())
}

/// Priors in a language model's answer, for those labels that it names: `{"LABEL": {"mean": x, "sd": y}}`, with any text
/// around it. A `source` beside them is kept. What the answer does not name is taken from `fallback`.
///
/// # Errors
/// When there is no JSON object in it, a label of it is not in the mesh, or a number is missing or means nothing.
pub fn from_answer(text: &str, file: &str, fallback: Vec<Prior>) -> Result<Vec<Prior>, ContactError> {
    let expected = "a JSON object {\"LABEL\": {\"mean\": .., \"sd\": ..}}";
    let mut priors = fallback;
    let value = object_in(text, &priors).map_err(|found| ContactError::prior(file, expected, found))?;
    for (label, said) in &value {
        let known = priors.iter().map(|p| p.label.clone()).collect::<Vec<_>>().join(", ");
        let Some(prior) = priors.iter_mut().find(|p| p.label == *label) else {
            return Err(ContactError::prior(file, format!("labels of the mesh ({known})"), format!("`{label}`")));
        };
        let number = |key: &str| {
            let found = said.get(key).map_or("nothing".into(), ToString::to_string);
            let wrong = || ContactError::prior(file, format!("a number `{key}` of `{label}`"), found.clone());
            said.get(key).and_then(Value::as_f64).ok_or_else(wrong)
        };
        let source = said.get("source").and_then(Value::as_str).unwrap_or("language model");
        *prior = Prior::new(label, number("mean")?, number("sd")?, source, file)?;
    }
    Ok(priors)
}

/// The JSON object in a text that names most of the labels, of equal ones the last: models repeat the question before, and think aloud. Its
/// values are objects. Else why the first brace begins none.
fn object_in(text: &str, priors: &[Prior]) -> Result<serde_json::Map<String, Value>, String> {
    let mut first_error = None;
    let mut best: Option<(usize, serde_json::Map<String, Value>)> = None;
    for (at, _) in text.match_indices('{') {
        let mut values = serde_json::Deserializer::from_str(&text[at..]).into_iter::<serde_json::Map<String, Value>>();
        match values.next() {
            Some(Ok(object)) if !object.is_empty() && object.values().all(Value::is_object) => {
                let named = object.keys().filter(|label| priors.iter().any(|p| p.label == **label)).count();
                if best.as_ref().is_none_or(|(most, _)| named >= *most) {
                    best = Some((named, object));
                }
            }
            Some(Err(error)) => _ = first_error.get_or_insert(error.to_string()),
            _ => {}
        }
    }
    best.map(|(_, object)| object).ok_or_else(|| first_error.unwrap_or_else(|| shortened(text)))
}

fn shortened(text: &str) -> String {
    let short: String = text.chars().take(120).collect();
    if short.len() < text.len() { format!("`{short}...`") } else { format!("`{short}`") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    fn labels(names: &[&str]) -> Vec<String> {
        names.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn the_table_is_whole() {
        let table = built_in();
        assert!(table.len() >= 20, "{}", table.len());
        let mut names: Vec<String> =
            table.iter().flat_map(|e| std::iter::once(&e.name).chain(&e.aliases)).cloned().collect();
        let all = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all, "a name stands for one material");
        for entry in &table {
            assert!((0.05..1.2).contains(&entry.mean) && entry.sd < 0.5 * entry.mean, "{}", entry.name);
            let source = &entry.source;
            assert!(["noon", "toolbox", "assumed"].iter().any(|s| source.starts_with(s)), "{source}");
        }
    }

    #[test]
    fn labels_are_found_by_name_alias_and_words() {
        let found =
            from_table(&labels(&["Ice", "wet lawn", "old wet-tile floor", "Sidewalk 2", "flubber"]), &built_in())
                .unwrap();
        let of = |i: usize| found[i].source.split(':').next().unwrap().to_string();
        assert_eq!([of(0), of(1), of(2), of(3)], ["ice", "wet_grass", "wet_tile", "concrete"]);
        assert!(found[4].source.contains("unknown") && found[4].sd > 0.3);
    }

    #[test]
    fn moments_of_the_logarithm() {
        let prior = Prior::new("x", 0.3, 0.1, "", "f").unwrap();
        let [m, s] = prior.log_moments();
        assert!(((m + 0.5 * s * s).exp() - 0.3).abs() < 1e-12);
        let variance = ((s * s).exp() - 1.0) * (2.0 * m + s * s).exp();
        assert!((variance.sqrt() - 0.1).abs() < 1e-12);
    }

    #[test]
    fn an_answer_overrides_the_table_and_is_clamped() {
        let fallback = from_table(&labels(&["ice", "grass"]), &built_in()).unwrap();
        let text = "Sure:\n```json\n{\"ice\": {\"mean\": 0.001, \"sd\": 5}}\n```";
        let priors = from_answer(text, "answer", fallback.clone()).unwrap();
        assert_eq!((priors[0].mean, priors[0].sd), (0.03, 0.03));
        assert!(priors[0].source.states("within"), "{}", priors[0].source);
        assert_eq!(priors[1], fallback[1]);
        let chatty = "By {my} knowledge {\"of\": 1}:\n{\"ice\": {\"mean\": 0.1, \"sd\": 0.05}}\nHope {this} helps.";
        assert_eq!(from_answer(chatty, "answer", fallback.clone()).unwrap()[0].mean, 0.1);
        for before in
            ["I fill in {} as asked:", "Such as {\"ice\": {\"mean\": 0.9, \"sd\": 0.1}}. My answer:", "{\"a\": {}}"]
        {
            let text = format!("{before} {{\"ice\": {{\"mean\": 0.2, \"sd\": 0.1}}}}");
            assert_eq!(from_answer(&text, "answer", fallback.clone()).unwrap()[0].mean, 0.2, "{before}");
        }
    }

    #[test]
    fn bad_answers_are_named() {
        let fallback = from_table(&labels(&["ice"]), &built_in()).unwrap();
        for (text, word) in [
            ("I cannot help with that.", "cannot help"),
            ("{\"ice\": {\"mean\": 0.1}}", "`sd`"),
            ("{\"ice\": {\"mean\": \"low\", \"sd\": 0.1}}", "low"),
            ("{\"ice\": {\"mean\": -1, \"sd\": 0.1}}", "-1"),
            ("{\"lava\": {\"mean\": 1, \"sd\": 0.1}}", "`lava`"),
            ("{\"ice\": 3", "cannot be there"),
        ] {
            let error = from_answer(text, "a.json", fallback.clone()).unwrap_err().to_string();
            let is_named = error.contains("a.json") && (error.contains(word) || word == "cannot be there");
            assert!(is_named, "{text}: {error}");
        }
        assert!(answer_of("{\"choices\": []}").is_err());
        assert_eq!(answer_of("{\"choices\":[{\"message\":{\"content\":\"hi\"}}]}").unwrap(), "hi");
        assert!(parse("[[material]]\nname = \"x\"\nmean = -1\nsd = 1\nsource = \"\"", "mine.toml").is_err());
    }

    #[test]
    fn a_model_is_asked_about_every_label() {
        let body = request("some-model", &labels(&["ice", "wet lawn"]));
        let content = body["messages"][0]["content"].as_str().unwrap();
        assert!(content.states("\"ice\" \"wet lawn\"") && body["model"] == "some-model");
    }
}
