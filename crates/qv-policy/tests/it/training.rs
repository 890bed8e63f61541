//! Trainings: the same bits on any number of threads and after an interruption; what goes wrong is named; robots other than
//! the Go2 train from their URDF and a few lines.

use crate::facts::States;
use qv_policy::PolicyError;
use qv_policy::env::{End, VectorEnv};
use qv_policy::policy::PolicyFile;
use qv_policy::ppo::PpoSettings;
use qv_policy::score::{Decide, score};
use qv_policy::train::{Checkpoint, TrainSettings, Training};
use qv_policy::velocity::{Commands, Ground, Randomise, RobotFile, TaskRobot, TaskSettings, VelocityTask, clock_input};
use std::path::Path;

fn small(seed: u64) -> TrainSettings {
    TrainSettings {
        seed,
        robots: 40,
        epoch: 3,
        score_every: 2,
        score_robots: 8,
        score_seconds: 2.0,
        task: TaskSettings { randomise: Randomise::robust("base"), ..Default::default() },
        ppo: PpoSettings { actor: vec![32], critic: vec![32], ..Default::default() },
    }
}

fn go2() -> TaskRobot {
    qv_go2::walk::robot().unwrap()
}

fn bits(training: &Training) -> Vec<u32> {
    training.ppo().parameters.iter().map(|x| x.to_bits()).collect()
}

fn trained(threads: usize, iterations: usize, seed: u64) -> Vec<u32> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let ground = Ground::bumps(0.04, seed).unwrap();
        let mut training = Training::new(&go2(), &ground, &small(seed)).unwrap();
        (0..iterations).for_each(|_| drop(training.advance().unwrap()));
        bits(&training)
    })
}

#[test]
fn the_file_of_robust_settings_has_those_of_the_option() {
    let (found, removed) = TrainSettings::parse(include_str!("../../../../fixtures/walk/robust.toml")).unwrap();
    assert!(removed.is_empty(), "{removed:?}");
    let task = TaskSettings { randomise: Randomise::robust("base"), ..Default::default() };
    assert_eq!(found, TrainSettings { task, ..Default::default() });
}

#[test]
fn same_bits_on_one_thread_and_on_three() {
    let one = trained(1, 4, 5);
    assert_eq!(one, trained(3, 4, 5));
    assert_ne!(one, trained(1, 4, 6), "another seed");
}

#[test]
fn a_training_that_is_taken_up_again_has_the_same_bits() {
    let ground = Ground::levels(0.2, 0.08, 1).unwrap();
    let mut whole = Training::new(&go2(), &ground, &small(9)).unwrap();
    let mut kept = None;
    for iteration in 0..8 {
        whole.advance().unwrap();
        if iteration == 4 {
            // In mid-epoch the checkpoint is that of the epoch's beginning.
            kept = Some(whole.checkpoint().to_bytes().unwrap());
        }
    }
    let kept = Checkpoint::from_bytes(&kept.unwrap()).unwrap();
    assert_eq!((kept.iterations, kept.epoch), (3, 1));
    let mut again = Training::resume(&go2(), &ground, &kept).unwrap();
    (0..5).for_each(|_| drop(again.advance().unwrap()));
    assert_eq!(bits(&again), bits(&whole));
    assert_eq!(again.checkpoint(), whole.checkpoint());
    assert_eq!(again.best().unwrap().0, whole.best().unwrap().0);
}

