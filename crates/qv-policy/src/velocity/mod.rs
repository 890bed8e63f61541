//! The velocity task: many robots on some ground, each to follow a commanded velocity.
//!
//! The policy sees what a robot's own sensors show ([`OBSERVATION`]); it decides the targets of the joints around the stand. Rewards are
//! those of legged_gym (Rudin et al. 2021, table 1 of its appendix) with terms for clearance, slip and timing of the feet.

mod ground;
mod judge;
mod mirror;
mod propose;
mod randomise;
mod readings;
mod reward;
mod robot;
mod scaling;
mod settings;
mod sums;
mod turns;
mod walker;

pub use ground::Ground;
pub use mirror::RobotMirror;
pub use propose::known_robot;
pub use reward::TERMS;
pub use robot::{PerJoint, RobotFile, TaskRobot};
pub use settings::{Commands, Ends, Noise, Randomise, Reward, TaskSettings};
pub(crate) use turns::in_heading;
pub use walker::Walker;

use crate::PolicyError;
use crate::env::{End, VectorEnv};
use crate::shape_torques::ShapeTorques;
use crate::symmetry::Symmetry;
use judge::{Judge, Outcome, touches};
use qv_core::random::Xoshiro256PlusPlus;
use qv_sim::{Batch, BatchCommand, LineSearch, SimOptions, State};
use randomise::{Draws, set_known};
use rayon::prelude::*;
use readings::Readings;
use scaling::SCAN;
use sums::Sums;
use turns::{heading, turned, turned_back};

/// Parts of an observation with their length; `0` stands for the number of joints. All in SI units, unscaled.
pub const OBSERVATION: [(&str, usize); 6] = [
    ("gyroscope, base axes [rad/s]", 3),
    ("direction of gravity in the base", 3),
    ("command: forwards, to the left [m/s], turning [rad/s]", 3),
    ("joint angles [rad]", 0),
    ("joint speeds [rad/s]", 0),
    ("last targets [rad]", 0),
];

/// What follows in the observation where there is a clock, see [`TaskSettings::clock`].
pub const CLOCK: (&str, usize) = ("clock: sine and cosine of its phase, zeros under a command to stand", 2);

/// Parts of the observation with a clock of so many strides a second.
pub fn observation_parts(clock: f32) -> Vec<(&'static str, usize)> {
    OBSERVATION.into_iter().chain((clock > 0.0).then_some(CLOCK)).collect()
}

/// What a policy sees of a clock of `clock` strides a second at some decision of a walk, `rate` decisions a second: nothing where it has none.
pub fn clock_input(clock: f32, rate: f32, decision: usize, command: [f32; 3]) -> Vec<f32> {
    let phase = (f64::from(clock) * decision as f64 / f64::from(rate)).rem_euclid(1.0);
    clock_of(phase as f32, command)[..clock_numbers(clock)].to_vec()
}

/// Sine and cosine of a phase; zeros under a command to stand, one shorter than 0.01 (m/s and rad/s alike), as in descriptions of policies.
fn clock_of(phase: f32, command: [f32; 3]) -> [f32; 2] {
    if command.iter().map(|x| x * x).sum::<f32>() < 1e-4 {
        return [0.0; 2];
    }
    let (sin, cos) = (std::f32::consts::TAU * phase).sin_cos();
    [sin, cos]
}

/// Where the command begins in an observation.
pub const COMMAND_AT: usize = 6;

/// Many robots that learn to follow commands.
pub struct VelocityTask {
    robot: TaskRobot,
    settings: TaskSettings,
    /// Weights of the present epoch.
    reward: Reward,
    /// Commands of the present epoch.
    commands: Commands,
    ground: Ground,
    batch: Batch<f32>,
    draws: Draws,
    walkers: Vec<Walker>,
    /// Fixed commands instead of drawn ones, and no noise: for scores.
    pub judged: bool,
    /// Whether robots differ and are pushed where they are judged, too.
    pub varied: bool,
    targets: Vec<f32>,
    read: Readings,
    sums: Sums,
    /// Level of the curriculum of each robot, where the ground has levels.
    levels: Vec<[usize; 2]>,
    mount: [f32; 4],
    shape_torques: Option<ShapeTorques>,
    added: Vec<f32>,
}

