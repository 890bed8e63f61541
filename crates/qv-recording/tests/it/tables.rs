//! Tables as other programs write them: all give the run of the plain one.

use crate::facts::States;
use qv_recording::limits::lift;
use qv_recording::read_table;
use qv_recording::run::{FaultKind, Run};
use qv_sim::{BaseKind, Model, ModelOptions};

const URDF: &str = r#"<robot name="r"><link name="base"><inertial><mass value="3"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="imu_link"/><joint name="m" type="fixed"><parent link="base"/><child link="imu_link"/>
<origin xyz="0.1 0 0.05" rpy="MOUNT"/></joint>
<link name="arm"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a/b c.d" type="revolute"><parent link="base"/><child link="arm"/><limit lower="-1" upper="1" effort="3" velocity="4"/></joint>
</robot>"#;

const TOML: &str = "robot = \"r.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 20\nkd = 0.5\n";

fn urdf(mount: &str) -> String {
    URDF.replace("MOUNT", mount)
}

fn read(csv: &str, toml: &str) -> Run {
    read_table(csv.as_bytes(), toml, Some(&urdf("0 0 0")), None).unwrap_or_else(|e| panic!("{e}\n{csv}"))
}

const ROWS: usize = 100;

/// A swing with stamps of `step` from `start`, cells between `separator`.
fn table(separator: &str, stamp: impl Fn(usize) -> String) -> String {
    let mut text = ["time", "cmd_pos.a/b c.d", "pos.a/b c.d", "vel.a/b c.d"].join(separator) + "\n";
    for k in 0..ROWS {
        let t = 0.002 * k as f64;
        let values = [0.4 * (6.0 * t).sin(), 0.39 * (6.0 * t).sin(), 2.34 * (6.0 * t).cos()];
        let cells: Vec<String> = values.iter().map(|x| format!("{x:.9}")).collect();
        text += &format!("{}{separator}{}\n", stamp(k), cells.join(separator));
    }
    text
}

fn seconds(k: usize) -> String {
    format!("{:.3}", 0.002 * k as f64)
}