#[test]
fn damaged_checkpoints_are_named() {
    let training = Training::new(&go2(), &Ground::plane(), &small(1)).unwrap();
    let bytes = training.checkpoint().to_bytes().unwrap();
    assert_eq!(&Checkpoint::from_bytes(&bytes).unwrap(), training.checkpoint());
    let mut not_finite = bytes.clone();
    let end = not_finite.len();
    not_finite[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    for (damaged, said) in [
        (&bytes[..bytes.len() - 3], "bytes of numbers"),
        (&bytes[..20], "no line of JSON"),
        (b"{}\n", "missing field"),
        (&not_finite[..], "is NaN"),
    ] {
        let error = Checkpoint::from_bytes(damaged).unwrap_err().to_string();
        assert!(error.contains("checkpoint") && error.contains(said), "{error}");
    }
    let bumps = Ground::bumps(0.04, 1).unwrap();
    let error = Training::resume(&go2(), &bumps, training.checkpoint()).map(|_| ()).unwrap_err().to_string();
    assert!(error.states("ground") && error.states("ground"), "{error}");
    let mut stiff = go2();
    stiff.kp[0] *= 2.0;
    assert!(Training::resume(&stiff, &Ground::plane(), training.checkpoint()).is_err(), "other gains");
    let mut again = Training::new(&go2(), &Ground::plane(), &small(1)).unwrap();
    let error = again.start_from(training.checkpoint()).unwrap_err().to_string();
    assert!(error.states("iteration 0"), "nothing is learnt there: {error}");
    let other = TrainSettings { ppo: PpoSettings::default(), ..small(1) };
    let mut kept = training.checkpoint().clone();
    kept.settings = other;
    assert!(matches!(Training::resume(&go2(), &Ground::plane(), &kept), Err(PolicyError::Mismatch(_))));
}

#[test]
fn what_is_not_finite_stops_a_training_with_its_name() {
    let mut training = Training::new(&go2(), &Ground::plane(), &small(2)).unwrap();
    training.advance().unwrap();
    training.ppo_mut().parameters[0] = f32::NAN;
    let error = training.advance().map(|_| ()).unwrap_err();
    assert!(matches!(&error, PolicyError::NotFinite { iteration: 1, term, .. } if term == "action"), "{error}");

    let mut settings = small(2);
    settings.task.reward.torque = f32::MAX;
    let mut training = Training::new(&go2(), &Ground::plane(), &settings).unwrap();
    let error = training.advance().map(|_| ()).unwrap_err();
    assert!(error.to_string().states("`torque`"), "{error}");
}

#[test]
fn settings_that_mean_nothing_are_named() {
    type Change = fn(&mut TrainSettings);
    let changes: [(Change, &str); 11] = [
        (|s| s.task.reward.fall = f32::NAN, "task.reward.fall"),
        (|s| s.task.noise.gyro = -1.0, "half widths"),
        (|s| s.score_seconds = 1.01, "score_seconds"),
        (|s| s.robots = 0, "robots"),
        (|s| s.task.rate = f32::NAN, "rate"),
        (|s| s.task.commands.vx = [1.0, 0.0], "commands.vx"),
        (|s| s.ppo.clip = 0.0, "clip"),
        (|s| s.ppo.actor = vec![0], "size of a layer"),
        (|s| s.task.reward.velocity_width = 0.0, "velocity_width"),
        (|s| s.task.randomise.parameters = [("contact.friction".into(), [1.0, 0.0])].into(), "contact.friction"),
        (|s| s.task.randomise.parameters = [("joint.*.magic".into(), [0.0, 1.0])].into(), "joint.*.magic"),
    ];
    for (change, named) in changes {
        let mut settings = small(0);
        change(&mut settings);
        let error = Training::new(&go2(), &Ground::plane(), &settings).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(named), "{named}: {error}");
    }
    let error = Ground::bumps(3.0, 0).map(|_| ()).unwrap_err().to_string();
    assert!(error.states("height") && error.contains('3'), "{error}");
}

#[test]
fn the_mirror_of_a_stand_is_that_stand_under_the_mirrored_command() {
    // Half a stride is 20 decisions.
    let settings = TaskSettings { clock: 1.25, ..Default::default() };
    let see = |command: [f32; 3]| {
        let mut task = VelocityTask::new(go2(), Ground::plane(), settings.clone(), 1).unwrap();
        task.judged = true;
        task.restart(0, 0).unwrap();
        task.command(0, command);
        let (mut seen, mut known) = (vec![0.0; task.observations()], vec![0.0; task.privileged()]);
        task.observe(&mut seen, &mut known);
        (seen, known, task.symmetry().unwrap())
    };
    let (seen, known, symmetry) = see([0.5, 0.2, 0.3]);
    let (mut left_seen, mut left_known, _) = see([0.5, -0.2, -0.3]);
    // The image of a clock is half a stride on.
    let clock = clock_input(1.25, 50.0, 20, [0.5, -0.2, -0.3]);
    assert_eq!(seen[45..], [0.0, 1.0]);
    [&mut left_seen, &mut left_known].into_iter().for_each(|row| row[45..47].copy_from_slice(&clock));
    for (map, row, expected) in
        [(&symmetry.observation, &seen, &left_seen), (&symmetry.privileged, &known, &left_known)]
    {
        assert_eq!(map.index.len(), row.len());
        let mut image = vec![0.0; row.len()];
        map.apply(row, &mut image);
        let off = image.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 1e-4, "{off}");
    }
    // A lop-sided robot has no images.
    let mut robot = go2();
    robot.kp[0] *= 1.5;
    let task = VelocityTask::new(robot, Ground::plane(), TaskSettings::default(), 1).unwrap();
    assert!(task.symmetry().is_none());
}

#[test]
fn settings_of_an_earlier_version_are_read_and_unknown_ones_named() {
    let (settings, removed) = TrainSettings::parse("[task.reward]\nair = 8.0\nleast = -0.2\nstill = 1.5\n").unwrap();
    assert_eq!((settings.task.reward.still, removed), (1.5, vec!["air", "least"]));
    let error = TrainSettings::parse("[task.reward]\nstil = 1.5\n").unwrap_err().to_string();
    assert!(error.contains("stil") && error.contains("still"), "{error}");
}

