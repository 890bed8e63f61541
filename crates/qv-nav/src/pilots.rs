//! Who decides: the network, the teacher, both in turn, and a follower of coloured blobs.

use crate::net::{HEIGHT, HIDDEN, KNOWN, Net, NetInput, NetOutput, OUTPUTS, SIGHT, Scratch, WIDTH};
use crate::roll::{Decision, Pilot, PilotInput};
use crate::task::{Episode, Limits};
use qv_core::random::Xoshiro256PlusPlus;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The network.
pub struct NetPilot<'a> {
    net: &'a Net,
    parameters: &'a [f32],
    robots: Vec<(Vec<f32>, Scratch)>,
    /// What it said at the last decision of each robot.
    pub said: Vec<NetOutput>,
}

impl<'a> NetPilot<'a> {
    /// For `count` robots.
    pub fn new(net: &'a Net, parameters: &'a [f32], count: usize) -> Self {
        let robots = (0..count).map(|_| (vec![0.0; HIDDEN], net.scratch())).collect();
        Self {
            net,
            parameters,
            robots,
            said: vec![NetOutput { out: [0.0; OUTPUTS + KNOWN], sight: [0.0; SIGHT] }; count],
        }
    }
}

impl Pilot for NetPilot<'_> {
    fn begin(&mut self, env: usize, _episode: &Episode) {
        self.robots[env].0.fill(0.0);
    }

    fn decide(&mut self, seen: &[PilotInput]) -> Vec<Decision> {
        let mut of_env: Vec<Option<&PilotInput>> = vec![None; self.robots.len()];
        seen.iter().for_each(|s| of_env[s.env] = Some(s));
        let (net, parameters) = (self.net, self.parameters);
        let robots = self.robots.par_iter_mut().zip(&mut self.said).zip(of_env);
        robots.for_each(|(((memory, scratch), out), seen)| {
            if let Some(seen) = seen {
                let picture: Vec<f32> = seen.picture.iter().map(|&b| f32::from(b)).collect();
                let sees = NetInput { picture: &picture, state: seen.state, recall: seen.recall };
                *out = net.step(parameters, &sees, memory, scratch);
            }
        });
        let says = |s: &PilotInput| &self.said[s.env];
        seen.iter()
            .map(|s| Decision { command: [0, 1, 2].map(|k| says(s).out[k]), sight: Some(says(s).sight) })
            .collect()
    }
}

/// The teacher itself.
pub struct TeacherPilot {
    /// Limits of commands.
    pub limits: Limits,
}

impl Pilot for TeacherPilot {
    fn begin(&mut self, _env: usize, _episode: &Episode) {}

    fn decide(&mut self, seen: &[PilotInput]) -> Vec<Decision> {
        seen.iter().map(|s| Decision { command: self.limits.shares(s.advice.command), sight: None }).collect()
    }
}

/// Who drives when an episode is driven by several in turn: shares of the time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mixture {
    /// Share of the episodes that the network drives alone.
    pub alone: f32,
    /// Share of the time of the others in which the teacher drives.
    pub taught: f32,
    /// Share of their time in which a command drives that was drawn: it brings the robot where neither of the two would.
    pub stray: f32,
    /// Mean number of decisions until the driver changes.
    pub stretch: f32,
    /// Share of the episodes in which the robot recalls the truth with errors instead of what the network says of its pictures.
    #[serde(alias = "goal_given")]
    pub goal_given: f32,
}

/// Who drives now.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Driver {
    Student,
    Teacher,
    Stray([f32; 3]),
}

/// The network, the teacher and drawn commands in turn.
pub struct MixedPilot<'a> {
    student: NetPilot<'a>,
    limits: Limits,
    mixture: Mixture,
    drivers: Vec<Drives>,
}

/// Who drives a robot: now, whether the network alone does, and whether it recalls the truth.
struct Drives {
    driver: Driver,
    alone: bool,
    goal_given: bool,
    random: Xoshiro256PlusPlus,
}

impl<'a> MixedPilot<'a> {
    /// For `count` robots.
    pub fn new(student: NetPilot<'a>, limits: Limits, mixture: Mixture, count: usize) -> Self {
        let idle =
            |_| Drives { driver: Driver::Teacher, alone: false, goal_given: true, random: Xoshiro256PlusPlus::new(0) };
        let drivers = (0..count).map(idle).collect();
        Self { student, limits, mixture, drivers }
    }
}

impl Mixture {
    fn draw(&self, random: &mut Xoshiro256PlusPlus) -> Driver {
        let share = random.unit();
        if share < self.taught {
            Driver::Teacher
        } else if share < self.taught + self.stray {
            Driver::Stray([0; 3].map(|_| random.between(-1.0, 1.0)))
        } else {
            Driver::Student
        }
    }

    /// Whether the network drives an episode alone.
    pub fn is_alone(&self, episode: &Episode) -> bool {
        Xoshiro256PlusPlus::of(episode.seed, 87, 0).unit() < self.alone
    }
}

