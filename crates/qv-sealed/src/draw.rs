//! Recipes drawn until one of them is a valid recording.

use crate::effects::{Cause, EFFECTS, needs_our_engine};
use crate::engine::Engine;
use crate::recipe::{self, Recipe};
use crate::record::{Outcome, record, scout};
use crate::sections::{Motion, Plan};
use crate::withheld::{WITHHELD, Withheld};
use qv_core::Mismatch;
use qv_core::random::{SplitMix64, sub_seed};
use qv_go2::synthetic::{Deviations, Message};
use qv_recording::RecordingError;

/// Draws after which [`make`] gives up.
pub const ATTEMPTS: u64 = 60;

/// Time that loaded feet must spend in a region, summed over feet, for it to act \[s\].
const LEAST_IN_REGION: f64 = 0.5;

/// Which engine to record with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EngineChoice {
    /// qv-sim, with other numerics.
    Ours,
    /// The second engine, but for effects that it hardly shows.
    Second,
}

/// What shall be wrong with the robot.
#[derive(Debug, Clone, PartialEq)]
pub enum FaultRequest {
    /// No more than small differences that nobody names.
    Nothing,
    /// These effects at once, names out of [`EFFECTS`].
    Effects(Vec<String>),
    /// An effect that no library has, a name out of [`WITHHELD`].
    Withheld(String),
}

/// What to record.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// With which engine.
    pub engine: EngineChoice,
    /// Of which robot.
    pub wanted: FaultRequest,
    /// What it does.
    pub motion: Motion,
    /// Whether sizes of effects go down to what cannot be seen: a tenth of those drawn, at least, log-uniformly.
    pub down_to_unseen: bool,
}

impl Request {
    /// Of a robot that does everything in turn, with sizes that can be seen.
    pub fn mixed(engine: EngineChoice, wanted: FaultRequest) -> Self {
        Self { engine, wanted, motion: Motion::Mixed, down_to_unseen: false }
    }
}

/// Why a draw was no valid recording.
#[derive(Debug, Clone, PartialEq)]
pub enum Rejection {
    /// The robot falls even without the effect.
    FallsAnyway,
    /// The motion does not bring the effect out.
    DoesNotAct,
    /// The robot fell at this time \[s\].
    Fell(f64),
}

/// A valid recording.
#[derive(Debug, Clone, PartialEq)]
pub struct ValidRecording {
    /// What it is.
    pub drawn: DrawnRecipe,
    /// Why the draws before it were not taken.
    pub rejected: Vec<Rejection>,
    /// The messages, in the order of their times.
    pub messages: Vec<Message>,
}

/// A recipe as it was drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnRecipe {
    /// What it is.
    pub recipe: Recipe,
    /// Why another engine was taken than asked for.
    pub other_engine: Option<String>,
}

/// Draws recipes from sub-seeds of `seed` until the robot stays on its feet and its effects act.
///
/// # Errors
/// When a name is unknown, the second engine is asked for and not built in, or no draw of [`ATTEMPTS`] was valid.
pub fn make(request: &Request, seed: u64) -> Result<ValidRecording, RecordingError> {
    check(&request.wanted)?;
    let mut rejected = Vec::new();
    for attempt in 0..ATTEMPTS {
        let drawn = match draw(request, sub_seed(seed, attempt))? {
            Ok(drawn) => drawn,
            Err(reason) => {
                rejected.push(reason);
                continue;
            }
        };
        let confined = drawn.recipe.causes.iter().any(|cause| cause.region.is_some());
        match record(&drawn.recipe)? {
            (Outcome::Fell { at }, _) => rejected.push(Rejection::Fell(at)),
            (Outcome::Stood { in_region, .. }, _) if confined && in_region < LEAST_IN_REGION => {
                rejected.push(Rejection::DoesNotAct);
            }
            (Outcome::Stood { .. }, messages) => return Ok(ValidRecording { drawn, rejected, messages }),
        }
    }
    let what = format!("recording of {:?} from seed {seed}", request.wanted);
    Err(Mismatch::new(what, format!("a valid draw among {ATTEMPTS}"), format!("none: {rejected:?}")).into())
}

