//! Recordings of a simulated Go2 whose cause is known, through the whole diagnosis.

use crate::facts::States;
use crate::recorded::{go2, read, recorded};
use qv_gap::checks::stationarity::fading;
use qv_gap::inference::level::level;
use qv_gap::inference::linearised::{LinearisedProblem, NullOptions};
use qv_gap::inference::search::Search;
use qv_gap::problem::columns::{Columns, Group};
use qv_gap::problem::library::Effect;
use qv_gap::problem::{library, rollout_of};
use qv_gap::report::{Report, UNKNOWN, Verdict};
use qv_gap::{Options, diagnose};
use qv_go2::synthetic;
use qv_recording::Run;
use qv_recording::gaps::without_gaps;
use qv_recording::run::{Fault, FaultKind};
use qv_rollout::compare;
use qv_rollout::law;
use qv_rollout::{Legs, SensorErrors, Starts, feet_of};
use qv_rollout::{Rollout, WindowOptions};
use qv_sealed::{EngineChoice, FaultRequest, Plan, Recipe, Request, Section};
use qv_sim::{Model, Terrain};

/// Fewer windows and simulated recordings than by default: these tests are run often.
fn quick() -> Options<'static> {
    Options {
        cut: WindowOptions { most: 32, ..Default::default() },
        effort: NullOptions { replicates: 6, ..Default::default() },
        ..Default::default()
    }
}

fn of(run: &Run, options: &Options) -> Report {
    let report = diagnose(std::slice::from_ref(run), &go2(), &Terrain::plane(), options, 0).unwrap().report;
    let total: f64 = report.ranking.iter().map(|r| r.score).sum();
    assert!((0.0..1.001).contains(&total), "{:?}", report.ranking);
    report
}

#[test]
fn a_latency_of_two_policy_steps_is_named_with_its_size() {
    // Far beyond where the slope at a few milliseconds leads.
    let report = of(&recorded(synthetic::command_latency(0.041), 4), &quick());
    assert_eq!(report.causes.len(), 1, "{}", report.sentence);
    let cause = &report.causes[0];
    assert_eq!((cause.effect.as_str(), cause.scope[0].as_str()), ("command_latency", "all"));
    assert!((cause.parameters[0].value - 0.041).abs() < 0.002, "{:?}", cause.parameters);
    assert!(report.gap.closed > 0.9, "{:?}", report.gap);
}

#[test]
fn a_latency_is_named_with_its_size_and_closes_the_gap() {
    let run = recorded(synthetic::command_latency(0.012), 4);
    let report = of(&run, &quick());
    assert_eq!(report.verdict, Verdict::Explained, "{}", report.sentence);
    assert_eq!(report.causes.len(), 1);
    let cause = &report.causes[0];
    assert_eq!((cause.effect.as_str(), cause.scope[0].as_str()), ("command_latency", "all"));
    assert_eq!(cause.parameters[0].name, "command_latency");
    assert!((cause.parameters[0].value - 0.012).abs() < 0.001, "{:?}", cause.parameters);
    assert!(report.gap.heldout && report.gap.closed > 0.9, "{:?}", report.gap);
    assert_eq!(report.corrections.len(), 12);
    let most = report.place.interfaces.iter().max_by(|a, b| a.share.total_cmp(&b.share)).unwrap();
    assert_eq!(most.name, "actuator");
    let shares: f64 = report.place.joints.iter().map(|j| j.share).sum();
    assert!((shares - 1.0).abs() < 1e-9);
}

#[test]
fn sealed_answers_and_the_library_mean_the_same_interface() {
    let effects = library::built_in();
    let known = effects.iter().filter_map(|e| Some((e, qv_sealed::interface(&e.name)?)));
    let pairs: Vec<(String, &str, &str)> = known.map(|(e, said)| (e.name.clone(), e.interface.name(), said)).collect();
    assert_eq!(pairs.len(), qv_sealed::EFFECTS.len());
    pairs.iter().for_each(|(name, ours, said)| assert_eq!(ours, said, "{name}"));
}

