//! A robot whose ground turns slippery at 60 s.

use qv_policy::velocity::TaskSettings;
use qv_residual::identify::FitSettings;
use qv_residual::log::Log;
use qv_residual::online::Online;
use qv_sim::Terrain;

#[test]
fn friction_and_strength_are_followed_through_a_change() {
    let robot = qv_go2::walk::robot().unwrap();
    let (terrain, task, settings) = (Terrain::plane(), TaskSettings::default(), FitSettings::default());
    let feet = |scale: f64| {
        let names = robot.feet.iter().map(|&g| format!("geom.{}.friction_scale", robot.model.geoms[g].name));
        names.map(|n| (n, scale)).collect::<Vec<_>>()
    };
    let stream = |scale: f64, strength: f64, pieces: usize| {
        let feet = feet(scale);
        let mut all: Vec<(&str, f64)> = feet.iter().map(|(n, x)| (n.as_str(), *x)).collect();
        all.push(("actuator.*.strength", strength));
        crate::squats::log(&robot, &all, pieces, 2e-4)
    };
    let (before, after) = (stream(1.0, 0.9, 15), stream(0.25, 0.8, 15));
    let mut online = Online::new(&robot, &terrain, &task, &settings, 20.0).unwrap();
    let mut push = |log: &Log, k: usize| {
        let piece = Log { stretches: vec![log.stretches[k].clone()], ..Log::new(&robot, &task) };
        online.push(&piece).unwrap()
    };
    let found = |estimates: &[qv_residual::online::Estimate], name: &str| {
        estimates.iter().find(|e| e.name == name).unwrap().clone()
    };
    let mut last = Vec::new();
    for k in 0..15 {
        last = push(&before, k);
    }
    let strength = found(&last, "actuator.*.strength");
    assert!((strength.value - 0.9).abs() < 0.02, "{strength:?}");
    let friction = found(&last, "geom.*.friction_scale");
    assert!(friction.interval[1] > 0.8 && friction.value > 0.6, "{friction:?}");
    for k in 0..10 {
        last = push(&after, k);
    }
    let strength = found(&last, "actuator.*.strength");
    assert!((strength.value - 0.8).abs() < 0.02, "{strength:?}");
    let friction = found(&last, "geom.*.friction_scale");
    assert!((friction.value - 0.25).abs() < 0.08, "{friction:?}");
    assert!(friction.interval[0] < friction.value && friction.interval[1] > friction.value);
    assert!(Online::new(&robot, &terrain, &task, &settings, 0.0).is_err());
}
