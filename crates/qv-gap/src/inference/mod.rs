//! From residuals and their sensitivities to candidates: which effect, where, when, how large, and how sure.

pub(crate) mod ablation;
pub(crate) mod gaussian_evidence;
pub mod intervals;
pub mod joint;
pub mod level;
pub(crate) mod linear_scores;
pub mod local;
pub mod regions;
pub mod relinearise;

pub mod linearised;
pub mod search;
pub mod short_windows;
