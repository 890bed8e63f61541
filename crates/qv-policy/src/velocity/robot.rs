//! The robot of a task: any four-legged (or otherwise footed) one, reported by its model and a few lines of TOML.

use super::propose;
use crate::PolicyError;
use qv_sim::mjcf::{Include, is_mjcf};
use qv_sim::{BaseKind, Geom, Model, ModelOptions};
use serde::Deserialize;
use std::collections::BTreeMap;

/// More feet than any robot here has.
pub(crate) const MOST_FEET: usize = 16;

/// What a walking task must know of a robot.
#[derive(Debug, Clone)]
pub struct TaskRobot {
    /// Its name, for files and pages.
    pub name: String,
    /// Its model, with armature, and with shapes for all that may touch the ground.
    pub model: Model,
    /// Joint angles of the stand \[rad\], `[joints]`.
    pub stand: Vec<f32>,
    /// Position gains \[N m/rad\], `[joints]`.
    pub kp: Vec<f32>,
    /// Velocity gains \[N m s/rad\], `[joints]`.
    pub kd: Vec<f32>,
    /// Radians by which a joint's target moves for an action of one, `[joints]`.
    pub action_scale: Vec<f32>,
    /// Shapes of the feet (indices into the model's), in the order of the legs.
    pub feet: Vec<usize>,
    /// Shapes that must not touch: an episode ends.
    pub trunk: Vec<usize>,
    /// All other shapes (thighs, shanks): touching costs.
    pub limbs: Vec<usize>,
    /// Joints that move legs sideways, `[joints]`: they stay near the stand.
    pub sideways: Vec<bool>,
    /// Height of the base over level ground in the stand \[m\].
    pub height: f32,
}

/// The TOML that describes a robot beside its URDF. What it leaves out is proposed from the model, see `propose.rs` and [`crate::stand`]. Joints are in the order of the URDF, depth first.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotFile {
    /// Its name; default: that of the URDF.
    pub name: Option<String>,
    /// File name of the URDF or MJCF, beside this file.
    pub urdf: String,
    /// Names of the legs, which with `joints` give the order of the joints: `<leg>_<joint>`. A check, no more.
    #[serde(default)]
    pub legs: Vec<String>,
    /// Names of a leg's joints, from the trunk outwards.
    #[serde(default)]
    pub joints: Vec<String>,
    /// Joint angles of the stand by joint name, or by the end of joint names \[rad\]; the longest name wins. Default: feet below hips.
    #[serde(default)]
    pub stand: BTreeMap<String, f32>,
    /// Position gain \[N m/rad\], one for all or by joint name (or its end). Default: in proportion to weight and height.
    pub kp: Option<PerJoint>,
    /// Velocity gain \[N m s/rad\]. Default: a fortieth of the position gain that is proposed.
    pub kd: Option<PerJoint>,
    /// Radians for an action of one; default 0.25.
    pub action_scale: Option<PerJoint>,
    /// Rotor inertia at each joint \[kg m²\]. Default: that of the model, else in proportion to the mass.
    pub armature: Option<f64>,
    /// Feet: names of shapes or links, or their ends, in the order of the legs. Default: the last shapes of four legs.
    #[serde(default)]
    pub feet: Vec<String>,
    /// Links or shapes (or the ends of their names) that must not touch the ground: an episode ends where one is of the base, touching
    /// costs for others. Default: all but the feet.
    #[serde(default)]
    pub must_not_touch: Vec<String>,
    /// Joints that move legs sideways, by the ends of their names; default: those whose axis is x.
    #[serde(default)]
    pub sideways: Vec<String>,
}

/// One number for all joints, or one by name.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum PerJoint {
    /// For all.
    All(f32),
    /// By joint name, or by the end of joint names.
    Named(BTreeMap<String, f32>),
}

impl PerJoint {
    /// One number for each joint.
    ///
    /// # Errors
    /// When a joint has none, or a number is not finite.
    pub fn resolve(&self, what: &str, model: &Model) -> Result<Vec<f32>, PolicyError> {
        let values = match self {
            Self::All(value) => vec![*value; model.joints.len()],
            Self::Named(named) => by_name(what, named, model)?,
        };
        match values.iter().find(|v| !v.is_finite()) {
            Some(bad) => Err(PolicyError::setting(what, "finite numbers", bad)),
            None => Ok(values),
        }
    }
}

/// Whether `pattern` names `name`: all of it, or its end.
fn names(pattern: &str, name: &str) -> bool {
    !pattern.is_empty() && name.ends_with(pattern)
}

/// One value for each joint, by the longest pattern that names it.
fn by_name(what: &str, named: &BTreeMap<String, f32>, model: &Model) -> Result<Vec<f32>, PolicyError> {
    if let Some(unused) = named.keys().find(|key| !model.joint_names().iter().any(|name| names(key, name))) {
        let expected = format!("the name, or the end of the name, of a joint: {}", model.joint_names().join(", "));
        return Err(PolicyError::setting(what, &expected, unused));
    }
    let find = |name: &String| {
        let longest = named.iter().filter(|(key, _)| names(key, name)).max_by_key(|(key, _)| key.len());
        longest.map(|(_, value)| *value).ok_or_else(|| {
            let keys = named.keys().cloned().collect::<Vec<_>>().join(", ");
            PolicyError::setting(what, &format!("a value for joint `{name}`"), keys)
        })
    };
    model.joint_names().iter().map(find).collect()
}

