//! Labelled terrain meshes in GLB: a material per label, its friction in `extras.friction`.

use crate::MeshError;
use crate::error::off;
use glam::{DMat4, DVec3};
use gltf::Gltf;
use gltf::mesh::Mode;
use qv_core::{Material, TriangleMesh};
use serde_json::json;

const PLACE: &str = "GLB";

/// Reads all triangles of the default scene, in world coordinates as the file has them (z up, metres).
///
/// # Errors
/// Says what is not GLB, what is not triangles, which index or number is off.
pub fn read(bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let gltf = Gltf::from_slice(bytes).map_err(|e| off(PLACE, "a GLB file", e))?;
    let blob = gltf.blob.as_deref();
    let mut mesh = TriangleMesh::default();
    for material in gltf.materials() {
        let name = material.name().map_or_else(|| format!("material {}", material.index().unwrap_or(0)), String::from);
        mesh.materials.push(Material { name, friction: friction(&material)? });
    }
    // Triangles without a material get a label of their own.
    mesh.materials.push(Material { name: "unlabelled".into(), friction: None });
    let scene = gltf.default_scene().or_else(|| gltf.scenes().next()).ok_or_else(|| off(PLACE, "a scene", "none"))?;
    for node in scene.nodes() {
        add_node(&node, DMat4::IDENTITY, blob, &mut mesh, 0)?;
    }
    mesh.validate()?;
    Ok(mesh)
}

fn friction(material: &gltf::Material) -> Result<Option<f64>, MeshError> {
    let Some(extras) = material.extras() else { return Ok(None) };
    let extras: serde_json::Value =
        serde_json::from_str(extras.get()).map_err(|e| off("extras of a material", "JSON", e))?;
    match extras.get("friction") {
        None => Ok(None),
        Some(value) => match value.as_f64().filter(|f| *f >= 0.0) {
            Some(friction) => Ok(Some(friction)),
            None => {
                Err(off(format!("extras.friction of material {:?}", material.name()), "a number of at least 0", value))
            }
        },
    }
}

fn add_node(
    node: &gltf::Node,
    parent: DMat4,
    blob: Option<&[u8]>,
    mesh: &mut TriangleMesh,
    depth: usize,
) -> Result<(), MeshError> {
    if depth > 64 {
        return Err(off(PLACE, "nodes nested at most 64 deep", "more"));
    }
    let local = DMat4::from_cols_array_2d(&node.transform().matrix().map(|c| c.map(f64::from)));
    let world_from_node = parent * local;
    for primitive in node.mesh().iter().flat_map(|m| m.primitives()) {
        add_primitive(&primitive, world_from_node, blob, mesh)?;
    }
    node.children().try_for_each(|child| add_node(&child, world_from_node, blob, mesh, depth + 1))
}

fn add_primitive(
    primitive: &gltf::Primitive,
    world_from_node: DMat4,
    blob: Option<&[u8]>,
    mesh: &mut TriangleMesh,
) -> Result<(), MeshError> {
    if primitive.mode() != Mode::Triangles {
        return Err(off(PLACE, "primitives of triangles", format!("{:?}", primitive.mode())));
    }
    let reader = primitive.reader(|buffer| blob.filter(|_| matches!(buffer.source(), gltf::buffer::Source::Bin)));
    let positions = reader
        .read_positions()
        .ok_or_else(|| off(PLACE, "positions in the file's own buffer", "a primitive without"))?;
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend(positions.map(|p| world_from_node.transform_point3(DVec3::from_array(p.map(f64::from)))));
    let added = mesh.vertices.len() as u32 - first;
    let indices: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..added).collect(),
    };
    let label = primitive.material().index().unwrap_or(mesh.materials.len() - 1) as u16;
    for corner in indices.chunks_exact(3) {
        if let Some(&bad) = corner.iter().find(|&&i| i >= added) {
            return Err(off(PLACE, format!("vertex indices below {added}"), bad));
        }
        mesh.triangles.push([first + corner[0], first + corner[1], first + corner[2]]);
        mesh.labels.push(label);
    }
    Ok(())
}

/// A GLB of the mesh: one primitive per material that has triangles, its friction in `extras.friction`. Positions become
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
    for label in 0..mesh.materials.len() {
        let of_label = mesh.triangles.iter().zip(&mesh.labels).filter(|(_, l)| usize::from(**l) == label);
        let indices: Vec<u32> = of_label.flat_map(|(triangle, _)| *triangle).collect();
        if indices.is_empty() {
            continue;
        }
        primitives.push(json!({"attributes": {"POSITION": 0}, "indices": accessors.len(), "material": label}));
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
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}], "materials": mesh.materials.iter().map(material).collect::<Vec<_>>(),
        "buffers": [{"byteLength": data.len()}], "bufferViews": views, "accessors": accessors,
    });
    container(document.to_string().into_bytes(), data)
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

    /// Two triangles with two materials, one of which states its friction.
    fn example(index: u8) -> Vec<u8> {
        let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
            "nodes":[{"mesh":0,"translation":[1,2,3]}],
            "materials":[{"name":"ice","extras":{"friction":0.1}},{"name":"grass"}],
            "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0},
              {"attributes":{"POSITION":0},"material":1}]}],
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

    #[test]
    fn bad_files_are_named() {
        assert!(read(&example(7)).unwrap_err().to_string().contains("indices below 3, found 7"));
        assert!(read(b"no glb").is_err());
        let full = example(2);
        for length in 0..full.len() {
            assert!(read(&full[..length]).is_err(), "{length} bytes");
        }
    }
}
