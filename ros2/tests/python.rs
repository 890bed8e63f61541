//! The driver commands what the node of `python/examples/go2_cone.py` commands, on the same pictures, odometry and times. That node runs over a
//! stand-in for rclpy, which no package index has; its policy runs in onnxruntime.

#[path = "policy/mod.rs"]
mod policy;
#[path = "../../fixtures/skipped.rs"]
mod skipped;

use cone_node::driver::Driver;
use cone_node::messages::{Pose, Quaternion, Vector3};
use qv_nav::navigator::Navigator;
use std::path::Path;
use std::process::Command;

const SCRIPT: &str = "
import importlib.util, json, math, sys, types
import numpy as np

class Node:
    def __init__(self, name): self.errors = []
    def create_subscription(self, *_): pass
    def create_timer(self, *_): pass
    def create_publisher(self, *_): return types.SimpleNamespace(publish=lambda twist: sent.append(twist))
    def get_clock(self): return types.SimpleNamespace(now=lambda: types.SimpleNamespace(nanoseconds=now * 1e9))
    def get_logger(self): return types.SimpleNamespace(error=lambda said: None)

space, sent, now = types.SimpleNamespace, [], 0.0
twist = lambda: space(linear=space(x=0.0, y=0.0), angular=space(z=0.0))
for name, members in {'rclpy': {}, 'rclpy.node': {'Node': Node}, 'geometry_msgs': {}, 'geometry_msgs.msg': {'Twist': twist},
                      'nav_msgs': {}, 'nav_msgs.msg': {'Odometry': object}, 'sensor_msgs': {},
                      'sensor_msgs.msg': {'Image': object}, 'quadverse': {}}.items():
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].__dict__.update(members)

def load(name, path):
    spec = importlib.util.spec_from_file_location(name, path)
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module

root, policy, pictures, events = sys.argv[1:]
navigation = load('quadverse.navigation', root + '/quadverse/navigation.py')
node = load('go2_cone', root + '/examples/go2_cone.py').ConeNode(navigation.Navigator(policy, 'yellow'))
pictures = np.fromfile(pictures, np.uint8).reshape(-1, 480, 3 * 640 + 8)
for now, picture, encoding, pose in json.load(open(events)):
    if picture is not None:
        data = pictures[picture].tobytes()
        node.on_image(space(height=480, width=640, encoding=encoding, step=3 * 640 + 8, data=data))
    if pose is not None:
        x, y, qx, qy, qz, qw = pose
        pose = space(position=space(x=x, y=y, z=0.3), orientation=space(x=qx, y=qy, z=qz, w=qw))
        node.on_odometry(space(pose=space(pose=pose)))
    now += 0.05
    node.decide()
json.dump([[t.linear.x, t.linear.y, t.angular.z] for t in sent], sys.stdout)
";

/// A time, which picture comes then and how it is encoded, and where the robot is.
type Event = (f64, Option<usize>, &'static str, Option<[f64; 6]>);

/// Turned a little about all axes, on the way along an arc.
fn pose(k: usize) -> [f64; 6] {
    let (k, yaw) = (k as f64, 0.4 + 0.1 * k as f64);
    let [x, y, z, w] = [0.03, -0.05, (0.5 * yaw).sin(), (0.5 * yaw).cos()];
    let length = (x * x + y * y + z * z + w * w).sqrt();
    [1.0 + 0.07 * k, -2.0 + 0.02 * k, x / length, y / length, z / length, w / length]
}

/// Twelve decisions: nothing, pictures and odometry, pictures missing, a picture of another kind, both again, and after the end.
fn events() -> Vec<Event> {
    let mut out: Vec<Event> = vec![(0.0, None, "", None), (0.2, None, "", Some(pose(0)))];
    out.extend((0..5).map(|k| (0.4 + 0.2 * k as f64, Some(k), "bgr8", Some(pose(k)))));
    out.extend([(1.4, None, "", Some(pose(5))), (1.6, None, "", Some(pose(5))), (1.8, None, "", Some(pose(5)))]);
    out.extend([(2.0, Some(1), "mono8", Some(pose(6))), (2.2, Some(2), "rgb8", Some(pose(6)))]);
    out.push((30.0, Some(3), "bgr8", Some(pose(7))));
    out
}

/// The same here.
fn driven(bytes: &[u8], events: &[Event]) -> Vec<[f64; 3]> {
    let mut driver = Driver::new(Navigator::new(bytes, "yellow").unwrap());
    let one = |&(at, picture, encoding, place): &Event| {
        if let Some(k) = picture {
            let picture = policy::picture(40 * k as u8);
            driver.see(cone_node::messages::Image { encoding: encoding.into(), ..picture }, at);
        }
        if let Some([px, py, x, y, z, w]) = place {
            let position = Vector3 { x: px, y: py, z: 0.3 };
            driver.moved(Pose { position, orientation: Quaternion { x, y, z, w } }, at);
        }
        driver.decide(at + 0.05).unwrap_or_default()
    };
    events.iter().map(one).collect()
}

#[test]
fn the_python_node_commands_the_same() {
    let python = std::env::var_os("QV_PYTHON_ONNX").unwrap_or_else(|| "python3".into());
    let works = Command::new(&python).args(["-c", "import numpy, onnxruntime"]).output();
    if !works.is_ok_and(|output| output.status.success()) {
        skipped::skipped("no Python with numpy and onnxruntime (cargo xtask ros2 makes one)");
        return;
    }
    let (bytes, events) = (policy::policy(), events());
    let commands = driven(&bytes, &events);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python");
    std::fs::create_dir_all(&folder).unwrap();
    let files = ["policy.onnx", "pictures.bin", "events.json"].map(|name| folder.join(name));
    let pictures = (0..5).flat_map(|k| policy::picture(40 * k).data).collect();
    for (file, bytes) in files.iter().zip([bytes, pictures, serde_json::to_vec(&events).unwrap()]) {
        std::fs::write(file, bytes).unwrap();
    }
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../python");
    let output = Command::new(python).args(["-c", SCRIPT]).arg(package).args(files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let expected: Vec<[f64; 3]> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(expected.len(), commands.len());
    for (k, (a, b)) in commands.iter().zip(&expected).enumerate() {
        assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-4), "event {k}: {a:?} here, {b:?} in Python");
    }
    let stands: Vec<bool> = commands.iter().map(|c| *c == [0.0; 3]).collect();
    let [t, f] = [true, false];
    // The picture of 1.2 s is 0.25 s old at 1.45 s, and 0.45 s at 1.65 s.
    assert_eq!(stands, [t, t, f, f, f, f, f, f, t, t, t, f, t], "{commands:?}");
}
