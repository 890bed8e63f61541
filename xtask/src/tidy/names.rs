//! Rules about names: types are nouns, and identifiers are words of the field.

use super::rust_text::{Strings, code};
use super::source::Source;

/// Participles and verbs that do not end like one.
const IRREGULAR: [&str; 26] = [
    "Told", "Kept", "Seen", "Sees", "Says", "Said", "Found", "Made", "Known", "Lost", "Left", "Held", "Taught",
    "Learnt", "Sent", "Built", "Met", "Meant", "Brought", "Bound", "Cut", "Put", "Read", "Ran", "Gone", "Done",
];
/// Nouns that end like participles, and a name of RustDDS.
const NOUNS: [&str; 14] = [
    "Seed", "Speed", "Feed", "Bed", "Token", "Screen", "Golden", "Garden", "Siren", "Pen", "Need", "Ten", "Open",
    "Decoded",
];
/// Words of our own for what the field calls otherwise, and its word.
const OWN_WORDS: [(&str, &str); 3] = [("told", "remarks"), ("tell", "report"), ("tells", "reports")];

/// All findings about names in Rust files.
pub fn check(sources: &[Source]) -> Vec<String> {
    let rust = sources.iter().filter(|source| source.path.extension().is_some_and(|e| e == "rs"));
    rust.flat_map(in_file).collect()
}

fn in_file(source: &Source) -> Vec<String> {
    let text = code(&source.text, Strings::Blank);
    let comments: Vec<&str> = source.text.lines().map(comment).collect();
    let mut found = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let at = format!("{}:{}", source.path.display(), number + 1);
        let words: Vec<&str> =
            line.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|w| !w.is_empty()).collect();
        if let Some(name) = words.windows(2).find_map(participle) {
            found.push(format!("{at}: expected a noun as the name of a type, found `{name}`"));
        }
        let written = comments.get(number).copied().unwrap_or_default();
        for (own, field) in OWN_WORDS {
            if words.contains(&own)
                || written.split(|c: char| !(c.is_alphanumeric() || "_-`".contains(c))).any(|word| word == own)
            {
                found.push(format!("{at}: expected a word of the field such as `{field}`, found `{own}`"));
            }
        }
    }
    found
}

/// A line that is a comment and nothing else.
fn comment(line: &str) -> &str {
    line.trim_start().strip_prefix("//").unwrap_or_default()
}

/// The name of a type that is one participle and nothing else, given two words of code.
fn participle<'t>(words: &[&'t str]) -> Option<&'t str> {
    let &[keyword, name] = words else { return None };
    let is_type = ["struct", "enum", "trait", "type"].contains(&keyword);
    let is_one_word = name.chars().skip(1).all(char::is_lowercase) && name.starts_with(char::is_uppercase);
    let ends = name.ends_with("ed") || name.ends_with("en") || name.ends_with("wn");
    let is_participle = IRREGULAR.contains(&name) || (ends && !NOUNS.contains(&name));
    (is_type && is_one_word && is_participle).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Vec<String> {
        in_file(&Source { path: "a.rs".into(), text: text.into() })
    }

    #[test]
    fn participles_are_no_types() {
        assert_eq!(of("pub struct Rejected(u8);\nenum Seen { A }\ntype Drawn = u8;\ntrait Said {}").len(), 4);
        assert!(
            of("struct Seed; struct RejectedPath; enum Golden { Told }\n// struct Seen\nlet s = \"struct Seen\";")
                .is_empty()
        );
    }

    #[test]
    fn words_of_our_own_are_named_with_those_of_the_field() {
        assert_eq!(
            of("fn tell(told: u8) {}"),
            [
                "a.rs:1: expected a word of the field such as `remarks`, found `told`",
                "a.rs:1: expected a word of the field such as `report`, found `tell`",
            ]
        );
        assert!(of("let cannot_tell = \"told\";").is_empty());
    }
}
