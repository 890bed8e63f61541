//! Windows of a log replayed in many lanes at once: each from the measured state, its motors warm, under the recorded targets.

use crate::ResidualError;
use crate::log::Log;
use qv_policy::shape_torques::ShapeTorques;
use qv_policy::velocity::{TaskRobot, TaskSettings};
use qv_sim::{Batch, BatchCommand, JointCommand, LineSearch, SimOptions, State, Terrain};
use rayon::prelude::*;

/// Where a window begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Stretch of the log.
    pub stretch: usize,
    /// Decision of the stretch.
    pub decision: usize,
}

/// Decisions before a window that are simulated, too, so that latency, lag and play have a past \[3 decisions of 20 ms: "commands of the
/// last 50 ms"\].
pub const WARM: usize = 3;

/// Windows of `length` decisions that follow each other in the stretches that `wanted` picks.
pub fn windows(log: &Log, length: usize, wanted: impl Fn(usize) -> bool) -> Vec<Window> {
    let mut all = Vec::new();
    for (stretch, s) in log.stretches.iter().enumerate().filter(|(k, _)| wanted(*k)) {
        let last = s.decisions(log.joints);
        let starts = (WARM..).step_by(length).take_while(|k| k + length <= last);
        all.extend(starts.map(|decision| Window { stretch, decision }));
    }
    all
}

/// Channels of an error beside joints: base forwards, to the left, up \[m\] in the heading at the window's start; roll, pitch, yaw \[rad\].
pub const BASE_CHANNELS: usize = 6;

/// Simulated minus measured.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Errors {
    /// Lanes.
    pub lanes: usize,
    /// Decisions of a window.
    pub length: usize,
    /// Joints and then [`BASE_CHANNELS`].
    pub channels: usize,
    /// `[lanes][length][channels]`; what a lane did after its numbers ran away is held at its last error.
    pub values: Vec<f32>,
}

impl Errors {
    /// The errors of a lane, `[length][channels]`.
    pub fn lane(&self, lane: usize) -> &[f32] {
        let width = self.length * self.channels;
        &self.values[lane * width..][..width]
    }

    /// Mean size of joint errors over joints, time and lanes \[rad\].
    pub fn joints(&self) -> f64 {
        let joints = self.channels - BASE_CHANNELS;
        let rows = self.values.chunks_exact(self.channels);
        let sum: f64 = rows.flat_map(|row| &row[..joints]).map(|x| f64::from(x.abs())).sum();
        sum / (self.lanes * self.length * joints).max(1) as f64
    }

    /// Mean size of each joint's error \[rad\].
    pub fn by_joint(&self) -> Vec<f64> {
        let joints = self.channels - BASE_CHANNELS;
        let mut sums = vec![0.0; joints];
        for row in self.values.chunks_exact(self.channels) {
            sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += f64::from(x.abs()));
        }
        sums.iter().map(|sum| sum / (self.lanes * self.length).max(1) as f64).collect()
    }

    /// Mean size of joint errors of each lane \[rad\].
    pub fn by_lane(&self) -> Vec<f64> {
        let joints = self.channels - BASE_CHANNELS;
        let of = |lane| {
            let rows = self.lane(lane).chunks_exact(self.channels);
            let sum: f64 = rows.flat_map(|row| &row[..joints]).map(|x| f64::from(x.abs())).sum();
            sum / (self.length * joints) as f64
        };
        (0..self.lanes).map(of).collect()
    }
}

/// Parameters of a lane, as indices into the catalogue and values; and its encoder biases \[rad\], which measurements are freed of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lane {
    /// Window of the lane.
    pub window: usize,
    /// Catalogue index and value.
    pub parameters: Vec<(usize, f64)>,
    /// Measured minus true angle \[rad\], `[joints]`; empty = none.
    pub bias: Vec<f64>,
}

/// What replays share.
pub struct Replayer<'a> {
    /// The recordings.
    pub log: &'a Log,
    /// The robot.
    pub robot: &'a TaskRobot,
    /// The ground.
    pub terrain: &'a Terrain,
    /// Solver's iterations, as the policy is trained with.
    pub iterations: usize,
    /// Longest latency that a lane may have \[s\].
    pub longest_latency: f64,
}

impl<'a> Replayer<'a> {
    /// Replays of a log under the physics that a task trains with.
    pub fn new(log: &'a Log, robot: &'a TaskRobot, terrain: &'a Terrain, task: &TaskSettings) -> Self {
        Self { log, robot, terrain, iterations: task.iterations, longest_latency: 0.05 }
    }

    /// Options of the simulator.
    pub fn options(&self) -> SimOptions {
        SimOptions {
            timestep: self.log.timestep(),
            iterations: self.iterations,
            line_search: LineSearch::Apex,
            line_search_iterations: 4,
            tolerance: Some(1e-2),
            max_command_latency: self.longest_latency,
            ..Default::default()
        }
    }

