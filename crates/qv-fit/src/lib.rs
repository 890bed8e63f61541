//! Least squares of what is simulated: bounds, priors, one robust loss, many points side by side, and intervals that hold for what correlates.
//!
//! A [`Problem`] is plain data. [`fit`] asks the caller for the residuals of many points at once, so that the columns of the Jacobian and all
//! trials of a step are simulated together. Residuals come in blocks, such as windows of a recording: a block is what the robust loss weighs,
//! what may run away without the others, and what is independent of the others in [`Slopes::sandwich`].

mod error;
mod least_squares;
pub mod linear;
mod problem;
mod scatter;
mod slopes;

pub use error::FitError;
pub use least_squares::{Fit, Options, StopReason, fit};
pub use linear::{Cholesky, Matrix};
pub use problem::{Blocks, Differences, Evaluate, Loss, Problem};
pub use scatter::Scatter;
pub use slopes::{Slopes, slopes};
