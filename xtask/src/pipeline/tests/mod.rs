//! Of the pipeline as data, and of its golden.

use super::golden::{Figure, Of, calls, differences, read};
use super::stages::{Size, Stage};
use crate::workspace::Workspace;
use clap::ValueEnum;
use serde_json::json;
use std::collections::BTreeMap;

/// What a stage reads, an earlier one writes.
#[test]
fn stages_fit_together() {
    let mut written: BTreeMap<&str, Stage> = BTreeMap::new();
    for &stage in Stage::value_variants() {
        for file in stage.inputs(true) {
            assert!(written.get(file).is_some_and(|by| *by < stage), "{file}");
        }
        for file in stage.outputs() {
            assert!(file.starts_with(stage.name()), "{file} lies in the stage's own folder, which it empties");
            written.insert(file, stage);
        }
        for call in [Size::Small, Size::Full].iter().flat_map(|size| stage.calls(*size, true)) {
            assert!(call.said.is_none_or(|file| stage.outputs().contains(&file)), "{call:?}");
        }
    }
}

/// The golden "stages" has figures of every stage that has any, and the first that moved is named first, with how far.
#[test]
fn the_first_stage_that_moved_is_named() {
    let root = Workspace::load().unwrap().workspace_root;
    let golden = read(&root, Of::Stages, Size::Small).unwrap();
    assert!(differences(&golden, &golden).is_empty());
    let place =
        |figure: &Figure| Stage::value_variants().iter().position(|stage| stage.name() == figure.stage).unwrap();
    assert!(golden.is_sorted_by_key(place), "in the order of the stages");
    let at = |stage: &str| golden.iter().position(|f| f.stage == stage && f.value.is_number()).unwrap();
    let (mesh, contact) = (at("mesh"), at("contact"));
    let mut moved = golden.clone();
    for index in [mesh, contact] {
        let far = moved[index].value.as_f64().unwrap() + 2.0 * moved[index].tolerance + 0.01;
        moved[index].value = json!(far);
    }
    let said = differences(&golden, &moved);
    assert!(said.len() == 2 && said[0].starts_with("mesh, ") && said[0].contains("allowed"), "{said:?}");
    let without: Vec<Figure> = golden.iter().filter(|figure| figure.stage != "mesh").cloned().collect();
    let said = differences(&without, &golden);
    assert!(!said.is_empty() && said[0].starts_with("mesh, ") && said[0].contains("expected none"), "{said:?}");
    moved.retain(|figure| figure.stage != "diagnose");
    assert!(
        differences(&golden, &moved).iter().any(|line| line.starts_with("diagnose") && line.ends_with("found none"))
    );
}

fn golden(name: &str) -> Vec<Figure> {
    let (of, size) = Of::named(name).unwrap();
    read(&Workspace::load().unwrap().workspace_root, of, size).unwrap()
}

/// A golden whose tolerance is wide sees no regression: at most a fifth of the figure.
#[test]
fn goldens_are_narrow_enough_to_see_a_regression() {
    for name in ["stages", "stages_full", "navigate", "navigate_full"] {
        for figure in golden(name) {
            let size = figure.value.as_f64().map_or(f64::INFINITY, f64::abs);
            assert!(figure.tolerance <= 0.2 * size, "{name}: {figure:?}");
        }
    }
}

/// A golden of other calls says nothing of these.
#[test]
fn goldens_are_of_the_calls_of_today() {
    let root = Workspace::load().unwrap().workspace_root;
    for name in ["stages", "stages_full", "navigate", "navigate_full"] {
        let (of, size) = Of::named(name).unwrap();
        let golden = super::read_json(&root.join("fixtures/pipeline/golden").join(of.file(size))).unwrap();
        assert_eq!(golden["options"]["stages"], json!(calls(of, size)), "{name}");
    }
}

/// The goldens "navigate" have figures of the optional stage alone, "stages" have none of it.
#[test]
fn the_optional_stage_has_a_golden_of_its_own() {
    for (stages, navigate) in [("stages", "navigate"), ("stages_full", "navigate_full")] {
        assert!(golden(stages).iter().all(|figure| figure.stage != "navigate"));
        let navigate = golden(navigate);
        assert!(navigate.len() == 6 && navigate.iter().all(|figure| figure.stage == "navigate"));
        let share = |k: usize| navigate[k].value.as_f64().unwrap();
        assert!(share(0) > 0.6 && share(1) > 0.9, "a policy that learnt, and its teacher: {} {}", share(0), share(1));
        assert!(share(2) > 0.4, "and on legs that walk: {}", share(2));
    }
    assert!(Stage::Report.calls(Size::Full, true)[0].words.contains("--navigation") && Stage::Navigate.is_optional());
    assert!(!Stage::Report.calls(Size::Full, false)[0].words.contains("--navigation"));
    let needed = super::needed(Stage::Navigate, true);
    assert!([Stage::Tune, Stage::Mesh, Stage::Yard].iter().all(|stage| needed.contains(stage)), "{needed:?}");
    assert!(![Stage::Paths, Stage::View, Stage::Report].iter().any(|stage| needed.contains(stage)), "{needed:?}");
    assert!(super::needed(Stage::Report, false).iter().all(|stage| !stage.is_optional()));
}

/// A stage that fails leaves what the last good one wrote; one that was killed leaves it for the next.
#[test]
fn what_a_stage_wrote_comes_back_when_it_fails() {
    let folder = std::env::temp_dir().join(format!("qv-anew-{}", std::process::id()));
    let own = folder.join("mesh");
    std::fs::create_dir_all(&own).unwrap();
    let file = own.join("terrain.glb");
    let write = |text: &'static str| std::fs::write(&file, text).map_err(anyhow::Error::from);
    super::anew(&own, &|| write("first")).unwrap();
    assert!(super::anew(&own, &|| write("half").and_then(|()| anyhow::bail!("it fails"))).is_err());
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "first");
    // As a kill leaves it: the good one moved away, a half in its place.
    std::fs::rename(&own, folder.join("mesh.before")).unwrap();
    std::fs::create_dir_all(&own).unwrap();
    write("half").unwrap();
    assert!(super::anew(&own, &|| anyhow::bail!("it fails again")).is_err());
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "first");
    super::anew(&own, &|| write("second")).unwrap();
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "second");
    assert!(!folder.join("mesh.before").exists());
    std::fs::remove_dir_all(&folder).unwrap();
}
