//! Three rivals of the diagnosis, on the same windows of the same recordings: one effect at a time, all parameters by CMA-ES,
//! and a network of residual torques. They are for judging the diagnosis, not for users.
//!
//! None knows the null or what else any robot has; how far they close the gap is measured by the diagnosis' own yardstick, in
//! windows that none of them saw. Errors are those of `qv-gap`.

mod all_parameters;
mod cma_es;
mod network;
mod one_at_a_time;
mod plain;
mod residual_network;

use plain::Plain;
use qv_gap::inference::linearised::LinearisedProblem;
use qv_gap::problem::columns::{Columns, Suspect};
use qv_gap::problem::{data_quality, rollout_of};
use qv_gap::{GapError, Options, Progress};
use qv_recording::Run;
use qv_sim::{Model, Terrain};
use serde::Serialize;

/// Steps that CMA-ES simulates unless told otherwise: about those that the diagnosis of a recording takes in all.
pub const CMA_ES_STEPS: usize = 20_000_000;
/// Names that an answer gives at most.
const MOST_CAUSES: usize = 5;

/// The size of an effect along an axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Size {
    /// Effect.
    pub effect: String,
    /// Axis of the library.
    pub name: String,
    /// `all`, or joints, a leg, a link.
    pub scope: Vec<String>,
    /// Value; a deviation from nominal unless the effect is stated as a value of its own.
    pub value: f64,
    /// Unit.
    pub unit: String,
}

/// What one rival says.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Answer {
    /// `explained`, `no_gap`, or `unnamed` of one that names no cause.
    pub verdict: String,
    /// The effect that it names, if it names any.
    pub effect: Option<String>,
    /// Effects by rank, five at most; none where it names none.
    pub causes: Vec<String>,
    /// Sizes of the effect that it names.
    pub sizes: Vec<Size>,
    /// Share of the gap that it closes, 0 to 1, in windows that no fit saw and in units of the null.
    pub closed: f64,
    /// Wall clock \[s\]; 0 when the caller gave no clock.
    pub seconds: f64,
    /// Simulated steps.
    pub steps: usize,
}

impl Answer {
    fn new(verdict: &str, mut causes: Vec<String>, sizes: Vec<Size>, closed: f64) -> Self {
        causes.truncate(MOST_CAUSES);
        let effect = causes.first().cloned();
        Self { verdict: verdict.into(), effect, causes, sizes, closed, seconds: 0.0, steps: 0 }
    }
}

/// What the rivals say: `baselines.json` is this, field by field.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Baselines {
    /// The effect that alone leaves least.
    pub one_at_a_time: Answer,
    /// All parameters at once.
    pub cma_es: Answer,
    /// Residual torques; names no cause.
    pub residual_network: Answer,
}

/// Lets the rivals judge `runs` of one robot on one ground; CMA-ES simulates `cma_es_steps`. Of the options all but the
/// null's effort count as in [`qv_gap::diagnose`]; the seed is that of the effort.
///
/// # Errors
/// When there are no runs, they are not of this model, or they have too little.
pub fn baselines(
    runs: &[Run],
    model: &Model,
    terrain: &Terrain,
    options: &Options,
    cma_es_steps: usize,
) -> Result<Baselines, GapError> {
    if runs.is_empty() {
        let [what, expected, found] = ["runs", "at least one", "none"].map(String::from);
        return Err(GapError::Run { what, expected, found });
    }
    tell(options, 1, "baselines: windows and yardstick");
    let (runs, _) = data_quality::upright(runs);
    let rollout = rollout_of(&runs[0], model, terrain, &options.given, options.cut)?;
    let columns = Columns::new(&rollout, &runs[0], &options.library)?;
    let mut plain = Plain::new(LinearisedProblem::new(rollout, columns, &runs, &options.reference, &options.effort)?);
    let (without, seed) = (&options.without, options.effort.seed);
    let one_at_a_time = timed(&mut plain, options, (2, "baselines: one effect at a time"), |plain| {
        one_at_a_time::answer(plain, without)
    })?;
    let cma_es = timed(&mut plain, options, (3, "baselines: CMA-ES"), |plain| {
        all_parameters::answer(plain, without, cma_es_steps, seed)
    })?;
    let residual_network =
        timed(&mut plain, options, (4, "baselines: residual network"), |plain| residual_network::answer(plain, seed))?;
    Ok(Baselines { one_at_a_time, cma_es, residual_network })
}

/// What is answered after another, and the windows before that.
const STAGES: usize = 4;

fn tell(options: &Options, stage: usize, name: &str) {
    if let Some(progress) = options.progress {
        progress(&Progress { stage, stages: STAGES, name, done: (stage - 1) as f64 / STAGES as f64 });
    }
}

/// An answer with what it took.
fn timed<'a>(
    plain: &mut Plain<'a>,
    options: &Options,
    (stage, name): (usize, &str),
    work: impl FnOnce(&mut Plain<'a>) -> Result<Answer, GapError>,
) -> Result<Answer, GapError> {
    tell(options, stage, name);
    let now = || options.clock.map_or(0.0, |clock| clock());
    let (since, steps) = (now(), plain.study.steps());
    let mut answer = work(plain)?;
    answer.seconds = now() - since;
    answer.steps = plain.study.steps() - steps;
    Ok(answer)
}

/// Sizes of a suspect by axis.
fn sizes(columns: &Columns, suspect: &Suspect) -> Vec<Size> {
    let group = &columns.groups[suspect.group];
    let effect = &columns.effects[group.effect];
    let one = |(axis, value): (&qv_gap::problem::library::Axis, &f64)| Size {
        effect: effect.name.clone(),
        name: axis.name.clone(),
        scope: group.names.clone(),
        value: *value,
        unit: effect.unit.clone(),
    };
    effect.axes.iter().zip(&suspect.values).map(one).collect()
}
