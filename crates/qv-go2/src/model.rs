//! The Go2 as a URDF text, written from its published figures (Unitree's `go2_description`; calf and foot merged as
//! in MuJoCo Menagerie).
//!
//! Link frames: x forward, y left, z up at the zero pose; the base frame is midway between the hip joints. Joint order
//! is FL, FR, RL, RR × hip, thigh, calf. In [`urdf`] only the feet collide, in [`urdf_with_shapes`] the rest does, too.

use glam::{DMat3, DQuat, DVec3};
use std::fmt::Write;

/// Legs in joint order.
pub const LEGS: [&str; 4] = ["FL", "FR", "RL", "RR"];

/// The twelve joints in order.
pub const JOINT_NAMES: [&str; 12] = [
    "FL_hip_joint",
    "FL_thigh_joint",
    "FL_calf_joint",
    "FR_hip_joint",
    "FR_thigh_joint",
    "FR_calf_joint",
    "RL_hip_joint",
    "RL_thigh_joint",
    "RL_calf_joint",
    "RR_hip_joint",
    "RR_thigh_joint",
    "RR_calf_joint",
];

/// Links that carry a foot, in leg order: the foot sphere belongs to the calf.
pub const FOOT_LINKS: [&str; 4] = ["FL_calf", "FR_calf", "RL_calf", "RR_calf"];

/// Shapes of the feet in [`urdf_with_shapes`], in leg order. In [`urdf`] a foot is its calf's only shape and named after it.
pub const FOOT_SHAPES: [&str; 4] = ["FL_foot", "FR_foot", "RL_foot", "RR_foot"];

/// Joint angles of the stand \[rad\].
pub const STAND: [f64; 12] = [0.1, 0.8, -1.5, -0.1, 0.8, -1.5, 0.1, 1.0, -1.5, -0.1, 1.0, -1.5];

/// Position gain in common use \[N m/rad\].
pub const DEFAULT_KP: f64 = 40.0;
/// Velocity gain in common use \[N m s/rad\].
pub const DEFAULT_KD: f64 = 1.0;
/// Rotor inertia seen at each joint \[kg m²\], nominal.
pub const ARMATURE: f64 = 0.01;
/// Friction coefficient of foot on floor, nominal.
pub const FLOOR_FRICTION: f64 = 0.8;
/// Radius of the foot sphere \[m\].
pub const FOOT_RADIUS: f64 = 0.022;
/// Centre of the foot sphere in the calf frame \[m\].
pub const FOOT_IN_CALF: [f64; 3] = [-0.002, 0.0, -0.213];
/// Origin of the IMU in the base frame \[m\]; its axes are those of the base.
pub const IMU_IN_BASE: [f64; 3] = [-0.02557, 0.0, 0.04232];

/// Hip joint in the base frame, front left \[m\].
const HIP_IN_BASE: [f64; 3] = [0.1934, 0.0465, 0.0];
/// Sideways offset of the thigh joint from the hip joint \[m\].
const ABDUCTION: f64 = 0.0955;
/// Length of the thigh, hip pitch axis to knee axis \[m\].
const THIGH_LENGTH: f64 = 0.213;

/// Edges of the trunk's box about the base's origin, x, y, z \[m\].
const TRUNK: [f64; 3] = [0.3762, 0.0935, 0.114];
/// Radius of the hip's motor, and how far out from the hip joint its middle lies \[m\]; a sphere stands for it.
const HIP_MOTOR: [f64; 2] = [0.046, 0.08];
/// Wider half of the thigh's section \[m\]: radius of a capsule that is as long as the thigh.
const THIGH_RADIUS: f64 = 0.017;
/// Radius of the shank, how far it lies before the knee's axis, and how far below the knee it ends \[m\].
const SHANK: [f64; 3] = [0.012, 0.008, 0.18];

/// Mass properties as published: principal moments and the rotation of their axes.
struct Inertial {
    /// kg
    mass: f64,
    /// Centre of mass in the link frame \[m\].
    com: [f64; 3],
    /// Principal moments about the centre of mass \[kg m²\].
    principal: [f64; 3],
    /// `link_from_principal`, w x y z; rounded as published, hence normalised before use.
    wxyz: [f64; 4],
}

