//! A look at the photographs of a camera, from photographs to evidence.

use crate::align::{self, Target};
use crate::footage::Footage;
use crate::path::Path;
use crate::see::{IN_VIEW, LookOptions, chosen, out_of_view, see, stated};
use crate::sight::Look;
use crate::{CameraError, judge};

/// Compares photographs with the scene, and measures what may be wrong with the camera.
///
/// # Errors
/// Too few photographs or poses, an image whose size is not that of the intrinsics, a scene that is nowhere in view.
pub fn look(footage: &Footage, options: &LookOptions) -> Result<Look, CameraError> {
    footage.rig.check()?;
    let path = Path::new(footage.poses)?;
    let chosen = chosen(footage, &path, options.most)?;
    let seen = see(footage, &path, &chosen, options)?;
    judge::judge(footage, &path, &seen, options)
}

/// Whether there is something to compare, before time is spent on it.
///
/// # Errors
/// As [`look`], but a scene out of view is found in three photographs only.
pub fn check(footage: &Footage, options: &LookOptions) -> Result<(), CameraError> {
    footage.rig.check()?;
    let path = Path::new(footage.poses)?;
    let chosen = chosen(footage, &path, options.most)?;
    let rig = &footage.rig;
    let mut most = 0.0f64;
    for k in [1, 3, 5] {
        let photograph = chosen[k * chosen.len() / 6];
        let camera = rig.camera((path.at(photograph.time - rig.delay) * rig.base_from_camera).inverse());
        let target = Target::new(&photograph.rgba, &rig.intrinsics, camera, options.width).over(footage.background);
        most = most.max(align::disagreement(footage.cloud, &target, &stated(rig, options.width), 0)?.seen);
    }
    if most < IN_VIEW { Err(out_of_view(most)) } else { Ok(()) }
}
