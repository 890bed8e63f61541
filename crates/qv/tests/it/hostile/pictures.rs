//! Photographs of a kilobyte with more pixels than memory.

use super::bounded;
use crate::bags::directory;
use std::fs;

/// A JPEG of 16 x 8 pixels that says it has 65535 x 65535.
fn vast() -> Vec<u8> {
    let image = image::GrayImage::from_pixel(16, 8, image::Luma([90]));
    let mut out = std::io::Cursor::new(vec![]);
    image.write_to(&mut out, image::ImageFormat::Jpeg).unwrap();
    let mut file = out.into_inner();
    let at = file.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap() + 5;
    file[at..at + 4].fill(0xff);
    file
}

#[test]
fn a_photograph_with_more_pixels_than_its_bytes_can_hold_is_refused() {
    let folder = directory("hostile_jpeg");
    let mut frames = Vec::new();
    for k in 0..10 {
        fs::write(folder.join(format!("{k}.jpg")), vast()).unwrap();
        frames.push(serde_json::json!({"file_path": format!("{k}.jpg"), "transform_matrix":
            [[1, 0, 0, k], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}));
    }
    let cameras = serde_json::json!({"w": 65535, "h": 65535, "fl_x": 9e4, "fl_y": 9e4, "cx": 32767.0, "cy": 32767.0,
        "frames": frames});
    fs::write(folder.join("transforms.json"), cameras.to_string()).unwrap();
    let (out, capture) = (folder.join("out"), folder.to_str().unwrap());
    let arguments = ["reconstruct", capture, "--out", out.to_str().unwrap(), "--iterations", "1"];
    let (code, _, err) = bounded(&arguments);
    assert!(code == 1 && err.contains("65535"), "{err}");
}
