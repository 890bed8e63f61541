//! What is compared: photographs, the camera on the robot, and the place.

use crate::CameraError;
use qv_core::{Camera, GaussianCloud, JointSeries, Pose};

/// A pinhole camera's inner numbers, OpenCV's axes, pixel centres at one half.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal length along x \[px\].
    pub fx: f64,
    /// Focal length along y \[px\].
    pub fy: f64,
    /// Principal point, x \[px\].
    pub cx: f64,
    /// Principal point, y \[px\].
    pub cy: f64,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A camera on a robot as it is said to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rig {
    /// The camera.
    pub intrinsics: Intrinsics,
    /// Where it is mounted; camera axes x right, y down, z forward.
    pub base_from_camera: Pose,
    /// A photograph with the stamp t was taken at t - delay on the clock of the poses \[s\]; neutral is 0.
    pub delay: f64,
    /// Displayed values are those of the scene times this; neutral is 1.
    pub gain: f64,
    /// Deviation of a blur \[px of the photograph\]; neutral is 0.
    pub blur: f64,
}

impl Rig {
    /// The camera at a pose.
    pub fn camera(&self, camera_from_world: Pose) -> Camera {
        let Intrinsics { fx, fy, cx, cy, width, height } = self.intrinsics;
        Camera { fx, fy, cx, cy, width, height, camera_from_world }
    }

    pub(crate) fn check(&self) -> Result<(), CameraError> {
        let off =
            |e: qv_core::CoreError| CameraError::new("camera", "intrinsics and mounting of a camera", e.to_string());
        self.camera(self.base_from_camera).check().map_err(off)?;
        let numbers =
            [("delay", self.delay, -1.0..=1.0), ("gain", self.gain, 0.05..=20.0), ("blur", self.blur, 0.0..=50.0)];
        match numbers.iter().find(|(_, value, range)| !range.contains(value)) {
            Some((name, value, range)) => Err(CameraError::new(
                format!("camera {name}"),
                format!("{} to {}", range.start(), range.end()),
                value.to_string(),
            )),
            None => Ok(()),
        }
    }
}

/// A photograph without distortion.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// Stamp \[s, on the clock of the poses\].
    pub time: f64,
    /// Red, green, blue as displayed and 255, or 0 where there is no photograph; row by row from the top.
    pub rgba: Vec<[u8; 4]>,
}

/// What is compared.
#[derive(Clone, Copy)]
pub struct Footage<'a> {
    /// The place, in the frame of the poses.
    pub cloud: &'a GaussianCloud,
    /// Colour that it was made to be drawn over, 0 to 1.
    pub background: [f32; 3],
    /// The camera.
    pub rig: Rig,
    /// Measured `world_from_base` as x, y, z \[m\], w, x, y, z.
    pub poses: Option<&'a JointSeries>,
    /// Photographs in the order of their stamps.
    pub photographs: &'a [Photograph],
}
