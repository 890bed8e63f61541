//! Metric scale and z up: from markers, a trajectory, a known distance, a direction, or the ground.

use super::arguments::Mesh;
use super::input::Input;
use crate::Failure;
use crate::outcome::about;
use crate::terminal::print_message;
use glam::DVec3;
use qv_core::TriangleMesh;
use qv_mesh::DepthFrame;
use qv_mesh::similarity::Similarity;
use std::fs;
use std::path::Path;

/// What `--up` says.
pub(super) enum Up {
    /// The largest plane.
    Ground,
    /// A direction that becomes z.
    Along(Similarity),
}

impl Up {
    pub(super) fn of(text: &str) -> Result<Self, Failure> {
        if text == "ground" {
            return Ok(Self::Ground);
        }
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|word| word.trim().parse()).collect();
        let numbers = numbers.ok().filter(|n| n.len() == 3);
        let numbers = numbers.ok_or_else(|| format!("--up: expected `ground` or x,y,z, found {text}"))?;
        let level = Similarity::from_up(DVec3::from_slice(&numbers)).map_err(|e| format!("--up: {e}"))?;
        Ok(Self::Along(level))
    }
}

/// What `--distance` says.
pub(super) fn of_distance(numbers: &[f64]) -> Result<Similarity, Failure> {
    let [x, y, z, to_x, to_y, to_z, metres] = *numbers else {
        return Err(format!("--distance: expected x,y,z,x,y,z,metres, found {} numbers", numbers.len()).into());
    };
    let (from, to) = (DVec3::new(x, y, z), DVec3::new(to_x, to_y, to_z));
    Ok(Similarity::from_distance(from, to, metres).map_err(|e| format!("--distance: {e}"))?)
}

/// Share of a surface that its ground has when it is none.
const LITTLE_GROUND: f64 = 0.03;

/// Share of a mesh's area that lies within `distance` of z = 0 and looks up.
fn flat_share(mesh: &TriangleMesh, distance: f64) -> f64 {
    let (mut flat, mut all) = (0.0, 0.0);
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(t);
        let area = (b - a).cross(c - a);
        all += area.length();
        let is_flat = area.z > 0.9 * area.length() && ((a + b + c).z / 3.0).abs() < distance;
        flat += if is_flat { area.length() } else { 0.0 };
    }
    if all > 0.0 { flat / all } else { 0.0 }
}

/// Whether ground of this share of the surface is doubtful, and what to do then.
fn doubt(share: f64) -> Option<String> {
    (share < LITTLE_GROUND).then(|| {
        format!(
            "up direction of --up ground: the largest plane that faces up is {:.1} % of the surface (ground has {:.0} % or more)\n\
             hint: give the up direction as --up x,y,z, or capture more of the ground",
            100.0 * share,
            100.0 * LITTLE_GROUND
        )
    })
}

impl Mesh {
    /// Brings frames and labelled points to metres, and says how; `distance` is what --distance says.
    pub(super) fn align(&self, input: &mut Input, distance: Option<Similarity>) -> Result<Similarity, Failure> {
        let metric_from_scene = if let Some(path) = &self.markers {
            let rows = rows(path)?;
            let numbers: Result<Vec<Vec<f64>>, _> =
                rows.iter().map(|row| row.iter().map(|word| word.parse()).collect()).collect();
            let numbers = numbers.map_err(|e| about(path, format!("expected lines of six numbers, found {e}")))?;
            if let Some(bad) = numbers.iter().find(|row| row.len() != 6) {
                return Err(about(path, format!("expected lines of six numbers, found {}", bad.len())));
            }
            let side = |first: usize| numbers.iter().map(|row| DVec3::from_slice(&row[first..])).collect::<Vec<_>>();
            let (similarity, error) = Similarity::from_points(&side(0), &side(3)).map_err(|e| about(path, e))?;
            let fit = format!("{}: {} markers fit within {:.1} mm (rms)", path.display(), numbers.len(), 1e3 * error);
            crate::progress::remark(&fit);
            similarity
        } else if let Some(path) = &self.trajectory {
            let (mut from, mut to) = (Vec::new(), Vec::new());
            for row in rows(path)? {
                let place: Option<Vec<f64>> = row.iter().skip(1).map(|word| word.parse().ok()).collect();
                let place = place.filter(|p| p.len() == 3);
                let place =
                    place.ok_or_else(|| about(path, format!("expected `image X Y Z`, found {}", row.join(" "))))?;
                let names = &input.capture.names;
                let exact = names.iter().position(|name| *name == row[0] || name.ends_with(&format!("/{}", row[0])));
                if let Some(frame) = exact.or_else(|| names.iter().position(|name| bare(name) == bare(&row[0]))) {
                    from.push(input.capture.frames[frame].camera.camera_from_world.inverse().position);
                    to.push(DVec3::from_slice(&place));
                }
            }
            let (used, of) = (from.len(), rows(path)?.len());
            let (similarity, error) = Similarity::from_points(&from, &to).map_err(|e| {
                let example = input.capture.names.first().map_or("", |name| bare(name));
                about(
                    path,
                    format!("{e}; {used} of {of} lines name an image of {}, such as {example}", self.scene.display()),
                )
            })?;
            print_message!(
                "{}: {used} of {of} places are of a frame, and fit within {:.1} mm (rms)",
                path.display(),
                1e3 * error
            );
            similarity
        } else if let Some(similarity) = distance {
            similarity
        } else {
            return Ok(Similarity::IDENTITY);
        };
        input.capture.frames.iter_mut().for_each(|frame| metric_from_scene.apply_to_frame(frame));
        if let Some(points) = &mut input.points {
            points.points.iter_mut().for_each(|p| *p = metric_from_scene.transform_point(*p));
        }
        Ok(metric_from_scene)
    }

    /// Turns the mesh so that its largest plane that faces the cameras' up has that for z; a plane that is hardly ground is a doubt for `lost`.
    pub(super) fn level(
        &self,
        frames: &[DepthFrame],
        mesh: &mut TriangleMesh,
        lost: &mut Vec<String>,
    ) -> Result<Similarity, Failure> {
        // People hold cameras upright: the mean of the images' up is up, more or less.
        let held = |frame: &DepthFrame| frame.camera.camera_from_world.inverse().transform_vector(DVec3::NEG_Y);
        let level = Similarity::from_ground(mesh, frames.iter().map(held).sum(), self.voxel, 300)?;
        level.apply(mesh);
        lost.extend(doubt(flat_share(mesh, self.voxel)));
        Ok(level)
    }
}

/// The name of an image without its folder, its ending, and what RGB-D frames have before that.
fn bare(name: &str) -> &str {
    let file = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let stem = [".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG"].iter().find_map(|ending| file.strip_suffix(ending));
    let stem = stem.unwrap_or(file);
    [".color", ".depth"].iter().find_map(|kind| stem.strip_suffix(kind)).unwrap_or(stem)
}

/// Lines of words, without comments.
fn rows(path: &Path) -> Result<Vec<Vec<String>>, Failure> {
    let text = fs::read_to_string(path).map_err(|e| about(path, format!("expected a text file, found {e}")))?;
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default());
    let rows = lines.map(|line| line.split_whitespace().map(String::from).collect::<Vec<_>>());
    Ok(rows.filter(|row| !row.is_empty()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_plane_is_doubted_and_a_floor_is_not() {
        assert!(doubt(0.29).is_none());
        let doubt = doubt(0.011).unwrap();
        assert!(doubt.contains("1.1 %") && doubt.contains("hint: give the up direction as --up x,y,z"), "{doubt}");
    }
}
