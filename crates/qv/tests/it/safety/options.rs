//! What a qv.toml may say.

use super::{directory, qv, recording};
use crate::facts::States;
use std::fs;
use std::net::TcpListener;

#[test]
fn a_file_sends_nothing_and_says_not_where_to_write() {
    let root = directory("ask");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let address = listener.local_addr().unwrap();
    let file = format!("[contact]\nask = \"http://{address}/v1\"\nmodel = \"x\"\nout = \"stolen\"\n");
    fs::write(root.join("qv.toml"), file).unwrap();
    let inside = root.join("inside");
    recording(&inside.join("run"));
    let ground = qv_core::TriangleMesh {
        vertices: [[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]].map(glam::DVec3::from_array).to_vec(),
        triangles: vec![[0, 1, 2]],
        ..Default::default()
    };
    fs::write(inside.join("ground.glb"), qv_mesh::files::glb::write(&ground)).unwrap();
    let contact = |words: &str| {
        let mut command = super::command(&inside, &format!("contact run --terrain ground.glb{words}"));
        super::remarks(&command.env("QV_API_KEY", "secret").output().unwrap())
    };
    let (code, _, err) = contact("");
    assert!(code == 2 && err.contains("--out"), "{err}");
    let (_, _, err) = contact(" --out own");
    assert!(err.states("--ask"), "{err}");
    assert!(listener.accept().is_err(), "somebody asked");
    assert!(!root.join("stolen").exists() && !inside.join("stolen").exists());
}

#[cfg(unix)]
#[test]
fn a_file_of_another_user_is_ignored() {
    let root = directory("owner");
    fs::write(root.join("qv.toml"), "[effects]\njson = true\n").unwrap();
    assert!(qv(&root, "effects").1.starts_with('{'));
    // Only root may give a file away.
    if std::os::unix::fs::chown(root.join("qv.toml"), Some(65_534), None).is_ok() {
        let (code, out, err) = qv(&root, "effects");
        assert!(code == 0 && !out.starts_with('{') && err.states("another"), "{err}");
    }
}
