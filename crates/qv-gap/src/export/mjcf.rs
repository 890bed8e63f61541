//! The corrections as an MJCF fragment: classes for joints, motors and ground, mass properties to paste, and the rest in
//! words.

use super::advice::advice;
use super::corrected::{CorrectionTarget, Entry, ModelCorrections, short};
use crate::report::Correction;
use glam::DQuat;
use qv_page::escape;
use qv_sim::{Model, Shape, SimOptions};
use std::fmt::Write;

/// Fields that a joint's class says.
const JOINT: [&str; 4] = ["armature", "viscous_friction", "coulomb_friction", "quadratic_drag"];
/// A spring that a joint's class says where it pulls to zero without slack: MuJoCo's `springref` is in the unit of the user's file.
const SPRING: [&str; 3] = ["spring_stiffness", "spring_rest", "spring_slack"];
/// Fields of a motor that go into its class when its gains are known.
const MOTOR: [&str; 4] = ["strength", "kp_scale", "kd_scale", "torque_limit"];
/// Shortest time step that a delayed command is kept for \[s\]: MuJoCo keeps samples, one a step.
const LEAST_STEP: f64 = 5e-4;
/// Fields of the contact that go into the ground's class.
const CONTACT: [&str; 4] =
    ["contact.friction", "contact.time_constant", "contact.damping_ratio", "contact.restitution"];
const SLIDE_ONLY: [&str; 2] = ["contact.torsional_friction", "contact.rolling_friction"];

/// MuJoCo refuses a file without an element.
const NOTHING: &str = "  <custom/>\n";

/// The corrections as MJCF for the `model` of a robot, which MuJoCo reads by `<include file="mjcf_fragment.xml"/>`.
///
/// Joints, motors and the ground get one default class each, `calibrated_<joint>` and `calibrated_ground`; links get an
/// `<inertial>` in their own frame in a comment, to be pasted, since MJCF cannot change a body from outside; what MJCF cannot
/// say is a comment with what to do elsewhere. `kp` \[N m/rad\] and `kd` \[N m s/rad\] are the gains of the recording, shape
/// `[joints]` in the model's order; empty when they are not known, zero for motors that take torques.
pub fn to_mjcf(model: &Model, corrections: &[Correction], kp: &[f64], kd: &[f64]) -> String {
    let corrected = ModelCorrections::new(model, corrections);
    let mut text = String::from("<mujocoinclude>\n");
    if corrected.entries.is_empty() {
        return text + NOTHING + "  <!-- The diagnosis corrects nothing. -->\n</mujocoinclude>\n";
    }
    let Fragment { classes, grounds, pasted, advice } = Fragment::new(&corrected, kp, kd);
    if classes.is_empty() && grounds.is_empty() {
        text += "  <!-- Corrections that a diagnosis found; MuJoCo reads none of them from here. -->\n";
        text += NOTHING;
    } else {
        text += &how_to(&classes, &grounds);
    }
    if corrected.entries.iter().any(|e| CONTACT.contains(&e.field)) {
        // Friction found with one cone and impedance ratio means something else with others.
        let ratio = SimOptions::default().impratio;
        let _ = writeln!(text, "  <option cone=\"elliptic\" impratio=\"{ratio}\"/>");
    }
    if !classes.is_empty() || !grounds.is_empty() {
        let _ = writeln!(text, "  <default>\n{}{}  </default>", classes.concat(), grounds.concat());
    }
    for element in pasted {
        let _ = writeln!(text, "  <!-- {} -->", in_comment(&element));
    }
    if !advice.is_empty() {
        text += "  <!-- MJCF cannot say the following; the program that drives the simulation can do it:\n";
        for line in advice {
            let _ = writeln!(text, "       - {}", in_comment(&line));
        }
        text += "  -->\n";
    }
    text + "</mujocoinclude>\n"
}

/// What has to be changed by hand where an included file changes nothing; `None` where it changes something.
pub(super) fn by_hand(model: &Model, corrections: &[Correction], kp: &[f64], kd: &[f64]) -> Option<Vec<String>> {
    let Fragment { classes, grounds, pasted, advice } =
        Fragment::new(&ModelCorrections::new(model, corrections), kp, kd);
    (classes.is_empty() && grounds.is_empty()).then(|| [pasted, advice].concat())
}

/// What a fragment says.
struct Fragment {
    /// Default classes of joints and motors, and of the ground: what MuJoCo reads.
    classes: Vec<String>,
    grounds: Vec<String>,
    /// Elements to paste.
    pasted: Vec<String>,
    /// What MJCF cannot say.
    advice: Vec<String>,
}