impl VelocityTask {
    /// `count` robots on some ground.
    ///
    /// # Errors
    /// When a setting means nothing or the simulator refuses the robot.
    pub fn new(robot: TaskRobot, ground: Ground, settings: TaskSettings, count: usize) -> Result<Self, PolicyError> {
        settings.check()?;
        let options = SimOptions {
            timestep: settings.timestep(),
            iterations: settings.iterations,
            // Ends that reading docs/theory/simulator.md, "Speed", recommends for training.
            line_search: LineSearch::Apex,
            line_search_iterations: 4,
            tolerance: Some(1e-2),
            max_command_latency: Draws::longest_latency(&settings),
            ..Default::default()
        };
        let mut batch = Batch::<f32>::new(&robot.model, &ground.terrain, &options, count)?;
        set_known(&settings.parameters, &mut batch)?;
        let draws = Draws::new(&settings.randomise, &batch)?;
        let (joints, feet, geoms) = (robot.joints(), robot.feet.len(), robot.model.geoms.len());
        let read = Readings {
            q: vec![0.0; count * (7 + joints)],
            v: vec![0.0; count * (6 + joints)],
            torques: vec![0.0; count * joints],
            forces: vec![0.0; count * geoms * 3],
            peaks: vec![0.0; count * feet],
            feet: vec![0.0; count * feet * 3],
            feet_speed: vec![0.0; count * feet * 3],
            gyro: vec![0.0; count * 3],
            acc: vec![0.0; count * 3],
            orientation: vec![0.0; count * 4],
            encoder_q: vec![0.0; count * joints],
            encoder_dq: vec![0.0; count * joints],
        };
        let mount = ["imu", "imu_link"].iter().find_map(|name| robot.model.frame(name)).filter(|f| f.link == Some(0));
        let mount = mount.map_or([1.0, 0.0, 0.0, 0.0], |f| f.link_from_frame.wxyz());
        let mut task = Self {
            walkers: vec![Walker::new(joints, feet); count],
            targets: vec![0.0; count * joints],
            levels: vec![[0; 2]; count],
            judged: false,
            varied: false,
            sums: Sums::new(),
            mount: mount.map(|x| x as f32),
            shape_torques: None,
            added: vec![0.0; count * joints],
            reward: settings.reward.in_epoch(0),
            commands: settings.commands.in_epoch(0),
            robot,
            settings,
            ground,
            batch,
            draws,
            read,
        };
        task.restart(0, 0)?;
        Ok(task)
    }

    /// The robot.
    pub fn robot(&self) -> &TaskRobot {
        &self.robot
    }

    /// The settings.
    pub fn settings(&self) -> &TaskSettings {
        &self.settings
    }

    /// The ground.
    pub fn ground(&self) -> &Ground {
        &self.ground
    }

    /// The simulator, to change parameters, or to add torques.
    pub fn batch_mut(&mut self) -> &mut Batch<f32> {
        &mut self.batch
    }

    /// Adds torques that the simulator lacks, or no more.
    pub fn set_shape_torques(&mut self, torques: Option<ShapeTorques>) {
        self.shape_torques = torques;
    }

    /// What is remembered of each robot.
    pub fn walkers(&self) -> &[Walker] {
        &self.walkers
    }

    /// Commands one robot, until the task draws another (never, where it is judged).
    pub fn command(&mut self, env: usize, command: [f32; 3]) {
        self.walkers[env].command = command;
    }

    /// Joint targets in force, `[count][joints]` \[rad\].
    pub fn targets(&self) -> &[f32] {
        &self.targets
    }

    /// Positions `[count][7 + joints]`, velocities `[count][6 + joints]` and torques `[count][joints]` after the last step.
    pub fn motion(&self) -> (&[f32], &[f32], &[f32]) {
        (&self.read.q, &self.read.v, &self.read.torques)
    }

