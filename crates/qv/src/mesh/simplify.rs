//! `--triangles`: as many as the finished mesh may have, walls and floor of the solid included.

use qv_core::TriangleMesh;
use qv_mesh::close::close_to_solid;
use qv_mesh::decimate::{DecimateOptions, Decimation, decimate};

/// Floor of the solid below its lowest point \[m\].
pub(super) const THICKNESS: f64 = 0.2;
/// Simplifications at most: walls and floor have fewer triangles when the rim has fewer sides.
const TRIES: usize = 4;

/// A surface that is simplified.
pub(super) struct SimpleSurface {
    /// The open surface.
    pub mesh: TriangleMesh,
    pub decimated: Decimation,
    /// Triangles of walls and floor that will close it.
    pub added: usize,
}

/// Simplifies an open surface so that it has at most `options.triangles`, with the walls and the floor where it will be closed to a solid; more
/// are left where the surface would move too far.
pub(super) fn simplify(surface: &TriangleMesh, options: &DecimateOptions, is_solid: bool) -> SimpleSurface {
    let of = |triangles: usize| {
        let mut mesh = surface.clone();
        let decimated = decimate(&mut mesh, &DecimateOptions { triangles, max_error: options.max_error });
        let added = if is_solid { closing(&mesh) } else { 0 };
        SimpleSurface { mesh, decimated, added }
    };
    let mut goal = options.triangles;
    let mut found = of(goal);
    for _ in 1..TRIES {
        let all = found.mesh.triangles.len() + found.added;
        // What the error limit stopped stops again.
        if all <= options.triangles || found.mesh.triangles.len() > goal {
            break;
        }
        goal = options.triangles.saturating_sub(found.added).max(4);
        found = of(goal);
    }
    found
}

/// Triangles that closing adds.
fn closing(mesh: &TriangleMesh) -> usize {
    let mut solid = mesh.clone();
    close_to_solid(&mut solid, THICKNESS);
    solid.triangles.len() - mesh.triangles.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A plate of `n` by `n` cells, or a rough one, which no simplification leaves near itself.
    fn plate(n: u32, roughness: f64) -> TriangleMesh {
        let height = |x: u32, y: u32| roughness * f64::from((x * 7919 + y * 104_729) % 17);
        let vertices = (0..=n)
            .flat_map(|y| (0..=n).map(move |x| DVec3::new(0.1 * f64::from(x), 0.1 * f64::from(y), height(x, y))));
        let cell = |x: u32, y: u32| {
            let a = y * (n + 1) + x;
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        };
        let triangles = (0..n).flat_map(|y| (0..n).flat_map(move |x| cell(x, y)));
        TriangleMesh { vertices: vertices.collect(), triangles: triangles.collect(), ..Default::default() }
    }

    #[test]
    fn walls_and_floor_are_within_the_number() {
        let options = DecimateOptions { triangles: 700, max_error: 0.05 };
        let found = simplify(&plate(30, 1e-4), &options, true);
        let all = found.mesh.triangles.len() + found.added;
        assert!(found.added > 0 && all <= 700, "{all} of which {} close it", found.added);
        let open = simplify(&plate(30, 1e-4), &options, false);
        assert!(open.added == 0 && open.mesh.triangles.len() > found.mesh.triangles.len());
    }

    #[test]
    fn a_surface_that_would_move_too_far_keeps_more() {
        let rough = plate(20, 0.01);
        let found = simplify(&rough, &DecimateOptions { triangles: 100, max_error: 1e-6 }, true);
        assert!(found.mesh.triangles.len() > 600, "{}", found.mesh.triangles.len());
    }
}
