//! `qv demo`: a made-up robot that hides an effect is recorded and diagnosed, and what was hidden stands beside what was found.

mod browser;
mod hidden;

use crate::fixture::write_recording;
use crate::outcome::about;
use crate::output::{commit, make_folder, write_whole};
use crate::progress::remark;
use crate::{Failure, Outcome, say};
use hidden::HiddenEffect;
use qv_go2::synthetic::{self, Robot};
use qv_sim::Terrain;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv demo\n\
     \x20 qv demo --seed 7 --no-open\n\
     \n\
     Results: run.mcap (18 s of a simulated Go2 that stands, squats and trots), truth.json (the hidden effect), why/ (results of\n\
     `qv diagnose`), view.html. No network. The same seed hides the same effect."
);

#[derive(clap::Args)]
pub struct Demo {
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", default_value = "out/demo", help_heading = "Output")]
    out: PathBuf,
    /// Draw the hidden effect and the noise from this seed
    #[arg(long, default_value_t = 1, value_name = "N", help_heading = "What to test")]
    seed: u64,
    /// Do not open the report in a browser
    #[arg(long, help_heading = "Output")]
    no_open: bool,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Demo {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let clock = Instant::now();
        let hidden = HiddenEffect::drawn(self.seed);
        self.record(&hidden)?;
        let [bag, why, view] = ["run.mcap", "why", "view.html"].map(|name| self.out.join(name));
        self.notify(&format!("A simulated Go2 walked for {} s with one hidden effect.\n", synthetic::DURATION))?;
        self.call(&["diagnose".as_ref(), &bag, "--out".as_ref(), &why])?;
        self.call(&["view".as_ref(), &why, "--out".as_ref(), &view])?;
        let report = read(&why.join("report.json"))?;
        let (found, page) = (&report["causes"][0], why.join("report.html"));
        let is_named = found["effect"] == hidden.effect.name;
        if self.json {
            let line = json!({
                "format": "qv-demo/1", "seed": self.seed, "hidden": hidden.to_json(), "found": found, "named": is_named,
                "seconds": clock.elapsed().as_secs_f64(), "page": page.display().to_string(),
            });
            say(&format!("{line}\n"))?;
        }
        let verdict = if is_named { "The hidden effect was found" } else { "The hidden effect was not found" };
        self.notify(&format!(
            "\nHidden: {}.\nFound:  {}.\n{verdict}, in {:.0} s. The page to read is {}.\n",
            of_hidden(&hidden),
            of_cause(found).unwrap_or_else(|| "no single cause".into()),
            clock.elapsed().as_secs_f64(),
            page.display()
        ))?;
        if !self.no_open
            && let Err(found) = browser::open(&page)
        {
            remark(&format!("the page could not be opened in a browser: {found}"));
        }
        Ok(Outcome::Done)
    }

    /// Recording and truth.
    fn record(&self, hidden: &HiddenEffect) -> Result<(), Failure> {
        make_folder(&self.out).map_err(|e| about(&self.out, format!("expected a folder, found {e}")))?;
        let robot = Robot { parameters: hidden.parameters(self.seed), seed: self.seed, start: [0.0; 3] };
        let messages = synthetic::record(&Terrain::plane(), &robot)?;
        write_recording(&self.out.join("run.mcap"), &messages)?;
        let truth = json!({ "seed": self.seed, "hidden": hidden.to_json(), "parameters": robot.parameters });
        write_whole(&self.out.join("truth.json"), format!("{truth:#}\n").as_bytes())?;
        // The commands that are called read it.
        commit().map_err(|e| about(&self.out, e))
    }

    fn notify(&self, text: &str) -> Result<(), Failure> {
        if !self.json {
            say(text)?;
        }
        Ok(())
    }

    /// Runs `qv` as one would type it, in a process of its own: what it does here is what it does there.
    fn call(&self, words: &[&Path]) -> Result<(), Failure> {
        let typed: Vec<String> = words.iter().map(|word| word.display().to_string()).collect();
        self.notify(&format!("\n$ qv {}\n", typed.join(" ")))?;
        let program = std::env::current_exe().map_err(|e| format!("expected this program's own path, found {e}"))?;
        let mut command = Command::new(program);
        command.args(words).arg("--no-config").stdin(Stdio::null());
        if self.json {
            command.stdout(Stdio::null());
        }
        let status = command.status().map_err(|e| format!("qv {}: {e}", typed.join(" ")))?;
        // 3: what was found is a finding and no correction, which the page says.
        match status.code() {
            Some(0 | 3) => Ok(()),
            _ => Err(format!("qv {}: expected it to end well, found {status}", typed.join(" ")).into()),
        }
    }
}

fn read(path: &Path) -> Result<Value, Failure> {
    let text = fs::read_to_string(path).map_err(|e| about(path, format!("expected a report, found {e}")))?;
    serde_json::from_str(&text).map_err(|e| about(path, format!("expected JSON, found {e}")))
}

fn of_hidden(hidden: &HiddenEffect) -> String {
    let (effect, name) = (&hidden.effect, hidden.effect.name.replace('_', " "));
    format!("{name} {:.4} {} of {} ({})", hidden.size, unit(&effect.unit), place(&hidden.scope), effect.about)
}

/// A cause of a report in words; none where nothing is accused.
fn of_cause(cause: &Value) -> Option<String> {
    let name = cause["effect"].as_str()?.replace('_', " ");
    let scope: Vec<String> = cause["scope"].as_array()?.iter().filter_map(|s| Some(s.as_str()?.to_owned())).collect();
    let size = &cause["parameters"][0];
    let number = |value: &Value| value.as_f64().map_or("?".into(), |x| format!("{x:.4}"));
    let (value, unit) = (number(&size["value"]), unit(size["unit"].as_str().unwrap_or("")));
    let [low, high] = [0, 1].map(|k| number(&size["ci95"][k]));
    Some(format!("{name} {value} {unit} of {} (95 % interval {low} to {high})", place(&scope)))
}

/// A unit as it is said behind a number.
fn unit(unit: &str) -> &str {
    if unit == "1" { "of the nominal value" } else { unit }
}

fn place(scope: &[String]) -> String {
    if scope == ["all"] { "all joints".into() } else { scope.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_is_said_in_a_line() {
        let cause = json!({"effect": "motor_gain_kp", "scope": ["FL_hip_joint"],
            "parameters": [{"name": "scale", "value": -0.2, "ci95": [-0.25, -0.15], "unit": "1"}]});
        let words = "motor gain kp -0.2000 of the nominal value of FL_hip_joint (95 % interval -0.2500 to -0.1500)";
        assert_eq!(of_cause(&cause).unwrap(), words);
        assert_eq!(of_cause(&Value::Null), None);
    }
}
