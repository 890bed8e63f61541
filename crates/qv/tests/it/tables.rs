//! Tidy tables, good and bad.

use crate::bags::*;
use crate::facts::States;
use crate::skipped::skipped;
use std::path::PathBuf;

const TOML: &str = "robot = \"robot.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 10.0\nkd = 0.5\n\
    [joint.shaft]\narmature = 0.02\n";
const URDF: &str = "<robot name=\"p\"><link name=\"a\"/><link name=\"b\"/></robot>";

fn table(name: &str, csv: &str, toml: &str) -> PathBuf {
    let path = directory(name);
    std::fs::write(path.join("run.csv"), csv).unwrap();
    std::fs::write(path.join("run.toml"), toml).unwrap();
    std::fs::write(path.join("robot.urdf"), URDF).unwrap();
    path
}

fn rows(count: usize, cell: impl Fn(usize) -> String) -> String {
    let lines: Vec<String> = (0..count).map(|k| format!("{:.3},0.1,{}", k as f64 * 0.01, cell(k))).collect();
    format!("time,cmd_pos.shaft,pos.shaft\n{}\n", lines.join("\n"))
}

fn wave(k: usize) -> String {
    format!("{:.5}", 0.3 * (k as f64 * 0.05).sin())
}

#[test]
fn a_good_table_with_quotes_and_carriage_returns() {
    let csv = rows(50, wave).replace('\n', "\r\n").replace("time,", "\u{feff}\"time\",");
    let (code, report, err) = inspect(&table("table_good", &csv, TOML));
    assert_eq!(code, 0, "{err} {report:#}");
    assert_eq!(report["joints"], serde_json::json!(["shaft"]));
    assert!((report["duration"].as_f64().unwrap() - 0.49).abs() < 1e-9);
    let channels = report["channels"].as_array().unwrap();
    let velocity = channels.iter().find(|c| c["name"] == "velocity").expect("velocity is derived");
    assert!(velocity["how"].as_str().unwrap().states("-3 dB"), "{velocity}");
}

#[test]
fn blanks_are_gaps_and_bad_cells_are_named() {
    let cell = |k: usize| {
        if k == 7 {
            String::new()
        } else if k == 9 {
            "abc".into()
        } else {
            wave(k)
        }
    };
    let (code, report, _) = inspect(&table("table_cells", &rows(30, cell), TOML));
    assert_eq!(code, 3);
    assert!(lost(&report).states("11 pos.shaft `abc`"), "{}", lost(&report));
    let position = report["channels"].as_array().unwrap().iter().find(|c| c["name"] == "position").unwrap();
    assert_eq!(position["samples"], 28);
    let (code, report, _) =
        inspect(&table("table_blank", &rows(30, |k| if k == 7 { String::new() } else { wave(k) }), TOML));
    assert_eq!(code, 0, "a blank cell is no fault: {report:#}");
}

#[test]
fn rows_and_columns_that_are_off_are_named() {
    let csv = rows(30, wave).replace("time,cmd_pos.shaft", "time,weather").replace("0.050,", "later,");
    for (name, end) in [("table_rows", "\n"), ("table_rows_of_windows", "\r\n")] {
        let (code, report, _) = inspect(&table(name, &csv.replace('\n', end), TOML));
        assert_eq!(code, 3);
        assert!(lost(&report).states("columns"), "{}", lost(&report));
        assert!(lost(&report).states("7 `later`"), "{}", lost(&report));
        assert_eq!(fault(&report, "missing")["channel"], "commands");
    }
}

#[test]
fn a_cut_off_table_gives_its_whole_rows() {
    let csv = rows(30, wave);
    let (code, report, _) = inspect(&table("table_cut", &csv[..csv.len() - 14], TOML));
    assert_eq!(code, 3);
    assert!(lost(&report).states("cells 3"), "{}", lost(&report));
}

#[test]
fn degrees_without_limits_are_suspected_by_range() {
    let csv = rows(100, |k| format!("{:.3}", 60.0 * (k as f64 * 0.05).sin()));
    let (code, report, _) = inspect(&table("table_degrees", &csv, TOML));
    assert_eq!(code, 3);
    assert!(fault(&report, "degrees_suspected")["detail"].as_str().unwrap().contains("60"));
}

