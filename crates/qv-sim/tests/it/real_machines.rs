//! What real machines have and models leave out: springs between motors and joints, batteries that run down and sag, ground on
//! which feet slip better the faster they slip, ground that gives way. Against closed forms.

use crate::robots::{Order, body, command, inertial, model, near, tabletop};
use qv_sim::{BaseKind, Batch, JointCommand, Model, Precision, SimOptions, State, Terrain};

/// Inertia of the wheel about its axis: its own and the rotor's that `crate::robots::model` adds \[kg m²\].
const INERTIA: f64 = 0.05 + 0.01;
const STEP: f64 = 0.001;

fn wheel() -> Model {
    let urdf = format!(
        r#"<robot name="wheel"><link name="bench"/><link name="wheel">{}</link>
        <joint name="axle" type="continuous"><parent link="bench"/><child link="wheel"/><axis xyz="0 0 1"/></joint></robot>"#,
        inertial(1.0, 0.05)
    );
    model(&urdf, BaseKind::Fixed)
}

fn turning<T: Precision>(implicit: bool, set: &[(&str, f64)]) -> Batch<T> {
    let options = SimOptions { implicit_actuator_damping: implicit, max_sensor_latency: 0.02, ..Default::default() };
    let mut sim = Batch::new(&wheel(), &Terrain::none(), &options, 1).unwrap();
    set.iter().for_each(|(name, value)| sim.set_parameter(0, name, *value).unwrap());
    sim
}

fn torque<T: Precision>(sim: &Batch<T>) -> f64 {
    sim.sensors(0).unwrap().tau[0]
}

#[test]
fn a_spring_in_series_gives_way_by_its_compliance() {
    let load = -2.0;
    let set = [("actuator.axle.series_compliance", 0.01), ("joint.axle.external_torque", load)];
    let mut sim = turning::<f64>(true, &set);
    command(&mut sim, Order { q: 0.3, kp: 20.0, kd: 2.0, ..Default::default() });
    sim.step_many(6000);
    let seen = sim.sensors(0).unwrap();
    near(seen.tau[0], -load, 1e-9);
    near(sim.state(0).unwrap().q[0], 0.3 + load / 20.0 + 0.01 * load, 1e-9);
    // The motor stands where its gain alone would let it stand.
    near(seen.q[0], 0.3 + load / 20.0, 1e-9);
    // The same of a reading that is late.
    sim.set_parameter(0, "sensor.axle.encoder_latency", 0.005).unwrap();
    near(sim.sensors(0).unwrap().q[0], 0.3 + load / 20.0, 1e-9);
}

#[test]
fn encoders_of_all_environments_read_the_motors() {
    let mut sim = Batch::<f64>::new(&wheel(), &Terrain::none(), &SimOptions::default(), 3).unwrap();
    sim.set_parameter(1, "actuator.axle.series_compliance", 0.01).unwrap();
    for env in 0..3 {
        sim.set_command(env, &JointCommand { q: &[0.0], dq: &[0.0], kp: &[0.0], kd: &[0.0], tau: &[2.0] }).unwrap();
    }
    sim.step();
    let (mut q, mut dq) = ([0.0; 3], [0.0; 3]);
    sim.read_encoders(&mut q, &mut dq).unwrap();
    assert_eq!(q[0], q[2]);
    near(f64::from(q[1] - q[0]), 0.02, 1e-7);
    assert_eq!(sim.state(0).unwrap(), sim.state(1).unwrap(), "a torque that is only fed forward is the same");
}

/// The torque that a motor gives which is what its spring is twisted by, by halving.
fn balanced(order: Order, compliance: f64, before: f64, share: f64, limits: [f64; 2], dq: f64) -> [f64; 2] {
    let lagged = |torque: f64| {
        let p = (order.kp * (order.q - compliance * torque) + order.tau).clamp(-limits[0], limits[0]);
        let u = p + order.kd * (order.dq - dq);
        before + share * (0.9 * u + 0.1 * u.abs() - before)
    };
    let given = |torque: f64| lagged(torque).clamp(-limits[1], limits[1]);
    let (mut low, mut high) = (-limits[1], limits[1]);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if given(middle) > middle { low = middle } else { high = middle }
    }
    [low, lagged(low)]
}

