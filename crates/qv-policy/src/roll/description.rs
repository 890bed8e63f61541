//! What a policy sees and what its actions mean, as TOML.

use super::RollError;
use serde::Deserialize;

/// One number for all joints, or one for each in the description's order.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Numbers {
    /// For all.
    One(f64),
    /// For each.
    Each(Vec<f64>),
}

impl Numbers {
    /// The number at `index`; the last one beyond the end of a list.
    pub fn at(&self, index: usize) -> f64 {
        match self {
            Self::One(number) => *number,
            Self::Each(numbers) => numbers.get(index).or(numbers.last()).copied().unwrap_or(f64::NAN),
        }
    }

    /// That there is one number or `count`, each with `good`.
    fn check(&self, key: &str, count: usize, expected: &str, good: impl Fn(f64) -> bool) -> Result<(), RollError> {
        let numbers = match self {
            Self::One(number) => std::slice::from_ref(number),
            Self::Each(numbers) if numbers.len() == count => numbers,
            Self::Each(numbers) => {
                return Err(value(key, format!("a number, or {count} of them"), format!("{} numbers", numbers.len())));
            }
        };
        match numbers.iter().find(|number| !number.is_finite() || !good(**number)) {
            Some(found) => Err(value(key, expected, found)),
            None => Ok(()),
        }
    }
}

impl Default for Numbers {
    fn default() -> Self {
        Self::One(1.0)
    }
}

/// A policy's surroundings. Joints are in the order of `joints` throughout.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// What the policy is called.
    pub name: String,
    /// Where these figures come from.
    #[serde(default)]
    pub source: String,
    /// Actions a second \[Hz\].
    pub rate: f64,
    /// Joints in the order of observations and actions, by the names of the robot's URDF.
    pub joints: Vec<String>,
    /// Joint angles of action zero \[rad\], which observations subtract, too.
    pub stand: Vec<f64>,
    /// Position gain \[N m/rad\].
    pub kp: Numbers,
    /// Velocity gain \[N m s/rad\].
    pub kd: Numbers,
    /// Radians per unit of action.
    pub action_scale: Numbers,
    /// Actions are clipped to plus and minus this, before anything else.
    #[serde(default)]
    pub action_clip: Option<f64>,
    /// Share of the new action in what is applied; the rest is the last one. 1 applies it as it is.
    #[serde(default = "one")]
    pub action_share: f64,
    /// Largest torque \[N m\]; without it, the robot's own.
    #[serde(default)]
    pub torque_limits: Option<Numbers>,
    /// Whether targets are clipped to the joints' limits.
    #[serde(default)]
    pub clip_targets: bool,
    /// What it sees.
    pub observation: Observation,
    /// The robot as it was trained on.
    #[serde(default)]
    pub simulation: Simulation,
}

/// The observation: terms in order, then their history.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Observation {
    /// The terms of one frame, in order.
    pub terms: Vec<Term>,
    /// Scaled numbers are clipped to plus and minus this.
    #[serde(default)]
    pub clip: Option<f64>,
    /// Past frames that are seen, too.
    #[serde(default)]
    pub history: Option<History>,
}

/// How past frames stand beside the present one.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct History {
    /// Frames in all, the present one included.
    pub length: usize,
    /// What stands together.
    pub layout: HistoryLayout,
    /// What stands first.
    pub order: HistoryOrder,
    /// What the frames before the first are.
    pub start: HistoryStart,
}

/// What of a history stands together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HistoryLayout {
    /// All terms of one frame, then of the next.
    Frame,
    /// All frames of one term, then of the next.
    Term,
}

/// What of a history stands first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HistoryOrder {
    /// The present comes last.
    OldestFirst,
    /// The present comes first.
    NewestFirst,
}

/// What the frames before the first are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HistoryStart {
    /// Zeros.
    Zeros,
    /// The first frame.
    Repeat,
}

/// One term of a frame.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Term {
    /// What it is.
    #[serde(flatten)]
    pub kind: TermKind,
    /// Factor, one or for each number of the term.
    #[serde(default)]
    pub scale: Numbers,
}

