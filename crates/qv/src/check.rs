//! `qv check`: what any file is, what of it is used, and what is missing for which command.

use crate::capture::open_capture;
use crate::mesh_file::read_mesh;
use crate::open::{model_of, open_run, read_model, read_urdf};
use crate::outcome::about;
#[cfg(feature = "learn")]
use crate::policy_child;
use crate::scene::{is_plain_ply, open_scene, rgbd_layout};
use crate::terminal::print_message;
use crate::{Failure, Outcome, Reading, RunArguments, foreign, say};
use qv_mesh::files::{glb, ply};
#[cfg(feature = "learn")]
use qv_policy::onnx::reader::TensorInfo;
use qv_recording::Run;
use qv_recording::run::{Base, Robot};
use qv_sim::mjcf::is_mjcf;
use qv_sim::{BaseKind, ModelOptions};
use qv_splat::files::Format;
use serde_json::json;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv check walk.mcap\n\
     \x20 qv check go2.urdf scene.ply terrain.glb captures/yard policy.onnx",
    "3 done, but part of the input was lost (reported); 1 also: unknown file type"
);

#[derive(clap::Args)]
pub struct Check {
    /// Files or directories to identify
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

/// What is said of a file.
#[derive(Default)]
struct FileReport {
    kind: &'static str,
    /// What of it is used, in a few words.
    used: String,
    /// How it was read where that is not as a matter of course.
    remarks: Vec<String>,
    /// What of it cannot be used.
    lost: Vec<String>,
    /// What a command needs that is not in it.
    missing: Vec<String>,
}

impl Check {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let (mut failed, mut partial) = (0, false);
        for path in &self.files {
            match look_at(path) {
                Ok(found) => {
                    partial |= !found.lost.is_empty();
                    say(&if self.json { found.to_json(path) } else { found.screen(path) })?;
                }
                Err(error) => {
                    failed += 1;
                    print_message!("{}", crate::failure::message(&error.to_string(), "check"));
                }
            }
        }
        match failed {
            0 if partial => Ok(Outcome::Partial),
            0 => Ok(Outcome::Done),
            _ => Err(format!(
                "files: expected {} that qv reads, found {failed} that it does not (above)",
                self.files.len()
            )
            .into()),
        }
    }
}

impl FileReport {
    fn to_json(&self, path: &Path) -> String {
        let line = json!({"format": "qv-check/1", "file": path.display().to_string(), "kind": self.kind, "used": self.used,
            "remarks": self.remarks, "lost": self.lost, "missing": self.missing});
        format!("{line}\n")
    }

    fn screen(&self, path: &Path) -> String {
        let mut text = format!("{}: {}\n  used     {}\n", path.display(), self.kind, self.used);
        for (word, lines) in [("remarks", &self.remarks), ("lost", &self.lost), ("missing", &self.missing)] {
            lines.iter().take(LINES).for_each(|line| text += &format!("  {word:<8} {line}\n"));
            if lines.len() > LINES {
                text += &format!("  {word:<8} and {} more\n", lines.len() - LINES);
            }
        }
        text
    }
}

/// Lines of each sort on the screen.
const LINES: usize = 6;
/// Bytes by which a file is known.
const HEAD: u64 = 1 << 20;

fn look_at(path: &Path) -> Result<FileReport, Failure> {
    if path.is_dir() {
        return folder(path);
    }
    let mut head = Vec::new();
    let file = fs::File::open(path).map_err(|e| about(path, format!("expected a file or a folder, found {e}")))?;
    file.take(HEAD).read_to_end(&mut head).map_err(|e| about(path, format!("expected a readable file, found {e}")))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let ends = |endings: &[&str]| endings.iter().any(|ending| name.ends_with(ending));
    if ends(&[".mcap", ".db3", ".zstd", ".csv", ".parquet", ".bag"]) {
        return recording(path);
    }
    if ends(&[".onnx"]) {
        return policy(path);
    }
    if ends(&[".urdf", ".xml", ".xacro", ".sdf", ".mjcf"]) || is_markup(&head) {
        return robot(path);
    }
    if ends(&[".splat", ".ksplat", ".sog"]) || Format::of_content(&head).is_ok() || is_plain_ply(&head) {
        return scene(path).or_else(|no_scene| terrain(path).map_err(|_| no_scene));
    }
    if ends(&[".json"]) {
        return capture(path);
    }
    if let Some(what) = qv_open::unread::named(&head) {
        return Err(about(path, format!("expected a file that qv reads, found {what}")));
    }
    let expected = "expected a recording (.mcap, .db3, .csv, .parquet), a robot (URDF), a capture (transforms.json), a scene (.ply, .spz, .glb, \
        .gltf, .splat), a terrain (.glb, .ply) or a policy (.onnx)";
    Err(about(path, format!("{expected}, found none of them")))
}