#[test]
fn clips_lag_and_asymmetry_act_through_the_spring() {
    let orders = [
        Order { q: 0.2, kp: 30.0, ..Default::default() },
        Order { q: -0.4, kp: 30.0, dq: 1.0, kd: 2.0, tau: 0.3 },
        Order { q: 1.0, kp: 80.0, dq: -1.0, kd: 2.0, tau: 0.0 },
        Order { q: 0.01, kp: 200.0, dq: -1.5, kd: 1.0, tau: 0.0 },
        Order { q: -3.0, kp: 300.0, ..Default::default() },
    ];
    let mut cases = [0; 3];
    for compliance in [1e-4, 0.01, 1.0] {
        for clip in [1e9, 4.0] {
            let set = [
                ("actuator.axle.series_compliance", compliance),
                ("actuator.axle.position_torque_limit", clip),
                ("actuator.axle.torque_limit", 6.0),
                ("actuator.axle.lag", 0.003),
                ("actuator.axle.strength", 0.9),
                ("actuator.axle.strength_asymmetry", 0.1),
            ];
            let share = 1.0 - (-STEP / 0.003f64).exp();
            for first in orders {
                for second in orders {
                    let mut sim = turning::<f64>(false, &set);
                    command(&mut sim, first);
                    sim.step();
                    // What was not watched before has settled.
                    let [given, lagged] = balanced(first, compliance, 0.0, 1.0, [clip, 6.0], 0.0);
                    near(torque(&sim), given, 1e-9);
                    command(&mut sim, second);
                    let State { q, v } = sim.state(0).unwrap();
                    sim.step();
                    let moved = Order { q: second.q - q[0], ..second };
                    let [given, next] = balanced(moved, compliance, lagged, share, [clip, 6.0], v[0]);
                    near(torque(&sim), given, 1e-9);
                    let soft = (moved.kp * (moved.q - compliance * given) + moved.tau).abs();
                    cases[usize::from(soft > clip) + 2 * usize::from(next.abs() > 6.0 && soft <= clip)] += 1;
                }
            }
        }
    }
    assert!(cases.iter().all(|&n| n > 10), "free, clipped, at the limit: {cases:?}");
}

#[test]
fn a_spring_divides_both_gains_and_their_implicit_damping() {
    for compliance in [0.002, 0.05, 2.0] {
        let order = Order { q: 0.5, dq: 0.1, kp: 60.0, kd: 4.0, tau: 0.2 };
        let mut sprung = turning::<f64>(true, &[("actuator.axle.series_compliance", compliance)]);
        let mut rigid = turning::<f64>(true, &[]);
        command(&mut sprung, order);
        let soft = 1.0 / (1.0 + compliance * 60.0);
        let gains = Order { kp: 60.0 * soft, kd: 4.0 * soft, tau: 0.2 * soft, ..order };
        command(&mut rigid, gains);
        for _ in 0..300 {
            sprung.step();
            rigid.step();
            near(sprung.state(0).unwrap().q[0], rigid.state(0).unwrap().q[0], 1e-12);
        }
        assert!(rigid.state(0).unwrap().q[0].abs() > 1e-3);
    }
}

#[test]
fn a_gain_without_end_is_held_by_the_spring() {
    // Without a spring this gain would throw the wheel about in steps of a millisecond.
    let set = [("actuator.axle.series_compliance", 0.01)];
    for kp in [1e4, 1e6] {
        let mut sim = turning::<f32>(true, &set);
        command(&mut sim, Order { q: 0.1, kp, kd: 0.02 * kp, ..Default::default() });
        sim.step_many(3000);
        near(sim.state(0).unwrap().q[0], 0.1, 1e-4);
        // The spring is what is left of the gain: a push of 1 N m twists it by its compliance.
        sim.set_parameter(0, "joint.axle.external_torque", 1.0).unwrap();
        sim.step_many(3000);
        near(sim.state(0).unwrap().q[0], 0.1 + 0.01 + 1.0 / kp, 1e-4);
    }
}

