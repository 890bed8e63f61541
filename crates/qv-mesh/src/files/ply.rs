//! Meshes in PLY (Turk, *The PLY Polygon File Format*, 1994): written binary, with a label and its colour for each face; read
//! binary (little-endian) or ASCII.

use crate::MeshError;
use crate::error::off;
use glam::DVec3;
use qv_core::{Material, TriangleMesh};

const PLACE: &str = "PLY";
/// Longest header that is looked through for its end, bytes.
const LONGEST_HEADER: usize = 1 << 20;
/// Colours of labels, in turn.
const COLOURS: [[u8; 3]; 8] = [
    [150, 150, 150],
    [90, 160, 60],
    [190, 100, 70],
    [140, 120, 100],
    [60, 120, 190],
    [200, 180, 60],
    [150, 80, 160],
    [60, 160, 150],
];

/// A file of the mesh. Vertices are 64-bit. Each face has `label`, the index of its material, and a colour for it; names and friction
/// of the materials are comments.
pub fn write(mesh: &TriangleMesh) -> Vec<u8> {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\ncomment metres, z up\n");
    for (index, material) in mesh.materials.iter().enumerate() {
        let friction = material.friction.map_or(String::from("unknown"), |f| f.to_string());
        let name = material.name.replace(['\n', '\r'], " ");
        header += &format!("comment label {index} friction {friction} name {name}\n");
    }
    let labels = if mesh.labels.is_empty() {
        ""
    } else {
        "property ushort label\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    };
    header += &format!(
        "element vertex {}\nproperty double x\nproperty double y\nproperty double z\nelement face {}\n\
         property list uchar int vertex_indices\n{labels}end_header\n",
        mesh.vertices.len(),
        mesh.triangles.len()
    );
    let mut out = header.into_bytes();
    out.extend(mesh.vertices.iter().flat_map(|v| v.to_array()).flat_map(f64::to_le_bytes));
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        out.push(3);
        out.extend(triangle.iter().flat_map(|i| i.to_le_bytes()));
        if let Some(label) = mesh.labels.get(t) {
            out.extend(label.to_le_bytes());
            out.extend(COLOURS[*label as usize % COLOURS.len()]);
        }
    }
    out
}

/// A number's type: bytes, and whether it is a float, and whether signed.
#[derive(Debug, Clone, Copy)]
struct Kind {
    bytes: usize,
    float: bool,
    signed: bool,
}

impl Kind {
    fn of_name(name: &str) -> Option<Self> {
        let (bytes, float, signed) = match name {
            "char" | "int8" => (1, false, true),
            "uchar" | "uint8" => (1, false, false),
            "short" | "int16" => (2, false, true),
            "ushort" | "uint16" => (2, false, false),
            "int" | "int32" => (4, false, true),
            "uint" | "uint32" => (4, false, false),
            "float" | "float32" => (4, true, true),
            "double" | "float64" => (8, true, true),
            _ => return None,
        };
        Some(Self { bytes, float, signed })
    }
}