impl Fragment {
    fn new(corrected: &ModelCorrections, kp: &[f64], kd: &[f64]) -> Self {
        let gains = |j: usize| Some((*kp.get(j)?, *kd.get(j)?));
        let joints = 0..corrected.model.joints.len();
        Self {
            classes: joints.filter_map(|j| joint_class(corrected, j, gains(j))).collect(),
            grounds: ground_classes(corrected),
            pasted: bodies(corrected).into_iter().chain(geoms(corrected)).chain(floor(corrected)).collect(),
            advice: advice(corrected, |e| is_said(corrected, e, gains)),
        }
    }
}

fn how_to(classes: &[String], grounds: &[String]) -> String {
    let mut text = String::from(
        "  <!-- Corrections that a diagnosis found. Put <include file=\"mjcf_fragment.xml\"/> right under <mujoco>.\n",
    );
    if !classes.is_empty() {
        text += "       Give each joint below and its actuator class=\"calibrated_JOINT\" and delete the attributes that the \
                 class sets\n       from the elements themselves; where they have a class already, copy the attributes \
                 into it.\n";
    }
    if classes.iter().any(|class| class.contains(" delay=")) {
        text += &format!(
            "       Delays of commands need MuJoCo 3.5 or later, and a time step of {LEAST_STEP} s or more.\n"
        );
    }
    if classes.iter().any(|class| has_drag(class)) {
        text += "       The second number of damping, per squared speed, needs MuJoCo 4.\n";
    }
    if !grounds.is_empty() {
        text += "       Give the floor class=\"calibrated_ground\": its priority makes its contact parameters hold, \
                 whatever the feet say.\n";
    }
    text + "  -->\n"
}

/// Whether a class has two numbers of damping.
fn has_drag(class: &str) -> bool {
    class
        .split_once(" damping=\"")
        .and_then(|(_, rest)| rest.split_once('"'))
        .is_some_and(|(value, _)| value.contains(' '))
}

/// The class of a joint and its motor; `None` when nothing about them is corrected that MJCF can say.
fn joint_class(corrected: &ModelCorrections, j: usize, gains: Option<(f64, f64)>) -> Option<String> {
    let joint = joint_attributes(corrected, j);
    let motor = motor(corrected, j, gains).unwrap_or_default();
    if joint.is_empty() && motor.is_empty() {
        return None;
    }
    let joint = if joint.is_empty() { joint } else { format!("      <joint{joint}/>\n") };
    let name = escape(&corrected.model.joints[j].name);
    Some(format!("    <default class=\"calibrated_{name}\">\n{joint}{motor}    </default>\n"))
}

fn joint_attributes(corrected: &ModelCorrections, j: usize) -> String {
    let set = |field: &str, name: &str| {
        corrected.joint(j, field).map_or(String::new(), |value| format!(" {name}=\"{}\"", short(value)))
    };
    let damping = match corrected.joint(j, "quadratic_drag") {
        None => set("viscous_friction", "damping"),
        Some(drag) => {
            let nominal = corrected.model.joints[j].viscous_friction;
            let viscous = corrected.joint(j, "viscous_friction").unwrap_or(nominal);
            format!(" damping=\"{} {}\"", short(viscous), short(drag))
        }
    };
    let spring = match has_plain_spring(corrected, j) {
        true => set("spring_stiffness", "stiffness") + " springref=\"0\"",
        false => String::new(),
    };
    [set("armature", "armature"), damping, set("coulomb_friction", "frictionloss"), spring].concat()
}

/// Whether a spring is corrected that pulls to zero without slack.
fn has_plain_spring(corrected: &ModelCorrections, j: usize) -> bool {
    let [stiffness, rest, slack] = SPRING.map(|field| corrected.joint(j, field));
    stiffness.is_some() && rest.unwrap_or(0.0) == 0.0 && slack.unwrap_or(0.0) == 0.0
}

