//! Models drawn from bytes, stepped in batches: debug builds check each access to the arrays of the engine. The fuzz target `batch_steps`
//! does the same with other bytes.

use qv_sim::qv_core::TriangleMesh;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain, glam::DVec3};
use std::fmt::Write;

/// Links of a drawn model, at most.
const LINKS: u8 = 14;

/// Bytes that say what is drawn; zeros after their end.
struct Bytes<'a>(std::slice::Iter<'a, u8>);

impl Bytes<'_> {
    fn next(&mut self) -> u8 {
        self.0.next().copied().unwrap_or(0)
    }

    fn below(&mut self, most: u8) -> u8 {
        self.next() % most
    }

    /// From -1 to 1.
    fn number(&mut self) -> f64 {
        f64::from(self.next()) / 127.5 - 1.0
    }

    fn three(&mut self, scale: f64) -> String {
        let mut one = || scale * self.number();
        format!("{} {} {}", one(), one(), one())
    }
}

fn shape(bytes: &mut Bytes) -> String {
    let mut size = || 0.02 + 0.1 * bytes.number().abs();
    let geometry = match (size(), size(), size()) {
        (a, b, c) if a < 0.045 => format!("<box size='{a} {b} {c}'/>"),
        (a, b, _) if a < 0.07 => format!("<cylinder radius='{a}' length='{b}'/>"),
        (a, _, _) => format!("<sphere radius='{a}'/>"),
    };
    let origin = bytes.three(0.1);
    format!("<collision><origin xyz='{origin}'/><geometry>{geometry}</geometry></collision>")
}

fn urdf(bytes: &mut Bytes) -> String {
    let count = 1 + bytes.below(LINKS);
    let mut text = String::from("<robot name='drawn'>");
    for k in 0..count {
        let shapes: String = (0..bytes.below(3)).map(|_| shape(bytes)).collect();
        let mass = 0.05 + bytes.number().abs();
        _ = write!(
            text,
            "<link name='l{k}'><inertial><origin xyz='{}'/><mass value='{mass}'/><inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' \
             ixz='0' iyz='0'/></inertial>{shapes}</link>",
            bytes.three(0.05)
        );
    }
    for k in 1..count {
        let kind =
            ["revolute", "continuous", "prismatic", "fixed", "revolute", "revolute"][usize::from(bytes.below(6))];
        let axis = ["1 0 0", "0 1 0", "0 0 1", "0.6 0 0.8"][usize::from(bytes.below(4))];
        let (parent, origin) = (bytes.below(k), bytes.three(0.2));
        _ = write!(
            text,
            "<joint name='j{k}' type='{kind}'><parent link='l{parent}'/><child link='l{k}'/><origin xyz='{origin}'/><axis xyz='{axis}'/>\
             <limit lower='-0.5' upper='0.5' effort='20' velocity='20'/></joint>"
        );
    }
    text + "</robot>"
}

fn terrain(bytes: &mut Bytes) -> Terrain {
    match bytes.below(3) {
        0 => Terrain::plane(),
        1 => Terrain::none(),
        _ => {
            let mut mesh = TriangleMesh::default();
            let side = 4;
            for k in 0..side * side {
                let (x, y) = (f64::from(k % side) - 1.5, f64::from(k / side) - 1.5);
                mesh.vertices.push(DVec3::new(x, y, 0.2 * bytes.number()));
            }
            for k in (0..side * (side - 1)).filter(|k| k % side + 1 < side) {
                mesh.triangles.extend([[k, k + 1, k + side], [k + 1, k + side + 1, k + side]]);
            }
            Terrain::from_mesh(&mesh).unwrap_or_else(|_| Terrain::plane())
        }
    }
}

/// Draws a model, a ground, options and commands, and steps them. True where they were a robot.
pub fn step(bytes: &[u8]) -> bool {
    let bytes = &mut Bytes(bytes.iter());
    let base = if bytes.below(2) == 0 { BaseKind::Floating } else { BaseKind::Fixed };
    let (count, is_single, self_collision) =
        (1 + usize::from(bytes.below(9)), bytes.below(2) == 0, bytes.below(2) == 0);
    let options = SimOptions { self_collision, ..Default::default() };
    let ground = terrain(bytes);
    let text = urdf(bytes);
    let Ok(model) = Model::from_urdf(&text, &ModelOptions { base, ..Default::default() }) else { return false };
    if is_single {
        run::<f32>(&model, &ground, &options, count, bytes)
    } else {
        run::<f64>(&model, &ground, &options, count, bytes)
    }
}

fn run<T: qv_sim::Precision>(
    model: &Model,
    ground: &Terrain,
    options: &SimOptions,
    count: usize,
    bytes: &mut Bytes,
) -> bool {
    let Ok(mut batch) = Batch::<T>::new(model, ground, options, count) else { return false };
    let joints = model.joints.len();
    for _ in 0..3 {
        for env in 0..count {
            let q: Vec<f64> = (0..joints).map(|_| bytes.number()).collect();
            let (zero, gain) = (vec![0.0; joints], vec![20.0; joints]);
            let command = JointCommand { q: &q, dq: &zero, kp: &gain, kd: &zero, tau: &zero };
            batch.set_command(env, &command).expect("a command of finite numbers");
        }
        batch.step_many(4);
    }
    for env in 0..count {
        let state = batch.state(env).expect("the environment exists");
        assert!(state.q.iter().chain(&state.v).all(|x| x.is_finite()), "{state:?}");
    }
    true
}