#[test]
fn half_a_tick_of_a_latency_is_not_taken_for_the_recorders() {
    let alignment = |latency: f64| {
        let run = recorded(synthetic::command_latency(latency), 4);
        let (model, plane) = (go2(), Terrain::plane());
        let rollout =
            Rollout::new(&run, &model, &plane, &[], WindowOptions { most: 12, ..Default::default() }).unwrap();
        let windows = rollout.windows(&run).unwrap();
        law::align(&rollout, &windows.iter().collect::<Vec<_>>())
    };
    assert_eq!(alignment(0.012), alignment(0.0));
    assert_eq!(alignment(0.0071), alignment(0.0));
}

/// The robot as it is with a command latency that is known already \[s\], and what may be suspected of it.
fn late<'a>(run: &Run, model: &'a Model, latency: f64, library: &[Effect]) -> (Rollout<'a>, Columns) {
    let known: Vec<(String, f64)> =
        model.joint_names().iter().map(|j| (format!("actuator.{j}.command_latency"), latency)).collect();
    let rollout = Rollout::new(run, model, &Terrain::plane(), &known, quick().cut).unwrap();
    let columns = Columns::new(&rollout, run, library).unwrap();
    (rollout, columns)
}

/// What the search asks for beside the known command latency \[s\].
fn asked_for(study: &mut LinearisedProblem) -> f64 {
    let is_all = |g: &Group| study.columns.effects[g.effect].name == "command_latency" && g.members.len() == 12;
    let group = study.columns.groups.iter().position(is_all).unwrap();
    let mut search = Search::new(study, 1.0).unwrap();
    let base = search.base(&[]).unwrap();
    let fit = search.refined(&base, group).unwrap().expect("something to gain");
    assert!(fit.loss < base.loss);
    fit.suspect.values[0]
}

#[test]
fn a_size_that_stopped_short_is_completed_in_the_corrected_robot() {
    let (run, model) = (recorded(synthetic::command_latency(0.012), 4), go2());
    let Options { effort, library, .. } = quick();
    let (rollout, columns) = late(&run, &model, 0.009, &library);
    let mut study = LinearisedProblem::new(rollout, columns, std::slice::from_ref(&run), &[], &effort).unwrap();
    let asked = asked_for(&mut study);
    assert!((asked - 0.003).abs() < 0.001, "{asked}");
}

#[test]
fn a_study_that_is_moved_says_what_a_new_one_says() {
    let (run, model) = (recorded(synthetic::command_latency(0.012), 4), go2());
    let Options { effort, library, .. } = quick();
    let new = |latency: f64| {
        let (rollout, columns) = late(&run, &model, latency, &library);
        LinearisedProblem::new(rollout, columns, std::slice::from_ref(&run), &[], &effort).unwrap()
    };
    let (rollout, columns) = late(&run, &model, 0.010, &library);
    let (before, mut anew) = (new(0.009), new(0.010));
    let steps = before.steps();
    let mut moved = before.moved(rollout, columns).unwrap().expect("the same columns");
    assert!(moved.steps() - steps < anew.steps() / 2, "{} and {}", moved.steps() - steps, anew.steps());
    assert_eq!(moved.tolerance, anew.tolerance);
    assert!(moved.seen.iter().zip(&anew.seen).all(|(a, b)| a.raw == b.raw));
    let levels = [&moved, &anew].map(|s| level(s).unwrap().ratio);
    assert!((levels[0] / levels[1] - 1.0).abs() < 0.1, "{levels:?}");
    let asked = [&mut moved, &mut anew].map(asked_for);
    // Half a tick of the simulator: the sensitivities of the one are those at another latency.
    assert!((asked[0] - asked[1]).abs() < 0.0005, "{asked:?}");
    // With another library there is nothing to keep.
    let fewer: Vec<Effect> = library.iter().filter(|e| e.name != "payload_mass").cloned().collect();
    let (rollout, columns) = late(&run, &model, 0.010, &fewer);
    assert!(moved.moved(rollout, columns).unwrap().is_none());
}

