//! Gathers made-up reports of three robots into a page: `cargo run -p quadverse-fleet --example fleet_page FILE.html`.

use qv_fleet::gather::{State, gather};
use qv_fleet::state::Kind;
use qv_fleet::{InputFile, Plan, Recording, Task, page, sha256};
use serde_json::json;

fn main() -> std::io::Result<()> {
    let recording = |k: u64| {
        let path = format!("{}/day{:02}", ["rex", "bello", "laika"][k as usize % 3], k / 3);
        let files = vec![InputFile { path: path.clone(), bytes: 1, sha256: sha256(path.as_bytes()) }];
        let start_ns = Some(1_700_000_000_000_000_000 + k / 3 * 86_400_000_000_000);
        Recording { robot: path[..path.find('/').unwrap_or(0)].into(), path, start_ns, seconds: 20.0, files }
    };
    let plan = Plan::new(Task::default(), (0..30).map(recording).collect(), vec![], false);
    let fleet = gather(&plan, |unit| {
        let day: f64 = unit.recordings[0].path[unit.robot.len() + 4..].parse().unwrap_or(0.0);
        if unit.robot == "laika" && day > 7.0 {
            return State::Failed(Kind::Failed, format!("{}: expected a bag, found none", unit.recordings[0].path));
        }
        // The commands of one robot come later every day.
        let late = if unit.robot == "rex" { 8.0 + 0.4 * day } else { 5.0 } + 0.1 * (7.0 * day).sin();
        let size = json!({"name": "command latency", "value": late, "ci95": [late - 0.3, late + 0.3], "unit": "ms"});
        let cause = json!({"effect": "command_latency", "scope": ["all"], "parameters": [size]});
        State::Done(0, json!({"verdict": "explained", "causes": [cause], "gap": {"after": 1.0 + 0.01 * day}}))
    });
    for size in fleet.sizes.iter().filter(|size| size.drifts) {
        println!("{} of {} drifts", size.parameter, size.robot);
    }
    let file = std::env::args().nth(1).unwrap_or_else(|| "fleet.html".into());
    std::fs::write(&file, page::to_html(&fleet, &plan))?;
    println!("written to {file}");
    Ok(())
}
