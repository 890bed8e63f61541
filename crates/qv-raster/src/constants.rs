//! Constants that renderers must share if their images are to be compared; those of gsplat 1.5.3.

/// Largest opacity of a Gaussian at a pixel.
pub const MAX_ALPHA: f32 = 0.999;
/// A Gaussian is not drawn where its opacity is below this.
pub const MIN_ALPHA: f32 = 1.0 / 255.0;
/// A pixel takes no further Gaussian once its transmittance would fall to this.
pub const MIN_TRANSMITTANCE: f32 = 1e-4;
/// Added to both variances of the projected Gaussian \[px²\].
pub const LOW_PASS: f32 = 0.3;
/// The same where [`crate::Settings::antialias`] is asked for: about the variance of a pixel's square, as in *Mip-Splatting* \[px²\].
pub const ANTIALIAS_LOW_PASS: f32 = 0.1;
/// A Gaussian is drawn when its centre is farther than this in front of the camera \[m\].
pub const NEAR: f32 = 0.01;
/// The projection is linearised no farther outside the image than this times half its width and height.
pub const GUARD: f64 = 0.3;
/// Side of the square tiles \[px\].
pub const TILE: u32 = 16;
/// Pixels of a tile.
pub const TILE_PIXELS: usize = (TILE * TILE) as usize;
/// Plane depth is given where the blended normal, times the ray with z = 1, is below minus this.
pub const MIN_FACING: f32 = 1e-4;
/// Squared length of a quaternion below which it has no direction.
pub const MIN_QUATERNION: f32 = 1e-24;
