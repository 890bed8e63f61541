//! Replays of recordings whose truth is known.

mod effects;
mod mistaken;
