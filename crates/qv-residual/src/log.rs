//! A recording of a robot under its policy, cut to the policy's decisions: what is replayed.

use crate::ResidualError;
use qv_policy::velocity::{TaskRobot, TaskSettings};
use qv_recording::Run;
use qv_rollout::{Command, CoveredSeries, HeldCommands, Legs, SensorErrors, Starts, feet_of, joint_columns};
use rayon::prelude::*;

/// Part of a recording without holes, on a grid of decisions.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Name of the recording.
    pub recording: String,
    /// Time of the first decision in the recording \[s\].
    pub start: f64,
    /// Joint targets of each physics step, `[decisions][substeps][joints]` \[rad\].
    pub targets: Vec<f32>,
    /// Measured state at each decision and after the last, smoothed: `[decisions + 1]` of 7 + joints positions and 6 + joints velocities.
    pub states: Vec<f32>,
}

/// Recordings of one robot, all at the same rate and gains.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// Decisions a second \[Hz\].
    pub rate: f32,
    /// Physics steps of a decision.
    pub substeps: usize,
    /// Joints.
    pub joints: usize,
    /// Position gains \[N m/rad\].
    pub kp: Vec<f32>,
    /// Velocity gains \[N m s/rad\].
    pub kd: Vec<f32>,
    /// Stretches.
    pub stretches: Vec<Stretch>,
    /// The recordings that they are of, by name, without torques, accelerations and forces of feet.
    pub runs: Vec<(String, Run)>,
    /// What was left out of the recordings, a sentence each.
    pub remarks: Vec<String>,
}

/// Longest stretch \[s\]: clocks of robot and recorder part company over longer ones, and held-out blocks are made of these.
const LONGEST: f64 = 10.0;
/// Stretches that are shorter serve nothing \[s\].
const SHORTEST: f64 = 2.0;
/// Larger numbers of a state are no robot's \[m, rad, m/s, rad/s\].
const FARTHEST: f32 = 1e6;
/// A base that leans by more than this lies \[rad\].
const LYING: f32 = 1.0;

impl Stretch {
    /// Numbers of a state.
    fn width(joints: usize) -> usize {
        13 + 2 * joints
    }

    /// Number of decisions.
    pub fn decisions(&self, joints: usize) -> usize {
        (self.states.len() / Self::width(joints)).saturating_sub(1)
    }

    /// Positions and velocities at a decision.
    pub fn state(&self, joints: usize, decision: usize) -> (&[f32], &[f32]) {
        let row = &self.states[decision * Self::width(joints)..][..Self::width(joints)];
        row.split_at(7 + joints)
    }
}

impl Log {
    /// An empty log of a robot under a task's rate.
    pub fn new(robot: &TaskRobot, task: &TaskSettings) -> Self {
        Self {
            rate: task.rate,
            substeps: task.substeps,
            joints: robot.joints(),
            kp: robot.kp.clone(),
            kd: robot.kd.clone(),
            stretches: Vec::new(),
            runs: Vec::new(),
            remarks: Vec::new(),
        }
    }

    /// Physics step \[s\].
    pub fn timestep(&self) -> f64 {
        1.0 / (f64::from(self.rate) * self.substeps as f64)
    }

    /// Seconds of all stretches.
    pub fn seconds(&self) -> f64 {
        let decisions: usize = self.stretches.iter().map(|s| s.decisions(self.joints)).sum();
        decisions as f64 / f64::from(self.rate)
    }

