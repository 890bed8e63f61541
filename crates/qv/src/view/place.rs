//! The place: Gaussians that cover most, the labelled ground, slips on it.

use crate::Failure;
use crate::ground::mesh_at;
use crate::outcome::about;
use crate::scene::open_scene;
use qv_core::{GaussianCloud, TriangleMesh};
use qv_sim::Terrain;
use qv_splat::files::{Format, write};
use serde::Serialize;
use serde_json::Value;
use std::path::Path;

/// Coefficients of the constant harmonic alone are kept: colours that change with the direction cost three times the space.
const DEGREE: u8 = 0;
/// Height from which slips are dropped on the ground \[m\].
const ABOVE: f64 = 1e3;

/// Gaussians as a file within the page.
pub struct Splat {
    pub count: usize,
    /// Compressed PLY.
    pub file: Vec<u8>,
    /// Colour behind everything, 0 to 1.
    pub background: Option<[f32; 3]>,
}

/// A slip of a foot.
#[derive(Serialize)]
pub struct Slip {
    pub at: [f64; 3],
    pub time: f64,
    pub distance: f64,
}

pub fn open_mesh(path: &Path) -> Result<TriangleMesh, Failure> {
    Ok(mesh_at(path, "a mesh")?)
}

/// The Gaussians of a file, at most `most` of them.
pub fn splat(path: &Path, most: usize, remarks: &mut Vec<String>) -> Result<Splat, Failure> {
    let file = open_scene(path)?;
    let all = file.cloud.len();
    let cloud = thinned(&file.cloud, most);
    if cloud.len() < all {
        remarks.push(format!("{}: {} of {all} Gaussians, those that cover most", path.display(), cloud.len()));
    }
    let bytes = write(&cloud, Format::CompressedPly).map_err(|e| about(path, e))?;
    Ok(Splat { count: cloud.len(), file: bytes, background: file.background })
}

/// The Gaussians with the greatest product of opacity and area, in their order, without what depends on the direction.
fn thinned(cloud: &GaussianCloud, most: usize) -> GaussianCloud {
    let covers = |k: usize| {
        let mut scales = cloud.log_scales[k];
        scales.sort_by(f32::total_cmp);
        // Two axes of a flat Gaussian are what one sees of it.
        let area = scales[1] + scales[2];
        area - (1.0 + (-cloud.opacity_logits[k]).exp()).ln()
    };
    let mut order: Vec<usize> = (0..cloud.len()).collect();
    order.sort_by(|a, b| covers(*b).total_cmp(&covers(*a)).then(a.cmp(b)));
    let mut is_kept = vec![false; cloud.len()];
    order.iter().take(most).for_each(|&k| is_kept[k] = true);
    let kept = cloud.filtered(|k| is_kept[k]);
    let sh = kept.sh.chunks_exact(kept.sh_count()).map(|bands| bands[0]).collect();
    GaussianCloud { sh_degree: DEGREE, sh, feature_count: 0, features: vec![], ..kept }
}

/// Whether two reports say that the first recording of each is not the same file.
pub fn are_of_two(one: Option<&Value>, other: Option<&Value>) -> bool {
    let first = |report: Option<&Value>| report?.pointer("/provenance/inputs/0/sha256")?.as_str().map(str::to_owned);
    matches!((first(one), first(other)), (Some(one), Some(other)) if one != other)
}

/// Slips of the first recording of a report of `qv contact`, on the ground.
pub fn slips(contact: &Value, mesh: Option<&TriangleMesh>) -> Vec<Slip> {
    let terrain = mesh.and_then(|mesh| Terrain::from_mesh(mesh).ok());
    let slip = |value: &Value| {
        let (x, y) = (value["at"][0].as_f64()?, value["at"][1].as_f64()?);
        let ground = terrain.as_ref().and_then(|terrain| terrain.height_below(x, y, ABOVE)).unwrap_or(0.0);
        Some(Slip { at: [x, y, ground], time: value["time"].as_f64()?, distance: value["distance"].as_f64()? })
    };
    let of_first = |value: &&Value| value["run"].as_u64().unwrap_or(0) == 0;
    contact["slips"].as_array().into_iter().flatten().filter(of_first).filter_map(slip).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_covers_most_is_kept_in_its_order() {
        let cloud = GaussianCloud {
            means: vec![[0.0; 3], [1.0; 3], [2.0; 3], [3.0; 3]],
            // A large faint one, a small one, a flat one, a large one.
            log_scales: vec![[0.0; 3], [-5.0; 3], [-2.0, -9.0, -2.0], [-1.0; 3]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 4],
            opacity_logits: vec![-30.0, 9.0, 9.0, 9.0],
            sh_degree: 1,
            sh: (0..16).map(|k| [k as f32; 3]).collect(),
            ..GaussianCloud::default()
        };
        let kept = thinned(&cloud, 2);
        assert_eq!(kept.means, [[2.0; 3], [3.0; 3]]);
        assert_eq!((kept.sh_degree, kept.sh), (0, vec![[8.0; 3], [12.0; 3]]));
        assert_eq!(thinned(&cloud, 9).len(), 4);
    }

    #[test]
    fn reports_of_two_recordings_are_told_apart() {
        let report =
            |hash: &str| serde_json::json!({"provenance": {"inputs": [{"sha256": hash}, {"sha256": "ground"}]}});
        assert!(are_of_two(Some(&report("a")), Some(&report("b"))));
        assert!(!are_of_two(Some(&report("a")), Some(&report("a"))));
        assert!(!are_of_two(Some(&serde_json::json!({})), Some(&report("a"))) && !are_of_two(None, None));
    }

    #[test]
    fn slips_lie_on_the_ground() {
        let report = serde_json::json!({"slips": [
            {"at": [0.1, 0.2], "time": 1.0, "distance": 0.02, "run": 0}, {"at": [0.0, 0.0], "time": 2.0, "distance": 0.1, "run": 1},
            {"at": [0.0], "time": 3.0, "distance": 0.1, "run": 0}]});
        let found = slips(&report, None);
        assert_eq!(found.len(), 1, "those of the first recording that say where");
        assert_eq!((found[0].at, found[0].time), ([0.1, 0.2, 0.0], 1.0));
    }
}