    /// Positions of the feet `[count][feet][3]` and forces on all shapes `[count][shapes][3]` after the last step, in the world.
    pub fn feet(&self) -> (&[f32], &[f32]) {
        (&self.read.feet, &self.read.forces)
    }

    /// Greatest force on each foot, upwards, of the physics steps of the last decision, `[count][feet]` \[N\].
    pub fn peaks(&self) -> &[f32] {
        &self.read.peaks
    }

    /// Puts one robot onto its feet at its place, and forgets its past.
    fn begin(&mut self, env: usize) -> Result<(), PolicyError> {
        let walker = &mut self.walkers[env];
        walker.begin();
        walker.first_phase = 0.0;
        let dt = self.settings.dt();
        let judged = self.judged;
        if !judged {
            walker.draw_command(&self.commands, dt);
            if self.settings.clock > 0.0 {
                // Commands come at any phase.
                walker.first_phase = walker.random.unit();
            }
        }
        if !judged || self.varied {
            self.draws.draw(env, &mut walker.random, &mut self.batch)?;
            walker.push_steps = push_steps(&mut walker.random, &self.settings);
        }
        let random = &mut walker.random;
        let places = &self.ground.places[self.levels[env][0] % self.ground.places.len()];
        let place = match self.ground.has_levels() {
            true => places[self.levels[env][1].min(places.len() - 1)],
            false => places[random.below(places.len())],
        };
        walker.place = self.levels[env];
        let around = self.ground.around;
        let [x, y] = [0, 1].map(|k| place[k] + random.between(-around, around));
        walker.start = [x, y];
        let yaw = if judged { 0.0 } else { random.between(-std::f32::consts::PI, std::f32::consts::PI) };
        let spread = if judged { 0.0 } else { self.settings.randomise.start_angle };
        let speed = if judged { 0.0 } else { self.settings.randomise.start_speed };
        let joints = self.robot.joints();
        let mut q = vec![0.0f64; 7 + joints];
        let ground = self.highest(x, y);
        (q[0], q[1], q[2]) = (f64::from(x), f64::from(y), f64::from(ground + self.robot.height));
        (q[3], q[6]) = ((0.5 * f64::from(yaw)).cos(), (0.5 * f64::from(yaw)).sin());
        let random = &mut self.walkers[env].random;
        for j in 0..joints {
            let (low, high) = self.robot.limits(j);
            q[7 + j] = f64::from((self.robot.stand[j] + random.between(-spread, spread)).clamp(low, high));
        }
        let mut v = vec![0.0f64; 6 + joints];
        v[0] = f64::from(random.between(-speed, speed));
        v[1] = f64::from(random.between(-speed, speed));
        self.batch.set_state(env, &State { q, v })?;
        self.targets[env * joints..][..joints].copy_from_slice(&self.robot.stand);
        Ok(())
    }

    /// Highest ground under a robot that stands at (x, y): nothing of it begins inside the ground.
    fn highest(&self, x: f32, y: f32) -> f32 {
        if self.ground.is_plane() {
            return 0.0;
        }
        let reach = self.robot.height;
        let around = (0..25).map(|k| ((k % 5) as f32 * 0.5 - 1.0, (k / 5) as f32 * 0.5 - 1.0));
        let heights = around.filter_map(|(i, j)| self.ground.height(x + i * reach, y + j * reach, f32::MAX));
        heights.fold(f32::NEG_INFINITY, f32::max).max(-1e3)
    }

    /// Reads all that rewards and observations need.
    fn look(&mut self) -> Result<(), PolicyError> {
        let read = &mut self.read;
        self.batch.read_positions(&mut read.q)?;
        self.batch.read_velocities(&mut read.v)?;
        self.batch.read_torques(&mut read.torques)?;
        self.batch.read_geom_forces(&mut read.forces)?;
        self.batch.read_imu(&mut read.gyro, &mut read.acc, &mut read.orientation)?;
        self.batch.read_encoders(&mut read.encoder_q, &mut read.encoder_dq)?;
        self.batch.read_geoms(&self.robot.feet, &mut read.feet, &mut read.feet_speed)?;
        Ok(())
    }

