//! MJCF files as models: against MuJoCo (`fixtures/mjcf`), what is reported, what is refused.

use crate::against_mujoco::compare;
use crate::facts::States;
use qv_sim::mjcf::{MjcfModel, is_mjcf};
use qv_sim::{BaseKind, Model, ModelOptions, Shape};
use serde_json::Value;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/mjcf");

fn file(name: &str) -> Result<String, String> {
    std::fs::read_to_string(format!("{FOLDER}/{name}")).map_err(|e| format!("{name}: {e}"))
}

fn fixture(name: &str, base: BaseKind) -> MjcfModel {
    let options = ModelOptions { base, ..Default::default() };
    MjcfModel::read(&file(&format!("{name}.xml")).unwrap(), &options, &file).unwrap()
}

fn golden(name: &str) -> Value {
    serde_json::from_str(&file(&format!("golden/{name}.json")).unwrap()).unwrap()
}

fn check(name: &str, base: BaseKind) {
    let (read, golden) = (fixture(name, base), golden(name));
    let found = compare(&read, &golden);
    println!("{name}: {found:?}");
    let tolerance = golden["tolerance"]["relative"].as_f64().unwrap();
    let all =
        [found.mass, found.pose, found.kinetic_energy, found.center_of_mass, found.angular_momentum, found.joints];
    assert!(all.iter().all(|x| *x < tolerance), "{name}: {found:?}");
    assert!(found.motion < golden["tolerance"]["motion_rms"].as_f64().unwrap(), "{name}: {found:?}");
    assert!(found.frames > 30, "{name}: {found:?}");
}

#[test]
fn a_biped_of_classes_and_frames_is_mujocos() {
    check("biped", BaseKind::Floating);
}

#[test]
fn an_arm_that_weighs_what_its_geoms_do_is_mujocos() {
    check("arm", BaseKind::Fixed);
}

#[test]
fn what_lies_beside_the_model() {
    let biped = fixture("biped", BaseKind::Floating);
    let stand = biped.stand.unwrap();
    assert_eq!(stand.base, Some([0.0, 0.0, 0.33, 1.0, 0.0, 0.0, 0.0]));
    assert_eq!(stand.joints, [0.1, 0.8, -1.5, -0.1, 0.9, -1.6]);
    assert_eq!(biped.timestep, Some(0.002));
    let model = &biped.model;
    assert_eq!(model.frame("imu").map(|f| f.link), Some(Some(0)));
    let shapes: Vec<&str> = model.geoms.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(shapes, ["trunk_box", "a_thigh", "a_foot", "b_thigh", "b_foot"]);
    assert_eq!(model.left_out, ["body `crate`, which is free beside the robot (line 43)"]);
    for word in
        ["the plane (line 34)", "friction, condim of geoms", "integrator implicitfast", "kp 45 kd 1.5 of a_roll"]
    {
        assert!(model.remarks.iter().any(|t| t.contains(word)), "{word}: {:?}", model.remarks);
    }
    let arm = fixture("arm", BaseKind::Floating);
    assert_eq!(arm.stand.unwrap().joints, [0.1, 0.2, 0.3, -0.4, 0.5]);
    assert_eq!((arm.model.base, arm.model.links.len()), (BaseKind::Fixed, 5));
    assert!(arm.model.remarks.iter().any(|t| t.states("fixed")), "{:?}", arm.model.remarks);
    assert!(arm.model.remarks.iter().any(|t| t.states("`elbow`")), "{:?}", arm.model.remarks);
    assert!(arm.model.left_out.iter().any(|t| t.states("control")), "{:?}", arm.model.left_out);
    assert!(arm.model.geoms.iter().any(|g| matches!(&g.shape, Shape::Hull(points) if points.len() == 6)));
}

#[test]
fn a_free_base_can_be_held() {
    let held = fixture("biped", BaseKind::Fixed).model;
    assert_eq!((held.base, held.nq(), held.links.len()), (BaseKind::Fixed, 6, 6));
    assert_eq!(held.frame("trunk").unwrap().link_from_frame.position.to_array(), [0.0, 0.0, 0.4]);
}

