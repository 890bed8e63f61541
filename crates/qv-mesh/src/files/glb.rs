//! Labelled terrain meshes in GLB: a material per label, its friction in `extras.friction`.

use super::gltf::{Document, index, list, number, transform};
use crate::MeshError;
use crate::error::off;
use glam::{DMat4, DVec3};
use qv_core::{Material, TriangleMesh};
use serde_json::{Value, json};

const PLACE: &str = "GLB";
/// `primitive.mode` of triangles.
const TRIANGLES: usize = 4;
/// Nodes and primitives of a scene, and how deep they lie in each other.
const MOST_NODES: usize = 200_000;
const DEEPEST: usize = 64;
/// Vertices and triangles that any file may place; larger ones as many as they have bytes. A mesh that many nodes name is placed many times.
const ANY_SIZE: usize = 2_000_000;

/// Reads all triangles of the default scene, in world coordinates as the file has them (z up, metres).
///
/// # Errors
/// Says what is not GLB, what is not triangles, which index or number is off, and where a small file places too many triangles.
pub fn read(bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let document = Document::parse(bytes)?;
    let mut mesh = TriangleMesh::default();
    for (index, material) in document.list("materials").iter().enumerate() {
        let name = material.get("name").and_then(Value::as_str);
        let name = name.map_or_else(|| format!("material {index}"), String::from);
        mesh.materials.push(Material { friction: friction(material, &name)?, name });
    }
    if mesh.materials.len() >= usize::from(u16::MAX) {
        return Err(off(PLACE, format!("fewer than {} materials", u16::MAX), mesh.materials.len()));
    }
    // Triangles without a material get a label of their own.
    mesh.materials.push(Material { name: "unlabelled".into(), friction: None });
    let mut placing = Placing { most: ANY_SIZE + bytes.len(), document, mesh, visited: 0 };
    let nodes = list(placing.document.scene()?, "nodes").to_vec();
    placing.nodes(&nodes, DMat4::IDENTITY, 0)?;
    let mesh = placing.mesh;
    mesh.validate()?;
    Ok(mesh)
}

fn friction(material: &Value, name: &str) -> Result<Option<f64>, MeshError> {
    match material.get("extras").and_then(|extras| extras.get("friction")) {
        None => Ok(None),
        Some(value) => match value.as_f64().filter(|f| *f >= 0.0) {
            Some(friction) => Ok(Some(friction)),
            None => Err(off(format!("extras.friction of material {name:?}"), "a number of at least 0", value)),
        },
    }
}

/// A mesh that grows as nodes are placed.
struct Placing<'a> {
    document: Document<'a>,
    mesh: TriangleMesh,
    /// Nodes and primitives so far.
    visited: usize,
    /// Vertices and triangles that may be placed.
    most: usize,
}

impl Placing<'_> {
    fn nodes(&mut self, nodes: &[Value], world_from_parent: DMat4, depth: usize) -> Result<(), MeshError> {
        if depth > DEEPEST {
            return Err(off(PLACE, format!("nodes nested at most {DEEPEST} deep"), "more"));
        }
        for node in nodes {
            self.count()?;
            let node = self.document.entry("nodes", index(node, "node")?)?;
            let world_from_node = world_from_parent * transform(node)?;
            let children = list(node, "children").to_vec();
            if let Some(mesh) = number(node, "mesh")? {
                for primitive in list(self.document.entry("meshes", mesh)?, "primitives").to_vec() {
                    self.count()?;
                    self.primitive(&primitive, world_from_node)?;
                }
            }
            self.nodes(&children, world_from_node, depth + 1)?;
        }
        Ok(())
    }

    fn count(&mut self) -> Result<(), MeshError> {
        self.visited += 1;
        if self.visited > MOST_NODES {
            return Err(off(PLACE, format!("a scene of at most {MOST_NODES} nodes and primitives"), "more"));
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &Value, world_from_node: DMat4) -> Result<(), MeshError> {
        let mode = number(primitive, "mode")?.unwrap_or(TRIANGLES);
        if mode != TRIANGLES {
            return Err(off(PLACE, "primitives of triangles", format!("mode {mode}")));
        }
        let attributes = primitive.get("attributes").unwrap_or(&Value::Null);
        let positions =
            number(attributes, "POSITION")?.ok_or_else(|| off(PLACE, "positions", "a primitive without"))?;
        let positions = self.document.positions(positions)?;
        let added = positions.len() as u32;
        let indices = match number(primitive, "indices")? {
            Some(indices) => self.document.indices(indices)?,
            None => (0..added).collect(),
        };
        let size = self.mesh.vertices.len() + self.mesh.triangles.len() + positions.len() + indices.len() / 3;
        if size > self.most {
            return Err(off(
                PLACE,
                format!("at most {} vertices and triangles in a file of its size", self.most),
                "more",
            ));
        }
        let first = self.mesh.vertices.len() as u32;
        let label = match number(primitive, "material")? {
            Some(material) => self.document.entry("materials", material).map(|_| material)?,
            None => self.mesh.materials.len() - 1,
        };
        for corner in indices.chunks_exact(3) {
            if let Some(&bad) = corner.iter().find(|&&i| i >= added) {
                return Err(off(PLACE, format!("vertex indices below {added}"), bad));
            }
            self.mesh.triangles.push([first + corner[0], first + corner[1], first + corner[2]]);
            self.mesh.labels.push(label as u16);
        }
        self.mesh.vertices.extend(positions.into_iter().map(|p| world_from_node.transform_point3(p)));
        Ok(())
    }
}