#[test]
fn dialects_give_the_run_of_the_plain_table() {
    let plain = table(",", seconds);
    let right = read(&plain, TOML);
    assert_eq!((right.remarks.len(), right.lost.len()), (0, 0), "{:?} {:?}", right.remarks, right.lost);
    let with_index = |name: &str| {
        let rows = plain.lines().enumerate();
        let row =
            |(k, line): (usize, &str)| if k == 0 { format!("{name},{line}\n") } else { format!("{},{line}\n", k - 1) };
        rows.map(row).collect::<String>()
    };
    let line_ends = |end: &str| plain.lines().map(|l| format!("{l}{end}\n")).collect::<String>();
    let rows_alone = plain.replacen('\n', "\r", 1).replace('\n', ",\n").replacen('\r', "\n", 1);
    // What, the table, words of what is reported.
    let quoted = |line: &str| line.split(',').map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(",");
    let header = plain.lines().next().unwrap();
    let cases: [(&str, String, &[&str]); 22] = [
        ("semicolons", table(";", seconds), &["semicolons"]),
        ("tabs", table("\t", seconds), &["tabs"]),
        (
            "decimal commas",
            table(";", seconds)
                .replacen("a/b c.d", "a/b c#d", 3)
                .replace('.', ",")
                .replace("c#d", "c.d")
                .replace("cmd_pos,", "cmd_pos.")
                .replace("pos,a", "pos.a")
                .replace("vel,a", "vel.a"),
            &["semicolons", "decimal commas"],
        ),
        ("milliseconds", table(",", |k| (2 * k).to_string()), &["milliseconds"]),
        ("microseconds", table(",", |k| (2000 * k).to_string()), &["microseconds"]),
        ("nanoseconds", table(",", |k| (2_000_000 * k).to_string()), &["nanoseconds"]),
        (
            "nanoseconds since the epoch",
            table(",", |k| (1_700_000_000_123_456_789_u64 + 2_000_000 * k as u64).to_string()),
            &["nanoseconds"],
        ),
        ("an index without a name", with_index(""), &["column 1 (no name)"]),
        ("an index of pandas", with_index("Unnamed: 0"), &["Unnamed: 0"]),
        ("an index with a name", with_index("index"), &["column 1 (index)"]),
        ("separators at all ends", line_ends(","), &[]),
        ("separators at the ends of rows", rows_alone, &[]),
        ("three separators at all ends", line_ends(",,,"), &[]),
        ("a mark", format!("\u{feff}{plain}"), &[]),
        ("microseconds since boot", table(",", |k| (1_200_000_000 + 2000 * k).to_string()), &["microseconds"]),
        (
            "nanoseconds since boot",
            table(",", |k| (1_800_000_000_000_u64 + 2_000_000 * k as u64).to_string()),
            &["nanoseconds"],
        ),
        ("milliseconds since boot", table(",", |k| (1_209_600_000 + 2 * k).to_string()), &["milliseconds"]),
        ("a unit in the name", table(",", |k| (2 * k).to_string()).replacen("time", "time_ms", 1), &[]),
        ("a header in quotes", plain.replacen(header, &quoted(header), 1), &[]),
        ("a header in capitals", plain.replacen("time,cmd_pos", "TIME,CMD_POS", 1).replacen("pos.a", "Pos.a", 2), &[]),
        ("a header of NumPy", format!("# {plain}"), &[]),
        ("Excel's separator", format!("sep=;\n{}", table(";", seconds)), &["semicolons"]),
    ];
    for (what, csv, words) in cases {
        let run = read(&csv, TOML);
        assert_eq!(run.lost, [], "{what}");
        assert_eq!(run.joint_names, ["a/b c.d"], "{what}");
        assert_eq!(run.remarks.len(), words.len(), "{what}: {:?}", run.remarks);
        for word in words {
            assert!(run.remarks.iter().any(|t| t.contains(word)), "{what}: {:?}", run.remarks);
        }
        let (found, right) = (run.measured.position.unwrap(), right.measured.position.as_ref().unwrap());
        assert_eq!(found.values, right.values, "{what}");
        assert!(
            found.time.iter().zip(&right.time).all(|(a, b)| (a - b).abs() < 1e-9),
            "{what}: {:?}",
            &found.time[..4]
        );
    }
}

#[test]
fn a_stated_unit_of_time_holds() {
    // Four rows a second look like milliseconds.
    let slow = table(",", |k| format!("{}", 0.25 * k as f64));
    let of = |toml: &str| read(&slow, toml).measured.position.unwrap().time[4];
    assert_eq!(of(TOML), 0.001);
    assert_eq!(of(&format!("time_unit = \"s\"\n{TOML}")), 1.0);
    let error = read_table(slow.as_bytes(), &format!("time_unit = \"min\"\n{TOML}"), None, None).unwrap_err();
    assert!(error.to_string().states("time_unit `min`"), "{error}");
}

#[test]
fn degrees_become_radians_where_they_are_stated() {
    let right = read(&table(",", seconds), TOML).measured.position.unwrap();
    let in_degrees = |cell: &str| cell.parse::<f64>().unwrap().to_degrees().to_string();
    let line = |line: &str| match line.split_once(',') {
        Some((time, rest)) if time != "time" => {
            format!("{time},{}\n", rest.split(',').map(in_degrees).collect::<Vec<_>>().join(","))
        }
        _ => format!("{line}\n"),
    };
    let csv: String = table(",", seconds).lines().map(line).collect();
    let found = read(&csv, &format!("position_unit = \"deg\"\n{TOML}"));
    assert_eq!(found.lost, []);
    let found = found.measured.position.unwrap();
    assert!(found.values.iter().zip(&right.values).all(|(a, b)| (a - b).abs() < 1e-12));
}

