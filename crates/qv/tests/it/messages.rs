//! What is said of bad files of every kind: each message names what was expected and what was found.

use qv_recording::foreign::motor_csv::Motors;
use qv_recording::foreign::{Settings, lerobot, motor_csv, sage};
use qv_recording::{BagFile, read_bag, read_table};
use qv_sim::{Model, ModelOptions};
use qv_splat::captures::rgbd_folders::{self, Folder, Layout};
use qv_splat::captures::{cameras_json, colmap, nerfstudio, rgbd};
use qv_splat::files::{points, read_named};
use std::collections::BTreeSet;
use std::fmt::Display;

/// Kind of file, what is wrong with it, words that the message has, the message.
type Row = (&'static str, &'static str, &'static str, String);

fn said<T>(result: Result<T, impl Display>) -> String {
    result.err().map_or_else(|| "no error".to_string(), |error| error.to_string())
}

fn scene(name: &str, bytes: &[u8]) -> String {
    said(read_named(bytes, name, &mut |_| Err("no such file".into())))
}

fn ply(header: &str, body: usize) -> String {
    let text = format!("ply\nformat binary_little_endian 1.0\n{header}end_header\n");
    scene("x.ply", &[text.as_bytes(), &vec![0; body]].concat())
}

fn transforms(text: &str) -> String {
    said(nerfstudio::read(text))
}

fn frame(matrix: &str, more: &str) -> String {
    transforms(&format!(
        "{{\"w\": 4, \"h\": 4, \"fl_x\": 4{more}, \"frames\": [{{\"file_path\": \"a\", \"transform_matrix\": {matrix}}}]}}"
    ))
}

const MATRIX: &str = "[[1,0,0,0],[0,1,0,0],[0,0,1,0]]";

fn folder(files: &[(&str, &str)]) -> String {
    let names: BTreeSet<String> = files.iter().map(|(name, _)| (*name).to_string()).collect();
    let mut text =
        |name: &str| Ok(files.iter().find(|(known, _)| *known == name).map_or("", |(_, text)| *text).to_string());
    let Some(layout) = Layout::of(&names) else { return "no layout".into() };
    said(rgbd_folders::read(layout, &mut Folder { names: &names, text: &mut text, sizes: &mut |_| Ok([640, 480]) }))
}

fn table(csv: &str, toml: &str) -> String {
    said(read_table(csv.as_bytes(), toml, None, None))
}

fn bag(bytes: &[u8]) -> String {
    said(read_bag([BagFile { name: "run.mcap".into(), source: bytes }], &qv_go2::wire::mapping(None)))
}

fn urdf(text: &str) -> String {
    said(Model::from_urdf(text, &ModelOptions::default()))
}

fn info(text: &str) -> String {
    said(lerobot::Info::read(text))
}

const ROBOT: &str = "robot = \"r.urdf\"";

fn scenes() -> Vec<Row> {
    let kind = "scene";
    let floats = |names: &str| names.split(' ').map(|name| format!("property float {name}\n")).collect::<String>();
    let vertex = format!("element vertex 1\n{}", floats("x y z"));
    vec![
        (kind, "empty", "expected a PLY, SPZ, GLB or glTF file", scene("x.ply", b"")),
        (kind, "a pointer of Git LFS", "found a pointer of Git LFS", scene("x.ply", b"version https://git-lfs.github.com/spec/v1\n")),
        (kind, "a picture", "found [89, 50, 4e, 47]", scene("x.spz", b"\x89PNG\r\n")),
        (kind, "PLY as text", "found ascii 1.0", scene("x.ply", b"ply\nformat ascii 1.0\nend_header\n")),
        (kind, "PLY, big-endian", "found binary_big_endian", scene("x.ply", b"ply\nformat binary_big_endian 1.0\nend_header\n")),
        (kind, "PLY without end of header", "expected a line end_header", scene("x.ply", b"ply\nformat binary_little_endian 1.0\n")),
        (kind, "PLY of points", "expected property f_dc_0, found x, y, z", ply(&vertex, 12)),
        (kind, "PLY cut off", "expected 12 bytes from byte", ply(&vertex, 11)),
        (kind, "PLY without vertices", "expected element vertex", ply("element face 0\nproperty list uchar int i\n", 0)),
        (kind, "PLY with faces before vertices", "before any with lists", ply(&format!("element face 1\nproperty list uchar int i\n{vertex}"), 13)),
        (kind, "PLY with a number of rows that is none", "expected a number of rows, found many", ply("element vertex many\n", 0)),
        (kind, "PLY of an unknown type", "expected a type of PLY, found half", ply("element vertex 1\nproperty half x\n", 2)),
        (kind, "SPZ that is no gzip", "16 bytes in gzip", scene("x.spz", b"\x1f\x8bxxxxxxxxxxxxxxxx")),
        (kind, "GLB of version 1", "expected version 2, found 1", scene("x.glb", b"glTF\x01\0\0\0\x0c\0\0\0")),
        (kind, "GLB of another length", "expected 12 bytes, as the file has", scene("x.glb", b"glTF\x02\0\0\0\x0d\0\0\0")),
        (kind, "glTF whose data is missing", "expected file a.bin, found no such file", scene("x.gltf", b"{\"asset\": {}, \"buffers\": [{\"uri\": \"a.bin\"}]}")),
        (kind, "glTF with bad Base64", "glTF buffer 0: expected Base64", scene("x.gltf", b"{\"asset\": {}, \"buffers\": [{\"uri\": \"data:x;base64,???\"}]}")),
        (kind, "other JSON", "found other JSON", scene("x.json", b"{\"a\": 1}")),
        (kind, "JSON that is none", "expected JSON", scene("x.gltf", b"{\"asset\": ")),
        (kind, ".splat cut off", "expected rows of 32 bytes, found 33 bytes", scene("x.splat", &[0; 33])),
        (kind, ".splat without numbers", "expected a row with finite numbers", scene("x.splat", &[0xff; 32])),
        (kind, ".ksplat", "cannot read a .ksplat file: splat-transform", scene("x.ksplat", &[0; 4096])),
        (kind, "SOG", "cannot read a SOG, or another ZIP archive: splat-transform", scene("x.sog", b"PK\x03\x04xxxx")),
        (kind, "SOG as a folder", "cannot read a SOG: splat-transform", scene("meta.json", b"{\"means\": {}, \"quats\": {}}")),
        (kind, "the index of a streamed SOG", "cannot read a SOG: splat-transform", scene("lod-meta.json", b"{\"lodLevels\": 3}")),
        ("points", "text cut off", "expected 2 points, found 1", said(points::read(b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n"))),
    ]
}

fn captures() -> Vec<Row> {
    let kind = "capture";
    let rgb = ("rgb.txt", "1.0 rgb/1.png\n");
    let pose = |text: &'static str| [rgb, ("groundtruth.txt", text)];
    let names = |all: &[&str]| all.iter().map(|name| (*name).to_string()).collect::<Vec<_>>();
    vec![
        (kind, "no JSON", "expected JSON", transforms("{")),
        (kind, "no frames", "expected a list `frames`, found none", transforms("{}")),
        (
            kind,
            "a mirrored pose",
            "frame 0, transform_matrix: expected a rotation and a position",
            frame("[[1,0,0,0],[0,1,0,0],[0,0,-1,0]]", ""),
        ),
        (kind, "a pose that is null", "expected 3 or 4 rows of 4 numbers, found null", frame("null", "")),
        (kind, "a pose with NaN", "expected 3 or 4 rows of 4 numbers", frame("[[NaN,0,0,0],[0,1,0,0],[0,0,1,0]]", "")),
        (kind, "a fisheye", "camera_model: expected OPENCV", frame(MATRIX, ", \"camera_model\": \"OPENCV_FISHEYE\"")),
        (kind, "NaN as the principal point", "cx: expected a number, found \"NaN\"", frame(MATRIX, ", \"cx\": NaN")),
        (
            kind,
            "half a pixel of width",
            "expected a whole number of pixels, found 4.5",
            transforms(&format!(
                "{{\"w\": 4.5, \"h\": 4, \"fl_x\": 4, \"frames\": [{{\"file_path\": \"a\", \"transform_matrix\": {MATRIX}}}]}}"
            )),
        ),
        (
            kind,
            "neither size nor image",
            "expected w and h, or an image to look at",
            transforms(&format!(
                "{{\"fl_x\": 4, \"frames\": [{{\"file_path\": \"a\", \"transform_matrix\": {MATRIX}}}]}}"
            )),
        ),
        (
            kind,
            "no focal length",
            "expected a focal length or an angle of view",
            transforms(&format!(
                "{{\"w\": 4, \"h\": 4, \"frames\": [{{\"file_path\": \"a\", \"transform_matrix\": {MATRIX}}}]}}"
            )),
        ),
        (
            kind,
            "our own JSON with a misspelt key",
            "found fz",
            said(cameras_json::read("{\"format\": \"qv-cameras/1\", \"cameras\": [{\"fz\": 1}]}")),
        ),
        (
            kind,
            "COLMAP's fisheye",
            "found OPENCV_FISHEYE",
            said(colmap::read_text("1 OPENCV_FISHEYE 4 4 1 1 2 2 0 0 0 0\n", "")),
        ),
        (
            kind,
            "COLMAP without its camera",
            "expected the number of a camera, found 7",
            said(colmap::read_text("1 PINHOLE 4 4 1 1 2 2\n", "1 1 0 0 0 0 0 0 7 a.png\n\n")),
        ),
        (kind, "COLMAP's binary cut off", "expected 8 bytes from byte 0", said(colmap::read_binary(&[1, 2], &[]))),
        (
            kind,
            "7-Scenes without poses",
            "expected a pose in a.pose.txt, found no such file",
            said(rgbd::read(&names(&["a.color.png"]), &mut |_| Ok(String::new()))),
        ),
        (kind, "TUM without poses", "expected groundtruth.txt with times and poses", folder(&[rgb])),
        (kind, "TUM with a short row", "groundtruth.txt, line 1: expected time, x, y, z", folder(&pose("1 2 3\n"))),
        (kind, "TUM with poses of another day", "without a pose within 0.02 s", folder(&pose("9 0 0 0 0 0 0 1\n"))),
        (
            kind,
            "TUM with words for times",
            "rgb.txt, line 1: expected a time, found now",
            folder(&[("rgb.txt", "now rgb/1.png"), ("groundtruth.txt", "")]),
        ),
        (
            kind,
            "Redwood without poses",
            "expected poses in trajectory.log",
            folder(&[("color/1.jpg", ""), ("depth/1.png", "")]),
        ),
        (
            kind,
            "Redwood with depth missing",
            "expected as many images in color as in depth, found 2 and 1",
            folder(&[("color/1.jpg", ""), ("color/2.jpg", ""), ("depth/1.png", "")]),
        ),
        (
            kind,
            "ScanNet without lens",
            "expected the lens in intrinsic/intrinsic_color.txt",
            folder(&[("color/0.jpg", ""), ("pose/0.txt", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1")]),
        ),
        (
            kind,
            "ScanNet that lost track",
            "without a pose that is a rotation",
            folder(&[("color/0.jpg", ""), ("pose/0.txt", "-inf -inf -inf")]),
        ),
    ]
}

fn recordings() -> Vec<Row> {
    let (kind, motors) = ("recording", Motors { joints: vec!["a".into()], wire: None, first: None });
    let settings = |text: &str| said(Settings::of(text));
    let of_sage = |state: &str, joints| said(sage::table(state, None, joints, &Settings::default()));
    vec![
        (kind, "an empty bag", "expected", bag(b"")),
        (kind, "a bag that is none", "expected", bag(b"this is no bag at all, whatever its name says")),
        (kind, "a bag of ROS 1", "found one of ROS 1", bag(b"#ROSBAG V2.0\nxxxxxxxxx")),
        (kind, "a table without times", "expected a column `time`", table("pos.a\n1\n", ROBOT)),
        (kind, "a table without positions", "expected columns `pos.<joint>`", table("time,x\n1,2\n", ROBOT)),
        (kind, "a table without rows", "expected at least one row", table("time,pos.a\n", ROBOT)),
        (
            kind,
            "a table with an unknown base",
            "base = \"fixed\" or \"free\"",
            table("time,pos.a\n0,1\n", &format!("{ROBOT}\nbase = \"wobbly\"")),
        ),
        (
            kind,
            "a table with gains for no joint",
            "kp",
            table("time,pos.a\n0,1\n", &format!("{ROBOT}\n[actuator]\nkind = \"pd\"\nkp = [1, 2]")),
        ),
        (
            kind,
            "a description without a robot",
            "expected a run description",
            table("time,pos.a\n0,1\n", "base = \"fixed\""),
        ),
        (
            kind,
            "LeRobot of version 1",
            "expected codebase_version v2.0, v2.1 or v3.0, found v1.6",
            info("{\"codebase_version\": \"v1.6\"}"),
        ),
        (kind, "LeRobot without features", "expected features, found none", info("{\"codebase_version\": \"v3.0\"}")),
        (kind, "LeRobot, no JSON", "meta/info.json: expected JSON", info("hello")),
        (kind, "a dataset in turns", "found `turns`", settings("[dataset]\nunit = \"turns\"")),
        (kind, "a dataset with a misspelt key", "unknown field `joint_names`", settings("[dataset]\njoint_names = []")),
        (kind, "SAGE without names", "expected names of 1 joints", of_sage("timestamp,positions\n0,[1]\n", None)),
        (kind, "SAGE without positions", "expected a column `positions`", of_sage("timestamp,angles\n", None)),
        (
            kind,
            "SAGE with words for numbers",
            "expected rows with positions",
            of_sage("timestamp,positions\n0,[x]\n", Some("a")),
        ),
        (
            kind,
            "LowState without times",
            "expected a column with the time",
            said(motor_csv::table("q_0\n1\n", &motors)),
        ),
        (kind, "LowState without motors", "such as motor_state[0].q", said(motor_csv::table("time,x\n1,2\n", &motors))),
    ]
}

fn robots_and_the_rest() -> Vec<Row> {
    let kind = "robot";
    let glb = |bytes: &[u8]| said(qv_mesh::files::glb::read(bytes));
    vec![
        (kind, "empty", "expected", urdf("")),
        (kind, "no XML", "expected", urdf("joint: hip")),
        (kind, "SDF", "SDF", urdf("<sdf version=\"1.9\"><model name=\"m\"/></sdf>")),
        (kind, "a web page", "expected", urdf("<!DOCTYPE html><html><body>404</body></html>")),
        (kind, "without links", "link", urdf("<robot name=\"r\"/>")),
        (
            kind,
            "a joint to nowhere",
            "elbow",
            urdf(
                "<robot name=\"r\"><link name=\"a\"/><joint name=\"elbow\" type=\"revolute\"><parent link=\"a\"/><child link=\"gone\"/></joint></robot>",
            ),
        ),
        (
            kind,
            "a joint of an unknown type",
            "elbow",
            urdf(
                "<robot name=\"r\"><link name=\"a\"/><link name=\"b\"/><joint name=\"elbow\" type=\"hinge\"><parent link=\"a\"/><child link=\"b\"/></joint></robot>",
            ),
        ),
        ("terrain", "empty", "expected", glb(b"")),
        ("terrain", "a picture", "expected", glb(b"\x89PNG\r\n\x1a\n....")),
        ("terrain", "GLB cut off", "expected", glb(b"glTF\x02\0\0\0\xff\0\0\0")),
        (
            "terrain",
            "PLY without faces",
            "expected",
            said(qv_mesh::files::ply::read(b"ply\nformat binary_little_endian 1.0\nend_header\n")),
        ),
        ("policy", "no ONNX", "expected", said(qv_policy::onnx::OnnxPolicy::from_bytes(b"hello"))),
        ("policy", "empty", "expected", said(qv_policy::onnx::OnnxPolicy::from_bytes(b""))),
    ]
}

#[test]
fn each_message_says_what_is_wrong() {
    let rows = [scenes(), captures(), recordings(), robots_and_the_rest()].concat();
    let mut wrong = vec![];
    for (kind, what, words, message) in &rows {
        if !message.contains(words) || message == "no error" {
            wrong.push(format!("{kind}, {what}: expected `{words}` in `{message}`"));
        }
        // One line for a terminal, whatever the file holds.
        if message.contains('\n') || message.chars().count() > 700 {
            wrong.push(format!("{kind}, {what}: expected one line, found {message:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let all: BTreeSet<(&str, &str)> = rows.iter().map(|(kind, what, _, _)| (*kind, *what)).collect();
    assert!(all.len() == rows.len() && rows.len() >= 60, "{} messages, {} of them differ", rows.len(), all.len());
}
