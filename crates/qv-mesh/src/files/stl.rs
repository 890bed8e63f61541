//! Binary STL (3D Systems, *StereoLithography Interface Specification*, 1989): triangles alone, without labels.

use qv_core::TriangleMesh;

/// A file of the mesh; positions become 32-bit numbers.
pub fn write(mesh: &TriangleMesh) -> Vec<u8> {
    let mut out = b"binary STL, metres, z up".to_vec();
    out.resize(80, 0);
    out.extend((mesh.triangles.len() as u32).to_le_bytes());
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(t);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let numbers = [normal, a, b, c].into_iter().flat_map(|v| v.to_array());
        out.extend(numbers.flat_map(|x| (x as f32).to_le_bytes()));
        out.extend([0, 0]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn bytes_are_where_they_belong() {
        let mesh = TriangleMesh {
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::new(0.0, 2.0, 0.0)],
            triangles: vec![[0, 1, 2]],
            ..Default::default()
        };
        let bytes = write(&mesh);
        let number = |at: usize| f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        assert_eq!((bytes.len(), bytes[80], number(84 + 8), number(84 + 24), number(84 + 40)), (134, 1, 1.0, 1.0, 2.0));
        assert!(!bytes.starts_with(b"solid"));
    }
}