#[test]
fn an_environment_without_a_spring_keeps_its_bits_beside_one_with() {
    let run = |neighbour: f64| {
        let options = SimOptions { lanes: Some(8), ..Default::default() };
        let mut sim = Batch::<f64>::new(&wheel(), &Terrain::none(), &options, 8).unwrap();
        sim.set_parameter(3, "actuator.axle.series_compliance", neighbour).unwrap();
        for env in 0..8 {
            sim.set_command(env, &JointCommand { q: &[0.4], dq: &[0.0], kp: &[50.0], kd: &[1.0], tau: &[0.1] })
                .unwrap();
        }
        sim.step_many(200);
        [2, 3].map(|env| crate::robots::bits(&sim.state(env).unwrap()))
    };
    let (without, with) = (run(0.0), run(0.01));
    assert_eq!(without[0], with[0]);
    assert_ne!(without[1], with[1]);
}

#[test]
fn strength_drifts_from_the_start_of_the_run() {
    let set = [("actuator.axle.strength", 0.8), ("actuator.axle.strength_drift", -0.02)];
    let mut sim = turning::<f64>(true, &set);
    command(&mut sim, Order { tau: 2.0, ..Default::default() });
    sim.step_many(10_000);
    near(torque(&sim), 2.0 * 0.8 * (1.0 - 0.02 * 9.999), 1e-9);
    // A part of the run that begins after a minute: nothing is left, and it does not turn round.
    let again = State { q: vec![0.0], v: vec![0.0] };
    for (start, left) in [(30.0, 0.4), (60.0, 0.0)] {
        sim.set_parameter(0, "run.start", start).unwrap();
        sim.set_state(0, &again).unwrap();
        command(&mut sim, Order { tau: 2.0, ..Default::default() });
        sim.step();
        near(torque(&sim), 2.0 * 0.8 * left, 1e-9);
    }
    assert_eq!([qv_sim::drift_share(0.01, 10.0), qv_sim::drift_share(-0.2, 10.0)], [1.1, 0.0]);
}

#[test]
fn gains_and_their_implicit_damping_drift_too() {
    let order = Order { q: 0.5, dq: 0.1, kp: 60.0, kd: 4.0, tau: 0.2 };
    let set = [("actuator.axle.strength_drift", -0.01), ("actuator.axle.series_compliance", 0.01), ("run.start", 50.0)];
    let mut sim = turning::<f64>(true, &set);
    command(&mut sim, order);
    sim.step();
    let mut plain = turning::<f64>(true, &[("actuator.axle.strength", 0.5), set[1]]);
    command(&mut plain, order);
    plain.step();
    near(sim.state(0).unwrap().v[0], plain.state(0).unwrap().v[0], 1e-12);
}

