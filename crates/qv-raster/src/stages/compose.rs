//! Images of what moves over prepared images of what does not.
//!
//! Where the cameras stay and only a few groups move, the rest is drawn once and kept; each frame draws the groups alone.

use crate::{Image, RasterError};

/// Puts `front`, drawn over black, before `back`, which may have been drawn over anything: colour, alpha, and depth where both have it.
/// A pixel of the front that is farther than the back, by their mean depths, is hidden by as much as the back covers. That is right where
/// the two do not lie within one another along the ray; blending all Gaussians together has no such limit.
///
/// # Errors
/// The images differ in size, or the front has planes or features, which are not put together.
pub fn compose(front: &mut Image, back: &Image) -> Result<(), RasterError> {
    for (what, expected, found) in [
        ("rows of the image behind", front.height, back.height),
        ("columns of the image behind", front.width, back.width),
        ("numbers of normals and features to put before another image", 0, front.normal.len() + front.features.len()),
    ] {
        if expected != found {
            return Err(RasterError::Length { what: what.into(), expected, found });
        }
    }
    let deep = !front.depth.is_empty() && !back.depth.is_empty();
    for pixel in 0..front.alpha.len() {
        let (alpha, behind) = (front.alpha[pixel], back.alpha[pixel]);
        let hidden = if deep && front.depth[pixel] > back.depth[pixel] { behind } else { 0.0 };
        let shown = alpha * (1.0 - hidden);
        let left = 1.0 - shown;
        for c in 3 * pixel..3 * pixel + 3 {
            front.colour[c] = (1.0 - hidden) * front.colour[c] + left * back.colour[c];
        }
        let covered = shown + left * behind;
        if deep && covered > 0.0 {
            front.depth[pixel] = (shown * front.depth[pixel] + left * behind * back.depth[pixel]) / covered;
        }
        front.alpha[pixel] = covered;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel(colour: [f32; 3], alpha: f32, depth: f32) -> Image {
        let (colour, alpha, depth) = (colour.to_vec(), vec![alpha], vec![depth]);
        Image { width: 1, height: 1, colour, alpha, depth, ..Default::default() }
    }

    #[test]
    fn what_is_nearer_covers_and_what_is_farther_is_covered() {
        let back = pixel([0.0, 0.8, 0.0], 1.0, 2.0);
        let mut near = pixel([0.5, 0.0, 0.0], 0.5, 1.0);
        compose(&mut near, &back).unwrap();
        assert_eq!((&near.colour[..], near.alpha[0], near.depth[0]), (&[0.5, 0.4, 0.0][..], 1.0, 1.5));
        let mut far = pixel([0.5, 0.0, 0.0], 0.5, 3.0);
        compose(&mut far, &back).unwrap();
        assert_eq!((&far.colour[..], far.alpha[0], far.depth[0]), (&[0.0, 0.8, 0.0][..], 1.0, 2.0));
    }

    #[test]
    fn sizes_that_differ_are_errors() {
        let wide = Image { width: 2, height: 1, colour: vec![0.0; 6], alpha: vec![0.0; 2], ..Default::default() };
        let error = compose(&mut pixel([0.0; 3], 0.0, 0.0), &wide).unwrap_err().to_string();
        assert_eq!(error, "columns of the image behind: expected length 1, found 2");
    }
}
