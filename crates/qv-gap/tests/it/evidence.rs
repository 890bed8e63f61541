//! Decides on stored evidence of twelve sealed recordings (`fixtures/evidence`), of three origins and four cases. Nothing is simulated.

use qv_gap::decision::evidence::Evidence;
use qv_gap::decision::{Decision, HeldWindows, Policy, decide};
use qv_gap::report::report;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/evidence")
}

fn evidence(name: &str) -> Evidence {
    let file = folder().join(name).join("evidence.json");
    Evidence::read(&fs::read_to_string(&file).unwrap(), &file.display().to_string()).unwrap()
}

/// Name, case, and effects that are there.
fn answers() -> Vec<(String, String, Vec<String>)> {
    let text = fs::read_to_string(folder().join("answers.json")).unwrap();
    let answers: Value = serde_json::from_str(&text).unwrap();
    let effects = |answer: &Value| -> Vec<String> {
        let all = answer["effects"].as_array().unwrap();
        all.iter().map(|e| e["effect"].as_str().unwrap().into()).collect()
    };
    let all = answers["recordings"].as_object().unwrap();
    all.iter().map(|(name, answer)| (name.clone(), answer["case"].as_str().unwrap().into(), effects(answer))).collect()
}

fn decided(name: &str, policy: &Policy) -> Decision {
    decide(&evidence(name), policy).unwrap_or_else(|e| panic!("{name}: {e:?}"))
}

#[test]
fn evidence_of_other_formats_is_decided_on_or_refused() {
    // The format before has what decides, and nothing of what a report shows.
    let (name, ..) = answers().swap_remove(0);
    let error = report(&evidence(&name), &Policy::default()).unwrap_err().to_string();
    assert!(error.contains("qv-evidence/1") && error.contains("`qv diagnose` again"), "{error}");
    let error = Evidence::read("{\"format\": \"qv-evidence/9\"}", "new.json").unwrap_err().to_string();
    assert!(
        error.contains("new.json") && error.contains("qv-evidence/2") && error.contains("qv-evidence/9"),
        "{error}"
    );
}

#[test]
fn nothing_is_accused_where_nothing_of_the_library_is_there() {
    let quiet: Vec<_> = answers().into_iter().filter(|(_, case, _)| case == "none" || case == "withheld").collect();
    assert_eq!(quiet.len(), 6);
    for (name, case, _) in quiet {
        let decision = decided(&name, &Policy::default());
        assert!(!decision.accuses(), "{name} ({case}): {:?}", decision.verdict);
    }
}

#[test]
fn what_is_there_is_among_the_likeliest() {
    let mut among = 0;
    for (name, case, effects) in answers() {
        if case != "single" && case != "pair" {
            continue;
        }
        let decision = decided(&name, &Policy::default());
        // Several can be there at once, so that they need not sum to one.
        assert!(decision.ranking.iter().all(|r| (0.0..=1.0).contains(&r.score)), "{name}: {:?}", decision.ranking);
        let likeliest = decision.ranking.iter().filter(|r| r.effect != "unknown").take(3);
        let likeliest: Vec<_> = likeliest.map(|r| r.effect.as_str()).collect();
        among += usize::from(effects.iter().all(|e| likeliest.contains(&e.as_str())));
    }
    // Of six; the sixth is a latency of observation that is reported as one of command.
    assert_eq!(among, 5);
}

#[test]
fn a_policy_that_asks_for_more_accuses_less() {
    let strict = Policy {
        least_evidence: 1e9,
        held_windows: HeldWindows { least_evidence: 1e9, ..Default::default() },
        ..Policy::default()
    };
    let accusing = |policy: &Policy| -> usize {
        // Where the policy parts from what was measured, what would have followed is not known.
        let all = answers().into_iter().map(|(name, ..)| decide(&evidence(&name), policy));
        all.filter(|d| d.as_ref().is_ok_and(Decision::accuses)).count()
    };
    let (own, less) = (accusing(&Policy::default()), accusing(&strict));
    assert!(less < own, "{less} of {own}");
}