/// Two wheels on one bench.
fn wheels() -> Model {
    let wheel = |name: &str| {
        format!(
            r#"<link name="{name}">{}</link><joint name="{name}_axle" type="continuous"><parent link="bench"/><child link="{name}"/>
            <axis xyz="0 0 1"/></joint>"#,
            inertial(1.0, 0.05)
        )
    };
    model(
        &format!(r#"<robot name="wheels"><link name="bench"/>{}{}</robot>"#, wheel("one"), wheel("two")),
        BaseKind::Fixed,
    )
}

#[test]
fn the_power_of_all_motors_takes_from_each() {
    let (sag, asked) = (0.004, [2.0, -3.0]);
    let mut sim = Batch::<f64>::new(&wheels(), &Terrain::none(), &SimOptions::default(), 1).unwrap();
    sim.set_parameter(0, "supply.sag", sag).unwrap();
    // The second wheel is braked at first, which takes no power.
    let (mut v, mut given) = ([1.0, 2.0], [0.0; 2]);
    sim.set_state(0, &State { q: vec![0.0; 2], v: v.to_vec() }).unwrap();
    sim.set_command(0, &JointCommand { q: &[0.0; 2], dq: &[0.0; 2], kp: &[0.0; 2], kd: &[0.0; 2], tau: &asked })
        .unwrap();
    let mut least = 1.0f64;
    for _ in 0..1000 {
        sim.step();
        let power = (given[0] * v[0]).max(0.0) + (given[1] * v[1]).max(0.0);
        let share = (1.0 - sag * power).max(0.0);
        least = least.min(share);
        for j in 0..2 {
            given[j] = share * asked[j];
            v[j] += STEP * given[j] / INERTIA;
        }
        let seen = sim.sensors(0).unwrap();
        (0..2).for_each(|j| near(seen.tau[j], given[j], 1e-9));
    }
    assert!(least < 0.65 && least > 0.1, "the supply gave {least} at the least");
}

/// The plane as two triangles.
/// Friction over normal force of a box that slides at a speed, over a few steps.
fn sliding(terrain: &Terrain, speed: f64, set: &[(&str, f64)]) -> f64 {
    let mut sim =
        Batch::<f64>::new(&body(r#"<box size="0.4 0.4 0.02"/>"#), terrain, &SimOptions::default(), 1).unwrap();
    set.iter().for_each(|(name, value)| sim.set_parameter(0, name, *value).unwrap());
    let v = vec![speed, 0.0, 0.0, 0.0, 0.0, 0.0];
    sim.set_state(0, &State { q: vec![0.0, 0.0, 0.0099, 1.0, 0.0, 0.0, 0.0], v }).unwrap();
    sim.step_many(10);
    let v = sim.state(0).unwrap().v;
    // It chatters, so the normal impulse is taken from its vertical motion.
    (speed - v[0]) / (9.81 * 0.01 + v[2])
}

#[test]
fn friction_falls_with_slip() {
    let weak = [("contact.friction_drop", 0.4), ("contact.friction_speed", 0.5)];
    let patch = [
        ("terrain.patch.x_min", -1.0),
        ("terrain.patch.x_max", 1.0),
        ("terrain.patch.y_min", -1.0),
        ("terrain.patch.y_max", 1.0),
        ("terrain.patch.friction", 0.2),
    ];
    let left = |speed: f64| 1.0 - 0.4 * (1.0 - (-speed / 0.5f64).exp());
    for terrain in [Terrain::plane(), tabletop()] {
        for speed in [0.5, 3.0] {
            let plain = sliding(&terrain, speed, &[("contact.friction", 0.3)]);
            near(plain, 0.3, 3e-3);
            // Within the ten steps it loses a few hundredths of a metre per second.
            near(
                sliding(&terrain, speed, &[&[("contact.friction", 0.3)], &weak[..]].concat()),
                0.3 * left(speed),
                4e-3,
            );
            let of_patch = [&patch[..], &weak[..], &[("geom.body.friction_scale", 1.5)]].concat();
            near(sliding(&terrain, speed, &of_patch), 0.2 * 1.5 * left(speed), 4e-3);
        }
    }
}

const BALL: &str = r#"<sphere radius="0.1"/>"#;

/// A ball of 1 kg that lies on ground, settled.
fn lying<T: Precision>(terrain: &Terrain, geometry: &str, height: f64, set: &[(&str, f64)]) -> Batch<T> {
    let mut sim = Batch::<T>::new(&body(geometry), terrain, &SimOptions::default(), 2).unwrap();
    set.iter().for_each(|(name, value)| sim.set_parameter(0, name, *value).unwrap());
    for env in 0..2 {
        let q = vec![0.3, 0.2, height - 0.0001, 1.0, 0.0, 0.0, 0.0];
        sim.set_state(env, &State { q, v: vec![0.0; 6] }).unwrap();
    }
    sim.step_many(500);
    sim
}

const WEIGHT: f64 = 9.81;

#[test]
fn what_presses_harder_than_the_ground_bears_sinks_for_good() {
    let soft = [("contact.yield_force", 5.0), ("contact.sink_rate", 0.002)];
    let speed = 0.002 * (WEIGHT - 5.0);
    for terrain in [Terrain::plane(), tabletop()] {
        for (geometry, height) in [(BALL, 0.1), (r#"<box size="0.2 0.3 0.1"/>"#, 0.05)] {
            let mut sim = lying::<f64>(&terrain, geometry, height, &soft);
            let (before, sunk) = (sim.state(0).unwrap().q[2], sim.sunk_depths(0).unwrap()[0]);
            sim.step_many(500);
            let after = sim.sunk_depths(0).unwrap()[0];
            near(after - sunk, 0.5 * speed, 0.01 * speed);
            near(before - sim.state(0).unwrap().q[2], after - sunk, 1e-4);
            // Beside it hard ground bears the same body, which lies higher by what the other has sunk.
            assert_eq!(sim.sunk_depths(1).unwrap(), [0.0]);
            near(sim.state(1).unwrap().q[2] - sim.state(0).unwrap().q[2], after, 2e-4);
            // Half out of its print it is still in it; above the ground as it was it has left it.
            let up = |sim: &mut Batch<f64>, by: f64| {
                let mut state = sim.state(0).unwrap();
                (state.q[2], state.v) = (state.q[2] + by, vec![0.0; 6]);
                sim.move_to(0, &state).unwrap();
                sim.step();
                sim.sunk_depths(0).unwrap()[0]
            };
            near(up(&mut sim, 0.5 * after), after, 2e-5);
            assert_eq!(up(&mut sim, after), 0.0);
        }
    }
}

#[test]
fn ground_that_bears_a_body_keeps_every_bit() {
    let firm = [("contact.yield_force", 1e4), ("contact.sink_rate", 0.002)];
    for terrain in [Terrain::plane(), tabletop()] {
        let sim = lying::<f32>(&terrain, BALL, 0.1, &firm);
        assert_eq!(crate::robots::bits(&sim.state(0).unwrap()), crate::robots::bits(&sim.state(1).unwrap()));
        assert_eq!(sim.sunk_depths(0).unwrap(), [0.0]);
    }
}

#[test]
fn prints_go_with_their_environments() {
    let soft = [("contact.yield_force", 5.0), ("contact.sink_rate", 0.002)];
    let mut sim = lying::<f32>(&Terrain::plane(), BALL, 0.1, &soft);
    let kept = sim.snapshot();
    // Into an environment of hard ground, where the print soon stays as deep as it is.
    sim.copy_lane(0, 1).unwrap();
    let depth = sim.sunk_depths(0).unwrap()[0];
    sim.step_many(100);
    let deeper = sim.sunk_depths(0).unwrap()[0];
    assert!(depth > 1e-3 && deeper > depth + 5e-4, "{depth} {deeper}");
    near(sim.sunk_depths(1).unwrap()[0], depth, 1e-4);
    near(sim.state(1).unwrap().q[2] - sim.state(0).unwrap().q[2], deeper - depth, 2e-4);
    sim.restore(&kept).unwrap();
    assert_eq!(sim.sunk_depths(0).unwrap(), [depth]);
    sim.step_many(100);
    assert_eq!(sim.sunk_depths(0).unwrap(), [deeper]);
    // A new state is one on ground that nobody trod.
    let state = sim.state(0).unwrap();
    sim.set_state(0, &state).unwrap();
    assert_eq!(sim.sunk_depths(0).unwrap(), [0.0]);
}

#[test]
fn on_triangles_nothing_sinks_through() {
    let soft = [("contact.yield_force", 0.0), ("contact.sink_rate", 0.01)];
    let mut sim = lying::<f64>(&tabletop(), BALL, 0.1, &soft);
    sim.step_many(5000);
    assert_eq!(sim.sunk_depths(0).unwrap(), [0.1]);
    near(sim.state(0).unwrap().q[2], 0.0, 2e-3);
}

#[cfg(feature = "rapier")]
#[test]
fn the_second_engine_says_what_ground_it_lacks() {
    use qv_sim::rapier::{RapierEngine, RapierOptions};
    let mut engine = RapierEngine::new(&wheel(), &Terrain::plane(), &RapierOptions::default()).unwrap();
    for (name, value) in [
        ("contact.friction_drop", 0.3),
        ("contact.friction_speed", 0.3),
        ("contact.yield_force", 30.0),
        ("contact.sink_rate", 0.002),
    ] {
        let refused = engine.set_parameter(name, value).unwrap_err().to_string();
        assert!(refused.contains(name), "{refused}");
    }
}

#[cfg(feature = "rapier")]
#[test]
fn the_second_engine_sags_and_drifts_alike() {
    use qv_sim::rapier::{Motion, compare_engines};
    fn run(parameters: &[(&str, f64)]) -> qv_sim::rapier::EngineDifference {
        let robot = wheels();
        let motion = Motion {
            start: &State { q: vec![0.0; 2], v: vec![0.0; 2] },
            duration: 0.5,
            kp: 60.0,
            kd: 2.0,
            target: &|t: f64| vec![0.5 * (20.0 * t).sin(), 0.3 * (15.0 * t).sin()],
            parameters,
        };
        let options = SimOptions { implicit_actuator_damping: false, ..Default::default() };
        compare_engines(&robot, &Terrain::none(), &options, &motion).unwrap()
    }
    let plain = run(&[]);
    for set in [[("supply.sag", 0.004)], [("actuator.one_axle.strength_drift", -1.0)]] {
        let found = run(&set);
        // Steps of other lengths part without any of it, too.
        assert!(found.joint_rms < 1.5 * plain.joint_rms, "{set:?}: {found} (plain: {plain})");
        let apart = (found.first.q[0] - plain.first.q[0]).abs();
        assert!(apart > 0.01, "{set:?} makes a difference of {apart} rad");
    }
}

#[cfg(feature = "rapier")]
#[test]
fn the_second_engine_has_the_same_spring() {
    use qv_sim::rapier::{Motion, RapierEngine, RapierOptions, compare_engines};
    let robot = wheel();
    let options = SimOptions { implicit_actuator_damping: false, ..Default::default() };
    let run = |parameters| {
        let start = State { q: vec![0.0], v: vec![0.0] };
        let target = |t: f64| vec![0.3 * (15.0 * t).sin()];
        let motion = Motion { start: &start, duration: 0.4, kp: 60.0, kd: 2.0, target: &target, parameters };
        compare_engines(&robot, &Terrain::none(), &options, &motion).unwrap()
    };
    let set = [("actuator.axle.series_compliance", 0.02), ("actuator.axle.lag", 0.004)];
    let found = run(&set);
    // Of a swing of 0.3 rad: rapier takes its steps in four parts.
    assert!(found.joint_rms < 2e-3, "{found}");
    let rigid = run(&set[1..]);
    let apart = (found.first.q[0] - rigid.first.q[0]).abs();
    assert!(apart > 0.02, "the spring makes a difference of {apart} rad");

    let mut engine = RapierEngine::new(&robot, &Terrain::none(), &RapierOptions::default()).unwrap();
    engine.set_parameter("actuator.axle.series_compliance", 0.01).unwrap();
    engine.set_parameter("sensor.axle.encoder_latency", 0.002).unwrap();
    engine.set_command(&JointCommand { q: &[0.0], dq: &[0.0], kp: &[0.0], kd: &[0.0], tau: &[2.0] }).unwrap();
    (0..5).for_each(|_| engine.step().unwrap());
    let past = 0.5 * 2.0 / INERTIA * 0.003f64.powi(2);
    near(engine.sensors().q[0], past + 0.02, 2e-4);
}
