//! `qv view`: what is in the page, and what happens in a browser when one moves, clicks and plays.

use crate::bags::{directory, qv};
use crate::facts::States;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use qv_core::GaussianCloud;
use qv_splat::files::ply;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Names that the browser goes by.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

/// Does what a reader does, and leaves what was seen after each step as text.
const STEPS: &str = "<script>addEventListener('load', async () => {
const seen = {}, canvas = document.getElementById('scene'), wait = (ms) => new Promise((go) => setTimeout(go, ms));
const see = async (name) => { await wait(100); seen[name] = qvView.state(); };
const mouse = (kind, x, y) => canvas.dispatchEvent(new PointerEvent(kind, {pointerId: 1, pointerType: 'mouse', button: 0, buttons: 1, clientX: x, clientY: y, bubbles: true}));
canvas.setPointerCapture = canvas.releasePointerCapture = () => {};
try {
await see('start');
mouse('pointerdown', 800, 300); mouse('pointermove', 900, 330); mouse('pointerup', 900, 330);
await see('turned');
document.querySelector('button.cause').click();
await see('cause');
document.querySelector('button.cause').click();
await see('unchosen');
const time = document.getElementById('time'); time.value = 2; time.dispatchEvent(new Event('input'));
await see('slid');
document.querySelector('input[name=place]').click();
await see('without');
document.querySelector('input[name=\"forces simulated\"]').click();
await see('unforced');
document.getElementById('play').click();
for (let k = 0; k < 50 && qvView.state().time <= 2; k++) await wait(50);
await see('playing');
document.getElementById('play').click();
dispatchEvent(new KeyboardEvent('keydown', {key: 'w'})); for (let k = 0; k < 50 && String(qvView.state().target) === String(seen.playing.target); k++) await wait(50); dispatchEvent(new KeyboardEvent('keyup', {key: 'w'}));
await see('flown');
} catch (error) { seen.error = String(error && error.stack || error); }
const out = document.createElement('pre'); out.id = 'seen'; out.textContent = JSON.stringify(seen).replace(/[&<>]/g, ' '); document.body.append(out);
});</script>";

/// A wall of red Gaussians, which are flat, behind where the robot walks.
fn wall() -> GaussianCloud {
    let means: Vec<[f32; 3]> = (0..900).map(|k| [-1.0 + 0.1 * (k % 30) as f32, 1.5, 0.05 * (k / 30) as f32]).collect();
    let n = means.len();
    GaussianCloud {
        means,
        log_scales: vec![[-3.0, -6.0, -3.0]; n],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
        opacity_logits: (0..n).map(|k| if k % 2 == 0 { 4.0 } else { -4.0 }).collect(),
        sh: vec![[0.2, 0.9, 1.2]; n],
        ..GaussianCloud::default()
    }
}

/// A recording of the made-up Go2, its ground, a diagnosis, slips and a wall; the folder of all that.
fn outputs(name: &str) -> PathBuf {
    let root = directory(name);
    let text = root.display().to_string();
    assert_eq!(qv(&["fixture", "--out", &text]).0, 0);
    let map = json!({"joints": ["FL_hip_joint", "FR_hip_joint"], "times": [1.0, 5.0, 9.0],
        "before": [[1.0, 2.0, 1.0], [1.0, 1.0, 9.0]], "after": [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]});
    let cause = json!({"effect": "joint_friction", "scope": ["FL"], "parameters": [{"name": "coulomb", "value": 0.5, "unit": "N m"}]});
    let report = json!({"sentence": "A <b>made-up</b> cause.", "causes": [cause], "heat_map": map, "corrections_apply": true,
        "provenance": {"inputs": [{"path": root.join("run.mcap")}]}});
    fs::write(root.join("report.json"), report.to_string()).unwrap();
    fs::write(root.join("calibrated.toml"), "\"actuator.*.command_latency\" = 0.008\n").unwrap();
    let slips =
        json!({"slips": [{"at": [0.2, 0.1], "time": 3.0, "distance": 0.02, "run": 0}], "sentence": "Slippery."});
    fs::write(root.join("contact.json"), slips.to_string()).unwrap();
    fs::write(root.join("scene.ply"), ply::write(&wall()).unwrap()).unwrap();
    root
}

fn browser() -> Option<PathBuf> {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from);
    let works = |name: &PathBuf| {
        let mut command = Command::new(name);
        command.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    };
    named.into_iter().chain(BROWSERS.iter().map(PathBuf::from)).find(works)
}

/// What was seen after each step.
fn looked_at(browser: &Path, page: &Path) -> Value {
    let copy = page.with_extension("steps.html");
    // The page's policy lets no script run but its own; the copy's own are those and the steps.
    let steps = STEPS.split_once("<script>").and_then(|(_, rest)| rest.split_once("</script>")).unwrap().0;
    let own = format!("script-src 'sha256-{}' ", STANDARD.encode(Sha256::digest(steps.as_bytes())));
    let html = fs::read_to_string(page).unwrap().replacen("script-src ", &own, 1);
    fs::write(&copy, html + STEPS).unwrap();
    let mut command = Command::new(browser);
    // No sandbox: continuous integration runs as root. WebGL is drawn by software.
    command.args([
        "--headless",
        "--no-sandbox",
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
    ]);
    command.args(["--ignore-gpu-blocklist", "--window-size=1280,800", "--virtual-time-budget=20000", "--dump-dom"]);
    let output = command.arg(format!("file://{}", copy.display())).stderr(Stdio::null()).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let found = text.rsplit_once("<pre id=\"seen\">").and_then(|(_, rest)| rest.split_once("</pre>"));
    let (found, _) =
        found.unwrap_or_else(|| panic!("the page said nothing: {}", &text[text.len().saturating_sub(2000)..]));
    serde_json::from_str(found).unwrap()
}

