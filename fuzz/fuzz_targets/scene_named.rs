//! Scenes that a name shows: `.splat`, and a glTF whose files all are the bytes behind a byte 255.
#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_splat::files::{SplatFile, read_named};

fn check(file: &SplatFile) {
    assert_eq!(file.cloud.check(), Ok(()));
    assert!(file.cloud.means.iter().flatten().all(|x| x.is_finite()));
}

fuzz_target!(|data: &[u8]| {
    if let Ok(file) = read_named(data, "a.splat", &mut |_| Err("none".into())) {
        check(&file);
    }
    let split = data.iter().position(|&b| b == 0xff).unwrap_or(data.len());
    let rest = data.get(split + 1..).unwrap_or(&[]);
    if let Ok(file) = read_named(&data[..split], "a.gltf", &mut |_| Ok(rest.to_vec())) {
        check(&file);
    }
});