#[test]
fn a_cause_that_only_imitates_another_is_doubted() {
    // A gain that is too low does to one leg much of what a lag does, but its law is another.
    let run = recorded(["hip", "thigh", "calf"].map(|j| (format!("actuator.RL_{j}_joint.lag"), 0.009)).to_vec(), 4);
    let without = ["actuator_lag", "command_latency", "observation_latency"].map(String::from).to_vec();
    let report = of(&run, &Options { without, ..quick() });
    assert_eq!(report.verdict, Verdict::Unexplained, "{}", report.sentence);
    assert_eq!(report.ranking[0].effect, UNKNOWN);
    assert!(report.causes.is_empty() && report.corrections.is_empty());
    // A gain that stands for a lag changes with speed; or the lag is asked for beside it.
    let reports = |line: &String| line.states("changes speed") || line.states("actuator");
    let doubted = report.next.iter().any(|line| line.starts_with("Not identified: motor_gain_kd") && reports(line));
    assert!(doubted, "{:?}", report.next);
}

#[test]
fn a_push_that_is_not_one_force_is_told() {
    let force = [("external.force_x", 9.0), ("external.start", 8.0), ("external.duration", 6.0)];
    let run = recorded(force.map(|(name, value)| (name.into(), value)).to_vec(), 4);
    let (model, Options { effort, library, .. }) = (go2(), quick());
    let rollout = Rollout::new(&run, &model, &Terrain::plane(), &[], WindowOptions::default()).unwrap();
    let columns = Columns::new(&rollout, &run, &library).unwrap();
    let study = LinearisedProblem::new(rollout, columns, std::slice::from_ref(&run), &[], &effort).unwrap();
    let is_force = |g: &&Group| study.columns.effects[g.effect].name == "external_force";
    let group = study.columns.groups.iter().find(is_force).unwrap();
    let fading = |from, until| fading(&study, "external_force", group, &[9.0, 0.0, 0.0], [from, until]);
    let whole = fading(8.0, 14.0).unwrap();
    assert!(whole.errors.abs() < 3.0, "{whole:?}");
    // As if it had pulled from 4 s on: it comes late in that time.
    let late = fading(4.0, 14.0).unwrap();
    assert!(late.errors > 4.0 && late.change > 0.5, "{late:?}");
    assert_eq!(fading(8.0, 9.0), None, "too few windows");
}

#[test]
fn play_in_a_joint_is_told_by_its_torques() {
    let run = recorded(vec![("actuator.FR_hip_joint.backlash".into(), 0.015)], 4);
    let report = of(&run, &quick());
    let cause = report.causes.first().unwrap_or_else(|| panic!("{}", report.sentence));
    assert_eq!((cause.effect.as_str(), &cause.scope[..]), ("backlash", &["FR_hip_joint".to_string()][..]));
    assert!((cause.parameters[0].value - 0.015).abs() < 0.002, "{:?}", cause.parameters);
}

#[test]
fn an_effect_that_is_left_out_is_no_tolerated_deviation_either() {
    // Its own tolerance takes most of a bias of the gyroscope upon itself.
    let run = recorded(vec![("sensor.imu.gyro_bias_y".into(), 0.09)], 4);
    let diagnosis = diagnose(&[run], &go2(), &Terrain::plane(), &quick(), 1).unwrap();
    assert_eq!(diagnosis.report.causes.first().map(|c| c.effect.as_str()), Some("gyro_bias"));
    let (effect, without, _) = &diagnosis.without[0];
    assert_eq!((effect.as_str(), without.verdict), ("gyro_bias", Verdict::Unexplained), "{}", without.sentence);
    assert!(without.rounds[0].level > 1.5 * diagnosis.report.rounds[0].level);
    assert!(!without.ranking.iter().any(|r| r.effect == "gyro_bias"));
}

/// A torque that is stuck costs its channel, a pose that jumps the windows it jumps in.
#[test]
fn a_robot_without_an_effect_is_not_accused_for_a_dead_channel_or_a_pose_that_jumps() {
    let mut run = recorded(Vec::new(), 5);
    let pose = run.measured.base_pose.as_mut().unwrap();
    let joints = pose.joints;
    for (row, time) in pose.values.chunks_mut(joints).zip(&pose.time) {
        // A loop that is closed every five seconds.
        row[0] += 0.6 * (time / 5.0).floor();
    }
    let torque = run.measured.torque.as_mut().unwrap();
    let joints = torque.joints;
    torque.values.iter_mut().skip(3).step_by(joints).for_each(|x| *x = 0.7);
    run.faults.push(Fault {
        kind: FaultKind::Frozen,
        channel: "torque FR_hip_joint".into(),
        time: 0.0,
        count: 9000,
        detail: "for the whole run".into(),
    });
    let report = of(&run, &quick());
    assert_eq!(report.verdict, Verdict::NoGap, "{}", report.sentence);
    assert!(report.causes.is_empty());
    assert!(report.cannot_tell.iter().any(|line| line.states("FR_hip_joint")), "{:?}", report.cannot_tell);
}

