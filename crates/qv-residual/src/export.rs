//! `compensator.onnx`: what is added to a simulator beside its parameters, for those who train elsewhere.

use crate::ResidualError;
use crate::compensation::Compensation;
use qv_policy::PolicyError;
use qv_policy::onnx::GraphBuilder;
use qv_policy::shape_torques::{NEAR_REST, SHAPES, TURN};
use qv_policy::velocity::TaskRobot;

impl Compensation {
    /// The file `compensator.onnx`: torques to be added to those of the motors (zero where parameters alone were learnt).
    ///
    /// | input, f32 | output, f32 |
    /// |---|---|
    /// | `motion` `[n, 3 joints]`: angles from the stand \[rad\], speeds \[rad/s\], the motors' torques \[N m\] | `torque` `[n, joints]` \[N m\] |
    ///
    /// The simulator's parameters are in the file as text (`parameters`, JSON).
    ///
    /// # Errors
    /// When it is another robot's or a number is not finite.
    pub fn to_onnx(&self, robot: &TaskRobot) -> Result<Vec<u8>, ResidualError> {
        self.check(robot)?;
        let text = |key: &str, value: String| (key.to_owned(), value);
        let metadata = [
            text("robot", self.robot.clone()),
            text("joints", self.joints.join(" ")),
            text("stand", format!("{:?}", robot.stand)),
            text("parameters", serde_json::to_string(&self.parameters).unwrap_or_default()),
        ];
        let zero = vec![0.0; robot.joints() * SHAPES.len()];
        let numbers = if self.shapes.is_empty() { &zero } else { &self.shapes };
        Ok(shapes(robot, numbers, &metadata).map_err(PolicyError::from)?)
    }
}

/// The graph of [`qv_policy::shape_torques::shapes`], and their sum within the largest torque.
fn shapes(
    robot: &TaskRobot,
    numbers: &[f32],
    metadata: &[(String, String)],
) -> Result<Vec<u8>, qv_policy::onnx::OnnxError> {
    let joints = robot.joints();
    let mut graph = GraphBuilder::new();
    let motion = graph.input("motion", 3 * joints)?;
    let off = graph.slice(&motion, 0, joints)?;
    let speed = graph.slice(&motion, joints, 2 * joints)?;
    let torque = graph.slice(&motion, 2 * joints, 3 * joints)?;
    let one = graph.constant("one", &[1], &[1.0])?;
    let minus = graph.constant("minus_one", &[1], &[-1.0])?;
    // Friction: against the smooth sign of the speed, x / sqrt(1 + x²).
    let turn = graph.constant("one_over_turn", &[1], &[1.0 / TURN])?;
    let x = graph.mul(&speed, &turn);
    let squared = graph.mul(&x, &x);
    let more = graph.add(&squared, &one);
    let root = graph.sqrt(&more);
    let sign = graph.div(&x, &root);
    let against = graph.mul(&sign, &minus);
    // Near rest: 1 / (1 + (speed / reach)²).
    let reach = graph.constant("one_over_reach", &[1], &[1.0 / NEAR_REST])?;
    let slow = graph.mul(&speed, &reach);
    let slow = graph.mul(&slow, &slow);
    let slow = graph.add(&slow, &one);
    let near = graph.div(&against, &slow);
    let load = graph.abs(&torque);
    let under_load = graph.mul(&against, &load);
    let mut signed_square = |x| {
        let size = graph.abs(x);
        let square = graph.mul(x, &size);
        graph.mul(&square, &minus)
    };
    let (drag, saturation) = (signed_square(&speed), signed_square(&torque));
    let spring = graph.mul(&off, &minus);
    let mut sum = None;
    for (k, shape) in
        [Some(near), Some(under_load), Some(drag), Some(saturation), None, Some(spring)].iter().enumerate()
    {
        let column: Vec<f32> = numbers.chunks_exact(SHAPES.len()).map(|own| own[k]).collect();
        let weights = graph.constant(&format!("shape_{k}"), &[joints], &column)?;
        // A constant torque is the same in every row.
        let part = shape.as_ref().map_or(weights.clone(), |shape| graph.mul(shape, &weights));
        sum = Some(sum.map_or(part.clone(), |sum| graph.add(&sum, &part)));
    }
    let most = graph.constant("most", &[joints], &vec![robot.torque_scale(); joints])?;
    let least = graph.constant("least", &[joints], &vec![-robot.torque_scale(); joints])?;
    let sum = sum.unwrap_or(motion);
    let above = graph.max(&sum, &least);
    let clipped = graph.min(&above, &most);
    graph.output(&clipped, "torque", joints)?;
    metadata.iter().for_each(|(key, value)| graph.metadata(key, value));
    Ok(graph.finish())
}