    /// Adds what a recording has of the robot walking under position targets.
    ///
    /// # Errors
    /// When the recording is of another robot, has no commands, other gains, or nothing of it can be used; it is named.
    pub fn add(&mut self, name: &str, run: &Run, robot: &TaskRobot) -> Result<(), ResidualError> {
        let (columns, free) = joint_columns(run, &robot.model).map_err(|e| named(name, &e.to_string()))?;
        if !free {
            return Err(named(name, "its base is held"));
        }
        let commands = HeldCommands::new(run, &columns)?;
        let feet = feet_of(run, &robot.model);
        let starts = match run.measured.base_pose.as_ref().filter(|p| !p.is_empty()) {
            Some(_) => Starts::new(run, &columns, true, SensorErrors::default())?,
            None => {
                self.remarks.push(format!("{name}: no poses of the base; it goes where its legs carry it"));
                Starts::on_legs(
                    run,
                    &columns,
                    SensorErrors::default(),
                    Legs { model: &robot.model, feet: &feet.geoms },
                )?
            }
        };
        self.check_gains(name, run, &commands)?;
        let decision = 1.0 / f64::from(self.rate);
        let [mut from, end] = run.span();
        let position = CoveredSeries::new(run.measured.position.as_ref().expect("joint_columns asks for it"));
        let pace = commands.pace().map(CoveredSeries::new);
        let first = commands.pace().and_then(|c| c.time.first().copied()).unwrap_or(from);
        from = from.max(first);
        let (mut lost, mut fallen, mut twice) = (0, 0, 0);
        while from + SHORTEST <= end {
            // Decisions begin where commands change.
            let step = self.timestep();
            let begin = commands.until(from, step).min(from + decision);
            let longest = ((LONGEST.min(end - begin)) / decision).floor() as usize;
            // As far as the first hole.
            let count = longest_whole(longest, |count| {
                position.is_whole(begin, begin + count as f64 * decision)
                    && pace.is_some_and(|pace| pace.is_whole(begin, begin + (count - 1) as f64 * decision))
            });
            let is_used = count as f64 * decision >= SHORTEST;
            let stretch = is_used.then(|| self.stretch(name, begin, count, &starts, &commands)).flatten();
            match stretch {
                Some(stretch) if !self.stands(&stretch) => fallen += count,
                Some(stretch) if stretch.states.iter().all(|x| x.abs() < FARTHEST) => {
                    // A recording that is given twice would be held out from itself.
                    if self.stretches.iter().any(|s| s.states == stretch.states) {
                        twice += count;
                    } else {
                        self.stretches.push(stretch);
                    }
                }
                _ => lost += count.max(1),
            }
            from = begin + count.max(1) as f64 * decision;
        }
        let left_out = [
            (lost, "something is missing or means nothing"),
            (fallen, "the robot lies"),
            (twice, "they were given already"),
        ];
        for (count, why) in left_out.into_iter().filter(|(count, _)| *count > 0) {
            self.remarks.push(format!("{name}: {:.1} s left out: {why}", count as f64 * decision));
        }
        if self.stretches.iter().all(|s| s.recording != name) {
            let why = match (fallen, twice) {
                (0, 0) => "none",
                (0, _) => "none that is not in another recording",
                _ => "a robot that lies",
            };
            return Err(ResidualError::input(name, "stretches of a robot that walks, 2 s and longer", why));
        }
        if self.runs.iter().any(|(other, _)| other == name) {
            return Err(ResidualError::input(name, "a name of its own", "the name of another recording"));
        }
        let mut run = run.clone();
        // What no fit reads.
        (run.measured.torque, run.measured.acceleration, run.measured.foot_force) = (None, None, None);
        self.runs.push((name.into(), run));
        Ok(())
    }

    /// Gains must be those that the simulator is trained with: a policy commands no others.
    fn check_gains(&self, name: &str, run: &Run, commands: &HeldCommands) -> Result<(), ResidualError> {
        let [from, to] = run.span();
        let mut command = Command::default();
        for share in [0.25, 0.5, 0.75] {
            commands.at(from + share * (to - from), self.timestep(), &mut command);
            let view = command.view();
            for (what, found, own) in [("kp", view.kp, &self.kp), ("kd", view.kd, &self.kd)] {
                let off =
                    found.iter().zip(own).position(|(x, own)| (x - f64::from(*own)).abs() > 0.02 * f64::from(*own));
                if let Some(j) = off {
                    let expected = format!("gains of the policy ({what} of joint {j}: {})", own[j]);
                    return Err(ResidualError::input(name, expected, found[j]));
                }
            }
            if let Some(x) = view.dq.iter().chain(view.tau).find(|x| **x != 0.0) {
                return Err(ResidualError::input(
                    name,
                    "commands of positions alone, as a policy gives them",
                    format!("a speed or torque of {x}"),
                ));
            }
        }
        Ok(())
    }

    fn stretch(
        &self,
        name: &str,
        begin: f64,
        count: usize,
        starts: &Starts,
        commands: &HeldCommands,
    ) -> Option<Stretch> {
        let (decision, step) = (1.0 / f64::from(self.rate), self.timestep());
        let mut targets = Vec::with_capacity(count * self.substeps * self.joints);
        let mut command = Command::default();
        for k in 0..count * self.substeps {
            commands.at(begin + k as f64 * step, step, &mut command);
            targets.extend(command.view().q.iter().map(|&x| x as f32));
        }
        let states: Option<Vec<_>> =
            (0..=count).into_par_iter().map(|k| starts.at(begin + k as f64 * decision)).collect();
        let states = states?.into_iter().flat_map(|s| s.q.into_iter().chain(s.v)).map(|x| x as f32).collect();
        Some(Stretch { recording: name.into(), start: begin, targets, states })
    }

    fn stands(&self, stretch: &Stretch) -> bool {
        (0..=stretch.decisions(self.joints)).all(|k| {
            let (q, _) = stretch.state(self.joints, k);
            1.0 - 2.0 * (q[4] * q[4] + q[5] * q[5]) > LYING.cos()
        })
    }
}

/// The largest count up to `most` for which `is_whole` holds, which it does for all below; 0 when for none.
fn longest_whole(most: usize, is_whole: impl Fn(usize) -> bool) -> usize {
    if most == 0 || is_whole(most) {
        return most;
    }
    let (mut low, mut high) = (0, most);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if is_whole(middle) { low = middle } else { high = middle }
    }
    low
}

fn named(name: &str, found: &str) -> ResidualError {
    ResidualError::input(name, "a recording of this robot, walking", found)
}
