//! `qv walk describe`: descriptions of policies from other trainers, as a start for one's own.

use crate::{Failure, Outcome, say};
use qv_go2::descriptions::DESCRIPTIONS;
use qv_policy::roll::Description;
use serde_json::json;

#[derive(clap::Args)]
pub struct Describe {
    /// Name of an example; without it all are listed
    name: Option<String>,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Describe {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let Some(name) = &self.name else {
            say(&if self.json { as_json()? } else { list()? })?;
            return Ok(Outcome::Done);
        };
        let Some((_, text)) = DESCRIPTIONS.iter().find(|(known, _)| known == name) else {
            let known: Vec<&str> = DESCRIPTIONS.iter().map(|(known, _)| *known).collect();
            return Err(format!("cannot print '{name}': no such example; examples: {}", known.join(", ")).into());
        };
        let line = json!({"format": "qv-walk-describe/1", "name": name, "toml": text});
        say(&if self.json { format!("{line}\n") } else { (*text).to_owned() })?;
        Ok(Outcome::Done)
    }
}

fn list() -> Result<String, Failure> {
    let mut text = String::new();
    for (name, toml) in DESCRIPTIONS {
        text += &format!("{name:<16} {}\n", Description::from_toml(toml)?.name);
    }
    Ok(text)
}

fn as_json() -> Result<String, Failure> {
    let mut all = Vec::new();
    for (name, toml) in DESCRIPTIONS {
        let about = Description::from_toml(toml)?;
        all.push(json!({"name": name, "about": about.name, "source": about.source}));
    }
    Ok(format!("{}\n", json!({"format": "qv-walk-describe/1", "examples": all})))
}
