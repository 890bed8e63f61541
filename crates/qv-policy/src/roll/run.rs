//! Runs a policy on a robot of the simulator under a constant command.

use super::RollError;
use super::description::{Description, Numbers};
use super::observe::{Observer, RobotState};
use crate::gait::{GaitMeter, GaitSample};
use crate::velocity::in_heading;
use qv_sim::{Batch, JointCommand, Model, SimError, State};

/// What a roll did: one sample at the start and one after every action, joints in the description's order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RollTrace {
    /// Time since the start \[s\].
    pub time: Vec<f64>,
    /// Base in the world: x, y, z \[m\], quaternion w, x, y, z.
    pub base: Vec<[f64; 7]>,
    /// Joint angles \[rad\].
    pub joints: Vec<Vec<f64>>,
    /// Torques of the last physics step \[N m\]; zeros at the start.
    pub torques: Vec<Vec<f64>>,
    /// Joint speeds \[rad/s\].
    pub speeds: Vec<Vec<f64>>,
    /// Velocity of the base: world axes \[m/s\], then its turning in its own axes \[rad/s\].
    pub velocity: Vec<[f64; 6]>,
    /// Upward force of the ground on each shape of the model in the last physics step \[N\]; zeros at the start.
    pub forces: Vec<Vec<f32>>,
    /// The greatest of it in the physics steps since the sample before \[N\].
    pub peaks: Vec<Vec<f32>>,
    /// What the policy saw before each action.
    pub observations: Vec<Vec<f32>>,
    /// Actions, clipped.
    pub actions: Vec<Vec<f64>>,
}

/// Rolls `policy` from `start` under `command`, forward, left \[m/s\], counter-clockwise \[rad/s\], for `duration` \[s\].
/// Environment 0 of `batch` is the robot; others are stepped along. Torque limits and joint parameters of the
/// description are set on it, then `parameters`: what was calibrated wins; the ground's friction and the time step are the batch's own, and the step must be the
/// description's.
///
/// # Errors
/// When duration or command mean nothing, a joint is not the robot's, the batch steps otherwise than the description says, the policy fails or gives an
/// action of the wrong length or not finite, or the simulation runs away.
pub fn roll<E: std::fmt::Display>(
    batch: &mut Batch<f64>,
    description: &Description,
    start: &State,
    (command, duration): ([f64; 3], f64),
    parameters: &[(String, f64)],
    mut policy: impl FnMut(&[f32]) -> Result<Vec<f32>, E>,
) -> Result<RollTrace, RollError> {
    if !(0.0..=1e6).contains(&duration) {
        let (what, expected) = ("duration of a roll".to_owned(), "0 to 1e6 s".to_owned());
        return Err(SimError::Value { what, expected, found: duration }.into());
    }
    if let Some(&found) = command.iter().find(|x| !x.is_finite()) {
        let (what, expected) = ("commanded velocity".to_owned(), "finite numbers".to_owned());
        return Err(SimError::Value { what, expected, found }.into());
    }
    let map = Map::new(batch.model(), description)?;
    set_up(batch, description, &map)?;
    parameters.iter().try_for_each(|(name, value)| batch.set_parameter(0, name, *value))?;
    batch.set_state(0, start)?;
    let (mut observer, mut rolled) = (Observer::new(description), RollTrace::default());
    let count = description.joints.len();
    let (mut last, mut state) = (vec![0.0; count], start.clone());
    let shapes = batch.model().geoms.len();
    let (mut forces, mut peaks) = (vec![0.0; 3 * shapes * batch.len()], vec![0.0f32; shapes]);
    rolled.push(0.0, start, &map, vec![0.0; count]);
    rolled.forces.push(peaks.clone());
    rolled.peaks.push(peaks.clone());
    for k in 0..(duration * description.rate).round() as usize {
        let time = k as f64 / description.rate;
        let seen = RobotState {
            base: state.q[..7].try_into().unwrap_or([f64::NAN; 7]),
            velocity: state.v[..6].try_into().unwrap_or([f64::NAN; 6]),
            joints: &map.joints(&state.q),
            speeds: &map.speeds(&state.v),
            command,
            last_action: &last,
            actions: k,
        };
        let observation = observer.observe(&seen);
        let raw = policy(&observation).map_err(|error| RollError::Policy { time, reason: error.to_string() })?;
        let action = clipped(description, &raw, time)?;
        map.command(batch, description, &action, &last)?;
        peaks.fill(0.0);
        for _ in 0..description.steps_per_action() {
            batch.step();
            batch.read_geom_forces(&mut forces)?;
            peaks.iter_mut().zip(forces.chunks_exact(3)).for_each(|(peak, force)| *peak = peak.max(force[2]));
        }
        if batch.is_faulty(0)? {
            return Err(RollError::RanAway { time: time + 1.0 / description.rate });
        }
        batch.read_state(0, &mut state)?;
        let torques = map.pick(&batch.sensors(0)?.tau);
        rolled.push((k + 1) as f64 / description.rate, &state, &map, torques);
        rolled.forces.push(forces.chunks_exact(3).take(shapes).map(|force| force[2]).collect());
        rolled.peaks.push(peaks.clone());
        rolled.observations.push(observation);
        rolled.actions.push(action.clone());
        last = action;
    }
    Ok(rolled)
}

