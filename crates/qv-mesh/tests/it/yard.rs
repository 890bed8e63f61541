//! The synthetic yard from its depth with noise: how close the mesh is to the truth, and that it is a solid.

use crate::facts::States;
use glam::DVec3;
use qv_core::{Camera, Pose, TriangleMesh};
use qv_mesh::close::close_to_solid;
use qv_mesh::compare::{compare, sample};
use qv_mesh::labels::LabelledPoints;
use qv_mesh::{
    DepthFrame, FuseOptions, MeshError, MeshOptions, PointGrid, Topology, Volume, extract, finish, fuse, surface,
};
use yard::noise::Random;
use yard::{Yard, layout};

/// Depth of all views with noise of a deviation \[m\], and labelled points of every third pixel.
fn captured(yard: &Yard, noise: f64) -> (Vec<DepthFrame>, LabelledPoints) {
    let mut points = LabelledPoints::new(layout::MATERIALS.len());
    let mut frames = Vec::new();
    for (view, camera) in yard.cameras.iter().enumerate() {
        let photo = yard.photo(view);
        let mut random = Random::new(5, view as u64);
        let noisy = |d: &f32| if *d > 0.0 { d + (noise * random.normal()) as f32 } else { 0.0 };
        let frame = DepthFrame { camera: *camera, depth: photo.depth.iter().map(noisy).collect(), weight: vec![] };
        points.add_image(&frame, &photo.labels, 3, view).unwrap();
        frames.push(frame);
    }
    (frames, points)
}

/// Slope \[degrees\] of the plane through points, by least squares of z.
fn slope(points: &[DVec3]) -> f64 {
    let mean = points.iter().sum::<DVec3>() / points.len() as f64;
    let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for p in points.iter().map(|p| *p - mean) {
        (xx, xy, yy) = (xx + p.x * p.x, xy + p.x * p.y, yy + p.y * p.y);
        (xz, yz) = (xz + p.x * p.z, yz + p.y * p.z);
    }
    let determinant = xx * yy - xy * xy;
    let (a, b) = ((yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant);
    a.hypot(b).atan().to_degrees()
}

/// Share of the area of a mesh whose material is that of the true surface nearest to it.
fn label_accuracy(mesh: &TriangleMesh, truth: &TriangleMesh) -> f64 {
    let split = |mesh: &TriangleMesh, label: u16| {
        let keep: Vec<[u32; 3]> =
            (0..mesh.triangles.len()).filter(|t| mesh.labels[*t] == label).map(|t| mesh.triangles[t]).collect();
        TriangleMesh { triangles: keep, labels: vec![], materials: vec![], ..mesh.clone() }
    };
    let area = |mesh: &TriangleMesh| Topology::of(mesh).area;
    let labels = truth.materials.len() as u16;
    let mut points = Vec::new();
    let mut label_of = Vec::new();
    for label in 0..labels {
        let part = split(truth, label);
        points.extend(sample(&part, (20_000.0 * area(&part)) as usize, 7).unwrap());
        label_of.resize(points.len(), label);
    }
    let grid = PointGrid::new(&points, 0.03).unwrap();
    let (mut right, mut all) = (0, 0);
    for label in 0..labels {
        let part = split(mesh, label);
        for p in sample(&part, (2_000.0 * area(&part)) as usize, 9).unwrap() {
            all += 1;
            right += usize::from(grid.nearest(p, 0.1).is_some_and(|(i, _)| label_of[i] == label));
        }
    }
    f64::from(right as u32) / f64::from(all)
}

/// Measured, voxels of 2 cm, noise of 1 cm: F1 0.991 at 2 cm.
#[test]
fn the_yard_comes_back() {
    let yard = Yard::new(40, 320, 240, 1).unwrap();
    let (frames, points) = captured(&yard, 0.01);
    let volume = fuse(&frames, &FuseOptions::default()).unwrap();
    let options = MeshOptions { triangles: Some(40_000), ..Default::default() };
    let labels = Some((&points, yard.mesh.materials.as_slice()));
    let (mesh, report) = surface(&volume, labels, &options).unwrap();
    mesh.validate().unwrap();
    let f1 = compare(&mesh, &yard.mesh, &[0.02], 200_000).unwrap()[0];
    let accuracy = label_accuracy(&mesh, &yard.mesh);
    let [x0, x1, y0, y1] = layout::RAMP;
    let on_ramp = |p: &DVec3| p.x > x0 + 0.15 && p.x < x1 - 0.15 && p.y > y0 + 0.15 && p.y < y1 - 0.15;
    let ramp: Vec<DVec3> = sample(&mesh, 200_000, 3).unwrap().into_iter().filter(on_ramp).collect();
    let angle = slope(&ramp);
    println!("F1 {:.4}, labels {accuracy:.4}, ramp {angle:.3} degrees, {report:?}", f1.f1());
    assert!(f1.f1() >= 0.98 && accuracy >= 0.97, "{f1:?} {accuracy}");
    assert!((angle - layout::RAMP_DEGREES).abs() < 0.2, "{angle}");
    assert!(report.decimated.after < 60_000 && report.decimated.error <= options.max_error, "{report:?}");

    let mut solid = mesh;
    close_to_solid(&mut solid, 0.2);
    let topology = Topology::of(&solid);
    assert!(topology.is_watertight() && topology.pinched_vertices == 0, "{topology:?}");
    assert_eq!((topology.components, solid.labels.len()), (1, solid.triangles.len()));
    // A floor 0.2 m below the lowest point, walls up to the rim at 0.4 m.
    assert!((7.0..12.0).contains(&topology.volume), "{topology:?}");
}

#[test]
fn threads_change_no_bit() {
    let yard = Yard::new(6, 96, 72, 2).unwrap();
    let (frames, points) = captured(&yard, 0.01);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let volume = fuse(&frames, &FuseOptions { voxel: 0.04, ..Default::default() }).unwrap();
            let options = MeshOptions { triangles: Some(4000), ..Default::default() };
            let (mesh, _) = finish(&volume, Some((&points, &yard.mesh.materials)), &options).unwrap();
            (qv_mesh::files::ply::write(&mesh), compare(&mesh, &yard.mesh, &[0.05], 5000).unwrap())
        })
    };
    let (bytes, likeness) = on(1);
    assert!(bytes.len() > 50_000);
    for threads in [2, 5] {
        let other = on(threads);
        assert!(bytes == other.0 && likeness == other.1, "{threads} threads");
    }
}