/// A robot of one arm; `inside` stands in its moving body in line 4, `beside` after the bodies in line 5.
fn robot(inside: &str, beside: &str) -> String {
    format!(
        "<mujoco>\n<worldbody><body name=\"base\"><freejoint/><geom size=\"0.1\"/>\n<body name=\"arm\">\n{inside}</body></body></worldbody>\n{beside}</mujoco>"
    )
}

const JOINT: &str = "<joint name=\"j\"/><geom size=\"0.1\"/>";

fn read(xml: &str) -> Result<MjcfModel, String> {
    let nothing = |name: &str| match name {
        "odd.xml" => Ok("<mujocoinclude>\n<joint type=\"hinge\" axis=\"0 0\"/></mujocoinclude>".to_owned()),
        "urdf.xml" => Ok("<robot/>".to_owned()),
        _ => Err("there is none".to_owned()),
    };
    MjcfModel::read(xml, &ModelOptions::default(), &nothing).map_err(|e| e.to_string())
}

#[test]
fn what_is_left_out_is_named() {
    let cases: [(&str, String, &[&str]); 17] = [
        ("nothing", robot(JOINT, ""), &[]),
        (
            "no weight",
            robot(JOINT, "").replace("<body name=\"arm\"", "<body name=\"arm\" gravcomp=\"0.5\""),
            &["gravcomp 0.5 of body `arm`", "line 3"],
        ),
        (
            "a misspelt element",
            robot(&format!("{JOINT}<sight name=\"s\"/>"), ""),
            &["sight `s` in body `arm` (line 4)"],
        ),
        ("a misspelt section", robot(JOINT, "<actuators><motor joint=\"j\"/></actuators>"), &["<actuators>", "line 5"]),
        (
            "a misspelt attribute",
            robot("<joint name=\"j\" axsi=\"0 1 0\"/><joint axsi=\"0 1 0\"/><geom size=\"0.1\"/>", ""),
            &["attribute `axsi` of joint `j` (line 4) and 1 more"],
        ),
        (
            "a misspelt default",
            robot(JOINT, "<default>\n<geom frictoin=\"1\"/></default>"),
            &["attribute `frictoin` of <geom> (line 6): MuJoCo's <geom> has none"],
        ),
        (
            "a spring",
            robot("<joint name=\"j\" stiffness=\"3\"/><geom size=\"0.1\"/>", ""),
            &["the spring", "`j`", "line 4"],
        ),
        ("a tendon", robot(JOINT, "<tendon><fixed name=\"t\"/></tendon>"), &["fixed `t`", "<tendon>", "line 5"]),
        (
            "an equality",
            robot(JOINT, "<equality><weld body1=\"arm\"/></equality>"),
            &["<weld>", "<equality>", "line 5"],
        ),
        ("a muscle", robot(JOINT, "<actuator><muscle name=\"m\" joint=\"j\"/></actuator>"), &["muscle `m`", "line 5"]),
        ("a motor of a tendon", robot(JOINT, "<actuator><motor tendon=\"t\"/></actuator>"), &["<motor>", "no joint"]),
        ("a filter", robot(JOINT, "<actuator><position joint=\"j\" timeconst=\"0.1\"/></actuator>"), &["the filter"]),
        (
            "a mesh",
            robot(
                "<joint/><geom size=\"1\"/><geom type=\"mesh\" mesh=\"m\" mass=\"0\"/>",
                "<asset><mesh file=\"m.stl\"/></asset>",
            ),
            &["no reader for mesh `m.stl`"],
        ),
        (
            "a heightfield",
            robot("<joint/><geom size=\"1\"/><geom type=\"hfield\" mass=\"0\"/>", ""),
            &["`hfield`", "line 4"],
        ),
        (
            "pairs",
            robot(JOINT, "<contact><exclude body1=\"a\" body2=\"b\"/></contact>"),
            &["<contact>, 1 pairs and exclusions", "line 5"],
        ),
        ("balance", robot(JOINT, "<compiler settotalmass=\"3\"/>"), &["settotalmass", "line 5"]),
        (
            "damping of the base",
            robot(JOINT, "").replace("<freejoint/>", "<joint type=\"free\" damping=\"1\"/>"),
            &["damping of the free joint"],
        ),
    ];
    for (what, xml, words) in cases {
        let model = read(&xml).unwrap_or_else(|e| panic!("{what}: {e}")).model;
        let all = model.left_out.join("; ");
        assert_eq!(model.left_out.len(), usize::from(!words.is_empty()), "{what}: {all}");
        for word in words {
            assert!(all.contains(word), "{what}: expected `{word}` in `{all}`");
        }
    }
}