#[test]
fn whole_settings_of_an_earlier_version_have_no_clock() {
    let mut table = toml::Table::try_from(TrainSettings::default()).unwrap();
    let task = table.get_mut("task").and_then(toml::Value::as_table_mut).unwrap();
    assert!(task.remove("clock").is_some());
    let clock = |table: &toml::Table| TrainSettings::parse(&table.to_string()).unwrap().0.task.clock;
    assert_eq!(clock(&table), 0.0);
    // A file of a few settings is of today.
    assert_eq!(clock(&toml::from_str("[task.reward]\nstill = 1.5\n").unwrap()), TaskSettings::default().clock);
}

#[test]
fn a_robot_whose_model_is_an_mjcf_takes_its_place() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/mjcf");
    let text = "urdf = \"biped.xml\"\nlegs = [\"a\", \"b\"]\njoints = [\"roll\", \"pitch\", \"knee\"]\n\
                feet = [\"a_foot\", \"b_foot\"]\nmust_not_touch = [\"thigh\"]\nkp = 30.0\nkd = 1.0\n\
                stand = { roll = 0.0, pitch = 0.6, knee = -1.2 }\n";
    let file = RobotFile::parse(text).unwrap();
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).map_err(|e| e.to_string());
    let model = read(&file.urdf).unwrap();
    let robot = file.robot_with(&model, &read).unwrap();
    assert_eq!((robot.joints(), robot.feet.len()), (6, 2));
    assert!(robot.height > 0.3 && robot.height < 0.6, "{} m", robot.height);
    let mut task = VelocityTask::new(robot, Ground::plane(), TaskSettings::default(), 1).unwrap();
    task.restart(0, 0).unwrap();
    let alone = file.robot(&model).map(|_| ()).unwrap_err().to_string();
    assert!(alone.contains("legs.xml"), "{alone}");
}

#[test]
fn other_robots_stand_on_their_feet_and_learn() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots");
    for name in ["go1", "a1", "a2", "anymal_c"] {
        let read = |file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
        let file = RobotFile::parse(&read(&format!("{name}.toml"))).unwrap();
        let robot = file.robot(&read(&file.urdf)).unwrap();
        assert_eq!((robot.feet.len(), robot.joints()), (4, 12), "{name}");
        assert!(!robot.trunk.is_empty() && !robot.limbs.is_empty(), "{name}");
        // At rest under its own gains: nothing but feet touches, and it neither falls nor sinks by more than a third (gains are soft).
        let mut task = VelocityTask::new(robot.clone(), Ground::plane(), TaskSettings::default(), 2).unwrap();
        task.judged = true;
        task.restart(0, 0).unwrap();
        let (mut rewards, mut ends) = ([0.0; 2], [End::No; 2]);
        for _ in 0..100 {
            task.step(&[0.0; 24], &mut rewards, &mut ends).unwrap();
            assert_eq!(ends, [End::No; 2], "{name} falls");
        }
        let height = task.motion().0[2];
        assert!((height / robot.height - 1.0).abs() < 0.34, "{name}: {height} m for {} m", robot.height);
        let mut settings = small(3);
        settings.task.randomise = Randomise::default();
        let mut training = Training::new(&robot, &Ground::plane(), &settings).unwrap();
        assert!(training.advance().unwrap().iteration.reward.is_finite(), "{name}");
    }
}

#[test]
fn robot_files_that_do_not_fit_are_named() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots");
    let text = std::fs::read_to_string(folder.join("go1.toml")).unwrap();
    let urdf = std::fs::read_to_string(folder.join("go1.urdf")).unwrap();
    for (from, to, said) in [
        ("hip_joint = 0.0", "hop_joint = 0.0", "hop_joint"),
        ("\"FL_foot\"", "\"FL_hoof\"", "FL_hoof"),
        ("kp = 35.0", "kp = -1.0", "kp"),
        ("calf_joint = -1.8", "calf_joint = 3.0", "stand of `FL_calf_joint`"),
        ("[\"FL\", \"FR\"", "[\"FR\", \"FL\"", "legs and joints"),
        ("kp = 35.0", "kp = 35.0\nspeed = 3", "speed"),
        ("kd = 0.5", "kd = -0.5", "kd"),
        ("armature = 0.01", "armature = nan", "armature"),
        ("\"FL_foot\"", "\"\"", "feet"),
        ("\"FL_foot\"", "\"trunk\"", "feet"),
    ] {
        let changed = text.replacen(from, to, 1);
        assert_ne!(changed, text, "{from} is there");
        let error = RobotFile::parse(&changed).and_then(|f| f.robot(&urdf)).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(said), "{said}: {error}");
    }
}