impl RobotFile {
    /// A file that names a model and leaves out all else.
    pub fn bare(model: &str) -> Self {
        Self {
            name: None,
            urdf: model.into(),
            legs: Vec::new(),
            joints: Vec::new(),
            stand: BTreeMap::new(),
            kp: None,
            kd: None,
            action_scale: None,
            armature: None,
            feet: Vec::new(),
            must_not_touch: Vec::new(),
            sideways: Vec::new(),
        }
    }

    /// # Errors
    /// When the text is not such a file; the line is reported.
    pub fn parse(text: &str) -> Result<Self, PolicyError> {
        toml::from_str(text).map_err(|e| PolicyError::Text { what: "robot file".into(), reason: e.to_string() })
    }

    /// The robot that this file and the text of its URDF describe, or of an MJCF that includes no other.
    ///
    /// # Errors
    /// When the model cannot be simulated, or a name or number of the file does not fit it.
    pub fn robot(&self, model: &str) -> Result<TaskRobot, PolicyError> {
        self.robot_with(model, &|name: &str| Err(format!("{name}: a model of one file is expected here")))
    }

    /// As [`RobotFile::robot`], with what gives the text of files that an MJCF includes.
    ///
    /// # Errors
    /// As [`RobotFile::robot`].
    pub fn robot_with(&self, model: &str, include: &Include) -> Result<TaskRobot, PolicyError> {
        let armature = self.armature.unwrap_or(0.0);
        if !(armature.is_finite() && armature >= 0.0) {
            return Err(PolicyError::setting("armature", "a finite number of at least 0", armature));
        }
        let options = ModelOptions { base: BaseKind::Floating, armature, ..Default::default() };
        let mut model = match is_mjcf(model) {
            true => Model::from_mjcf(model, &options, include)?,
            false => Model::from_urdf(model, &options)?,
        };
        if self.armature.is_none() {
            propose::add_armature(&mut model);
        }
        self.robot_of(model)
    }

    fn robot_of(&self, model: Model) -> Result<TaskRobot, PolicyError> {
        let legs = self.legs.iter().flat_map(|leg| self.joints.iter().map(move |joint| format!("{leg}_{joint}")));
        let named: Vec<String> = legs.collect();
        if !named.is_empty() && named != model.joint_names() {
            let expected = format!("the joints of the URDF in its order: {}", model.joint_names().join(", "));
            return Err(PolicyError::setting("legs and joints", &expected, named.join(", ")));
        }
        let stand = match self.stand.is_empty() {
            true => propose::stand(&model)?,
            false => by_name("stand", &self.stand, &model)?,
        };
        let feet = match self.feet.is_empty() {
            true => propose::feet(&model)?,
            false => shapes("feet", &self.feet, &model)?,
        };
        let height = standing_height(&model, &stand, &feet);
        let torque = torque_scale(&model, height, feet.len());
        let mut numbers = propose::gains(torque, model.joints.len());
        for (k, (what, given)) in
            [("kp", &self.kp), ("kd", &self.kd), ("action_scale", &self.action_scale)].into_iter().enumerate()
        {
            if let Some(given) = given {
                numbers[k] = given.resolve(what, &model)?;
            }
        }
        let [kp, kd, action_scale] = numbers;
        let mut shy = match self.must_not_touch.is_empty() {
            true => (0..model.geoms.len()).collect(),
            false => shapes("must_not_touch", &self.must_not_touch, &model)?,
        };
        shy.retain(|g| !feet.contains(g));
        let (trunk, limbs) = shy.into_iter().partition(|&g: &usize| model.geoms[g].link == 0);
        let sideways = match self.sideways.is_empty() {
            true => model.joints.iter().map(|j| j.axis.x.abs() > 0.9).collect(),
            false => model.joint_names().iter().map(|n| self.sideways.iter().any(|s| names(s, n))).collect(),
        };
        let name = self.name.clone().unwrap_or_else(|| model.name.clone());
        TaskRobot::new(&name, model, [stand, kp, kd, action_scale], [feet, trunk, limbs], sideways)
    }
}

/// Shapes of a model by the names of shapes or links, or the ends of these.
fn shapes(what: &str, wanted: &[String], model: &Model) -> Result<Vec<usize>, PolicyError> {
    let fits = |pattern: &str, geom: &Geom| names(pattern, &geom.name) || names(pattern, &model.links[geom.link].name);
    let mut found = Vec::new();
    for pattern in wanted {
        let fitting: Vec<usize> = (0..model.geoms.len()).filter(|&g| fits(pattern, &model.geoms[g])).collect();
        if fitting.is_empty() {
            let known = model.geoms.iter().map(|g| g.name.clone()).collect::<Vec<_>>().join(", ");
            return Err(PolicyError::setting(what, &format!("a shape or link among {known}"), pattern));
        }
        found.extend(fitting);
    }
    let mut once = Vec::new();
    found.into_iter().for_each(|g| {
        if !once.contains(&g) {
            once.push(g)
        }
    });
    Ok(once)
}

