//! `compensator.onnx` says what the compensator does.

use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::onnx::OnnxPolicy;
use qv_policy::shape_torques::{SHAPES, shapes};
use qv_residual::compensation::Compensation;

#[test]
fn torques_of_known_shapes_come_out_of_the_file_as_they_are_added() {
    let robot = qv_go2::walk::robot().unwrap();
    let joints = robot.joints();
    let mut random = Xoshiro256PlusPlus::of(3, 1, 4);
    let mut learnt = Compensation::nominal(&robot);
    learnt.shapes = (0..joints * SHAPES.len()).map(|_| random.between(-0.5, 0.5)).collect();
    learnt.parameters.insert("base.mass_offset".into(), 1.5);
    let mut file = OnnxPolicy::from_bytes(&learnt.to_onnx(&robot).unwrap()).unwrap();
    let motion: Vec<f32> = (0..3 * joints).map(|_| random.between(-3.0, 3.0)).collect();
    let mut added = Vec::new();
    file.run(&motion, &mut added).unwrap();
    let most = robot.torque_scale();
    for (j, added) in added.iter().enumerate() {
        let shapes = shapes(motion[j], motion[joints + j], motion[2 * joints + j]);
        let sum: f32 = shapes.iter().zip(&learnt.shapes[j * SHAPES.len()..]).map(|(s, n)| s * n).sum();
        assert!((added - sum.clamp(-most, most)).abs() < 1e-4, "joint {j}: {added}, {sum}");
    }
    assert!(added.iter().any(|x| x.abs() > 0.1 && x.abs() < most), "{added:?}");
    let plain = Compensation::nominal(&robot).to_onnx(&robot).unwrap();
    OnnxPolicy::from_bytes(&plain).unwrap().run(&motion, &mut added).unwrap();
    assert!(added.iter().all(|x| *x == 0.0), "parameters alone add nothing");
    let mut other = learnt.clone();
    other.robot = "cat".into();
    assert!(other.to_onnx(&robot).unwrap_err().to_string().contains("cat"));
}
