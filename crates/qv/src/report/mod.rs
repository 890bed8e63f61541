//! `qv report`: what reconstruction, mesh, contact, replay and diagnosis left, on one page.

mod ground;
mod json_file;
mod page;
mod parts;
mod reproduce;

use crate::ground::mesh_at;
use crate::outcome::about;
use crate::output::put;
use crate::{Failure, Outcome, say};
use json_file::read_json;
use parts::Parts;
use qv_camera::html::section;
use qv_core::TriangleMesh;
use qv_gap::decision::Policy;
use qv_gap::decision::evidence::Evidence;
use qv_gap::export;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv report --reconstruction out/splats --terrain out/contact/terrain.glb --contact out/contact \\\n\
     \x20   --replay out/replay --diagnosis out/why --out out/report.html\n\
     \x20 qv report --evidence out/why/evidence.json --out again/report.html\n\
     \x20 qv report --reproduce out/why\n\
     \n\
     The result is one HTML file that needs no network. A section is omitted if its results are not given.\n\
     --evidence also writes report.json beside the page. --reproduce writes nothing.",
    "3 --reproduce: an input is missing or has changed\n  4 --reproduce: the report differs"
);

/// Most photographs on the page.
const PICTURES: usize = 6;

#[derive(clap::Args)]
#[command(arg_required_else_help = true)]
pub struct Report {
    /// Read the results of `qv reconstruct`
    #[arg(long, value_name = "DIR", help_heading = "Input")]
    reconstruction: Option<PathBuf>,
    /// Read the terrain mesh of `qv mesh` or `qv contact`
    #[arg(long = "terrain", value_name = "FILE.glb", alias = "mesh", help_heading = "Input")]
    mesh: Option<PathBuf>,
    /// Read the results of `qv contact`
    #[arg(long, value_name = "DIR", help_heading = "Input")]
    contact: Option<PathBuf>,
    /// Read the results of `qv replay`
    #[arg(long, value_name = "DIR", help_heading = "Input")]
    replay: Option<PathBuf>,
    /// Read the results of `qv diagnose`
    #[arg(long, value_name = "DIR", help_heading = "Input")]
    diagnosis: Option<PathBuf>,
    /// Read the results of `qv tune`
    #[arg(long, value_name = "DIR", help_heading = "Input")]
    tuning: Option<PathBuf>,
    /// Read path-tracking errors before and after (`qv walk paths`)
    #[arg(long, value_name = "FILE.json", help_heading = "Input")]
    paths: Option<PathBuf>,
    /// Read results.json and link to index.html of `qv navigate`
    #[arg(long, value_name = "DIR", help_heading = "Input")]
    navigation: Option<PathBuf>,
    /// Link to the page of `qv view`
    #[arg(long, value_name = "FILE.html", help_heading = "Input")]
    view: Option<PathBuf>,
    /// Rebuild a diagnosis report from evidence.json without simulation
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["reconstruction", "mesh", "contact", "replay", "diagnosis",
        "tuning", "paths", "navigation", "view"], help_heading = "Advanced")]
    evidence: Option<PathBuf>,
    /// Run a diagnosis again and compare the bits of report.json
    ///
    /// The command line and the hashes of the inputs are those that DIR/report.json states.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["reconstruction", "mesh", "contact", "replay", "diagnosis",
        "tuning", "paths", "navigation", "view", "evidence", "out"], help_heading = "Advanced")]
    reproduce: Option<PathBuf>,
    /// Write the page to this file
    #[arg(long, value_name = "FILE.html", required_unless_present = "reproduce", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Report {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        if let Some(folder) = &self.reproduce {
            return reproduce::reproduce(folder, self.json);
        }
        let out = self.out.as_deref().ok_or("expected --out FILE.html, found none")?;
        if let Some(file) = &self.evidence {
            return self.render(file, out);
        }
        let all = [
            &self.reconstruction,
            &self.mesh,
            &self.contact,
            &self.replay,
            &self.diagnosis,
            &self.tuning,
            &self.paths,
            &self.navigation,
        ];
        if all.iter().all(|part| part.is_none()) {
            let expected = "expected at least one of --reconstruction, --mesh, --contact, --replay, --diagnosis, --tuning, --paths, \
                 --navigation, or --evidence";
            return Err(expected.into());
        }
        let part = |folder: &Option<PathBuf>, name: &str, key: &str| {
            folder.as_ref().map(|dir| read_json(&dir.join(name), key)).transpose()
        };
        let parts = Parts {
            scores: part(&self.reconstruction, "metrics.json", "held_out")?,
            pictures: self.reconstruction.as_ref().map_or(Ok(vec![]), |dir| pictures(&dir.join("held_out")))?,
            mesh: self.mesh.as_ref().map(|path| read_mesh(path)).transpose()?,
            contact: part(&self.contact, "contact.json", "regions")?,
            replay: part(&self.replay, "replay.json", "windows")?,
            diagnosis: part(&self.diagnosis, "report.json", "sentence")?,
            tuning: part(&self.tuning, "tune.json", "candidates")?,
            paths: self.paths.as_ref().map(|file| read_json(file, "policies")).transpose()?,
            navigation: self.navigation.as_ref().map(|dir| navigation(dir, out)).transpose()?,
            view: self.view.as_ref().map(|file| way_to(file, out, "qv view")).transpose()?,
        };
        if let (Some(paths), Some(file)) = (&parts.paths, &self.paths) {
            let two = paths["policies"].as_array().filter(|list| list.len() == 2);
            let has_all = |list: &Vec<Value>| list.iter().all(|p| p["paths"]["position"].is_number());
            if !two.is_some_and(has_all) {
                let expected = "two policies with `paths`, as `qv walk paths BEFORE AFTER` writes them";
                return Err(about(file, format!("expected {expected}, found others")));
            }
        }
        if let (Some(tuning), Some(folder)) = (&parts.tuning, &self.tuning)
            && !tuning["candidates"].is_array()
        {
            return Err(about(&folder.join("tune.json"), "expected a list of candidates, found none"));
        }
        self.write(out, page::to_html(&parts)?)?;
        self.finish(out)
    }

    /// The report of a diagnosis from its evidence.
    fn render(&self, file: &Path, out: &Path) -> Result<Outcome, Failure> {
        let text = fs::read_to_string(file).map_err(|e| about(file, format!("expected evidence, found {e}")))?;
        let beside = out.with_extension("json");
        if beside == out {
            return Err(about(out, "expected a page such as report.html, found a name that report.json takes"));
        }
        if fs::canonicalize(&beside).is_ok_and(|path| fs::canonicalize(file).is_ok_and(|input| input == path)) {
            return Err(about(
                &beside,
                "expected another name for --out, found the evidence, which would be written over",
            ));
        }
        let evidence = Evidence::read(&text, &file.display().to_string())?;
        let report = qv_gap::report::report(&evidence, &Policy::default()).map_err(|e| about(file, e))?;
        let said = evidence.report.as_ref().map(|data| (data.title.as_str(), &data.notes[..]));
        let (title, notes) = said.unwrap_or_default();
        let sections: Vec<String> = report.visual.iter().map(|sight| section(sight, &[])).collect();
        self.write(out, export::to_html(&report, None, title, notes, &sections))?;
        self.write(&beside, export::to_json(&report))?;
        self.finish(out)
    }

    fn write(&self, path: &Path, text: String) -> Result<(), Failure> {
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            fs::create_dir_all(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
        }
        put(path, text).map_err(|e| about(path, format!("expected to write it, found {e}")))
    }

    fn finish(&self, out: &Path) -> Result<Outcome, Failure> {
        match self.json {
            true => say(&format!("{}\n", json!({"format": "qv-report/1", "out": out})))?,
            false => say(&format!("written to {}\n", out.display()))?,
        }
        Ok(Outcome::Done)
    }
}

