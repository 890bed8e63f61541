//! The scene as a file, so that another renderer can draw the very same one: `fixtures/gsplat/bench.py` reads it.
//!
//! All little-endian and without gaps: the eight bytes `QVSCENE1`; five u32: Gaussians N, degree d of the spherical harmonics,
//! cameras C, width, height; then f32 arrays, one after the other:
//!
//! | array | shape |
//! |---|---|
//! | means \[m\] | `[N, 3]` |
//! | natural logarithms of the scales \[ln m\] | `[N, 3]` |
//! | rotations, quaternions w, x, y, z | `[N, 4]` |
//! | opacity logits | `[N]` |
//! | spherical harmonics, colour = max(0, 0.5 + sum) | `[N, (d + 1)², 3]` |
//! | fx, fy, cx, cy \[px\] | `[C, 4]` |
//! | camera_from_world, rows of a homogeneous matrix | `[C, 4, 4]` |

use qv_core::{Camera, GaussianCloud};
use std::fs::File;
use std::io::{BufWriter, Error, Result, Write};
use std::path::Path;

const MAGIC: [u8; 8] = *b"QVSCENE1";

/// Writes a scene, whose cameras are all of one size.
pub fn save(path: &Path, cloud: &GaussianCloud, cameras: &[Camera]) -> Result<()> {
    let mut out = BufWriter::new(File::create(path)?);
    let (width, height) = cameras.first().map_or((0, 0), |camera| (camera.width, camera.height));
    out.write_all(&MAGIC)?;
    for number in [cloud.len(), cloud.sh_degree.into(), cameras.len(), width as usize, height as usize] {
        out.write_all(&u32::try_from(number).map_err(Error::other)?.to_le_bytes())?;
    }
    write(&mut out, cloud.means.as_flattened())?;
    write(&mut out, cloud.log_scales.as_flattened())?;
    write(&mut out, cloud.rotations.as_flattened())?;
    write(&mut out, &cloud.opacity_logits)?;
    write(&mut out, cloud.sh.as_flattened())?;
    for camera in cameras {
        write(&mut out, &[camera.fx, camera.fy, camera.cx, camera.cy].map(|x| x as f32))?;
    }
    for camera in cameras {
        write(&mut out, &rows(camera))?;
    }
    out.flush()
}

fn write(out: &mut impl Write, values: &[f32]) -> Result<()> {
    values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
}

/// The matrix of `camera_from_world`, row by row.
fn rows(camera: &Camera) -> [f32; 16] {
    let pose = camera.camera_from_world;
    let matrix = glam::DMat4::from_rotation_translation(pose.rotation, pose.position);
    matrix.transpose().to_cols_array().map(|x| x as f32)
}
