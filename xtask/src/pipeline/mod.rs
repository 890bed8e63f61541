//! `cargo xtask pipeline`: the main job on a made-up yard and a made-up robot, stage by stage. A stage runs when its inputs have changed
//! since it last ran, or its outputs have; one that was killed has left no stamp, and runs again.

mod golden;
pub mod look;
mod stages;
mod stamp;
#[cfg(test)]
mod tests;

pub use golden::{Figure, Of, differences, read_file as read_golden};
pub use stamp::hash;

use crate::{process, programs, workspace::Workspace};
use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use golden::read_json;
use serde_json::{Map, Value, json};
pub use stages::Size;
use stages::{PROGRAMS, Program, SEED, Stage};
use stamp::Stamp;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// What to run.
#[derive(Args)]
pub struct Pipeline {
    /// Run this stage alone, on what earlier ones left
    #[arg(long, value_name = "STAGE", conflicts_with = "from")]
    only: Option<Stage>,
    /// Run this stage and all later ones, whether or not something changed
    #[arg(long, value_name = "STAGE")]
    from: Option<Stage>,
    /// Run this stage and those that it needs, where something changed
    #[arg(long, value_name = "STAGE", conflicts_with_all = ["from", "only"])]
    up_to: Option<Stage>,
    /// Also let a network learn to reach cones in the reconstructed place
    #[arg(long)]
    navigate: bool,
    /// Take the size of continuous integration: fewer steps, shorter recordings
    #[arg(long)]
    small: bool,
    /// Write docs/pictures/report.png, a picture of the last page (needs Chromium)
    #[arg(long, conflicts_with = "small")]
    pictures: bool,
    /// Folder for what the stages write; default target/pipeline, or target/pipeline-small
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Pipeline {
    fn size(&self) -> Size {
        if self.small { Size::Small } else { Size::Full }
    }
}

/// Runs the stages that need it; true when all ended well.
///
/// # Errors
/// A program does not build, or a stage fails or lacks what an earlier one writes.
pub fn run(workspace: &Workspace, pipeline: &Pipeline) -> Result<bool> {
    let folder = match &pipeline.out {
        Some(out) => std::path::absolute(out).with_context(|| format!("in {}", out.display()))?,
        None => folder(workspace, pipeline.size()),
    };
    let programs = build_all(workspace)?;
    let clock = Instant::now();
    let navigate = pipeline.navigate || [pipeline.only, pipeline.from, pipeline.up_to].contains(&Some(Stage::Navigate));
    let needed = pipeline.up_to.map(|last| needed(last, navigate));
    for stage in Stage::value_variants().iter().filter(|stage| navigate || !stage.is_optional()) {
        let forced = pipeline.from.is_some_and(|from| *stage >= from) || pipeline.only == Some(*stage);
        let wanted = needed.as_ref().is_none_or(|needed| needed.contains(stage));
        if wanted && pipeline.only.is_none_or(|only| only == *stage) {
            run_stage(*stage, (pipeline.size(), navigate), &programs, &folder, forced)?;
        }
    }
    println!("{:<11} {:.1} s", "all", clock.elapsed().as_secs_f64());
    conclude(&folder)?;
    if pipeline.pictures {
        let browser = look::browser().context("cannot take a picture: no Chromium is there")?;
        let picture = workspace.workspace_root.join("docs/pictures/report.png");
        look::take_picture(&browser, &folder.join("report/report.html"), &picture)?;
        println!("written to {}", picture.display());
    }
    Ok(true)
}

/// A stage and all whose files it needs, directly or not.
fn needed(last: Stage, navigate: bool) -> Vec<Stage> {
    let mut found = vec![last];
    for &stage in Stage::value_variants().iter().rev() {
        let is_read = |file: &&str| found.iter().any(|later| later.inputs(navigate).contains(file));
        if !found.contains(&stage) && stage.outputs().iter().any(is_read) {
            found.push(stage);
        }
    }
    found
}

/// File that says whose folder it is.
const MARK: &str = "pipeline.txt";

fn folder(workspace: &Workspace, size: Size) -> PathBuf {
    let name = match size {
        Size::Full => "pipeline",
        Size::Small => "pipeline-small",
    };
    workspace.target_directory.join(name)
}

/// Builds all programs of the stages.
fn build_all(workspace: &Workspace) -> Result<Vec<(Program, PathBuf)>> {
    let packages = PROGRAMS.map(|(_, package, _)| package);
    let folder = programs::build(workspace, &packages, &[])?;
    Ok(PROGRAMS.iter().map(|(program, _, name)| (*program, folder.join(programs::file(name)))).collect())
}

fn run_stage(
    stage: Stage,
    (size, navigate): (Size, bool),
    programs: &[(Program, PathBuf)],
    folder: &Path,
    forced: bool,
) -> Result<()> {
    let own = folder.join(stage.name());
    let stamp_file = own.join("stamp.json");
    let program = |wanted: Program| {
        let found = programs.iter().find(|(program, _)| *program == wanted).map(|(_, path)| path);
        found.with_context(|| format!("{wanted:?} is not among the programs"))
    };
    let mut read: Vec<PathBuf> = vec![];
    for call in stage.calls(size, navigate) {
        read.push(program(call.program)?.clone());
    }
    read.extend(stage.inputs(navigate).iter().map(|file| folder.join(file)));
    if let Some(missing) = read.iter().find(|path| !path.exists()) {
        bail!("stage {}: expected {}, found nothing; run the stages before it", stage.name(), missing.display());
    }
    let written: Vec<PathBuf> = stage.outputs().iter().map(|file| folder.join(file)).collect();
    let words: Vec<String> = stage.calls(size, navigate).iter().flat_map(stages::Call::arguments).collect();
    let inputs = hash(&words, &read)?;
    let fresh = written.iter().all(|path| path.exists())
        && Stamp::read(&stamp_file) == Some(Stamp { inputs, outputs: hash(&[], &written)? });
    if fresh && !forced {
        println!("{:<11} unchanged", stage.name());
        return Ok(());
    }
    if own.exists() {
        // A folder of somebody else that happens to have the name is not emptied.
        let is_ours = [MARK, "stamp.json"].iter().any(|file| own.join(file).is_file())
            || fs::read_dir(&own).is_ok_and(|mut list| list.next().is_none());
        if !is_ours {
            bail!(
                "{}: expected a folder that the pipeline made, found another; --out names where it works",
                own.display()
            );
        }
    }
    let clock = Instant::now();
    let work = || {
        for call in stage.calls(size, navigate) {
            let mut command = Command::new(program(call.program)?);
            command.current_dir(folder).args(call.arguments());
            if call.program == Program::Qv {
                // Figures are not to depend on a qv.toml above this folder.
                command.arg("--no-config");
            }
            let said = process::output(&mut command)?;
            if let Some(file) = call.said_in(folder) {
                fs::write(&file, said).with_context(|| format!("writing {}", file.display()))?;
            }
        }
        match written.iter().find(|path| !path.exists()) {
            Some(missing) => {
                bail!("stage {}: expected it to write {}, found nothing", stage.name(), missing.display())
            }
            None => Ok(()),
        }
    };
    anew(&own, &work)?;
    Stamp { inputs, outputs: hash(&[], &written)? }.write(&stamp_file)?;
    println!("{:<11} {:.1} s", stage.name(), clock.elapsed().as_secs_f64());
    Ok(())
}

/// Does what fills a folder in an empty one; what was in it before comes back when that fails.
fn anew(own: &Path, work: &dyn Fn() -> Result<()>) -> Result<()> {
    let before = own.with_extension("before");
    if before.exists() && own.exists() {
        // Left by one that was killed: what is in the folder now is half done.
        fs::remove_dir_all(own).with_context(|| format!("removing {}", own.display()))?;
    } else if own.exists() {
        fs::rename(own, &before).with_context(|| format!("moving {}", own.display()))?;
    }
    fs::create_dir_all(own).with_context(|| format!("making {}", own.display()))?;
    fs::write(own.join(MARK), "made by cargo xtask pipeline, which empties it\n")
        .with_context(|| format!("writing into {}", own.display()))?;
    let ended = work();
    if before.exists() {
        let leaves = if ended.is_ok() { &before } else { own };
        fs::remove_dir_all(leaves).with_context(|| format!("removing {}", leaves.display()))?;
    }
    if before.exists() {
        fs::rename(&before, own).with_context(|| format!("moving {} back", before.display()))?;
    }
    ended
}

/// Says what was found and where it is, as far as the stages have come.
fn conclude(folder: &Path) -> Result<()> {
    for (file, key, page) in [
        ("contact/contact.json", "sentence", "contact/contact.html"),
        ("replay/replay.json", "verdict", "replay/replay.html"),
        ("diagnose/report.json", "sentence", "diagnose/report.html"),
        ("again/contact.json", "sentence", "again/contact.html"),
        ("tune/tune.json", "why", "tune/tune.html"),
    ] {
        let path = folder.join(file);
        if path.is_file() {
            let report = read_json(&path)?;
            let said =
                report[key].as_str().with_context(|| format!("{}: expected its {key}, found none", path.display()))?;
            // One sentence a line.
            let with = if file.starts_with("again") { "With that taken into account: " } else { "" };
            println!("{with}{}\n{}", said.replace(". ", ".\n"), folder.join(page).display());
        }
    }
    let paths = folder.join("paths/paths.json");
    if paths.is_file() {
        let report = read_json(&paths)?;
        let strayed = |k: usize| report["policies"][k]["paths"]["position"].as_f64().unwrap_or(f64::NAN);
        println!(
            "Path-tracking error of the simulated robot: {:.3} m before and {:.3} m after fine-tuning.",
            strayed(0),
            strayed(1)
        );
    }
    let said = [
        ("navigate/said.txt", "Cones in the reconstructed place"),
        ("navigate/said_walked.txt", "The same on the tuned robot, which walks in the corrected simulator"),
    ];
    for (file, title) in said.map(|(file, title)| (folder.join(file), title)).iter().filter(|(file, _)| file.is_file())
    {
        let rows = fs::read_to_string(file).with_context(|| format!("reading {}", file.display()))?;
        print!("{title}:\n{rows}");
    }
    let page = folder.join("navigate/index.html");
    if page.is_file() {
        println!("{}", page.display());
    }
    for (file, words) in [("view/view.html", "To look around"), ("report/report.html", "All of it on one page")] {
        let page = folder.join(file);
        if page.is_file() {
            println!("{words}: {}", page.display());
        }
    }
    Ok(())
}

/// The pipeline that a golden is of.
fn whole(of: Of, size: Size) -> Pipeline {
    let up_to = (of == Of::Navigate).then_some(Stage::Navigate);
    Pipeline { only: None, from: None, up_to, navigate: false, small: size == Size::Small, pictures: false, out: None }
}

/// Runs the stages that need it and compares their figures with the golden; true when all agree. Names the first stage that moved.
///
/// # Errors
/// As [`run`], or a figure or the golden is missing.
pub fn check_golden(workspace: &Workspace, of: Of, size: Size) -> Result<bool> {
    run(workspace, &whole(of, size))?;
    let folder = folder(workspace, size);
    let (expected, found) = (golden::read(&workspace.workspace_root, of, size)?, golden::figures(&folder, of)?);
    let differences = differences(&expected, &found);
    match differences.first().and_then(|line| line.split(',').next()) {
        None => println!("{} figures of the pipeline are those of the golden", expected.len()),
        Some(stage) => println!("the first stage that moved is {stage}:\n  {}", differences.join("\n  ")),
    }
    Ok(look_at_pages(&folder, pages(of))? && differences.is_empty())
}

/// Pages that a person reads, of the stages that a golden is of.
fn pages(of: Of) -> &'static [&'static str] {
    match of {
        Of::Stages => &[
            "report/report.html",
            "contact/contact.html",
            "replay/replay.html",
            "diagnose/report.html",
            "tune/tune.html",
        ],
        Of::Navigate => &["navigate/index.html"],
    }
}

