//! Sealed recordings: the same seed gives the same bytes, robots stay on their feet, and each effect is there to be seen.

use qv_core::JointSeries;
use qv_go2::synthetic::{Deviations, Message, write_bag};
use qv_go2::wire;
use qv_recording::{BagFile, Run, read_bag};
use qv_sealed::{
    ATTEMPTS, EFFECTS, Engine, EngineChoice, FaultRequest, Motion, Outcome, Recipe, Request, ValidRecording, WITHHELD,
    confusable_group, interface,
};
use std::io::Cursor;

fn made(engine: EngineChoice, wanted: FaultRequest, seed: u64) -> ValidRecording {
    qv_sealed::make(&Request::mixed(engine, wanted), seed).unwrap()
}

fn single(effect: &str) -> FaultRequest {
    FaultRequest::Effects(vec![effect.into()])
}

/// The messages written to a bag and read back.
fn run(messages: &[Message]) -> Run {
    let mut bag = Cursor::new(Vec::new());
    write_bag(messages, &mut bag).unwrap();
    bag.set_position(0);
    let file = BagFile { name: "run.mcap".into(), source: bag };
    let run = read_bag([file], &wire::mapping(None)).unwrap();
    assert!(run.lost.is_empty() && !run.is_partial(), "{:?} {:?}", run.lost, run.faults);
    run
}

/// Root mean square of the difference of two series, over their columns from `first` to `last`.
fn apart(a: &Option<JointSeries>, b: &Option<JointSeries>, columns: std::ops::Range<usize>) -> f64 {
    let (a, b) = (a.as_ref().unwrap(), b.as_ref().unwrap());
    assert_eq!(a.len(), b.len());
    let mut sum = 0.0;
    for sample in 0..a.len() {
        sum += columns.clone().map(|c| (a.row(sample)[c] - b.row(sample)[c]).powi(2)).sum::<f64>();
    }
    (sum / (a.len() * columns.len()) as f64).sqrt()
}

/// Largest difference over the channels, in deviations of their noise. Both carry the same noise, so that two
/// recordings of the same robot differ by nothing.
fn difference(a: &[Message], b: &[Message], d: &Deviations) -> f64 {
    let (a, b) = (run(a), run(b));
    let (m, n) = (&a.measured, &b.measured);
    [
        apart(&m.position, &n.position, 0..12) / d.position,
        apart(&m.velocity, &n.velocity, 0..12) / d.velocity,
        apart(&m.torque, &n.torque, 0..12) / d.torque,
        apart(&m.gyro, &n.gyro, 0..3) / d.gyro,
        apart(&m.orientation, &n.orientation, 0..4) / d.orientation,
        apart(&m.base_pose, &n.base_pose, 0..3) / d.pose_position,
    ]
    .into_iter()
    .fold(0.0, f64::max)
}

fn recorded(recipe: &Recipe) -> Vec<Message> {
    let (outcome, messages) = qv_sealed::record(recipe).unwrap();
    assert!(matches!(outcome, Outcome::Stood { .. }), "{outcome:?}");
    messages
}

#[test]
fn the_same_seed_gives_the_same_recording() {
    let draw = |seed| made(EngineChoice::Ours, single("motor_strength"), seed);
    let (first, again, other) = (draw(5), draw(5), draw(6));
    assert_eq!(first, again);
    assert_ne!(first.drawn.recipe, other.drawn.recipe);
    assert_ne!(first.messages, other.messages);
    let request = Request::mixed(EngineChoice::Ours, single("motor_strength"));
    let redraws = first.rejected.len() as u64;
    assert_eq!(qv_sealed::redraw(&request, 5, redraws).unwrap(), first.drawn);
    let span = run(&first.messages).span();
    assert!((span[1] - span[0] - 20.0).abs() < 0.01, "{span:?}");
}

/// A walk that amplified anything would show any effect: it must not.
fn nudges_do_not_show(recipe: &Recipe) {
    let plain = recipe.without_effects();
    let mut nudged = plain.clone();
    nudged.differences.push(("link.base.payload_mass".into(), 1e-6));
    let found = difference(&recorded(&plain), &recorded(&nudged), &recipe.deviations);
    println!("a milligram in {:?}: {found:.5} deviations", recipe.engine);
    assert!(found > 0.0 && found < 0.05, "{found} deviations");
}

fn shows(made: &ValidRecording, name: &str) {
    let without = recorded(&made.drawn.recipe.without_effects());
    let found = difference(&made.messages, &without, &made.drawn.recipe.deviations);
    println!("{name}: {found:.2} deviations, after {} redraws", made.rejected.len());
    assert!(found > 0.5, "{name}: {found} deviations");
}

#[test]
fn a_milligram_does_not_show() {
    for seed in 0..4 {
        nudges_do_not_show(&made(EngineChoice::Ours, FaultRequest::Nothing, seed).drawn.recipe);
    }
}

#[test]
fn each_effect_of_the_library_shows() {
    for (index, effect) in EFFECTS.into_iter().enumerate() {
        let made = made(EngineChoice::Ours, single(effect), 40 + index as u64);
        assert_eq!(made.drawn.recipe.causes[0].effect, effect);
        assert!(made.drawn.recipe.withheld.is_none() && made.rejected.len() < ATTEMPTS as usize);
        for figure in &made.drawn.recipe.causes[0].figures {
            let (least, most) = figure.range;
            assert!((least..=most).contains(&figure.value), "{effect}: {figure:?}");
        }
        assert!(
            made.drawn.recipe.causes[0].figures.iter().any(|figure| figure.asked),
            "{effect} has nothing to ask for"
        );
        shows(&made, effect);
    }
}

