//! Depth maps of the synthetic yard, with noise, to a labelled collision mesh; prints how good it is and how long it took:
//! `cargo run --release -p quadverse-mesh --example mesh_yard -- [VOXEL] [NOISE] [OUT.glb] [ROUNDS OF SMOOTHING]`, in metres.

use qv_core::Material;
use qv_mesh::close::close_to_solid;
use qv_mesh::compare::compare;
use qv_mesh::files::glb;
use qv_mesh::labels::LabelledPoints;
use qv_mesh::{DepthFrame, FuseOptions, MeshOptions, Topology, fuse, surface};
use std::time::Instant;
use yard::noise::Random;
use yard::{Yard, layout};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, default: f64| arguments.get(k).map_or(Ok(default), |text| text.parse());
    let (voxel, noise) = (number(0, 0.01)?, number(1, 0.01)?);
    let yard = Yard::new(40, 320, 240, 1)?;
    let mut points = LabelledPoints::new(layout::MATERIALS.len());
    let mut frames = Vec::new();
    for (view, camera) in yard.cameras.iter().enumerate() {
        let photo = yard.photo(view);
        let mut random = Random::new(5, view as u64);
        let depth =
            photo.depth.iter().map(|d| if *d > 0.0 { d + (noise * random.normal()) as f32 } else { 0.0 }).collect();
        let frame = DepthFrame { camera: *camera, depth, weight: vec![] };
        points.add_image(&frame, &photo.labels, 2, view)?;
        frames.push(frame);
    }
    let materials: Vec<Material> = yard.mesh.materials.clone();

    let clock = Instant::now();
    let volume = fuse(&frames, &FuseOptions { voxel, ..Default::default() })?;
    let fused = clock.elapsed().as_secs_f64();
    let smoothing = number(3, 3.0)? as usize;
    let options = MeshOptions { smoothing, triangles: Some(40_000), max_error: 0.6 * voxel, ..Default::default() };
    let (mut mesh, report) = surface(&volume, Some((&points, &materials)), &options)?;
    println!("{fused:.2} s to fuse, {:.2} s in all\n{report:#?}", clock.elapsed().as_secs_f64());
    // The walls and floor of the solid are no part of the yard, so that the surface is compared before it is closed.
    for likeness in compare(&mesh, &yard.mesh, &[0.01, 0.02, 0.05], 400_000)? {
        let (precision, recall) = (likeness.precision, likeness.recall);
        println!("F1 at {} m: {:.4} ({precision:.4}, {recall:.4})", likeness.distance, likeness.f1());
    }
    close_to_solid(&mut mesh, 0.2);
    println!("closed: {:?}", Topology::of(&mesh));
    if let Some(path) = arguments.get(2) {
        std::fs::write(path, glb::write(&mesh))?;
    }
    Ok(())
}
