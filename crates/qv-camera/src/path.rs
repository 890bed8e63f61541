//! Where the robot was: the measured pose at any time.
//!
//! Measured poses scatter by millimetres from one to the next, which as a velocity is as large as that of a walk: a delay would be fitted to
//! the noise. Each pose is the value at its stamp of a parabola through its neighbours within 50 ms (Savitzky and Golay, 1964).

use crate::CameraError;
use glam::{DMat3, DQuat, DVec3};
use qv_core::{JointSeries, Pose};

/// Measured poses `world_from_base` by time, at least two.
#[derive(Debug, Clone)]
pub struct Path {
    time: Vec<f64>,
    poses: Vec<Pose>,
    /// Velocity at each stamp in the axes of its pose \[m/s, rad/s\].
    velocity: Vec<Twist>,
}

/// Neighbours within this belong to a parabola \[s\].
const NEAR: f64 = 0.055;
/// Fewest samples of a parabola; fewer are taken as they are.
const FEWEST: usize = 5;

impl Path {
    /// Of a pose stream with the columns x, y, z, w, x, y, z; rows that were not measured are left out.
    ///
    /// # Errors
    /// Fewer than two poses.
    pub fn new(stream: Option<&JointSeries>) -> Result<Self, CameraError> {
        let (mut time, mut poses) = (Vec::new(), Vec::new());
        for i in 0..stream.map_or(0, JointSeries::len) {
            let row = stream.expect("has rows").row(i);
            let [x, y, z, qw, qx, qy, qz] = row[..] else {
                return Err(CameraError::new("base pose", "7 columns", row.len().to_string()));
            };
            if let Some(pose) = Pose::from_position_wxyz([x, y, z], [qw, qx, qy, qz]) {
                time.push(stream.expect("has rows").time[i]);
                poses.push(pose);
            }
        }
        if time.len() < 2 {
            let expected = "a stream of base poses, to know what the camera should see";
            return Err(CameraError::new("base pose", expected, format!("{} poses", time.len())));
        }
        let smoothed: Vec<(Pose, Twist)> = (0..time.len()).map(|i| smoothed(&time, &poses, i)).collect();
        let (poses, velocity) = smoothed.into_iter().unzip();
        Ok(Self { time, poses, velocity })
    }

    /// First and last stamp \[s\].
    pub fn span(&self) -> [f64; 2] {
        [self.time[0], self.time[self.time.len() - 1]]
    }

    /// `world_from_base` at a time: the cubic between neighbours that has their poses and velocities; beyond the ends at the velocity there.
    pub fn at(&self, time: f64) -> Pose {
        let n = self.time.len();
        let after = self.time.partition_point(|t| *t <= time).clamp(1, n - 1);
        let (k, length) = (after - 1, self.time[after] - self.time[after - 1]);
        if time < self.time[0] || time > self.time[n - 1] {
            let end = if time < self.time[0] { 0 } else { n - 1 };
            return self.poses[end] * pose_of(&self.velocity[end].map(|v| v * (time - self.time[end])));
        }
        let s = (time - self.time[k]) / length;
        let (h10, h01, h11) = (s * (1.0 - s).powi(2), s * s * (3.0 - 2.0 * s), s * s * (s - 1.0));
        let next = twist_of(&(self.poses[k].inverse() * self.poses[after]));
        let turn = self.poses[k].rotation.conjugate() * self.poses[after].rotation;
        let (first, second) = (&self.velocity[k], turned(turn, &self.velocity[after]));
        let twist: Twist = std::array::from_fn(|i| h10 * length * first[i] + h01 * next[i] + h11 * length * second[i]);
        self.poses[k] * pose_of(&twist)
    }
}

/// A twist in other axes.
fn turned(rotation: DQuat, twist: &Twist) -> Twist {
    let v = rotation * DVec3::new(twist[0], twist[1], twist[2]);
    let w = rotation * DVec3::new(twist[3], twist[4], twist[5]);
    [v.x, v.y, v.z, w.x, w.y, w.z]
}

/// A sample's pose and velocity by a parabola through its neighbours, or as they are where there are few.
fn smoothed(time: &[f64], poses: &[Pose], i: usize) -> (Pose, Twist) {
    let seen = |j: usize| (time[j] - time[i], twist_of(&(poses[i].inverse() * poses[j])));
    let first = time.partition_point(|t| *t < time[i] - NEAR);
    let last = time.partition_point(|t| *t <= time[i] + NEAR);
    if last - first < FEWEST {
        let (a, b) = (i.saturating_sub(1), (i + 1).min(time.len() - 1));
        let ((from, before), (to, after)) = (seen(a), seen(b));
        return (poses[i], std::array::from_fn(|k| (after[k] - before[k]) / (to - from)));
    }
    let (mut normal, mut wanted) = (DMat3::ZERO, [DVec3::ZERO; 6]);
    for j in first..last {
        let (dt, twist) = seen(j);
        let u = dt / NEAR;
        let row = DVec3::new(1.0, u, u * u);
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        (0..6).for_each(|k| wanted[k] += twist[k] * row);
    }
    let inverse = normal.inverse();
    let parabola = wanted.map(|w| inverse * w);
    (poses[i] * pose_of(&parabola.map(|p| p.x)), parabola.map(|p| p.y / NEAR))
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
    use crate::facts::States;

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
        assert!((path.at(1.2).position.x - 1.2).abs() < 0.05, "{}", path.at(1.2).position);
        assert_eq!(path.span(), [0.0, 1.0]);
        assert!(Path::new(None).unwrap_err().to_string().states("base"));
    }

    #[test]
    fn noise_is_smoothed_and_motion_is_not() {
        let truth = |t: f64| {
            let turn = DQuat::from_rotation_z(0.7 * t) * DQuat::from_rotation_x(0.03 * (11.0 * t).sin());
            Pose { position: DVec3::new(0.4 * t, 0.02 * (9.0 * t).cos(), 0.3), rotation: turn }
        };
        let (mut time, mut values) = (Vec::new(), Vec::new());
        for k in 0..100 {
            let noise = 0.002 * f64::from([1, -1, -1, 1, 0][k % 5]);
            let t = 0.02 * k as f64;
            time.push(t);
            values.extend((truth(t).position + noise).to_array());
            values.extend(truth(t).wxyz());
        }
        let path = Path::new(Some(&JointSeries::new(time, values, 7).unwrap())).unwrap();
        for t in [0.511, 0.9, 1.237] {
            assert!((path.at(t).position - truth(t).position).length() < 0.0025, "{t}");
            assert!(path.at(t).rotation.angle_between(truth(t).rotation) < 2e-3, "{t}");
            let speed = |of: &dyn Fn(f64) -> Pose| (of(t + 0.01).position - of(t - 0.01).position) / 0.02;
            // Between raw samples noise alone makes up to 0.35 m/s.
            assert!((speed(&|t| path.at(t)) - speed(&truth)).length() < 0.2, "{t}");
        }
    }

    #[test]
    fn twists_and_poses_undo_each_other() {
        let twist = [0.1, -0.2, 0.3, 0.02, -0.5, 0.4];
        let back = twist_of(&pose_of(&twist));
        assert!(twist.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
