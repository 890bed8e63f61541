//! `qv view`: one HTML file in which one looks around: the place, the ground, the robot as it was recorded and simulated, slips, causes.

mod causes;
mod motion;
mod page;
mod parts;
mod place;

use crate::open::lost_from;
use crate::outcome::about;
use crate::output::write_whole;
use crate::progress::remark;
use crate::terminal::print_message;
use crate::{Failure, Outcome, Reading, say};
use parts::Parts;
use serde_json::json;
use std::fs;
use std::path::PathBuf;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv view out/why out/contact out/splats --out out/view.html\n\
     \x20 qv view out/why --run walk.mcap --out out/view.html\n\
     \n\
     Used from each directory, if present: scene.ply (qv reconstruct), terrain.glb (qv mesh, qv contact), contact.json, report.json\n\
     and calibrated.toml (qv diagnose), replay.json. The page needs no network. It needs a browser with WebGL 2.",
    "3 done, but part of the input was lost (reported)"
);

#[derive(clap::Args)]
pub struct View {
    /// Directories written by other commands; the first of a kind is used
    #[arg(required = true, value_name = "OUT")]
    folders: Vec<PathBuf>,
    /// Show this recording [default: the one named by the results]
    #[arg(long, value_name = "RUN", help_heading = "Input")]
    run: Option<PathBuf>,
    #[command(flatten)]
    reading: Reading,
    /// Keep the N Gaussians that cover most
    #[arg(long, default_value_t = 150_000, value_name = "N", help_heading = "Output")]
    gaussians: usize,
    /// Write the page to this file
    #[arg(long, value_name = "FILE.html", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl View {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let parts = Parts::find(&self.folders, self.run.as_deref())?;
        let (mut lost, mut remarks) = (Vec::new(), parts.remarks.clone());
        let mesh = parts.mesh.as_deref().map(place::open_mesh).transpose()?;
        let splat = match &parts.scene {
            None => None,
            Some(path) => Some(place::splat(path, self.gaussians, &mut remarks)?),
        };
        let motion = match &parts.run {
            None => None,
            Some(path) => {
                let (motion, run) = motion::of(path, &self.reading, mesh.as_ref(), &parts, &mut remarks)?;
                lost.extend(lost_from(&run));
                Some(motion)
            }
        };
        if mesh.is_none() && splat.is_none() && motion.is_none() {
            let expected = "expected scene.ply, terrain.glb, or a report that names a recording, found none of them";
            return Err(about(&self.folders[0], expected));
        }
        let causes = parts.diagnosis.as_ref().map(|report| causes::of(report, motion.as_ref())).unwrap_or_default();
        let mut slips = parts.contact.as_ref().map(|c| place::slips(c, mesh.as_ref())).unwrap_or_default();
        if !slips.is_empty() && place::are_of_two(parts.contact.as_ref(), parts.diagnosis.as_ref()) {
            lost.push(format!("{} slips: of another recording than the diagnosis, left out", slips.len()));
            slips.clear();
        }
        let data = page::Data {
            parts: &parts,
            mesh: mesh.as_ref(),
            splat: splat.as_ref(),
            motion: motion.as_ref(),
            causes: &causes,
            slips: &slips,
        };
        let html = data.to_html();
        if let Some(folder) = self.out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            fs::create_dir_all(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
        }
        write_whole(&self.out, html.as_bytes())?;
        remarks.iter().for_each(|what| remark(what));
        lost.iter().for_each(|what| print_message!("{what}"));
        let outcome = if lost.is_empty() { Outcome::Done } else { Outcome::Partial };
        if self.json {
            let line = json!({
                "format": "qv-view/1", "gaussians": splat.as_ref().map(|s| s.count), "triangles": mesh.as_ref().map(|m| m.triangles.len()),
                "seconds": motion.as_ref().map(|m| m.seconds()), "slips": slips.len(), "causes": causes.len(),
                "bytes": html.len(), "out": self.out, "lost": lost,
            });
            say(&format!("{line}\n"))?;
            return Ok(outcome);
        }
        let has = [
            splat.as_ref().map(|s| format!("{} Gaussians", s.count)),
            mesh.as_ref().map(|m| format!("{} triangles", m.triangles.len())),
            motion.as_ref().map(|m| format!("{:.1} s of motion", m.seconds())),
            (!slips.is_empty()).then(|| format!("{} slip{}", slips.len(), if slips.len() == 1 { "" } else { "s" })),
            (!causes.is_empty()).then(|| format!("{} cause{}", causes.len(), if causes.len() == 1 { "" } else { "s" })),
        ];
        let has: Vec<String> = has.into_iter().flatten().collect();
        say(&format!("{}; {:.1} MB written to {}\n", has.join(", "), html.len() as f64 / 1e6, self.out.display()))?;
        Ok(outcome)
    }
}
