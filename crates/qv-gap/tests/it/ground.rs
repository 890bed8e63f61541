//! Slippery ground, in a part of the floor and everywhere, and what something weighs, through the whole diagnosis.

use crate::facts::States;
use crate::recorded::{go2, recorded};
use qv_gap::inference::linearised::NullOptions;
use qv_gap::report::{Report, Verdict};
use qv_gap::{Options, diagnose};
use qv_recording::Run;
use qv_rollout::WindowOptions;
use qv_sim::Terrain;

fn quick() -> Options<'static> {
    Options { effort: NullOptions { replicates: 6, ..Default::default() }, ..Default::default() }
}

/// Fewer windows, where no outline is looked for.
fn fewer() -> Options<'static> {
    Options { cut: WindowOptions { most: 32, ..Default::default() }, ..quick() }
}

fn of(run: &Run, options: &Options) -> Report {
    diagnose(std::slice::from_ref(run), &go2(), &Terrain::plane(), options, 0).unwrap().report
}

fn patch([x0, x1, y0, y1]: [f64; 4], friction: f64) -> Vec<(String, f64)> {
    let edges = [("x_min", x0), ("x_max", x1), ("y_min", y0), ("y_max", y1), ("friction", friction)];
    edges.map(|(name, value)| (format!("terrain.patch.{name}"), value)).to_vec()
}

fn size(report: &Report, name: &str) -> f64 {
    let all = report.causes.iter().flat_map(|c| &c.parameters);
    all.into_iter().find(|p| p.name == name).unwrap_or_else(|| panic!("{name}: {}", report.sentence)).value
}

#[test]
fn the_outline_of_a_slippery_stripe_is_found_and_ends_at_feet() {
    let run = recorded(patch([0.4, 0.9, -3.0, 3.0], 0.15), 4);
    let report = of(&run, &quick());
    assert_eq!(report.causes.first().map(|c| c.effect.as_str()), Some("ground_friction"), "{}", report.sentence);
    assert_eq!(report.causes[0].scope, ["region"]);
    assert!((size(&report, "x_min") - 0.4).abs() < 0.15 && (size(&report, "x_max") - 0.9).abs() < 0.15);
    assert!((size(&report, "friction") - 0.15).abs() < 0.05);
    let [low, high] = ["y_min", "y_max"].map(|edge| size(&report, edge));
    assert!(-1.0 < low && low < 0.0 && 0.0 < high && high < 1.0, "{low} {high}");
    assert!(report.next.iter().any(|line| line.states("y_min y_max")), "{:?}", report.next);

    // Ground that is known already is not accused once more.
    let given = report.corrections.iter().map(|c| (c.parameter.clone(), c.value)).collect();
    let report = of(&run, &Options { given, ..fewer() });
    assert!(report.causes.is_empty(), "{}", report.sentence);
}

#[test]
fn ground_that_is_slippery_under_the_feet_of_one_side_has_its_edge_between_them() {
    let run = recorded(patch([0.4, 0.9, 0.0, 0.8], 0.12), 4);
    let report = of(&run, &quick());
    assert_eq!(report.causes.first().map(|c| c.effect.as_str()), Some("ground_friction"), "{}", report.sentence);
    for (edge, truth) in [("x_min", 0.4), ("x_max", 0.9), ("y_min", 0.0)] {
        let found = size(&report, edge);
        assert!((found - truth).abs() < 0.15, "{edge} {found}");
    }
}

#[test]
fn a_floor_that_is_slippery_everywhere_has_no_outline() {
    let report = of(&recorded(vec![("contact.friction".into(), 0.25)], 4), &fewer());
    assert_eq!(report.causes.first().map(|c| c.effect.as_str()), Some("ground_friction"), "{}", report.sentence);
    assert_eq!(report.causes[0].scope, ["all"]);
    assert!((size(&report, "friction") - 0.25).abs() < 0.05);
    assert!(report.corrections.iter().all(|c| !c.parameter.contains("patch")), "{:?}", report.corrections);
    assert!(report.place.regions.iter().all(|r| r.name != "found"), "{:?}", report.place.regions);
}

/// A floor of known friction that lets feet go once they slip.
#[test]
fn friction_that_falls_with_slip_is_named() {
    let known = [("contact.friction".to_string(), 0.35)];
    let weak = [("contact.friction_drop".to_string(), 0.6)];
    let run = recorded([&known[..], &weak[..]].concat(), 4);
    let report = of(&run, &Options { given: known.to_vec(), ..fewer() });
    let named = |cause: &qv_gap::report::Cause| {
        let mut all = cause.confusable_with.iter().chain([&cause.effect]);
        all.any(|effect| effect == "friction_drop")
    };
    let is_named = report.causes.first().is_some_and(named);
    assert!(is_named, "{} {:?} {:?}", report.sentence, report.causes, report.leads);
}

#[test]
fn a_weight_that_the_library_lacks_is_no_force() {
    let options = fewer();
    let run = recorded(vec![("link.base.payload_mass".into(), 1.2)], 4);
    let diagnosis = diagnose(&[run], &go2(), &Terrain::plane(), &options, 1).unwrap();
    assert_eq!(diagnosis.report.causes.first().map(|c| c.effect.as_str()), Some("payload_mass"));
    let (effect, without, _) = &diagnosis.without[0];
    assert_eq!(effect, "payload_mass");
    assert_eq!(without.verdict, Verdict::Unexplained, "{}", without.sentence);
}
