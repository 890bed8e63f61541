#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_recording::{BagFile, read_bag};

fuzz_target!(|data: &[u8]| {
    // The magic is given, so that the time goes into what follows it.
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    bytes.extend_from_slice(data);
    let file = BagFile { name: "fuzz".into(), source: bytes.as_slice() };
    if let Ok(run) = read_bag([file], &qv_go2::wire::mapping(None)) {
        let position = run.measured.position.expect("a run has positions");
        assert!(position.time.windows(2).all(|w| w[1] > w[0]));
        assert!(!position.values.iter().any(|x| x.is_infinite()));
    }
});
