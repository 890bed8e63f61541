//! Depth where photographs say nothing: walls and fronts of one colour, floors without texture, and what shines. There the depth that was
//! learned bends behind the surface, all frames agree on it, and no comparison of photographs tells.
//!
//! Man-made places are flat where they are plain. So planes are found in what has texture (`find`), photographs are cut into regions
//! of one colour (`segments`), and each region whose rim and inside lie on a plane all round is laid on that plane (`assign`): between
//! what was seen, never beyond it. Planes for plain regions are those of Gallup, Frahm and Pollefeys, *Piecewise Planar and Non-Planar Stereo
//! for Urban Scene Reconstruction* (2010), parallel ones for each direction those of Sinha, Steedly and Szeliski, *Piecewise Planar
//! Stereo for Image-based Rendering* (2009).

mod assign;
mod find;
mod picture;
mod segments;
#[cfg(test)]
mod tests;

use crate::error::off;
use crate::{DepthFrame, MeshError};
use glam::DVec3;
use picture::Picture;
use rayon::prelude::*;

/// A plane of the world: `normal` · p = `offset`, in metres; the normal is a unit one and points to where cameras see it from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit normal.
    pub normal: DVec3,
    /// Distance of the origin from the plane, against the normal \[m\].
    pub offset: f64,
}

/// What was laid on planes.
#[derive(Debug, Clone, PartialEq)]
pub struct Laid {
    /// Planes that were found, those with most texture on them first, then parallel ones.
    pub planes: Vec<Plane>,
    /// Share of all pixels that were laid on one.
    pub share: f64,
}

/// Lays plain regions of `frames` on planes that textured points within `distance` \[m\] support. `colours` has a picture for each frame, 0 to
/// 1, shape `[height, width, 3]`, as the frame's camera sees it.
///
/// # Errors
/// A frame, or a picture that does not fit its frame.
pub fn lay_on_planes(frames: &mut [DepthFrame], colours: &[Vec<f32>], distance: f64) -> Result<Laid, MeshError> {
    if colours.len() != frames.len() {
        return Err(off("pictures of depth frames", format!("one for each of {}", frames.len()), colours.len()));
    }
    for (index, (frame, colour)) in frames.iter().zip(colours).enumerate() {
        frame.check(index)?;
        if colour.len() != 3 * frame.camera.pixels() {
            let expected = format!("{} numbers", 3 * frame.camera.pixels());
            return Err(off(format!("picture of depth frame {index}"), expected, colour.len()));
        }
    }
    let pictures: Vec<Picture> =
        frames.par_iter().zip(colours).map(|(frame, colour)| Picture::smoothed(&frame.camera, colour)).collect();
    let planes = find::planes(frames, &pictures, distance);
    let laid: usize =
        frames.par_iter_mut().zip(&pictures).map(|(frame, picture)| assign::lay(frame, picture, &planes)).sum();
    let pixels: usize = frames.iter().map(|frame| frame.camera.pixels()).sum();
    Ok(Laid { planes, share: laid as f64 / pixels.max(1) as f64 })
}
