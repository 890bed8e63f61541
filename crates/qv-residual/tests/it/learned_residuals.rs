//! Learned compensators on a made-up robot: weak motors that sway about the stand.

use crate::facts::States;
use qv_policy::compensate::Compensator;
use qv_policy::onnx::OnnxPolicy;
use qv_policy::velocity::{Ground, TaskRobot, TaskSettings};
use qv_residual::log::{Log, Stretch};
use qv_residual::residual::reinforce::{self, ReinforceSettings};
use qv_residual::residual::supervised::{train_position, train_torque};
use qv_residual::residual::{ResidualNet, SupervisedSettings};
use qv_residual::windows::{Lane, Replayer, Window, windows};
use qv_residual::{ResidualError, residual::NetKind};
use qv_sim::{Batch, BatchCommand, SimOptions, State};

const DECISIONS: usize = 120;

/// A robot whose motors deliver 0.7 of the torque that they should, and rub.
fn sway(robot: &TaskRobot, task: &TaskSettings) -> Log {
    let mut log = Log::new(robot, task);
    let joints = robot.joints();
    let options = SimOptions { timestep: log.timestep(), ..Default::default() };
    for stretch in 0..4u8 {
        let mut batch = Batch::<f32>::new(&robot.model, &Ground::plane().terrain, &options, 1).unwrap();
        for name in robot.model.joint_names() {
            batch.set_parameter(0, &format!("actuator.{name}.strength"), 0.7).unwrap();
            batch.set_parameter(0, &format!("joint.{name}.coulomb_friction"), 0.5).unwrap();
        }
        let mut q = vec![0.0, 0.0, f64::from(robot.height), 1.0, 0.0, 0.0, 0.0];
        q.extend(robot.stand.iter().map(|&x| f64::from(x)));
        batch.set_state(0, &State { q, v: vec![0.0; 6 + joints] }).unwrap();
        let (mut targets, mut states) = (Vec::new(), Vec::new());
        let keep = |batch: &Batch<f32>, states: &mut Vec<f32>| {
            let state = batch.state(0).unwrap();
            states.extend(state.q.iter().chain(&state.v).map(|&x| x as f32));
        };
        keep(&batch, &mut states);
        for decision in 0..DECISIONS {
            let time = decision as f32 / log.rate;
            let pace = 1.0 + 0.4 * f32::from(stretch);
            let target: Vec<f32> = (0..joints)
                .map(|j| robot.stand[j] + 0.15 * (std::f32::consts::TAU * pace * time + 2.1 * j as f32).sin())
                .collect();
            for _ in 0..log.substeps {
                targets.extend(&target);
                let command = BatchCommand { q: &target, dq: None, kp: &robot.kp, kd: &robot.kd, tau: None };
                batch.set_commands(&command).unwrap();
                batch.step();
            }
            keep(&batch, &mut states);
        }
        log.stretches.push(Stretch { recording: format!("sway {stretch}"), start: 0.0, targets, states });
    }
    log
}

struct Case {
    robot: TaskRobot,
    ground: Ground,
    task: TaskSettings,
    log: Log,
}

impl Case {
    fn new() -> Self {
        let (robot, task) = (qv_go2::walk::robot().unwrap(), TaskSettings::default());
        let log = sway(&robot, &task);
        Self { robot, ground: Ground::plane(), task, log }
    }

    fn replayer(&self) -> Replayer<'_> {
        Replayer::new(&self.log, &self.robot, &self.ground.terrain, &self.task)
    }

    /// Joint error on the stretch that nothing is trained on.
    fn held_out(&self, net: Option<&ResidualNet>) -> f64 {
        let held = windows(&self.log, 20, |k| k == 1);
        let lanes: Vec<Lane> = (0..held.len()).map(|window| Lane { window, ..Default::default() }).collect();
        let compensator: Option<Box<dyn Compensator>> =
            net.map(|net| net.compensator(&self.robot, self.log.substeps, lanes.len()).unwrap());
        self.replayer().replay(&held, &lanes, 20, compensator).unwrap().joints()
    }

    fn training(&self) -> Vec<Window> {
        windows(&self.log, 10, |k| k != 1)
    }
}

/// The same on one thread and on three.
fn on_threads<T: PartialEq + std::fmt::Debug + Send>(run: impl Fn() -> T + Sync) -> T {
    let with = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(&run);
    let one = with(1);
    assert_eq!(one, with(3), "bits depend on threads");
    one
}

