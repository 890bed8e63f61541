//! What carries the camera: the trait, and a follower of velocities that knows no legs.

use crate::NavError;
use crate::map::Map;
use crate::task::PERIOD;
use glam::DVec2;
use qv_core::Pose;
use qv_core::random::Xoshiro256PlusPlus;
use std::collections::VecDeque;

/// Where a robot begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Base from above \[m\].
    pub place: [f64; 2],
    /// Its heading \[rad\].
    pub yaw: f64,
    /// For what differs from episode to episode.
    pub seed: u64,
}

/// How a robot moves at the moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// The base in the world.
    pub world_from_base: Pose,
    /// Angular velocity in base axes \[rad/s\].
    pub gyro: [f64; 3],
    /// Whether it fell.
    pub fell: bool,
}

/// Many robots that follow commands.
pub trait Legs {
    /// How many there can be at once.
    fn count(&self) -> usize;
    /// Puts the first robots onto their places; there are at most [`Legs::count`].
    ///
    /// # Errors
    /// When there are too many, or a simulator refuses.
    fn begin(&mut self, starts: &[Start]) -> Result<(), NavError>;
    /// Follows commands (forwards, to the left \[m/s\], turning \[rad/s\]) for [`PERIOD`]; robots that are not `active` may stand still.
    ///
    /// # Errors
    /// When a simulator fails.
    fn step(&mut self, commands: &[[f64; 3]], active: &[bool]) -> Result<(), NavError>;
    /// How one moves.
    fn motion(&self, env: usize) -> Motion;
    /// Where the base was `ago` seconds ago, at most 0.3 s, to 20 ms; at the start where it began.
    fn past(&self, env: usize, ago: f64) -> Pose;
}

/// Poses of the last 0.3 s, every 20 ms.
#[derive(Debug, Clone, Default)]
pub struct Past(VecDeque<Pose>);

/// Seconds from one kept pose to the next.
pub const TICK: f64 = 0.02;

impl Past {
    /// Forgets all but one pose.
    pub fn begin(&mut self, pose: Pose) {
        self.0.clear();
        self.0.push_back(pose);
    }

    /// Adds the pose after a tick.
    pub fn push(&mut self, pose: Pose) {
        self.0.push_back(pose);
        if self.0.len() > 16 {
            self.0.pop_front();
        }
    }

    /// The pose so many seconds before the last one.
    pub fn ago(&self, ago: f64) -> Pose {
        let back = (ago / TICK).round().max(0.0) as usize;
        let at = self.0.len().saturating_sub(1 + back);
        self.0.get(at).copied().unwrap_or(Pose::IDENTITY)
    }
}

/// Robots whose velocity follows the command as a first-order lag does, on the map's heights, with a sway as of walking. Nothing stops them
/// but the judge: there is no physics in this.
pub struct Follower<'a> {
    map: &'a Map,
    robots: Vec<One>,
    height: f64,
}

#[derive(Debug, Clone, Default)]
struct One {
    place: DVec2,
    yaw: f64,
    velocity: [f64; 3],
    /// What each velocity is multiplied with, and the lag \[s\].
    gains: [f64; 3],
    lag: f64,
    phase: f64,
    gyro: [f64; 3],
    past: Past,
}

impl<'a> Follower<'a> {
    /// `count` robots whose base is `height` over the ground \[m\].
    pub fn new(map: &'a Map, count: usize, height: f64) -> Self {
        Self { map, robots: vec![One::default(); count], height }
    }
}

impl One {
    fn pose(&self, map: &Map, height: f64) -> Pose {
        let [sway, bob, nod] = [self.phase, 2.0 * self.phase + 0.6, 2.0 * self.phase].map(f64::sin);
        let forwards = DVec2::from_angle(self.yaw);
        let under = |p: DVec2| map.height(p);
        let here = under(self.place).unwrap_or(0.0);
        let rise = match (under(self.place + 0.2 * forwards), under(self.place - 0.2 * forwards)) {
            (Some(a), Some(b)) if (a - b).abs() < 0.15 => ((a - b) / 0.4).atan(),
            _ => 0.0,
        };
        let position = [self.place.x, self.place.y, here + height + 0.006 * bob];
        Pose::from_xyz_rpy(position, [0.02 * sway, 0.015 * nod - rise, self.yaw])
    }

    fn tick(&mut self, map: &Map, height: f64, command: [f64; 3]) {
        let share = 1.0 - (-TICK / self.lag).exp();
        for k in 0..3 {
            self.velocity[k] += share * (self.gains[k] * command[k] - self.velocity[k]);
        }
        let before = self.past.ago(0.0);
        self.yaw += TICK * self.velocity[2];
        self.place += TICK * DVec2::from_angle(self.yaw).rotate(DVec2::new(self.velocity[0], self.velocity[1]));
        // Steps twice a second, in place as well.
        self.phase += TICK * std::f64::consts::TAU * 2.0;
        let pose = self.pose(map, height);
        let turn = before.rotation.conjugate() * pose.rotation;
        let half = if turn.w < 0.0 { -1.0 } else { 1.0 };
        self.gyro = [turn.x, turn.y, turn.z].map(|x| 2.0 * half * x / TICK);
        self.past.push(pose);
    }
}

impl Legs for Follower<'_> {
    fn count(&self) -> usize {
        self.robots.len()
    }

    fn begin(&mut self, starts: &[Start]) -> Result<(), NavError> {
        if starts.len() > self.robots.len() {
            return Err(NavError::value("starts", &format!("at most {}", self.robots.len()), starts.len()));
        }
        for (robot, start) in self.robots.iter_mut().zip(starts) {
            let mut random = Xoshiro256PlusPlus::of(start.seed, 83, 0);
            let mut between = |low: f32, high: f32| f64::from(random.between(low, high));
            *robot = One {
                place: DVec2::from(start.place),
                yaw: start.yaw,
                gains: [between(0.85, 1.1), between(0.8, 1.1), between(0.85, 1.1)],
                lag: between(0.08, 0.25),
                phase: between(0.0, std::f32::consts::TAU),
                ..One::default()
            };
            robot.past.begin(robot.pose(self.map, self.height));
        }
        Ok(())
    }

    fn step(&mut self, commands: &[[f64; 3]], active: &[bool]) -> Result<(), NavError> {
        for ((robot, command), _) in self.robots.iter_mut().zip(commands).zip(active).filter(|(_, active)| **active) {
            for _ in 0..(PERIOD / TICK).round() as usize {
                robot.tick(self.map, self.height, *command);
            }
        }
        Ok(())
    }

    fn motion(&self, env: usize) -> Motion {
        let robot = &self.robots[env];
        Motion { world_from_base: robot.past.ago(0.0), gyro: robot.gyro, fell: false }
    }

    fn past(&self, env: usize, ago: f64) -> Pose {
        self.robots[env].past.ago(ago)
    }
}
