//! Depth where photographs say nothing: walls and fronts of one colour, floors without texture, and what shines. There the depth that was
//! learned bends behind the surface, all frames agree on it, and no comparison of photographs shows.
//!
//! Man-made places are flat where they are plain. So planes are found in what has texture (`find`), photographs are cut into regions
//! of one colour (`segments`), and each region whose rim and inside lie on a plane all round is laid on that plane (`assign`): between
//! what was seen, never beyond it. Planes for plain regions are those of Gallup, Frahm and Pollefeys, *Piecewise Planar and Non-Planar Stereo
//! for Urban Scene Reconstruction* (2010), parallel ones for each direction those of Sinha, Steedly and Szeliski, *Piecewise Planar
//! Stereo for Image-based Rendering* (2009).

mod assign;
mod find;
mod picture;
mod plane;
mod segments;
#[cfg(test)]
mod tests;

pub use plane::Plane;

use crate::error::off;
use crate::{DepthFrame, MeshError};
use picture::Picture;
use rayon::prelude::*;

/// What was drawn of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedFrame {
    /// Colours, 0 to 1, shape `[height, width, 3]`, as the frame's camera sees them.
    pub colour: Vec<f32>,
    /// Depths before those were left out that other frames do not confirm \[m\]; 0 where nothing solid is, as in the sky: nothing is laid there.
    pub depth: Vec<f32>,
}

/// What was laid on planes.
#[derive(Debug, Clone, PartialEq)]
pub struct Laid {
    /// Planes that something was laid on, those with most texture on them first, then parallel ones.
    pub planes: Vec<Plane>,
    /// Share of the pixels with a depth that were laid on one.
    pub share: f64,
}

/// Lays plain regions of `frames` on planes that textured points within `distance` \[m\] support. `drawn` has what was drawn of each frame.
///
/// # Errors
/// A frame, or something drawn that does not fit its frame.
pub fn lay_on_planes(frames: &mut [DepthFrame], drawn: &[RenderedFrame], distance: f64) -> Result<Laid, MeshError> {
    if drawn.len() != frames.len() {
        return Err(off("pictures of depth frames", format!("one for each of {}", frames.len()), drawn.len()));
    }
    for (index, (frame, RenderedFrame { colour, depth })) in frames.iter().zip(drawn).enumerate() {
        frame.check(index)?;
        let pixels = frame.camera.pixels();
        if colour.len() != 3 * pixels {
            let expected = format!("{} numbers", 3 * pixels);
            return Err(off(format!("picture of depth frame {index}"), expected, colour.len()));
        }
        if depth.len() != pixels {
            let expected = format!("{pixels} numbers");
            return Err(off(format!("depth drawn of depth frame {index}"), expected, depth.len()));
        }
    }
    let pictures: Vec<Picture> =
        frames.par_iter().zip(drawn).map(|(frame, drawn)| Picture::smoothed(&frame.camera, &drawn.colour)).collect();
    let planes = find::planes(frames, &pictures, distance);
    let parts = frames.par_iter_mut().zip(&pictures).zip(drawn);
    let by_frame: Vec<Vec<usize>> =
        parts.map(|((frame, picture), drawn)| assign::lay(frame, picture, &drawn.depth, &planes)).collect();
    let laid: Vec<usize> = (0..planes.len()).map(|plane| by_frame.iter().map(|frame| frame[plane]).sum()).collect();
    let pixels = frames.iter().flat_map(|frame| &frame.depth).filter(|depth| **depth > 0.0).count();
    let share = laid.iter().sum::<usize>() as f64 / pixels.max(1) as f64;
    let planes = planes.into_iter().zip(laid).filter(|(_, laid)| *laid > 0).map(|(plane, _)| plane).collect();
    Ok(Laid { planes, share })
}
