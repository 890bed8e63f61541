//! Recordings on ground of several labelled materials, whose frictions only the answers show.

use crate::draw::{ATTEMPTS, EngineChoice, Rejection};
use crate::effects::{Cause, needs_our_engine};
use crate::engine::Engine;
use crate::plant::Plant;
use crate::recipe::{self, Recipe};
use crate::record::{Outcome, record_seen};
use crate::sections::{Plan, Section};
use glam::{DQuat, DVec3};
use qv_core::random::{SplitMix64, sub_seed};
use qv_core::{Material, TriangleMesh};
use qv_go2::gait::Trot;
use qv_go2::model;
use qv_go2::synthetic::{Deviations, Message};
use qv_recording::RecordingError;
use qv_sim::{SensorReading, State};

/// Labels on which a walking robot slips, and the friction that such a label is usually said to have.
pub const SLIPPERY: [(&str, f64); 7] = [
    ("wet_tile", 0.35),
    ("wet_leaves", 0.3),
    ("snow", 0.22),
    ("mud", 0.3),
    ("wet_wood", 0.35),
    ("ice", 0.12),
    ("polished_stone", 0.45),
];
/// Labels that hold a foot, and the friction that such a label is usually said to have.
pub const GRIPPY: [(&str, f64); 6] =
    [("concrete", 0.75), ("asphalt", 0.7), ("carpet", 0.7), ("rubber_mat", 0.9), ("gravel", 0.5), ("grass", 0.55)];

/// True frictions of slippery ground.
const SLIPPERY_RANGE: [f64; 2] = [0.12, 0.4];
/// True frictions of ground that holds.
const GRIPPY_RANGE: [f64; 2] = [0.5, 0.95];
/// Ratio of true to usual friction of slippery ground, either way.
const AWAY: [f64; 2] = [1.3, 2.2];
/// Time that loaded feet must spend on each material, summed over feet \[s\], for each minute of the recording.
const LEAST_ON_EACH: f64 = 6.0;
/// Half of the side of the ground \[m\].
const HALF: f64 = 14.0;

/// Faults of motors, and soft ground, that make friction hard to see.
const FAULTS: [&str; 6] = [
    "motor_strength",
    "command_latency",
    "actuator_lag",
    "joint_coulomb_friction",
    "joint_viscous_friction",
    "contact_compliance",
];

/// What is to be recorded on mixed ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MixedRequest {
    /// Engine.
    pub engine: EngineChoice,
    /// Length \[s\].
    pub seconds: f64,
    /// Faults of the robot, or soft ground where the engine has it, all different; at most 5.
    pub faults: usize,
}

/// A recording on ground of four materials.
#[derive(Debug, Clone, PartialEq)]
pub struct MixedGround {
    /// All about it; `recipe.ground` holds the true frictions.
    pub recipe: Recipe,
    /// Names of the materials that are slippery.
    pub slippery: Vec<&'static str>,
    /// Time that loaded feet spent on each material, summed over feet \[s\]; empty for a redrawn one.
    pub contact_time: Vec<f64>,
    /// Why the draws before it were not taken.
    pub rejected: Vec<Rejection>,
}

impl MixedGround {
    /// The ground as a robot's map has it: labels without friction.
    pub fn labelled(&self) -> TriangleMesh {
        let mut mesh = self.recipe.ground.clone().unwrap_or_default();
        mesh.materials.iter_mut().for_each(|m| m.friction = None);
        mesh
    }
}

/// Draws grounds, robots and walks from sub-seeds of `seed` until the robot stays on its feet and steps on
/// all four materials; with the messages of the recording.
///
/// # Errors
/// When the second engine is asked for and not built in, or no draw of [`ATTEMPTS`] was valid.
pub fn make_mixed(request: MixedRequest, seed: u64) -> Result<(MixedGround, Vec<Message>), RecordingError> {
    let mut rejected = Vec::new();
    for attempt in 0..ATTEMPTS {
        let mut mixed = draw(request, sub_seed(seed, attempt));
        let mut time = vec![0.0; 4];
        let (outcome, messages) = record_seen(&mixed.recipe, |plant, seen, state| {
            add_contact(&mixed.recipe, plant, seen, state, &mut time);
        })?;
        let needed = LEAST_ON_EACH * request.seconds / 60.0;
        match outcome {
            Outcome::Fell { at } => rejected.push(Rejection::Fell(at)),
            Outcome::Stood { .. } if time.iter().any(|t| *t < needed) => rejected.push(Rejection::DoesNotAct),
            Outcome::Stood { .. } => {
                (mixed.contact_time, mixed.rejected) = (time, rejected);
                return Ok((mixed, messages));
            }
        }
    }
    let what = format!("recording on mixed ground from seed {seed}");
    Err(qv_core::Mismatch::new(what, format!("a valid draw among {ATTEMPTS}"), format!("none: {rejected:?}")).into())
}