/// The motor's element: a position servo with the gains as they act, or a torque motor where both gains are zero.
fn motor(corrected: &ModelCorrections, j: usize, gains: Option<(f64, f64)>) -> Option<String> {
    let limit = corrected.joint(j, "torque_limit");
    let delay = corrected.joint(j, "command_latency").filter(|x| *x > 0.0).map_or(String::new(), delay);
    if delay.is_empty() && !MOTOR.iter().any(|field| corrected.joint(j, field).is_some()) {
        return None;
    }
    let scale = |field: &str| corrected.joint(j, field).unwrap_or(1.0);
    let (strength, range) =
        (scale("strength"), |x: f64| format!(" forcelimited=\"true\" forcerange=\"-{0} {0}\"", short(x)));
    let (kp, kd) = match gains {
        Some(gains) => gains,
        None => {
            let limited = limit.map_or(String::new(), range);
            let is_said = !(limited.is_empty() && delay.is_empty());
            return is_said.then(|| format!("      <general{limited}{delay}/>\n"));
        }
    };
    if kp == 0.0 && kd == 0.0 {
        // The force is limited before the gear multiplies it.
        let range = limit.filter(|_| strength > 0.0).map_or(String::new(), |x| range(x / strength));
        return Some(format!("      <motor gear=\"{}\"{range}{delay}/>\n", short(strength)));
    }
    let (kp, kd) = (short(kp * scale("kp_scale") * strength), short(kd * scale("kd_scale") * strength));
    Some(format!("      <position kp=\"{kp}\" kv=\"{kd}\"{}{delay}/>\n", limit.map_or(String::new(), range)))
}

/// A command that MuJoCo holds back, from 3.5 on: it keeps `nsample` of them, which must span the delay.
fn delay(latency: f64) -> String {
    let samples = (latency / LEAST_STEP).ceil() + 1.0;
    format!(" delay=\"{}\" nsample=\"{samples}\" interp=\"zoh\"", short(latency))
}

fn ground_classes(corrected: &ModelCorrections) -> Vec<String> {
    let mut classes = Vec::new();
    let contact = contact_attributes(corrected);
    if !contact.is_empty() {
        classes.push(format!(
            "    <default class=\"calibrated_ground\">\n      <geom priority=\"1\"{contact}/>\n    </default>\n"
        ));
    }
    for entry in &corrected.entries {
        if let CorrectionTarget::Material(name) = entry.part {
            let (name, friction) = (escape(name), friction(corrected, entry.correction.value));
            classes.push(format!(
                "    <default class=\"calibrated_ground_{name}\">\n      <geom priority=\"1\"{friction}/>\n    </default>\n"
            ));
        }
    }
    classes
}

fn friction(corrected: &ModelCorrections, sliding: f64) -> String {
    // What is not corrected is as in the simulator, whose values are MuJoCo's.
    let length = |name: &str, neutral: f64| short(corrected.world(name).unwrap_or(neutral));
    format!(" friction=\"{} {} {}\"", short(sliding), length(SLIDE_ONLY[0], 0.005), length(SLIDE_ONLY[1], 0.0001))
}

fn contact_attributes(corrected: &ModelCorrections) -> String {
    let mut text = corrected.world(CONTACT[0]).map_or(String::new(), |mu| friction(corrected, mu));
    let [time_constant, ratio, restitution] = [1, 2, 3].map(|k| corrected.world(CONTACT[k]));
    if time_constant.is_some() || ratio.is_some() || restitution.is_some() {
        let (time_constant, ratio) = (time_constant.unwrap_or(0.008), ratio.unwrap_or(1.0));
        let bouncing = restitution.filter(|e| *e > 0.0).map(damping_for_restitution);
        // The damping that gives the rebound, at the same stiffness.
        let (time_constant, ratio) = bouncing.map_or((time_constant, ratio), |b| (time_constant * ratio / b, b));
        let _ = write!(text, " solref=\"{} {}\"", short(time_constant), short(ratio));
    }
    text
}

