//! Walking policies: what a training, a play and a score leave behind.

#[cfg(test)]
mod example;
mod page;
mod recording;

pub use page::page;
pub use recording::write_recording;