#[test]
fn a_single_wild_value_becomes_a_gap() {
    let csv = rows(100, |k| if k == 40 { "-3.14".into() } else { wave(k) });
    let (code, report, err) = inspect(&table("table_spike", &csv, TOML));
    assert_eq!(code, 0, "{err}");
    let found = fault(&report, "jump");
    assert_eq!((found["count"].as_u64(), found["time"].as_f64()), (Some(1), Some(0.4)));
    assert!(found["detail"].as_str().unwrap().states("-3.140 -3.140"), "{found}");
    assert_eq!(report["faults"].as_array().unwrap().len(), 1, "the gap is not reported again: {report:#}");
}

#[test]
fn eleven_joints_and_foreign_joints() {
    let names = qv_go2::wire::joint_names();
    let header =
        |names: &[String]| format!("time,{}", names.iter().map(|n| format!("pos.{n}")).collect::<Vec<_>>().join(","));
    let row = |k: usize, n: usize| {
        let cells = (0..n).map(|j| format!("{:.4}", STAND[j] + 0.01 * (k + j) as f64)).collect::<Vec<_>>().join(",");
        format!("{:.3},{cells}", k as f64 * 0.005)
    };
    let go2 = "robot = \"go2\"\nbase = \"fixed\"\n";
    let csv = format!("{}\n{}\n", header(&names[..11]), (0..20).map(|k| row(k, 11)).collect::<Vec<_>>().join("\n"));
    let (code, report, err) = inspect(&table("table_eleven", &csv, go2));
    assert_eq!(code, 3, "{err}");
    let found = fault(&report, "wrong_robot");
    assert!(found["detail"].as_str().unwrap().states("11 RR_calf_joint"), "{found}");
    let (code, _, err) = inspect(&table("table_foreign", &rows(20, wave), go2));
    assert_eq!(code, 1);
    assert!(err.states("FL_hip_joint") && err.contains("shaft"), "{err}");
}

#[test]
fn bad_descriptions_are_errors() {
    for (name, toml, word) in [
        ("toml_syntax", "robot = ", "run.toml"),
        ("toml_kind", "robot = \"robot.urdf\"\n[actuator]\nkind = \"magic\"", "magic"),
        ("toml_base", "robot = \"robot.urdf\"\nbase = \"sky\"", "sky"),
        ("toml_robot", "robot = \"spot\"", "go2"),
        ("toml_nan", "robot = \"robot.urdf\"\n[actuator]\nkind = \"pd\"\nkp = nan", "finite"),
    ] {
        let (code, _, err) = inspect(&table(name, &rows(5, wave), toml));
        assert!(code == 1 && err.contains(word), "{name}: {code} {err}");
    }
    let (code, report, _) = inspect(&table("toml_extra", &rows(20, wave), &format!("{TOML}weight = 3.0\n")));
    assert!(code == 3 && lost(&report).contains("joint.shaft.weight"), "{report:#}");
}

#[test]
fn empty_tables_are_errors() {
    for (name, csv, word) in [
        ("csv_empty", "", "time"),
        ("csv_header", "time,pos.shaft\n", "at least one row"),
        ("csv_no_time", "t,pos.shaft\n0,1\n", "`time`"),
        ("csv_no_position", "time,vel.shaft\n0,1\n", "pos.<joint>"),
        ("csv_all_nan", "time,pos.shaft\n0,nan\n1,\n", "at least one row"),
    ] {
        let (code, _, err) = inspect(&table(name, csv, TOML));
        assert!(code == 1 && err.contains(word), "{name}: {code} {err}");
    }
}

#[test]
fn real_tables_read_in_full() {
    let real = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/real");
    if !real.exists() {
        skipped("no ../shared/real beside the workspace");
        return;
    }
    let (code, report, err) = inspect(&real.join("go2_air"));
    assert_eq!(code, 0, "{err}");
    assert_eq!((count(&report, "run.csv"), report["base"].as_str()), (4698, Some("fixed")));
    let (code, report, _) = inspect(&real.join("double_pendulum_acrobot/calm_01"));
    assert_eq!((code, report["joints"].as_array().unwrap().len()), (0, 2));
}