/// What a term is. Vectors are in base axes.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "term", rename_all = "snake_case")]
pub enum TermKind {
    /// Velocity of a point of the base \[m/s\], 3 numbers.
    LinearVelocity {
        /// The point in the base frame \[m\].
        #[serde(default)]
        at: [f64; 3],
    },
    /// Angular velocity \[rad/s\], 3 numbers.
    Gyro,
    /// Direction of gravity, 3 numbers: (0, 0, -1) when level.
    Gravity,
    /// Commanded velocity: forward, left \[m/s\], counter-clockwise \[rad/s\].
    Command,
    /// Joint angles less the stand \[rad\].
    JointPositions,
    /// Joint speeds \[rad/s\].
    JointVelocities,
    /// The last action as the policy gave it, clipped; zeros at first.
    LastAction,
    /// A clock per offset.
    Clock {
        /// Rounds a second \[Hz\].
        frequency: f64,
        /// Phase of each number at the start, in rounds.
        offsets: Vec<f64>,
        /// How a phase is written.
        form: ClockForm,
        /// Every number of the term while the command's norm is below 0.01.
        #[serde(default)]
        standing: Option<f64>,
    },
    /// Height of the base's origin in the world \[m\], 1 number.
    Height,
}

/// How a clock's phase p, in rounds, is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClockForm {
    /// p itself, 0 to 1.
    Phase,
    /// sin 2πp.
    Sin,
    /// sin 2πp of all offsets, then cos 2πp of all.
    SinCos,
}

/// The robot and ground that a policy was trained on, as far as a URDF does not say it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Simulation {
    /// Physics step \[s\].
    pub timestep: f64,
    /// Rotor inertia of every joint \[kg m²\].
    pub armature: f64,
    /// Viscous friction of every joint \[N m s/rad\].
    pub viscous_friction: f64,
    /// Coulomb friction of every joint \[N m\].
    pub coulomb_friction: f64,
    /// Friction of foot on ground.
    pub friction: f64,
}

impl Default for Simulation {
    /// Steps of 1 ms, and what is nominal for robots of the Go2's size.
    fn default() -> Self {
        Self { timestep: 0.001, armature: 0.01, viscous_friction: 0.0, coulomb_friction: 0.0, friction: 0.8 }
    }
}

fn one() -> f64 {
    1.0
}

fn value(key: &str, expected: impl ToString, found: impl ToString) -> RollError {
    RollError::Value { key: key.to_owned(), expected: expected.to_string(), found: found.to_string() }
}

impl TermKind {
    /// Numbers in the term, for a policy of `joints` joints.
    pub fn len(&self, joints: usize) -> usize {
        match self {
            Self::LinearVelocity { .. } | Self::Gyro | Self::Gravity | Self::Command => 3,
            Self::JointPositions | Self::JointVelocities | Self::LastAction => joints,
            Self::Clock { offsets, form: ClockForm::SinCos, .. } => 2 * offsets.len(),
            Self::Clock { offsets, .. } => offsets.len(),
            Self::Height => 1,
        }
    }
}

impl Description {
    /// Reads and checks a description.
    ///
    /// # Errors
    /// Names the key: not TOML, unknown or missing, a list of the wrong length, a number that means nothing.
    pub fn from_toml(text: &str) -> Result<Self, RollError> {
        let description: Self = toml::from_str(text).map_err(|error| RollError::Toml(error.to_string()))?;
        check_term_keys(text)?;
        description.check()?;
        Ok(description)
    }

    /// Numbers of one frame.
    pub fn frame(&self) -> usize {
        self.observation.terms.iter().map(|term| term.kind.len(self.joints.len())).sum()
    }

    /// Numbers of an observation: of all its frames.
    pub fn observations(&self) -> usize {
        self.frame() * self.observation.history.as_ref().map_or(1, |history| history.length)
    }

    /// Physics steps per action.
    pub(crate) fn steps_per_action(&self) -> usize {
        (1.0 / (self.rate * self.simulation.timestep)).round() as usize
    }

