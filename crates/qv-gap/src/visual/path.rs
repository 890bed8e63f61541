//! Where the robot was: the measured pose at any time.

use crate::GapError;
use glam::{DQuat, DVec3};
use qv_core::{JointSeries, Pose};

/// Measured poses `world_from_base` by time, at least two.
#[derive(Debug, Clone)]
pub struct Path {
    time: Vec<f64>,
    poses: Vec<Pose>,
}

impl Path {
    /// Of a pose stream with the columns x, y, z, w, x, y, z; rows that were not measured are left out.
    ///
    /// # Errors
    /// Fewer than two poses.
    pub fn new(stream: Option<&JointSeries>) -> Result<Self, GapError> {
        let (mut time, mut poses) = (Vec::new(), Vec::new());
        for i in 0..stream.map_or(0, JointSeries::len) {
            let row = stream.expect("has rows").row(i);
            let [x, y, z, qw, qx, qy, qz] = row[..] else {
                return Err(GapError::run("base pose", "7 columns", row.len().to_string()));
            };
            if let Some(pose) = Pose::from_position_wxyz([x, y, z], [qw, qx, qy, qz]) {
                time.push(stream.expect("has rows").time[i]);
                poses.push(pose);
            }
        }
        if time.len() < 2 {
            let expected = "a stream of base poses, to know what the camera should see";
            return Err(GapError::run("base pose", expected, format!("{} poses", time.len())));
        }
        Ok(Self { time, poses })
    }

    /// First and last stamp \[s\].
    pub fn span(&self) -> [f64; 2] {
        [self.time[0], self.time[self.time.len() - 1]]
    }

    /// `world_from_base` at a time: positions on a straight line, rotations on a great circle between neighbours; beyond the ends at the
    /// velocity there.
    pub fn at(&self, time: f64) -> Pose {
        let after = self.time.partition_point(|t| *t <= time).clamp(1, self.time.len() - 1);
        let (a, b) = (&self.poses[after - 1], &self.poses[after]);
        let share = (time - self.time[after - 1]) / (self.time[after] - self.time[after - 1]);
        let turn = shortest(a.rotation.conjugate() * b.rotation).to_scaled_axis();
        let rotation = (a.rotation * DQuat::from_scaled_axis(share * turn)).normalize();
        Pose { position: a.position.lerp(b.position, share), rotation }
    }

    /// The longest interval between neighbours around a time \[s\].
    pub fn interval(&self, time: f64) -> f64 {
        let after = self.time.partition_point(|t| *t <= time).clamp(1, self.time.len() - 1);
        self.time[after] - self.time[after - 1]
    }
}

/// The same rotation as the quaternion whose angle is at most half a turn.
fn shortest(q: DQuat) -> DQuat {
    if q.w < 0.0 { -q } else { q }
}

/// A small motion as translation \[m\] and rotation \[rad\]: position and scaled axis of a pose.
pub type Twist = [f64; 6];

/// Position and scaled axis of a pose.
pub fn twist_of(pose: &Pose) -> Twist {
    let w = shortest(pose.rotation).to_scaled_axis();
    [pose.position.x, pose.position.y, pose.position.z, w.x, w.y, w.z]
}

/// The pose of a position and a scaled axis; undoes [`twist_of`].
pub fn pose_of(twist: &[f64]) -> Pose {
    let rotation = DQuat::from_scaled_axis(DVec3::new(twist[3], twist[4], twist[5]));
    Pose { position: DVec3::new(twist[0], twist[1], twist[2]), rotation }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_between_their_neighbours() {
        let half = 0.5f64.sqrt();
        let values = vec![
            0.0,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
            f64::NAN,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
            1.0,
            2.0,
            0.0,
            -half,
            0.0,
            0.0,
            -half,
        ];
        let path = Path::new(Some(&JointSeries::new(vec![0.0, 0.5, 1.0], values, 7).unwrap())).unwrap();
        let middle = path.at(0.5);
        assert!((middle.position - DVec3::new(0.5, 1.0, 0.0)).length() < 1e-12);
        // The same rotation with the other sign is no detour.
        assert!((middle.yaw() - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
        assert!((path.at(1.2).position.x - 1.2).abs() < 1e-12);
        assert_eq!(path.span(), [0.0, 1.0]);
        assert!(Path::new(None).unwrap_err().to_string().contains("base pose"));
    }

    #[test]
    fn twists_and_poses_undo_each_other() {
        let twist = [0.1, -0.2, 0.3, 0.02, -0.5, 0.4];
        let back = twist_of(&pose_of(&twist));
        assert!(twist.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
