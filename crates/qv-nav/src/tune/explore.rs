//! The network with noise on its commands.

use crate::net::{COMMAND, Net};
use crate::pilots::NetPilot;
use crate::roll::{Decision, Pilot, PilotInput, StudentAction};
use crate::task::Episode;
use qv_core::random::Xoshiro256PlusPlus;

/// Drives, and keeps what it did.
pub(super) struct Explorer<'a> {
    student: NetPilot<'a>,
    deviation: f32,
    seed: u64,
    robots: Vec<(Xoshiro256PlusPlus, Vec<StudentAction>)>,
}

impl<'a> Explorer<'a> {
    pub(super) fn new(net: &'a Net, parameters: &'a [f32], deviation: f32, (count, seed): (usize, u64)) -> Self {
        let robots = vec![(Xoshiro256PlusPlus::new(0), Vec::new()); count];
        Self { student: NetPilot::new(net, parameters, count), deviation, seed, robots }
    }

    /// What each robot did, in the order of its decisions.
    pub(super) fn into_acted(self) -> impl Iterator<Item = Vec<StudentAction>> {
        self.robots.into_iter().map(|(_, acted)| acted)
    }
}

impl Pilot for Explorer<'_> {
    fn begin(&mut self, env: usize, episode: &Episode) {
        self.student.begin(env, episode);
        self.robots[env] = (Xoshiro256PlusPlus::of(self.seed, 94, env as u64), Vec::new());
    }

    fn decide(&mut self, seen: &[PilotInput]) -> Vec<Decision> {
        let mut decisions = self.student.decide(seen);
        for (decision, seen) in decisions.iter_mut().zip(seen) {
            let (random, acted) = &mut self.robots[seen.env];
            let mean = decision.command;
            let action: [f32; COMMAND] = mean.map(|mean| mean + self.deviation * random.normal());
            acted.push(StudentAction { action, mean, deviation: self.deviation, advantage: 0.0 });
            decision.command = action;
        }
        decisions
    }
}
