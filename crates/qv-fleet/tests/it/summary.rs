//! The summary of made-up units: what it finds, and that order changes nothing.

use crate::facts::States;
use qv_fleet::gather::{Fleet, State, gather};
use qv_fleet::state::Kind;
use qv_fleet::{InputFile, Plan, Recording, Task, page, sha256};
use serde_json::{Value, json};

const DAY: u64 = 86_400_000_000_000;

/// Twelve recordings of each of three robots, a day apart.
fn recordings() -> Vec<Recording> {
    let one = |robot: &str, day: u64| {
        let path = format!("lab/{robot}/day{day:02}");
        let files = vec![InputFile { path: format!("{path}/run.csv"), bytes: 1, sha256: sha256(path.as_bytes()) }];
        Recording {
            path,
            robot: robot.into(),
            start_ns: Some(1_700_000_000_000_000_000 + day * DAY),
            seconds: 20.0,
            files,
        }
    };
    ["bello", "laika", "rex"].iter().flat_map(|robot| (0..12).map(move |day| one(robot, day))).collect()
}

fn report(effect: &str, value: f64) -> Value {
    let size = json!({"name": "size", "value": value, "ci95": [value - 0.4, value + 0.4], "unit": "ms"});
    json!({"verdict": "explained", "sentence": "<b>late</b>", "gap": {"after": 1.0 + 0.01 * value},
        "causes": [{"effect": effect, "scope": ["all"], "parameters": [size]}]})
}

fn plan(recordings: Vec<Recording>) -> Plan {
    Plan::new(Task::default(), recordings, vec![], false)
}

fn summary(plan: &Plan) -> Fleet {
    gather(plan, |unit| {
        let path = &unit.recordings[0].path;
        let day: f64 = path[path.len() - 2..].parse().unwrap();
        let wobble = 0.2 * (9.0 * day).sin();
        match unit.robot.as_str() {
            "rex" => State::Done(0, report("command_latency", 8.0 + 0.5 * day + wobble)),
            "bello" if day == 5.0 => State::Done(0, report("command_latency", 40.0)),
            "bello" => State::Done(0, report("command_latency", 10.0 + wobble)),
            _ if day < 3.0 => State::Failed(Kind::Failed, format!("{path}/run.csv: expected a time, found `x`")),
            _ if day < 4.0 => State::Missing,
            _ => State::Done(3, report("joint_friction", 2.0 + wobble)),
        }
    })
}

#[test]
fn causes_sizes_drift_outliers_and_failures_are_found() {
    let fleet = summary(&plan(recordings()));
    assert_eq!(["done", "finding", "failed", "missing"].map(|s| fleet.counts[s]), [24, 8, 3, 1]);
    assert_eq!(fleet.causes[0].effect, "command_latency");
    assert_eq!(fleet.causes[0].robots, [("bello".into(), 12, 12), ("rex".into(), 12, 12)]);
    assert_eq!(fleet.causes[1].robots, [("laika".into(), 8, 8)]);
    let drifting: Vec<&str> = fleet.sizes.iter().filter(|s| s.drifts).map(|s| s.robot.as_str()).collect();
    assert_eq!(drifting, ["rex"]);
    let rex = fleet.sizes.iter().find(|s| s.drifts).unwrap();
    let slope = rex.per_day.unwrap();
    assert!(slope.ci95[0] < 0.5 && slope.ci95[1] > 0.5 && (slope.value - 0.5).abs() < 0.05, "{slope:?}");
    assert_eq!(rex.dates, ["2023-11-14T22:13:20Z", "2023-11-25T22:13:20Z"]);
    let apart: Vec<(&str, f64)> = fleet.outliers.iter().map(|o| (o.robot.as_str(), o.value)).collect();
    assert!(apart.contains(&("bello", 40.0)) && fleet.outliers[0].z > 3.5, "{apart:?}");
    assert_eq!(fleet.failures.len(), 1, "one reason, though its files differ");
    assert_eq!(fleet.failures[0].reason, "RECORDING: expected a time, found `x`");
    assert_eq!(fleet.failures[0].units.len(), 3);
}

#[test]
fn the_same_units_give_the_same_bytes_in_any_order() {
    let mut turned = recordings();
    turned.reverse();
    turned.swap(3, 20);
    let (one, other) = (plan(recordings()), plan(turned));
    let (a, b) = (summary(&one), summary(&other));
    assert_eq!(a.to_text(), b.to_text());
    assert_eq!(page::to_html(&a, &one), page::to_html(&b, &other));
}

#[test]
fn the_page_says_all_of_it_and_stays_text() {
    let plan = plan(recordings());
    let html = page::to_html(&summary(&plan), &plan);
    for words in ["command_latency: shared by bello, rex", "drifts by", "beyond 3.5", "RECORDING: expected a time"] {
        assert!(html.contains(words), "{words}");
    }
    assert!(html.contains("&lt;b&gt;late") && !html.contains("<b>late"));
    let boards = qv_page::read::boards(&html);
    assert_eq!((boards.len(), boards[0].choices[0].options.len()), (1, 2));
    for never in ["http:", "https:", "NaN", "src="] {
        assert!(!html.contains(never), "{never}");
    }
}

#[test]
fn a_browser_shows_the_page() {
    let plan = plan(recordings());
    crate::browser::check("fleet", &page::to_html(&summary(&plan), &plan));
}

#[test]
fn nothing_done_is_a_page_too() {
    let plan = plan(recordings());
    let fleet = gather(&plan, |_| State::Missing);
    let html = page::to_html(&fleet, &plan);
    assert!(html.states("missing 36") && fleet.sizes.is_empty() && fleet.outliers.is_empty());
}