/// The results of `qv navigate test` in a folder, and the way to the page of them.
fn navigation(folder: &Path, from: &Path) -> Result<(Value, String), Failure> {
    let file = folder.join("results.json");
    let results = read_json(&file, "rows")?;
    let is_row = |tested: &Value| tested["name"].is_string() && tested["row"]["success"].is_number();
    if !results["rows"].as_array().is_some_and(|rows| !rows.is_empty() && rows.iter().all(is_row)) {
        return Err(about(&file, "expected rows with a name and a share of success, found others"));
    }
    Ok((results, way_to(&folder.join("index.html"), from, "qv navigate page")?))
}

/// The relative way from one page to another, as a link has it.
fn way_to(file: &Path, from: &Path, maker: &str) -> Result<String, Failure> {
    if !file.is_file() {
        return Err(about(file, format!("expected a page of `{maker}`, found none")));
    }
    let whole = |path: &Path| std::path::absolute(path).map_err(|e| about(path, e));
    let (file, from) = (whole(file)?, whole(from)?);
    let folder = from.parent().unwrap_or(&from);
    let shared = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(shared).map(|_| "..".to_owned());
    let down = file.components().skip(shared).map(|part| part.as_os_str().to_string_lossy().into_owned());
    Ok(up.chain(down).collect::<Vec<_>>().join("/"))
}

fn read_mesh(path: &Path) -> Result<TriangleMesh, Failure> {
    Ok(mesh_at(path, "a mesh")?)
}

/// Some of the PNG files of a folder, spread evenly over their names; none where there is no folder.
fn pictures(folder: &Path) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let Ok(entries) = fs::read_dir(folder) else { return Ok(vec![]) };
    let mut files: Vec<PathBuf> = entries.filter_map(|entry| entry.ok().map(|e| e.path())).collect();
    files.retain(|path| path.extension().is_some_and(|end| end == "png"));
    files.sort();
    let stride = files.len().div_ceil(PICTURES).max(1);
    let read = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok((name, fs::read(path).map_err(|e| about(path, format!("expected a picture, found {e}")))?))
    };
    files.iter().step_by(stride).map(read).collect()
}