/// A camera above flat ground 7 mm up that looks straight down and sees twice its height along each side.
fn above(x: f64, y: f64, height: f64, side: u32) -> DepthFrame {
    let rotation = glam::DQuat::from_rotation_x(std::f64::consts::PI);
    let camera_from_world = Pose { position: DVec3::new(x, y, height), rotation }.inverse();
    let (focal, centre) = (f64::from(side) * 0.5, 0.5 * f64::from(side));
    let camera = Camera { fx: focal, fy: focal, cx: centre, cy: centre, width: side, height: side, camera_from_world };
    DepthFrame { camera, depth: vec![height as f32 - 0.007; (side * side) as usize], weight: vec![] }
}

/// Memory grows with the area: four times the ground takes four times the blocks, half the voxel as well. At 1 cm voxels 30 x 30 m
/// of flat ground would take 0.6 GB.
#[test]
fn memory_is_linear_in_surface() {
    let blocks = |tiles: i32, voxel: f64| {
        let mut volume = Volume::new(&FuseOptions { voxel, ..Default::default() }).unwrap();
        for i in 0..tiles * tiles {
            // Tiles of 2 x 2 m.
            let (x, y) = (f64::from(i % tiles) * 2.0, f64::from(i / tiles) * 2.0);
            volume.allocate(&above(x, y, 1.0, 200), i as usize).unwrap();
        }
        (volume.block_count() as f64, volume.memory() as f64)
    };
    let ((small, _), (large, bytes), (fine, _)) = (blocks(4, 0.02), blocks(8, 0.02), blocks(4, 0.01));
    println!("{small} {large} {fine}");
    assert!((large / small / 4.0 - 1.0).abs() < 0.1, "{small} {large}");
    assert!((fine / small / 4.0 - 1.0).abs() < 0.1, "{small} {fine}");
    // 256 m² at 2 cm are 64 m² at 1 cm.
    let whole = bytes / 64.0 * 900.0;
    println!("30 x 30 m at 1 cm: {:.2} GB", whole / 1e9);
    assert!(whole < 2e9, "{whole} bytes");
}

#[test]
fn flat_ground_is_exact_across_blocks() {
    let frames = [above(0.0, 0.0, 1.0, 120), above(0.3, 0.2, 1.1, 120)];
    let mesh = extract(&fuse(&frames, &FuseOptions::default()).unwrap());
    let topology = Topology::of(&mesh);
    assert!(mesh.vertices.iter().all(|v| (v.z - 0.007).abs() < 1e-5), "a plane");
    assert_eq!((topology.components, topology.crowded_edges, topology.twisted_edges, topology.euler), (1, 0, 0, 1));
    // It looks up, at the cameras.
    let [a, b, c] = mesh.corners(0);
    assert!((b - a).cross(c - a).z > 0.0 && topology.area > 4.0, "{topology:?}");
}

#[test]
fn what_cannot_be_fused_is_named() {
    let good = above(0.0, 0.0, 1.0, 60);
    let fault = |frames: &[DepthFrame], options: FuseOptions| fuse(frames, &options).unwrap_err().to_string();
    let plain = FuseOptions::default();
    assert_eq!(fault(&[], plain), "depth frames: expected two or more, found 0");
    assert_eq!(fault(std::slice::from_ref(&good), plain), "depth frames: expected two or more, found 1");
    let empty = DepthFrame { depth: vec![0.0; 3600], ..good.clone() };
    let nan = DepthFrame { depth: vec![f32::NAN; 3600], ..good.clone() };
    assert!(fault(&[empty, nan], plain).states("frames 2"));
    let short = DepthFrame { depth: vec![1.0; 7], ..good.clone() };
    assert!(fault(&[good.clone(), short], plain).states("numbers 1 3600"));
    let mut lost = good.clone();
    lost.camera.camera_from_world.position.x = f64::NAN;
    assert!(fault(&[good.clone(), lost], plain).states("camera 1"));
    let mut far = good.clone();
    far.camera.camera_from_world.position.x = 1e9;
    assert!(fault(&[good.clone(), far], plain).states("origin"));
    let fine = FuseOptions { voxel: 0.001, memory_limit: 1 << 20, ..plain };
    let error = fuse(&[good.clone(), good.clone()], &fine).unwrap_err();
    assert!(matches!(error, MeshError::Memory { limit: 1_048_576, needed, .. } if needed > 10_000_000), "{error}");
    assert!(fault(&[good.clone(), good.clone()], FuseOptions { voxel: -1.0, ..plain }).states("option"));
    // Depth, but nothing that was seen from near enough to count.
    let strict = FuseOptions { min_weight: 900.0, ..plain };
    let volume = fuse(&[good.clone(), good], &strict).unwrap();
    assert!(finish(&volume, None, &MeshOptions::default()).unwrap_err().to_string().states("surface"));
}