#[test]
fn the_same_run_gives_the_same_report() {
    let run = recorded(Vec::new(), 6);
    let options = Options { cut: WindowOptions { most: 12, ..Default::default() }, ..quick() };
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (first, second) = (of(&run, &options), one.install(|| of(&run, &options)));
    // As text: traces have gaps, and a gap is not equal to itself.
    assert!(format!("{first:?}") == format!("{second:?}"), "the reports differ");
}

#[test]
fn a_run_that_is_too_short_is_refused_by_name() {
    let run = recorded(Vec::new(), 5);
    let short = qv_rollout::channels::snippet(&run, 0.0, 1.5);
    let error = diagnose(&[short], &go2(), &Terrain::plane(), &quick(), 0).err().unwrap().to_string();
    assert!(error.states("windows 8"), "{error}");
    assert!(diagnose(&[], &go2(), &Terrain::plane(), &quick(), 0).is_err());
}

#[test]
fn single_values_that_are_missing_and_kilometres_from_the_origin_cost_nothing() {
    let mut run = recorded(synthetic::command_latency(0.012), 4);
    for row in run.measured.base_pose.as_mut().unwrap().values.chunks_exact_mut(7) {
        (row[0], row[1]) = (row[0] + 5000.0, row[1] + 3000.0);
    }
    let blank = |series: &mut Option<qv_core::JointSeries>, every: usize| {
        series.iter_mut().for_each(|s| s.values.iter_mut().step_by(every).for_each(|x| *x = f64::NAN));
    };
    // Coprime to the number of columns: all of them, now and then.
    blank(&mut run.commands.position, 101);
    blank(&mut run.measured.position, 103);
    blank(&mut run.measured.velocity, 107);
    blank(&mut run.measured.torque, 109);
    blank(&mut run.measured.base_pose, 113);
    blank(&mut run.measured.gyro, 127);
    let report = of(&run, &quick());
    assert_eq!(report.verdict, Verdict::Explained, "{}", report.sentence);
    assert_eq!(report.causes[0].effect, "command_latency");
    assert!((report.causes[0].parameters[0].value - 0.012).abs() < 0.001, "{:?}", report.causes);
    assert!(
        report.cannot_tell.iter().any(|line| line.starts_with("places are given from")),
        "{:?}",
        report.cannot_tell
    );
    let remarks = |what: &str| report.cannot_tell.iter().any(|t| t.contains(what));
    assert!(remarks("single values of positions are missing") && remarks("of base pose"), "{:?}", report.cannot_tell);
    assert!(!remarks("could be judged"), "all windows are there: {:?}", report.cannot_tell);
}

#[test]
fn what_was_taken_out_as_wrong_is_not_filled_in() {
    let mut run = recorded(synthetic::command_latency(0.012), 4);
    let position = run.measured.position.as_mut().unwrap();
    // One sample of the first two joints, the first of which jumped there.
    position.values[100 * 12..100 * 12 + 2].fill(f64::NAN);
    let channel = format!("position {}", run.joint_names[0]);
    let detail = String::new();
    run.faults.push(Fault { kind: FaultKind::Jump, channel, time: position.time[100], count: 1, detail });
    let (mended, remarks) = without_gaps(run);
    let row = mended.measured.position.as_ref().unwrap().row(100);
    assert!(row[0].is_nan() && row[1].is_finite());
    assert!(remarks.len() == 1 && remarks[0].starts_with("1 single values of positions"), "{remarks:?}");
}

