//! `replay.layout.json`: how Foxglove shows `replay.mcap` (menu Layouts, Import from file).

use super::{Errors, Replay};
use serde_json::{Map, Value, json};

/// Joints that are plotted: those with the largest errors.
const PLOTTED: usize = 3;

/// The layout: both robots with forces and slips to the left, the worst joints to the right.
pub fn layout(replay: &Replay) -> Value {
    let mut panels = Map::new();
    let scene = json!({
        "layers": {"grid": {"layerId": "foxglove.Grid", "frameId": "world", "visible": true, "size": 10, "divisions": 20}},
        "topics": {"/recorded/scene": {"visible": true}, "/simulated/scene": {"visible": true}, "/recorded/base_pose": {"visible": true}, "/simulated/base_pose": {"visible": true}},
        "followTf": "world", "followMode": "follow-none",
    });
    panels.insert("3D!scene".into(), scene);
    let mut names = vec![];
    for joint in worst(&replay.window_errors) {
        let name = format!("Plot!{}", replay.joint_names[joint]);
        panels.insert(name.clone(), plot(joint, &replay.joint_names[joint]));
        names.push(Value::String(name));
    }
    // Panels below each other are a tree of pairs.
    let column = names
        .into_iter()
        .rev()
        .reduce(|below, above| json!({"first": above, "second": below, "direction": "column", "splitPercentage": 50}));
    let arranged = match column {
        Some(column) => json!({"first": "3D!scene", "second": column, "direction": "row", "splitPercentage": 55}),
        None => json!("3D!scene"),
    };
    json!({"configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1}, "layout": arranged})
}

/// Joints by their error of position, the largest first; those that were not measured are left out.
fn worst(errors: &Errors) -> Vec<usize> {
    let mut known: Vec<usize> = (0..errors.joints.len()).filter(|&j| errors.joints[j].position.is_finite()).collect();
    known.sort_by(|&a, &b| errors.joints[b].position.total_cmp(&errors.joints[a].position));
    known.truncate(PLOTTED);
    known
}

fn plot(joint: usize, name: &str) -> Value {
    let path = |topic: &str, label: &str| json!({"value": format!("{topic}.position[{joint}]"), "label": label, "enabled": true, "timestampMethod": "receiveTime"});
    json!({
        "title": format!("{name} [rad]"), "foxglovePanelTitle": format!("{name} [rad]"),
        "paths": [
            path("/recorded/joint_states", "recorded"),
            path("/simulated/joint_states", "simulated, whole run"),
            path("/error/windows", "error in windows"),
        ],
        "xAxisVal": "timestamp", "isSynced": true, "showLegend": true, "legendDisplay": "floating",
        "showXAxisLabels": true, "showYAxisLabels": true,
    })
}