/// Damping ratio of a spring and damper that never pulls and returns this part of the impact speed (Schwager and Pöschel,
/// Granular Matter 9, 2007, eq. 21), by bisection.
fn damping_for_restitution(restitution: f64) -> f64 {
    let rebound = |ratio: f64| {
        let root = (1.0 - ratio * ratio).sqrt();
        (-ratio / root * (2.0 * ratio * root).atan2(2.0 * ratio * ratio - 1.0)).exp()
    };
    let (mut low, mut high) = (1e-6, 1.0 - 1e-6);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if rebound(middle) > restitution { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// An `<inertial>` for each link that changes: MJCF's body frame is the link's, its `fullinertia` the entries of the tensor.
fn bodies(corrected: &ModelCorrections) -> Vec<String> {
    let changed = (0..corrected.model.links.len()).filter(|&l| corrected.changes_link(l));
    changed.filter_map(|l| Some(inertial(corrected, l, corrected.body(l)?))).collect()
}

fn inertial(corrected: &ModelCorrections, l: usize, body: super::corrected::Body) -> String {
    let name = &corrected.model.links[l].name;
    let merged: Vec<&str> =
        corrected.model.frames.iter().filter(|f| f.link == Some(l)).map(|f| f.name.as_str()).collect();
    // Bodies that are welded to this one in the MJCF bring their own mass along.
    let others: Vec<&str> = merged.into_iter().filter(|other| other != name).collect();
    let note = if others.is_empty() { String::new() } else { format!(" (it includes {})", others.join(", ")) };
    let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    format!(
        "in <body name=\"{}\">{}, in place of its own: <inertial mass=\"{}\" pos=\"{}\" fullinertia=\"{}\"/>",
        escape(name),
        escape(&note),
        body.mass,
        list(&body.com.to_array()),
        list(&body.moments())
    )
}

/// The new size of each round shape whose radius changes.
fn geoms(corrected: &ModelCorrections) -> Vec<String> {
    let one = |g: usize| {
        let geom = &corrected.model.geoms[g];
        let offset = corrected.geom(g, "radius_offset")?;
        let (kind, radius) = match geom.shape {
            Shape::Sphere(radius) => ("sphere", radius),
            Shape::Capsule { radius, .. } => ("capsule", radius),
            _ => return None,
        };
        let body = escape(&corrected.model.links[geom.link].name);
        Some(format!("in <body name=\"{body}\">: the radius (first size) of its {kind} is {}", short(radius + offset)))
    };
    (0..corrected.model.geoms.len()).filter_map(one).collect()
}

const FLOOR: [&str; 3] = ["terrain.height", "terrain.slope_x", "terrain.slope_y"];

/// Where the floor is when it is raised or tilted.
fn floor(corrected: &ModelCorrections) -> Option<String> {
    let values = FLOOR.map(|name| corrected.world(name));
    if values.iter().all(Option::is_none) {
        return None;
    }
    let [height, x, y] = values.map(|v| v.unwrap_or(0.0));
    // Rising along x is a turn about -y.
    let q = DQuat::from_rotation_y(-x) * DQuat::from_rotation_x(y);
    let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(short);
    Some(format!("the floor, if it is at the origin and level: pos=\"0 0 {}\" quat=\"{w} {x} {y} {z}\"", short(height)))
}

/// Whether the fragment says a correction in MJCF's own terms.
fn is_said(corrected: &ModelCorrections, entry: &Entry, gains: impl Fn(usize) -> Option<(f64, f64)>) -> bool {
    match entry.part {
        CorrectionTarget::Joint(j) => {
            let limit = entry.field == "torque_limit";
            let motor =
                entry.field == "command_latency" || (MOTOR.contains(&entry.field) && (limit || gains(j).is_some()));
            let spring = SPRING.contains(&entry.field) && has_plain_spring(corrected, j);
            JOINT.contains(&entry.field) || spring || motor
        }
        CorrectionTarget::Link(l) => corrected.body(l).is_some() && entry.field != "length_scale",
        CorrectionTarget::Geom(g) => {
            let round = matches!(corrected.model.geoms[g].shape, Shape::Sphere(_) | Shape::Capsule { .. });
            entry.field == "radius_offset" && round
        }
        CorrectionTarget::Material(_) => true,
        CorrectionTarget::World => {
            let slides = corrected.world(CONTACT[0]).is_some();
            CONTACT.contains(&entry.field)
                || FLOOR.contains(&entry.field)
                || (slides && SLIDE_ONLY.contains(&entry.field))
        }
        CorrectionTarget::Nothing => false,
    }
}

/// Text that may stand in an XML comment. Two hyphens end one; as a character reference the second is one still where
/// the text is pasted as an attribute.
pub(super) fn in_comment(text: &str) -> String {
    let clean: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let inner = clean.replace("--", "-&#45;");
    if inner.ends_with('-') { inner + " " } else { inner }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_cannot_be_left() {
        for text in ["a-->b", "---", "--", "a-", "a\nb--"] {
            let inside = in_comment(text);
            assert!(!inside.contains("--") && !inside.ends_with('-') && !inside.contains('\n'), "{inside}");
        }
    }

    #[test]
    fn damping_gives_the_rebound() {
        // A mass on the spring and damper, until it leaves.
        for restitution in [0.2, 0.5, 0.8] {
            let ratio = damping_for_restitution(restitution);
            let (mut x, mut v, step) = (0.0, -1.0, 1e-5);
            loop {
                let force: f64 = -x - 2.0 * ratio * v;
                if force <= 0.0 && v > 0.0 {
                    break;
                }
                v += step * force;
                x += step * v;
            }
            assert!((v - restitution).abs() < 1e-3, "{v} for {restitution}");
        }
    }
}
