//! What stands between a policy and the simulator so that both together move as the robot does.

/// The robots as a compensator sees them: what a simulator has, and no recording.
#[derive(Debug, Clone, Copy)]
pub struct SimulatedStates<'a> {
    /// Positions `[count][7 + joints]`: base in the world \[m\], quaternion w, x, y, z, joint angles \[rad\].
    pub q: &'a [f32],
    /// Velocities `[count][6 + joints]`: base in the world \[m/s\], in its own axes \[rad/s\], joint speeds \[rad/s\].
    pub v: &'a [f32],
    /// Torques that the motors delivered in the last physics step `[count][joints]` \[N m\].
    pub torques: &'a [f32],
    /// Forces of the ground on all shapes in the world `[count][shapes][3]` \[N\], of the last decision.
    pub forces: &'a [f32],
    /// Joint targets in force `[count][joints]` \[rad\].
    pub targets: &'a [f32],
}

/// Corrects what a simulator gets wrong beside its parameters. Environments are independent of each other, and of threads.
pub trait Compensator: Send + Sync {
    /// An environment begins anew: its past is forgotten.
    fn begin(&mut self, env: usize);
    /// Before each decision's physics: moves the targets that are sent, `[count][joints]` \[rad\]; `sent` holds the policy's.
    fn move_targets(&mut self, seen: &SimulatedStates, sent: &mut [f32]);
    /// Whether [`Compensator::add_torques`] does anything: physics is slower with it.
    fn adds_torques(&self) -> bool {
        false
    }
    /// Before each physics step: torques added behind the motors' latency and lag, `[count][joints]` \[N m\]; all are to be written.
    fn add_torques(&mut self, _seen: &SimulatedStates, added: &mut [f32]) {
        added.fill(0.0);
    }
    /// The same for so many environments, none of which has a past.
    fn for_count(&self, count: usize) -> Box<dyn Compensator>;
}