/// Whether a browser shows the pages as they should be; true, with a word, where no browser is there.
fn look_at_pages(folder: &Path, pages: &[&str]) -> Result<bool> {
    let Some(browser) = look::browser() else {
        println!("the pages were not looked at: no Chromium is there");
        return Ok(true);
    };
    let mut found = vec![];
    for page in pages {
        found.extend(look::faults(&browser, &folder.join(page))?);
    }
    match found.is_empty() {
        true => println!("{} pages look as they should in a browser", pages.len()),
        false => println!("pages in a browser:\n  {}", found.join("\n  ")),
    }
    Ok(found.is_empty())
}

/// Writes a golden into `out`: `replay`, the figures of all `stages`, or those of the optional stage `navigate`; with `_full` at the size
/// of the guides.
///
/// # Errors
/// A program fails, a report has another shape, or the name is another one.
pub fn write_golden(workspace: &Workspace, name: &str, out: &Path) -> Result<()> {
    fs::create_dir_all(out).with_context(|| format!("making {}", out.display()))?;
    match name {
        "replay" => write_replay(workspace, out),
        other => match Of::named(other) {
            Some((of, size)) => {
                run(workspace, &whole(of, size))?;
                golden::write(&folder(workspace, size), of, size, &out.join(of.file(size)))
            }
            None => {
                bail!("expected the golden replay, stages, navigate, stages_full or navigate_full, found {other:?}")
            }
        },
    }
}

