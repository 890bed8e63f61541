//! Policies compared where no training has been.

use super::inputs::Inputs;
use super::report::PathPair;
use crate::ResidualError;
use crate::compensation::Compensation;
use crate::paths::{PathScore, SECONDS, commands, walk};
use crate::tune::{CorrectedSimulator, judge_of, score};
use qv_policy::policy::Policy;

/// Walks in the simulator that no training has seen.
pub(super) struct ScoredWalks {
    task: qv_policy::velocity::VelocityTask,
    nominal: qv_policy::velocity::VelocityTask,
    choosing: Walks,
    reporting: Walks,
}

/// Commands of walks, and the seed of what else differs in them.
struct Walks {
    commands: Vec<[f32; 3]>,
    seed: u64,
}

/// Makes the commands of scores others than those of the choice of iterations.
const SCORING: u64 = 0x5c0e;

/// Makes the commands of what is reported others than those of the choice of policies.
const TELLING: u64 = 0xa9a1;

impl ScoredWalks {
    pub fn new(inputs: &Inputs, judging: &Compensation) -> Result<Self, ResidualError> {
        let (robot, task, walks) = (inputs.robot, &inputs.start.settings.task, inputs.settings.walks);
        let seed = inputs.settings.tune.seed ^ SCORING;
        let of = |seed| Walks { commands: commands(&task.commands, walks, seed), seed };
        Ok(Self {
            task: judge_of(robot, inputs.train_on, task, &judging.corrected(robot), walks)?,
            nominal: judge_of(robot, inputs.train_on, task, &CorrectedSimulator::nominal(), walks)?,
            choosing: of(seed),
            reporting: of(seed ^ TELLING),
        })
    }

    /// A score to choose a policy by.
    pub fn score(&mut self, policy: &Policy) -> Result<PathScore, ResidualError> {
        score(policy, &mut self.task, &self.choosing.commands, self.choosing.seed)
    }

    /// A score to show: the best of several is so by chance, too, and these walks did not choose it.
    pub fn remarks(&mut self, policy: &Policy) -> Result<PathScore, ResidualError> {
        score(policy, &mut self.task, &self.reporting.commands, self.reporting.seed)
    }

    /// One walk of each kind of command.
    pub fn pairs(&mut self, before: &Policy, after: &Policy) -> Result<Vec<PathPair>, ResidualError> {
        let Walks { commands, seed } = &self.choosing;
        let old = walk(before, &mut self.task, commands, SECONDS, *seed)?;
        let new = walk(after, &mut self.task, commands, SECONDS, *seed)?;
        let promised = walk(before, &mut self.nominal, commands, SECONDS, *seed)?;
        let kinds = crate::paths::KINDS.len();
        let pair = |k: usize| PathPair {
            command: commands[k],
            before: old[k].0.clone(),
            after: new[k].0.clone(),
            promised: promised[k].0.clone(),
        };
        Ok((0..kinds.min(commands.len())).map(pair).collect())
    }
}
