//! COLMAP's sparse models (colmap.github.io, *Output format*, COLMAP 3.x): `cameras` and `images`, as text or binary.
//!
//! Poses are `camera_from_world` with OpenCV's axes; pixel centres lie at one half, as ours do. Points are not read.

pub use super::colmap_cameras::Model;
use super::colmap_cameras::{Intrinsics, PosedImage};
use super::pictures::ImageOrientation;
use super::{Attachments, Capture, CaptureCamera, finish};
use crate::SplatError;
use crate::error::off;
use qv_core::Camera;
use std::collections::BTreeMap;

/// Reads `cameras.txt` and `images.txt`.
///
/// # Errors
/// Names the line that is off, a camera that an image names and that is not there, and models other than those of [`Model`].
pub fn read_text(cameras: &str, images: &str) -> Result<Capture, SplatError> {
    join(super::colmap_text::cameras(cameras)?, super::colmap_text::images(images)?, "images.txt")
}

/// Reads `cameras.bin` and `images.bin`.
///
/// # Errors
/// Names the byte where a file ends early or goes on, and what else [`read_text`] names.
pub fn read_binary(cameras: &[u8], images: &[u8]) -> Result<Capture, SplatError> {
    join(super::colmap_binary::cameras(cameras)?, super::colmap_binary::images(images)?, "images.bin")
}

/// Images with their intrinsics, sorted by name, since COLMAP's own order varies from run to run.
fn join(cameras: BTreeMap<u32, Intrinsics>, mut images: Vec<PosedImage>, place: &str) -> Result<Capture, SplatError> {
    images.sort_by(|a, b| a.name.cmp(&b.name));
    let one = |image: PosedImage| {
        let found = cameras.get(&image.camera);
        let intrinsics = found
            .ok_or_else(|| off(format!("{place}, image {}", image.name), "the number of a camera", image.camera))?;
        let camera = Camera { camera_from_world: image.camera_from_world, ..intrinsics.camera };
        let distortion = intrinsics.distortion;
        let attachments = Attachments::default();
        Ok(CaptureCamera { name: String::new(), camera, distortion, image: Some(image.name), attachments })
    };
    let capture = finish(images.into_iter().map(one).collect::<Result<_, SplatError>>()?, place)?;
    Ok(Capture { shown: ImageOrientation::Stored, ..capture })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    const CAMERAS: &str = "# Camera list\n1 SIMPLE_RADIAL 640 480 500.0 320.0 240.0 0.05\n\
        2 OPENCV 100 80 90.0 91.0 50.0 40.0 0.1 0.2 0.3 0.4\n";
    const IMAGES: &str = "# Image list\n\
        7 1 0 0 0 0.5 0 2 1 b side.jpg\n1.0 2.0 -1 3.0 4.0 5\n3 0.5 0.5 0.5 0.5 0 0 1 2 a.jpg\n\n";

    fn binary() -> [Vec<u8>; 2] {
        let mut cameras = 2u64.to_le_bytes().to_vec();
        for (id, model, size, p) in [
            (1u32, 2u32, [640u64, 480], vec![500.0f64, 320.0, 240.0, 0.05]),
            (2, 4, [100, 80], vec![90.0, 91.0, 50.0, 40.0, 0.1, 0.2, 0.3, 0.4]),
        ] {
            cameras.extend(id.to_le_bytes());
            cameras.extend(model.to_le_bytes());
            size.iter().for_each(|side| cameras.extend(side.to_le_bytes()));
            p.iter().for_each(|x| cameras.extend(x.to_le_bytes()));
        }
        let mut images = 2u64.to_le_bytes().to_vec();
        for (id, pose, camera, name, points) in [
            (7u32, [1.0f64, 0.0, 0.0, 0.0, 0.5, 0.0, 2.0], 1u32, "b side.jpg", 2u64),
            (3, [0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 1.0], 2, "a.jpg", 0),
        ] {
            images.extend(id.to_le_bytes());
            pose.iter().for_each(|x| images.extend(x.to_le_bytes()));
            images.extend(camera.to_le_bytes());
            images.extend(name.as_bytes());
            images.push(0);
            images.extend(points.to_le_bytes());
            images.resize(images.len() + 24 * points as usize, 1);
        }
        [cameras, images]
    }

    #[test]
    fn text_and_binary_are_the_same() {
        let text = read_text(CAMERAS, IMAGES).unwrap();
        let [cameras, images] = binary();
        assert_eq!(read_binary(&cameras, &images).unwrap(), text);
        let [a, b] = &text.cameras[..] else { panic!("{text:?}") };
        assert_eq!((a.name.as_str(), b.name.as_str()), ("a", "b side"));
        assert_eq!((b.camera.fx, b.camera.fy, b.distortion.k1, a.distortion.p2), (500.0, 500.0, 0.05, 0.4));
        assert_eq!(b.camera.camera_from_world.position.to_array(), [0.5, 0.0, 2.0]);
    }

    #[test]
    fn each_fault_is_named() {
        let fault = |cameras: &str, images: &str| read_text(cameras, images).unwrap_err().to_string();
        assert!(fault("1 FOV 1 1 1\n", "").states("FOV"));
        assert!(fault("1 PINHOLE 640 480 500 500 320\n", "").states("numbers 1 4"));
        assert!(fault("1 PINHOLE x 480 500 500 320 240\n", "").states("line 1"));
        assert!(
            fault("1 PINHOLE 0 480 500 500 320 240\n", IMAGES.replace(" 2 a.jpg", " 1 a.jpg").as_str())
                .contains("width")
        );
        assert!(fault(CAMERAS, &IMAGES.replace("2 a.jpg", "9 a.jpg")).states("a.jpg"));
        assert!(fault(CAMERAS, "1 0 0 0 0 0 0 0 1 a\n\n").states("quaternion"));
        let without_points = "1 1 0 0 0 0 0 0 1 a.jpg\n2 1 0 0 0 0 0 0 1 b.jpg\n";
        assert!(fault(CAMERAS, without_points).states("images.txt 2"));
        assert!(fault(CAMERAS, "1 0 0\n\n").states("line 1"));
    }

    #[test]
    fn cut_off_binaries_are_errors() {
        let [cameras, images] = binary();
        for length in 0..cameras.len() {
            assert!(read_binary(&cameras[..length], &images).is_err(), "{length}");
        }
        for length in 0..images.len() {
            assert!(read_binary(&cameras, &images[..length]).is_err(), "{length}");
        }
        let mut more = images.clone();
        more.push(0);
        assert!(read_binary(&cameras, &more).unwrap_err().to_string().states("end"));
        let mut huge = images.clone();
        huge[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        assert!(read_binary(&cameras, &huge).is_err());
    }
}
