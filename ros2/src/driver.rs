//! Decides what the robot does, from the last picture and the last odometry, and stands still when one of them is old. Knows no ROS but its messages.

use crate::messages::{Image, Pose};
use qv_nav::NavError;
use qv_nav::glam::DVec2;
use qv_nav::navigator::{FRAME, Navigator};
use qv_nav::recall::Planar;

/// A picture or odometry of this age or older makes the robot stand still \[s\].
pub const STALE: f64 = 0.4;
/// So long after the first decision it stands still for good \[s\].
pub const LONGEST: f64 = 25.0;

/// Why a picture or odometry is of no use.
#[derive(Debug, thiserror::Error)]
pub enum DriverError {
    /// A picture that is not what the policy takes.
    #[error("picture, {what}: expected {expected}, found {found}")]
    Picture {
        /// Which part of it.
        what: &'static str,
        /// What is allowed.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The policy failed.
    #[error(transparent)]
    Policy(#[from] NavError),
}

/// What came in last, and what became of it. All times are seconds of one clock that never goes back.
pub struct Driver {
    navigator: Navigator,
    picture: Option<(Image, f64)>,
    odometry: Option<(Pose, f64)>,
    /// Where it was at the first decision, and when.
    start: Option<(Planar, f64)>,
}

impl Driver {
    /// One that has seen nothing.
    pub fn new(navigator: Navigator) -> Self {
        Self { navigator, picture: None, odometry: None, start: None }
    }

    /// A picture came in.
    pub fn see(&mut self, picture: Image, now: f64) {
        self.picture = Some((picture, now));
    }

    /// Odometry came in.
    pub fn moved(&mut self, pose: Pose, now: f64) {
        self.odometry = Some((pose, now));
    }

    /// The command (forwards, to the left \[m/s\], turning \[rad/s\]); zeros when there is nothing new to decide from, or the time is over.
    ///
    /// # Errors
    /// When the picture is not of 640 x 480 pixels of three bytes, or the policy fails. The robot should stand still then.
    pub fn decide(&mut self, now: f64) -> Result<[f64; 3], DriverError> {
        const STAND: [f64; 3] = [0.0; 3];
        let (Some((picture, seen_at)), Some((pose, moved_at))) = (&self.picture, &self.odometry) else {
            return Ok(STAND);
        };
        let is_over = self.start.is_some_and(|(_, began)| now - began > LONGEST);
        // So that an age that is no number is old, too.
        let is_fresh = now - seen_at.min(*moved_at) < STALE;
        if is_over || !is_fresh {
            return Ok(STAND);
        }
        let (at, down) = planar(pose);
        let (start, _) = *self.start.get_or_insert((at, now));
        let since = Planar { place: start.into_frame(at.place), yaw: at.yaw - start.yaw };
        Ok(self.navigator.decide(&pixels(picture)?, down, since)?)
    }
}

/// Where a robot is from above, and the direction of gravity in its axes.
pub fn planar(pose: &Pose) -> (Planar, [f64; 3]) {
    let (q, p) = (pose.orientation, pose.position);
    let yaw = (2.0 * (q.w * q.z + q.x * q.y)).atan2(1.0 - 2.0 * (q.y * q.y + q.z * q.z));
    let down = [2.0 * (q.w * q.y - q.x * q.z), -2.0 * (q.y * q.z + q.w * q.x), 2.0 * (q.x * q.x + q.y * q.y) - 1.0];
    (Planar { place: DVec2::new(p.x, p.y), yaw }, down)
}

/// Red, green, blue of a picture with three bytes a pixel; its rows may be padded.
fn pixels(picture: &Image) -> Result<Vec<u8>, DriverError> {
    let wrong = |what, expected: String, found: String| Err(DriverError::Picture { what, expected, found });
    let is_blue_first = match picture.encoding.as_str() {
        "rgb8" => false,
        "bgr8" => true,
        other => return wrong("encoding", "rgb8 or bgr8".into(), other.into()),
    };
    let [height, width] = FRAME;
    if [picture.height, picture.width] != FRAME.map(|n| n as u32) {
        let found = format!("{} x {}", picture.width, picture.height);
        return wrong("pixels", format!("{width} x {height}"), found);
    }
    let step = picture.step as usize;
    if step < 3 * width {
        return wrong("bytes from one row to the next", format!("at least {}", 3 * width), step.to_string());
    }
    if picture.data.len() != step * height {
        return wrong("bytes", (step * height).to_string(), picture.data.len().to_string());
    }
    let mut out: Vec<u8> = picture.data.chunks_exact(step).flat_map(|row| &row[..3 * width]).copied().collect();
    if is_blue_first {
        out.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Quaternion, Vector3};
    use qv_core::random::Xoshiro256PlusPlus;
    use qv_nav::net::Net;
    use qv_nav::onnx::to_bytes;
    use qv_nav::task::Limits;

    fn driver() -> Driver {
        let net = Net::default();
        let parameters = net.draw(&mut Xoshiro256PlusPlus::new(4));
        let policy = to_bytes(&net, &parameters, &Limits::default(), [3.0, 2.5]).unwrap();
        Driver::new(Navigator::new(&policy, "red").unwrap())
    }

    fn picture() -> Image {
        let step = 3 * 640 + 8;
        let data = [10, 20, 30].repeat(step).into_iter().take(step).collect::<Vec<u8>>().repeat(480);
        Image { height: 480, width: 640, encoding: "bgr8".into(), step: step as u32, data, ..Image::default() }
    }

    #[test]
    fn it_stands_until_both_are_there_and_when_one_is_old_and_when_the_time_is_over() {
        let mut driver = driver();
        assert_eq!(driver.decide(0.0).unwrap(), [0.0; 3]);
        driver.see(picture(), 0.1);
        assert_eq!(driver.decide(0.2).unwrap(), [0.0; 3], "no odometry yet");
        driver.moved(Pose::default(), 0.3);
        assert_ne!(driver.decide(0.4).unwrap(), [0.0; 3]);
        // Odometry goes on, pictures do not.
        driver.moved(Pose::default(), 0.45);
        assert_ne!(driver.decide(0.49).unwrap(), [0.0; 3]);
        assert_eq!(driver.decide(0.51).unwrap(), [0.0; 3], "the picture is old");
        driver.see(picture(), 0.8);
        assert_eq!(driver.decide(0.9).unwrap(), [0.0; 3], "the odometry is old");
        driver.moved(Pose::default(), 0.9);
        assert_ne!(driver.decide(1.0).unwrap(), [0.0; 3]);
        driver.see(picture(), 25.5);
        driver.moved(Pose::default(), 25.5);
        assert_eq!(driver.decide(25.5).unwrap(), [0.0; 3], "the time is over");
        assert_eq!(driver.decide(f64::NAN).unwrap(), [0.0; 3]);
    }

    #[test]
    fn pixels_are_red_first_without_padding_and_bad_pictures_are_named() {
        let frame = pixels(&picture()).unwrap();
        assert!(frame.len() == 640 * 480 * 3 && frame[..3] == [30, 20, 10] && frame[1920..1923] == [30, 20, 10]);
        let said = |change: fn(&mut Image)| {
            let mut bad = picture();
            change(&mut bad);
            pixels(&bad).unwrap_err().to_string()
        };
        assert!(said(|i| i.encoding = "mono8".into()).contains("encoding: expected rgb8 or bgr8, found mono8"));
        assert!(said(|i| i.height = 240).contains("pixels: expected 640 x 480, found 640 x 240"));
        assert!(said(|i| i.step = 640).contains("expected at least 1920, found 640"));
        assert!(said(|i| i.data.truncate(5)).contains("bytes: expected 925440, found 5"));
    }

    #[test]
    fn gravity_is_that_of_the_simulator() {
        // Nose down by 0.2 rad: gravity has a part forwards.
        let orientation = Quaternion { x: 0.0, y: 0.1f64.sin(), z: 0.0, w: 0.1f64.cos() };
        let (at, down) = planar(&Pose { position: Vector3 { x: 1.0, y: 2.0, z: 0.3 }, orientation });
        assert!(at.place == DVec2::new(1.0, 2.0) && at.yaw.abs() < 1e-12);
        let expected = [0.2f64.sin(), 0.0, -0.2f64.cos()];
        assert!(down.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{down:?}");
    }
}
