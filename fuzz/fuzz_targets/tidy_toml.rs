#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_recording::read_table;
use qv_rollout::parameters_from_toml;

fuzz_target!(|data: &[u8]| {
    let text = String::from_utf8_lossy(data);
    let csv = b"time,pos.a,cmd_pos.a\n0,0.1,0.2\n0.01,0.1,0.2\n";
    if let Ok(run) = read_table(&csv[..], &text, None, None) {
        assert_eq!(run.joint_names, ["a"]);
    }
    let _ = parameters_from_toml(&text);
});
