//! Diagnosis of robots with a fixed base by the torque balance of whole recordings.
//!
//! A recording becomes equations whose rows are linear in all that a robot may differ in (`balance`, `regressor`). References say how far a robot
//! strays without a cause (`study`): recordings of it, or a fleet of faultless robots within the tolerances, simulated in closed loop with the
//! recording's own controller (`fleet`). Servos without torques are compared by their positions, joint by joint (`servo`, `path`, `source`). Every hypothesis is measured against them (`measure`, `follow`, `pairs`): [`Evidence`] is plain data, and [`decide`] says
//! what comes of it. Source and figures: `docs/theory/diagnosis.md`.

mod balance;
mod decision;
mod distribution;
mod error;
mod events;
mod evidence;
mod fleet;
mod follow;
mod gram;
mod hypothesis;
mod measure;
mod pairs;
mod path;
mod profile;
mod regressor;
mod request;
mod servo;
mod signal;
mod slices;
mod source;
mod study;
mod table;
mod traces;

pub use decision::{Decision, Judgement, Outcome, POWER, PairJudgement, Policy, decide};
pub use error::HeldError;
pub use evidence::{Change, Event, Evidence, HypothesisTest, JointRow, PairTest, Square, TorqueTrace};
pub use hypothesis::{Axis, Family, Hypothesis, Tolerances};
pub use measure::{can_measure, joint_table, measure};
pub use request::Request;
