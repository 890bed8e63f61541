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
/// Share of the pixels that meet in another unit below which those of the stated one say nothing: near the cameras no two of them see one place.
const FEW: f64 = 0.5;

/// How frames go together in a unit.
#[derive(Debug, Clone, Copy)]
struct Agreement {
    factor: f64,
    /// Share of the pixels that meet which differ, and share of all pixels that meet.
    off: f64,
    met: f64,
}

/// Reads the depths in the unit in which frames agree, where they contradict each other in the stated one; says so.
pub fn agree(frames: &mut [DepthFrame]) -> Option<String> {
    let found: Vec<Agreement> = FACTORS.iter().filter_map(|f| agreement(frames, *f)).collect();
    // Frames of which nothing meets in the stated unit contradict each other, too, if they meet and agree in another.
    let stated = found.iter().find(|a| a.factor == 1.0).map_or(1.0, |a| a.off);
    let best = found.iter().min_by(|a, b| a.off.total_cmp(&b.off))?;
    let (factor, why) = if best.factor != 1.0 && stated >= CONTRADICTS && best.off <= LEFT * stated {
        let why = format!(
            "{:.0} % of the depths contradict those of other frames in the stated unit, {:.0} % in one {} times as large",
            100.0 * stated,
            100.0 * best.off,
            best.factor
        );
        (best.factor, why)
    } else {
        seen_together(&found)?
    };
    for frame in frames.iter_mut() {
        frame.depth.iter_mut().for_each(|d| *d *= factor as f32);
    }
    Some(format!("{why}, which is taken"))
}

/// The one other unit in which frames agree and see one another's places, where in the stated one they hardly do: a floor that all frames see from
/// one height agrees in every unit. Its factor, and why.
fn seen_together(found: &[Agreement]) -> Option<(f64, String)> {
    let met = found.iter().find(|a| a.factor == 1.0).map_or(0.0, |a| a.met);
    let is_seen = |a: &&Agreement| a.factor != 1.0 && a.off < CONTRADICTS && met < FEW * a.met;
    let mut others = found.iter().filter(is_seen);
    let (Some(other), None) = (others.next(), others.next()) else { return None };
    let why = format!(
        "{:.0} % of the depths are seen in another frame in the stated unit, {:.0} % in one {} times as large",
        100.0 * met,
        100.0 * other.met,
        other.factor
    );
    Some((other.factor, why))
}

/// How the depths of two frames of one place go together; `None` where too few meet.
fn agreement(frames: &[DepthFrame], factor: f64) -> Option<Agreement> {
    let step = (frames.len() / PAIRS).max(1);
    let apart = (frames.len() / 12).max(1);
    let pairs = (0..frames.len().saturating_sub(apart)).step_by(step);
    let all: Vec<Option<f64>> = pairs.flat_map(|i| differences(&frames[i], &frames[i + apart], factor)).collect();
    let met: Vec<f64> = all.iter().copied().flatten().collect();
    (met.len() >= LEAST).then(|| Agreement {
        factor,
        off: met.iter().filter(|off| **off > DIFFERS).count() as f64 / met.len() as f64,
        met: met.len() as f64 / all.len() as f64,
    })
}

/// Difference of each depth of a frame from the other's of the same place, as a share; `None` where the other does not see it.
fn differences(one: &DepthFrame, other: &DepthFrame, factor: f64) -> Vec<Option<f64>> {
    let (a, b) = (&one.camera, &other.camera);
    let world_from_a = a.camera_from_world.inverse();
    let every = (one.depth.len() / PIXELS).max(1);
    let pixel = |i: usize| {
        let z = factor * f64::from(one.depth[i]);
        let (u, v) = ((i % a.width as usize) as f64 + 0.5, (i / a.width as usize) as f64 + 0.5);
        let place = DVec3::new((u - a.cx) / a.fx * z, (v - a.cy) / a.fy * z, z);
        let seen = b.camera_from_world.transform_point(world_from_a.transform_point(place));
        let (u, v) = (b.cx + b.fx * seen.x / seen.z, b.cy + b.fy * seen.y / seen.z);
        let inside = seen.z > 0.0 && (0.0..f64::from(b.width)).contains(&u) && (0.0..f64::from(b.height)).contains(&v);
        let there = inside.then(|| factor * f64::from(other.depth[v as usize * b.width as usize + u as usize]))?;
        (there > 0.0).then(|| (there - seen.z).abs() / seen.z)
    };
    (0..one.depth.len()).step_by(every).filter(|&i| one.depth[i] > 0.0).map(pixel).collect()
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

    /// Frames of a ball of 0.18 m on the floor z = 0, from cameras on a circle about it, all at one height.
    fn frames_of_a_ball(unit: f64) -> Vec<DepthFrame> {
        let frame = |k: usize| {
            let turn = DQuat::from_rotation_z(0.26 * k as f64);
            let look = turn * DQuat::from_rotation_y(0.54) * axes();
            let position = turn * DVec3::new(-2.0, 0.0, 1.2);
            let camera_from_world = Pose { position, rotation: look }.inverse();
            let camera =
                Camera { fx: 153.0, fy: 153.0, cx: 106.0, cy: 60.0, width: 212, height: 120, camera_from_world };
            let depth = |i: usize| {
                let (u, v) = ((i % 212) as f64 + 0.5, (i / 212) as f64 + 0.5);
                let ray = look * DVec3::new((u - 106.0) / 153.0, (v - 60.0) / 153.0, 1.0);
                let from = position - DVec3::new(0.0, 0.0, 0.18);
                let (a, b, c) = (ray.dot(ray), ray.dot(from), from.dot(from) - 0.0324);
                let to_ball = b * b - a * c;
                let floor = if ray.z < -0.1 { -position.z / ray.z } else { 0.0 };
                let z = if to_ball > 0.0 { (-b - to_ball.sqrt()) / a } else { floor };
                (z / unit) as f32
            };
            DepthFrame { camera, depth: (0..212 * 120).map(depth).collect(), weight: vec![] }
        };
        (0..20).map(frame).collect()
    }

    #[test]
    fn a_floor_seen_from_one_height_agrees_in_every_unit_and_what_stands_on_it_tells() {
        let metres = frames_of_a_ball(1.0);
        let mut right = metres.clone();
        assert_eq!(agree(&mut right), None);
        let mut far = frames_of_a_ball(5.0);
        let said = agree(&mut far).unwrap();
        assert!(said.contains("5 times as large"), "{said}");
        assert!(far.iter().zip(&metres).all(|(a, b)| a.depth.iter().zip(&b.depth).all(|(a, b)| (a - b).abs() < 1e-4)));
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