#[test]
fn a_start_is_the_same_beside_other_errors() {
    let run = recorded(synthetic::command_latency(0.012), 4);
    let columns: Vec<usize> = (0..12).collect();
    let none = Starts::new(&run, &columns, true, SensorErrors::default()).unwrap();
    let of_joints = SensorErrors {
        encoder_bias: vec![0.01; 12],
        gyro_bias: [0.02, 0.0, -0.01],
        encoder_latency: vec![0.004; 12],
        ..SensorErrors::default()
    };
    let alone = Starts::new(&run, &columns, true, of_joints.clone()).unwrap();
    let beside = none.with_errors(&of_joints).unwrap();
    for time in [4.0, 5.3, 6.1] {
        assert_eq!(beside.at(time).unwrap(), alone.at(time).unwrap());
        assert_ne!(beside.at(time).unwrap(), none.at(time).unwrap());
    }
    let of_path = [
        SensorErrors { pose_delay: 0.01, ..SensorErrors::default() },
        SensorErrors { imu_tilt: [0.0, 0.02], ..SensorErrors::default() },
    ];
    assert!(of_path.iter().all(|errors| none.with_errors(errors).is_none()));
}

#[test]
fn without_poses_a_robot_goes_where_its_legs_carry_it() {
    let model = go2();
    let posed = recorded(synthetic::command_latency(0.012), 4);
    let mut run = posed.clone();
    run.measured.base_pose = None;
    run.foot_names.clear();
    let feet = feet_of(&run, &model);
    assert_eq!(feet.names, ["FL", "FR", "RL", "RR"]);
    assert_eq!((&feet.geoms, &feet.of_joint), (&feet_of(&posed, &model).geoms, &feet_of(&posed, &model).of_joint));
    let columns: Vec<usize> = (0..12).collect();
    let legs = Legs { model: &model, feet: &feet.geoms };
    let by_legs = Starts::on_legs(&run, &columns, SensorErrors::default(), legs).unwrap();
    let by_poses = Starts::new(&posed, &columns, true, SensorErrors::default()).unwrap();
    let [first, last] = run.span();
    let times = (0..40).map(|k| first + 0.5 + (last - first - 1.0) * f64::from(k) / 39.0);
    let (mut apart, mut speed) = (0.0f64, 0.0f64);
    for time in times {
        let (a, b) = (by_legs.at(time).unwrap(), by_poses.at(time).unwrap());
        let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        let difference: Vec<f64> = a.v[..3].iter().zip(&b.v[..3]).map(|(x, y)| x - y).collect();
        (apart, speed) = (apart + square(&difference), speed + square(&b.v[..3]));
    }
    assert!(speed > 40.0 * 0.1 * 0.1, "it hardly walks");
    assert!((apart / speed).sqrt() < 0.15, "{} of {}", (apart / 40.0).sqrt(), (speed / 40.0).sqrt());
    let refused = |run: &Run, terrain: &Terrain| match rollout_of(run, &model, terrain, &[], quick().cut) {
        Ok(_) => panic!("not refused"),
        Err(error) => error.to_string(),
    };
    let corner = |x: f64, y: f64| glam::DVec3::new(x, y, 0.0);
    let mesh = qv_core::TriangleMesh {
        vertices: vec![corner(-9.0, -9.0), corner(9.0, -9.0), corner(0.0, 9.0)],
        triangles: vec![[0, 1, 2]],
        labels: vec![0],
        materials: vec![qv_core::Material { name: "grass".into(), friction: None }],
    };
    assert!(refused(&run, &Terrain::from_mesh(&mesh).unwrap()).states("plane"));
    run.measured.orientation = None;
    assert!(refused(&run, &Terrain::plane()).contains("orientation"));
}

#[test]
fn a_leg_of_another_length_than_the_urdfs_is_named() {
    let run = recorded(Vec::new(), 4);
    let mut wrong = go2();
    let calf = wrong.links.iter().position(|l| l.name == "FL_calf").unwrap();
    wrong.links[calf].com *= 0.95;
    wrong.geoms.iter_mut().filter(|g| g.link == calf).for_each(|g| g.link_from_geom.position *= 0.95);
    let report = diagnose(std::slice::from_ref(&run), &wrong, &Terrain::plane(), &quick(), 0).unwrap().report;
    assert_eq!(report.causes.len(), 1, "{}", report.sentence);
    let cause = &report.causes[0];
    assert_eq!((cause.effect.as_str(), &cause.scope[..]), ("link_length", &["FL_calf".to_string()][..]));
    assert!((cause.parameters[0].value - 1.0 / 0.95 + 1.0).abs() < 0.015, "{:?}", cause.parameters);
}

