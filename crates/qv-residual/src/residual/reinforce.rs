//! The paper's compensator: a residual of joint targets learnt by PPO on replayed recordings, with a critic that sees the recording.

use super::replay_env::ReplayEnv;
use super::{NetKind, ResidualNet, UNIT};
use crate::ResidualError;
use crate::windows::{Lane, Replayer, Window};
use qv_policy::env::VectorEnv;
use qv_policy::ppo::{Iteration, Ppo, PpoSettings};
use serde::{Deserialize, Serialize};

/// How a net is reinforced.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReinforceSettings {
    /// Iterations.
    pub iterations: u64,
    /// Robots at once.
    pub robots: usize,
    /// Standard deviation of corrections at the start \[rad\].
    pub std: f32,
    /// Least standard deviation \[rad\].
    pub least_std: f32,
    /// Largest correction \[rad\].
    pub clip: f32,
    /// The learner; its standard deviations are set from those above.
    pub ppo: PpoSettings,
    /// Seed.
    pub seed: u64,
}

impl Default for ReinforceSettings {
    fn default() -> Self {
        let ppo = PpoSettings {
            steps: 24,
            gamma: 0.95,
            entropy: 0.001,
            actor: vec![128, 128],
            critic: vec![128, 128],
            ..PpoSettings::default()
        };
        Self { iterations: 240, robots: 512, std: 0.04, least_std: 0.01, clip: 0.3, ppo, seed: 0 }
    }
}

/// What an iteration did, with its figures of the replay.
#[derive(Debug, Clone, Serialize)]
pub struct ReinforceIteration {
    /// The learner's.
    pub iteration: Iteration,
    /// Root mean square of joint errors, mean over robots \[rad\]; of corrections \[rad\]; share of steps that lost a robot.
    pub figures: Vec<(&'static str, f32)>,
}

/// Trains a net of positions on windows of a log, on top of a lane's parameters and biases; from scratch, or from a net of the same sizes.
///
/// # Errors
/// When a setting means nothing, `start` does not fit, no window has room for an episode, or a number is not finite.
pub fn train(
    replayer: &Replayer,
    windows: &[Window],
    lane: &Lane,
    start: Option<&ResidualNet>,
    settings: &ReinforceSettings,
    mut notify: impl FnMut(&ReinforceIteration),
) -> Result<ResidualNet, ResidualError> {
    if !(settings.clip > 0.0 && settings.clip <= 10.0) {
        return Err(ResidualError::input("clip", "more than 0, at most 10 rad", settings.clip));
    }
    let mut env = ReplayEnv::new(replayer, windows, lane, settings.clip, settings.robots)?;
    let ppo = PpoSettings { std: settings.std / UNIT, least_std: settings.least_std / UNIT, ..settings.ppo.clone() };
    let mut ppo = Ppo::new(&ppo, &env, settings.seed)?;
    if let Some(start) = start {
        start.check(replayer.robot, NetKind::Position)?;
        let (net, parameters) = start.layers();
        if net != ppo.actor {
            let sizes = |net: &qv_policy::net::Mlp| net.layers.iter().map(|l| l.inputs).collect::<Vec<_>>();
            let expected = format!("layers of {:?} inputs", sizes(&ppo.actor));
            return Err(ResidualError::input("net to start from", expected, format!("{:?}", sizes(&net))));
        }
        ppo.parameters[..parameters.len()].copy_from_slice(&parameters);
    }
    env.restart(settings.seed, 0)?;
    ppo.reseed(settings.seed, 0, settings.robots);
    // The mean of the last quarter's weights strays less than the last (Polyak and Juditsky 1992).
    let last = (settings.iterations / 4).max(1);
    let mut mean = ppo.parameters[..ppo.actor.len()].to_vec();
    while ppo.iterations < settings.iterations {
        let iteration = ppo.iterate(&mut env)?;
        let kept = (ppo.iterations + last).saturating_sub(settings.iterations).max(1);
        let share = 1.0 / kept as f32;
        mean.iter_mut().zip(&ppo.parameters).for_each(|(mean, x)| *mean += share * (x - *mean));
        notify(&ReinforceIteration { iteration, figures: env.figures() });
    }
    Ok(env.net(&ppo.actor, &mean))
}
