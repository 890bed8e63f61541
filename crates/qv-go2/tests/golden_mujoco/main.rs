//! qv-sim against runs of MuJoCo, `fixtures/mujoco/golden`. Each test repeats a run from the inputs in the golden and
//! compares by the golden's own tolerance. The figures are printed: `cargo test --test golden_mujoco -- --nocapture`.

mod momentum;
mod reference;

use glam::DVec3;
use qv_go2::gait::{Chirp, Trot};
use qv_go2::model;
use reference::{Golden, Joint, numbers, read, rms};
use serde_json::Value;
use std::collections::BTreeMap;

/// Prints a figure beside its bound, and holds it to it.
fn hold(golden: &Golden, measure: &str, found: f64) {
    let bound = golden.bound(measure);
    println!("{}: {measure} {found:.3e}, at most {bound:.1e}", golden.name);
    assert!(found <= bound, "{}: {measure}: expected at most {bound}, found {found}", golden.name);
}

fn chirp(name: &str) {
    let golden = read(name);
    let motion = golden.chirp.as_ref().unwrap().motion();
    assert_eq!(motion, Chirp::default());
    let states = golden.repeat(Some(&|t| motion.target(t)));
    hold(&golden, "rms_rad", rms(&states, &golden.q, 0, 12));
}

#[test]
fn leg_chirp() {
    chirp("chirp");
}

#[test]
fn leg_chirp_with_joint_friction() {
    chirp("chirp_friction");
}

#[test]
fn standing_robot_dropped() {
    let golden = read("drop");
    let states = golden.repeat(Some(&|_| model::STAND));
    hold(&golden, "z_rms_m", rms(&states, &golden.q, 2, 3));
}

fn trot(name: &str) {
    let golden = read(name);
    let gait = golden.trot.as_ref().unwrap().gait();
    assert_eq!(gait, Trot::default());
    let states = golden.repeat(Some(&|t| gait.target(t)));
    let (found, expected) = (&states.last().unwrap().q, golden.q.last().unwrap());
    let distance = (0..3).map(|i| (found[i] - expected[i]).powi(2)).sum::<f64>().sqrt();
    println!("{name}: path rms {:.3e} m", rms(&states, &golden.q, 0, 3));
    hold(&golden, "end_position_m", distance);
}

#[test]
fn trot_on_the_flat() {
    trot("trot_mu08");
    trot("trot_mu02");
}

#[test]
fn trot_with_joint_friction() {
    trot("trot_friction_mu08");
    trot("trot_friction_mu02");
}

#[test]
fn trot_on_bumps() {
    trot("trot_bumps_mu08");
    trot("trot_bumps_mu02");
}

/// Speed of the base along the slope, at the samples of the golden: found and expected \[m/s\].
fn incline(golden: &Golden) -> (Vec<f64>, Vec<f64>) {
    let states = golden.repeat(Some(&|_| model::STAND));
    let expected = golden.table("q_and_velocity").iter().map(|row| row[19]).collect();
    (states.iter().map(|state| state.v[0]).collect(), expected)
}

#[test]
fn holds_below_the_friction_angle() {
    let golden = read("incline_hold");
    let (found, _) = incline(&golden);
    hold(&golden, "holding_speed_m_per_s", found.last().unwrap().abs());
}

#[test]
fn slides_above_the_friction_angle() {
    let golden = read("incline_slide");
    let (found, expected) = incline(&golden);
    // From half a second on, when it is well under way.
    let worst = (25..found.len()).map(|i| (found[i] / expected[i] - 1.0).abs()).fold(0.0, f64::max);
    hold(&golden, "speed_relative", worst);
}

#[test]
fn free_flight_keeps_energy_and_angular_momentum() {
    let golden = read("free_flight");
    let model = golden.model();
    let states = golden.repeat(None);
    let invariants: Vec<_> = states.iter().map(|state| momentum::invariants(&model, state)).collect();
    let first = &golden.table("rows")[0];
    assert!((invariants[0].kinetic_energy / first[2] - 1.0).abs() < 1e-7, "the same run as the reference's");
    let reference = DVec3::new(first[3], first[4], first[5]);
    assert!((invariants[0].angular_momentum - reference).length() < 1e-7 * reference.length());
    let drift = |of: &dyn Fn(&momentum::Invariants) -> f64| invariants.iter().map(of).fold(0.0, f64::max);
    let energy = drift(&|now| (now.kinetic_energy - invariants[0].kinetic_energy).abs());
    let turning = drift(&|now| (now.angular_momentum - invariants[0].angular_momentum).length());
    hold(&golden, "energy_drift_J", energy);
    hold(&golden, "angular_momentum_drift", turning);
}

fn free_body(name: &str) {
    let golden = read(name);
    let states = golden.repeat(None);
    hold(&golden, "path_rms_m", rms(&states, &golden.q, 0, 3));
}

#[test]
fn box_on_a_plane() {
    free_body("box_drop");
    free_body("box_throw");
}

fn chain(name: &str) {
    let golden = read(name);
    let states = golden.repeat(None);
    let joints = golden.initial_q.len();
    hold(&golden, "rms_rad", rms(&states, &golden.q, 0, joints));
}

#[test]
fn pendulums_with_damping_and_friction() {
    chain("pendulum");
    chain("double_pendulum");
}

/// Largest difference beside the largest expected value.
fn relative(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let scale = expected.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    assert!(scale > 0.0);
    found.iter().zip(expected).map(|(f, e)| (f - e).abs()).fold(0.0, f64::max) / scale
}

#[test]
fn one_step_from_states_in_contact() {
    let golden = read("single_step");
    let states: Vec<BTreeMap<String, Value>> = serde_json::from_value(golden.rest["states"].clone()).unwrap();
    assert_eq!(states.len(), 3);
    for (index, state) in states.iter().enumerate() {
        let joint: Joint = serde_json::from_value(state["joint"].clone()).unwrap();
        let (q, v) = (numbers(state, "q"), numbers(state, "v"));
        let mut sim = golden.environment(joint, &q, &v);
        golden.command(&mut sim, &numbers(state, "ctrl"));
        sim.step();
        let next = sim.state(0).unwrap();
        let change = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
        let error = relative(&change(&next.v, &v), &change(&numbers(state, "v_next"), &v));
        println!("state {index}");
        hold(&golden, "relative", error);
        assert!(relative(&change(&next.q, &q), &change(&numbers(state, "q_next"), &q)) < 1e-5);
    }
}

#[test]
fn masses_of_the_merged_model() {
    // The inverse weights of this golden are compared inside qv-sim, which keeps its own to itself.
    let golden = read("invweights");
    let model = golden.model();
    let expected = golden.numbers("body_mass");
    let names: Vec<String> = serde_json::from_value(golden.rest["body_names"].clone()).unwrap();
    for (name, mass) in names.iter().zip(&expected).filter(|(name, _)| *name != "world") {
        let link = model.links.iter().find(|link| link.name == *name).unwrap_or_else(|| panic!("no link {name}"));
        assert!((link.mass - mass).abs() < 1e-12, "{name}: {} {mass}", link.mass);
    }
    let total: f64 = serde_json::from_value(golden.rest["total_mass"].clone()).unwrap();
    assert!((model.mass() - total).abs() < 1e-12);
}