#[test]
fn one_looks_around_in_the_page() {
    let root = outputs("view_page");
    let page = root.join("view.html");
    let (code, out, err) = qv(&["view", root.to_str().unwrap(), "--gaussians", "400", "--out", page.to_str().unwrap()]);
    assert_eq!(code, 0, "{err}");
    assert!(out.states("400 Gaussians 8") && out.states("1 slip, 1 cause"), "{out}");
    assert!(err.states("400 900 Gaussians"), "{err}");
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.states("default-src") && html.states("The MIT License"), "no network; three.js with its licence");
    assert!(html.contains("&lt;b&gt;made-up") && !html.contains("<b>made-up"));
    for never in ["<link", "<img", "src=", "@import", "fetch(", "XMLHttpRequest"] {
        assert!(!html.contains(never), "{never}");
    }
    crate::browser::check("view", &html);
    let Some(browser) = browser() else { return crate::skipped::skipped("no Chromium") };
    let seen = looked_at(&browser, &page);
    assert!(seen["error"].is_null(), "{}", seen["error"]);
    let start = &seen["start"];
    let layers: Vec<&String> = start["layers"].as_object().unwrap().keys().collect();
    for name in [
        "place",
        "ground",
        "recorded",
        "simulated",
        "corrected",
        "path recorded",
        "slips",
        "forces recorded",
        "forces simulated",
    ] {
        assert!(layers.iter().any(|layer| *layer == name), "{name} {layers:?}");
    }
    assert_eq!((start["gaussians"].as_u64(), start["error"].as_u64()), (Some(400), Some(0)));
    assert!(start["colours"].as_u64() > Some(30), "the picture is not empty: {start}");
    let differs = |a: &str, b: &str, key: &str| seen[a][key] != seen[b][key];
    assert!(differs("start", "turned", "camera") && differs("start", "turned", "picture"), "a drag turns");
    // The cause is of the front left leg, whose errors shrink most in the window from 5 s.
    let cause = &seen["cause"];
    assert_eq!((cause["chosen"].as_u64(), cause["time"].as_f64()), (Some(0), Some(5.0)));
    assert!(
        cause["red"].as_u64().unwrap() > seen["turned"]["red"].as_u64().unwrap() + 50,
        "{cause} {}",
        seen["turned"]
    );
    assert!(seen["unchosen"]["chosen"].is_null() && seen["unchosen"]["red"].as_u64() < cause["red"].as_u64());
    assert_eq!(seen["slid"]["time"].as_f64(), Some(2.0));
    assert!(differs("cause", "slid", "base"), "the robot is elsewhere then");
    assert_eq!(seen["without"]["layers"]["place"], false);
    assert!(differs("slid", "without", "picture"));
    // Four feet bear 15 kg, and none of them alone.
    let forces = |step: &str, robot: &str| -> Vec<f64> {
        let all = seen[step]["forces"][robot].as_array().unwrap();
        all.iter().map(|force| force.as_f64().unwrap()).collect()
    };
    for robot in ["recorded", "simulated"] {
        let (stand, total) = (forces("slid", robot), forces("slid", robot).iter().sum::<f64>());
        assert!(stand.len() == 4 && total > 75.0 && total < 300.0, "{robot} {stand:?}");
        assert!(stand.iter().all(|force| *force < 0.6 * total), "{robot} {stand:?}");
        assert_ne!(stand, forces("cause", robot), "they change with time");
    }
    assert_eq!(seen["unforced"]["layers"]["forces simulated"], false);
    assert!(differs("without", "unforced", "picture"), "arrows are drawn");
    assert!(seen["playing"]["time"].as_f64() > Some(2.0) && seen["playing"]["playing"] == true, "{}", seen["playing"]);
    assert!(differs("playing", "flown", "target"), "a key flies");
}

#[test]
fn parts_that_are_not_there_are_left_out_or_refused() {
    let root = outputs("view_parts");
    let page = root.join("view.html");
    let view = |folder: &Path, more: &[&str]| {
        qv(&[&["view", folder.to_str().unwrap(), "--out", page.to_str().unwrap()], more].concat())
    };
    let lone = root.join("lone");
    fs::create_dir_all(&lone).unwrap();
    let (code, _, err) = view(&lone, &[]);
    assert!(code == 1 && err.states("scene.ply terrain.glb"), "{err}");
    let (code, _, err) = view(&root.join("none"), &[]);
    assert!(code == 1 && err.states("command"), "{err}");
    fs::copy(root.join("scene.ply"), lone.join("scene.ply")).unwrap();
    let (code, out, err) = view(&lone, &[]);
    assert!(code == 0 && out.starts_with("900 Gaussians; "), "{out}{err}");
    // A report whose recording is gone.
    let moved = json!({"causes": [], "provenance": {"inputs": [{"path": "gone/run.mcap"}]}});
    fs::write(lone.join("report.json"), moved.to_string()).unwrap();
    let (code, out, err) = view(&lone, &[]);
    assert!(code == 0 && !out.contains("motion") && err.states("gone/run.mcap"), "{out}{err}");
    let run = root.join("run.mcap").display().to_string();
    let (code, out, err) = view(&lone, &["--run", &run]);
    assert!(code == 0 && out.states("motion 18.0"), "{out}{err}");
    fs::write(lone.join("report.json"), "{").unwrap();
    let (code, _, err) = view(&lone, &[]);
    assert!(code == 1 && err.states("report.json JSON"), "{err}");
}
