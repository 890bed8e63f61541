//! A sphere against triangles, with contacts at inner edges of a surface sorted out.

use glam::DVec3;
use parry3d_f64::bounding_volume::Aabb;

/// One triangle of a terrain.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Triangle {
    /// Index in the terrain.
    pub index: u32,
    /// Corners \[m\], counter-clockwise seen from above.
    pub corners: [DVec3; 3],
    /// Index of its material.
    pub material: Option<u16>,
}

/// Where a shape touches a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SurfaceContact {
    /// Negative = penetration \[m\].
    pub distance: f64,
    /// From terrain to robot.
    pub normal: DVec3,
    /// Point on the terrain \[m\].
    pub on_terrain: DVec3,
    /// Material of the triangle.
    pub material: Option<u16>,
    /// Whether the point lies inside the face, not on its rim.
    in_face: bool,
    triangle: [DVec3; 3],
}

impl Triangle {
    /// Whether the heights of its corners overlap an interval \[m\].
    #[inline(always)]
    pub fn reaches(&self, low: f64, high: f64) -> bool {
        let [a, b, c] = self.corners;
        a.z.min(b.z).min(c.z) <= high && a.z.max(b.z).max(c.z) >= low
    }

    /// Height of the triangle's plane above (x, y) when that lies within the triangle.
    pub fn height_at(&self, x: f64, y: f64) -> Option<f64> {
        let [a, b, c] = self.corners;
        let (u, v) = (b - a, c - a);
        let determinant = u.x * v.y - u.y * v.x;
        if determinant.abs() < 1e-18 {
            return None;
        }
        let (dx, dy) = (x - a.x, y - a.y);
        let (s, t) = ((dx * v.y - dy * v.x) / determinant, (u.x * dy - u.y * dx) / determinant);
        let slack = 1e-9;
        (s >= -slack && t >= -slack && s + t <= 1.0 + slack).then_some(a.z + s * u.z + t * v.z)
    }

    /// Contact of a sphere when it penetrates. Ground is solid below its faces: a centre just under a face is pushed
    /// out along the face's normal.
    #[inline(always)]
    pub fn sphere_contact(&self, centre: DVec3, radius: f64) -> Option<SurfaceContact> {
        let [a, b, c] = self.corners;
        let (point, in_face) = closest_point(centre, a, b, c);
        let offset = centre - point;
        // Most triangles end here, without a root or a normal; the margin leaves those in doubt to the test below.
        if offset.length_squared() > radius * radius * (1.0 + 1e-9) {
            return None;
        }
        let face_normal = (b - a).cross(c - a).normalize();
        let height = (centre - a).dot(face_normal);
        let length = offset.length();
        if height.abs() >= radius || length >= radius {
            return None;
        }
        let (distance, normal) = if in_face {
            (height - radius, face_normal)
        } else if height > 0.0 && length > 1e-12 {
            (length - radius, offset / length)
        } else {
            // Beside and below the rim: the neighbouring face has it.
            return None;
        };
        let (material, triangle) = (self.material, self.corners);
        Some(SurfaceContact { distance, normal, on_terrain: point, material, in_face, triangle })
    }

    /// Contact of a point that lies under the face (or within `skin` above it), no deeper than `most`.
    pub fn point_contact(&self, point: DVec3, skin: f64, most: f64) -> Option<SurfaceContact> {
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(c - a).normalize();
        let height = (point - a).dot(normal);
        if height >= skin || height < -most {
            return None;
        }
        let foot = point - normal * height;
        let slack = -1e-9;
        let inside = [(a, b), (b, c), (c, a)].iter().all(|&(p, q)| (q - p).cross(foot - p).dot(normal) >= slack);
        inside.then(|| SurfaceContact::new(height - skin, normal, foot, self))
    }
}

/// Contacts of a ball that are judged beside each other, the deepest: a ball on a mesh as fine as sand has fewer.
const MOST_JUDGED: usize = 1024;

impl SurfaceContact {
    /// A contact found by another method.
    pub fn new(distance: f64, normal: DVec3, on_terrain: DVec3, triangle: &Triangle) -> Self {
        let (material, triangle) = (triangle.material, triangle.corners);
        Self { distance, normal, on_terrain, material, in_face: true, triangle }
    }

