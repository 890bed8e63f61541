//! Channels that were not measured, derived from those that were.

use crate::clean::median_interval;
use crate::run::Run;
use crate::smooth::LocalPolynomial;
use glam::{DQuat, DVec3};
use qv_core::JointSeries;

/// Half-width of the joint filter in samples.
const JOINT_REACH: f64 = 6.0;

/// Half-width of the base filter \[s\].
const BASE_HALF_WIDTH: f64 = 0.1;

/// A derived channel.
#[derive(Debug, Clone, PartialEq)]
pub struct DerivedChannel {
    /// Values.
    pub series: JointSeries,
    /// From what and how.
    pub method: String,
    /// Where its amplitude has fallen by 3 dB against the true one \[Hz\]; NaN when beyond the Nyquist frequency.
    pub bandwidth: f64,
}

/// The filter for joint channels: a local cubic over +-6 samples.
pub fn joint_filter(series: &JointSeries) -> LocalPolynomial {
    LocalPolynomial { half_width: JOINT_REACH * median_interval(&series.time).max(1e-6), degree: 3 }
}

fn describe(filter: LocalPolynomial, from: &str) -> String {
    format!("local cubic over +-{:.0} ms of {from}, zero phase", 1e3 * filter.half_width)
}

/// Joint velocities \[rad/s\] from positions; `None` when positions are too few.
pub fn joint_velocity(run: &Run) -> Option<DerivedChannel> {
    let position = run.measured.position.as_ref().filter(|p| p.len() > 3)?;
    let filter = joint_filter(position);
    let bandwidth = filter.bandwidth(median_interval(&position.time), true);
    Some(DerivedChannel { series: filter.derivative(position), method: describe(filter, "positions"), bandwidth })
}

/// Linear velocity of the base in the world \[m/s\], 3 columns, from poses.
pub fn base_velocity(pose: &JointSeries) -> Option<DerivedChannel> {
    if pose.len() < 4 {
        return None;
    }
    let filter = base_filter(pose);
    let xyz = (0..pose.len()).flat_map(|i| pose.row(i)[..3].to_vec()).collect();
    let position = JointSeries { time: pose.time.clone(), values: xyz, joints: 3 };
    let bandwidth = filter.bandwidth(median_interval(&pose.time), true);
    Some(DerivedChannel { series: filter.derivative(&position), method: describe(filter, "poses"), bandwidth })
}

/// Angular velocity of the base in its own frame \[rad/s\], 3 columns, from poses: for recordings without a gyro.
pub fn base_angular_velocity(pose: &JointSeries) -> Option<DerivedChannel> {
    if pose.len() < 4 {
        return None;
    }
    let filter = base_filter(pose);
    let mut turns = Vec::with_capacity(4 * pose.len());
    let mut before = [1.0, 0.0, 0.0, 0.0];
    for i in 0..pose.len() {
        let q: [f64; 4] = pose.row(i)[3..7].try_into().expect("a pose has seven columns");
        // The two quaternions of one turn: the one nearer to the last keeps the series smooth.
        let dot: f64 = q.iter().zip(&before).map(|(a, b)| a * b).sum();
        let q = if dot < 0.0 { q.map(|x| -x) } else { q };
        turns.extend(q);
        if q.iter().all(|x| x.is_finite()) {
            before = q;
        }
    }
    let turns = JointSeries { time: pose.time.clone(), values: turns, joints: 4 };
    let values = turns.time.iter().flat_map(|&t| {
        let s = filter.at(&turns, t);
        let (q, d) = (std::array::from_fn(|k| s[k].value), std::array::from_fn(|k| s[k].slope));
        body_rate(q, d)
    });
    let series = JointSeries { time: pose.time.clone(), values: values.collect(), joints: 3 };
    let bandwidth = filter.bandwidth(median_interval(&pose.time), true);
    Some(DerivedChannel { series, method: describe(filter, "pose orientations"), bandwidth })
}

/// A rotation as a vector \[rad\], of the two ways round the shorter.
pub fn shorter_turn(q: DQuat) -> DVec3 {
    (if q.w < 0.0 { -q } else { q }).to_scaled_axis()
}

fn base_filter(pose: &JointSeries) -> LocalPolynomial {
    LocalPolynomial { half_width: BASE_HALF_WIDTH.max(3.0 * median_interval(&pose.time)), degree: 3 }
}

/// `2 q* dq/dt`, the angular velocity in the body frame, for a quaternion that is nearly of unit length.
fn body_rate(q: [f64; 4], d: [f64; 4]) -> [f64; 3] {
    let [w, x, y, z] = q;
    let square = w * w + x * x + y * y + z * z;
    let k = 2.0 / square;
    [
        k * (w * d[1] - x * d[0] - y * d[3] + z * d[2]),
        k * (w * d[2] + x * d[3] - y * d[0] - z * d[1]),
        k * (w * d[3] - x * d[2] + y * d[1] - z * d[0]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn body_rate_of_a_steady_turn_off_every_axis() {
        let rate = DVec3::new(0.3, -0.7, 1.1);
        let start = DQuat::from_xyzw(0.1, -0.4, 0.3, 0.8).normalize();
        let at = |t: f64| {
            let q = start * DQuat::from_scaled_axis(rate * t);
            [q.w, q.x, q.y, q.z]
        };
        let (q, a, b) = (at(0.0), at(-1e-4), at(1e-4));
        let found = body_rate(q, std::array::from_fn(|k| (b[k] - a[k]) / 2e-4));
        assert!((DVec3::from_array(found) - rate).length() < 1e-6, "{found:?}");
    }
}
