//! `cargo xtask guides`: the commands of README.md and of the tutorials run as they stand there, and what they print is compared with
//! what the pages say.

mod page;

use crate::programs;
use crate::workspace::{Build, Workspace};
use anyhow::{Context, Result, bail};
use page::Command as Typed;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// How to run.
#[derive(clap::Args)]
pub struct Guides {
    /// Pages; default: README.md and the tutorials
    pages: Vec<PathBuf>,
    /// Write figures that differ into the pages
    #[arg(long)]
    write: bool,
    /// Run the programs that `cargo xtask test` built, and build none with optimisation
    #[arg(long)]
    test_build: bool,
}

/// Pages whose commands are run.
const PAGES: [&str; 5] = [
    "README.md",
    "docs/guide/tour.md",
    "docs/guide/tutorial_bag.md",
    "docs/guide/tutorial_policy.md",
    "docs/guide/tutorial_video.md",
];
/// First words of commands that other gates of continuous integration run.
const ELSEWHERE: [&str; 3] = ["cargo install ", "cargo xtask ", "pip install "];
/// What a page types to run the maker of the synthetic yard.
const YARD: &str = "cargo run --release -p yard -- ";

/// Runs the commands of all pages, each page in a folder of its own; true when all succeed and print what the pages say.
///
/// # Errors
/// A program does not build, a page cannot be read, or holds a command that this chore does not know.
pub fn run(workspace: &Workspace, guides: &Guides) -> Result<bool> {
    let build = if guides.test_build { Build::Tests } else { Build::Release };
    let built = programs::build(&Workspace { build, ..workspace.clone() }, &["quadverse", "yard"], &[])?;
    let default = PAGES.map(PathBuf::from).to_vec();
    let mut faults = 0;
    for page in if guides.pages.is_empty() { &default } else { &guides.pages } {
        faults += run_page(workspace, page, &built, guides.write)?;
    }
    println!("{faults} faults in the commands of the guides");
    Ok(faults == 0)
}

/// Runs the commands of a page and returns how many fail or print something else.
fn run_page(workspace: &Workspace, page: &Path, built: &Path, write: bool) -> Result<usize> {
    let file = workspace.workspace_root.join(page);
    let text = fs::read_to_string(&file).with_context(|| format!("cannot read '{}'", file.display()))?;
    let name = page.file_stem().with_context(|| format!("{} has no name", page.display()))?;
    let folder = workspace.target_directory.join("guides").join(name);
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("cannot remove '{}'", folder.display()))?;
    }
    fs::create_dir_all(&folder).with_context(|| format!("cannot make '{}'", folder.display()))?;
    let (mut faults, mut mended) = (0, BTreeMap::new());
    for line in page::untagged(&text) {
        println!("{}:{line}: expected a block of `console` or `console own-data` around a command", page.display());
        faults += 1;
    }
    let commands = page::commands(&text);
    if commands.is_empty() {
        println!("{}: expected a command that can be run, found none", page.display());
        faults += 1;
    }
    for typed in commands {
        if ELSEWHERE.iter().any(|start| typed.words.starts_with(start)) {
            println!("{}: not run here: {}", page.display(), typed.words);
            continue;
        }
        let clock = Instant::now();
        faults += check(page, &typed, built, &folder, &mut mended)?;
        println!("{}: {:.1} s: {}", page.display(), clock.elapsed().as_secs_f64(), typed.words);
    }
    if write && !mended.is_empty() {
        let lines = text.lines().enumerate().map(|(k, line)| mended.get(&k).map_or(line, String::as_str));
        let text = lines.collect::<Vec<_>>().join("\n") + "\n";
        fs::write(&file, text).with_context(|| format!("cannot write '{}'", file.display()))?;
        println!("{}: {} lines written anew", page.display(), mended.len());
    }
    Ok(faults)
}

/// Runs a command and reports what differs; lines that differ in numbers alone are added to `mended`.
fn check(
    page: &Path,
    typed: &Typed,
    built: &Path,
    folder: &Path,
    mended: &mut BTreeMap<usize, String>,
) -> Result<usize> {
    let output = command(&typed.words, built)?.current_dir(folder).output();
    let output = output.with_context(|| format!("cannot run '{}'", typed.words))?;
    let printed = String::from_utf8_lossy(&output.stdout);
    if !output.status.success() {
        let errors = String::from_utf8_lossy(&output.stderr);
        println!("{}: {}: {}\n{printed}{errors}", page.display(), typed.words, output.status);
        return Ok(1);
    }
    let differences = page::differences(typed, &printed);
    for (line, expected, alike) in &differences {
        let found = alike.as_deref().unwrap_or("no such line");
        println!("{}:{}: expected: {expected}\n  found: {found}", page.display(), line + 1);
        mended.extend(alike.clone().map(|alike| (*line, alike)));
    }
    if differences.iter().any(|(_, _, alike)| alike.is_none()) {
        println!("{}: {}: printed:\n{printed}", page.display(), typed.words);
    }
    Ok(differences.len())
}

/// The program and arguments of a command as a page types it.
fn command(words: &str, built: &Path) -> Result<Command> {
    let (program, arguments) = match (words.strip_prefix("qv "), words.strip_prefix(YARD)) {
        (Some(arguments), _) => ("qv", arguments),
        (_, Some(arguments)) => ("yard", arguments),
        _ => bail!("expected a command of qv or of yard in a block of `console`, found '{words}'"),
    };
    let mut command = Command::new(built.join(programs::file(program)));
    command.args(arguments.split_whitespace());
    // No window opens while pages are checked.
    command.env("BROWSER", "true").env_remove("DISPLAY");
    Ok(command)
}
