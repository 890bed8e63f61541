//! What `qv` writes: the one place that decides which files a command owns, replaces and removes.
//!
//! A command with `--out DIR` owns what it wrote into that folder before, and nothing else: a manifest in the folder lists each file with its
//! hash ([`manifest`]). Results are written beside their places and put there together when the command ends ([`folder`]). A file that the
//! manifest does not know, or that somebody changed, is renamed and not replaced. What a command reads is never written over ([`inputs`]).

mod file;
mod folder;
mod inputs;
mod manifest;
mod paths;

pub use file::{put, stream, write_whole};
pub use folder::{OutputFolder, abandon, claim, clear, commit, keep_what_is_claimed, make_folder, remove, staged};
pub use inputs::{innermost, refuse, refuse_inputs, targets};
pub use manifest::{FILE as MANIFEST, open_plain};
pub use paths::is_same;
