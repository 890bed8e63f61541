//! What public URDFs have that ours have not: each loads, with a word where one is owed, or is refused with link or joint and
//! line.

use crate::robots::inertial;
use glam::{DMat3, DVec3};
use qv_sim::{BaseKind, Batch, Model, ModelOptions, SimError, SimOptions, State, Terrain};

fn read(urdf: &str) -> Result<Model, SimError> {
    Model::from_urdf(urdf, &ModelOptions::default())
}

/// A base of 3 kg with an arm; `on_base` and `on_arm` stand inside their links, `more` after the joint in line 4.
fn robot(on_base: &str, on_arm: &str, limit: &str, more: &str) -> String {
    let base = inertial(3.0, 0.02);
    format!(
        "<robot name=\"r\">\n<link name=\"base\">{base}{on_base}</link>\n<link name=\"arm\">{on_arm}</link>\n\
         <joint name=\"j\" type=\"revolute\"><parent link=\"base\"/><child link=\"arm\"/><axis xyz=\"0 1 0\"/>{limit}</joint>\n\
         {more}</robot>"
    )
}

const LIMIT: &str = r#"<limit lower="-1" upper="1" effort="3" velocity="4"/>"#;

fn fixed(inertial: &str) -> String {
    format!(
        "<link name=\"camera\">{inertial}</link><joint name=\"c\" type=\"fixed\"><parent link=\"base\"/><child link=\"camera\"/>\
         <origin xyz=\"0.1 0 0\"/></joint>"
    )
}

fn mass(kg: f64, [xx, xy, xz, yy, yz, zz]: [f64; 6]) -> String {
    format!(
        "<inertial><mass value=\"{kg}\"/><inertia ixx=\"{xx}\" ixy=\"{xy}\" ixz=\"{xz}\" iyy=\"{yy}\" iyz=\"{yz}\" izz=\"{zz}\"/></inertial>"
    )
}

