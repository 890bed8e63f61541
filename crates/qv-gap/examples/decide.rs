//! Decides once more on evidence that was measured, perhaps by another policy: seconds for hundreds of recordings.
//!
//! `decide EVIDENCE OUT [POLICY.toml]` reads `EVIDENCE/NAME/evidence.json` (and `EVIDENCE/NAME/without/EFFECT/evidence.json`) and writes
//! `OUT/NAME/report.json` with verdict, causes and ranking. A recording that the policy would have led to other simulations
//! gets no report. Prints a line of JSON: how many were decided, how many not, and the policy.

use qv_gap::decision::evidence::Evidence;
use qv_gap::decision::{Decision, Policy, decide};
use serde_json::{Value, json};
use std::error::Error;
use std::fs;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [evidence, out, policy @ ..] = arguments.as_slice() else {
        return Err("expected EVIDENCE OUT [POLICY.toml]".into());
    };
    let policy: Policy = match policy {
        [] => Policy::default(),
        [file, ..] => toml::from_str(&fs::read_to_string(file)?).map_err(|e| format!("{file}: {e}"))?,
    };
    let mut names: Vec<_> = fs::read_dir(evidence)?.collect::<Result<Vec<_>, _>>()?;
    names.sort_by_key(|entry| entry.file_name());
    let mut counts = [0; 2];
    for entry in names.iter().filter(|entry| entry.path().join("evidence.json").is_file()) {
        let own = Path::new(out).join(entry.file_name());
        counts[usize::from(!one(&entry.path(), &own, &policy)?)] += 1;
        let Ok(without) = fs::read_dir(entry.path().join("without")) else { continue };
        for effect in without {
            let effect = effect?;
            one(&effect.path(), &own.join("without").join(effect.file_name()), &policy)?;
        }
    }
    println!("{}", json!({ "decided": counts[0], "parted": counts[1], "policy": policy }));
    Ok(())
}

/// Whether there is a decision on the evidence in `folder`, which is written into `out`.
fn one(folder: &Path, out: &Path, policy: &Policy) -> Result<bool, Box<dyn Error>> {
    let file = folder.join("evidence.json");
    let text = fs::read_to_string(&file).map_err(|e| format!("{}: {e}", file.display()))?;
    let evidence = Evidence::read(&text, &file.display().to_string())?;
    let Ok(decision) = decide(&evidence, policy) else { return Ok(false) };
    fs::create_dir_all(out)?;
    fs::write(out.join("report.json"), report(&evidence, &decision).to_string())?;
    Ok(true)
}

fn report(evidence: &Evidence, decision: &Decision) -> Value {
    let is_told = decision.accuses();
    let score = |effect: &str| {
        let of = decision.ranking.iter().find(|r| r.effect == effect);
        of.map_or(0.0, |r| r.score)
    };
    let causes = evidence.accused().filter(|_| is_told).map(|(accused, candidate)| {
        let scope = match candidate.extent {
            Some(qv_gap::problem::columns::Extent::Region(_)) => vec!["region".to_owned()],
            _ => candidate.scope.clone(),
        };
        json!({
            "effect": candidate.effect,
            "score": score(&candidate.effect),
            "scope": scope,
            "parameters": accused.parameters,
        })
    });
    let closed = evidence.corrected.as_ref().filter(|_| is_told).map_or(0.0, |c| c.closed.share_with_events);
    json!({
        "format": "qv-diagnosis/1",
        "verdict": decision.verdict,
        "gap": { "closed": closed },
        "causes": causes.collect::<Vec<Value>>(),
        "ranking": decision.ranking,
    })
}
