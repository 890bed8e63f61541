//! Policies compared where no training has been.

use super::{Inputs, PathPair};
use crate::ResidualError;
use crate::compensation::Compensation;
use crate::paths::{PathScore, commands, walk};
use crate::tune::{Corrected, SECONDS, judge_of};
use qv_policy::policy::Policy;

/// Walks in the simulator that no training has seen.
pub(super) struct Scored {
    task: qv_policy::velocity::VelocityTask,
    nominal: qv_policy::velocity::VelocityTask,
    commands: Vec<[f32; 3]>,
    seed: u64,
}

/// Makes the commands of scores others than those of the choice of iterations.
const SCORING: u64 = 0x5c0e;

/// Makes the commands of what is told others than those of the choice of policies.
const AGAIN: u64 = 0xa9a1;

impl Scored {
    pub fn new(inputs: &Inputs, judging: &Compensation) -> Result<Self, ResidualError> {
        let (robot, task, walks) = (inputs.robot, &inputs.start.settings.task, inputs.settings.walks);
        let seed = inputs.settings.tune.seed ^ SCORING;
        Ok(Self {
            task: judge_of(robot, inputs.train_on, task, &judging.corrected(robot, task.substeps)?, walks)?,
            nominal: judge_of(robot, inputs.train_on, task, &Corrected::nominal(), walks)?,
            commands: commands(&task.commands, walks, seed),
            seed,
        })
    }

    /// The same simulators with other walks.
    pub fn again(&self, inputs: &Inputs, judging: &Compensation) -> Result<Self, ResidualError> {
        let mut other = Self::new(inputs, judging)?;
        other.seed ^= AGAIN;
        other.commands = commands(&inputs.start.settings.task.commands, inputs.settings.walks, other.seed);
        Ok(other)
    }

    pub fn score(&mut self, policy: &Policy) -> Result<PathScore, ResidualError> {
        crate::tune::score(policy, &mut self.task, &self.commands, self.seed)
    }

    /// One walk of each kind of command.
    pub fn pairs(&mut self, before: &Policy, after: &Policy) -> Result<Vec<PathPair>, ResidualError> {
        let old = walk(before, &mut self.task, &self.commands, SECONDS, self.seed)?;
        let new = walk(after, &mut self.task, &self.commands, SECONDS, self.seed)?;
        let promised = walk(before, &mut self.nominal, &self.commands, SECONDS, self.seed)?;
        let kinds = crate::paths::KINDS.len();
        let pair = |k: usize| PathPair {
            command: self.commands[k],
            before: old[k].0.clone(),
            after: new[k].0.clone(),
            promised: promised[k].0.clone(),
        };
        Ok((0..kinds.min(self.commands.len())).map(pair).collect())
    }
}