/// A GLB of the mesh: one primitive per material that has triangles, or one without a material when there are no labels, friction in `extras.friction`. Positions become
/// 32-bit numbers, as the format has them.
pub fn write(mesh: &TriangleMesh) -> Vec<u8> {
    let mut data: Vec<u8> = Vec::new();
    let (mut views, mut accessors, mut primitives) = (Vec::new(), Vec::new(), Vec::new());
    let float = |v: &DVec3| v.to_array().map(|x| x as f32);
    let corners = |end: fn(f32, f32) -> f32, start: f32| {
        mesh.vertices.iter().map(float).fold([start; 3], |a, v| std::array::from_fn(|k| end(a[k], v[k])))
    };
    let (low, high) = (corners(f32::min, f32::INFINITY), corners(f32::max, f32::NEG_INFINITY));
    data.extend(mesh.vertices.iter().flat_map(|v| float(v).into_iter().flat_map(f32::to_le_bytes)));
    views.push(json!({"buffer": 0, "byteOffset": 0, "byteLength": data.len(), "target": 34962}));
    accessors.push(json!({"bufferView": 0, "componentType": 5126, "count": mesh.vertices.len(), "type": "VEC3",
        "min": low, "max": high}));
    for (label, indices) in parts(mesh) {
        let mut primitive = json!({"attributes": {"POSITION": 0}, "indices": accessors.len()});
        if let Some(label) = label {
            primitive["material"] = json!(label);
        }
        primitives.push(primitive);
        let view = json!({"buffer": 0, "byteOffset": data.len(), "byteLength": 4 * indices.len(), "target": 34963});
        accessors
            .push(json!({"bufferView": views.len(), "componentType": 5125, "count": indices.len(), "type": "SCALAR"}));
        views.push(view);
        data.extend(indices.into_iter().flat_map(u32::to_le_bytes));
    }
    let material = |m: &Material| match m.friction {
        Some(friction) => json!({"name": m.name, "extras": {"friction": friction}}),
        None => json!({"name": m.name}),
    };
    let mut document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "buffers": [{"byteLength": data.len()}], "bufferViews": views, "accessors": accessors,
    });
    // The format has no empty lists.
    if !mesh.materials.is_empty() {
        document["materials"] = mesh.materials.iter().map(material).collect();
    }
    container(document.to_string().into_bytes(), data)
}

/// Vertex indices of the triangles of each label that has some; of all triangles when there are no labels.
fn parts(mesh: &TriangleMesh) -> Vec<(Option<usize>, Vec<u32>)> {
    if mesh.labels.is_empty() {
        return vec![(None, mesh.triangles.concat())];
    }
    let of = |label: usize| {
        let of_label = mesh.triangles.iter().zip(&mesh.labels).filter(|(_, l)| usize::from(**l) == label);
        (Some(label), of_label.flat_map(|(triangle, _)| *triangle).collect::<Vec<u32>>())
    };
    (0..mesh.materials.len()).map(of).filter(|(_, indices)| !indices.is_empty()).collect()
}

