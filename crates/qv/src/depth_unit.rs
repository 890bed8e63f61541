//! The unit of depth images: frames that contradict each other in the stated unit, and agree in another.

use glam::DVec3;
use qv_mesh::DepthFrame;

/// Factors on the stated unit that are tried: 1/5000 m of TUM for millimetres and the other way round, tenths, thousandths.
const FACTORS: [f64; 7] = [1.0, 5.0, 0.2, 10.0, 0.1, 1000.0, 0.001];
/// Pairs of frames, and pixels of each, that are compared at most.
const PAIRS: usize = 40;
const PIXELS: usize = 400;
/// Difference of two depths of one place that contradicts, as a share of them: a plane alone agrees in any unit, what stands on it does not.
const DIFFERS: f64 = 0.02;
/// Share of pixels that differ from which on frames contradict each other, and share of that which may be left in the right unit.
const CONTRADICTS: f64 = 0.04;
const LEFT: f64 = 0.4;
/// Pixels that must meet in all pairs together.
const LEAST: usize = 200;

/// Reads the depths in the unit in which frames agree, where they contradict each other in the stated one; says so.
pub fn agree(frames: &mut [DepthFrame]) -> Option<String> {
    let found: Vec<(f64, f64)> = FACTORS.iter().filter_map(|f| Some((*f, disagreement(frames, *f)?))).collect();
    // Frames of which nothing meets in the stated unit contradict each other, too, if they meet and agree in another.
    let stated = found.iter().find(|(factor, _)| *factor == 1.0).map_or(1.0, |(_, off)| *off);
    let (factor, best) = found.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))?;
    if factor == 1.0 || stated < CONTRADICTS || best > LEFT * stated {
        return None;
    }
    for frame in frames.iter_mut() {
        frame.depth.iter_mut().for_each(|d| *d *= factor as f32);
    }
    Some(format!(
        "{:.0} % of the depths contradict those of other frames in the stated unit, {:.0} % in one {factor} times as large, which is taken",
        100.0 * stated,
        100.0 * best
    ))
}

/// Share of the depths of two frames of one place that differ; `None` where too few meet.
fn disagreement(frames: &[DepthFrame], factor: f64) -> Option<f64> {
    let step = (frames.len() / PAIRS).max(1);
    let apart = (frames.len() / 12).max(1);
    let pairs = (0..frames.len().saturating_sub(apart)).step_by(step);
    let all: Vec<f64> = pairs.flat_map(|i| differences(&frames[i], &frames[i + apart], factor)).collect();
    (all.len() >= LEAST).then(|| all.iter().filter(|off| **off > DIFFERS).count() as f64 / all.len() as f64)
}

fn differences(one: &DepthFrame, other: &DepthFrame, factor: f64) -> Vec<f64> {
    let (a, b) = (&one.camera, &other.camera);
    let world_from_a = a.camera_from_world.inverse();
    let every = (one.depth.len() / PIXELS).max(1);
    let pixel = |i: usize| {
        let z = factor * f64::from(one.depth[i]);
        let (u, v) = ((i % a.width as usize) as f64 + 0.5, (i / a.width as usize) as f64 + 0.5);
        let place = DVec3::new((u - a.cx) / a.fx * z, (v - a.cy) / a.fy * z, z);
        let seen = b.camera_from_world.transform_point(world_from_a.transform_point(place));
        let (u, v) = (b.cx + b.fx * seen.x / seen.z, b.cy + b.fy * seen.y / seen.z);
        let inside = z > 0.0
            && seen.z > 0.0
            && (0.0..f64::from(b.width)).contains(&u)
            && (0.0..f64::from(b.height)).contains(&v);
        let there = inside.then(|| factor * f64::from(other.depth[v as usize * b.width as usize + u as usize]))?;
        (there > 0.0).then(|| (there - seen.z).abs() / seen.z)
    };
    (0..one.depth.len()).step_by(every).filter_map(pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use qv_core::{Camera, Pose};

    /// Frames of the floor z = 0, from cameras on a circle that look down at 45 degrees, with depths in units of `unit` metres.
    fn frames(unit: f64) -> Vec<DepthFrame> {
        let frame = |k: usize| {
            let turn = DQuat::from_rotation_z(0.15 * k as f64);
            let look = turn * DQuat::from_rotation_y(std::f64::consts::FRAC_PI_4) * axes();
            let position = turn * DVec3::new(-1.0, 0.0, 1.2 + 0.2 * (k % 3) as f64);
            let camera_from_world = Pose { position, rotation: look }.inverse();
            let camera = Camera { fx: 80.0, fy: 80.0, cx: 40.0, cy: 30.0, width: 80, height: 60, camera_from_world };
            let depth = |i: usize| {
                let (u, v) = ((i % 80) as f64 + 0.5, (i / 80) as f64 + 0.5);
                let ray = look * DVec3::new((u - 40.0) / 80.0, (v - 30.0) / 80.0, 1.0);
                if ray.z < -0.1 { (-position.z / ray.z / unit) as f32 } else { 0.0 }
            };
            DepthFrame { camera, depth: (0..80 * 60).map(depth).collect(), weight: vec![] }
        };
        (0..24).map(frame).collect()
    }

    /// A camera that looks along x with z up.
    fn axes() -> DQuat {
        DQuat::from_mat3(&glam::DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X))
    }

    #[test]
    fn depths_are_read_in_the_unit_in_which_frames_agree() {
        let metres = frames(1.0);
        let mut right = metres.clone();
        assert_eq!(agree(&mut right), None);
        assert_eq!(right, metres);
        for unit in [5.0, 0.2, 10.0] {
            let mut other = frames(unit);
            let said = agree(&mut other);
            assert!(said.as_ref().is_some_and(|s| s.contains(&format!("{unit} times as large"))), "{unit} {said:?}");
            let near =
                other.iter().zip(&metres).all(|(a, b)| a.depth.iter().zip(&b.depth).all(|(a, b)| (a - b).abs() < 1e-4));
            assert!(near, "{unit}");
        }
    }
}
