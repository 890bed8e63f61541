//! A definition, a zero byte, and a message that is decoded by it.
#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_recording::plan::{Plan, Wanted};
use qv_recording::cdr;

use qv_recording::schema::Schema;

fuzz_target!(|data: &[u8]| {
    let split = data.iter().position(|&b| b == 0).unwrap_or(data.len());
    let (text, message) = (String::from_utf8_lossy(&data[..split]), data.get(split + 1..).unwrap_or(&[]));
    let Ok(schema) = Schema::parse("p/T", &text) else { return };
    let tree = cdr::decode(&schema, message);
    if let Ok(plan) = Plan::compile(&schema, &[Wanted { path: "a".into(), elements: vec![0] }]) {
        let read = plan.read(message, &mut [0.0]);
        assert!(tree.is_err() || read.is_ok() || format!("{}", read.unwrap_err()).contains("at least"));
    }
});
