//! A text is cameras in JSON and, cut at a byte 255, COLMAP's two files, as text and as binary.
#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_splat::captures::{Capture, cameras_json, colmap, nerfstudio};
use qv_splat::lens::Distorter;

fn check(capture: &Capture) {
    for one in &capture.cameras {
        assert_eq!(one.camera.check(), Ok(()));
        if let Ok(distorter) = Distorter::new(&one.camera, &one.distortion) {
            assert_eq!(distorter.pinhole.check(), Ok(()));
        }
    }
    let again = cameras_json::read(&cameras_json::write(capture)).expect("our own file is good");
    assert_eq!(again.cameras.len(), capture.cameras.len());
}

fuzz_target!(|data: &[u8]| {
    let text = String::from_utf8_lossy(data);
    let found = [nerfstudio::read(&text), cameras_json::read(&text)];
    found.iter().flatten().for_each(check);
    let split = data.iter().position(|&b| b == 0xff).unwrap_or(data.len());
    let (first, second) = (&data[..split], data.get(split + 1..).unwrap_or(&[]));
    if let Ok(capture) = colmap::read_text(&String::from_utf8_lossy(first), &String::from_utf8_lossy(second)) {
        check(&capture);
    }
    if let Ok(capture) = colmap::read_binary(first, second) {
        check(&capture);
    }
});