const BASE: Inertial = Inertial {
    mass: 6.921,
    com: [0.021112, 0.0, -0.005366],
    principal: [0.107027, 0.0980771, 0.0244531],
    wxyz: [-0.000543471, 0.713435, -0.00173769, 0.700719],
};
/// Front left; the others are reflections.
const HIP: Inertial = Inertial {
    mass: 0.678,
    com: [-0.0054, 0.00194, -0.000105],
    principal: [0.00088403, 0.000596003, 0.000479967],
    wxyz: [0.497014, 0.499245, 0.505462, 0.498237],
};
const THIGH: Inertial = Inertial {
    mass: 1.152,
    com: [-0.00374, -0.0223, -0.0327],
    principal: [0.00594973, 0.00584149, 0.000878787],
    wxyz: [0.829533, 0.0847635, -0.0200632, 0.551623],
};
const CALF: Inertial = Inertial {
    mass: 0.241352,
    com: [0.00629595, -0.000622121, -0.141417],
    principal: [0.0014901, 0.00146356, 5.31397e-05],
    wxyz: [0.710672, 0.00154099, -0.00450087, 0.703508],
};

impl Inertial {
    /// Inertia tensor about the centre of mass along the link axes \[kg m²\].
    fn tensor(&self) -> DMat3 {
        let [w, x, y, z] = self.wxyz;
        let link_from_principal = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let diagonal = DMat3::from_diagonal(DVec3::from_array(self.principal));
        link_from_principal * diagonal * link_from_principal.transpose()
    }

    /// The `<inertial>` element of this body reflected by `sign` (each component 1 or -1).
    fn element(&self, sign: DVec3) -> String {
        let com = sign * DVec3::from_array(self.com);
        let reflection = DMat3::from_diagonal(sign);
        let tensor = reflection * self.tensor() * reflection;
        format!(
            "<inertial><origin xyz=\"{}\" rpy=\"0 0 0\"/><mass value=\"{}\"/>\
             <inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/></inertial>",
            triple(com),
            self.mass,
            tensor.x_axis.x,
            tensor.y_axis.x,
            tensor.z_axis.x,
            tensor.y_axis.y,
            tensor.z_axis.y,
            tensor.z_axis.z
        )
    }
}

/// What a joint can do; the same on every leg but for the thigh's range.
struct Limits {
    /// rad
    range: [f64; 2],
    /// N m
    effort: f64,
    /// rad/s
    velocity: f64,
}

/// Limits of one joint: `kind` is 0 hip, 1 thigh, 2 calf.
#[allow(clippy::approx_constant)] // the published, rounded figures
fn limits(front: bool, kind: usize) -> Limits {
    match (kind, front) {
        (0, _) => Limits { range: [-1.0472, 1.0472], effort: 23.7, velocity: 30.1 },
        (1, true) => Limits { range: [-1.5708, 3.4907], effort: 23.7, velocity: 30.1 },
        (1, false) => Limits { range: [-0.5236, 4.5379], effort: 23.7, velocity: 30.1 },
        _ => Limits { range: [-2.7227, -0.83776], effort: 45.43, velocity: 15.7 },
    }
}

/// Largest torque of each joint in joint order \[N m\].
pub fn effort_limits() -> [f64; 12] {
    std::array::from_fn(|joint| limits(joint < 6, joint % 3).effort)
}

/// Position limits of each joint in joint order \[rad\].
pub fn position_limits() -> [(f64, f64); 12] {
    std::array::from_fn(|joint| limits(joint < 6, joint % 3).range.into())
}

/// The whole robot as URDF: links `base`, `imu` (fixed), and `<leg>_hip`, `<leg>_thigh`, `<leg>_calf` per leg.
///
/// Numbers are written with every digit, so that reading them back gives the same bits.
pub fn urdf() -> String {
    robot(false)
}

/// The robot of [`urdf`] with more to touch the ground: trunk (a box), hips (spheres), thighs and shanks (capsules, which
/// have few points). Each is the only shape of its link and named after it: `base`, `<leg>_hip`, `<leg>_thigh`, `<leg>_calf`.
/// The feet lie on links of their own without mass, [`FOOT_SHAPES`]. Mass and joints are the same.
///
/// Sizes are those of the published primitives; a thigh is a capsule instead of a box, and a shank a straight one instead
/// of two cylinders. Shapes of one link, and of links that share a joint, overlap: that matters with `self_collision` only.
pub fn urdf_with_shapes() -> String {
    robot(true)
}

