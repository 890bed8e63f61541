//! The files of a diagnosis, read back by those who will read them: this crate, the simulator, MuJoCo, Python.

use crate::facts::States;
use crate::made_up::{correction, empty, go2, report};
use crate::python::{python, python_with};
use qv_gap::export::{Gains, files, to_html, to_isaac_lab, to_json, to_mjcf, to_toml, to_urdf};
use qv_gap::report::*;
use qv_page::read;
use qv_rollout::parameters_from_toml;
use qv_sim::{BaseKind, Model, ModelOptions};

const KP: [f64; 12] = [40.0; 12];
const KD: [f64; 12] = [1.0; 12];
const GAINS: Gains = Gains { kp: &KP, kd: &KD };

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().map(|x| x.parse().unwrap()).collect()
}

fn assert_close(found: &[f64], expected: &[f64], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}: {found:?}");
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() <= 1e-5 * e.abs().max(1e-4), "{what}: {found:?}, expected {expected:?}");
    }
}

/// Every kind of correction that some format says.
fn corrections() -> Vec<Correction> {
    vec![
        correction("joint.FL_hip_joint.armature", 0.0213, 0.01, "kg m²"),
        correction("joint.FL_hip_joint.viscous_friction", 0.31, 0.0, "N m s/rad"),
        correction("joint.FL_hip_joint.coulomb_friction", 0.125, 0.0, "N m"),
        correction("actuator.FL_hip_joint.strength", 0.8, 1.0, "1"),
        correction("actuator.FL_hip_joint.kp_scale", 0.9, 1.0, "1"),
        correction("actuator.FL_hip_joint.torque_limit", 15.0, 23.7, "N m"),
        correction("actuator.FR_calf_joint.command_latency", 0.0123, 0.0, "s"),
        correction("actuator.RL_thigh_joint.speed_knee", 10.0, 30.1, "rad/s"),
        correction("actuator.RL_thigh_joint.speed_zero", 22.0, 33.11, "rad/s"),
        correction("actuator.RR_hip_joint.lag", 0.01, 0.0, "s"),
        correction("sensor.RR_hip_joint.encoder_bias", 0.02, 0.0, "rad"),
        correction("link.base.payload_mass", 2.0, 0.0, "kg"),
        correction("link.base.payload_x", 0.1, 0.0, "m"),
        correction("link.FL_calf.com_z", 0.02, 0.0, "m"),
        correction("link.FL_calf.inertia_scale", 1.2, 1.0, "1"),
        correction("geom.FL_calf.radius_offset", -0.002, 0.0, "m"),
        correction("contact.friction", 0.4, 0.8, "1"),
        correction("contact.time_constant", 0.02, 0.008, "s"),
        correction("terrain.slope_x", 0.05, 0.0, "rad"),
    ]
}

#[test]
fn the_page_says_what_matters() {
    let page = to_html(&report(), None, "walk.mcap", &["One message was lost.".into()], &[]);
    for said in [
        "<title>Diagnosis of walk.mcap</title>",
        "The motors answer 10.1 ms late",
        "One message was lost.",
        ">91 %<",
        "87 to 93 %",
        "10.1 ms (9.6 to 10.6)",
        "0.21 (0.17 to 0.26)",
        "Actuator lag",
        "96 %",
        "all joints",
        "71 % of the gap",
        "Command latency, Motor gain kd",
        "a lag rounds them off",
        "impact",
        "patch, 22 %<title>",
        "FL_calf_joint",
        "load on the leg",
        "the robot never turned",
        "at half the speed",
        "1.84 million simulated steps",
        "prefers-color-scheme:dark",
    ] {
        assert!(page.contains(said), "{said}");
    }
    assert_eq!(
        page.matches("<svg").count(),
        2 + 1 + 1 + 2 + 1 + 2,
        "two maps, two plans, two legends, times, a joint's positions and errors"
    );
}

#[test]
fn every_joint_is_on_the_page_at_the_recorded_rate() {
    let page = to_html(&report(), None, "walk.mcap", &[], &[]);
    let boards = read::boards(&page);
    assert_eq!(boards.len(), 1);
    let board = &boards[0];
    assert_eq!(board.choices[0].options, qv_go2::model::JOINT_NAMES);
    assert_eq!(board.choices[1].options, ["position", "velocity", "all"]);
    assert_eq!((board.panels.len(), board.stretches.len()), (12 * 2 * 2, 4));
    for panel in board.panels.iter().step_by(2) {
        let names: Vec<&str> = panel.lines.iter().map(|l| l.name.as_str()).collect();
        assert_eq!(names, ["measured", "before", "after"]);
        for line in &panel.lines {
            let (x, y) = board.points(line);
            assert_eq!((x.len(), y.iter().filter(|y| y.is_finite()).count()), (4 * 151, 4 * 150));
            assert!((x[1] - x[0] - 0.002).abs() < 1e-9);
        }
    }
    let json = to_json(&report());
    assert!(!json.contains("\"traces\"") && json.len() < 200_000, "{} bytes: they are for the page", json.len());
    assert!(page.len() < 500_000, "{} bytes", page.len());
}

