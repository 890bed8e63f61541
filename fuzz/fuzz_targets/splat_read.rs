#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_splat::files::{Format, read_any, write};

fuzz_target!(|data: &[u8]| {
    let Ok(file) = read_any(data) else { return };
    assert_eq!(file.cloud.check(), Ok(()));
    // What was read is good, so that it can be written without loss as PLY; the others may find it too large.
    let ply = write(&file.cloud, Format::Ply).expect("only good Gaussians are read");
    assert_eq!(read_any(&ply).expect("our own file is good").cloud, file.cloud);
    for format in [Format::CompressedPly, Format::Spz, Format::Gltf] {
        if let Ok(bytes) = write(&file.cloud, format) {
            let again = read_any(&bytes).expect("our own file is good");
            assert_eq!(again.cloud.len() + again.left_out, file.cloud.len());
        }
    }
});