#[test]
fn what_loads_and_what_is_told_of_it() {
    let arm = inertial(0.5, 0.001);
    let two = r#"<visual><geometry><box size="1 1 1"/></geometry><material name="a"/><material name="b"/></visual>"#;
    let odd = [1e-3, 0.0, 0.0, 1e-3, 0.0, 3e-3];
    // What, the URDF, words of the one sentence that is reported, if any.
    let cases: [(&str, String, &[&str]); 11] = [
        ("two materials", robot(two, &arm, LIMIT, ""), &[]),
        ("a frame with a mass of nothing", robot("", &arm, LIMIT, &fixed(&mass(1e-6, [0.0; 6]))), &[]),
        ("a frame without inertial", robot("", &arm, LIMIT, &fixed("")), &[]),
        (
            "a frame with a singular inertia",
            robot("", &arm, LIMIT, &fixed(&mass(1e-6, [1e-6; 6]))),
            &["`camera`", "line 5"],
        ),
        (
            "a camera that no body is",
            robot("", &arm, LIMIT, &fixed(&mass(0.2, odd))),
            &["`camera`", "as they are", "`base`"],
        ),
        (
            "an arm that no body is",
            robot("", &mass(0.5, odd), LIMIT, ""),
            &["`arm`", "3.000e-3", "line 3", "as they are"],
        ),
        (
            "a negative moment",
            robot("", &mass(0.5, [1e-3, 0.0, 0.0, 1e-3, 0.0, -1e-3]), LIMIT, ""),
            &["`arm`", "nearest"],
        ),
        ("limits upside down", robot("", &arm, r#"<limit lower="2" upper="-1"/>"#, ""), &["`j`", "2 to -1", "line 4"]),
        (
            "no speed in limits",
            robot("", &arm, r#"<limit lower="-1" upper="2" effort="1"/>"#, ""),
            &["`j`", "`velocity`", "line 4"],
        ),
        (
            "a mass without inertia",
            robot("", "<inertial><mass value=\"0.5\"/></inertial>", LIMIT, ""),
            &["`arm`", "point mass", "line 3"],
        ),
        ("prefixes without declarations", robot("<old:tag old:x=\"1\"><new:tag/></old:tag>", &arm, LIMIT, ""), &[]),
    ];
    for (what, urdf, words) in cases {
        // An absent `velocity` alone is reported for the limits upside down as well.
        let model = read(&urdf).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert!(model.left_out.is_empty(), "{what}: {:?}", model.left_out);
        assert_eq!(model.remarks.is_empty(), words.is_empty(), "{what}: {:?}", model.remarks);
        for word in words {
            assert!(model.remarks.iter().any(|t| t.contains(word)), "{what}: expected `{word}` in {:?}", model.remarks);
        }
        let mut batch = Batch::<f64>::new(&model, &Terrain::plane(), &SimOptions::default(), 1).expect(what);
        batch.step_many(100);
        assert!(batch.state(0).unwrap().q.iter().all(|x| x.is_finite()), "{what}");
    }
}

#[test]
fn limits_upside_down_are_those_the_right_way_up() {
    let urdf = robot("", &inertial(0.5, 0.001), r#"<limit lower="2" upper="-1" velocity="1"/>"#, "");
    let joint = &read(&urdf).unwrap().joints[0];
    assert_eq!((joint.lower, joint.upper), (-1.0, 2.0));
}

#[test]
fn merged_links_weigh_what_their_parts_do() {
    let odd = [1e-3, 0.0, 0.0, 1e-3, 0.0, 3e-3];
    let model = read(&robot("", &inertial(0.5, 0.001), LIMIT, &fixed(&mass(1.0, odd)))).unwrap();
    let base = &model.links[0];
    assert_eq!(base.mass, 4.0);
    assert!((base.com - DVec3::new(0.025, 0.0, 0.0)).length() < 1e-15);
    // Two parts 0.1 m apart: the reduced mass of 0.75 kg adds 0.0075 kg m² about y and z.
    let right = DMat3::from_diagonal(DVec3::new(0.021, 0.0285, 0.0305));
    assert!((base.inertia - right).to_cols_array().iter().all(|x| x.abs() < 1e-15), "{}", base.inertia);
    // An inertia that is positive definite is used as it is, though no body has it.
    let model = read(&robot("", &mass(0.5, odd), LIMIT, "")).unwrap();
    assert_eq!(model.links[1].inertia, DMat3::from_diagonal(DVec3::new(1e-3, 1e-3, 3e-3)));
}

#[test]
fn a_floating_joint_below_the_world_is_the_free_base() {
    let arm = inertial(0.5, 0.001);
    let world = "<link name=\"world\"/><link name=\"map\"/><link name=\"post\"><inertial><mass value=\"9\"/></inertial></link>\
         <joint name=\"m\" type=\"fixed\"><parent link=\"world\"/><child link=\"map\"/></joint>\
         <joint name=\"p\" type=\"fixed\"><parent link=\"world\"/><child link=\"post\"/></joint>\
         <joint name=\"f\" type=\"floating\"><parent link=\"map\"/><child link=\"base\"/></joint>";
    let urdf = robot("", &arm, LIMIT, world);
    let (model, plain) = (read(&urdf).unwrap(), read(&robot("", &arm, LIMIT, "")).unwrap());
    assert_eq!((model.nq(), model.nv(), model.links[0].name.as_str()), (8, 7, "base"));
    assert_eq!(model.frame("world").unwrap().link, None);
    let fall = |model: &Model| {
        let mut batch = Batch::<f64>::new(model, &Terrain::plane(), &SimOptions::default(), 1).unwrap();
        let q = vec![0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.3];
        batch.set_state(0, &State { q, v: vec![0.1; 7] }).unwrap();
        batch.step_many(200);
        batch.state(0).unwrap().q.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(fall(&model), fall(&plain));
    let held = Model::from_urdf(&urdf, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap();
    assert_eq!((held.nq(), held.links.len()), (1, 1));
}

#[test]
fn what_is_refused_says_where() {
    let arm = inertial(0.5, 0.001);
    let floating =
        "<link name=\"b\"/><joint name=\"f\" type=\"floating\"><parent link=\"arm\"/><child link=\"b\"/></joint>";
    let cases: [(&str, String, &[&str]); 20] = [
        ("a moving link without mass", robot("", "", LIMIT, ""), &["`arm`", "positive mass", "line 3"]),
        ("a massless base", "<robot name=\"r\">\n<link name=\"b\"/></robot>".into(), &["`b`", "line 2"]),
        (
            "a base without inertia",
            format!("<robot name=\"r\">\n<link name=\"b\">{}</link></robot>", mass(1.0, [0.0; 6])),
            &["`b`", "line 2"],
        ),
        ("no iyz", robot("", &arm.replace("iyz=\"0\"", ""), LIMIT, ""), &["`arm`", "`iyz`", "line 3"]),
        ("no mass", robot("", "<inertial/>", LIMIT, ""), &["`arm`", "<mass>", "line 3"]),
        ("a word for a mass", robot("", &arm.replace("0.5", "half"), LIMIT, ""), &["`arm`", "`half`", "line 3"]),
        (
            "two origins",
            robot("<inertial><origin xyz=\"1 0 0\"/></inertial>", &arm, LIMIT, ""),
            &["`base`", "<inertial>", "line"],
        ),
        ("commas", robot("", &arm, "<origin xyz=\"1, 0, 0\"/>", ""), &["`j`", "`1, 0, 0`", "line 4"]),
        ("two numbers", robot("", &arm, "<origin rpy=\"1 0\"/>", ""), &["`j`", "3 numbers", "line 4"]),
        (
            "no parent",
            robot("", &arm, LIMIT, "").replace("<parent link=\"base\"/>", ""),
            &["`j`", "<parent>", "line 4"],
        ),
        ("no type", robot("", &arm, LIMIT, "").replace("type=\"revolute\"", ""), &["`j`", "`type`", "line 4"]),
        ("an unknown type", robot("", &arm, LIMIT, "").replace("revolute", "hinge"), &["`j`", "`hinge`", "line 4"]),
        ("a floating joint behind another", robot("", &arm, LIMIT, floating), &["`f`", "line 5"]),
        ("a link without a name", robot("", &arm, LIMIT, "<link/>"), &["<link>", "line 5"]),
        ("SDF", "<?xml version=\"1.0\"?><sdf version=\"1.7\"><model/></sdf>".into(), &["SDF"]),
        ("MJCF", "<mujoco model=\"x\"><worldbody/></mujoco>".into(), &["MJCF"]),
        ("HTML", "<!DOCTYPE html><html><body>404: Not Found</body></html>".into(), &["web page"]),
        ("damaged HTML", "<!doctype html><html><br></html>".into(), &["web page"]),
        (
            "xacro",
            "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\"><xacro:include filename=\"a\"/></robot>".into(),
            &["xacro"],
        ),
        ("a pointer", "version https://git-lfs.github.com/spec/v1\noid sha256:0".into(), &["Git LFS"]),
    ];
    for (what, urdf, words) in cases {
        let error = read(&urdf).map(|_| ()).expect_err(what).to_string();
        for word in words {
            assert!(error.contains(word), "{what}: expected `{word}` in `{error}`");
        }
    }
}

/// Nesting of any depth is read on a small stack.
#[test]
fn deep_nesting_overflows_nothing() {
    let deep = 300_000;
    let nest = "<a>".repeat(deep) + &"</a>".repeat(deep);
    let urdf = robot(&nest, &inertial(0.5, 0.001), LIMIT, "");
    let cut = "<a>".repeat(deep);
    let small = std::thread::Builder::new().stack_size(256 << 10);
    small
        .spawn(move || {
            assert_eq!(read(&urdf).unwrap().links.len(), 2);
            assert!(read(&cut).is_err());
        })
        .unwrap()
        .join()
        .unwrap();
}
