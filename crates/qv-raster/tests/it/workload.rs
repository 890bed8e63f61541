//! The measured scene is the one of its description: sums and samples that NumPy gives for it (2000 Gaussians, degree 1,
//! 128 cameras, seed 1).

use qv_raster::workload::{cameras, cloud};

fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() <= 2e-6 * expected.abs().max(1.0), "{found} {expected}");
}

/// Sum of all, and of all times the cosine of the Gaussian's index.
fn sums(rows: impl Iterator<Item = Vec<f64>>) -> [f64; 2] {
    let mut out = [0.0; 2];
    for (i, row) in rows.enumerate() {
        let sum: f64 = row.iter().sum();
        out[0] += sum;
        out[1] += (i as f64).cos() * sum;
    }
    out
}

fn check(found: [f64; 2], expected: [f64; 2]) {
    close(found[0], expected[0]);
    // The second is what is left of large numbers.
    assert!((found[1] - expected[1]).abs() < 1e-3, "{found:?} {expected:?}");
}

#[test]
fn the_cloud_is_the_described_one() {
    let cloud = cloud(2000, 1, 1);
    cloud.check().unwrap();
    let wide = |row: &[f32]| row.iter().map(|&x| x as f64).collect::<Vec<f64>>();
    check(sums(cloud.means.iter().map(|m| wide(m))), [1_187.436_776_243_190_3, 454.448_525_698_538_4]);
    check(sums(cloud.rotations.iter().map(|q| wide(q))), [1_052.801_807_147_481_7, 15.204_665_164_203_31]);
    let scales = cloud.log_scales.iter().map(|s| s.iter().map(|&x| (x as f64).exp()).collect());
    check(sums(scales), [2_576.417_543_055_955_3, -58.069_683_254_460_735]);
    let opacities = cloud.opacity_logits.iter().map(|&x| vec![1.0 / (1.0 + (-x as f64).exp())]);
    check(sums(opacities), [1_331.028_169_533_703_5, 3.025_641_746_514_505_6]);
    let sh = (0..2000).map(|i| wide(cloud.sh_of(i).as_flattened()));
    check(sums(sh), [-2_851.374_984_377_456_7, 30.651_716_943_898_82]);
    assert_eq!(cloud.means[1234], [6.811_205, -4.848_75, 1.816_543_1]);
    assert_eq!(cloud.sh_of(1234)[1], [-0.027_702_132, -0.052_436_88, 0.015_717_3]);
}

#[test]
fn the_cameras_are_the_described_ones() {
    let cameras = cameras(128, 1, 640, 480);
    assert_eq!(cameras.len(), 128);
    let focal: f64 = cameras.iter().map(|c| 2.0 * c.fx + c.cx + c.cy).sum();
    close(focal, 199_830.126_220_703_12);
    let entries = |c: &qv_core::Camera| {
        let (m, t) = (c.camera_from_world.matrix(), c.camera_from_world.position);
        [m.x_axis, m.y_axis, m.z_axis, t].iter().map(|v| v.element_sum()).sum::<f64>() + 1.0
    };
    close(cameras.iter().map(entries).sum(), 85.562_938_952_265_46);
    let camera = &cameras[77];
    let rotation = camera.camera_from_world.matrix();
    let expected = [-0.751_610_577_106_475_8, -0.658_316_493_034_362_8, 0.041_242_752_224_206_924];
    for k in 0..3 {
        close(rotation.row(0)[k], expected[k]);
    }
    close(camera.camera_from_world.position.z, 9.350_624_084_472_656);
    close(camera.fx, 508.937_713_623_046_9);
}