#[test]
fn what_is_refused_says_where() {
    let fitted = "<joint/><geom type=\"box\" mesh=\"m\"/>";
    let heavy = "<joint/><geom type=\"mesh\" mesh=\"m\"/>";
    let world = |inside: &str| format!("<mujoco><worldbody>\n{inside}</worldbody></mujoco>");
    let cases: [(&str, String, &[&str]); 28] = [
        (
            "a primitive that a mesh gives",
            robot(fitted, "<asset><mesh name=\"m\" file=\"m.obj\"/></asset>"),
            &["body `arm`", "positive mass", "a box that MuJoCo fits to mesh `m`", "line 4"],
        ),
        (
            "a mass that a mesh gives",
            robot(heavy, "<asset><mesh name=\"m\" file=\"m.obj\"/></asset>"),
            &["body `arm`", "positive mass", "(line 4)", "mesh `m` (line 5)", "no reader for mesh `m.obj`"],
        ),
        (
            "bodies of another element",
            world("<replicate count=\"2\"><body><joint/><geom size=\"1\"/></body></replicate>"),
            &["<body>", "<replicate> (line 2) is not followed"],
        ),
        (
            "a body of another file",
            world("<body name=\"a\"><attach model=\"m\"/></body>"),
            &["no link that moves", "<attach> (line 2) is not followed"],
        ),
        (
            "a mass of another element",
            robot("<joint/><frame><composite/><flexcomp name=\"f\"/></frame>", ""),
            &["body `arm`", "<composite> (line 4) is not", "<flexcomp> `f` (line 4) is not"],
        ),
        (
            "a misspelt joint",
            world("<body name=\"a\"><jiont name=\"j\"/><geom size=\"1\"/></body>"),
            &["no link that moves", "jiont `j` in body `a` (line 2)"],
        ),
        ("URDF", "<robot name=\"r\"/>".into(), &["<robot>"]),
        ("cut off", "<mujoco>".into(), &["MJCF"]),
        ("empty", "<mujoco/>".into(), &["<body>", "line 1"]),
        ("no mass", robot("<joint name=\"j\"/>", ""), &["body `arm`", "positive mass", "line 3"]),
        (
            "a ball",
            robot("<joint name=\"j\" type=\"ball\"/><geom size=\"1\"/>", ""),
            &["joint `j`", "`ball`", "line 4"],
        ),
        ("a free joint inside", robot("<freejoint name=\"f\"/><geom size=\"1\"/>", ""), &["freejoint `f`", "line 4"]),
        (
            "two numbers",
            robot("<joint name=\"j\" axis=\"0 1\"/>", ""),
            &["joint `j`", "3 finite numbers as `axis`", "line 4"],
        ),
        ("a word", robot("<joint/><geom name=\"g\" size=\"big\"/>", ""), &["geom `g`", "`size`", "`big`", "line 4"]),
        ("not finite", robot("<joint/><geom size=\"nan\"/>", ""), &["<geom>", "`nan`", "line 4"]),
        ("no size", robot("<joint/><geom name=\"g\"/>", ""), &["geom `g`", "1 positive number as `size`", "line 4"]),
        ("a class", robot("<joint class=\"odd\"/>", ""), &["<joint>", "default class", "`odd`", "line 4"]),
        (
            "a class twice",
            robot(JOINT, "<default><default class=\"a\"/><default class=\"a\"/></default>"),
            &["`a` again", "line 5"],
        ),
        (
            "two orientations",
            robot("<geom euler=\"0 0 1\" quat=\"1 0 0 0\" size=\"1\"/>", ""),
            &["quat and euler", "line 4"],
        ),
        ("no quaternion", robot("<geom quat=\"0 0 0 0\" size=\"1\"/>", ""), &["quaternion", "line 4"]),
        (
            "limits without a range",
            robot("<joint name=\"j\" limited=\"true\"/>", ""),
            &["joint `j`", "`range`", "line 4"],
        ),
        ("limits upside down", robot("<joint name=\"j\" range=\"1 0\"/>", ""), &["joint `j`", "1 to 0", "line 4"]),
        (
            "an inertial without inertia",
            robot("<joint/><inertial pos=\"0 0 0\" mass=\"1\"/>", ""),
            &["<inertial>", "`diaginertia`", "line 4"],
        ),
        ("no mesh", robot("<joint/><geom type=\"mesh\" mesh=\"m\"/>", ""), &["mesh of <asset>", "`m`", "line 4"]),
        (
            "a file that is not there",
            robot("<include file=\"arm.xml\"/>", ""),
            &["<include>", "`arm.xml`", "there is none", "line 4"],
        ),
        ("a fault in a file", robot("<include file=\"odd.xml\"/>", ""), &["`axis`", "line 2 of `odd.xml`"]),
        ("a file of another kind", robot("<include file=\"urdf.xml\"/>", ""), &["`urdf.xml`", "<robot>"]),
        (
            "a keyframe of another robot",
            robot(JOINT, "<keyframe><key qpos=\"0 0\"/></keyframe>"),
            &["<key>", "8 finite numbers", "line 5"],
        ),
    ];
    for (what, xml, words) in cases {
        let error = read(&xml).map(|_| ()).expect_err(what);
        for word in words {
            assert!(error.contains(word), "{what}: expected `{word}` in `{error}`");
        }
    }
}

