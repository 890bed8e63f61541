//! Gaussians that hang in the air over ground where a robot can stand.
//!
//! A reconstruction puts them there for sky and for what few photographs show. From the photographs they look right; before an eye near the
//! ground they are fog. The mesh knows better: what many photographs contradict does not become part of its surface.

use crate::map::{Map, SQUEEZE};
use glam::DVec3;
use qv_core::GaussianCloud;

/// What counts as hanging in the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Air {
    /// From this height over the ground on \[m\]: above grass and the noise of a mesh, below the robot's eye.
    pub from: f64,
    /// Up to this height \[m\]: ceilings and crowns stay. That of [`MapSettings::ceiling`](crate::map::MapSettings) by default.
    pub to: f64,
}

impl Default for Air {
    fn default() -> Self {
        Self { from: 0.2, to: 2.0 }
    }
}

/// The cloud of a place without Gaussians whose middle hangs in the air, over ground where a robot can get through. Ground that the mesh does not
/// show says nothing: there the scene may show what the mesh lacks.
pub fn without_veils(place: &GaussianCloud, map: &Map, air: &Air) -> GaussianCloud {
    let hangs = |mean: [f32; 3]| {
        let p = DVec3::from(mean.map(f64::from));
        let over = map.height(p.truncate()).map_or(0.0, |ground| p.z - ground);
        map.is_shown(p.truncate()) && map.room(p.truncate()) > f64::from(SQUEEZE) && over > air.from && over < air.to
    };
    place.filtered(|k| !hangs(place.means[k]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::MapSettings;
    use crate::map::tests::ring;

    /// On ground, box, wall and ceiling Gaussians stay; in the air over the ground, and over the box that one could stand on, they go.
    #[test]
    fn what_hangs_in_the_air_goes_and_all_else_stays() {
        let map = Map::new(&ring(), &MapSettings::default()).unwrap();
        let surface = [[-2.0, 0.0, 0.05], [0.0, 0.0, 0.52], [-1.0, 0.0, 0.3], [-1.05, 0.0, 0.4], [2.0, 0.0, 2.4]];
        let veils = [[-2.0, 0.0, 0.4], [2.0, 2.0, 1.9], [0.0, 0.0, 1.0]];
        let outside = [[8.0, 0.0, 1.0], [f32::NAN, 0.0, 1.0]];
        let means = [&surface[..], &veils, &outside].concat();
        let n = means.len();
        let cloud = GaussianCloud {
            means,
            log_scales: vec![[-3.0; 3]; n],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
            opacity_logits: vec![0.0; n],
            sh: vec![[0.0; 3]; n],
            ..Default::default()
        };
        let cleared = without_veils(&cloud, &map, &Air::default());
        assert_eq!(cleared.check(), Ok(()));
        assert_eq!(cleared.means[..surface.len()], surface);
        assert_eq!(cleared.len(), n - veils.len());
        // The same with the ground taken for granted, where of the mesh the box is left.
        let mut little = ring();
        little.triangles = vec![[0, 2, 0], [4, 5, 6], [4, 6, 7]];
        let filled = Map::new(&little, &MapSettings { floor: Some(0.0), ..Default::default() }).unwrap();
        assert_eq!(without_veils(&cloud, &filled, &Air::default()).len(), n - 1, "over the box alone");
        let none = Air { from: f64::INFINITY, ..Air::default() };
        assert_eq!(without_veils(&cloud, &map, &none).len(), n);
    }
}
