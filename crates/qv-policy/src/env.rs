//! What a learner asks of a task: many environments at once, flat arrays, no allocation.

use crate::PolicyError;
use crate::symmetry::Symmetry;

/// How a step ended for one environment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum End {
    /// It goes on.
    #[default]
    No,
    /// The robot failed: nothing is to be gained after.
    Failed,
    /// Its time is over, though it could have gone on: what it would have gained counts.
    TimeOut,
}

/// Many environments of one task, stepped together.
pub trait VectorEnv {
    /// Number of environments.
    fn count(&self) -> usize;
    /// Numbers that the policy sees of one environment.
    fn observations(&self) -> usize;
    /// Numbers that only the critic sees, the observation without noise among them.
    fn privileged(&self) -> usize;
    /// Numbers that the policy decides.
    fn actions(&self) -> usize;
    /// Offset and scale that bring observations to the size of one: `(x - offset) * scale`; `[observations]` each.
    fn observation_scaling(&self) -> (Vec<f32>, Vec<f32>);
    /// The same for what the critic sees; `[privileged]` each.
    fn privileged_scaling(&self) -> (Vec<f32>, Vec<f32>);
    /// Fills `[count][observations]` and `[count][privileged]` with the present state, unscaled.
    fn observe(&mut self, observations: &mut [f32], privileged: &mut [f32]);
    /// One step under `actions`, `[count][actions]`; writes the rewards and ends of all, and resets nobody.
    ///
    /// # Errors
    /// When an action or a term of the reward is not finite; it is named.
    fn step(&mut self, actions: &[f32], rewards: &mut [f32], ends: &mut [End]) -> Result<(), PolicyError>;
    /// Begins anew where `mask` is true.
    ///
    /// # Errors
    /// When the simulator refuses the new state.
    fn reset(&mut self, mask: &[bool]) -> Result<(), PolicyError>;
    /// Begins all episodes anew, with random numbers that depend on `seed` and `epoch` alone and ages drawn at random: checkpoints
    /// are taken here, so that a training that is taken up again has the same bits.
    ///
    /// # Errors
    /// When the simulator refuses the new state.
    fn restart(&mut self, seed: u64, epoch: u64) -> Result<(), PolicyError>;
    /// Mirror images of the unscaled numbers, where the robot is its own mirror image; offsets of the scaling are, too.
    fn symmetry(&self) -> Option<Symmetry> {
        None
    }
    /// What is worth watching since the last call, by name: means over environments and steps.
    fn figures(&mut self) -> Vec<(&'static str, f32)>;
    /// Numbers of the curriculum, which a checkpoint keeps.
    fn curriculum(&self) -> Vec<f32> {
        Vec::new()
    }
    /// Sets what [`VectorEnv::curriculum`] reported.
    fn set_curriculum(&mut self, _numbers: &[f32]) {}
}