impl RollTrace {
    fn push(&mut self, time: f64, state: &State, map: &Map, torques: Vec<f64>) {
        self.time.push(time);
        self.base.push(state.q[..7].try_into().unwrap_or([f64::NAN; 7]));
        self.velocity.push(state.v[..6].try_into().unwrap_or([f64::NAN; 6]));
        self.joints.push(map.joints(&state.q));
        self.speeds.push(map.speeds(&state.v));
        self.torques.push(torques);
    }

    /// Gives a meter what the robot did under a command; `feet` are the model's shapes of its feet. From a fall on (the trunk leans by more than
    /// 60 degrees) nothing counts.
    pub fn measure(&self, command: [f64; 3], feet: &[usize], meter: &mut GaitMeter) {
        let narrow = |values: &[f64]| values.iter().map(|&x| x as f32).collect::<Vec<f32>>();
        for k in 1..self.time.len() {
            let turn = [3, 4, 5, 6].map(|i| self.base[k][i] as f32);
            if 1.0 - 2.0 * (turn[1] * turn[1] + turn[2] * turn[2]) < 0.5 {
                meter.note_fall();
                return;
            }
            let [vx, vy, vz, _, _, turning] = self.velocity[k].map(|x| x as f32);
            let [ahead, aside, _] = in_heading(turn, [vx, vy, vz]);
            let touching: Vec<bool> = feet.iter().map(|&f| self.forces[k][f] > 0.1).collect();
            let peaks: Vec<f32> = feet.iter().map(|&f| self.peaks[k][f]).collect();
            meter.add(&GaitSample {
                command: command.map(|x| x as f32),
                velocity: [ahead, aside, turning],
                peaks: &peaks,
                touching: &touching,
                torques: &narrow(&self.torques[k]),
                speeds: &narrow(&self.speeds[k]),
            });
        }
    }
}

fn clipped(description: &Description, raw: &[f32], time: f64) -> Result<Vec<f64>, RollError> {
    let expected = description.joints.len();
    if raw.len() != expected {
        return Err(RollError::Action { time, expected, found: format!("{} numbers", raw.len()) });
    }
    if let Some(found) = raw.iter().find(|x| !x.is_finite()) {
        return Err(RollError::Action { time, expected, found: found.to_string() });
    }
    let clip = description.action_clip.unwrap_or(f64::INFINITY);
    Ok(raw.iter().map(|&x| f64::from(x).clamp(-clip, clip)).collect())
}