#[test]
fn the_page_is_one_file_without_network() {
    for report in [report(), empty()] {
        let whole = to_html(&report, None, "run", &[], &[]);
        let page = read::without_scripts(&whole);
        for never in ["http:", "https:", "src=", "<link", "@import", "url(", "NaN", "inf"] {
            assert!(!page.contains(never), "{never}");
        }
        for tag in ["div", "svg", "span", "table", "dl", "article", "h2", "h3", "p", "ul", "ol", "title"] {
            let opened = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
        let has_plots = !report.traces.windows.is_empty();
        assert_eq!(whole.matches("<script").count(), if has_plots { 2 } else { 0 });
    }
}

#[test]
fn the_first_screen_answers_what_a_reader_asks() {
    let page = to_html(&report(), None, "walk", &[], &[]);
    let first = page.split("<h2>").next().unwrap_or_default();
    for question in ["Cause", "Size (95 % interval)", "Removes", "Score", "Next step"] {
        assert!(first.contains(&format!("<dt>{question}")), "{question}: {first}");
    }
    let mut nameless = report();
    nameless.causes.clear();
    let page = to_html(&nameless, None, "walk", &[], &[]);
    assert!(!page.contains("<dt>Certainty") && page.contains("<dt>Next step"));
}

#[test]
fn what_is_not_there_takes_no_room() {
    let page = to_html(&empty(), None, "run", &[], &[]);
    for absent in
        ["<svg", "Remaining error", "Error breakdown", "Next step", "cannot show", "Simulation effort", "Corrections"]
    {
        assert!(!page.contains(absent), "{absent}");
    }
    assert!(page.states("gap") && page.contains("No gap"));
    let mut held = report();
    held.floor_plan.clear();
    held.place.regions.clear();
    held.verdict = Verdict::Unexplained;
    held.causes.clear();
    let page = to_html(&held, None, "arm", &[], &[]);
    assert!(!page.contains("Error along the path") && page.states("library"));
    assert!(!page.contains("95 % interval"), "nothing is closed without a cause");
    assert!(!page.contains(">after<"), "after is before");
    assert!(read::boards(&page)[0].panels.iter().flat_map(|p| &p.lines).all(|l| l.name != "after"));
}

#[test]
fn text_of_others_stays_text() {
    let nasty = "</style><script>alert(\"1\" & '2')</script>".to_string();
    let mut r = report();
    r.sentence = nasty.clone();
    r.gap.unit = nasty.clone();
    r.next = vec![nasty.clone()];
    r.cannot_tell = vec![nasty.clone()];
    r.causes[0].effect = nasty.clone();
    r.causes[0].scope = vec![nasty.clone()];
    r.causes[0].confusable_with = vec![nasty.clone()];
    r.causes[0].separating_experiment = nasty.clone();
    r.causes[0].parameters[0].unit = nasty.clone();
    r.causes[1].parameters[0].name = nasty.clone();
    r.ranking[0].effect = nasty.clone();
    r.place.interfaces[0].name = nasty.clone();
    r.place.joints[0].name = nasty.clone();
    r.place.regions[0].name = nasty.clone();
    r.heat_map.joints[0] = nasty.clone();
    r.traces.joints[11] = nasty.clone();
    r.traces.joints[0] = nasty.clone();
    r.unexplained.depends_on[0].factor = nasty.clone();
    r.stages[0].name = nasty.clone();
    r.corrections[0].parameter = format!("actuator.{nasty}.lag");
    r.corrections[0].unit = nasty.clone();
    let page = to_html(&r, None, &nasty, std::slice::from_ref(&nasty), &[]);
    assert!(!page.contains("<script>alert") && page.matches("</style>").count() == 1);
    assert_eq!(page.matches("</script>").count(), 2, "the plots' numbers, and what draws them");
    assert!(page.matches("&lt;script&gt;").count() > 15);
}

#[test]
fn numbers_that_are_none_leave_no_trace() {
    let mut r = report();
    let none = f64::NAN;
    r.gap.before = none;
    r.gap.floor = f64::INFINITY;
    r.gap.closed = none;
    r.gap.closed_ci95 = [none; 2];
    r.gap.joint_rms = [none; 2];
    r.causes[0].score = none;
    r.causes[0].closed_alone = none;
    r.causes[0].parameters[0].ci95 = [none; 2];
    r.causes[1].parameters[0].value = f64::NEG_INFINITY;
    r.ranking[0].score = none;
    r.place.interfaces[0].share = none;
    r.place.joints[0].share = none;
    r.place.joints[0].pos_rms = none;
    r.place.times[0].share = none;
    r.place.times[1].start = none;
    r.place.regions[0].x[0] = none;
    r.heat_map.before[0][0] = f64::INFINITY;
    r.heat_map.after[3].clear();
    r.heat_map.times[40] = none;
    r.floor_plan[0].x = none;
    r.floor_plan[1].before = f64::INFINITY;
    r.curves[0].before[3] = none;
    r.traces.windows[0].before.position[3] = none;
    r.traces.windows[1].measured.position.truncate(10);
    r.traces.windows[2].after.velocity.clear();
    r.traces.windows[3].measured.time.clear();
    r.unexplained.share = none;
    r.unexplained.depends_on[0].r2_heldout = none;
    r.timing.stages_s[0] = none;
    r.corrections[0].value = none;
    r.timing.runtime_s = none;
    let everything = files(&r, &go2(), Some(&qv_go2::model::urdf()), "run", &[], &[], GAINS);
    for (name, bytes) in everything {
        let text = read::without_scripts(&String::from_utf8(bytes).unwrap());
        assert!(!text.contains("inf\"") && !text.contains(">inf") && !text.contains("-inf"), "{name}");
        let allowed = if name == "calibrated.toml" { 1 } else { 0 };
        assert_eq!(text.matches("NaN").count(), allowed, "{name} (the table names the correction that it leaves out)");
    }
}

#[test]
fn calibrated_parameters_come_back_bit_by_bit() {
    let mut r = report();
    r.corrections.push(correction("joint.a \"quoted\\\" joint\n.armature", 1.0 / 3.0, 0.0, "kg m²"));
    r.corrections.push(correction("external.duration", 1e-300, 1e9, "s"));
    r.corrections.push(correction("external.start", 5.0, 0.0, "s"));
    let text = to_toml(&r);
    let mut found = parameters_from_toml(&text).unwrap();
    let mut expected: Vec<(String, f64)> = r.corrections.iter().map(|c| (c.parameter.clone(), c.value)).collect();
    found.sort_by(|a, b| a.0.cmp(&b.0));
    expected.sort_by(|a, b| a.0.cmp(&b.0));
    assert_eq!(found, expected);
    assert!(text.states("\"actuator.FL_hip_joint.lag\" 0.010123456789 0 actuator_lag"), "{text}");
    assert!(text.states("0.8 ground_friction"), "{text}");
}

#[test]
fn a_finding_that_makes_things_worse_is_applied_by_no_file() {
    let mut found = report();
    found.corrections_apply = false;
    (found.gap.before, found.gap.after) = (1.4, 7.3);
    let text = to_toml(&found);
    assert_eq!(parameters_from_toml(&text).unwrap(), []);
    for correction in &found.corrections {
        assert!(text.contains(&format!("# \"{}\" = ", correction.parameter)), "{text}");
    }
    assert!(text.states("loss 7.30 1.40"), "{text}");
    assert!(to_html(&found, None, "walk", &[], &[]).states("correction"));
    let model = go2();
    let of = |report: &Report| files(report, &model, None, "walk", &[], &[], GAINS);
    let nothing = Report { corrections: vec![], ..found.clone() };
    let text = |report: &Report| of(report).into_iter().find(|f| f.0 == "isaac_lab_actuators.py").unwrap().1;
    assert_eq!(text(&found), text(&nothing));
    assert!(of(&found).iter().all(|f| f.0 != "mjcf_fragment.xml"), "no file that changes nothing");
}

#[test]
fn the_page_says_by_how_much_the_error_falls_and_why_two_figures_differ() {
    let mut remarks = report();
    let page = to_html(&remarks, None, "walk", &[], &[]);
    let agreed = "Error on held-out data falls 88 % (mean square of all channels, 38.2 to 4.43); of the joints alone it falls 78 % (14.2 to 3.1 mrad).";
    assert!(page.contains(agreed) && page.states("explained"), "{page}");
    assert!(!page.contains("The two differ") && !page.contains("simulation and recording diverge"));
    // Feet slip in two of ten windows, where nothing is mended.
    let windows: Vec<[f64; 2]> = (0..10).map(|k| if k < 2 { [0.03, 0.036] } else { [0.017, 0.002] }).collect();
    remarks.gap.joint_rms = [0.0204, 0.017];
    (remarks.gap.before, remarks.gap.after) = (100.0, 4.0);
    remarks.gap.joint_rms_apart = JointRmsApart::of(&windows);
    let page = to_html(&remarks, None, "walk", &[], &[]);
    for said in [
        "falls 96 % (mean square of all channels, 100 to 4.00); of the joints alone it falls 17 % (20.4 to 17.0 mrad)",
        "The two differ",
        "In 2 of 10 windows simulation and recording diverge",
        "there the joint error changes from 30.0 to 36.0 mrad. In the other 8 it changes from 17.0 to 2.0 mrad.",
    ] {
        assert!(page.contains(said), "{said}");
    }
    assert_eq!(JointRmsApart::of(&[[0.01, 0.002]; 5]), None);
    assert_eq!(JointRmsApart::of(&[]), None);
    let json = to_json(&remarks);
    assert!(json.contains("\"rms_apart\""), "{json}");
}

#[test]
fn calibrated_parameters_may_be_none_or_doubled() {
    assert!(parameters_from_toml(&to_toml(&empty())).unwrap().is_empty());
    let mut r = empty();
    r.sentence = "two\nlines".into();
    r.corrections = vec![
        correction("contact.friction", 0.3, 0.8, "1"),
        correction("contact.friction", 0.4, 0.8, "1"),
        correction("terrain.height", f64::NAN, 0.0, "m"),
    ];
    assert_eq!(parameters_from_toml(&to_toml(&r)).unwrap(), [("contact.friction".to_string(), 0.4)]);
}

#[test]
fn the_fragment_says_joints_motors_and_ground() {
    let text = to_mjcf(&go2(), &corrections(), &KP, &KD);
    for said in [
        "<default class=\"calibrated_FL_hip_joint\">",
        "<joint armature=\"0.0213\" damping=\"0.31\" frictionloss=\"0.125\"/>",
        "<position kp=\"28.8\" kv=\"0.8\" forcelimited=\"true\" forcerange=\"-15 15\"/>",
        "<geom priority=\"1\" friction=\"0.4 0.005 0.0001\" solref=\"0.02 1\"/>",
        "<option cone=\"elliptic\" impratio=\"10\"/>",
        "in <body name=\"base\"> (it includes imu), in place of its own: <inertial mass=\"8.921\"",
        "in <body name=\"FL_calf\">: the radius (first size) of its sphere is 0.02",
        "<position kp=\"40\" kv=\"1\" delay=\"0.0123\" nsample=\"26\" interp=\"zoh\"/>",
        "speed_knee: RL_thigh_joint 10 rad/s.",
        "lag: RR_hip_joint 0.01 s. Low-pass",
        "encoder_bias: RR_hip_joint 0.02 rad. Add it",
        "the floor, if it is at the origin and level: pos=\"0 0 0\" quat=\"0.999688 0 -0.0249974 0\"",
    ] {
        assert!(text.contains(said), "{said}\n{text}");
    }
    for unsaid in [
        "armature:",
        "strength:",
        "payload_mass:",
        "radius_offset:",
        "command_latency:",
        "contact.friction:",
        "terrain.slope_x:",
    ] {
        assert!(!text.contains(unsaid), "{unsaid} is said twice\n{text}");
    }
}

#[test]
fn a_fragment_for_other_motors() {
    let c = corrections();
    let torque = to_mjcf(&go2(), &c, &[0.0; 12], &[0.0; 12]);
    assert!(torque.contains("<motor gear=\"0.8\" forcelimited=\"true\" forcerange=\"-18.75 18.75\"/>"), "{torque}");
    let unknown = to_mjcf(&go2(), &c, &[], &[]);
    assert!(unknown.contains("<general forcelimited=\"true\" forcerange=\"-15 15\"/>"), "{unknown}");
    assert!(unknown.states("FL_hip_joint 0.8. Multiply"), "{unknown}");
    let none = to_mjcf(&go2(), &[], &KP, &KD);
    assert!(none.states("corrects") && !none.contains("<default"));
}

/// A robot of two bodies whose joint, motor, inertials and floor come from the fragment.
fn mjcf_model(fragment: &str, motor: &str) -> String {
    let inertial = |body: &str| {
        let from = fragment.find(&format!("in <body name=\"{body}\">")).unwrap();
        let at = from + fragment[from..].find("<inertial").unwrap();
        fragment[at..at + fragment[at..].find("/>").unwrap() + 2].to_string()
    };
    format!(
        "<mujoco><include file=\"mjcf_fragment.xml\"/><default><geom rgba=\"1 0 0 1\"/></default><worldbody>\
         <geom name=\"floor\" type=\"plane\" size=\"0 0 1\" class=\"calibrated_ground\"/>\
         <body name=\"base\" pos=\"0 0 1\"><freejoint/>{}\
         <body name=\"FL_calf\"><joint name=\"FL_hip_joint\" class=\"calibrated_FL_hip_joint\" axis=\"1 0 0\"/>{}</body></body>\
         </worldbody><actuator><{motor} class=\"calibrated_FL_hip_joint\" joint=\"FL_hip_joint\"/></actuator></mujoco>",
        inertial("base"),
        inertial("FL_calf")
    )
}

const READ_MJCF: &str = "
import mujoco, numpy as np
m = mujoco.MjModel.from_xml_path('model.xml')
row = lambda x: print(*np.asarray(x, float).ravel())
row([m.dof_armature[6], m.dof_damping[6], m.dof_frictionloss[6]])
row([m.actuator_gainprm[0, 0], m.actuator_biasprm[0, 1], m.actuator_biasprm[0, 2], m.actuator_gear[0, 0]])
row(m.actuator_forcerange[0])
row(m.geom_friction[0]); row(m.geom_solref[0]); row([m.opt.impratio, m.opt.cone])
for name in ('base', 'FL_calf'):
    b = m.body(name)
    r = np.zeros(9); mujoco.mju_quat2Mat(r, b.iquat); r = r.reshape(3, 3)
    row(b.mass); row(b.ipos); row(r @ np.diag(b.inertia) @ r.T)
";

#[test]
fn mujoco_reads_the_fragment() {
    let Some(with_mujoco) = python_with("mujoco") else { return };
    let model = go2();
    let fragment = to_mjcf(&model, &corrections(), &KP, &KD);
    let files = [("mjcf_fragment.xml", fragment.as_str()), ("model.xml", &mjcf_model(&fragment, "position"))];
    let printed = python(&with_mujoco, "mjcf_position", READ_MJCF, &files);
    let rows: Vec<Vec<f64>> = printed.lines().map(numbers).collect();
    assert_close(&rows[0], &[0.0213, 0.31, 0.125], "joint");
    assert_close(&rows[1], &[28.8, -28.8, -0.8, 1.0], "motor");
    assert_close(&rows[2], &[-15.0, 15.0], "limit");
    assert_close(&rows[3], &[0.4, 0.005, 0.0001], "friction");
    assert_close(&rows[4], &[0.02, 1.0], "solref");
    assert_close(&rows[5], &[10.0, 1.0], "option");
    // 2 kg, 10 cm ahead of the trunk's centre: the reduced mass turns about the y and z axes.
    let base = &model.links[0];
    let mut com = base.com.to_array();
    com[0] += 0.1 * 2.0 / 8.921;
    let about = 0.01 * 2.0 * 6.921 / 8.921;
    let mut expected = base.inertia.to_cols_array();
    expected[4] += about;
    expected[8] += about;
    assert_close(&rows[6], &[8.921], "mass");
    assert_close(&rows[7], &com, "centre");
    assert_close(&rows[8], &expected, "inertia");
    let calf = model.links.iter().find(|l| l.name == "FL_calf").unwrap();
    let [x, y, z] = calf.com.to_array();
    assert_close(&rows[10], &[x, y, z + 0.02], "centre of the calf");
    assert_close(&rows[11], &(calf.inertia * 1.2).to_cols_array(), "inertia of the calf");
    let torque = to_mjcf(&model, &corrections(), &[0.0; 12], &[0.0; 12]);
    let files = [("mjcf_fragment.xml", torque.as_str()), ("model.xml", &mjcf_model(&torque, "motor"))];
    let rows: Vec<Vec<f64>> = python(&with_mujoco, "mjcf_motor", READ_MJCF, &files).lines().map(numbers).collect();
    assert_close(&rows[1], &[1.0, 0.0, 0.0, 0.8], "torque motor");
    assert_close(&rows[2], &[-18.75, 18.75], "limit before the gear");
    let none = to_mjcf(&model, &[], &KP, &KD);
    let bare = "<mujoco><include file=\"mjcf_fragment.xml\"/><worldbody/></mujoco>";
    let program = "import mujoco; print(mujoco.MjModel.from_xml_path('model.xml').nbody)";
    assert_eq!(
        python(&with_mujoco, "mjcf_none", program, &[("mjcf_fragment.xml", &none), ("model.xml", bare)]).trim(),
        "1"
    );
}

#[test]
fn the_urdf_has_the_corrections_and_keeps_the_rest() {
    let (model, original) = (go2(), qv_go2::model::urdf());
    let (text, unsaid) = to_urdf(&original, &model, &corrections()).unwrap();
    let options = ModelOptions { base: BaseKind::Floating, armature: 0.01, mesh_reader: None, held: &[] };
    let read = Model::from_urdf(&text, &options).unwrap();
    let joint = |name: &str| &read.joints[read.joint_index(name).unwrap()];
    let hip = joint("FL_hip_joint");
    assert_eq!((hip.viscous_friction, hip.coulomb_friction, hip.effort, hip.velocity), (0.31, 0.125, 15.0, 30.1));
    assert_eq!(joint("RL_thigh_joint").velocity, 10.0);
    assert_eq!(joint("RR_hip_joint").effort, 23.7);
    assert!((read.links[0].mass - 8.921).abs() < 1e-12);
    assert!((read.links[0].com.x - (model.links[0].com.x + 0.2 / 8.921)).abs() < 1e-12);
    let trunk = read.links[0].inertia.y_axis.y - model.links[0].inertia.y_axis.y;
    assert!((trunk - 0.02 * 6.921 / 8.921).abs() < 1e-12, "{trunk}");
    let calf = read.joints[2].link;
    assert!((read.links[calf].com.z - model.links[calf].com.z - 0.02).abs() < 1e-12);
    assert!((read.links[calf].inertia.x_axis.y / model.links[calf].inertia.x_axis.y - 1.2).abs() < 1e-9);
    // Lines that no correction names are the same lines.
    let changed = original.lines().zip(text.lines()).filter(|(a, b)| a != b).count();
    assert_eq!((changed, text.lines().count()), (4, original.lines().count()), "base, FL_calf, FL hip, RL thigh");
    for kind in
        ["armature", "strength", "kp_scale", "command_latency", "speed_zero", "lag", "encoder_bias", "contact.friction"]
    {
        assert_eq!(unsaid.iter().filter(|u| u.starts_with(&format!("{kind}: "))).count(), 1, "{kind} in {unsaid:?}");
    }
    assert!(!unsaid.iter().any(|u| u.starts_with("payload_mass") || u.starts_with("torque_limit")), "{unsaid:?}");
    let (same, known) = to_urdf(&original, &model, &[]).unwrap();
    assert_eq!(same, original);
    assert_eq!(known, ["armature: all joints 0.01 kg m². Add it as rotor inertia at the joint."]);
    // What a recording states of its joints, and how long links are.
    let mut stated = model.clone();
    stated.joints[3].viscous_friction = 0.2;
    stated.joints.iter_mut().for_each(|j| j.armature = 0.0);
    let (text, unsaid) =
        to_urdf(&original, &stated, &[correction("link.FL_calf.length_scale", 1.04, 1.0, "1")]).unwrap();
    let read = Model::from_urdf(&text, &options).unwrap();
    assert_eq!((read.joints[2].viscous_friction, read.joints[3].viscous_friction), (0.0, 0.2));
    assert_eq!(read.links[calf].com, model.links[calf].com, "told as a whole, not in part");
    assert!(matches!(&unsaid[..], [line] if line.starts_with("length_scale: FL_calf 1.04")), "{unsaid:?}");
}

/// A trunk that carries a heavy box, turned and fixed to it, and an arm on a joint without limits.
const WELDED: &str = r#"<robot name="cart">
  <link name="trunk"><inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.025"/></inertial></link>
  <link name="box"><inertial><origin xyz="0.1 0 0" rpy="0 0 0.5"/><mass value="4"/><inertia ixx="0.05" ixy="0.001" ixz="0" iyy="0.06" iyz="0" izz="0.08"/></inertial></link>
  <joint name="weld" type="fixed"><parent link="trunk"/><child link="box"/><origin xyz="0 0.2 0.1" rpy="0.3 -0.2 1.0"/></joint>
  <link name="arm"><inertial><mass value="0.5"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
  <joint name="swing" type="continuous">
    <parent link="trunk"/><child link="arm"/><axis xyz="0 1 0"/>
  </joint>
</robot>"#;

fn read(urdf: &str) -> Model {
    Model::from_urdf(urdf, &ModelOptions { base: BaseKind::Floating, ..Default::default() }).unwrap()
}

#[test]
fn welded_links_share_their_corrections() {
    let model = read(WELDED);
    let all = [
        correction("link.trunk.mass_scale", 1.1, 1.0, "1"),
        correction("link.trunk.inertia_scale", 0.95, 1.0, "1"),
        correction("link.trunk.com_y", -0.02, 0.0, "m"),
        correction("link.arm.payload_mass", 0.25, 0.0, "kg"),
        correction("actuator.swing.torque_limit", 3.0, 1e9, "N m"),
        correction("joint.swing.coulomb_friction", 0.1, 0.0, "N m"),
    ];
    let (text, unsaid) = to_urdf(WELDED, &model, &all).unwrap();
    assert_eq!(unsaid, Vec::<String>::new());
    let found = read(&text);
    let (new, old) = (&found.links[0], &model.links[0]);
    assert!((new.mass - 5.5).abs() < 1e-12);
    assert!((new.com - old.com + glam::DVec3::Y * 0.02).length() < 1e-12, "{} {}", new.com, old.com);
    let apart =
        (new.inertia - old.inertia * (1.1 * 0.95)).to_cols_array().into_iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    assert!(apart < 1e-12, "{apart}");
    assert!((found.links[1].mass - 0.75).abs() < 1e-12 && found.links[1].inertia == glam::DMat3::ZERO);
    assert_eq!((found.joints[0].effort, found.joints[0].coulomb_friction), (3.0, 0.1));
    assert!(text.contains("<link name=\"trunk\"><inertial><mass value=\"1\"/>"), "the lighter one stays\n{text}");
}

#[test]
fn a_weld_that_no_part_can_take_is_taken_by_the_whole() {
    let model = read(WELDED);
    // Less inertia than the trunk and the distances alone have.
    let all = [correction("link.trunk.inertia_scale", 0.4, 1.0, "1")];
    let (text, unsaid) = to_urdf(WELDED, &model, &all).unwrap();
    let (new, old) = (&read(&text).links[0], &model.links[0]);
    let apart = (new.inertia - old.inertia * 0.4).to_cols_array().into_iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    assert!(apart < 1e-12 && (new.mass - 5.0).abs() < 1e-12, "{apart}");
    assert_eq!(unsaid, ["link box: it now has the mass properties of trunk as well."]);
    let weightless = [correction("link.arm.payload_mass", -0.5, 0.0, "kg")];
    let (text, unsaid) = to_urdf(WELDED, &model, &weightless).unwrap();
    assert_eq!(text, WELDED);
    assert!(unsaid[0].states("mass"), "{unsaid:?}");
}

#[test]
fn a_urdf_of_another_robot_is_refused() {
    let hip = correction("joint.FL_hip_joint.coulomb_friction", 0.1, 0.0, "N m");
    for (urdf, remarks) in [("no xml", "URDF"), (WELDED, "FL_hip_joint")] {
        let error = to_urdf(urdf, &go2(), std::slice::from_ref(&hip)).unwrap_err().to_string();
        assert!(error.contains(remarks), "{error}");
        let mut r = empty();
        r.corrections = vec![hip.clone()];
        let written = files(&r, &go2(), Some(urdf), "run", &[], &[], GAINS);
        assert!(!written.iter().any(|(name, _)| name == "robot_calibrated.urdf"));
        let page = &written.iter().find(|(name, _)| name == "report.html").unwrap().1;
        assert!(String::from_utf8_lossy(page).states("robot_calibrated.urdf"));
    }
}

#[test]
fn isaac_lab_gets_a_class_for_each_kind_of_motor() {
    let text = to_isaac_lab(&go2(), &corrections(), &KP, &KD, 0.005);
    for said in [
        "from isaaclab.actuators import DCMotorCfg, DelayedPDActuatorCfg, ImplicitActuatorCfg",
        "PHYSICS_DT = 0.005",
        "stiffness=28.8,",
        "effort_limit_sim=15,",
        "min_delay=2,\n        max_delay=3,  # 12.3 ms",
        "# - lag: RR_hip_joint 0.01 s.",
        "# - contact.friction: 0.4.",
        "# - payload_mass: base 2 kg.",
    ] {
        assert!(text.contains(said), "{said}\n{text}");
    }
    for unsaid in ["# - armature", "# - strength", "# - command_latency", "# - speed_knee"] {
        assert!(!text.contains(unsaid), "{unsaid}\n{text}");
    }
    let unknown = to_isaac_lab(&go2(), &corrections(), &[], &[], 0.005);
    assert!(unknown.contains("stiffness=None,") && unknown.states("FL_hip_joint 0.8."), "{unknown}");
}

/// Runs the configuration with classes that keep what they are given.
const READ_ISAAC: &str = "
import ast, re, sys, types
text = open('isaac_lab_actuators.py').read()
ast.parse(text)
package, module = types.ModuleType('isaaclab'), types.ModuleType('isaaclab.actuators')
class Cfg:
    def __init__(self, **given): self.given = given
for name in ('DCMotorCfg', 'DelayedPDActuatorCfg', 'ImplicitActuatorCfg'):
    setattr(module, name, type(name, (Cfg,), {}))
package.actuators = module
sys.modules.update({'isaaclab': package, 'isaaclab.actuators': module})
found = {}
exec(text, found)
for joint in open('joints').read().split('\\n'):
    groups = [c for c in found['ACTUATORS'].values() if any(re.fullmatch(e, joint) for e in c.given['joint_names_expr'])]
    assert len(groups) == 1, joint
    g = groups[0].given
    keys = ('stiffness', 'damping', 'armature', 'friction', 'effort_limit', 'effort_limit_sim', 'velocity_limit',
            'saturation_effort', 'min_delay', 'max_delay')
    print(type(groups[0]).__name__, *(g.get(k) for k in keys))
";

#[test]
fn python_reads_the_actuators() {
    let Some(plain) = python_with("ast") else { return };
    let model = go2();
    let text = to_isaac_lab(&model, &corrections(), &KP, &KD, 0.005);
    let joints = model.joint_names().join("\n");
    let printed = python(&plain, "isaac", READ_ISAAC, &[("isaac_lab_actuators.py", &text), ("joints", &joints)]);
    let lines: Vec<&str> = printed.lines().collect();
    let of = |joint: &str| lines[model.joint_index(joint).unwrap()];
    assert_eq!(of("FL_hip_joint"), "ImplicitActuatorCfg 28.8 0.8 0.0213 0.125 None 15 None None None None");
    assert_eq!(of("FR_calf_joint"), "DelayedPDActuatorCfg 40 1 0.01 None 45.43 None 15.7 None 2 3");
    // All torque up to 10 rad/s and none at 22: the line meets rest at 23.7 * 22 / 12.
    assert_eq!(of("RL_thigh_joint"), "DCMotorCfg 40 1 0.01 None 23.7 None 22 43.45 None None");
    assert_eq!(of("RR_hip_joint"), "ImplicitActuatorCfg 40 1 0.01 None None 23.7 None None None None");
    let odd = read(&WELDED.replace("\"swing\"", "\"s.w[1]&quot;\\\""));
    for (model, corrections) in [(&odd, &[][..]), (&model, &report().corrections[..])] {
        let text = to_isaac_lab(model, corrections, &KP, &KD, 0.002);
        let joints = model.joint_names().join("\n");
        let printed =
            python(&plain, "isaac_odd", READ_ISAAC, &[("isaac_lab_actuators.py", &text), ("joints", &joints)]);
        assert_eq!(printed.lines().count(), model.joints.len());
    }
}

fn text_of(files: &[(String, Vec<u8>)], name: &str) -> String {
    let (_, bytes) = files.iter().find(|f| f.0 == name).unwrap();
    String::from_utf8(bytes.clone()).unwrap()
}

/// First screens: what causes the gap, beside the place on the robot.
#[test]
fn a_browser_shows_the_pages() {
    let legs = to_html(&report(), Some(&go2()), "recordings/walk.mcap", &["One message was lost.".into()], &[]);
    assert!(legs.contains("class=\"pin marked\"") && legs.contains("Place of the cause"), "{legs}");
    crate::browser::check("diagnosis_of_legs", &legs);
    let arm = crate::two_links::model();
    let page = to_html(&crate::made_up::held(), Some(&arm), "arm/run.csv", &[], &[]);
    for said in [
        "coulomb friction of shoulder <b>0.120 N m (0.100 to 0.140)</b>",
        "coulomb friction of elbow",
        "<code>qv replay",
    ] {
        assert!(page.contains(said), "{said}\n{page}");
    }
    crate::browser::check("diagnosis_of_an_arm", &page);
    let mut open = report();
    (open.verdict, open.causes) = (Verdict::Unexplained, Vec::new());
    crate::browser::check("diagnosis_unexplained", &to_html(&open, Some(&go2()), "walk.mcap", &[], &[]));
}

#[test]
fn all_files_are_written() {
    let urdf = qv_go2::model::urdf();
    let mut with_friction = report();
    with_friction.corrections.push(correction("joint.FL_hip_joint.coulomb_friction", 0.125, 0.0, "N m"));
    let fragment = text_of(&files(&with_friction, &go2(), None, "run", &[], &[], GAINS), "mjcf_fragment.xml");
    assert!(fragment.contains("frictionloss=\"0.125\""), "{fragment}");
    let written = files(&report(), &go2(), Some(&urdf), "run", &[], &[], GAINS);
    let names: Vec<&str> = written.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(
        names,
        [
            "report.json",
            "report.html",
            "calibrated.toml",
            "mjcf_by_hand.txt",
            "robot_calibrated.urdf",
            "isaac_lab_actuators.py"
        ]
    );
    let text = |k: usize| std::str::from_utf8(&written[k].1).unwrap();
    let json: serde_json::Value = serde_json::from_str(text(0)).unwrap();
    assert_eq!(json["format"], "qv-diagnosis/1");
    assert_eq!(json["causes"][0]["parameters"][0]["value"], 0.01012);
    assert_eq!(json["where"]["regions"][0]["name"], "patch");
    let by_hand = text(3);
    assert!(
        report().corrections.iter().all(|c| by_hand.contains(c.parameter.rsplit('.').next().unwrap())),
        "{by_hand}"
    );
    let read = read(text(4));
    assert_eq!(read.joints.len(), 12, "a URDF with a comment at its end is one still");
    assert!(text(4).states("0.0101235 0.0101235"));
    let nothing = files(&empty(), &go2(), Some(&qv_go2::model::urdf()), "run", &[], &[], Gains::default());
    assert_eq!(nothing.len(), 5, "a fragment would change nothing");
    assert!(nothing[3].1.starts_with(qv_go2::model::urdf().as_bytes()), "nothing is changed");
    assert!(
        text_of(&nothing, "report.html").contains("mjcf_fragment.xml was not written: the diagnosis corrects nothing.")
    );
    let urdf = text_of(&nothing, "robot_calibrated.urdf");
    assert!(urdf.contains("a URDF has no free base") && urdf.contains("armature: "), "{}", &urdf[urdf.len() - 900..]);
    assert_eq!(files(&empty(), &go2(), None, "run", &[], &[], Gains::default()).len(), 4);
    // A body cannot be changed from outside: the page says what to paste.
    let mut heavy = report();
    heavy.corrections = vec![correction("link.base.payload_mass", 2.0, 0.0, "kg")];
    let heavy = files(&heavy, &go2(), None, "run", &[], &[], Gains::default());
    let page = text_of(&heavy, "report.html");
    assert!(heavy.iter().all(|f| f.0 != "mjcf_fragment.xml"));
    assert!(text_of(&heavy, "mjcf_by_hand.txt").contains("- in <body name=\"base\">"));
    assert!(
        page.contains("By hand: in &lt;body name=&quot;base&quot;&gt;") && page.contains("&lt;inertial mass="),
        "{page}"
    );
    let closed: serde_json::Value = serde_json::from_str(&to_json(&empty())).unwrap();
    assert!(closed["gap"]["closed"].is_null(), "{closed}");
}
