//! The page: data, our script, and three.js within one file.

use super::causes::Cause;
use super::motion::{Forces, Motion, Track};
use super::parts::Parts;
use super::place::{Slip, Splat};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use qv_core::TriangleMesh;
use qv_page::{TOKENS, escape, policy, script_data};
use serde_json::{Value, json};

/// The part of three.js that is used; see asset/README.md.
const THREE: &str = include_str!("asset/three.min.js");
/// Its licence, which goes with it.
const LICENCE: &str = include_str!("asset/LICENSE");
const SCRIPT: &str = include_str!("view.js");
const STYLE: &str = include_str!("view.css");

/// What is shown.
pub struct Data<'a> {
    pub parts: &'a Parts,
    pub mesh: Option<&'a TriangleMesh>,
    pub splat: Option<&'a Splat>,
    pub motion: Option<&'a Motion>,
    pub causes: &'a [Cause],
    pub slips: &'a [Slip],
}

impl Data<'_> {
    /// The whole file.
    pub fn to_html(&self) -> String {
        let sentence = |report: &Option<Value>| report.as_ref().and_then(|r| Some(r["sentence"].as_str()?.to_owned()));
        let sentences: Vec<String> =
            [&self.parts.diagnosis, &self.parts.contact].into_iter().filter_map(sentence).collect();
        let heading = match &self.parts.run {
            Some(path) => path.display().to_string(),
            None => "A place".into(),
        };
        let said: String = sentences.iter().map(|s| format!("<p>{}</p>", escape(s))).collect();
        let data = script_data(&self.to_json().to_string());
        let three = format!("/*! three.js\n{LICENCE}*/{THREE}");
        // Nothing may be fetched: not even by a mistake of ours.
        let policy = policy(&[&three, SCRIPT]);
        format!(
            "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">{policy}\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{0}</title><style>{TOKENS}{STYLE}</style><body>\
             <canvas id=\"scene\" role=\"img\" aria-label=\"3D view of scene, robot and slips: drag to turn, wheel to zoom, W A S D to fly\"></canvas>\
             <main id=\"panel\" tabindex=\"0\"><h1>{0}</h1>{said}<div id=\"controls\"></div></main>\
             <div id=\"clock\"><button id=\"play\">play</button><input id=\"time\" type=\"range\" min=\"0\" max=\"1\" step=\"any\" value=\"0\" \
             aria-label=\"time\"><output id=\"now\"></output></div>\
             <script type=\"application/json\" id=\"data\">{data}</script>\
             <script>{three}</script><script>{SCRIPT}</script></body></html>\n",
            escape(&heading)
        )
    }

    fn to_json(&self) -> Value {
        json!({
            "mesh": self.mesh.map(mesh),
            "splat": self.splat.map(|s| json!({"count": s.count, "file": STANDARD.encode(&s.file), "background": s.background})),
            "motion": self.motion.map(motion),
            "causes": self.causes,
            "slips": self.slips,
        })
    }
}

fn floats(numbers: impl Iterator<Item = f32>) -> String {
    STANDARD.encode(numbers.flat_map(f32::to_le_bytes).collect::<Vec<u8>>())
}

fn mesh(mesh: &TriangleMesh) -> Value {
    let corners = STANDARD.encode(mesh.triangles.iter().flatten().flat_map(|k| k.to_le_bytes()).collect::<Vec<u8>>());
    let labels = STANDARD.encode(mesh.labels.iter().flat_map(|k| k.to_le_bytes()).collect::<Vec<u8>>());
    json!({
        "vertices": floats(mesh.vertices.iter().flat_map(|v| v.to_array()).map(|x| x as f32)),
        "triangles": corners,
        "labels": labels,
        "names": mesh.materials.iter().map(|m| &m.name).collect::<Vec<_>>(),
        "frictions": mesh.materials.iter().map(|m| m.friction).collect::<Vec<_>>(),
    })
}

fn motion(motion: &Motion) -> Value {
    let forces = |f: &Forces| json!({"feet": floats(f.feet.iter().copied()), "usual": f.usual});
    let track = |t: &Track| json!({"name": t.name, "poses": floats(t.poses.iter().copied()), "forces": t.forces.as_ref().map(forces)});
    let tracks: Vec<Value> = motion.tracks.iter().map(track).collect();
    json!({
        "links": motion.model.links.len(),
        "time": floats(motion.time.iter().map(|t| *t as f32)),
        "shapes": motion.shapes(),
        "tracks": tracks,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use sha2::{Digest, Sha256};

    #[test]
    fn three_is_the_one_that_is_described() {
        let readme = include_str!("asset/README.md");
        let hash: String = Sha256::digest(THREE.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
        assert!(readme.contains(&hash), "expected asset/README.md to name {hash}");
        assert!(!THREE.contains("</script") && !SCRIPT.contains("</script") && !STYLE.contains("</style"));
        assert!(THREE.len() < 1_000_000 && LICENCE.states("MIT License") && !LICENCE.contains("*/"));
    }
}
