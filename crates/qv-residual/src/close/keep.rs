//! What a caller of the loop keeps of it, and hears of it.

use crate::ResidualError;

/// A stage's result that can be kept, so that a run that was stopped goes on.
pub trait Keep {
    /// What was kept under a name.
    fn get(&self, name: &str) -> Option<String>;
    /// Keeps a text.
    ///
    /// # Errors
    /// When it cannot be written.
    fn put(&self, name: &str, text: &str) -> Result<(), ResidualError>;
}

/// Keeps nothing.
pub struct Forget;

impl Keep for Forget {
    fn get(&self, _name: &str) -> Option<String> {
        None
    }
    fn put(&self, _name: &str, _text: &str) -> Result<(), ResidualError> {
        Ok(())
    }
}

/// What a caller hears while it goes.
pub enum Event<'a> {
    /// A stage begins: its name, number and how many there are at most.
    Stage(&'a str, usize, usize),
    /// Share of a stage that is done, and a figure.
    Progress(f64, String),
}