    /// Of the contacts from `first` on: unless `inner_edges` are to be felt, drops contacts there. A rim contact is real only
    /// when no neighbour that shares the touched point is nearer to the sphere; of several contacts at one point (a
    /// ridge) the first stays. Then keeps the `most` deepest.
    #[inline(always)]
    pub fn sort_out(contacts: &mut Vec<Self>, first: usize, inner_edges: bool, most: usize) {
        if contacts.len() > first + MOST_JUDGED {
            contacts[first..].sort_by(|a, b| a.distance.total_cmp(&b.distance));
            contacts.truncate(first + MOST_JUDGED);
        }
        if !inner_edges && contacts.len() > first + 1 {
            Self::drop_inner_edges(contacts, first);
        }
        if contacts.len() > first + most {
            contacts[first..].sort_by(|a, b| a.distance.total_cmp(&b.distance));
            contacts.truncate(first + most);
        }
    }

    /// All are judged beside all others before any is dropped.
    fn drop_inner_edges(contacts: &mut Vec<Self>, first: usize) {
        let judged = &contacts[first..];
        let inner = |own: usize| {
            let contact = &judged[own];
            let covered = |(i, other): (usize, &Self)| i != own && other.covers(contact, i < own);
            !contact.in_face && judged.iter().enumerate().any(covered)
        };
        // As many as fit the bits of a number; more triangles at one ball are rare.
        const FEW: usize = 64;
        if judged.len() > FEW {
            let drop: Vec<bool> = (0..judged.len()).map(inner).collect();
            let mut drop = std::iter::repeat_n(false, first).chain(drop);
            return contacts.retain(|_| drop.next() == Some(false));
        }
        let drop = (0..judged.len()).fold(0u64, |bits, own| bits | u64::from(inner(own)) << own);
        if drop != 0 {
            let mut index = 0..contacts.len();
            contacts.retain(|_| index.next().is_some_and(|i| i < first || drop >> (i - first) & 1 == 0));
        }
    }

    fn covers(&self, rim: &Self, earlier: bool) -> bool {
        const SAME: f64 = 1e-9;
        let nearer = self.distance < rim.distance - SAME;
        let same = (self.on_terrain - rim.on_terrain).length_squared() < SAME * SAME;
        if same {
            return earlier || self.in_face;
        }
        let [a, b, c] = self.triangle;
        nearer && (closest_point(rim.on_terrain, a, b, c).0 - rim.on_terrain).length_squared() < SAME * SAME
    }
}

/// Closest point of a triangle, and whether it lies inside the face (Ericson, Real-Time Collision Detection, 5.1.5).
#[inline(always)]
fn closest_point(p: DVec3, a: DVec3, b: DVec3, c: DVec3) -> (DVec3, bool) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (a, false);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return (b, false);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (a + ab * (d1 / (d1 - d3)), false);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return (c, false);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (a + ac * (d2 / (d2 - d6)), false);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return (b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), false);
    }
    let inverse = 1.0 / (va + vb + vc);
    (a + ab * (vb * inverse) + ac * (vc * inverse), true)
}

/// The box about three corners.
pub(super) fn bounds(corners: &[DVec3; 3]) -> Aabb {
    let [a, b, c] = *corners;
    Aabb::new(a.min(b).min(c), a.max(b).max(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(offset: f64) -> Triangle {
        let corners = [DVec3::new(offset, 0.0, 0.0), DVec3::new(offset + 1.0, 0.0, 0.0), DVec3::new(offset, 1.0, 0.0)];
        Triangle { index: 0, corners, material: None }
    }

    #[test]
    fn face_contact_points_up_from_either_side() {
        for z in [0.015, 0.0, -0.005] {
            let contact = flat(0.0).sphere_contact(DVec3::new(0.3, 0.3, z), 0.02).unwrap();
            assert!((contact.normal - DVec3::Z).length() < 1e-12);
            assert!((contact.distance - (z - 0.02)).abs() < 1e-12);
        }
    }

    #[test]
    fn inner_edges_are_not_felt() {
        let left = Triangle { index: 1, corners: [DVec3::ZERO, DVec3::Y, DVec3::new(-1.0, 0.5, 0.0)], material: None };
        let centre = DVec3::new(0.002, 0.4, 0.018);
        let mut contacts: Vec<_> = [flat(0.0), left].iter().filter_map(|t| t.sphere_contact(centre, 0.02)).collect();
        assert_eq!(contacts.len(), 2, "both are touched");
        SurfaceContact::sort_out(&mut contacts, 0, false, 4);
        assert_eq!(contacts.len(), 1);
        assert!((contacts[0].normal - DVec3::Z).length() < 1e-12);
    }

    #[test]
    fn an_outer_edge_is_felt() {
        let contact = flat(0.0).sphere_contact(DVec3::new(0.5, -0.01, 0.01), 0.02).unwrap();
        assert!((contact.normal - DVec3::new(0.0, -1.0, 1.0).normalize()).length() < 1e-12);
    }
}