impl TaskRobot {
    /// A robot from its parts; `[stand, kp, kd, action_scale]` of `[joints]` each, `[feet, trunk, limbs]` as indices of shapes.
    ///
    /// # Errors
    /// When a length is off, a number means nothing, or there are no feet.
    pub fn new(
        name: &str,
        model: Model,
        [stand, kp, kd, action_scale]: [Vec<f32>; 4],
        [feet, trunk, limbs]: [Vec<usize>; 3],
        sideways: Vec<bool>,
    ) -> Result<Self, PolicyError> {
        let joints = model.joints.len();
        if model.base != BaseKind::Floating || joints == 0 {
            return Err(PolicyError::setting("robot", "a floating base and joints", format!("{joints} joints")));
        }
        for (what, values) in [("stand", &stand), ("kp", &kp), ("kd", &kd), ("action_scale", &action_scale)] {
            if values.len() != joints {
                return Err(PolicyError::setting(what, &format!("{joints} numbers"), values.len()));
            }
        }
        for (what, values) in [("kp", &kp), ("action_scale", &action_scale)] {
            if let Some(bad) = values.iter().find(|v| **v <= 0.0) {
                return Err(PolicyError::setting(what, "more than 0", bad));
            }
        }
        for ((joint, &angle), name) in model.joints.iter().zip(&stand).zip(model.joint_names()) {
            if f64::from(angle) < joint.lower || f64::from(angle) > joint.upper {
                let expected = format!("{} to {} (limits of the model)", joint.lower, joint.upper);
                return Err(PolicyError::setting(&format!("stand of `{name}`"), &expected, angle));
            }
        }
        if let Some(bad) = kd.iter().find(|v| **v < 0.0) {
            return Err(PolicyError::setting("kd", "at least 0", bad));
        }
        if feet.iter().any(|&g| model.geoms.get(g).is_some_and(|geom| geom.link == 0)) {
            return Err(PolicyError::setting("feet", "shapes of legs", "one of the base"));
        }
        if feet.is_empty() {
            return Err(PolicyError::setting("feet", "at least one shape", "none"));
        }
        if feet.len() > MOST_FEET {
            return Err(PolicyError::setting("feet", &format!("at most {}", MOST_FEET), feet.len()));
        }
        if sideways.len() != joints {
            return Err(PolicyError::setting("sideways", &format!("{joints} answers"), sideways.len()));
        }
        if let Some(bad) = feet.iter().chain(&trunk).chain(&limbs).find(|&&g| g >= model.geoms.len()) {
            return Err(PolicyError::setting("shape", &format!("an index below {}", model.geoms.len()), bad));
        }
        let height = standing_height(&model, &stand, &feet);
        Ok(Self { name: name.into(), model, stand, kp, kd, action_scale, feet, trunk, limbs, sideways, height })
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.stand.len()
    }

    /// Position limits of a joint \[rad\].
    pub fn limits(&self, joint: usize) -> (f32, f32) {
        let j = &self.model.joints[joint];
        (j.lower as f32, j.upper as f32)
    }

    /// How far below its centre a shape reaches \[m\]: its radius, where it has one.
    pub fn foot_radius(&self, geom: usize) -> f32 {
        radius(&self.model.geoms[geom]) as f32
    }

    /// Torque by which terms of the reward are measured: a foot's share of the weight on a lever as long as the robot is high.
    pub fn torque_scale(&self) -> f32 {
        torque_scale(&self.model, self.height, self.feet.len())
    }
}

fn torque_scale(model: &Model, height: f32, feet: usize) -> f32 {
    (model.mass() * qv_core::GRAVITY) as f32 * height / feet as f32
}

/// Height of the base over level ground at which the lowest foot touches \[m\].
fn standing_height(model: &Model, stand: &[f32], feet: &[usize]) -> f32 {
    let mut q = vec![0.0; model.nq()];
    q[3] = 1.0;
    stand.iter().enumerate().for_each(|(j, &angle)| q[7 + j] = f64::from(angle));
    let links = model.world_from_links(&q);
    let lowest = |&g: &usize| {
        let geom = &model.geoms[g];
        (links[geom.link] * geom.link_from_geom).position.z - radius(geom)
    };
    -feet.iter().map(lowest).fold(f64::INFINITY, f64::min) as f32
}

/// How far a foot's shape reaches below its centre: its radius, or half its least extent.
fn radius(geom: &Geom) -> f64 {
    match &geom.shape {
        qv_sim::Shape::Sphere(r) | qv_sim::Shape::Capsule { radius: r, .. } => *r,
        qv_sim::Shape::Cylinder { radius, half_length } => radius.min(*half_length),
        qv_sim::Shape::Box(half) => half.min_element(),
        qv_sim::Shape::Hull(points) => points.iter().map(|p| -p.z).fold(0.0, f64::max),
    }
}
