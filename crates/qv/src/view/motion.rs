//! The robot over time: as it was recorded, as the simulator has it, and with the corrections of a diagnosis.

use super::parts::Parts;
use crate::open::{find_gains, model_of, open_run, parameters_of};
use crate::{Failure, Reading, RunArguments};
use glam::DVec3;
use qv_core::TriangleMesh;
use qv_recording::Run;
use qv_rollout::{Feet, Trace};

use qv_replay::{ReplayOptions, simulate, usual_force};
use qv_sim::{Model, Shape, Terrain};
use serde_json::{Value, json};
use std::path::Path;
use std::slice;

/// Most pictures of a second, and of a recording.
const RATE: f64 = 25.0;
const MOST: usize = 1500;

/// Half the height of a slab that stands for a trunk \[m\].
const THICK: f64 = 0.05;
/// A stick shorter than this is none \[m\].
const SHORT: f64 = 0.01;

/// A robot over time.
pub struct Track {
    pub name: &'static str,
    /// x, y, z, quaternion x, y, z, w of each link in the world; NaN where it is not known. Shape `[T, links, 7]`.
    pub poses: Vec<f32>,
    /// What the ground does to its feet, where that is known.
    pub forces: Option<Forces>,
}

/// Normal forces on the feet of a robot over time.
pub struct Forces {
    /// Where the foot touches the ground in the world \[m\], and the force \[N, or what a sensor takes for it\]; NaN where
    /// it is not known. Shape `[T, feet, 4]`.
    pub feet: Vec<f32>,
    /// The largest force that is usual, in the same unit.
    pub usual: f64,
}

/// All tracks, on one clock.
pub struct Motion {
    pub model: Model,
    /// \[s\], shape `[T]`.
    pub time: Vec<f64>,
    pub tracks: Vec<Track>,
}

impl Motion {
    /// How long it is.
    pub fn seconds(&self) -> f64 {
        self.time.last().unwrap_or(&0.0) - self.time.first().unwrap_or(&0.0)
    }

    /// Links that the joints of these names move; of `all` every one with a joint, of a leg those whose names begin with its.
    pub fn links(&self, scope: &[String]) -> Vec<usize> {
        let is_meant = |joint: &str| {
            scope.iter().any(|name| name == "all" || joint == name || joint.starts_with(&format!("{name}_")))
        };
        let joints = self.model.joints.iter().filter(|joint| is_meant(&joint.name));
        let mut links: Vec<usize> = joints.map(|joint| joint.link).collect();
        // A trunk, or another link that is named itself.
        let named = (0..self.model.links.len()).filter(|&k| scope.contains(&self.model.links[k].name));
        links.extend(named);
        links.sort_unstable();
        links.dedup();
        links
    }

    /// The shapes of all links, for the page.
    pub fn shapes(&self) -> Vec<Value> {
        let solid = self.model.geoms.iter().map(|geom| {
            let pose = pose(&geom.link_from_geom);
            let [kind, size] = match &geom.shape {
                Shape::Sphere(radius) => [json!("sphere"), json!([radius])],
                Shape::Box(half) => [json!("box"), json!([half.x, half.y, half.z])],
                Shape::Capsule { radius, half_length } => [json!("capsule"), json!([radius, half_length])],
                Shape::Cylinder { radius, half_length } => [json!("cylinder"), json!([radius, half_length])],
                Shape::Hull(points) => {
                    [json!("hull"), json!(points.iter().flat_map(|p| [p.x, p.y, p.z]).collect::<Vec<f64>>())]
                }
            };
            json!({"link": geom.link, "kind": kind, "size": size, "pose": pose})
        });
        solid.chain(sticks(&self.model)).collect()
    }
}

