//! The Go2 on a mesh of the synthetic yard, made from noisy depth: it stands on every flat square metre without jitter or sinking.

use qv_go2::model::{self, ARMATURE, DEFAULT_KD, DEFAULT_KP, STAND};
use qv_mesh::{DepthFrame, FuseOptions, MeshOptions, reconstruct};
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, State, Terrain};
use yard::Yard;
use yard::layout::HALF;
use yard::noise::Random;

/// Deviation of the depths \[m\].
const NOISE: f64 = 0.01;
/// Time to settle, and time that is watched then, in steps of 2 ms. On a plane, too, the stand swings for two seconds.
const SETTLE: usize = 1750;
const WATCH: usize = 250;
/// How far the base may stand from where it stands on the true ground \[m\].
const HEIGHT: f64 = 0.015;
/// Fastest that the base \[m/s\] and a joint \[rad/s\] may move while watched.
const BASE_SPEED: f64 = 0.01;
const JOINT_SPEED: f64 = 0.1;

fn meshed(yard: &Yard) -> Terrain {
    let frame = |(view, camera)| {
        let photo = yard.photo(view);
        let mut random = Random::new(5, view as u64);
        let noisy = |d: &f32| if *d > 0.0 { d + (NOISE * random.normal()) as f32 } else { 0.0 };
        DepthFrame { camera, depth: photo.depth.iter().map(noisy).collect(), weight: vec![] }
    };
    let frames: Vec<DepthFrame> = yard.cameras.iter().copied().enumerate().map(frame).collect();
    let options = MeshOptions { triangles: Some(40_000), ..Default::default() };
    let (mesh, report) = reconstruct(&frames, None, &FuseOptions::default(), &options).unwrap();
    assert!(report.topology.is_watertight(), "{report:?}");
    Terrain::from_mesh(&mesh).unwrap()
}

/// Middles of the squares of a metre, half a metre apart, whose true ground is level, and its height \[m\].
fn flat_squares(truth: &Terrain) -> Vec<[f64; 3]> {
    let places = (-5..=5).flat_map(|j| (-5..=5).map(move |i| [0.5 * f64::from(i), 0.5 * f64::from(j)]));
    let level = |[x, y]: [f64; 2]| {
        let heights: Option<Vec<f64>> = (0..441)
            .map(|k| {
                let (u, v) = (f64::from(k % 21) / 20.0 - 0.5, f64::from(k / 21) / 20.0 - 0.5);
                let inside = |a: f64| a.clamp(-HALF + 1e-6, HALF - 1e-6);
                truth.height_below(inside(x + u), inside(y + v), 2.0)
            })
            .collect();
        let heights = heights?;
        let (low, high) = heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(*z), h.max(*z)));
        (high - low < 1e-6).then_some([x, y, low])
    };
    places.filter_map(level).collect()
}

fn standing([x, y, ground]: [f64; 3]) -> State {
    let mut q = vec![x, y, ground + 0.02 + model::touching_height(&STAND), 1.0, 0.0, 0.0, 0.0];
    q.extend(STAND);
    State { q, v: vec![0.0; 18] }
}

/// A batch with a robot on each square after it has settled.
fn settled(robot: &Model, terrain: &Terrain, squares: &[[f64; 3]]) -> Batch<f64> {
    let options = SimOptions { timestep: 0.002, ..Default::default() };
    let mut sim = Batch::<f64>::new(robot, terrain, &options, squares.len()).unwrap();
    let (zero, kp, kd) = ([0.0; 12], [DEFAULT_KP; 12], [DEFAULT_KD; 12]);
    for (index, square) in squares.iter().enumerate() {
        sim.set_state(index, &standing(*square)).unwrap();
        sim.set_command(index, &JointCommand { q: &STAND, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
    }
    sim.step_many(SETTLE);
    sim
}

#[test]
fn it_stands_on_every_flat_square_metre_without_jitter_or_sinking() {
    let yard = Yard::new(40, 320, 240, 1).unwrap();
    let truth = Terrain::from_mesh(&yard.mesh).unwrap();
    let squares = flat_squares(&truth);
    assert!(squares.len() >= 30, "{squares:?}");
    assert!(squares.iter().any(|[.., z]| *z > 0.3), "the platform is one of them");
    let options = ModelOptions { base: BaseKind::Floating, armature: ARMATURE, ..Default::default() };
    let robot = Model::from_urdf(&model::urdf(), &options).unwrap();

    // Where it stands on the plane.
    let height = settled(&robot, &Terrain::plane(), &[[0.0; 3]]).state(0).unwrap().q[2];
    let mut sim = settled(&robot, &meshed(&yard), &squares);
    let (mut base, mut joints, mut off): (f64, f64, f64) = (0.0, 0.0, 0.0);
    for _ in 0..WATCH {
        sim.step();
        for (index, square) in squares.iter().enumerate() {
            let State { q, v } = sim.state(index).unwrap();
            let speed = v[..3].iter().map(|v| v * v).sum::<f64>().sqrt();
            let joint = v[6..].iter().fold(0.0, |most, v| f64::max(most, v.abs()));
            let apart = q[2] - square[2] - height;
            assert!(speed < BASE_SPEED && joint < JOINT_SPEED, "{square:?}: {speed} m/s, {joint} rad/s");
            assert!(apart.abs() < HEIGHT && q[3] > 0.998, "{square:?}: {apart} m off, {:?}", &q[3..7]);
            (base, joints, off) = (base.max(speed), joints.max(joint), off.max(apart.abs()));
        }
    }
    println!("{} squares: base {base:.2e} m/s, joints {joints:.2e} rad/s, height off by {off:.4} m", squares.len());
}
