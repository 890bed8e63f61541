//! The bytes, cut at bytes 255, are the texts of an RGB-D folder of each layout.
#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_splat::captures::json;
use qv_splat::captures::rgbd_folders::{Folder, Layout, read};
use std::collections::BTreeSet;

const TEXTS: [(Layout, [&str; 3]); 3] = [
    (Layout::Tum, ["rgb.txt", "groundtruth.txt", "depth.txt"]),
    (Layout::Redwood, ["trajectory.log", "camera_intrinsic.json", "camera-intrinsics.txt"]),
    (Layout::ScanNet, ["pose/0.txt", "intrinsic/intrinsic_color.txt", "intrinsic/intrinsic_depth.txt"]),
];

fuzz_target!(|data: &[u8]| {
    let _ = json::parse(data, "fuzz");
    let parts: Vec<String> =
        data.split(|&b| b == 0xff).map(|part| String::from_utf8_lossy(part).into_owned()).collect();
    for (layout, texts) in TEXTS {
        let mut names: BTreeSet<String> = ["color/0.jpg", "depth/0.png"].map(String::from).into();
        // A part that is empty is a file that is not there.
        let there = texts.iter().zip(&parts).filter(|(_, text)| !text.is_empty());
        names.extend(there.map(|(name, _)| (*name).to_string()));
        let mut text = |name: &str| {
            let at = texts.iter().position(|known| *known == name).unwrap_or(0);
            Ok(parts.get(at).cloned().unwrap_or_default())
        };
        let mut folder = Folder { names: &names, text: &mut text, sizes: &mut |_| Ok([640, 480]) };
        if let Ok(capture) = read(layout, &mut folder) {
            capture.cameras.iter().for_each(|one| assert_eq!(one.camera.check(), Ok(())));
        }
    }
});
