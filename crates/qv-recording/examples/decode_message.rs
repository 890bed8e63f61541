//! Decodes one CDR message by its ROS 2 definition: as a tree, and as the few numbers that are wanted.
//!
//! `cargo run -p quadverse-replay --example decode_message`

use qv_recording::cdr::{Writer, decode};
use qv_recording::plan::{FieldSelection, Plan};
use qv_recording::schema::Schema;

fn main() -> Result<(), qv_recording::RecordingError> {
    let text = "string name\nMotor[] motors\n===\nMSG: demo/Motor\nuint8 mode\nfloat32 q\n";
    let schema = Schema::parse("demo/msg/Robot", text)?;
    let mut writer = Writer::new();
    writer.string("arm").u32(2).u8(1).f32(0.25).u8(1).f32(-0.5);
    let message = writer.finish();

    println!("{:#?}", decode(&schema, &message)?);
    let plan = Plan::compile(&schema, &[FieldSelection { path: "motors[].q".into(), elements: vec![1, 0] }])?;
    let mut q = [0.0; 2];
    plan.read(&message, &mut q)?;
    println!("second and first motor: {q:?} rad");
    Ok(())
}
