//! Triangle meshes with a material per triangle.

use crate::CoreError;
use glam::DVec3;
use std::collections::HashMap;

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

/// Corners, edge by edge, of a triangle.
fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

impl TriangleMesh {
    /// Turns the faces of connected pieces that are wound the wrong way round: closed pieces inside out, and open ones most of whose area
    /// looks down. Vertices of the same place count as one. Returns how many triangles were turned.
    pub fn turn_outward(&mut self) -> usize {
        let welded = self.welded();
        let pieces = pieces(&welded);
        let count = pieces.iter().copied().max().map_or(0, |last| last + 1);
        let (mut volume, mut up, mut level) = (vec![0.0; count], vec![0.0; count], vec![0.0; count]);
        for (t, piece) in pieces.iter().enumerate() {
            let [a, b, c] = self.corners(t);
            let normal = (b - a).cross(c - a);
            volume[*piece] += a.dot(b.cross(c));
            up[*piece] += normal.z;
            level[*piece] += normal.z.abs();
        }
        let open = open_pieces(&welded, &pieces, count);
        let is_wrong = |k: usize| if open[k] { up[k] < -0.5 * level[k] } else { volume[k] < 0.0 };
        let wrong: Vec<bool> = (0..count).map(is_wrong).collect();
        let mut turned = 0;
        for (triangle, _) in self.triangles.iter_mut().zip(&pieces).filter(|(_, piece)| wrong[**piece]) {
            triangle.swap(1, 2);
            turned += 1;
        }
        turned
    }

    /// Triangles with one index for all vertices of a place.
    fn welded(&self) -> Vec<[u32; 3]> {
        let mut known = HashMap::new();
        let first: Vec<u32> = (0..self.vertices.len() as u32)
            .map(|i| *known.entry(self.vertices[i as usize].to_array().map(|x| (x + 0.0).to_bits())).or_insert(i))
            .collect();
        self.triangles.iter().map(|t| t.map(|i| first[i as usize])).collect()
    }

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

/// The piece of each triangle, counted from 0: those that share a vertex are of one.
fn pieces(triangles: &[[u32; 3]]) -> Vec<usize> {
    let vertices = triangles.iter().flatten().max().map_or(0, |last| *last as usize + 1);
    let mut parent: Vec<u32> = (0..vertices as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for [a, b, c] in triangles {
        let (a, b, c) = (root(&mut parent, *a), root(&mut parent, *b), root(&mut parent, *c));
        parent[b as usize] = a;
        let c = root(&mut parent, c);
        parent[c as usize] = a;
    }
    let mut numbers = HashMap::new();
    let mut number = |t: &[u32; 3]| {
        let (root, next) = (root(&mut parent, t[0]), numbers.len());
        *numbers.entry(root).or_insert(next)
    };
    triangles.iter().map(&mut number).collect()
}

/// Which pieces have an edge that one triangle alone has.
fn open_pieces(triangles: &[[u32; 3]], pieces: &[usize], count: usize) -> Vec<bool> {
    let mut sides: HashMap<[u32; 2], (usize, usize)> = HashMap::new();
    for (t, piece) in triangles.iter().zip(pieces) {
        for [a, b] in edges(*t) {
            sides.entry([a.min(b), a.max(b)]).or_insert((*piece, 0)).1 += 1;
        }
    }
    let mut open = vec![false; count];
    sides.values().filter(|(_, n)| *n == 1).for_each(|(piece, _)| open[*piece] = true);
    open
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
    fn pieces_that_look_down_or_inward_are_turned() {
        let plane = |up: bool| {
            let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
            let vertices = corners.iter().map(|[x, y]| DVec3::new(*x, *y, 0.0)).collect();
            let triangles = if up { vec![[0, 1, 2], [0, 2, 3]] } else { vec![[0, 2, 1], [0, 3, 2]] };
            TriangleMesh { vertices, triangles, labels: vec![], materials: vec![] }
        };
        let (mut up, mut down) = (plane(true), plane(false));
        assert_eq!((up.turn_outward(), down.turn_outward()), (0, 2));
        assert!((0..2).all(|t| {
            let [a, b, c] = down.corners(t);
            (b - a).cross(c - a).z > 0.0
        }));
        // A closed body, mirrored, beside a plane that is right: vertices of one place are written for each triangle, as exporters do.
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|p| DVec3::from_array(p) + 5.0);
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let mut both = plane(true);
        for face in faces {
            let first = both.vertices.len() as u32;
            both.vertices.extend(face.map(|i: usize| corners[i] * DVec3::new(-1.0, 1.0, 1.0)));
            both.triangles.push([first, first + 1, first + 2]);
        }
        assert_eq!((both.clone().turn_outward(), both.turn_outward(), both.turn_outward()), (4, 4, 0));
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