impl Pilot for MixedPilot<'_> {
    fn begin(&mut self, env: usize, episode: &Episode) {
        self.student.begin(env, episode);
        let mut random = Xoshiro256PlusPlus::of(episode.seed, 88, 0);
        let alone = self.mixture.is_alone(episode);
        let driver = if alone { Driver::Student } else { self.mixture.draw(&mut random) };
        let goal_given = random.unit() < self.mixture.goal_given;
        self.drivers[env] = Drives { driver, alone, goal_given, random };
    }

    fn decide(&mut self, seen: &[PilotInput]) -> Vec<Decision> {
        // Without it, its memory is of no use either: a first round need not run the network.
        let Mixture { alone, taught, stray, goal_given, stretch } = self.mixture;
        let absent = alone <= 0.0 && taught + stray >= 1.0 && goal_given >= 1.0;
        let nothing = Decision { command: [0.0; 3], sight: None };
        let mut out = if absent { vec![nothing; seen.len()] } else { self.student.decide(seen) };
        for (out, s) in out.iter_mut().zip(seen) {
            let drives = &mut self.drivers[s.env];
            if !drives.alone && drives.random.unit() * stretch < 1.0 {
                drives.driver = self.mixture.draw(&mut drives.random);
            }
            match drives.driver {
                Driver::Student => {}
                Driver::Teacher => out.command = self.limits.shares(s.advice.command),
                Driver::Stray(command) => out.command = command,
            }
            if drives.goal_given {
                out.sight = None;
            }
        }
        out
    }
}

/// Follows the largest patch of the wanted colour in the picture, and turns to the left while there is none: what needs no learning.
pub struct BlobPilot {
    /// Limits of commands.
    pub limits: Limits,
}

impl BlobPilot {
    /// So many pixels are a blob.
    pub const LEAST: usize = 3;

    /// Number of pixels of a hue \[degrees\], their mean column, and the lowest row.
    pub fn blob(picture: &[u8], hue: f32) -> (usize, f64, usize) {
        let (mut count, mut sum, mut lowest) = (0, 0.0, 0);
        for (k, p) in picture.chunks_exact(3).enumerate() {
            let [r, g, b] = [p[0], p[1], p[2]].map(f64::from);
            let (most, least) = (r.max(g).max(b), r.min(g).min(b));
            let spread = most - least;
            if most < 60.0 || spread < 0.55 * most {
                continue;
            }
            let own = if most == r {
                60.0 * (g - b) / spread
            } else if most == g {
                60.0 * (b - r) / spread + 120.0
            } else {
                60.0 * (r - g) / spread + 240.0
            };
            let off = (own - f64::from(hue) + 180.0).rem_euclid(360.0) - 180.0;
            if off.abs() < 12.0 {
                count += 1;
                sum += (k % WIDTH) as f64;
                lowest = k / WIDTH;
            }
        }
        (count, sum / (count.max(1) as f64), lowest)
    }
}

impl Pilot for BlobPilot {
    fn begin(&mut self, _env: usize, _episode: &Episode) {}

    fn decide(&mut self, seen: &[PilotInput]) -> Vec<Decision> {
        seen.iter()
            .map(|s| {
                let (count, column, lowest) = Self::blob(s.picture, s.hue);
                let turn = (0.5 * WIDTH as f64 - column) / (0.5 * WIDTH as f64) * 0.48;
                // A cone that fills this many pixels at the lower edge is about 0.3 m from the head.
                let near = lowest + 1 == HEIGHT && count > 330;
                let command = match count {
                    0..Self::LEAST => [0.0, 0.0, self.limits.turning],
                    _ if near => [0.0, 0.0, turn],
                    _ => [0.5 * (1.0 - turn.abs()), 0.0, 2.0 * turn],
                };
                Decision { command: self.limits.shares(command), sight: None }
            })
            .collect()
    }
}

/// The same command always: ahead, with a turn that leads in a circle. What knows nothing reaches this much.
pub struct ConstantPilot {
    /// The command as shares of its limits.
    pub command: [f32; 3],
}

impl ConstantPilot {
    /// Ahead at half of its speed, turning a little to the left.
    pub fn circling(limits: &Limits) -> Self {
        Self { command: limits.shares([0.3, 0.0, 0.15]) }
    }
}

impl Pilot for ConstantPilot {
    fn begin(&mut self, _env: usize, _episode: &Episode) {}

    fn decide(&mut self, seen: &[PilotInput]) -> Vec<Decision> {
        seen.iter().map(|_| Decision { command: self.command, sight: None }).collect()
    }
}

/// Commands that are drawn, each held for a second on average.
pub struct RandomPilot {
    robots: Vec<([f32; 3], Xoshiro256PlusPlus)>,
}

impl RandomPilot {
    /// For `count` robots.
    pub fn new(count: usize) -> Self {
        Self { robots: (0..count).map(|_| ([0.0; 3], Xoshiro256PlusPlus::new(0))).collect() }
    }
}

impl Pilot for RandomPilot {
    fn begin(&mut self, env: usize, episode: &Episode) {
        self.robots[env] = ([0.0; 3], Xoshiro256PlusPlus::of(episode.seed, 79, 0));
    }

    fn decide(&mut self, seen: &[PilotInput]) -> Vec<Decision> {
        seen.iter()
            .map(|s| {
                let (command, random) = &mut self.robots[s.env];
                if random.unit() < 0.2 || *command == [0.0; 3] {
                    *command = [0; 3].map(|_| random.between(-1.0, 1.0));
                }
                Decision { command: *command, sight: None }
            })
            .collect()
    }
}
