//! Two frames and a point: `cargo run -p quadverse-core --example frames`.
use qv_core::Pose;

fn main() {
    let world_from_base = Pose::from_xyz_rpy([1.0, 0.0, 0.3], [0.0, 0.0, 1.0]);
    let base_from_imu = Pose::from_xyz_rpy([-0.02557, 0.0, 0.04232], [0.0; 3]);
    let world_from_imu = world_from_base * base_from_imu;
    println!("IMU in the world: {:.4} m, heading {:.3} rad", world_from_imu.position, world_from_imu.yaw());
}