#[test]
fn an_effect_whose_values_mean_nothing_is_refused_with_its_file() {
    let run = recorded(Vec::new(), 4);
    let text = "[[effect]]\nname = 'glue'\ninterface = 'actuator'\nscope = 'joints'\nunit = 'N m s/rad'\nrange = [-0.5, 0]\n\
        tolerance = 0.01\nlevels = [-0.1]\n[[effect.axis]]\nname = 'x'\nmoves = { 'joint.{joint}.viscous_friction' = 1.0 }\n";
    for (from, to, remarks) in
        [("", "", "viscous_friction` at least 0"), ("viscous_friction", "glue", "parameter of the simulator")]
    {
        let own = library::parse(&text.replace(from, to), "mine.toml").unwrap();
        let options = Options { library: own, ..quick() };
        let error =
            diagnose(std::slice::from_ref(&run), &go2(), &Terrain::plane(), &options, 0).err().unwrap().to_string();
        assert!(error.contains("mine.toml") && error.contains("`glue`") && error.contains(remarks), "{error}");
    }
}

#[test]
fn without_poses_a_slope_may_be_a_tilted_imu() {
    let mut run = recorded(vec![("terrain.slope_x".into(), 0.05)], 4);
    run.measured.base_pose = None;
    let report = of(&run, &quick());
    let cause = report.causes.first().expect("it is seen");
    let one_of_two = ["terrain_slope", "imu_tilt"];
    assert!(one_of_two.contains(&cause.effect.as_str()), "{}", report.sentence);
    assert!(
        cause.confusable_with.iter().any(|name| one_of_two.contains(&name.as_str())),
        "{:?}",
        cause.confusable_with
    );
    assert!(report.sentence.states("Without"), "{}", report.sentence);
    assert!(report.cannot_tell.iter().any(|line| line.contains("pose_delay")), "{:?}", report.cannot_tell);
}

#[test]
fn a_robot_that_only_stands_is_accused_of_nothing() {
    let request = Request::mixed(EngineChoice::Ours, FaultRequest::Nothing);
    let plan = Plan { sections: vec![(Section::Stand, 10.0)] };
    let recipe = Recipe { plan, ..qv_sealed::redraw(&request, 7, 0).unwrap().recipe };
    let run = read(&qv_sealed::record(&recipe).unwrap().1);
    let report = of(&run, &quick());
    // Noise alone asks for a lag, a weaker kd and a late pose there.
    assert_eq!(report.verdict, Verdict::NoGap, "{}", report.sentence);
    assert!(report.cannot_tell.iter().any(|line| line.starts_with("no joint moves")), "{:?}", report.cannot_tell);
}

#[test]
fn recordings_of_another_robot_are_refused_by_number() {
    let run = recorded(Vec::new(), 4);
    let mut other = run.clone();
    other.joint_names[2] = "knee".into();
    let error = diagnose(&[run.clone(), run, other], &go2(), &Terrain::plane(), &quick(), 0).err().unwrap().to_string();
    assert!(error.states("recording 3") && error.contains("knee"), "{error}");
}

#[test]
fn far_from_the_origin_the_same_steps_leave_the_same() {
    let (run, model) = (recorded(synthetic::command_latency(0.012), 4), go2());
    let mut far = run.clone();
    let pose = far.measured.base_pose.as_mut().unwrap();
    pose.values.chunks_exact_mut(pose.joints).for_each(|row| row[0] += 40.0);
    // Near the origin in single precision, far from it in double.
    let left = |run: &Run| {
        let rollout = Rollout::new(run, &model, &Terrain::plane(), &[], quick().cut).unwrap();
        let windows = rollout.windows(run).unwrap();
        compare(&rollout, &rollout.numerics, &windows.iter().collect::<Vec<_>>(), &[vec![]]).unwrap().values.remove(0)
    };
    let [near, far] = [&run, &far].map(left);
    let squares = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
        near.iter().flatten().zip(far.iter().flatten()).map(|(a, b)| of(*a, *b).powi(2)).sum()
    };
    assert!(near.iter().zip(&far).all(|(a, b)| a.len() == b.len()));
    let (left, apart) = (squares(&|a, _| a).sqrt(), squares(&|a, b| a - b).sqrt());
    assert!(apart < 0.01 * left, "{apart} of {left}");
}