#[test]
fn a_file_that_names_itself_ends() {
    let own = |_: &str| Ok("<mujoco><include file=\"own.xml\"/></mujoco>".to_owned());
    let error = Model::from_mjcf("<mujoco><include file=\"own.xml\"/></mujoco>", &ModelOptions::default(), &own);
    assert!(error.unwrap_err().to_string().states("`own.xml`"));
    let count = std::cell::Cell::new(0);
    let others = |_: &str| {
        count.set(count.get() + 1);
        Ok(format!("<mujoco><include file=\"{}.xml\"/></mujoco>", count.get()))
    };
    let error = Model::from_mjcf("<mujoco><include file=\"0.xml\"/></mujoco>", &ModelOptions::default(), &others);
    assert!(error.unwrap_err().to_string().states("files 64"));
}

#[test]
fn bodies_nested_to_any_depth_overflow_nothing() {
    let deep = 20_000;
    let frames = "<frame>".repeat(deep) + &"</frame>".repeat(deep);
    let bodies = "<body>".repeat(deep) + &"</body>".repeat(deep);
    let classes: String = (0..deep).map(|k| format!("<default class=\"c{k}\">")).collect();
    let beside = format!("<default>{classes}{}</default>", "</default>".repeat(deep));
    let xml = robot(&format!("{JOINT}{frames}{bodies}"), &beside);
    let small = std::thread::Builder::new().stack_size(256 << 10);
    small.spawn(move || assert_eq!(read(&xml).unwrap().model.links.len(), 2)).unwrap().join().unwrap();
}

#[test]
fn mjcf_is_told_from_other_files() {
    for (text, right) in [
        ("<mujoco/>", true),
        ("\u{feff}<?xml version=\"1.0\"?>\n<!-- a robot -->\n<mujoco model=\"x\">", true),
        ("<mujocoinclude/>", false),
        ("<robot name=\"mujoco\"/>", false),
        ("<!-- <mujoco> ", false),
        ("", false),
    ] {
        assert_eq!(is_mjcf(text), right, "{text}");
    }
}

#[test]
fn a_fixed_body_without_mass_needs_no_inertia() {
    let text = |neck: &str| {
        format!(
            r#"<mujoco model="m"><worldbody><body name="base"><inertial pos="0 0 0" mass="5" diaginertia="0.1 0.1 0.1"/><joint name="j"/>
            <body name="neck"><inertial pos="0 0 0.1" {neck}/></body></body></worldbody></mujoco>"#
        )
    };
    let none = |name: &str| Err(name.to_string());
    let options = ModelOptions { base: BaseKind::Fixed, ..Default::default() };
    let read = |neck: &str| MjcfModel::read(&text(neck), &options, &none).map(|read| read.model.mass());
    assert_eq!(read("mass=\"0\"").unwrap(), 5.0);
    assert!(read("mass=\"1\"").is_err(), "a mass has an inertia");
}
