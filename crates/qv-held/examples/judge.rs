//! Judges recordings of a fixed-base robot against references: `judge [--together] [--reference FOLDER]... RUN...`.
//!
//! A folder holds `run.csv`, `run.toml` and `robot.urdf`. One line of JSON per recording, or one for all `--together`: outcome, the best hypotheses with their tests, and seconds.

use qv_held::{Decision, Evidence, Outcome, PairJudgement, PairTest, Policy, Request, decide, measure};
use qv_recording::Run;
use qv_sim::{BaseKind, Model, ModelOptions};
use serde_json::{Value, json};
use std::error::Error;
use std::fs;
use std::path::Path;
use std::time::Instant;

/// Hypotheses that are printed.
const SHOWN: usize = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut references, mut folders, mut together) = (Vec::new(), Vec::new(), false);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--reference" {
            references.push(read(Path::new(&arguments.next().ok_or("--reference needs a folder")?))?);
        } else if argument == "--together" {
            together = true;
        } else {
            folders.push(argument);
        }
    }
    let count = if together { folders.len().max(1) } else { 1 };
    for folders in folders.chunks(count) {
        println!("{}", judge(folders, &references)?);
    }
    Ok(())
}

fn read(folder: &Path) -> Result<Run, Box<dyn Error>> {
    let text =
        |name: &str| fs::read_to_string(folder.join(name)).map_err(|e| format!("{}/{name}: {e}", folder.display()));
    let urdf = text("robot.urdf")?;
    Ok(qv_recording::read_table(text("run.csv")?.as_bytes(), &text("run.toml")?, Some(&urdf), None)?)
}

fn judge(folders: &[String], references: &[Run]) -> Result<Value, Box<dyn Error>> {
    let urdf = fs::read_to_string(Path::new(&folders[0]).join("robot.urdf"))?;
    let model = Model::from_urdf(&urdf, &ModelOptions { base: BaseKind::Fixed, ..Default::default() })?;
    let runs = folders.iter().map(|folder| read(Path::new(folder))).collect::<Result<Vec<Run>, _>>()?;
    let policy = Policy::default();
    let request =
        Request { runs: &runs, references, model: &model, given: &[], without: &[], seed: 1, policy: &policy };
    let begun = Instant::now();
    let evidence = measure(&request)?;
    let decision = decide(&evidence, &policy);
    let seconds = begun.elapsed().as_secs_f64();
    Ok(line(&folders[0], &evidence, &decision, seconds))
}

fn line(folder: &str, evidence: &Evidence, decision: &Decision, seconds: f64) -> Value {
    let mut order = decision.order.clone();
    if let Outcome::Cause(k, _) = decision.outcome {
        order.retain(|o| *o != k);
        order.insert(0, k);
    }
    let best: Vec<Value> = order.iter().take(SHOWN).map(|&k| hypothesis(evidence, decision, k)).collect();
    json!({
        "run": folder,
        "outcome": decision.outcome,
        "p_gap": decision.p_gap,
        "none_in_set": decision.none_in_set,
        "loss": evidence.loss,
        "references": evidence.left_out,
        "best": best,
        "pairs": (evidence.pairs.iter().zip(&decision.pairs)).map(pair).collect::<Vec<Value>>(),
        "joints": evidence.joints,
        "events": decision.events.len(),
        "seconds": seconds,
    })
}

fn pair((pair, judged): (&PairTest, &PairJudgement)) -> Value {
    json!({
        "effect": pair.test.hypothesis.effect,
        "members": pair.members,
        "size": pair.test.size,
        "judged": judged,
        "loss": pair.test.loss,
    })
}

fn hypothesis(evidence: &Evidence, decision: &Decision, k: usize) -> Value {
    let (tested, judged) = (&evidence.tested[k], &decision.judged[k]);
    json!({
        "effect": tested.hypothesis.effect,
        "scope": tested.hypothesis.scope,
        "size": tested.size,
        "judged": judged,
        "loss": tested.loss,
    })
}