    fn check(&self) -> Result<(), RollError> {
        let joints = self.joints.len();
        if joints == 0 {
            return Err(value("joints", "names", "none"));
        }
        if let Some(k) = (0..joints).find(|&k| self.joints[..k].contains(&self.joints[k])) {
            return Err(value("joints", "every joint once", format!("`{}` twice", self.joints[k])));
        }
        Numbers::Each(self.stand.clone()).check("stand", joints, "angles of at most 7 rad", |x| x.abs() <= 7.0)?;
        positive("rate", self.rate)?;
        self.kp.check("kp", joints, "at least 0", |x| x >= 0.0)?;
        self.kd.check("kd", joints, "at least 0", |x| x >= 0.0)?;
        self.action_scale.check("action_scale", joints, "a number", |_| true)?;
        if let Some(limits) = &self.torque_limits {
            limits.check("torque_limits", joints, "above 0", |x| x > 0.0)?;
        }
        if let Some(clip) = self.action_clip {
            positive("action_clip", clip)?;
        }
        if !(self.action_share > 0.0 && self.action_share <= 1.0) {
            return Err(value("action_share", "above 0, at most 1", self.action_share));
        }
        self.check_observation()?;
        self.check_simulation()
    }

    fn check_observation(&self) -> Result<(), RollError> {
        let observation = &self.observation;
        if observation.terms.is_empty() {
            return Err(value("observation.terms", "terms", "none"));
        }
        for (k, term) in observation.terms.iter().enumerate() {
            let key = format!("observation.terms[{k}]");
            let len = term.kind.len(self.joints.len());
            term.scale.check(&format!("{key}.scale"), len, "a number", |_| true)?;
            match &term.kind {
                TermKind::LinearVelocity { at } if at.iter().any(|x| !x.is_finite()) => {
                    return Err(value(&format!("{key}.at"), "finite numbers", format!("{at:?}")));
                }
                TermKind::Clock { frequency, offsets, standing, .. } => {
                    positive(&format!("{key}.frequency"), *frequency)?;
                    let numbers = offsets.iter().chain(standing);
                    if offsets.is_empty() || numbers.clone().any(|x| !x.is_finite()) {
                        return Err(value(&format!("{key}.offsets"), "finite numbers", format!("{offsets:?}")));
                    }
                }
                _ => {}
            }
        }
        if let Some(clip) = observation.clip {
            positive("observation.clip", clip)?;
        }
        match &observation.history {
            Some(history) if !(1..=1000).contains(&history.length) => {
                Err(value("observation.history.length", "1 to 1000 frames", history.length))
            }
            _ => Ok(()),
        }
    }

    fn check_simulation(&self) -> Result<(), RollError> {
        let simulation = &self.simulation;
        positive("simulation.timestep", simulation.timestep)?;
        let steps = 1.0 / (self.rate * simulation.timestep);
        if !(steps > 0.999 && steps < 1e6 && (steps - steps.round()).abs() < 1e-6 * steps) {
            let expected = "a time that goes a whole number of times into one over `rate`";
            return Err(value("simulation.timestep", expected, simulation.timestep));
        }
        for (key, number) in [
            ("armature", simulation.armature),
            ("viscous_friction", simulation.viscous_friction),
            ("coulomb_friction", simulation.coulomb_friction),
            ("friction", simulation.friction),
        ] {
            if !(number >= 0.0 && number.is_finite()) {
                return Err(value(&format!("simulation.{key}"), "at least 0", number));
            }
        }
        Ok(())
    }
}

/// That terms have no unknown keys: serde does not look, where a structure is flattened into another.
fn check_term_keys(text: &str) -> Result<(), RollError> {
    let table: toml::Table = toml::from_str(text).map_err(|error| RollError::Toml(error.to_string()))?;
    let terms = table.get("observation").and_then(|observation| observation.get("terms")).and_then(|t| t.as_array());
    for (k, term) in terms.into_iter().flatten().filter_map(|term| term.as_table()).enumerate() {
        let own: &[&str] = match term.get("term").and_then(|name| name.as_str()) {
            Some("linear_velocity") => &["at"],
            Some("clock") => &["frequency", "offsets", "form", "standing"],
            _ => &[],
        };
        let known = |key: &&String| ["term", "scale"].contains(&key.as_str()) || own.contains(&key.as_str());
        if let Some(key) = term.keys().find(|key| !known(key)) {
            let expected = [&["term", "scale"], own].concat().join(", ");
            return Err(value(&format!("observation.terms[{k}]"), format!("keys among {expected}"), key));
        }
    }
    Ok(())
}

fn positive(key: &str, number: f64) -> Result<(), RollError> {
    match number > 0.0 && number.is_finite() {
        true => Ok(()),
        false => Err(value(key, "above 0", number)),
    }
}