    /// A batch of so many lanes.
    ///
    /// # Errors
    /// When the simulator refuses the robot.
    pub fn batch(&self, lanes: usize) -> Result<Batch<f32>, ResidualError> {
        Ok(Batch::new(&self.robot.model, self.terrain, &self.options(), lanes)?)
    }

    /// The measured state at a decision, free of the encoders' biases, moved so that its lowest feet touch the ground: poses are known to
    /// millimetres, and a millimetre of height decides whether a foot pushes.
    pub fn start(&self, window: Window, offset: usize, bias: &[f64]) -> State {
        let stretch = &self.log.stretches[window.stretch];
        let (q, v) = stretch.state(self.log.joints, window.decision - offset);
        let mut q: Vec<f64> = q.iter().map(|&x| f64::from(x)).collect();
        q[7..].iter_mut().zip(bias).for_each(|(q, bias)| *q -= bias);
        q[2] -= self.gap(&q).unwrap_or(0.0);
        State { q, v: v.iter().map(|&x| f64::from(x)).collect() }
    }

    /// Height of the lowest feet over the ground \[m\] at a measured state; `None` where there is no ground.
    pub(crate) fn gap_at(&self, at: Window) -> Option<f64> {
        let (q, _) = self.log.stretches[at.stretch].state(self.log.joints, at.decision);
        self.gap(&q.iter().map(|&x| f64::from(x)).collect::<Vec<_>>())
    }

    /// Height of the lowest feet over the ground \[m\]: the mean of those within 5 mm of the lowest, as qv-rollout has it without the depth.
    fn gap(&self, q: &[f64]) -> Option<f64> {
        let links = self.robot.model.world_from_links(q);
        let gap = |&g: &usize| {
            let geom = &self.robot.model.geoms[g];
            let at = (links[geom.link] * geom.link_from_geom).position;
            let ground = self.terrain.height_below(at.x, at.y, at.z + 1.0)?;
            Some(at.z - f64::from(self.robot.foot_radius(g)) - ground)
        };
        let gaps: Vec<f64> = self.robot.feet.iter().filter_map(gap).collect();
        let lowest = gaps.iter().copied().fold(f64::INFINITY, f64::min);
        let near: Vec<f64> = gaps.into_iter().filter(|g| *g < lowest + 0.005).collect();
        (!near.is_empty()).then(|| near.iter().sum::<f64>() / near.len() as f64)
    }

    /// The recorded targets of a physics step, `[joints]` \[rad\].
    fn targets(&self, at: Window, substep: usize) -> &'a [f32] {
        let from = (at.decision * self.log.substeps + substep) * self.log.joints;
        &self.log.stretches[at.stretch].targets[from..][..self.log.joints]
    }

    /// Sets parameters, states and past commands of all lanes at their windows' starts, and simulates the decisions before them.
    ///
    /// # Errors
    /// When the simulator refuses a number.
    pub fn begin(
        &self,
        batch: &mut Batch<f32>,
        windows: &[Window],
        lanes: &[Lane],
        torques: Option<&ShapeTorques>,
    ) -> Result<(), ResidualError> {
        let joints = self.log.joints;
        let wide = |list: &[f32]| list.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
        let (kp, kd, zero) = (wide(&self.log.kp), wide(&self.log.kd), vec![0.0; joints]);
        for (env, lane) in lanes.iter().enumerate() {
            for &(id, value) in &lane.parameters {
                batch.set_parameter_at(env, id, value)?;
            }
            let window = windows[lane.window];
            batch.set_state(env, &self.start(window, WARM, &lane.bias))?;
            let q = wide(self.targets(Window { decision: window.decision - WARM, ..window }, 0));
            batch.set_command(env, &JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero })?;
        }
        let mut run = Running::new(self, lanes.len());
        for decision in 0..WARM {
            run.decide(batch, windows, lanes, torques, decision, WARM)?;
        }
        let starts: Vec<State> = lanes.par_iter().map(|lane| self.start(windows[lane.window], 0, &lane.bias)).collect();
        for (env, start) in starts.iter().enumerate() {
            batch.move_to(env, start)?;
        }
        Ok(())
    }

    /// Replays lanes for `length` decisions.
    ///
    /// # Errors
    /// When the simulator refuses a number.
    pub fn replay(
        &self,
        windows: &[Window],
        lanes: &[Lane],
        length: usize,
        torques: Option<&ShapeTorques>,
    ) -> Result<Errors, ResidualError> {
        let mut batch = self.batch(lanes.len())?;
        self.begin(&mut batch, windows, lanes, torques)?;
        let channels = self.log.joints + BASE_CHANNELS;
        let mut errors =
            Errors { lanes: lanes.len(), length, channels, values: vec![0.0; lanes.len() * length * channels] };
        let mut run = Running::new(self, lanes.len());
        let starts: Vec<[f32; 7]> = {
            batch.read_positions(&mut run.q)?;
            run.q.chunks_exact(7 + self.log.joints).map(|q| std::array::from_fn(|k| q[k])).collect()
        };
        for decision in 0..length {
            run.decide(&mut batch, windows, lanes, torques, decision, 0)?;
            batch.read_positions(&mut run.q)?;
            let rows = errors.values.par_chunks_exact_mut(length * channels).zip(lanes).zip(&starts);
            let q = &run.q;
            rows.enumerate().for_each(|(env, ((values, lane), start))| {
                let (before, now) = values.split_at_mut(decision * channels);
                let sim = &q[env * (7 + self.log.joints)..][..7 + self.log.joints];
                self.compare(windows[lane.window], decision + 1, sim, start, &lane.bias, &mut now[..channels]);
                let is_lost = now[..channels].iter().any(|x| x.is_nan() || x.abs() >= 10.0);
                if is_lost && decision > 0 {
                    now[..channels].copy_from_slice(&before[(decision - 1) * channels..]);
                } else if is_lost {
                    now[..channels].fill(1.0);
                }
            });
        }
        Ok(errors)
    }

    /// Simulated minus measured of one lane.
    fn compare(&self, window: Window, after: usize, sim: &[f32], start: &[f32; 7], bias: &[f64], out: &mut [f32]) {
        let stretch = &self.log.stretches[window.stretch];
        let joints = self.log.joints;
        let (real, _) = stretch.state(joints, window.decision + after);
        let (first, _) = stretch.state(joints, window.decision);
        for j in 0..joints {
            out[j] = sim[7 + j] + bias.get(j).map_or(0.0, |b| *b as f32) - real[7 + j];
        }
        // The path since the start, as the heading at the start sees it.
        let moved = [0, 1, 2].map(|k| (sim[k] - start[k]) - (real[k] - first[k]));
        let yaw = yaw_of(&first[3..7]);
        let (c, s) = (yaw.cos(), yaw.sin());
        out[joints] = c * moved[0] + s * moved[1];
        out[joints + 1] = c * moved[1] - s * moved[0];
        out[joints + 2] = moved[2];
        let (a, b) = (rotation_of(&sim[3..7]), rotation_of(&real[3..7]));
        for k in 0..2 {
            out[joints + 3 + k] = a[k] - b[k];
        }
        let turned = yaw_of(&sim[3..7]) - yaw_of(&real[3..7]);
        out[joints + 5] = turned.sin().atan2(turned.cos());
    }
}