    /// What judges a step.
    fn make_judge(&self) -> Judge<'_> {
        Judge {
            robot: &self.robot,
            settings: &self.settings,
            reward: &self.reward,
            ground: &self.ground,
            batch: &self.batch,
            read: &self.read,
            judged: self.judged,
            commands: &self.commands,
            torque: self.robot.torque_scale(),
            weight: (self.robot.model.mass() * qv_core::GRAVITY) as f32,
            foot_radius: self.robot.feet.iter().map(|&g| self.robot.foot_radius(g)).collect(),
            length: (self.settings.episode * self.settings.rate) as u32,
        }
    }

    /// The next place of the curriculum after an episode: harder for who lasted its time and went four fifths of the path that was asked
    /// for, easier for who fell or went less than half of it. (Rudin et al. 2021, section 3, ask for the distance from the start; under
    /// commands that turn, who follows them well comes back to it.)
    fn promote(&mut self, env: usize) {
        if !self.ground.has_levels() || self.judged {
            return;
        }
        let walker = &mut self.walkers[env];
        let lasted = walker.steps >= (self.settings.episode * self.settings.rate) as u32;
        let last = self.ground.places[0].len() - 1;
        let level = &mut self.levels[env][1];
        if lasted && walker.went >= 0.8 * walker.asked {
            // Who has done them all goes anywhere, so that nothing is forgotten.
            *level = if *level == last { walker.random.below(last + 1) } else { *level + 1 };
        } else if (!lasted || walker.went < 0.5 * walker.asked) && *level > 0 {
            *level -= 1;
        }
        self.levels[env][0] = walker.random.below(self.ground.places.len());
    }

    fn push(&mut self) -> Result<(), PolicyError> {
        let most = self.settings.randomise.push;
        if most == 0.0 || (self.judged && !self.varied) {
            return Ok(());
        }
        let mut change = vec![0.0; 6 + self.robot.joints()];
        for (env, walker) in self.walkers.iter_mut().enumerate() {
            walker.push_steps = walker.push_steps.saturating_sub(1);
            if walker.push_steps == 0 {
                walker.push_steps = push_steps(&mut walker.random, &self.settings);
                (change[0], change[1]) =
                    (f64::from(walker.random.between(-most, most)), f64::from(walker.random.between(-most, most)));
                self.batch.add_velocity(env, &change)?;
            }
        }
        Ok(())
    }
}

/// Numbers of an observation that a clock of so many strides a second has.
pub(crate) fn clock_numbers(clock: f32) -> usize {
    if clock > 0.0 { 2 } else { 0 }
}

/// Steps until the next push, exponentially distributed.
fn push_steps(random: &mut Xoshiro256PlusPlus, settings: &TaskSettings) -> u32 {
    let time = -f64::from(1.0 - random.unit()).ln() * f64::from(settings.randomise.push_every);
    ((time * f64::from(settings.rate)) as u32).max(1)
}

impl VectorEnv for VelocityTask {
    fn count(&self) -> usize {
        self.batch.len()
    }

    fn observations(&self) -> usize {
        9 + 3 * self.robot.joints() + clock_numbers(self.settings.clock)
    }

    fn privileged(&self) -> usize {
        self.observations() + 4 + 4 * self.robot.feet.len() + SCAN.len()
    }

    fn actions(&self) -> usize {
        self.robot.joints()
    }

    fn observation_scaling(&self) -> (Vec<f32>, Vec<f32>) {
        scaling::observation(&self.robot, clock_numbers(self.settings.clock))
    }

    fn privileged_scaling(&self) -> (Vec<f32>, Vec<f32>) {
        scaling::privileged(&self.robot, clock_numbers(self.settings.clock))
    }