/// Sticks from each link to what hangs on it, and a slab between the links of a trunk: many models have shapes for feet alone.
fn sticks(model: &Model) -> Vec<Value> {
    let mut all = Vec::new();
    for link in 0..model.links.len() {
        let children = model.links.iter().filter(|child| child.parent == Some(link));
        let mut ends: Vec<DVec3> = children.map(|child| child.parent_from_link.position).collect();
        let own: Vec<DVec3> =
            model.geoms.iter().filter(|geom| geom.link == link).map(|geom| geom.link_from_geom.position).collect();
        if ends.len() >= 3 && own.is_empty() {
            let both = |p: &DVec3| [-THICK, THICK].map(|z| [p.x, p.y, p.z + z]);
            let points: Vec<f64> = ends.iter().flat_map(both).flatten().collect();
            all.push(json!({"link": link, "kind": "hull", "size": points}));
            continue;
        }
        if ends.is_empty() {
            ends = own;
        }
        if ends.is_empty() {
            // Nothing hangs on it and nothing says its shape: an even rod ends as far beyond its centre of mass as it begins before it.
            ends = vec![2.0 * model.links[link].com];
        }
        let sticks = ends.iter().filter(|end| end.length() > SHORT);
        all.extend(sticks.map(|end| json!({"link": link, "kind": "stick", "size": [end.x, end.y, end.z]})));
    }
    all
}

/// x, y, z, quaternion x, y, z, w.
fn pose(pose: &qv_core::Pose) -> [f64; 7] {
    let ([w, x, y, z], p) = (pose.wxyz(), pose.position);
    [p.x, p.y, p.z, x, y, z, w]
}

/// The motion of a recording; what could not be simulated is reported.
///
/// # Errors
/// The recording or its robot cannot be read.
pub fn of(
    path: &Path,
    reading: &Reading,
    mesh: Option<&TriangleMesh>,
    parts: &Parts,
    remarks: &mut Vec<String>,
) -> Result<(Motion, Run), Failure> {
    let mut run = open_run(&RunArguments { run: path.into(), reading: reading.clone() })?;
    let model = model_of(&run, path, reading.robot.as_deref())?;
    let terrain = match mesh {
        None => Terrain::plane(),
        Some(mesh) => Terrain::from_mesh(mesh)?,
    };
    let plain = ReplayOptions::default();
    find_gains(slice::from_mut(&mut run), &model, &terrain, &plain.parameters)?;
    let simulated = simulate(&run, &model, &terrain, &plain)?;
    let (kept, time) = kept(&simulated.recorded.time);
    let track = |name, trace: &Trace| track(name, &model, &simulated.feet, [trace, &simulated.recorded], &kept);
    let mut tracks = vec![track("recorded", &simulated.recorded)];
    match simulated.ran_away {
        None => tracks.push(track("simulated", &simulated.whole)),
        Some(at) => remarks.push(format!("the simulation ran away at {at:.1} s: it is not shown")),
    }
    if let Some(file) = &parts.calibrated {
        let options = ReplayOptions { parameters: parameters_of(Some(file), &model, &terrain)?, ..plain };
        let corrected = simulate(&run, &model, &terrain, &options)?;
        match corrected.ran_away {
            None => tracks.push(track("corrected", &corrected.whole)),
            Some(at) => {
                remarks.push(format!("with the corrections the simulation ran away at {at:.1} s: it is not shown"))
            }
        }
    }
    Ok((Motion { model, time, tracks }, run))
}

/// Indices of the instants that are shown, and their times.
fn kept(time: &[f64]) -> (Vec<usize>, Vec<f64>) {
    let span = time.last().unwrap_or(&0.0) - time.first().unwrap_or(&0.0);
    let step = (1.0 / RATE).max(span / MOST as f64);
    let (mut kept, mut next) = (Vec::new(), f64::NEG_INFINITY);
    for (k, t) in time.iter().enumerate() {
        if *t >= next {
            kept.push(k);
            next = t + step - 1e-9;
        }
    }
    let times = kept.iter().map(|&k| time[k]).collect();
    (kept, times)
}