/// What [`make_mixed`] took after `redraws` rejections, without recording it again.
pub fn redraw_mixed(request: MixedRequest, seed: u64, redraws: u64) -> MixedGround {
    draw(request, sub_seed(seed, redraws))
}

fn draw(MixedRequest { engine, seconds, faults }: MixedRequest, seed: u64) -> MixedGround {
    let mut draws = SplitMix64::new(seed);
    let acts = |fault: &&str| engine == EngineChoice::Ours || !needs_our_engine(fault);
    let mut possible: Vec<&'static str> = FAULTS.into_iter().filter(acts).collect();
    let engine = match engine {
        EngineChoice::Ours => Engine::ours(&mut draws),
        EngineChoice::Second => Engine::second(&mut draws),
    };
    let (materials, slippery) = materials(&mut draws);
    let cell = draws.between(0.6, 0.9);
    let origin = [draws.between(0.0, 2.0 * cell), draws.between(0.0, 2.0 * cell)];
    let mut recipe = Recipe {
        seed: sub_seed(seed, 1),
        engine,
        plan: walks(&mut draws, seconds),
        kp: draws.between(30.0, 60.0),
        kd: draws.between(0.8, 2.0),
        differences: recipe::small_differences(sub_seed(seed, 2)),
        deviations: Deviations::drawn(&mut draws, 0.5, 1.5),
        causes: Vec::new(),
        withheld: None,
        ground: Some(patchwork(materials, cell, origin)),
    };
    for _ in 0..faults.min(possible.len()) {
        let effect = possible.swap_remove(draws.index(possible.len()));
        recipe.causes.extend(Cause::of_any_motion(effect, &mut draws));
    }
    MixedGround { recipe, slippery, contact_time: Vec::new(), rejected: Vec::new() }
}

/// Four materials, two or three of them slippery, in a drawn order.
fn materials(draws: &mut SplitMix64) -> (Vec<Material>, Vec<&'static str>) {
    let count = 2 + draws.index(2);
    let slippery = pick(draws, &SLIPPERY, count);
    let grippy = pick(draws, &GRIPPY, 4 - count);
    let mut all: Vec<Material> = Vec::new();
    for (name, usual) in &slippery {
        all.push(Material { name: (*name).into(), friction: Some(away(draws, *usual)) });
    }
    for (name, usual) in grippy {
        let friction = (usual * draws.between(0.85, 1.2)).clamp(GRIPPY_RANGE[0], GRIPPY_RANGE[1]);
        all.push(Material { name: name.into(), friction: Some(friction) });
    }
    let turn = draws.index(4);
    all.rotate_left(turn);
    (all, slippery.into_iter().map(|(name, _)| name).collect())
}

