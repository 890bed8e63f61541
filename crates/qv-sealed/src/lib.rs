//! Recordings of a simulated Go2 whose departure from its model is known to whoever made them and to nobody else: for
//! judging a diagnosis.
//!
//! A [`Recipe`] says all about one recording: the engine (our own with other numerics, or the second one), a motion of
//! several sections, gains, small differences that nobody names, sensor noise, and the named effects ([`Cause`]) or one
//! effect that no library has ([`Withheld`]). [`make`] draws recipes from a seed until the robot stays on its feet and
//! does what makes the effect act. The same seed gives the same bytes.

mod draw;
mod effects;
mod engine;
pub mod mistakes;
mod mixed;
mod plant;
mod recipe;
mod record;
mod scout;
mod sections;
mod withheld;

pub use draw::{ATTEMPTS, DrawnRecipe, EngineChoice, FaultRequest, Rejection, Request, ValidRecording, make, redraw};
pub use effects::{Cause, EFFECTS, Figure, Region, confusable_group, interface, needs_our_engine};
pub use engine::Engine;
pub use mixed::{GRIPPY, MixedGround, MixedRequest, SLIPPERY, make_mixed, redraw_mixed};
pub use recipe::Recipe;
pub use record::{Outcome, record};
pub use sections::{Motion, Plan, SETTLING, Section};
pub use withheld::{WITHHELD, Withheld};