/// The two chunks of a GLB, each padded to four bytes as the format demands.
fn container(mut document: Vec<u8>, mut data: Vec<u8>) -> Vec<u8> {
    document.resize(document.len().next_multiple_of(4), b' ');
    data.resize(data.len().next_multiple_of(4), 0);
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend(((12 + 8 + document.len() + 8 + data.len()) as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &document), (b"BIN\0", &data)] {
        glb.extend((chunk.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(chunk);
    }
    glb
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn what_is_written_is_read() {
        let mut mesh = read(&example(2)).unwrap();
        let again = read(&write(&mesh)).unwrap();
        // Vertices that two materials share are read once for each; triangles stay what they are.
        let corners = |mesh: &TriangleMesh| (0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect::<Vec<_>>();
        assert_eq!(corners(&again), corners(&mesh));
        // The reader adds a label for triangles without one each time.
        mesh.materials.push(Material { name: "unlabelled".into(), friction: None });
        assert_eq!((again.labels, again.materials), (mesh.labels, mesh.materials));
    }

    #[test]
    fn a_mesh_without_labels_is_written_whole() {
        let mesh = read(&example(2)).unwrap();
        let bare = TriangleMesh { labels: vec![], materials: vec![], ..mesh };
        let again = read(&write(&bare)).unwrap();
        assert_eq!((again.vertices, again.triangles), (bare.vertices, bare.triangles));
        assert_eq!((again.labels, again.materials.len()), (vec![0, 0], 1));
    }

    /// Two triangles with two materials, one of which states its friction.
    fn example(index: u8) -> Vec<u8> {
        let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
            "nodes":[{"mesh":0,"translation":[1,2,3]}],
            "materials":[{"name":"ice","extras":{"friction":0.1}},{"name":"grass"}],
            "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0},
              {"attributes":{"POSITION":0},"mode":4,"material":1}]}],
            "buffers":[{"byteLength":40}],
            "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":3}],
            "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
              {"bufferView":1,"componentType":5121,"count":3,"type":"SCALAR"}]}"#;
        let json = json.as_bytes().to_vec();
        let mut data = Vec::new();
        for x in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
            data.extend_from_slice(&x.to_le_bytes());
        }
        data.extend_from_slice(&[0, 1, index, 0]);
        container(json, data)
    }

    #[test]
    fn labels_friction_and_placement() {
        let mesh = read(&example(2)).unwrap();
        assert_eq!((mesh.triangles.len(), mesh.labels.as_slice()), (2, &[0, 1][..]));
        assert_eq!(mesh.materials[0], Material { name: "ice".into(), friction: Some(0.1) });
        assert_eq!(mesh.materials[1].friction, None);
        assert_eq!(mesh.corners(0)[1], DVec3::new(2.0, 2.0, 3.0));
    }

    /// A GLB of one triangle whose document is changed by a text.
    fn changed(from: &str, to: &str) -> Vec<u8> {
        let whole = example(2);
        let length = u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
        let document = String::from_utf8(whole[20..20 + length].to_vec()).unwrap();
        assert!(document.contains(from), "{from}");
        container(document.replacen(from, to, 1).into_bytes(), whole[28 + length..].to_vec())
    }

    #[test]
    fn documents_that_claim_what_is_not_there_are_refused() {
        for (from, to) in [
            (r#""count":3"#, r#""count":4"#),
            (r#""count":3"#, r#""count":18446744073709551615"#),
            (r#""componentType":5126"#, r#""componentType":5125"#),
            (r#""componentType":5121"#, r#""componentType":5122"#),
            (r#""bufferView":0"#, r#""bufferView":7"#),
            (r#""type":"VEC3""#, r#""type":"VEC2""#),
            (r#""byteLength":36"#, r#""byteLength":36,"byteOffset":18446744073709551615"#),
            (r#""byteLength":36"#, r#""byteLength":36,"byteStride":1"#),
            (r#""accessors""#, r#""others""#),
            (r#""mesh":0"#, r#""mesh":1"#),
            (r#""mode":4,"material":1"#, r#""material":2"#),
            (r#""translation":[1,2,3]"#, r#""translation":[1,2]"#),
            (r#""translation":[1,2,3]"#, r#""children":[0]"#),
            (r#""scene":0"#, r#""scene":1"#),
        ] {
            assert!(read(&changed(from, to)).is_err(), "{to}");
        }
    }

    #[test]
    fn a_small_file_places_few_triangles() {
        // 2^40 of them: each node names the next one twice.
        let next = |k: usize| format!(r#"{{"children":[{},{}]}},"#, k + 1, k + 1);
        let nodes: String = (0..40).map(next).collect();
        let error = read(&changed(r#""nodes":[{"mesh""#, &format!(r#""nodes":[{nodes}{{"mesh""#)));
        assert!(error.is_err_and(|e| e.to_string().contains("nodes")));
    }

    #[test]
    fn bad_files_are_named() {
        assert!(read(&example(7)).unwrap_err().to_string().states("indices 3 7"));
        assert!(read(b"no glb").is_err());
        let full = example(2);
        for length in 0..full.len() {
            assert!(read(&full[..length]).is_err(), "{length} bytes");
        }
    }
}
