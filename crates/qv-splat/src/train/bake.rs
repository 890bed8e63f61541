//! The median exposure of the photographs as colours of the Gaussians: a scene is drawn without exposures, and is then to look like the photographs.
//!
//! A drawn colour is a weighted mean of the Gaussians' colours and of what is behind them, so an affine transform E of all of those is E of
//! the drawn colour (but where colours are cut off at 0). Exposures become E_v E⁻¹: photographs are explained as before.

use super::exposure::{Exposure, NEUTRAL, exposed};
use super::model::Model;
use super::start::C0;
use glam::{Mat3, Vec3};
use qv_core::statistics::median;

/// Least determinant of the median's matrix: what is flatter cannot be undone.
const LEAST: f32 = 1e-3;

/// Puts the median of all exposures, entry by entry, into the colours; gives the colour `background` behind them as it is then. Nothing
/// changes where the median cannot be undone.
pub fn bake(model: &mut Model, background: [f32; 3]) -> [f32; 3] {
    let of_all = median_exposure(&model.exposures);
    let (matrix, shift) = parts(&of_all);
    if !(matrix.determinant().abs() > LEAST && matrix.is_finite() && shift.is_finite()) || of_all == NEUTRAL {
        return background;
    }
    let count = model.cloud.sh_count();
    for (at, sh) in model.cloud.sh.iter_mut().enumerate() {
        let turned = matrix * Vec3::from_array(*sh);
        let constant = if at % count == 0 { (matrix * Vec3::splat(0.5) + shift - 0.5) / C0 } else { Vec3::ZERO };
        *sh = (turned + constant).to_array();
    }
    let back = matrix.inverse();
    for exposure in &mut model.exposures {
        let (own, own_shift) = parts(exposure);
        let rest = own * back;
        *exposure = whole(rest, own_shift - rest * shift);
    }
    exposed(&of_all, background).map(|colour| colour.clamp(0.0, 1.0))
}

fn median_exposure(exposures: &[Exposure]) -> Exposure {
    if exposures.is_empty() {
        return NEUTRAL;
    }
    std::array::from_fn(|entry| {
        let mut values: Vec<f64> = exposures.iter().map(|exposure| f64::from(exposure[entry])).collect();
        median(&mut values) as f32
    })
}

/// The matrix and the shift of an exposure.
fn parts(e: &Exposure) -> (Mat3, Vec3) {
    let rows = [0, 4, 8].map(|row| Vec3::new(e[row], e[row + 1], e[row + 2]));
    (Mat3::from_cols(rows[0], rows[1], rows[2]).transpose(), Vec3::new(e[3], e[7], e[11]))
}

fn whole(matrix: Mat3, shift: Vec3) -> Exposure {
    let mut out = [0.0; 12];
    for row in 0..3 {
        (0..3).for_each(|k| out[4 * row + k] = matrix.row(row)[k]);
        out[4 * row + 3] = shift[row];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::exposure::exposed_image;
    use super::super::{drawn, tiny};
    use super::*;

    #[test]
    fn a_baked_scene_is_drawn_as_most_photographs_are_and_explains_all_as_before() {
        let mut scene = tiny::scene(40, 5, 32);
        scene.dataset.background = [0.3, 0.4, 0.5];
        let mut model = Model::new(scene.cloud.clone(), &scene.dataset);
        model.raise_degree(1);
        // Colours that nowhere are cut off at 0.
        model.cloud.sh.iter_mut().enumerate().for_each(|(at, sh)| *sh = [if at % 4 == 0 { 0.2 } else { 0.05 }; 3]);
        let usual = [0.8, 0.05, 0.0, 0.02, 0.0, 1.1, 0.0, 0.0, 0.1, 0.0, 0.9, -0.01];
        model.exposures = vec![usual; 5];
        model.exposures[3] = [0.2, 0.0, 0.0, 0.1, 0.0, 0.3, 0.0, 0.1, 0.0, 0.0, 0.2, 0.1];
        let camera = scene.dataset.training[1].camera;
        let before = drawn(&model.cloud, &camera, &scene.dataset).unwrap().colour;
        let explained: Vec<Vec<f32>> = model.exposures.iter().map(|e| exposed_image(e, &before)).collect();
        scene.dataset.background = bake(&mut model, scene.dataset.background);
        let after = drawn(&model.cloud, &camera, &scene.dataset).unwrap().colour;
        let apart = |a: &[f32], b: &[f32]| a.iter().zip(b).fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
        assert!(apart(&after, &explained[0]) < 1e-4, "{}", apart(&after, &explained[0]));
        for (exposure, wanted) in model.exposures.iter().zip(&explained) {
            assert!(apart(&exposed_image(exposure, &after), wanted) < 1e-3);
        }
    }

    #[test]
    fn what_cannot_be_undone_changes_nothing() {
        let scene = tiny::scene(10, 3, 16);
        let mut model = Model::new(scene.cloud.clone(), &scene.dataset);
        assert_eq!(bake(&mut model, [0.5; 3]), [0.5; 3]);
        model.exposures = vec![[0.0; 12]; 3];
        let before = model.clone();
        assert_eq!((bake(&mut model, [0.5; 3]), model == before), ([0.5; 3], true));
        model.exposures = vec![[f32::NAN; 12]; 3];
        bake(&mut model, [0.5; 3]);
        assert_eq!(model.cloud, before.cloud);
    }
}
