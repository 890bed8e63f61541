//! `calibrated_camera.toml`: the camera as a diagnosis corrects it.

use crate::Rig;

/// A camera as the text of a file for `--camera`, whose first lines say what the diagnosis says. `distortion` is k1, k2, p1, p2, k3 of
/// the lens; none is written where all are 0.
pub fn to_toml(rig: &Rig, distortion: [f64; 5], sentence: &str) -> String {
    let Rig { intrinsics: i, base_from_camera, delay, gain, blur } = rig;
    let list = |values: &[f64]| values.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(", ");
    let distortion = match distortion == [0.0; 5] {
        true => String::new(),
        false => format!("distortion = [{}]\n", list(&distortion)),
    };
    format!(
        "# The camera as a diagnosis corrects it, for --camera.\n# {}\nwidth = {}\nheight = {}\nfx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\n\
         {distortion}# Images are taken this long before their stamps [s].\ndelay = {delay:?}\n# Factor on displayed values of the scene.\n\
         gain = {gain:?}\n# Deviation of a blur [px].\nblur = {blur:?}\n\n[base_from_camera]\nposition = [{}]\nquaternion = [{}]\n",
        sentence.replace(['\n', '\r'], " "),
        i.width,
        i.height,
        i.fx,
        i.fy,
        i.cx,
        i.cy,
        list(&base_from_camera.position.to_array()),
        list(&base_from_camera.wxyz())
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Intrinsics;
    use qv_core::Pose;

    #[test]
    fn a_lens_without_distortion_has_no_line_of_it() {
        let intrinsics = Intrinsics { fx: 50.0, fy: 51.0, cx: 32.0, cy: 24.5, width: 64, height: 48 };
        let rig = Rig { intrinsics, base_from_camera: Pose::IDENTITY, delay: 0.0125, gain: 1.0, blur: 0.0 };
        let text = to_toml(&rig, [0.0; 5], "One\nline.");
        assert!(text.contains("\n# One line.\n") && text.contains("\ndelay = 0.0125\n"), "{text}");
        assert!(text.ends_with("position = [0.0, 0.0, 0.0]\nquaternion = [1.0, 0.0, 0.0, 0.0]\n"), "{text}");
        assert!(!text.contains("distortion"), "{text}");
        assert!(to_toml(&rig, [0.0, 0.0, 0.01, 0.0, 0.0], "").contains("\ndistortion = [0.0, 0.0, 0.01, 0.0, 0.0]\n"));
    }
}
