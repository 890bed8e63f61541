#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_recording::read_table;

fuzz_target!(|data: &[u8]| {
    if let Ok(run) = read_table(data, "robot = \"x\"", None, None) {
        let position = run.measured.position.expect("a run has positions");
        assert!(position.time.windows(2).all(|w| w[1] > w[0]));
        assert!(!position.values.iter().any(|x| x.is_infinite()));
    }
});