/// The recording that the golden `replay` is of, and its replay.
const REPLAY: [&str; 2] = [
    "fixture --seed 1 --out recording",
    "replay recording/run.mcap --terrain recording/terrain.glb --out replay --json",
];

/// Writes `replay.json`: every number of the report that another machine must find, too.
///
/// Tolerances are wide enough for another processor's rounding, which a trot amplifies once feet land, and narrow beside
/// what any effect does (1.7 mrad with the truth, 11.5 with a latency of 8 ms).
///
/// # Errors
/// The pipeline fails, or its report has another shape.
fn write_replay(workspace: &Workspace, out: &Path) -> Result<()> {
    let folder = workspace.target_directory.join("pipeline-golden");
    fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
    let qv = programs::qv(workspace)?;
    for words in REPLAY {
        process::output(Command::new(&qv).current_dir(&folder).args(words.split(' ')))?;
    }
    let report = read_json(&folder.join("replay/replay.json"))?;
    let figures = |list: &Value, key: &str| -> Result<Map<String, Value>> {
        let items = list.as_array().context("replay.json: expected a list")?;
        items.iter().map(|i| Ok((i["name"].as_str().context("a name")?.to_string(), i[key].clone()))).collect()
    };
    let golden = json!({
        "generator": "cargo xtask golden bless replay",
        "name": "replay",
        "seed": SEED,
        "options": {"commands": REPLAY},
        "tolerance": {"windows_relative": 0.02, "whole_relative": 0.1, "base_m": 0.05, "lag_s": 0.0005},
        "windows_count": report["windows"]["count"],
        "windows_pos_rms_mean": report["windows"]["pos_rms_mean"],
        "windows_pos_rms": figures(&report["windows"]["joints"], "pos_rms")?,
        "whole_pos_rms_mean": report["pos_rms_mean"],
        "whole_pos_rms": figures(&report["joints"], "pos_rms")?,
        "lag_behind_simulation": figures(&report["lags"]["behind_simulation"], "lag")?,
        "base_pos_final": report["base"]["pos_final"],
    });
    let file = out.join("replay.json");
    fs::write(&file, format!("{golden:#}\n")).with_context(|| format!("writing {}", file.display()))
}