/// The recipe that [`make`] took after `redraws` rejections, without recording it again.
///
/// # Errors
/// When a name is unknown, or this draw cannot have been the one taken.
pub fn redraw(request: &Request, seed: u64, redraws: u64) -> Result<DrawnRecipe, RecordingError> {
    check(&request.wanted)?;
    draw(request, sub_seed(seed, redraws))?.map_err(|reason| {
        let what = format!("draw {redraws} of {:?} from seed {seed}", request.wanted);
        Mismatch::new(what, "the one that was recorded", format!("one that was rejected: {reason:?}")).into()
    })
}

fn check(wanted: &FaultRequest) -> Result<(), RecordingError> {
    let unknown = |name: &str, known: &[&str]| {
        Err(Mismatch::new("effect of a recording", format!("one of {}", known.join(", ")), name).into())
    };
    match wanted {
        FaultRequest::Nothing => Ok(()),
        FaultRequest::Effects(names) => match names.iter().find(|name| !EFFECTS.contains(&name.as_str())) {
            Some(name) => unknown(name, &EFFECTS),
            None => Ok(()),
        },
        FaultRequest::Withheld(name) if !WITHHELD.contains(&name.as_str()) => unknown(name, &WITHHELD),
        FaultRequest::Withheld(_) => Ok(()),
    }
}

/// One recipe, or why there is none from this seed.
fn draw(request: &Request, seed: u64) -> Result<Result<DrawnRecipe, Rejection>, RecordingError> {
    let mut draws = SplitMix64::new(seed);
    let (engine, other_engine) = engine(request, &mut draws);
    let mut recipe = Recipe {
        seed: sub_seed(seed, 1),
        engine,
        plan: Plan::of(request.motion, &mut draws),
        kp: draws.between(25.0, 60.0),
        kd: draws.between(0.8, 2.0),
        differences: recipe::small_differences(sub_seed(seed, 2)),
        deviations: Deviations::drawn(&mut draws, 0.5, 1.5),
        causes: Vec::new(),
        withheld: None,
        ground: None,
    };
    let Some(scout) = scout(&recipe)? else { return Ok(Err(Rejection::FallsAnyway)) };
    match &request.wanted {
        FaultRequest::Nothing => {}
        FaultRequest::Effects(names) => {
            for name in names {
                match Cause::drawn(name, &mut draws, &scout, recipe.plan.walking()) {
                    Some(cause) if request.down_to_unseen => {
                        recipe.causes.push(cause.scaled(10f64.powf(-draws.uniform())));
                    }
                    Some(cause) => recipe.causes.push(cause),
                    None => return Ok(Err(Rejection::DoesNotAct)),
                }
            }
        }
        FaultRequest::Withheld(name) => match Withheld::drawn(name, &mut draws, &scout) {
            Some(effect) => recipe.withheld = Some(effect),
            None => return Ok(Err(Rejection::DoesNotAct)),
        },
    }
    Ok(Ok(DrawnRecipe { recipe, other_engine }))
}

fn engine(request: &Request, draws: &mut SplitMix64) -> (Engine, Option<String>) {
    let unseen = match &request.wanted {
        FaultRequest::Effects(names) => names.iter().find(|name| needs_our_engine(name)),
        _ => None,
    };
    match (request.engine, unseen) {
        (EngineChoice::Second, Some(name)) => {
            (Engine::ours(draws), Some(format!("the second engine hardly shows {name}")))
        }
        (EngineChoice::Second, None) => (Engine::second(draws), None),
        (EngineChoice::Ours, _) => {
            let engine = Engine::ours(draws);
            // Outside torques follow the motion step by step, and need short steps for that.
            let stepwise = matches!(request.wanted, FaultRequest::Withheld(_));
            (if stepwise { engine.with_short_steps() } else { engine }, None)
        }
    }
}