#[test]
fn text_in_utf_16_is_read() {
    let bytes: Vec<u8> = format!("\u{feff}{}", table(",", seconds)).encode_utf16().flat_map(u16::to_le_bytes).collect();
    let run = read_table(bytes.as_slice(), TOML, Some(&urdf("0 0 0")), None).unwrap();
    assert_eq!((run.lost.len(), run.measured.position), (0, read(&table(",", seconds), TOML).measured.position));
}

#[test]
fn stops_that_the_recording_went_beyond_are_told_and_not_applied() {
    let run = read(&table(",", seconds), TOML);
    // It swings to 0.363 rad.
    for (upper, is_beyond) in [("1", false), ("0.36", false), ("0.3", true)] {
        let text = urdf("0 0 0").replace("upper=\"1\"", &format!("upper=\"{upper}\""));
        let options = ModelOptions { base: BaseKind::Fixed, ..Default::default() };
        let mut model = Model::from_urdf(&text, &options).unwrap();
        let remarks = lift(&run, &mut model).join("; ");
        assert_eq!(
            (remarks.is_empty(), model.joints[0].upper.is_infinite()),
            (!is_beyond, is_beyond),
            "{upper}: {remarks}"
        );
        if is_beyond {
            for word in ["joint `a/b c.d`", "-1.000 to 0.300 rad", "reaches 0.36", "no limit on its position"] {
                assert!(remarks.contains(word), "expected {word} in {remarks}");
            }
        }
    }
}

#[test]
fn gains_by_joint_are_commands() {
    let csv = table(",", seconds);
    for toml in [
        TOML.replace("kp = 20", "kp = [20]"),
        TOML.replace("kp = 20", "kp = { \"a/b c.d\" = 20 }"),
        TOML.to_owned() + "[joint.\"a/b c.d\"]\nkp = 20\narmature = 0.01\ntau_max = 2\n",
    ] {
        let run = read(&csv, &toml);
        assert_eq!(run.lost, [], "{toml}");
        let kp = run.commands.kp.unwrap();
        assert_eq!((kp.values, run.actuator.kp, run.actuator.kd), (vec![20.0], None, Some(0.5)), "{toml}");
    }
}

#[test]
fn what_a_table_lacks_is_told() {
    let plain = table(",", seconds);
    let sparse: String = plain
        .lines()
        .enumerate()
        .map(|(k, line)| {
            let keep = k == 0 || k % 3 == 0;
            if keep { format!("{line}\n") } else { format!("{},\n", line.rsplit_once(',').unwrap().0) }
        })
        .collect();
    let run = read(&sparse, TOML);
    let found = run.faults.iter().find(|f| f.kind == FaultKind::Sparse).unwrap_or_else(|| {
        panic!("two thirds of the velocities are missing: {:?} {:?}", run.faults, run.measured.velocity)
    });
    assert!(found.channel == "velocity a/b c.d" && found.detail.states("100 67 100"), "{found:?}");
    let one: String = plain.lines().take(2).map(|l| format!("{l}\n")).collect();
    let run = read(&one, TOML);
    assert!(run.faults.iter().any(|f| f.kind == FaultKind::Missing && f.detail.states("several")));
    assert!(read(&plain, TOML).faults.iter().all(|f| f.kind != FaultKind::Sparse));
}