/// Sets what the description says about the robot on environment 0.
fn set_up(batch: &mut Batch<f64>, description: &Description, map: &Map) -> Result<(), RollError> {
    let simulation = &description.simulation;
    let step = batch.options().timestep;
    if (step - simulation.timestep).abs() > 1e-12 {
        return Err(RollError::Value {
            key: "simulation.timestep".to_owned(),
            expected: format!("that of the batch, {step} s"),
            found: simulation.timestep.to_string(),
        });
    }
    for (k, name) in description.joints.iter().enumerate() {
        let mut set = |what: &str, value: f64| batch.set_parameter(0, &what.replace('*', name), value);
        set("joint.*.armature", simulation.armature)?;
        set("joint.*.viscous_friction", simulation.viscous_friction)?;
        set("joint.*.coulomb_friction", simulation.coulomb_friction)?;
        let limit = description.torque_limits.as_ref().map(|limits| limits.at(k));
        if let Some(limit) = limit.or(Some(map.efforts[k]).filter(|effort| effort.is_finite())) {
            set("actuator.*.torque_limit", limit)?;
        }
    }
    Ok(())
}

/// From the model's joints to the description's.
struct Map {
    /// Index in the model of each joint.
    model_joint: Vec<usize>,
    efforts: Vec<f64>,
    /// Position limits \[rad\].
    limits: Vec<(f64, f64)>,
    model_joints: usize,
}

impl Map {
    fn new(model: &Model, description: &Description) -> Result<Self, RollError> {
        if model.base_dofs() != 6 {
            let (what, expected) = ("degrees of freedom of the base".to_owned(), "6: a free base".to_owned());
            return Err(SimError::Value { what, expected, found: model.base_dofs() as f64 }.into());
        }
        let find = |joint: &String| {
            model.joint_index(joint).ok_or_else(|| RollError::Joint {
                robot: model.name.clone(),
                joint: joint.clone(),
                known: model.joint_names().join(", "),
            })
        };
        let model_joint = description.joints.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        let joints = || model_joint.iter().map(|&j| &model.joints[j]);
        let efforts = joints().map(|joint| joint.effort).collect();
        let limits = joints().map(|joint| (joint.lower, joint.upper)).collect();
        Ok(Self { model_joint, efforts, limits, model_joints: model.joints.len() })
    }

    /// Values of the description's joints from those of the model's.
    fn pick(&self, values: &[f64]) -> Vec<f64> {
        self.model_joint.iter().map(|&j| values[j]).collect()
    }

    fn joints(&self, q: &[f64]) -> Vec<f64> {
        self.pick(&q[7..])
    }

    fn speeds(&self, v: &[f64]) -> Vec<f64> {
        self.pick(&v[6..])
    }

    fn spread(&self, value: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut all = vec![0.0; self.model_joints];
        self.model_joint.iter().enumerate().for_each(|(k, &j)| all[j] = value(k));
        all
    }

    /// Hands the action to the motors. Joints that the description does not name go limp.
    fn command(
        &self,
        batch: &mut Batch<f64>,
        description: &Description,
        action: &[f64],
        last: &[f64],
    ) -> Result<(), RollError> {
        let share = description.action_share;
        let target = |k: usize| {
            let applied = share * action[k] + (1.0 - share) * last[k];
            let target = description.stand[k] + description.action_scale.at(k) * applied;
            let (lower, upper) = self.limits[k];
            if description.clip_targets { target.clamp(lower, upper) } else { target }
        };
        let gain = |numbers: &Numbers| self.spread(|k| numbers.at(k));
        let zeros = vec![0.0; self.model_joints];
        let command = JointCommand {
            q: &self.spread(target),
            dq: &zeros,
            kp: &gain(&description.kp),
            kd: &gain(&description.kd),
            tau: &zeros,
        };
        Ok(batch.set_command(0, &command)?)
    }
}