fn small() -> SupervisedSettings {
    SupervisedSettings { rounds: 1, length: 10, windows: 30, passes: 40, hidden: vec![32, 32], ..Default::default() }
}

#[test]
fn taught_nets_help_where_they_were_not_taught() {
    let case = Case::new();
    let (training, lane) = (case.training(), Lane::default());
    let nominal = case.held_out(None);
    assert!(nominal > 0.01, "the made-up robot must differ: {nominal}");
    let teach = |kind: NetKind| {
        let replayer = case.replayer();
        match kind {
            NetKind::Position => train_position(&replayer, &training, &lane, &small(), |_| {}),
            NetKind::Torque => train_torque(&replayer, &training, &lane, &small(), |_| {}),
        }
        .unwrap()
    };
    for kind in [NetKind::Position, NetKind::Torque] {
        let net = on_threads(|| teach(kind));
        let found = case.held_out(Some(&net));
        assert!(found < 0.6 * nominal, "{kind:?}: {found} rad of {nominal}");
        let file = serde_json::to_string(&net).unwrap();
        let again: ResidualNet = serde_json::from_str(&file).unwrap();
        assert_eq!(again, net, "a file keeps all bits");
        let onnx = OnnxPolicy::from_bytes(&net.to_onnx(&case.robot, &[]).unwrap()).unwrap();
        let outputs = if kind == NetKind::Position { 12 } else { 1 };
        assert_eq!(onnx.outputs()[0].shape.last(), Some(&Some(outputs)), "{:?}", onnx.outputs());
    }
}

#[test]
fn reinforced_nets_earn_more_and_start_from_others() {
    let case = Case::new();
    let (training, lane) = (case.training(), Lane::default());
    let mut settings = ReinforceSettings { iterations: 6, robots: 48, ..Default::default() };
    settings.ppo.actor = vec![32, 32];
    settings.ppo.critic = vec![32, 32];
    let run = |start: Option<&ResidualNet>| {
        let mut rewards = Vec::new();
        let notify = |done: &reinforce::ReinforceIteration| rewards.push(done.iteration.reward);
        let net = reinforce::train(&case.replayer(), &training, &lane, start, &settings, notify).unwrap();
        (net, rewards)
    };
    let (net, rewards) = on_threads(|| run(None));
    assert_eq!(rewards.len(), 6);
    let taught = train_position(&case.replayer(), &training, &lane, &small(), |_| {}).unwrap();
    let (_, from_taught) = run(Some(&taught));
    assert!(from_taught[0] > rewards[0], "a taught net begins higher: {from_taught:?} {rewards:?}");
    assert!(net.weights.iter().all(|w| w.is_finite()));
    settings.ppo.actor = vec![16];
    let wrong = reinforce::train(&case.replayer(), &training, &lane, Some(&net), &settings, |_| {});
    assert!(matches!(wrong, Err(ResidualError::Input(_))), "other sizes are refused");
}

#[test]
fn what_does_not_fit_is_named() {
    let case = Case::new();
    let (replayer, lane) = (case.replayer(), Lane::default());
    let remarks = |found: Result<ResidualNet, ResidualError>| found.unwrap_err().to_string();
    let none = remarks(train_position(&replayer, &[], &lane, &small(), |_| {}));
    assert!(none.states("training"), "{none}");
    let late = [Window { stretch: 0, decision: DECISIONS - 5 }];
    assert!(remarks(train_torque(&replayer, &late, &lane, &small(), |_| {})).states("room"));
    let bad = SupervisedSettings { error: f64::NAN, ..small() };
    assert!(remarks(train_position(&replayer, &case.training(), &lane, &bad, |_| {})).starts_with("error"));
    let quick = SupervisedSettings { rounds: 0, passes: 1, windows: 2, ..small() };
    let net = train_position(&replayer, &case.training(), &lane, &quick, |_| {}).unwrap();
    let broken = |change: &dyn Fn(&mut ResidualNet)| {
        let mut net = net.clone();
        change(&mut net);
        net.compensator(&case.robot, case.log.substeps, 1).err().expect("refused").to_string()
    };
    assert!(broken(&|net| net.weights[3] = f32::NAN).states("weight 3"));
    assert!(broken(&|net| net.weights.truncate(10)).contains("weights"));
    assert!(broken(&|net| net.robot = "go1".into()).contains("go1"));
    assert!(broken(&|net| net.kind = NetKind::Torque).contains("sizes"));
    assert!(broken(&|net| net.sizes = vec![0]).contains("sizes"));
    assert!(broken(&|net| net.clip = f32::INFINITY).contains("clip"));
}