fn is_markup(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(&head[..head.len().min(4096)]);
    text.trim_start_matches('\u{feff}').trim_start().starts_with('<')
}

fn folder(path: &Path) -> Result<FileReport, Failure> {
    let has = |name: &str| path.join(name).exists();
    if has("run.csv") || has("run.toml") || has("metadata.yaml") || foreign::root(path).is_some() {
        return recording(path);
    }
    if has("meta.json") {
        return scene(path);
    }
    if has("transforms.json") || has("sparse") || has("images.bin") || has("images.txt") || rgbd_layout(path).is_some()
    {
        return capture(path);
    }
    // Frames of 7-Scenes, COLMAP's other places, files of a bag without metadata.
    capture(path).or_else(|no_capture| {
        recording(path).map_err(|no_recording| format!("{no_recording}; and as a capture {no_capture}").into())
    })
}

fn recording(path: &Path) -> Result<FileReport, Failure> {
    let run = open_run(&RunArguments { run: path.to_path_buf(), reading: Reading::default() })?;
    let name = match &run.robot {
        Robot::Named(name) => name.as_str(),
        Robot::Urdf(_) => "a URDF",
    };
    let base = if run.base == Base::Free { "free" } else { "fixed" };
    let [start, end] = run.span();
    let used =
        format!("{name}, base {base}, {} joints, {:.3} s; {}", run.joints(), end - start, channels(&run).join(", "));
    let mut lost: Vec<String> = run.lost.iter().map(|loss| format!("{}: {}", loss.file, loss.what)).collect();
    let partial = run.faults.iter().filter(|fault| fault.kind.is_partial());
    lost.extend(partial.map(|fault| format!("{}: {}, {}", fault.channel, fault.kind, fault.detail)));
    let mut missing = missing_of(&run);
    match (model_of(&run, path, None), &run.robot) {
        (Ok(_), _) => {}
        // Of a robot that is known by name alone the model comes with --robot.
        (Err(_), Robot::Named(name)) => {
            missing.push(format!("the model of {name}, for qv replay and qv diagnose (--robot)"))
        }
        (Err(error), Robot::Urdf(_)) => lost.push(format!("its robot: {error}")),
    }
    Ok(FileReport { kind: "recording", used, missing, remarks: run.remarks, lost })
}

fn channels(run: &Run) -> Vec<&'static str> {
    let (c, m) = (&run.commands, &run.measured);
    let all = [
        ("positions", &m.position),
        ("velocities", &m.velocity),
        ("torques", &m.torque),
        ("commands", if c.position.is_some() { &c.position } else { &c.torque }),
        ("gyroscope", &m.gyro),
        ("acceleration", &m.acceleration),
        ("attitude", &m.orientation),
        ("foot forces", &m.foot_force),
        ("poses", &m.base_pose),
    ];
    all.into_iter().filter(|(_, series)| series.is_some()).map(|(name, _)| name).collect()
}

fn missing_of(run: &Run) -> Vec<String> {
    let (c, m) = (&run.commands, &run.measured);
    let mut missing = vec![];
    if c.position.is_none() && c.torque.is_none() {
        missing.push("commands, for qv replay and qv diagnose");
    }
    if run.base == Base::Free && m.base_pose.is_none() {
        missing.push("poses of the base, for qv contact; qv replay and qv diagnose go by the legs then");
        if m.orientation.is_none() {
            missing.push("attitude of the base, for qv replay and qv diagnose without poses");
        }
    }
    missing.into_iter().map(String::from).collect()
}

fn robot(path: &Path) -> Result<FileReport, Failure> {
    let (text, note) = read_urdf(path, "a URDF or MJCF file")?;
    let beside = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let beside = beside.canonicalize().unwrap_or_else(|_| beside.to_path_buf());
    let meshes = |mesh: &str| read_mesh(&beside, mesh);
    let of =
        |base| read_model(&text, &beside, &ModelOptions { base, mesh_reader: Some(&meshes), ..Default::default() });
    let held = of(BaseKind::Fixed).map_err(|e| about(path, e))?;
    let free = of(BaseKind::Floating).ok();
    let mut missing = Vec::new();
    if !is_mjcf(&text) {
        missing.push("rotor inertia, which no URDF has: [joint.NAME] armature in run.toml".to_string());
    }
    if free.is_none() {
        missing.push("mass and inertia of the root link, for a robot that is not held".into());
    }
    let model = free.unwrap_or(held);
    let mass: f64 = model.links.iter().map(|link| link.mass).sum();
    let used = format!(
        "{}: {} joints, {} moving links of {mass:.2} kg, {} collision shapes",
        model.name,
        model.joints.len(),
        model.links.len(),
        model.geoms.len()
    );
    if model.geoms.is_empty() {
        missing.push("collision shapes, for a robot that touches ground".into());
    }
    let remarks = note.into_iter().chain(model.remarks).collect();
    Ok(FileReport { kind: "robot", used, remarks, lost: model.left_out, missing })
}

