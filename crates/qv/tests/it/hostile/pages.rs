//! Pages: each says to a browser that it fetches nothing and runs no script but its own.

use super::bounded;
use super::tables::table;
use crate::facts::States;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};
use std::fs;

#[test]
fn pages_run_their_own_scripts_alone() {
    let folder = table("policy_page", "<b>j", 500, 0.002);
    // The name of the joint is one that a page must not take for HTML, nor a URDF for XML.
    let urdf = fs::read_to_string(folder.join("robot.urdf")).unwrap().replace("'<b>j'", "'&lt;b>j'");
    fs::write(folder.join("robot.urdf"), urdf).unwrap();
    let out = folder.join("out");
    let (code, _, err) = bounded(&["replay", folder.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(code == 0 || code == 3, "{err}");
    let page = fs::read_to_string(out.join("replay.html")).unwrap();
    let (head, body) = page.split_once("<title>").unwrap();
    assert!(head.contains("Content-Security-Policy") && head.states("default-src"), "{head}");
    assert!(!head.contains("script-src 'unsafe-inline'"));
    let mut own = 0;
    for script in body.split("<script>").skip(1) {
        let text = script.split_once("</script>").unwrap().0;
        assert!(head.contains(&STANDARD.encode(Sha256::digest(text.as_bytes()))));
        own += 1;
    }
    assert_eq!(own, 1);
}