/// A trunk that rolls back and forth, upright on average, and turns; the IMU turned by `mount` in its channels.
fn walk(mount: glam::DQuat, quaternion_scale: f64) -> String {
    use glam::{DQuat, DVec3};
    let mut text = String::from(
        "time,cmd_pos.a/b c.d,pos.a/b c.d,base.x,base.y,base.z,base.qw,base.qx,base.qy,base.qz,imu.qw,imu.qx,imu.qy,imu.qz,\
         gyro.x,gyro.y,gyro.z,acc.x,acc.y,acc.z\n",
    );
    for k in 0..500 {
        let t = 0.002 * k as f64;
        let (roll, rate) = (0.1 * (8.0 * t).sin(), 0.8 * (8.0 * t).cos());
        let base = DQuat::from_rotation_x(roll);
        let (imu, back) = (base * mount, mount.conjugate());
        let (gyro, acc) = (back * DVec3::new(rate, 0.0, 0.0), imu.conjugate() * DVec3::new(0.0, 0.0, 9.81));
        let cells = [
            vec![t, 0.1, 0.1 + 0.01 * (9.0 * t).sin(), 0.0, 0.0, 0.3, base.w, base.x, base.y, base.z],
            [imu.w, imu.x, imu.y, imu.z].map(|x| quaternion_scale * x).to_vec(),
            gyro.to_array().to_vec(),
            acc.to_array().to_vec(),
        ];
        let cells: Vec<String> = cells.concat().iter().map(|x| format!("{x:.12}")).collect();
        text += &format!("{}\n", cells.join(","));
    }
    text
}

const FREE: &str = "robot = \"r.urdf\"\nbase = \"free\"\n[actuator]\nkind = \"pd\"\nkp = 20\nkd = 0.5\n";

