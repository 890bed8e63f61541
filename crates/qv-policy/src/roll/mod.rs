//! Someone's policy rolled out on a robot in the simulator: a [`Description`] says what it sees and what its actions
//! mean, [`roll`] runs it.

mod description;
mod error;
mod observe;
mod run;

pub use description::{
    ClockForm, Description, History, HistoryLayout, HistoryOrder, HistoryStart, Numbers, Observation, Simulation, Term,
    TermKind,
};
pub use error::RollError;
pub use observe::{Observer, Seen};
pub use run::{Rolled, roll};
