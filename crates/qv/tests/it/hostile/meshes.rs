//! Meshes that name each other, numbers that are not there, and files that never end.

use super::bounded;
use crate::bags::directory;
use std::fs;

/// A GLB of a document, with 36 bytes of zeros.
fn glb(document: &str) -> Vec<u8> {
    let mut json = document.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((12 + 8 + json.len() as u32 + 8 + 36).to_le_bytes());
    file.extend((json.len() as u32).to_le_bytes());
    file.extend(b"JSON");
    file.extend(&json);
    file.extend(36u32.to_le_bytes());
    file.extend(b"BIN\0");
    file.extend([0u8; 36]);
    file
}

fn document(nodes: &str, accessor: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{nodes}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"buffers":[{{"byteLength":36}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}}],"accessors":[{accessor}]}}"#
    )
}

#[test]
fn terrains_of_a_few_kilobytes_are_small() {
    let folder = directory("hostile_glb");
    let node = r#"{"mesh":0}"#;
    let twice = |k: usize| format!(r#"{{"children":[{},{}]}},"#, k + 1, k + 1);
    let tree = format!("{}{node}", (0..40).map(twice).collect::<String>());
    let good = r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}"#;
    let cases = [
        ("tree.glb", document(&tree, good)),
        ("long.glb", document(node, &good.replace(":3,", ":4000000000,"))),
        ("bytes.glb", document(node, &good.replace("5126", "5120"))),
        ("bare.glb", document(node, r#"{"componentType":5126,"count":3,"type":"VEC3"}"#)),
        ("none.glb", document(node, good).replace("accessors", "others")),
    ];
    for (name, text) in cases {
        let path = folder.join(name);
        fs::write(&path, glb(&text)).unwrap();
        let (code, _, err) = bounded(&["params", "go2", "--terrain", path.to_str().unwrap()]);
        assert!(code == 1 && err.contains(name), "{name}: {code} {err}");
    }
}

#[test]
fn triangles_above_each_other_are_no_work() {
    let folder = directory("hostile_triangles");
    // 20 000 times the same triangle; and as many that lie across each other.
    let corner = |k: usize| {
        let angle = k as f64 * 0.7;
        [10.0 * angle.cos(), 10.0 * angle.sin(), 0.01 * (k % 7) as f64]
    };
    let same = |_: usize| [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let across = |k: usize| [corner(k), corner(k + 3), corner(2 * k + 1)];
    for (name, code, triangles) in [
        ("same.glb", 1, (0..20_000).map(same).collect::<Vec<_>>()),
        ("across.glb", 0, (0..20_000).map(across).collect::<Vec<_>>()),
    ] {
        let mut mesh = qv_core::TriangleMesh::default();
        for (k, corners) in triangles.iter().enumerate() {
            mesh.vertices.extend(corners.map(glam::DVec3::from_array));
            mesh.triangles.push([0, 1, 2].map(|c| 3 * k as u32 + c));
        }
        let path = folder.join(name);
        fs::write(&path, qv_mesh::files::glb::write(&mesh)).unwrap();
        let (found, _, err) = bounded(&["params", "go2", "--terrain", path.to_str().unwrap()]);
        assert_eq!(found, code, "{name}: {err}");
    }
}

#[test]
fn models_name_materials_and_attributes_in_vain() {
    let folder = directory("hostile_urdf");
    let path = folder.join("robot.urdf");
    let file = path.to_str().unwrap();
    let obj = "mtllib /dev/zero\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl x\nf 1 2 3\nf 1 2 4\nf 1 3 4\n";
    fs::write(folder.join("m.obj"), obj).unwrap();
    let link = |name: &str, inside: &str| {
        format!(
            "<link name='{name}'><inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>{inside}</link>"
        )
    };
    let joint = "<joint name='hip.L' type='revolute'><parent link='a'/><child link='b'/><axis xyz='0 1 0'/><limit effort='9' velocity='9' lower='-1' upper='1'/></joint>";
    let mesh = "<collision><geometry><mesh filename='m.obj'/></geometry></collision>";
    fs::write(&path, format!("<robot name='r'>{}{}{joint}</robot>", link("a", ""), link("b", mesh))).unwrap();
    let (code, out, err) = bounded(&["params", file]);
    assert!(code == 0 && out.contains("joint.hip.L.armature"), "{err}");
    let many: String = (0..60_000).map(|k| format!(" a{k}=''")).collect();
    fs::write(&path, format!("<robot name='r'><link name='a'{many}/></robot>")).unwrap();
    let (code, _, err) = bounded(&["params", file]);
    assert!(code == 1 && err.contains("attributes"), "{err}");
}