#[test]
fn an_imu_at_any_angle_is_turned_into_the_trunk_once() {
    let rpy = [0.4, -0.2, 2.0];
    let mount = qv_core::Pose::from_xyz_rpy([0.0; 3], rpy).rotation;
    let upside_down = qv_core::Pose::from_xyz_rpy([0.0; 3], [std::f64::consts::PI, 0.0, std::f64::consts::PI]).rotation;
    let quarter = glam::DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let plain = read_table(walk(glam::DQuat::IDENTITY, 1.0).as_bytes(), FREE, Some(&urdf("0 0 0")), None).unwrap();
    assert!(plain.remarks.is_empty(), "{:?}", plain.remarks);
    let stated = format!("{FREE}[imu]\nrotation = [0.4, -0.2, 2.0]\n");
    let upright = glam::DQuat::IDENTITY;
    // What, axes of the channels, run.toml, the URDF's link, words.
    let cases = [
        ("stated", mount, stated.as_str(), "0 0 0", "were turned"),
        ("stated against the link", mount, stated.as_str(), "3.1 0 0", "were turned"),
        ("by the link", mount, FREE, "0.4 -0.2 2", "were turned"),
        (
            "upside down, in the sensor's axes",
            upside_down,
            FREE,
            "3.141592653589793 0 3.141592653589793",
            "were turned",
        ),
        (
            "upside down, in the trunk's axes",
            upright,
            FREE,
            "3.141592653589793 0 3.141592653589793",
            "attitude and gyroscope and acceleration are in the trunk's",
        ),
        // Gravity does not distinguish these two; the poses do.
        (
            "a quarter turn, in the trunk's axes",
            upright,
            FREE,
            "0 0 1.5707963267948966",
            "attitude and gyroscope and acceleration are in the trunk's",
        ),
        ("a quarter turn, in the sensor's axes", quarter, FREE, "0 0 1.5707963267948966", "were turned"),
    ];
    for (what, axes, toml, link, word) in cases {
        let run = read_table(walk(axes, 1.0).as_bytes(), toml, Some(&urdf(link)), None).unwrap();
        assert_eq!(run.lost, [], "{what}");
        assert!(run.remarks.len() == 1 && run.remarks[0].contains(word), "{what}: {:?}", run.remarks);
        for (name, found, right) in [
            ("attitude", &run.measured.orientation, &plain.measured.orientation),
            ("gyroscope", &run.measured.gyro, &plain.measured.gyro),
            ("acceleration", &run.measured.acceleration, &plain.measured.acceleration),
        ] {
            let (found, right) = (found.as_ref().unwrap(), right.as_ref().unwrap());
            // A quaternion and its negative are one rotation.
            let sign = if name == "attitude" && found.values[0] * right.values[0] < 0.0 { -1.0 } else { 1.0 };
            let off = found.values.iter().zip(&right.values).map(|(a, b)| (sign * a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-8, "{what}: {name} off by {off}");
        }
    }
}

#[test]
fn a_mount_against_gravity_is_told() {
    let toml = format!("{FREE}[imu]\nrotation = [3.14159, 0.0, 0.0]\n");
    let run = read_table(walk(glam::DQuat::IDENTITY, 1.0).as_bytes(), &toml, Some(&urdf("0 0 0")), None).unwrap();
    assert!(run.remarks.iter().any(|t| t.states("contradicts") && t.states("leans 3.14")), "{:?}", run.remarks);
}

#[test]
fn quaternions_that_are_no_rotation_are_told() {
    let right = read_table(walk(glam::DQuat::IDENTITY, 1.0).as_bytes(), FREE, Some(&urdf("0 0 0")), None).unwrap();
    let run = read_table(walk(glam::DQuat::IDENTITY, 1.5).as_bytes(), FREE, Some(&urdf("0 0 0")), None).unwrap();
    let found = run.faults.iter().find(|f| f.kind == FaultKind::NoRotation).expect("a length of 1.5");
    assert!(found.channel == "orientation" && found.count == 500 && found.detail.contains("1.500"), "{found:?}");
    let (a, b) = (run.measured.orientation.unwrap(), right.measured.orientation.unwrap());
    assert!(a.values.iter().zip(&b.values).all(|(a, b)| (a - b).abs() < 1e-10));
    let run = read_table(walk(glam::DQuat::IDENTITY, 0.0).as_bytes(), FREE, Some(&urdf("0 0 0")), None).unwrap();
    let found = run.faults.iter().find(|f| f.kind == FaultKind::NoRotation).expect("no length");
    assert!(found.detail.states("kept 500"), "{found:?}");
}

#[test]
fn commands_are_read_as_run_toml_states() {
    let plain = table(",", |k| format!("{:.3}", 0.002 * k as f64));
    let right = read(&plain, TOML);
    let stated = format!(
        "{TOML}[commands]\ndelay = 0.004\nkp_scale = 2.0\n[joint.\"a/b c.d\"]\ncommand_scale = -0.5\ncommand_offset = 0.1\n"
    );
    let run = read(&plain, &stated);
    assert!(run.lost.is_empty(), "{:?}", run.lost);
    let (found, before) = (run.commands.position.unwrap(), right.commands.position.clone().unwrap());
    assert!(found.values.iter().zip(&before.values).all(|(a, b)| (a - (0.1 - 0.5 * b)).abs() < 1e-12));
    assert!(found.time.iter().zip(&before.time).all(|(a, b)| (a - b - 0.004).abs() < 1e-12));
    assert_eq!((run.actuator.kp, run.actuator.kd), (Some(40.0), Some(0.5)));
    let turned = read(&plain, &format!("{TOML}[joint.\"a/b c.d\"]\nsign = -1\n"));
    let opposite =
        |a: &qv_core::JointSeries, b: &qv_core::JointSeries| a.values.iter().zip(&b.values).all(|(a, b)| *a == -b);
    assert!(opposite(turned.measured.position.as_ref().unwrap(), right.measured.position.as_ref().unwrap()));
    assert!(opposite(turned.commands.position.as_ref().unwrap(), &before));
    for (wrong, word) in
        [("sign = 2", "1 or -1"), ("command_of = \"b\"", "command_of"), ("columns_of = \"b\"", "columns_of")]
    {
        let toml = format!("{TOML}[joint.\"a/b c.d\"]\n{wrong}\n");
        let error = read_table(plain.as_bytes(), &toml, Some(&urdf("0 0 0")), None).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}