    fn observe(&mut self, observations: &mut [f32], privileged: &mut [f32]) {
        let (seen, known, joints) = (self.observations(), self.privileged(), self.robot.joints());
        let geoms = self.robot.model.geoms.len();
        let (read, robot, ground, mount) = (&self.read, &self.robot, &self.ground, self.mount);
        let noise = if self.judged { None } else { Some(&self.settings.noise) };
        let targets = &self.targets;
        let (clock, dt) = (self.settings.clock, self.settings.dt());
        let rows = observations.par_chunks_mut(seen).zip(privileged.par_chunks_mut(known));
        rows.zip(&mut self.walkers).enumerate().with_min_len(16).for_each(|(env, ((row, all), walker))| {
            let q = &read.q[env * (7 + joints)..][..7 + joints];
            let v = &read.v[env * (6 + joints)..][..6 + joints];
            let turn = [
                read.orientation[4 * env],
                read.orientation[4 * env + 1],
                read.orientation[4 * env + 2],
                read.orientation[4 * env + 3],
            ];
            let gyro = [read.gyro[3 * env], read.gyro[3 * env + 1], read.gyro[3 * env + 2]];
            // From the IMU's axes to the base's, by the mounting that the model states.
            let gravity = turned(mount, turned_back(turn, [0.0, 0.0, -1.0]));
            let gyro = turned(mount, gyro);
            row[..3].copy_from_slice(&gyro);
            row[3..6].copy_from_slice(&gravity);
            row[COMMAND_AT..][..3].copy_from_slice(&walker.command);
            row[9..9 + joints].copy_from_slice(&read.encoder_q[env * joints..][..joints]);
            row[9 + joints..9 + 2 * joints].copy_from_slice(&read.encoder_dq[env * joints..][..joints]);
            row[9 + 2 * joints..9 + 3 * joints].copy_from_slice(&targets[env * joints..][..joints]);
            row[9 + 3 * joints..]
                .copy_from_slice(&clock_of(walker.phase(clock, dt), walker.command)[..seen - 9 - 3 * joints]);
            // The critic knows the true state.
            all[..3].copy_from_slice(&v[3..6]);
            all[3..6].copy_from_slice(&turned_back([q[3], q[4], q[5], q[6]], [0.0, 0.0, -1.0]));
            all[COMMAND_AT..][..3].copy_from_slice(&walker.command);
            all[9..9 + joints].copy_from_slice(&q[7..]);
            all[9 + joints..9 + 2 * joints].copy_from_slice(&v[6..]);
            all[9 + 2 * joints..9 + 3 * joints].copy_from_slice(&targets[env * joints..][..joints]);
            all[9 + 3 * joints..seen].copy_from_slice(&row[9 + 3 * joints..]);
            let rest = &mut all[seen..];
            rest[..3].copy_from_slice(&turned_back([q[3], q[4], q[5], q[6]], [v[0], v[1], v[2]]));
            rest[3] = q[2] - walker.ground;
            let feet = robot.feet.len();
            for (k, &foot) in robot.feet.iter().enumerate() {
                rest[4 + k] = f32::from(touches(&read.forces, geoms, env, foot));
            }
            // What the terms of the gait remember.
            for (list, part) in
                [&walker.air, &walker.stance, &walker.duty].iter().zip(rest[4 + feet..].chunks_mut(feet))
            {
                part.copy_from_slice(list);
            }
            let heading = heading([q[3], q[4], q[5], q[6]]);
            for (k, [ahead, aside]) in SCAN.into_iter().enumerate() {
                let [c, s] = heading;
                let at = [q[0] + c * ahead - s * aside, q[1] + s * ahead + c * aside];
                let height = if ground.is_plane() { Some(0.0) } else { ground.height(at[0], at[1], q[2]) };
                rest[4 + 4 * feet + k] = height.map_or(0.0, |h| (h - walker.ground).clamp(-0.5, 0.5));
            }
            if let Some(noise) = noise {
                let random = &mut walker.random;
                let mut add = |part: &mut [f32], width: f32| {
                    part.iter_mut().for_each(|x| *x += random.between(-width, width));
                };
                add(&mut row[..3], noise.gyro);
                add(&mut row[3..6], noise.gravity);
                add(&mut row[9..9 + joints], noise.position);
                add(&mut row[9 + joints..9 + 2 * joints], noise.speed);
            }
        });
    }

