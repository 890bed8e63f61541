#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_recording::schema::Schema;

fuzz_target!(|data: &[u8]| {
    if let Ok(schema) = Schema::parse("p/T", &String::from_utf8_lossy(data)) {
        assert!(!schema.types.is_empty());
    }
});