/// Poses of all links at the instants `kept`, and forces on feet. A robot that is held stands at the origin.
fn track(name: &'static str, model: &Model, feet: &Feet, [trace, recorded]: [&Trace; 2], kept: &[usize]) -> Track {
    let (n, links, count) = (model.joints.len(), model.links.len(), feet.geoms.len());
    let is_known = count > 0 && trace.foot_force.len() == count * trace.time.len();
    let usual = if is_known { usual_force(&trace.foot_force) } else { None };
    let mut on_feet = Vec::new();
    // A recorded position that is missing is where it was last: a robot without a leg shows less.
    let (mut last, mut base) = (vec![0.0; n], None);
    let mut all = Vec::with_capacity(kept.len() * links * 7);
    for &k in kept {
        let row = trace.position.get(k * n..(k + 1) * n).unwrap_or(&[]);
        row.iter().zip(&mut last).filter(|(x, _)| x.is_finite()).for_each(|(x, last)| *last = *x);
        let is_there = row.iter().any(|x| x.is_finite());
        let mut q = Vec::with_capacity(model.nq());
        if model.base_dofs() > 0 {
            let here = trace.base.get(k).or(recorded.base.get(k)).filter(|pose| pose.iter().all(|x| x.is_finite()));
            base = here.copied().or(base);
            q.extend(base.unwrap_or([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]));
        }
        q.extend(&last);
        if is_there && q.len() == model.nq() {
            let poses = model.world_from_links(&q);
            all.extend(poses.iter().flat_map(|link| pose(link).map(|x| x as f32)));
            if usual.is_some() {
                let soles = feet.geoms.iter().map(|&geom| sole(model, &poses, geom));
                let with_force = soles.zip(&trace.foot_force[k * count..]);
                on_feet.extend(with_force.flat_map(|(at, force)| [at.x, at.y, at.z, *force].map(|x| x as f32)));
            }
        } else {
            all.extend(std::iter::repeat_n(f32::NAN, links * 7));
            on_feet.extend(std::iter::repeat_n(f32::NAN, if usual.is_some() { count * 4 } else { 0 }));
        }
    }
    Track { name, poses: all, forces: usual.map(|usual| Forces { feet: on_feet, usual }) }
}

/// Where a foot would touch ground below it \[m\].
fn sole(model: &Model, poses: &[qv_core::Pose], geom: usize) -> DVec3 {
    let geom = &model.geoms[geom];
    let radius = if let Shape::Sphere(radius) = geom.shape { radius } else { 0.0 };
    poses[geom.link].transform_point(geom.link_from_geom.position) - radius * DVec3::Z
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_sim::{BaseKind, ModelOptions};

    /// An arm without shapes is drawn up to its end.
    #[test]
    fn each_link_of_an_arm_without_shapes_has_a_stick() {
        let inertia = "<inertia ixx='0.001' iyy='0.001' izz='0.001' ixy='0' ixz='0' iyz='0'/>";
        let link = |name: &str| {
            format!(
                "<link name='{name}'><inertial><origin xyz='0.1 0 0'/><mass value='0.2'/>{inertia}</inertial></link>"
            )
        };
        let joint = |name: &str, from: &str, to: &str| {
            format!(
                "<joint name='{name}' type='revolute'><parent link='{from}'/><child link='{to}'/><origin xyz='0.15 0 0'/><axis xyz='0 1 0'/><limit lower='-1' upper='1' effort='9' velocity='9'/></joint>"
            )
        };
        let (upper, lower) = (link("upper"), link("lower"));
        let (shoulder, elbow) = (joint("shoulder", "base", "upper"), joint("elbow", "upper", "lower"));
        let text = format!("<robot name='arm'><link name='base'/>{shoulder}{upper}{elbow}{lower}</robot>");
        let options = ModelOptions { base: BaseKind::Fixed, ..Default::default() };
        let model = Model::from_urdf(&text, &options).unwrap();
        let ends: Vec<f64> = sticks(&model).iter().map(|stick| stick["size"][0].as_f64().unwrap()).collect();
        // To the elbow, and from there twice as far as the centre of mass.
        assert!(ends.len() == 2 && (ends[0] - 0.15).abs() < 1e-9 && (ends[1] - 0.2).abs() < 1e-9, "{ends:?}");
    }

    #[test]
    fn instants_are_at_most_twenty_five_a_second() {
        let time: Vec<f64> = (0..5000).map(|k| 0.002 * f64::from(k)).collect();
        let (indices, times) = kept(&time);
        assert_eq!((indices.len(), indices[1], times[1]), (250, 20, 0.04));
        let long: Vec<f64> = (0..500_000).map(|k| 0.002 * f64::from(k)).collect();
        assert!(kept(&long).0.len() <= MOST + 1);
        assert!(kept(&[]).0.is_empty());
    }
}