    fn step(&mut self, actions: &[f32], rewards: &mut [f32], ends: &mut [End]) -> Result<(), PolicyError> {
        self.aim(actions)?;
        self.simulate()?;
        self.judge(actions, rewards, ends)
    }

    fn reset(&mut self, mask: &[bool]) -> Result<(), PolicyError> {
        for env in (0..mask.len()).filter(|&env| mask[env]) {
            self.promote(env);
            self.begin(env)?;
        }
        self.look()?;
        for env in (0..mask.len()).filter(|&env| mask[env]) {
            let at = &self.read.q[env * (7 + self.robot.joints())..];
            self.walkers[env].ground = self.ground.height(at[0], at[1], at[2]).unwrap_or(0.0);
        }
        Ok(())
    }

    fn restart(&mut self, seed: u64, epoch: u64) -> Result<(), PolicyError> {
        let length = (self.settings.episode * self.settings.rate) as usize;
        self.reward = self.settings.reward.in_epoch(epoch);
        self.commands = self.settings.commands.in_epoch(epoch);
        for env in 0..self.count() {
            self.walkers[env].random = Xoshiro256PlusPlus::of(seed ^ epoch.rotate_left(40), 4, env as u64);
            if epoch == 0 {
                // Scores are of the hardest places.
                let level = if self.judged { self.ground.places[0].len() - 1 } else { 0 };
                self.levels[env] = [env % self.ground.places.len(), level];
            }
            self.begin(env)?;
            if !self.judged {
                let walker = &mut self.walkers[env];
                // Else all episodes would end together.
                walker.steps = walker.random.below(length) as u32;
                walker.command_steps = 1 + walker.random.below(walker.command_steps.max(1) as usize) as u32;
            }
        }
        self.look()?;
        for env in 0..self.count() {
            let at = &self.read.q[env * (7 + self.robot.joints())..];
            self.walkers[env].ground = self.ground.height(at[0], at[1], at[2]).unwrap_or(0.0);
        }
        Ok(())
    }

    fn symmetry(&self) -> Option<Symmetry> {
        scaling::symmetry(&self.robot, clock_numbers(self.settings.clock))
    }

    fn figures(&mut self) -> Vec<(&'static str, f32)> {
        let sums = std::mem::replace(&mut self.sums, Sums::new());
        let mean = |sum: f64| if sums.steps > 0.0 { (sum / sums.steps) as f32 } else { 0.0 };
        let mut out: Vec<(&'static str, f32)> =
            TERMS.iter().zip(sums.terms).map(|(name, sum)| (*name, mean(sum))).collect();
        out.push(("velocity_error", mean(sums.velocity_error)));
        out.push(("turning_error", mean(sums.turning_error)));
        let landings = sums.feet[0].max(1.0);
        out.push(("swing_time", (sums.feet[1] / landings) as f32));
        out.push(("swing_height", (sums.feet[2] / landings) as f32));
        let level: usize = self.levels.iter().map(|l| l[1]).sum();
        out.push(("level", level as f32 / self.levels.len() as f32));
        out
    }

    fn curriculum(&self) -> Vec<f32> {
        self.levels.iter().flatten().map(|&l| l as f32).collect()
    }

    fn set_curriculum(&mut self, numbers: &[f32]) {
        for (level, pair) in self.levels.iter_mut().zip(numbers.chunks_exact(2)) {
            *level = [pair[0] as usize, pair[1] as usize];
        }
    }
}

impl VelocityTask {
    /// First part of a step: targets from actions, pushes, commands for the simulator.
    ///
    /// # Errors
    /// When an action is not finite.
    pub fn aim(&mut self, actions: &[f32]) -> Result<(), PolicyError> {
        let joints = self.robot.joints();
        if let Some(bad) = actions.iter().find(|a| !a.is_finite()) {
            return Err(PolicyError::NotFinite { iteration: 0, term: "action".into(), found: *bad });
        }
        for (env, targets) in self.targets.chunks_exact_mut(joints).enumerate() {
            for (j, target) in targets.iter_mut().enumerate() {
                let (low, high) = self.robot.limits(j);
                let wanted = self.robot.stand[j] + self.robot.action_scale[j] * actions[env * joints + j];
                *target = wanted.clamp(low, high);
            }
        }
        self.push()?;
        let command = BatchCommand { q: &self.targets, dq: None, kp: &self.robot.kp, kd: &self.robot.kd, tau: None };
        self.batch.set_commands(&command)?;
        Ok(())
    }

