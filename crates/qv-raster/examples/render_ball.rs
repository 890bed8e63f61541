//! Draws one Gaussian in letters: `cargo run -p quadverse-raster --example render_ball`.
use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::{RasterError, Scene, Settings, View, render};

fn main() -> Result<(), RasterError> {
    let cloud = GaussianCloud {
        means: vec![[0.0, 0.0, 2.0]],
        log_scales: vec![[-1.2, -2.0, -1.6]],
        rotations: vec![[1.0, 0.0, 0.0, 0.3]],
        opacity_logits: vec![3.0],
        sh: vec![[1.0, 0.0, -1.0]],
        ..Default::default()
    };
    let camera =
        Camera { fx: 40.0, fy: 20.0, cx: 32.0, cy: 12.0, width: 64, height: 24, camera_from_world: Pose::IDENTITY };
    let (images, _) = render(&Scene::still(&cloud), &[View::of(camera)], &Settings::default())?;
    for row in images[0].alpha.chunks(64) {
        println!("{}", row.iter().map(|alpha| b" .:-=+*#%@"[(alpha * 9.99) as usize] as char).collect::<String>());
    }
    Ok(())
}
