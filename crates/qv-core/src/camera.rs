//! Pinhole cameras.

use crate::{CoreError, Pose};

/// A pinhole camera without distortion, with OpenCV's axes: x right, y down, z forward. Pixel (i, j) has its centre at
/// (i + 0.5, j + 0.5) pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Focal length along x \[px\].
    pub fx: f64,
    /// Focal length along y \[px\].
    pub fy: f64,
    /// Principal point, x \[px\].
    pub cx: f64,
    /// Principal point, y \[px\].
    pub cy: f64,
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Takes world coordinates \[m\] to the camera's.
    pub camera_from_world: Pose,
}

impl Camera {
    /// Largest width and height of an image \[px\].
    pub const MAX_SIDE: u32 = 16_384;

    /// Checks that intrinsics and pose are finite, focal lengths positive and both sides within 1 to [`Self::MAX_SIDE`].
    ///
    /// # Errors
    /// Names the first value that is off.
    pub fn check(&self) -> Result<(), CoreError> {
        for (what, side) in [("camera width", self.width), ("camera height", self.height)] {
            if !(1..=Self::MAX_SIDE).contains(&side) {
                return Err(CoreError::Range { what, expected: "1 to 16384 pixels", found: side.to_string() });
            }
        }
        for (what, focal) in [("camera fx", self.fx), ("camera fy", self.fy)] {
            if !(1e-3..=1e7).contains(&focal) {
                return Err(CoreError::Range {
                    what,
                    expected: "0.001 to 10 000 000 pixels",
                    found: focal.to_string(),
                });
            }
        }
        for (what, centre) in [("camera cx", self.cx), ("camera cy", self.cy)] {
            if !(-1e7..=1e7).contains(&centre) {
                let expected = "at most 10 000 000 pixels to either side";
                return Err(CoreError::Range { what, expected, found: centre.to_string() });
            }
        }
        let pose = &self.camera_from_world;
        if !pose.position.is_finite() || !pose.rotation.is_finite() || (pose.rotation.length() - 1.0).abs() > 1e-6 {
            let found = format!("{} {}", pose.position, pose.rotation);
            return Err(CoreError::Range { what: "camera_from_world", expected: "a finite rigid transform", found });
        }
        if pose.position.abs().max_element() > 1e12 {
            let expected = "a position within 1e12 m";
            return Err(CoreError::Range { what: "camera_from_world", expected, found: pose.position.to_string() });
        }
        Ok(())
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Camera = Camera {
        fx: 400.0,
        fy: 410.0,
        cx: 320.0,
        cy: 240.0,
        width: 640,
        height: 480,
        camera_from_world: Pose::IDENTITY,
    };

    #[test]
    fn a_good_camera_passes() {
        assert_eq!(GOOD.check(), Ok(()));
        assert_eq!(GOOD.pixels(), 307_200);
    }

    #[test]
    fn each_fault_is_named() {
        let what = |camera: Camera| match camera.check() {
            Err(CoreError::Range { what, .. }) => what,
            other => panic!("{other:?}"),
        };
        assert_eq!(what(Camera { width: 0, ..GOOD }), "camera width");
        assert_eq!(what(Camera { height: 20_000, ..GOOD }), "camera height");
        assert_eq!(what(Camera { fx: f64::NAN, ..GOOD }), "camera fx");
        assert_eq!(what(Camera { fy: -1.0, ..GOOD }), "camera fy");
        assert_eq!(what(Camera { cy: f64::INFINITY, ..GOOD }), "camera cy");
        let camera_from_world = Pose { rotation: glam::DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0), ..Pose::IDENTITY };
        assert_eq!(what(Camera { camera_from_world, ..GOOD }), "camera_from_world");
    }
}
