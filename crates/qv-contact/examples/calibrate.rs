//! Calibrates the friction of a ground from a recording of a Go2 on it:
//! `cargo run --release -p quadverse-contact --example calibrate -- run.mcap terrain.glb`; without arguments of one that it
//! makes up, a Go2 that trots on two materials.

use qv_contact::{Ground, Options, calibrate, prior};
use qv_core::{Material, TriangleMesh};
use qv_go2::synthetic::{self, Robot};
use qv_recording::{BagFile, Run, read_bag};
use qv_sim::{BaseKind, Model, ModelOptions, Terrain};
use std::error::Error;
use std::time::Instant;

fn strips(frictions: [f64; 2]) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for (label, (name, friction)) in ["ice", "concrete"].into_iter().zip(frictions).enumerate() {
        mesh.materials.push(Material { name: name.into(), friction: Some(friction) });
        let (first, x) = (mesh.vertices.len() as u32, [[-3.0, 0.5], [0.5, 4.0]][label]);
        for (x, y) in [(x[0], -3.0), (x[1], -3.0), (x[1], 3.0), (x[0], 3.0)] {
            mesh.vertices.push(glam::DVec3::new(x, y, 0.0));
        }
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        mesh.labels.extend([label as u16; 2]);
    }
    mesh
}

fn made_up() -> Result<(Run, TriangleMesh), Box<dyn Error>> {
    let mesh = strips([0.25, 0.8]);
    let robot = Robot { parameters: synthetic::small_differences(1), seed: 1, start: [0.0; 3] };
    let messages = synthetic::record(&Terrain::from_mesh(&mesh)?, &robot)?;
    let mut bytes = Vec::new();
    synthetic::write_bag(&messages, std::io::Cursor::new(&mut bytes))?;
    let file = BagFile { name: "made up".into(), source: std::io::Cursor::new(bytes) };
    Ok((read_bag(vec![file], &qv_go2::wire::mapping(None))?, mesh))
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (run, mesh) = match &arguments[..] {
        [run, terrain] => {
            let file = BagFile { name: run.clone(), source: std::fs::File::open(run)? };
            let mesh = qv_mesh::files::glb::read(&std::fs::read(terrain)?)?;
            (read_bag(vec![file], &qv_go2::wire::mapping(None))?, mesh)
        }
        _ => made_up()?,
    };
    let options = ModelOptions { base: BaseKind::Floating, armature: qv_go2::model::ARMATURE, ..Default::default() };
    let model = Model::from_urdf(&qv_go2::model::urdf(), &options)?;
    let labels = Ground::new(&mesh)?.labels();
    let priors = prior::from_table(&labels, &prior::built_in())?;
    let clock = Instant::now();
    let seconds = || clock.elapsed().as_secs_f64();
    let report = calibrate(&[run], &model, &mesh, &priors, &Options { clock: Some(&seconds), ..Default::default() })?;
    for r in &report.regions {
        let [low, high] = r.posterior.interval90;
        println!(
            "{:<16} prior {:.3} -> {:.3} ({low:.3} to {high:.3}) {:?}, grid {:?}, evidence {:.1}, {:.2} nats, weight {:.3}, contact {:.1} s, slip {:.2}, sensitivity {:.3} {:.3}, windows {}",
            r.label,
            r.prior.mean,
            r.friction,
            r.status,
            r.grid.as_ref().map(|g| g.friction),
            r.evidence,
            r.information,
            r.weight,
            r.contact_time,
            r.slip_share,
            r.sensitivity[0],
            r.sensitivity[1],
            r.windows
        );
    }
    println!("{:?}\n{:?}\n{:?}", report.base_error.held_out, report.base_error.all, report.windows);
    println!("{:.1} s", report.timing.runtime_s);
    Ok(())
}