#[test]
fn policies_of_other_robots_and_damaged_files_are_named() {
    let robot = go2();
    let good = PolicyFile::new(&robot, &TaskSettings::default(), "plane", None);
    assert_eq!(PolicyFile::parse(&good.to_text().unwrap()).unwrap(), good);
    good.check(&robot).unwrap();
    type Change = fn(&mut PolicyFile);
    let changes: [(Change, &str); 6] = [
        (|f| f.robot = "go1".into(), "one of go1"),
        (|f| f.action_scale.clear(), "action_scale"),
        (|f| f.kp[3] = f32::NAN, "kp"),
        (|f| f.timestep = 0.0, "timestep"),
        (|f| f.clock = -1.0, "clock"),
        (|f| f.joints.swap(0, 1), "FR_hip_joint"),
    ];
    for (change, named) in changes {
        let mut file = good.clone();
        change(&mut file);
        let error = file.check(&robot).unwrap_err().to_string();
        assert!(error.contains("policy.toml") && error.contains(named), "{named}: {error}");
    }
}

#[test]
fn files_of_earlier_versions_have_no_clock() {
    let robot = go2();
    let text =
        PolicyFile::new(&robot, &TaskSettings { clock: 1.65, ..Default::default() }, "plane", None).to_text().unwrap();
    assert!(text.contains("clock = 1."), "{text}");
    let old: Vec<&str> = text.lines().filter(|line| !line.starts_with("clock = ")).collect();
    assert_eq!(PolicyFile::parse(&old.join("\n")).unwrap().clock, 0.0);
    let mut settings = small(1);
    settings.task.clock = 0.0;
    let kept = Training::new(&robot, &Ground::plane(), &settings).unwrap().checkpoint().clone();
    let bytes = kept.to_bytes().unwrap();
    let end = bytes.iter().position(|&b| b == b'\n').unwrap();
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    // The first one is the task's; the reward's weight stays.
    let old = header.replacen("\"clock\":0.0,", "", 1);
    assert_eq!(old.len() + 12, header.len());
    let read = Checkpoint::from_bytes(&[old.as_bytes(), &bytes[end..]].concat()).unwrap();
    assert_eq!(read, kept);
}

#[test]
fn a_clock_runs_while_the_robot_is_commanded_to_move() {
    let settings = TaskSettings { clock: 1.25, ..Default::default() };
    let mut task = VelocityTask::new(go2(), Ground::plane(), settings, 1).unwrap();
    task.judged = true;
    task.restart(0, 0).unwrap();
    let (mut seen, mut known) = (vec![0.0; task.observations()], vec![0.0; task.privileged()]);
    assert_eq!(seen.len(), 47);
    for decision in 0..60 {
        let command = if decision < 40 { [0.5, 0.0, 0.0] } else { [0.0; 3] };
        task.command(0, command);
        task.observe(&mut seen, &mut known);
        let expected = clock_input(1.25, 50.0, decision, command);
        assert!(seen[45..].iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-5), "{decision}: {seen:?}");
        assert_eq!(seen[45..], known[45..47]);
        task.step(&[0.0; 12], &mut [0.0], &mut [End::No]).unwrap();
    }
    assert_eq!(seen[45..], [0.0, 0.0]);
    assert!(clock_input(0.0, 50.0, 7, [0.5, 0.0, 0.0]).is_empty());
}

/// Holds the stand, or throws the robot over.
struct Always(f32);

impl Decide for Always {
    fn decide(&mut self, _: usize, _: &[f32], actions: &mut [f32]) -> Result<(), PolicyError> {
        actions.fill(self.0);
        Ok(())
    }
}

#[test]
fn who_falls_at_once_scores_like_one_that_lies_still() {
    let mut task = VelocityTask::new(go2(), Ground::plane(), TaskSettings::default(), 8).unwrap();
    let commands = Commands { vx: [0.5, 0.5], vy: [0.0; 2], wz: [0.3, 0.3], ..Default::default() };
    let still = score(Always(0.0), &mut task, &commands, 2.0, 0).unwrap();
    assert_eq!(still.fell, 0);
    assert!((still.velocity_error - 0.5).abs() < 0.05, "{still:?}");
    let thrown = score(Always(8.0), &mut task, &commands, 2.0, 0).unwrap();
    assert_eq!(thrown.fell, 8);
    assert!((thrown.velocity_error - 0.5).abs() < 1e-6 && thrown.cost() > 100.0, "{thrown:?}");
    assert!(score(Always(0.0), &mut task, &commands, 0.5, 0).is_err(), "the first second does not count");
}