fn robot(shapes: bool) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?>\n<robot name=\"go2\">\n");
    let trunk = if shapes {
        collision("base", DVec3::ZERO, &format!("<box size=\"{}\"/>", triple(DVec3::from_array(TRUNK))))
    } else {
        String::new()
    };
    push(&mut text, &format!("  <link name=\"base\">{}{trunk}</link>\n", BASE.element(DVec3::ONE)));
    push(&mut text, "  <link name=\"imu\"/>\n");
    let imu = triple(DVec3::from_array(IMU_IN_BASE));
    push(
        &mut text,
        &format!(
            "  <joint name=\"imu_joint\" type=\"fixed\"><parent link=\"base\"/><child link=\"imu\"/>\
             <origin xyz=\"{imu}\" rpy=\"0 0 0\"/></joint>\n"
        ),
    );
    for leg in 0..4 {
        push_leg(&mut text, leg, shapes);
    }
    text.push_str("</robot>\n");
    text
}

/// A `<collision>` element; origin in the link frame \[m\], its axes along the link's.
fn collision(name: &str, origin: DVec3, geometry: &str) -> String {
    let origin = triple(origin);
    format!(
        "<collision name=\"{name}\"><origin xyz=\"{origin}\" rpy=\"0 0 0\"/><geometry>{geometry}</geometry></collision>"
    )
}

/// A capsule along z between two heights \[m\], rounded ends included.
fn capsule(name: &str, x: f64, radius: f64, [low, high]: [f64; 2]) -> String {
    let length = high - low - 2.0 * radius;
    let middle = DVec3::new(x, 0.0, 0.5 * (low + high));
    collision(name, middle, &format!("<capsule radius=\"{radius}\" length=\"{length}\"/>"))
}

/// Shapes of hip, thigh and calf in [`urdf_with_shapes`]; `side` is 1 on the left and -1 on the right.
fn leg_shapes(name: &str, side: f64) -> [String; 3] {
    let [radius, out] = HIP_MOTOR;
    let hip =
        collision(&format!("{name}_hip"), DVec3::new(0.0, side * out, 0.0), &format!("<sphere radius=\"{radius}\"/>"));
    let thigh = capsule(&format!("{name}_thigh"), 0.0, THIGH_RADIUS, [-THIGH_LENGTH, 0.0]);
    let [radius, before, end] = SHANK;
    [hip, thigh, capsule(&format!("{name}_calf"), before, radius, [-end, 0.0])]
}

/// Links and joints of one leg.
fn push_leg(text: &mut String, leg: usize, shapes: bool) {
    let name = LEGS[leg];
    let (front, mirror) = (leg < 2, leg_reflection(leg));
    let sideways = DVec3::new(1.0, mirror.y, 1.0);
    let foot_in_calf = DVec3::from_array(FOOT_IN_CALF);
    let foot = |origin| collision(&format!("{name}_foot"), origin, &format!("<sphere radius=\"{FOOT_RADIUS}\"/>"));
    let [of_hip, of_thigh, of_calf] =
        if shapes { leg_shapes(name, mirror.y) } else { [String::new(), String::new(), foot(foot_in_calf)] };
    let parts = [
        ("hip", "base".to_string(), mirror * DVec3::from_array(HIP_IN_BASE), HIP.element(mirror), of_hip),
        ("thigh", format!("{name}_hip"), DVec3::new(0.0, mirror.y * ABDUCTION, 0.0), THIGH.element(sideways), of_thigh),
        ("calf", format!("{name}_thigh"), DVec3::new(0.0, 0.0, -THIGH_LENGTH), CALF.element(sideways), of_calf),
    ];
    for (kind, (part, parent, origin, inertial, collision)) in parts.into_iter().enumerate() {
        let axis = if kind == 0 { "1 0 0" } else { "0 1 0" };
        let Limits { range: [lower, upper], effort, velocity } = limits(front, kind);
        push(text, &format!("  <link name=\"{name}_{part}\">{inertial}{collision}</link>\n"));
        push(
            text,
            &format!(
                "  <joint name=\"{name}_{part}_joint\" type=\"revolute\"><parent link=\"{parent}\"/>\
                 <child link=\"{name}_{part}\"/><origin xyz=\"{}\" rpy=\"0 0 0\"/><axis xyz=\"{axis}\"/>\
                 <limit lower=\"{lower}\" upper=\"{upper}\" effort=\"{effort}\" velocity=\"{velocity}\"/></joint>\n",
                triple(origin)
            ),
        );
    }
    if shapes {
        push(
            text,
            &format!(
                "  <link name=\"{name}_foot\">{}</link>\n  <joint name=\"{name}_foot_joint\" type=\"fixed\">\
                 <parent link=\"{name}_calf\"/><child link=\"{name}_foot\"/><origin xyz=\"{}\" rpy=\"0 0 0\"/></joint>\n",
                foot(DVec3::ZERO),
                triple(foot_in_calf)
            ),
        );
    }
}

