//! Derivatives of Gaussians in groups that move: those of the same Gaussians where the group puts them.

use glam::{DQuat, DVec3};
use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::{Frame, Gradients, Image, Outputs, Scene, Settings, View};

/// Numbers from -1 to 1 (Knuth's linear congruential generator).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

const COUNT: usize = 40;
const SETTINGS: Settings =
    Settings { outputs: Outputs { depth: true, plane: false, features: true }, background: [0.2; 3], antialias: false };

fn camera() -> Camera {
    Camera { fx: 60.0, fy: 64.0, cx: 32.0, cy: 24.0, width: 64, height: 48, camera_from_world: Pose::IDENTITY }
}

fn cloud(degree: u8) -> GaussianCloud {
    let mut r = Numbers(5);
    let mut out = GaussianCloud { sh_degree: degree, feature_count: 2, ..Default::default() };
    for _ in 0..COUNT {
        let depth = 2.5 + r.next();
        out.means.push([0.5 * depth * r.next(), 0.4 * depth * r.next(), depth]);
        out.log_scales.push([0; 3].map(|_| -2.2 + 0.8 * r.next()));
        out.rotations.push([0; 4].map(|_| r.next()));
        out.opacity_logits.push(1.0 + 2.0 * r.next());
        for k in 0..out.sh_count() {
            out.sh.push([0; 3].map(|_| if k == 0 { r.next() } else { 0.3 * r.next() }));
        }
        out.features.extend([r.next(), r.next()]);
    }
    out
}

fn poses() -> [Pose; 2] {
    let of = |position, turn| Pose::from_position_wxyz(position, turn).unwrap();
    [of([0.2, -0.1, 0.2], [1.0, 0.1, 0.2, -0.2]), of([-0.15, 0.1, 0.1], [1.0, -0.2, 0.1, 0.25])]
}

fn gradients(scene: &Scene, view: View) -> Gradients {
    let frame = Frame::new(scene, &[view], &SETTINGS).unwrap();
    let mut r = Numbers(9);
    let mut by: Vec<Image> = frame.blank_images();
    let Image { colour, alpha, depth, features, .. } = &mut by[0];
    for values in [colour, alpha, depth, features] {
        values.iter_mut().for_each(|x| *x = r.next());
    }
    frame.gradients(scene, &by).unwrap()
}

fn assert_same(name: &str, a: &[f32], b: &[f32]) {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| *a as f64 * *b as f64).sum::<f64>();
    let (aa, bb, ab) = (dot(a, a), dot(b, b), dot(a, b));
    assert!(aa > 0.0, "{name}: nothing to compare");
    assert!(1.0 - ab / (aa * bb).sqrt() < 1e-8 && ((bb / aa).sqrt() - 1.0).abs() < 1e-4, "{name}: {aa} {bb} {ab}");
}

#[test]
fn a_cloud_in_one_group_is_a_moved_camera() {
    let (cloud, group_of) = (cloud(3), vec![1; COUNT]);
    let environments = [vec![None], vec![Some(poses()[0])]];
    let scene = Scene { cloud: &cloud, group_of: &group_of, environments: &environments };
    let found = gradients(&scene, View { camera: camera(), environment: 1 });
    let moved = Camera { camera_from_world: camera().camera_from_world * poses()[0], ..camera() };
    let expected = gradients(&Scene::still(&cloud), View::of(moved));
    assert_same("means", expected.means.as_flattened(), found.means.as_flattened());
    assert_same("rotations", expected.rotations.as_flattened(), found.rotations.as_flattened());
    assert_same("harmonics", expected.sh.as_flattened(), found.sh.as_flattened());
    // Both poses are turned on the side of the camera.
    assert_same("pose", &expected.poses[0], &found.poses[0]);
}

#[test]
fn gaussians_of_several_groups_are_those_of_the_world() {
    let (cloud, poses) = (cloud(0), poses());
    let group_of: Vec<u32> = (0..COUNT as u32).map(|i| i % 3).collect();
    let environments = [vec![None; 2], poses.map(Some).to_vec()];
    let scene = Scene { cloud: &cloud, group_of: &group_of, environments: &environments };
    let mut world = cloud.clone();
    let turns: Vec<DQuat> =
        group_of.iter().map(|&g| if g == 0 { DQuat::IDENTITY } else { poses[g as usize - 1].rotation }).collect();
    for i in (0..COUNT).filter(|i| group_of[*i] > 0) {
        let pose = poses[group_of[i] as usize - 1];
        world.means[i] = pose.transform_point(DVec3::from(cloud.means[i].map(f64::from))).as_vec3().to_array();
        let [w, x, y, z] = cloud.rotations[i].map(f64::from);
        let turned = pose.rotation * DQuat::from_xyzw(x, y, z, w);
        world.rotations[i] = [turned.w, turned.x, turned.y, turned.z].map(|q| q as f32);
    }
    let found = gradients(&scene, View { camera: camera(), environment: 1 });
    let expected = gradients(&Scene::still(&world), View::of(camera()));
    // Back into the axes of each group.
    let back = |i: usize| (turns[i].inverse() * DVec3::from(expected.means[i].map(f64::from))).as_vec3().to_array();
    let means: Vec<f32> = (0..COUNT).flat_map(back).collect();
    let turn_back = |i: usize| {
        let [w, x, y, z] = expected.rotations[i].map(f64::from);
        let q = turns[i].inverse() * DQuat::from_xyzw(x, y, z, w);
        [q.w, q.x, q.y, q.z].map(|q| q as f32)
    };
    let rotations: Vec<f32> = (0..COUNT).flat_map(turn_back).collect();
    assert_same("means", &means, found.means.as_flattened());
    assert_same("rotations", &rotations, found.rotations.as_flattened());
    assert_same("scales", expected.log_scales.as_flattened(), found.log_scales.as_flattened());
    assert_same("opacities", &expected.opacity_logits, &found.opacity_logits);
    assert_same("harmonics", expected.sh.as_flattened(), found.sh.as_flattened());
    assert_same("features", &expected.features, &found.features);
    assert_same("pose", &expected.poses[0], &found.poses[0]);
}