/// Yaw of a quaternion w, x, y, z.
pub(crate) fn yaw_of(q: &[f32]) -> f32 {
    (2.0 * (q[0] * q[3] + q[1] * q[2])).atan2(1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))
}

/// Horizontal parts of gravity's direction in the base: small ones are pitch and roll.
fn rotation_of(q: &[f32]) -> [f32; 2] {
    [2.0 * (q[0] * q[2] - q[1] * q[3]), -2.0 * (q[0] * q[1] + q[2] * q[3])]
}

/// Work space of a replay that runs.
struct Running<'a> {
    replayer: &'a Replayer<'a>,
    q: Vec<f32>,
    v: Vec<f32>,
    torques: Vec<f32>,
    asked: Vec<f32>,
    added: Vec<f32>,
}

impl<'a> Running<'a> {
    pub fn new(replayer: &'a Replayer<'a>, lanes: usize) -> Self {
        let joints = replayer.log.joints;
        let zeros = |width: usize| vec![0.0; lanes * width];
        Self {
            replayer,
            q: zeros(7 + joints),
            v: zeros(6 + joints),
            torques: zeros(joints),
            asked: zeros(joints),
            added: zeros(joints),
        }
    }

    /// One decision of all lanes, `decision` after the window's start less `before`.
    pub fn decide(
        &mut self,
        batch: &mut Batch<f32>,
        windows: &[Window],
        lanes: &[Lane],
        torques: Option<&ShapeTorques>,
        decision: usize,
        before: usize,
    ) -> Result<(), ResidualError> {
        let (replayer, joints) = (self.replayer, self.replayer.log.joints);
        for substep in 0..replayer.log.substeps {
            for (lane, asked) in lanes.iter().zip(self.asked.chunks_exact_mut(joints)) {
                let window = windows[lane.window];
                let at = Window { decision: window.decision + decision - before, ..window };
                asked.copy_from_slice(replayer.targets(at, substep));
            }
            if let Some(torques) = torques {
                batch.read_positions(&mut self.q)?;
                batch.read_velocities(&mut self.v)?;
                batch.read_torques(&mut self.torques)?;
                torques.write(&self.q, &self.v, &self.torques, &mut self.added);
                batch.set_added_torques(&self.added)?;
            }
            let (kp, kd) = (&replayer.log.kp[..], &replayer.log.kd[..]);
            batch.set_commands(&BatchCommand { q: &self.asked, dq: None, kp, kd, tau: None })?;
            batch.step_parallel();
        }
        Ok(())
    }
}
