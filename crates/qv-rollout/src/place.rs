//! Where a simulation starts: the measured state, ground under its feet, joints behind their springs.

use crate::RolloutError;
use crate::law;
use crate::parameters::Overrides;
use crate::robot::Rollout;
use crate::start::Starts;
use crate::window::Start;
use qv_sim::{ActsOn, Batch, GeomField, JointField, LinkField, Precision, Shape, State, WorldField};
use std::borrow::Cow;

/// Either side of a time, within which the torque of a motor is differentiated \[s\].
const BESIDE: f64 = 0.01;
/// Feet within this of the lowest one stand \[m\].
const STANDING: f64 = 0.005;

/// What the simulated sensors have of the parameters under `sensor.*`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensors {
    /// Nothing but the bias of encoders, which the motors' controllers see: what is measured is freed of the rest.
    Ideal,
    /// All.
    AsTheyAre,
}

impl Rollout<'_> {
    /// Puts an environment at `state`, which is true to the joints (see [`Rollout::behind_springs`]); the height at which the ground touches
    /// its feet there \[m\].
    ///
    /// # Errors
    /// When a value of `setting` means nothing.
    pub fn place<T: Precision>(
        &self,
        batch: &mut Batch<T>,
        env: usize,
        setting: &Overrides,
        (start, sensors): (&Start, Sensors),
        state: &State,
    ) -> Result<f64, RolloutError> {
        use WorldField::{ForceStart, Height, RunStart};
        let anchors = self.free && self.anchors;
        for (id, value) in self.acting(setting, start.during[0], start.during[1]) {
            match self.acts_on(id) {
                ActsOn::World(RunStart) => {}
                ActsOn::World(Height) if anchors => {}
                ActsOn::World(ForceStart) => batch.set_parameter_at(env, id, value - start.time)?,
                part if sensors == Sensors::Ideal && is_freed_of(part) => {}
                _ => batch.set_parameter_at(env, id, value)?,
            }
        }
        self.begin_pushes(batch, env, setting, start)?;
        if let Some((id, begins)) = self.run_start(setting, start.since) {
            batch.set_parameter_at(env, id, begins)?;
        }
        let height = self.value_of(setting, ActsOn::World(Height));
        // Where no foot is over ground that stays where it is said to be.
        let touching = if anchors { self.ground_at(setting, &state.q).unwrap_or(height) } else { 0.0 };
        if let (true, Some(id)) = (anchors, self.parameter_of(ActsOn::World(Height))) {
            batch.set_parameter_at(env, id, touching)?;
        }
        batch.set_state(env, state)?;
        Ok(touching)
    }

    /// Puts what pushes from the beginning of the run on its clock: a start of 0 is the simulator's own, and so not among what is set.
    fn begin_pushes<T: Precision>(
        &self,
        batch: &mut Batch<T>,
        env: usize,
        setting: &Overrides,
        start: &Start,
    ) -> Result<(), RolloutError> {
        use WorldField::{ForceStart, ForceX, ForceY, ForceZ};
        let acting = || self.acting(setting, start.during[0], start.during[1]).map(|s| (self.acts_on(s.0), s.1));
        let is_push = |part| {
            matches!(part, ActsOn::World(ForceX | ForceY | ForceZ) | ActsOn::Joint(_, JointField::ExternalTorque))
        };
        let pushes = acting().any(|(part, value)| value != 0.0 && is_push(part));
        if !pushes || acting().any(|(part, _)| part == ActsOn::World(ForceStart)) {
            return Ok(());
        }
        let Some(id) = self.parameter_of(ActsOn::World(ForceStart)) else { return Ok(()) };
        Ok(batch.set_parameter_at(env, id, self.nominal[id] - start.time)?)
    }

    /// The state at a `time` \[s\] near a start that encoders on motors report as `seen`: joints are behind the springs between them. Where
    /// speeds were not measured, those of `seen` are the motors', too.
    pub fn behind_springs<'s>(&self, start: &Start, setting: &Overrides, seen: &'s State, time: f64) -> Cow<'s, State> {
        if self.compliances(setting).is_none() {
            return Cow::Borrowed(seen);
        }
        let mut state = seen.clone();
        let joints = self.columns.len();
        let (first, first_speed) = (state.q.len() - joints, state.v.len() - joints);
        if start.view.measured.velocity.is_none() {
            let at = |starts: &Starts| {
                let leads = |time: f64| law::leads(self, start, setting, &starts.at(time)?, time);
                leads(time - BESIDE).zip(leads(time + BESIDE))
            };
            let both = match start.starts {
                Some(starts) => at(starts),
                None => self.starts(start.view, self.sensor_errors(setting)).ok().and_then(|starts| at(&starts)),
            };
            if let Some((before, after)) = both {
                let rates = before.iter().zip(after).map(|(before, after)| (after - before) / (2.0 * BESIDE));
                state.v[first_speed..].iter_mut().zip(rates).for_each(|(v, rate)| *v -= rate);
            }
        }
        if let Some(leads) = law::leads(self, start, setting, &state, time) {
            state.q[first..].iter_mut().zip(leads).for_each(|(q, lead)| *q -= lead);
        }
        Cow::Owned(state)
    }

    /// How far the ground must rise \[m\] to carry the lowest feet at positions `q`: their mean height above it, those within
    /// 5 mm of the lowest, and the depth to which the robot's weight on that many feet sinks in. Feet that only touched
    /// would slide freely until they have sunk in.
    /// `None` where no foot is over ground.
    pub(crate) fn ground_at(&self, setting: &Overrides, q: &[f64]) -> Option<f64> {
        let (touching, feet) = self.gap_below(setting, q);
        let share = self.feet.geoms.len() as f64 / feet as f64;
        (feet > 0).then(|| touching + share * self.standing_depth(setting))
    }

    /// Depth to which all feet sink in when they carry the robot under a setting \[m\]: as that of a contact whose spring has the stiffness
    /// 1 / (time constant x damping ratio)² (MuJoCo's documentation, "Solver parameters").
    fn standing_depth(&self, setting: &Overrides) -> f64 {
        let nominal = self.softness(|id| self.nominal[id]);
        if nominal > 0.0 { self.depth * self.softness(|id| self.value(setting, id)) / nominal } else { self.depth }
    }

    /// One over the stiffness of contacts per mass \[s²\], with such values of parameters.
    pub(crate) fn softness(&self, value: impl Fn(usize) -> f64) -> f64 {
        let of = |field: WorldField| self.parameter_of(ActsOn::World(field)).map_or(0.0, &value);
        (of(WorldField::TimeConstant) * of(WorldField::DampingRatio)).powi(2)
    }

    /// Whether the robot, as it is known to be, stands on all of its feet at positions `q`.
    pub fn stands(&self, q: &[f64]) -> bool {
        let feet = self.feet.geoms.len();
        feet > 0 && self.gap_below(&Overrides::new(), q).1 == feet
    }

    /// Mean height above the ground of the lowest feet \[m\], and how many those are.
    pub(crate) fn gap_below(&self, setting: &Overrides, q: &[f64]) -> (f64, usize) {
        let near: Vec<f64> = self.lowest_feet(setting, q).into_iter().map(|f| f.1).collect();
        (if near.is_empty() { 0.0 } else { near.iter().sum::<f64>() / near.len() as f64 }, near.len())
    }

    /// Where the lowest feet are, within 5 mm, x and y, and their heights above the ground \[m\].
    pub(crate) fn lowest_feet(&self, setting: &Overrides, q: &[f64]) -> Vec<([f64; 2], f64)> {
        let length = |link: usize| self.value_of(setting, ActsOn::Link(link, LinkField::LengthScale));
        let poses = self.model.world_from_scaled_links(q, length);
        let [slope_x, slope_y] =
            [WorldField::SlopeX, WorldField::SlopeY].map(|axis| self.value_of(setting, ActsOn::World(axis)).tan());
        let foot = |g: &usize| {
            let geom = &self.model.geoms[*g];
            let centre = poses[geom.link].transform_point(length(geom.link) * geom.link_from_geom.position);
            let Shape::Sphere(radius) = geom.shape else { return None };
            let offset = self.value_of(setting, ActsOn::Geom(*g, GeomField::RadiusOffset));
            let ground = self.terrain.height_below(centre.x, centre.y, centre.z + self.above)?;
            let gap = centre.z - radius - offset - ground - slope_x * centre.x - slope_y * centre.y;
            Some(([centre.x, centre.y], gap))
        };
        let mut feet: Vec<([f64; 2], f64)> = self.feet.geoms.iter().filter_map(foot).collect();
        let lowest = feet.iter().map(|f| f.1).fold(f64::INFINITY, f64::min);
        feet.retain(|f| f.1 < lowest + STANDING);
        feet
    }
}

/// Whether measurements are freed of a parameter: the simulated sensors need not have it.
fn is_freed_of(part: ActsOn) -> bool {
    use WorldField::{GyroBiasX, GyroBiasY, GyroBiasZ, PoseDelay, TiltPitch, TiltRoll};
    match part {
        ActsOn::Joint(_, field) => field == JointField::EncoderLatency,
        ActsOn::World(field) => {
            matches!(field, TiltRoll | TiltPitch | GyroBiasX | GyroBiasY | GyroBiasZ | PoseDelay)
        }
        _ => false,
    }
}
