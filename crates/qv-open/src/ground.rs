//! The ground that commands are given: a plane, or the mesh of a GLB file.

use crate::error::file_error;
use qv_core::TriangleMesh;
use qv_mesh::files::glb;
use qv_recording::{RecordingError, Run};
use qv_sim::Terrain;
use std::fs;
use std::path::Path;

/// Frictions by label in the place of those of a mesh, which is that of `path`.
///
/// # Errors
/// The mesh has no label of that name.
pub fn set_friction(mesh: &mut TriangleMesh, friction: &[(String, f64)], path: &Path) -> Result<(), RecordingError> {
    for (label, value) in friction {
        let material = mesh.materials.iter_mut().find(|material| material.name == *label);
        let expected = format!("the label {label}");
        material.ok_or_else(|| file_error(path, &expected, "none of that name"))?.friction = Some(*value);
    }
    Ok(())
}

/// The mesh in a GLB file; `expected` says what else the command line could have named.
///
/// # Errors
/// There is no such file, or it holds no mesh.
pub fn mesh_at(path: &Path, expected: &str) -> Result<TriangleMesh, RecordingError> {
    let bytes = fs::read(path).map_err(|e| file_error(path, expected, &e.to_string()))?;
    glb::read(&bytes).map_err(|e| file_error(path, "a mesh in GLB", &e.to_string()))
}

/// What a robot can walk on of the mesh of `path`.
///
/// # Errors
/// The mesh has no triangles, or a friction that is none.
pub fn terrain_at(path: &Path, mesh: &TriangleMesh) -> Result<Terrain, RecordingError> {
    Terrain::from_mesh(mesh).map_err(|e| file_error(path, "a mesh that can be walked on", &e.to_string()))
}

/// The ground that `--terrain` names.
///
/// # Errors
/// As for [`mesh_at`] and [`terrain_at`].
pub fn terrain_of(name: &str) -> Result<Terrain, RecordingError> {
    if name == "plane" {
        return Ok(Terrain::plane());
    }
    let path = Path::new(name);
    terrain_at(path, &mesh_at(path, "plane, or a .glb file")?)
}

/// Height above the ground from which on a base is none of a robot that stands on it \[m\].
const HIGHEST_BASE: f64 = 1.5;

/// Looks whether there is ground under the way of `run`: most of its poses lie above some. Gives remarks: faces that were turned round, and
/// ground that lies far below the poses.
///
/// # Errors
/// When most do not: the mesh lies elsewhere, or on its side.
pub fn check_ground(run: &Run, terrain: &Terrain) -> Result<Vec<String>, RecordingError> {
    const LOOKED_AT: usize = 200;
    // Where a pose stream begins is its own affair: a little above or below the ground it is counted from.
    const ABOVE: f64 = 1.0;
    let mut remarks = Vec::new();
    if terrain.turned() > 0 {
        remarks.push(format!(
            "{} triangles of the ground looked down or into their body: they are turned round",
            terrain.turned()
        ));
    }
    let Some(pose) = run.measured.base_pose.as_ref().filter(|p| !p.is_empty()) else { return Ok(remarks) };
    let every = pose.len().div_ceil(LOOKED_AT);
    let places: Vec<&[f64]> = (0..pose.len()).step_by(every).map(|i| &pose.row(i)[..3]).collect();
    let is_bare =
        |p: &&&[f64]| p.iter().all(|x| x.is_finite()) && terrain.height_below(p[0], p[1], p[2] + ABOVE).is_none();
    let bare: Vec<&&[f64]> = places.iter().filter(is_bare).collect();
    if 2 * bare.len() <= places.len() {
        let over = |p: &&[f64]| Some(p[2] - terrain.height_below(p[0], p[1], p[2] + ABOVE)?);
        let mut heights: Vec<f64> = places.iter().filter_map(over).collect();
        let height = qv_core::statistics::median(&mut heights);
        if height.is_finite() && !(0.0..=HIGHEST_BASE).contains(&height) {
            remarks.push(format!(
                "the ground lies {height:.2} m below the poses of the base (median): frames of ground and poses may differ; it is moved to \
                 the feet"
            ));
        }
        return Ok(remarks);
    }
    let range = |axis: usize| {
        let all = places.iter().map(|p| p[axis]).filter(|x| x.is_finite());
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        format!("{low:.2} to {high:.2}")
    };
    let way = format!("x {}, y {}, z {} m", range(0), range(1), range(2));
    let expected = format!(
        "ground below the robot, camera poses have {way} (meshes are read with z up, in the frame of the poses)"
    );
    Err(qv_core::Mismatch::new("terrain", expected, format!("none below {} of {} poses", bare.len(), places.len()))
        .into())
}