#[test]
fn each_withheld_effect_shows_and_is_logged_as_the_robot_would() {
    for (index, name) in WITHHELD.into_iter().enumerate() {
        let made = made(EngineChoice::Ours, FaultRequest::Withheld(name.into()), 80 + index as u64);
        let effect = made.drawn.recipe.withheld.as_ref().unwrap();
        assert!(made.drawn.recipe.causes.is_empty() && effect.name == name);
        assert!(!effect.relatives().is_empty() && !effect.relatives().contains(&name), "{effect:?}");
        shows(&made, name);
        let commands = |messages: &[Message]| {
            messages.iter().filter(|m| m.topic == "/lowcmd").map(|m| m.data.clone()).collect::<Vec<_>>()
        };
        assert_eq!(commands(&made.messages), commands(&recorded(&made.drawn.recipe.without_effects())), "{name}");
    }
}

#[test]
fn what_is_asked_for_is_checked() {
    for wanted in [single("motor_strenght"), FaultRequest::Withheld("payload_mass".into())] {
        let error = qv_sealed::make(&Request::mixed(EngineChoice::Ours, wanted), 1).unwrap_err().to_string();
        assert!(error.contains("motor_strength") || error.contains("tether"), "{error}");
    }
}

#[test]
fn two_effects_act_at_once() {
    let wanted = FaultRequest::Effects(vec!["payload_mass".into(), "imu_tilt".into()]);
    let both = made(EngineChoice::Ours, wanted, 3).drawn.recipe;
    assert_eq!(both.causes.len(), 2);
    let names: Vec<String> = both.parameters().into_iter().map(|(name, _)| name).collect();
    for name in ["link.base.payload_mass", "sensor.imu.tilt_roll"] {
        assert!(names.iter().any(|n| n == name), "{name}");
    }
}

#[test]
fn every_effect_has_an_interface_and_a_group() {
    for effect in EFFECTS {
        assert!(["actuator", "contact", "inertial", "sensing"].contains(&interface(effect).unwrap()));
        assert!(confusable_group(effect).contains(&effect));
    }
    assert_eq!(interface("tether"), None);
    assert_eq!(confusable_group("pose_delay"), ["pose_delay"]);
}

#[cfg(feature = "rapier")]
mod in_the_second_engine {
    use super::*;

    #[test]
    fn effects_show_and_repeat() {
        let made = made(EngineChoice::Second, single("joint_coulomb_friction"), 1);
        assert!(matches!(made.drawn.recipe.engine, Engine::Second { .. }) && made.drawn.other_engine.is_none());
        shows(&made, "joint_coulomb_friction");
        let mut recipe = made.drawn.recipe;
        recipe.plan.sections.truncate(2);
        nudges_do_not_show(&recipe);
    }

    #[test]
    fn disturbances_act_step_by_step_and_repeat() {
        let mut recipe = made(EngineChoice::Second, FaultRequest::Withheld("stribeck_friction".into()), 4).drawn.recipe;
        recipe.plan.sections.truncate(2);
        let with = recorded(&recipe);
        assert_eq!(with, recorded(&recipe));
        let found = difference(&with, &recorded(&recipe.without_effects()), &recipe.deviations);
        assert!(found > 0.5, "{found} deviations");
    }

    #[test]
    fn what_it_hardly_shows_is_recorded_in_ours() {
        let made = made(EngineChoice::Second, single("contact_compliance"), 1);
        assert!(matches!(made.drawn.recipe.engine, Engine::Ours { .. }));
        assert!(made.drawn.other_engine.unwrap().contains("contact_compliance"));
    }
}

#[cfg(not(feature = "rapier"))]
#[test]
fn an_engine_that_is_not_built_in_is_named() {
    let request = Request::mixed(EngineChoice::Second, FaultRequest::Nothing);
    assert!(qv_sealed::make(&request, 1).unwrap_err().to_string().contains("rapier"));
    let ours = made(EngineChoice::Ours, FaultRequest::Nothing, 1).drawn.recipe;
    assert!(matches!(ours.engine, Engine::Ours { .. }));
}

#[test]
fn sizes_go_down_and_values_stay() {
    let made = |effect: &str, down_to_unseen: bool| {
        let request =
            Request { engine: EngineChoice::Ours, wanted: single(effect), motion: Motion::Stand, down_to_unseen };
        qv_sealed::make(&request, 3).unwrap().drawn.recipe.causes.remove(0)
    };
    let (whole, small) = (made("motor_strength", false), made("motor_strength", true));
    let share = small.figures[0].value / whole.figures[0].value;
    assert!((0.1..1.0).contains(&share), "{share}");
    for ((name, small), (_, whole)) in small.settings.iter().zip(&whole.settings) {
        assert!((small - 1.0 - share * (whole - 1.0)).abs() < 1e-12, "{name}: {small} of {whole}");
    }
    assert_eq!(made("contact_compliance", false).figures, made("contact_compliance", true).figures);
}
