//! The simulator proper, written once over [`crate::lanes::Real`]: one block of lanes holds one environment per lane.
//!
//! A step runs the files here in this order: `actuation` and `friction`, `kinematics`, `dynamics`, `collide`, `constraint`, `newton`,
//! `step` (which also integrates). `derive` turns parameters into what these read.

pub(crate) mod actuation;
pub(crate) mod array;
pub(crate) mod block;
pub(crate) mod collide;
pub(crate) mod constraint;
mod cost;
pub(crate) mod derive;
pub(crate) mod dynamics;
pub(crate) mod friction;
pub(crate) mod kinematics;
mod line_search;
pub(crate) mod newton;
pub(crate) mod rows;
mod scratch;
mod start;
pub(crate) mod step;
pub(crate) mod topology;
mod transmission;
pub(crate) mod vector;
pub(crate) mod weights;