/// Signs that take the front left leg to this one: rear legs mirror in x, right legs in y.
fn leg_reflection(leg: usize) -> DVec3 {
    DVec3::new(if leg < 2 { 1.0 } else { -1.0 }, if leg.is_multiple_of(2) { 1.0 } else { -1.0 }, 1.0)
}

/// Centres of the feet in the base frame \[m\], in leg order, at joint angles `q` in joint order \[rad\].
pub fn foot_positions(q: &[f64; 12]) -> [DVec3; 4] {
    std::array::from_fn(|leg| {
        let mirror = leg_reflection(leg);
        let [hip, thigh, calf] = [q[3 * leg], q[3 * leg + 1], q[3 * leg + 2]];
        let in_thigh = DVec3::new(0.0, 0.0, -THIGH_LENGTH) + DQuat::from_rotation_y(calf) * DVec3::from(FOOT_IN_CALF);
        let in_hip = DVec3::new(0.0, mirror.y * ABDUCTION, 0.0) + DQuat::from_rotation_y(thigh) * in_thigh;
        mirror * DVec3::from(HIP_IN_BASE) + DQuat::from_rotation_x(hip) * in_hip
    })
}

/// Height of the base over level ground \[m\] at which the lowest foot just touches, base level, joints at `q` \[rad\].
pub fn touching_height(q: &[f64; 12]) -> f64 {
    let lowest = foot_positions(q).iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    FOOT_RADIUS - lowest
}

/// `x y z` with every digit; negative zeros, which reflections make, are written as zeros.
fn triple(v: DVec3) -> String {
    let v = v + DVec3::ZERO;
    format!("{} {} {}", v.x, v.y, v.z)
}