fn pick(draws: &mut SplitMix64, from: &[(&'static str, f64)], count: usize) -> Vec<(&'static str, f64)> {
    let mut left = from.to_vec();
    (0..count).map(|_| left.swap_remove(draws.index(left.len()))).collect()
}

/// A friction away from the usual one, among those of slippery ground.
fn away(draws: &mut SplitMix64, usual: f64) -> f64 {
    let [low, high] = SLIPPERY_RANGE;
    loop {
        let ratio = draws.between(AWAY[0], AWAY[1]);
        let friction = if draws.chance(0.5) { usual * ratio } else { usual / ratio };
        if (low..high).contains(&friction) {
            return friction;
        }
    }
}

/// Flat squares of side `cell` \[m\], four materials in a pattern of two by two that repeats.
fn patchwork(materials: Vec<Material>, cell: f64, origin: [f64; 2]) -> TriangleMesh {
    let mut mesh = TriangleMesh { materials, ..Default::default() };
    let count = (HALF / cell).ceil() as i64;
    for i in -count..count {
        for j in -count..count {
            let [x, y] = [i as f64 * cell + origin[0] - cell, j as f64 * cell + origin[1] - cell];
            let first = mesh.vertices.len() as u32;
            for (dx, dy) in [(0.0, 0.0), (cell, 0.0), (cell, cell), (0.0, cell)] {
                mesh.vertices.push(DVec3::new(x + dx, y + dy, 0.0));
            }
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            mesh.labels.extend([(i.rem_euclid(2) + 2 * j.rem_euclid(2)) as u16; 2]);
        }
    }
    mesh
}

/// It stands, then walks in several gaits, straight and in turns either way, and stands again.
fn walks(draws: &mut SplitMix64, seconds: f64) -> Plan {
    let standing = 1.0;
    let count = ((seconds - 2.0 * standing) / 8.0).round().max(1.0);
    let length = (seconds - 2.0 * standing) / count;
    let mut sections = vec![(Section::Stand, standing)];
    for _ in 0..count as usize {
        let gait = Trot {
            frequency: draws.between(1.6, 2.6),
            swing: draws.between(0.16, 0.28),
            lift: draws.between(0.45, 0.7),
            lift_delay: draws.between(0.3, 0.5),
            ..Default::default()
        };
        let turn = if draws.chance(0.3) { 0.0 } else { draws.between(-0.35, 0.35) };
        sections.push((Section::Trot { gait, turn }, length));
    }
    sections.push((Section::Stand, standing));
    Plan { sections }
}

/// Adds 2 ms for each loaded foot to the time of the material under it.
fn add_contact(recipe: &Recipe, plant: &Plant, seen: &SensorReading, state: &State, time: &mut [f64]) {
    let Some(mesh) = &recipe.ground else { return };
    let q = &state.q;
    let turn = DQuat::from_xyzw(q[4], q[5], q[6], q[3]);
    let feet = model::foot_positions(&std::array::from_fn(|j| q[7 + j]));
    for leg in 0..4 {
        let geoms = plant.model().geoms.iter().zip(&seen.foot_force);
        let is_loaded = geoms
            .filter(|(g, _)| plant.model().links[g.link].name == model::FOOT_LINKS[leg])
            .any(|(_, force)| *force > 5.0);
        let foot = DVec3::new(q[0], q[1], q[2]) + turn * feet[leg];
        if let (true, Some(label)) = (is_loaded, label_at(mesh, foot.x, foot.y)) {
            time[label] += 0.002;
        }
    }
}

/// Material of the square that holds a place: squares come in the order in which [`patchwork`] makes them.
fn label_at(mesh: &TriangleMesh, x: f64, y: f64) -> Option<usize> {
    let (low, high) = (mesh.vertices.first()?, mesh.vertices.get(2)?);
    let (cell, count) = (high.x - low.x, ((mesh.triangles.len() / 2) as f64).sqrt().round());
    let (i, j) = (((x - low.x) / cell).floor(), ((y - low.y) / cell).floor());
    let is_inside = (0.0..count).contains(&i) && (0.0..count).contains(&j);
    let square = (i * count + j) as usize;
    is_inside.then(|| mesh.labels.get(2 * square).map(|l| usize::from(*l))).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frictions_lie_away_from_the_usual_ones_and_in_their_ranges() {
        for seed in 0..200 {
            let (materials, slippery) = materials(&mut SplitMix64::new(seed));
            assert_eq!(materials.len(), 4);
            assert!((2..=3).contains(&slippery.len()));
            for material in &materials {
                let friction = material.friction.unwrap();
                match SLIPPERY.iter().find(|(name, _)| *name == material.name) {
                    Some((_, usual)) => {
                        assert!((0.12..0.4).contains(&friction));
                        assert!((friction / usual).ln().abs() > 1.29_f64.ln());
                    }
                    None => assert!((0.5..=0.95).contains(&friction)),
                }
            }
        }
    }

    #[test]
    fn squares_are_found_by_place() {
        let names = ["a", "b", "c", "d"].map(|name| Material { name: name.into(), friction: Some(0.5) });
        let mesh = patchwork(names.to_vec(), 0.7, [0.3, 0.1]);
        mesh.validate().unwrap();
        for (triangle, label) in mesh.labels.iter().enumerate().step_by(37) {
            let [a, b, c] = mesh.corners(triangle);
            let middle = (a + b + c) / 3.0;
            assert_eq!(label_at(&mesh, middle.x, middle.y), Some(usize::from(*label)));
        }
        assert_eq!(label_at(&mesh, 99.0, 0.0), None);
    }

    #[test]
    fn the_map_tells_no_friction() {
        let request = MixedRequest { engine: EngineChoice::Ours, seconds: 20.0, faults: 0 };
        let mixed = draw(request, 3);
        assert!(mixed.labelled().materials.iter().all(|m| m.friction.is_none()));
        assert!((mixed.recipe.plan.duration() - 20.0).abs() < 1e-9);
        assert_eq!(mixed, draw(request, 3));
    }

    #[test]
    fn faults_differ_and_leave_all_else_as_it_was() {
        for seed in 0..20 {
            let of = |engine, faults| draw(MixedRequest { engine, seconds: 20.0, faults }, seed);
            let (sound, faulty) = (of(EngineChoice::Second, 0), of(EngineChoice::Second, 5));
            let mut names: Vec<&str> = faulty.recipe.causes.iter().map(|cause| cause.effect).collect();
            assert_eq!((sound.recipe.causes.len(), names.len()), (0, 5));
            assert!(!names.contains(&"contact_compliance"), "the second engine hardly shows it: {names:?}");
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), 5);
            assert_eq!((sound.recipe.ground, sound.slippery), (faulty.recipe.ground, faulty.slippery));
        }
    }
}