    /// Second part of a step: physics alone, with the torques of shapes.
    ///
    /// # Errors
    /// When an added torque is not finite.
    pub fn simulate(&mut self) -> Result<(), PolicyError> {
        self.read.peaks.fill(0.0);
        for step in 0..self.settings.substeps {
            if let Some(torques) = &self.shape_torques {
                if step > 0 {
                    self.batch.read_positions(&mut self.read.q)?;
                    self.batch.read_velocities(&mut self.read.v)?;
                    self.batch.read_torques(&mut self.read.torques)?;
                }
                torques.write(&self.read.q, &self.read.v, &self.read.torques, &mut self.added);
                self.batch.set_added_torques(&self.added)?;
            }
            self.batch.step_parallel();
            self.batch.read_geom_forces(&mut self.read.forces)?;
            self.note_peaks();
        }
        Ok(())
    }

    /// An impact is over before the end of a decision: forces are looked at after each physics step.
    fn note_peaks(&mut self) {
        let (geoms, feet) = (self.robot.model.geoms.len(), &self.robot.feet);
        for (peaks, forces) in
            self.read.peaks.chunks_exact_mut(feet.len()).zip(self.read.forces.chunks_exact(3 * geoms))
        {
            for (peak, foot) in peaks.iter_mut().zip(feet) {
                *peak = peak.max(forces[3 * foot + 2]);
            }
        }
    }

    /// Third part of a step: rewards and ends of all robots, from the state that the simulator is in.
    ///
    /// # Errors
    /// When a term of the reward is not finite; it is named.
    pub fn judge(&mut self, actions: &[f32], rewards: &mut [f32], ends: &mut [End]) -> Result<(), PolicyError> {
        let (joints, count) = (self.robot.joints(), self.count());
        self.look()?;
        let mut outcomes = vec![None; count];
        let mut walkers = std::mem::take(&mut self.walkers);
        let shared = self.make_judge();
        let parts = walkers.par_iter_mut().zip(rewards).zip(ends).zip(&mut outcomes);
        parts.enumerate().with_min_len(16).for_each(|(env, (((walker, reward), end), outcome))| {
            let action = &actions[env * joints..][..joints];
            let (done, how) = shared.judge(env, action, walker);
            *reward = done.terms.iter().sum::<f32>() * shared.settings.dt();
            *end = how;
            *outcome = Some(done);
        });
        self.walkers = walkers;
        self.gather(outcomes.into_iter().flatten())
    }

    /// Adds what robots did to the sums, and names a term that is not finite.
    fn gather(&mut self, outcomes: impl Iterator<Item = Outcome>) -> Result<(), PolicyError> {
        for outcome in outcomes {
            self.sums.steps += 1.0;
            for (k, &term) in outcome.terms.iter().enumerate() {
                if !term.is_finite() {
                    let term_name = format!("term `{}` of the reward", TERMS[k]);
                    return Err(PolicyError::NotFinite { iteration: 0, term: term_name, found: term });
                }
                self.sums.terms[k] += f64::from(term);
            }
            self.sums.velocity_error += f64::from(outcome.velocity_error);
            self.sums.turning_error += f64::from(outcome.turning_error);
            self.sums.feet.iter_mut().zip(outcome.feet).for_each(|(sum, x)| *sum += f64::from(x));
        }
        Ok(())
    }
}
