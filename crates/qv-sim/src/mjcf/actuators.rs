//! The `<actuator>` section: gains and limits of joints.
//!
//! An actuator's force is `gain u + b0 + b1 l + b2 dl/dt`, with `l` the joint's position times the gear; the torque is the force
//! times the gear: <https://mujoco.readthedocs.io/en/stable/computation/index.html#force-generation>.

use super::attributes::{Attributes, Classes};
use super::frames::Compiler;
use super::joints::largest;
use super::tree::Tree;
use crate::SimError;

/// Short forms that set gain and bias of the same settings.
const KINDS: [&str; 4] = ["general", "motor", "position", "velocity"];
/// Short forms that have no counterpart here.
const OTHERS: [&str; 7] = ["intvelocity", "damper", "cylinder", "muscle", "adhesion", "plugin", "dcmotor"];

/// Gain and bias that follow the forms of an element and its defaults, one after the other.
struct Settings {
    /// The gain is a number, not one that changes with the state.
    is_plain: bool,
    gain: f64,
    bias: [f64; 3],
    /// A filter of the control.
    is_filtered: bool,
}

/// What one actuator adds to its joint.
pub(super) struct Actuator {
    pub joint: String,
    /// At the joint \[N m/rad\].
    pub kp: f64,
    /// At the joint \[N m s/rad\].
    pub kd: f64,
    /// In place of `kd`, the ratio to critical damping, which needs the joint's inertia.
    pub damping_ratio: Option<f64>,
    /// Most torque \[N m\]; infinity where none is stated.
    pub effort: f64,
    /// Joint position per unit of its control; `None` for a motor, whose control is a torque.
    pub position_per_control: Option<f64>,
}

/// All actuators of joints; what is not one of them goes to `left_out`.
pub(super) fn read(
    tree: &Tree,
    classes: &Classes,
    compiler: &Compiler,
    left_out: &mut Vec<String>,
) -> Result<Vec<Actuator>, SimError> {
    let mut all = Vec::new();
    for element in tree.section("actuator") {
        let place = tree.place(element);
        let mut lose = |what: &str| left_out.push(format!("{}: {what} {place}", tree.label(element)));
        let tag = tree.element(element).tag.as_str();
        if !KINDS.contains(&tag) {
            lose("a kind of actuator that is not here");
            continue;
        }
        let class = classes.of(tree, element, 0)?;
        let mut layers = vec![element];
        layers.extend(classes.layers(tree, class, &KINDS));
        let own = Attributes { tree, layers };
        let Some(joint) = own.text("joint").or(own.text("jointinparent")) else {
            lose("no joint is what it drives");
            continue;
        };
        if !classes.layers(tree, class, &OTHERS).is_empty() {
            lose("the defaults of its class for another kind of actuator");
        }
        let settings = settings(&own)?;
        if !settings.is_plain {
            lose("a gain or bias that is not a number");
            continue;
        }
        if settings.is_filtered {
            lose("the filter of its control");
        }
        let actuator = actuator(&own, compiler, joint, &settings)?;
        if let Some(scale) = actuator.position_per_control.filter(|s| (s - 1.0).abs() > 1e-9) {
            lose(&format!("the scale of its control (1 is a position of {scale})"));
        }
        all.push(actuator);
    }
    Ok(all)
}

/// The forms from the farthest default to the element itself, each over those before.
fn settings(own: &Attributes) -> Result<Settings, SimError> {
    let mut all = Settings { is_plain: true, gain: 1.0, bias: [0.0; 3], is_filtered: false };
    for &layer in own.layers.iter().rev() {
        let form = Attributes::plain(own.tree, layer);
        match own.tree.element(layer).tag.as_str() {
            "motor" => all = Settings { is_plain: true, gain: 1.0, bias: [0.0; 3], is_filtered: false },
            "position" => {
                all.gain = form.number_or("kp", all.gain)?;
                all.bias[1] = -all.gain;
                if let Some(kv) = form.number("kv")? {
                    all.bias[2] = -kv;
                }
                if let Some(ratio) = form.number("dampratio")? {
                    all.bias[2] = ratio;
                }
                all.is_filtered |= form.number_or("timeconst", 0.0)? > 0.0;
                all.is_plain = true;
            }
            "velocity" => {
                all.gain = form.number_or("kv", all.gain)?;
                all.bias = [0.0, 0.0, -all.gain];
                all.is_plain = true;
            }
            _ => general(&form, &mut all)?,
        }
    }
    Ok(all)
}

fn general(form: &Attributes, all: &mut Settings) -> Result<(), SimError> {
    if let Some(gain) = form.numbers("gainprm", 1, 64)? {
        all.gain = gain[0];
    }
    if let Some(bias) = form.numbers("biasprm", 1, 64)? {
        for (own, stated) in all.bias.iter_mut().zip(&bias) {
            *own = *stated;
        }
    }
    if let Some(kind) = form.text("gaintype") {
        all.is_plain = kind == "fixed";
    }
    match form.text("biastype") {
        Some("none") => all.bias = [0.0; 3],
        Some("affine") | None => {}
        Some(_) => all.is_plain = false,
    }
    if let Some(kind) = form.text("dyntype") {
        all.is_filtered = kind != "none";
    }
    Ok(())
}

fn actuator(own: &Attributes, compiler: &Compiler, joint: &str, all: &Settings) -> Result<Actuator, SimError> {
    let gear = own.numbers("gear", 1, 6)?.map_or(1.0, |g| g[0]);
    let force = own.range("forcerange", "forcelimited", compiler.autolimits)?;
    let control = own.range("ctrlrange", "ctrllimited", compiler.autolimits)?;
    let mut effort = force.map_or(f64::INFINITY, |range| gear.abs() * largest(range));
    let [_, b1, b2] = all.bias;
    let is_motor = b1 == 0.0 && b2 == 0.0;
    if let Some(range) = control.filter(|_| is_motor) {
        effort = effort.min((gear * all.gain).abs() * largest(range));
    }
    // A positive b2 is the ratio that <position dampratio> states.
    let damping_ratio = (b2 > 0.0 && all.gain == -b1).then_some(b2);
    if b1 > 0.0 || (b2 > 0.0 && damping_ratio.is_none()) {
        return Err(own.error("a bias against the motion, or none", format!("{:?}", all.bias)));
    }
    Ok(Actuator {
        joint: joint.to_owned(),
        kp: gear * gear * -b1,
        kd: if damping_ratio.is_some() { 0.0 } else { gear * gear * -b2 },
        damping_ratio,
        effort,
        position_per_control: (b1 != 0.0 && gear != 0.0).then(|| all.gain / -b1 / gear),
    })
}