fn push(text: &mut String, part: &str) {
    write!(text, "{part}").expect("writing to a String cannot fail");
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Value of `attribute="…"` in the first element after `start`.
    fn number_after(text: &str, start: &str, attribute: &str) -> f64 {
        let from = text.find(start).unwrap_or_else(|| panic!("{start} is missing"));
        let key = format!("{attribute}=\"");
        let at = from + text[from..].find(&key).unwrap() + key.len();
        text[at..].split('"').next().unwrap().parse().unwrap()
    }

    fn triple_after(text: &str, start: &str, attribute: &str) -> Vec<f64> {
        let from = text.find(start).unwrap_or_else(|| panic!("{start} is missing"));
        let key = format!("{attribute}=\"");
        let at = from + text[from..].find(&key).unwrap() + key.len();
        text[at..].split('"').next().unwrap().split(' ').map(|n| n.parse().unwrap()).collect()
    }

    #[test]
    fn masses_are_the_published_ones() {
        let text = urdf();
        let mut total = 0.0;
        for (link, expected) in [("base", 6.921), ("FL_hip", 0.678), ("RR_thigh", 1.152), ("FR_calf", 0.241352)] {
            assert_eq!(number_after(&text, &format!("<link name=\"{link}\">"), "value"), expected, "{link}");
        }
        for part in text.split("<mass value=\"").skip(1) {
            total += part.split('"').next().unwrap().parse::<f64>().unwrap();
        }
        assert!((total - (6.921 + 4.0 * (0.678 + 1.152 + 0.241352))).abs() < 1e-12, "{total}");
    }

    #[test]
    fn joints_come_in_order() {
        let text = urdf();
        let found: Vec<&str> = text
            .split("<joint name=\"")
            .skip(1)
            .map(|part| part.split('"').next().unwrap())
            .filter(|name| *name != "imu_joint")
            .collect();
        assert_eq!(found, JOINT_NAMES);
    }

    #[test]
    fn right_mirrors_left_in_y_and_rear_mirrors_front_in_x() {
        let text = urdf();
        for part in ["hip", "thigh", "calf"] {
            for (attribute, sign) in
                [("ixx", 1.0), ("ixy", -1.0), ("ixz", 1.0), ("iyy", 1.0), ("iyz", -1.0), ("izz", 1.0)]
            {
                let left = number_after(&text, &format!("<link name=\"FL_{part}\">"), attribute);
                let right = number_after(&text, &format!("<link name=\"FR_{part}\">"), attribute);
                assert_eq!(left, sign * right, "{part} {attribute}");
            }
            let left = triple_after(&text, &format!("<link name=\"RL_{part}\">"), "xyz");
            let right = triple_after(&text, &format!("<link name=\"RR_{part}\">"), "xyz");
            assert_eq!(left, [right[0], -right[1], right[2]]);
        }
        for (attribute, sign) in [("ixx", 1.0), ("ixy", -1.0), ("ixz", -1.0), ("iyz", 1.0)] {
            let front = number_after(&text, "<link name=\"FL_hip\">", attribute);
            assert_eq!(front, sign * number_after(&text, "<link name=\"RL_hip\">", attribute), "{attribute}");
        }
        let thigh = "<link name=\"FL_thigh\">";
        assert_eq!(number_after(&text, thigh, "ixz"), number_after(&text, "<link name=\"RL_thigh\">", "ixz"));
        assert_eq!(triple_after(&text, "name=\"RR_hip_joint\"", "xyz"), [-0.1934, -0.0465, 0.0]);
        assert_eq!(triple_after(&text, "name=\"FR_thigh_joint\"", "xyz"), [0.0, -0.0955, 0.0]);
    }

    #[test]
    fn tensors_keep_the_principal_moments() {
        for body in [&BASE, &HIP, &THIGH, &CALF] {
            let tensor = body.tensor();
            let [a, b, c] = body.principal;
            assert!((tensor.determinant() / (a * b * c) - 1.0).abs() < 1e-12);
            let trace = tensor.x_axis.x + tensor.y_axis.y + tensor.z_axis.z;
            assert!((trace / (a + b + c) - 1.0).abs() < 1e-13);
            let squared = (tensor * tensor).to_cols_array();
            let trace_of_square = squared[0] + squared[4] + squared[8];
            assert!((trace_of_square / (a * a + b * b + c * c) - 1.0).abs() < 1e-13);
        }
        // The trunk is longest along x: its moment about x is the small one.
        let trunk = BASE.tensor();
        assert!((trunk.x_axis.x - 0.02448).abs() < 5e-4 && trunk.y_axis.y > 0.09 && trunk.z_axis.z > 0.09);
    }

    #[test]
    fn feet_at_the_stand() {
        // Two links of 0.213 m in the leg's plane, then the plane turned by the hip angle about x; FL by hand.
        let (hip, thigh, calf): (f64, f64, f64) = (0.1, 0.8, -1.5);
        let along = -0.213 * thigh.sin() - 0.213 * (thigh + calf).sin() - 0.002 * (thigh + calf).cos();
        let down = -0.213 * thigh.cos() - 0.213 * (thigh + calf).cos() + 0.002 * (thigh + calf).sin();
        let expected = DVec3::new(
            0.1934 + along,
            0.0465 + 0.0955 * hip.cos() - down * hip.sin(),
            0.0955 * hip.sin() + down * hip.cos(),
        );
        let feet = foot_positions(&STAND);
        assert!((feet[0] - expected).length() < 1e-15, "{} {expected}", feet[0]);
        assert!((feet[1] - feet[0] * DVec3::new(1.0, -1.0, 1.0)).length() < 1e-15);
        assert!((feet[3] - feet[2] * DVec3::new(1.0, -1.0, 1.0)).length() < 1e-15);
        assert!(feet[2].x < -0.2 && feet[0].x > 0.1);
        assert!((touching_height(&STAND) - (0.022 - expected.z)).abs() < 1e-15);
    }

    #[test]
    fn the_stand_is_within_limits() {
        for (joint, &angle) in STAND.iter().enumerate() {
            let Limits { range: [lower, upper], .. } = limits(joint < 6, joint % 3);
            assert!(lower < angle && angle < upper, "{}", JOINT_NAMES[joint]);
        }
        assert_eq!(effort_limits()[..3], [23.7, 23.7, 45.43]);
    }
}
