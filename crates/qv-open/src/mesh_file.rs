//! Mesh files that a URDF or MJCF names (STL, OBJ).

use glam::DVec3;
use qv_sim::MeshShape;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// The mesh `name` \[m\], as a URDF writes it: a path beside the URDF (in `directory`), `file://PATH`, or
/// `package://PACKAGE/PATH`, looked for in `directory` and the directories above it.
///
/// # Errors
/// Says where it was looked for, or what is wrong with the file.
pub fn read_mesh(directory: &Path, name: &str) -> Result<MeshShape, String> {
    let path = find(directory, name)
        .ok_or_else(|| format!("expected mesh `{name}` in {} or above it, found none", directory.display()))?;
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let wrong = |e: String| format!("{}: expected a mesh, found {e}", path.display());
    match extension.as_str() {
        "stl" => {
            let file = File::open(&path).map_err(|e| wrong(e.to_string()))?;
            let mesh = stl_io::read_stl(&mut BufReader::new(file)).map_err(|e| wrong(e.to_string()))?;
            Ok(MeshShape {
                vertices: mesh.vertices.iter().map(|v| DVec3::new(v[0].into(), v[1].into(), v[2].into())).collect(),
                triangles: mesh.faces.iter().map(|face| face.vertices.map(|i| i as u32)).collect(),
            })
        }
        "obj" => {
            let file = File::open(&path).map_err(|e| wrong(e.to_string()))?;
            let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
            // Shapes have no colours: what `mtllib` names, which may be any file, is not opened.
            let no_colours = |_: &Path| Ok::<_, tobj::LoadError>(Default::default());
            let (models, _) = tobj::load_obj_buf(&mut BufReader::new(file), &options, no_colours)
                .map_err(|e| wrong(e.to_string()))?;
            let mut all = MeshShape::default();
            for mesh in models.iter().map(|m| &m.mesh) {
                let first = all.vertices.len() as u32;
                let points = mesh.positions.chunks_exact(3);
                all.vertices.extend(points.map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into())));
                let triangles = mesh.indices.chunks_exact(3);
                all.triangles.extend(triangles.map(|t| [first + t[0], first + t[1], first + t[2]]));
            }
            Ok(all)
        }
        other => Err(wrong(format!("a file of type `{other}`; STL and OBJ are read"))),
    }
}

fn find(directory: &Path, name: &str) -> Option<PathBuf> {
    if let Some(path) = name.strip_prefix("file://") {
        return Some(PathBuf::from(path)).filter(|p| p.is_file());
    }
    let inside = name.strip_prefix("package://");
    let relative = inside.unwrap_or(name);
    // A package may be the directory that holds the URDF's own, or be named by one above it.
    let short = inside.and_then(|path| path.split_once('/')).map(|(_, path)| path);
    let above = directory.ancestors().take(if inside.is_some() { 6 } else { 1 });
    above
        .flat_map(|root| [Some(relative), short].into_iter().flatten().map(move |path| root.join(path)))
        .find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const TETRAHEDRON: [[f32; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    fn directory(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("qv-mesh-{name}-{}", std::process::id()));
        fs::create_dir_all(path.join("robot/urdf")).unwrap();
        fs::create_dir_all(path.join("robot/meshes")).unwrap();
        path
    }

    #[test]
    fn stl_and_obj_are_found_and_read() {
        let root = directory("read");
        let mut obj = String::new();
        let mut stl = String::from("solid t\n");
        for [x, y, z] in TETRAHEDRON {
            obj += &format!("v {x} {y} {z}\n");
        }
        for face in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
            obj += &format!("f {} {} {}\n", face[0] + 1, face[1] + 1, face[2] + 1);
            stl += "facet normal 0 0 1\nouter loop\n";
            for i in face {
                let [x, y, z] = TETRAHEDRON[i];
                stl += &format!("vertex {x} {y} {z}\n");
            }
            stl += "endloop\nendfacet\n";
        }
        fs::write(root.join("robot/meshes/t.obj"), obj).unwrap();
        fs::write(root.join("robot/meshes/t.stl"), stl + "endsolid t\n").unwrap();
        let urdf = root.join("robot/urdf");
        for name in ["package://robot/meshes/t.obj", "package://robot/meshes/t.stl", "package://else/meshes/t.stl"] {
            let found = read_mesh(&urdf, name).unwrap();
            assert_eq!((found.vertices.len(), found.triangles.len()), (4, 4), "{name}");
            assert!(found.vertices.contains(&DVec3::Z) && found.is_closed(), "{name}");
        }
        assert_eq!(read_mesh(&root.join("robot"), "meshes/t.stl").unwrap().vertices.len(), 4);
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn materials_of_a_mesh_are_not_opened() {
        let root = directory("materials");
        let mut obj = String::from("mtllib /dev/zero\nmtllib gone.mtl\n");
        TETRAHEDRON.iter().for_each(|[x, y, z]| obj += &format!("v {x} {y} {z}\n"));
        fs::write(root.join("m.obj"), obj + "usemtl red\nf 1 3 2\nf 1 2 4\n").unwrap();
        assert_eq!(read_mesh(&root, "m.obj").map(|all| all.vertices.len()), Ok(4));
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        let root = directory("wrong");
        fs::write(root.join("cut.stl"), [0u8; 90]).unwrap();
        fs::write(root.join("scan.dae"), "<COLLADA/>").unwrap();
        fs::write(root.join("bad.obj"), "v 1 x 2\n").unwrap();
        for (name, word) in
            [("cut.stl", "cut.stl"), ("scan.dae", "`dae`"), ("bad.obj", "bad.obj"), ("gone.stl", "gone.stl")]
        {
            let error = read_mesh(&root, name).map(|mesh| mesh.vertices.len());
            // A binary STL of no triangles is a mesh without vertices.
            let is_empty = name == "cut.stl" && error == Ok(0);
            assert!(is_empty || error.as_ref().is_err_and(|e| e.contains(word)), "{name}: {error:?}");
        }
        fs::remove_dir_all(root).unwrap();
    }
}