struct Property {
    name: String,
    kind: Kind,
    /// Type of the length, for a list.
    list: Option<Kind>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Numbers one after the other.
enum Body<'a> {
    Binary { bytes: &'a [u8], at: usize },
    Text(std::str::SplitAsciiWhitespace<'a>),
}

impl Body<'_> {
    fn number(&mut self, kind: Kind) -> Result<f64, MeshError> {
        match self {
            Self::Text(words) => {
                let word = words.next().ok_or_else(|| off(PLACE, "more numbers", "the end of the file"))?;
                word.parse().map_err(|_| off(PLACE, "a number", word))
            }
            Self::Binary { bytes, at } => {
                let found = bytes.get(*at..*at + kind.bytes);
                let found = found.ok_or_else(|| {
                    off(PLACE, format!("{} bytes from byte {at} of its body", kind.bytes), "the end of the file")
                })?;
                *at += kind.bytes;
                let mut wide = [0u8; 8];
                wide[..kind.bytes].copy_from_slice(found);
                let whole = u64::from_le_bytes(wide);
                Ok(match (kind.float, kind.bytes) {
                    (true, 4) => f64::from(f32::from_bits(whole as u32)),
                    (true, _) => f64::from_bits(whole),
                    (false, bytes) if kind.signed => ((whole << (64 - 8 * bytes)) as i64 >> (64 - 8 * bytes)) as f64,
                    (false, _) => whole as f64,
                })
            }
        }
    }
}

/// Reads a mesh; polygons are cut to fans of triangles. Labels come from a face property `label` and the comments of [`write()`].
///
/// # Errors
/// The header is off, the body is cut off, faces name vertices that there are not, or there are no faces.
pub fn read(file: &[u8]) -> Result<TriangleMesh, MeshError> {
    let (header, body) = split(file)?;
    let (elements, binary, materials) = parse(header)?;
    let mut body = if binary {
        Body::Binary { bytes: body, at: 0 }
    } else {
        Body::Text(std::str::from_utf8(body).map_err(|e| off(PLACE, "text", e))?.split_ascii_whitespace())
    };
    let mut mesh = TriangleMesh { materials, ..Default::default() };
    for element in &elements {
        for row in 0..element.count {
            read_row(element, row, &mut body, &mut mesh)?;
        }
    }
    if mesh.triangles.is_empty() {
        return Err(off(PLACE, "faces", "none"));
    }
    let most = mesh.labels.iter().max().map_or(0, |most| usize::from(*most) + 1);
    for index in mesh.materials.len()..most {
        mesh.materials.push(Material { name: format!("label {index}"), friction: None });
    }
    mesh.validate()?;
    Ok(mesh)
}

fn split(file: &[u8]) -> Result<(&str, &[u8]), MeshError> {
    let head = &file[..file.len().min(LONGEST_HEADER)];
    let end = head.windows(11).position(|window| window == b"\nend_header");
    let end = end.ok_or_else(|| off(PLACE, "a line end_header", format!("none in {} bytes", head.len())))?;
    let text = std::str::from_utf8(&head[..end]).map_err(|e| off("PLY header", "text", e))?;
    let after = &file[end + 11..];
    let line = after
        .iter()
        .position(|byte| *byte == b'\n')
        .ok_or_else(|| off(PLACE, "a line break after end_header", "none"))?;
    Ok((text, &after[line + 1..]))
}

/// Elements, whether the body is binary, and materials from comments.
fn parse(header: &str) -> Result<(Vec<Element>, bool, Vec<Material>), MeshError> {
    let mut elements: Vec<Element> = Vec::new();
    let (mut binary, mut materials) = (None, Vec::new());
    for (number, line) in header.lines().enumerate() {
        let place = || format!("PLY header, line {}", number + 1);
        let kind = |name: &str| Kind::of_name(name).ok_or_else(|| off(place(), "a type of PLY", name));
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["ply"] if number == 0 => {}
            ["comment", "label", index, "friction", friction, "name", name @ ..] => {
                if index.parse() == Ok(materials.len()) {
                    materials.push(Material { name: name.join(" "), friction: friction.parse().ok() });
                }
            }
            [] | ["comment" | "obj_info", ..] => {}
            ["format", "ascii", _] => binary = Some(false),
            ["format", "binary_little_endian", _] => binary = Some(true),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| off(place(), "a number of rows", count))?;
                elements.push(Element { name: (*name).into(), count, properties: vec![] });
            }
            ["property", rest @ ..] => {
                let element = elements.last_mut().ok_or_else(|| off(place(), "an element first", line))?;
                element.properties.push(match rest {
                    ["list", length, of, name] => {
                        Property { name: (*name).into(), kind: kind(of)?, list: Some(kind(length)?) }
                    }
                    [of, name] => Property { name: (*name).into(), kind: kind(of)?, list: None },
                    _ => return Err(off(place(), "a property", line)),
                });
            }
            _ => return Err(off(place(), "format, element, property or comment", line)),
        }
    }
    let binary = binary.ok_or_else(|| off("PLY header", "format ascii or binary_little_endian", "none of them"))?;
    Ok((elements, binary, materials))
}

fn read_row(element: &Element, row: usize, body: &mut Body, mesh: &mut TriangleMesh) -> Result<(), MeshError> {
    let mut point = DVec3::NAN;
    let (mut polygon, mut label) = (Vec::new(), None);
    for property in &element.properties {
        let count = match property.list {
            Some(length) => body.number(length)? as usize,
            None => 1,
        };
        for _ in 0..count {
            let value = body.number(property.kind)?;
            match (element.name.as_str(), property.name.as_str()) {
                ("vertex", "x") => point.x = value,
                ("vertex", "y") => point.y = value,
                ("vertex", "z") => point.z = value,
                ("face", "vertex_indices" | "vertex_index") => polygon.push(value),
                ("face", "label") => label = Some(value as u16),
                _ => {}
            }
        }
    }
    if element.name == "vertex" {
        mesh.vertices.push(point);
    }
    if let Some(bad) = polygon.iter().find(|i| !(0.0..=f64::from(u32::MAX)).contains(*i)) {
        return Err(off(format!("PLY face {row}"), "indices of vertices", bad));
    }
    for k in 1..polygon.len().saturating_sub(1) {
        mesh.triangles.push([polygon[0], polygon[k], polygon[k + 1]].map(|i| i as u32));
        mesh.labels.extend(label);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    fn mesh() -> TriangleMesh {
        TriangleMesh {
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.1), DVec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            labels: vec![1, 0],
            materials: vec![
                Material { name: "wet grass".into(), friction: Some(0.4) },
                Material { name: "stone".into(), friction: None },
            ],
        }
    }

    #[test]
    fn what_is_written_is_read() {
        assert_eq!(read(&write(&mesh())).unwrap(), mesh());
        let bare = TriangleMesh { labels: vec![], materials: vec![], ..mesh() };
        assert_eq!(read(&write(&bare)).unwrap(), bare);
    }

    #[test]
    fn text_and_polygons_are_read() {
        let text = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n\
            element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0 9\n1 0 0 9\n1 1 0.5 9\n0 1 0 9\n4 0 1 2 3\n";
        let found = read(text).unwrap();
        assert_eq!((found.triangles, found.vertices[2]), (vec![[0, 1, 2], [0, 2, 3]], DVec3::new(1.0, 1.0, 0.5)));
    }

    #[test]
    fn bad_files_are_named() {
        let full = write(&mesh());
        for length in 0..full.len() {
            assert!(read(&full[..length]).is_err(), "{length} bytes");
        }
        let fault = |text: &str| read(text.as_bytes()).unwrap_err().to_string();
        assert!(fault("ply\nformat binary_big_endian 1.0\nend_header\n").states("line 2"));
        let huge = "ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n";
        assert!(fault(huge).states("file"));
        let mut bad = mesh();
        bad.triangles[0][1] = 9;
        assert!(read(&write(&bad)).unwrap_err().to_string().states("indices 4 9"));
    }
}