fn scene(path: &Path) -> Result<FileReport, Failure> {
    let file = open_scene(path)?;
    let (cloud, mut lost) = (&file.cloud, file.lost);
    if file.left_out > 0 {
        lost.push(format!("{} Gaussians whose numbers are not finite", file.left_out));
    }
    let used = format!("{} Gaussians ({}), harmonics of degree {}", cloud.len(), file.format.name(), cloud.sh_degree);
    let mut missing = vec!["cameras, for qv render and qv mesh (--cameras)".to_string()];
    if cloud.feature_count == 0 {
        missing.push("features, for labels (qv render --semantics, qv mesh --labels)".into());
    }
    Ok(FileReport { kind: "scene", used, remarks: vec![], lost, missing })
}

fn terrain(path: &Path) -> Result<FileReport, Failure> {
    let bytes = fs::read(path).map_err(|e| about(path, format!("expected a mesh, found {e}")))?;
    let is_ply = bytes.starts_with(b"ply");
    let mesh = if is_ply { ply::read(&bytes) } else { glb::read(&bytes) }.map_err(|e| about(path, e))?;
    let mut missing = vec![];
    if is_ply {
        missing.push("the form of --terrain, which is GLB: qv mesh writes it".to_string());
    }
    if mesh.materials.len() < 2 {
        missing.push("labels of several materials, for qv contact".into());
    }
    let used = format!("{} triangles, {} materials", mesh.triangles.len(), mesh.materials.len());
    let turned = mesh.clone().turn_outward();
    let remark = format!("{turned} triangles look down or into their body: commands that simulate turn them round");
    let remarks = if turned > 0 { vec![remark] } else { vec![] };
    Ok(FileReport { kind: "terrain", used, missing, remarks, ..Default::default() })
}

fn capture(path: &Path) -> Result<FileReport, Failure> {
    let opened = open_capture(path)?;
    let cameras = &opened.capture.cameras;
    let there =
        cameras.iter().filter(|one| one.image.as_deref().is_some_and(|image| opened.read(image).is_ok())).count();
    let named: Vec<&str> =
        cameras.iter().filter_map(|one| Some(one.attachments.depth.as_ref()?.path.as_str())).collect();
    let depths = named.iter().filter(|depth| opened.read(depth).is_ok()).count();
    let points = opened.points.as_ref().map_or(0, |points| points.places.len());
    let used = format!("{} cameras, {there} images, {depths} depth images, {points} points", cameras.len());
    let mut missing = vec![];
    if cameras.is_empty() {
        missing.push("cameras, for qv reconstruct and qv mesh".into());
    }
    if depths < named.len() {
        missing.push(format!("{} depth images that are named, for qv mesh", named.len() - depths));
    }
    if there < cameras.len() {
        missing.push(format!("{} images, for qv reconstruct", cameras.len() - there));
    }
    if depths == 0 {
        missing.push("depth images, for qv mesh without a scene and --depth-prior".into());
    }
    if points == 0 {
        missing.push("points, where qv reconstruct begins; it begins at random ones".into());
    }
    Ok(FileReport { kind: "capture", used, remarks: opened.capture.remarks, lost: opened.capture.lost, missing })
}

#[cfg(not(feature = "learn"))]
fn policy(path: &Path) -> Result<FileReport, Failure> {
    Err(about(
        path,
        "expected a file that this qv reads, found a policy, for which it must be built with the feature learn",
    ))
}

#[cfg(feature = "learn")]
fn policy(path: &Path) -> Result<FileReport, Failure> {
    let policy = policy_child::policy_at(path)?;
    let size = |size: &Option<usize>| size.map_or("?".to_string(), |size| size.to_string());
    let list = |all: &[TensorInfo]| {
        let one = |info: &TensorInfo| {
            format!("{} [{}]", info.name, info.shape.iter().map(size).collect::<Vec<_>>().join(", "))
        };
        all.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    let used = format!("in {}; out {}", list(policy.inputs()), list(policy.outputs()));
    let missing = vec![
        "what its observation is made of, unless qv walk trained it (qv walk score and qv walk roll take a description)".to_string(),
    ];
    Ok(FileReport { kind: "policy", used, missing, ..Default::default() })
}
