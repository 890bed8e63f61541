//! Two strips of ground, and a simulated Go2 that trots from the first onto the second.

use glam::DVec3;
use qv_contact::Ground;
use qv_contact::measured::Recording;
use qv_contact::simulate::Simulator;
use qv_core::{Material, TriangleMesh};
use qv_go2::synthetic::{self, Robot};
use qv_recording::{BagFile, Run};
use qv_sim::{BaseKind, Model, ModelOptions, Terrain};
use std::io::Cursor;
use std::sync::OnceLock;

/// Label, from and to along x \[m\], friction.
const STRIPS: [(&str, f64, f64, f64); 2] = [("ice", -3.0, 0.45, 0.22), ("concrete", 0.45, 6.0, 0.8)];
/// The frictions that the recording was made with.
pub const TRUTH: [f64; 2] = [STRIPS[0].3, STRIPS[1].3];

/// The labelled ground, with its frictions.
pub fn mesh() -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for (label, (name, x0, x1, friction)) in STRIPS.into_iter().enumerate() {
        mesh.materials.push(Material { name: name.into(), friction: Some(friction) });
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend([(x0, -3.0), (x1, -3.0), (x1, 3.0), (x0, 3.0)].map(|(x, y)| DVec3::new(x, y, 0.0)));
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        mesh.labels.extend([label as u16; 2]);
    }
    mesh
}

/// The nominal Go2.
pub fn go2() -> Model {
    let options = ModelOptions { base: BaseKind::Floating, armature: qv_go2::model::ARMATURE, ..Default::default() };
    Model::from_urdf(&qv_go2::model::urdf(), &options).unwrap()
}

/// The recording, without differences of the robot.
pub fn run() -> &'static Run {
    static MADE: OnceLock<Run> = OnceLock::new();
    MADE.get_or_init(|| run_of(vec![]))
}

/// A recording of a robot with these parameters.
pub fn run_of(parameters: Vec<(String, f64)>) -> Run {
    let robot = Robot { parameters, seed: 3, start: [0.0; 3] };
    let messages = synthetic::record(&Terrain::from_mesh(&mesh()).unwrap(), &robot).unwrap();
    let mut bytes = Cursor::new(vec![]);
    synthetic::write_bag(&messages, &mut bytes).unwrap();
    bytes.set_position(0);
    let files = vec![BagFile { name: "strips".into(), source: bytes }];
    qv_recording::read_bag(files, &qv_go2::wire::mapping(None)).unwrap()
}

/// The recording prepared, and a simulator of the ground with the given frictions.
pub fn prepared<'a>(model: &'a Model, ground: &Ground, frictions: &[f64]) -> (Simulator<'a>, Vec<Recording<'static>>) {
    let terrain = ground.terrain(frictions).unwrap();
    let mut simulator = Simulator::new(run(), model, &terrain, &[]).unwrap();
    let recordings = vec![Recording::new(run(), simulator.rollout(), ground).unwrap()];
    simulator.settle(&recordings[0]).unwrap();
    (simulator, recordings)
}
