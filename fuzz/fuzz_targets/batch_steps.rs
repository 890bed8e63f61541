#![no_main]
use libfuzzer_sys::fuzz_target;

#[path = "../../crates/qv-sim/tests/it/drawn/mod.rs"]
mod drawn;

// Debug assertions, which cargo-fuzz turns on, check each access to the arrays of the engine.
fuzz_target!(|data: &[u8]| {
    drawn::step(data);
});
