//! Writes a state of the Go2 as its wire has it, and reads it back through the mapping's field paths.
//!
//! `cargo run -p quadverse-go2 --example write_bag_message`

use qv_go2::messages::{LOW_STATE, LOW_STATE_TYPE, LowState, encode_low_state};
use qv_go2::{model, wire};
use qv_recording::plan::{FieldSelection, Plan};
use qv_recording::schema::Schema;

fn main() -> Result<(), qv_recording::RecordingError> {
    let message = encode_low_state(&LowState { q: model::STAND, ..Default::default() });
    let schema = Schema::parse(LOW_STATE_TYPE, LOW_STATE)?;
    let plan =
        Plan::compile(&schema, &[FieldSelection { path: "motor_state[].q".into(), elements: wire::motor_on_wire() }])?;
    let mut q = [0.0; 12];
    plan.read(&message, &mut q)?;
    for (name, q) in wire::joint_names().iter().zip(q) {
        println!("{name:<16} {q:7.4} rad");
    }
    Ok(())
}
