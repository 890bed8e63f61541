//! Triangle meshes with a material per triangle.

use crate::CoreError;
use glam::DVec3;

/// A surface material: what a label in a mesh stands for.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name of the label, such as `grass`.
    pub name: String,
    /// Coulomb friction coefficient of a rubber foot on it; `None` when unknown.
    pub friction: Option<f64>,
}

/// Colours of labels in pictures: they can be distinguished by most (Okabe and Ito 2008), in the order of the labels.
const LABEL_COLOURS: [[u8; 3]; 8] = [
    [170, 170, 170],
    [0, 158, 115],
    [86, 180, 233],
    [230, 159, 0],
    [204, 121, 167],
    [240, 228, 66],
    [0, 114, 178],
    [213, 94, 0],
];

/// Colour of a label in all pictures, red, green, blue; the ninth has that of the first.
pub fn label_colour(label: usize) -> [u8; 3] {
    LABEL_COLOURS[label % LABEL_COLOURS.len()]
}

/// Triangles in metres, z up, counter-clockwise seen from outside, with one material index per triangle.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions \[m\], shape `[V]`.
    pub vertices: Vec<DVec3>,
    /// Vertex indices, shape `[F]`.
    pub triangles: Vec<[u32; 3]>,
    /// Index into `materials` for each triangle, shape `[F]`; empty when the mesh carries no labels.
    pub labels: Vec<u16>,
    /// What the labels stand for.
    pub materials: Vec<Material>,
}

impl TriangleMesh {
    /// Checks indices, lengths and finiteness.
    ///
    /// # Errors
    /// Names the first triangle, vertex or array that is off.
    pub fn validate(&self) -> Result<(), CoreError> {
        if let Some((index, vertex)) = self.vertices.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(CoreError::NotFinite { what: "vertex", index, found: vertex.to_string() });
        }
        for (triangle, indices) in self.triangles.iter().enumerate() {
            if let Some(&found) = indices.iter().find(|&&i| i as usize >= self.vertices.len()) {
                return Err(CoreError::VertexIndex { triangle, vertices: self.vertices.len(), found });
            }
        }
        if self.labels.is_empty() {
            return Ok(());
        }
        if self.labels.len() != self.triangles.len() {
            return Err(CoreError::Length { what: "labels", expected: self.triangles.len(), found: self.labels.len() });
        }
        match self.labels.iter().find(|&&l| l as usize >= self.materials.len()) {
            Some(&label) => {
                Err(CoreError::Length { what: "materials", expected: label as usize + 1, found: self.materials.len() })
            }
            None => Ok(()),
        }
    }

    /// Corners of one triangle \[m\].
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|i| self.vertices[i as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_triangle() -> TriangleMesh {
        TriangleMesh {
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            triangles: vec![[0, 1, 2]],
            labels: vec![0],
            materials: vec![Material { name: "grass".into(), friction: Some(0.6) }],
        }
    }

    #[test]
    fn a_good_mesh_passes() {
        assert_eq!(one_triangle().validate(), Ok(()));
    }

    #[test]
    fn each_fault_is_named() {
        let mut mesh = one_triangle();
        mesh.triangles[0][2] = 9;
        assert_eq!(mesh.validate(), Err(CoreError::VertexIndex { triangle: 0, vertices: 3, found: 9 }));
        let mut mesh = one_triangle();
        mesh.vertices[1].x = f64::NAN;
        assert!(matches!(mesh.validate(), Err(CoreError::NotFinite { index: 1, .. })));
        let mut mesh = one_triangle();
        mesh.labels[0] = 3;
        assert!(matches!(mesh.validate(), Err(CoreError::Length { what: "materials", expected: 4, found: 1 })));
        let mut mesh = one_triangle();
        mesh.labels.push(0);
        assert!(matches!(mesh.validate(), Err(CoreError::Length { what: "labels", expected: 1, found: 2 })));
    }
}
