//! The command line `qv`. Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done with part of the input lost, 4 a robot or a report changed (`qv drift`, `qv report --reproduce`), 130 stopped.

mod ask;
#[cfg(test)]
#[path = "../../../fixtures/browser/mod.rs"]
mod browser;
mod camera;
mod can_tell;
mod capture;
mod check;
mod colmap;
mod config;
mod contact;
mod demo;
mod depth_unit;
mod diagnose;
mod drift;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
mod failure;
mod fixture;
mod fleet;
#[cfg(test)]
mod help;
mod inspect;
mod live;
mod lock;
mod memory;
mod mesh;
mod names;
#[cfg(feature = "learn")]
mod navigate;
mod next;
mod numbers;
mod open;
mod outcome;
mod output;
#[cfg(feature = "learn")]
mod policy_child;
mod progress;
mod provenance;
mod python;
mod reading;
mod reconstruct;
mod render;
mod replay;
mod report;
mod rgbd;
mod robots;
mod scene;
mod shell;
#[cfg(test)]
#[path = "../../../fixtures/skipped.rs"]
mod skipped;
mod stop;
mod terminal;
#[cfg(feature = "learn")]
mod tune;
mod usage;
mod validation;
mod video;
mod view;
#[cfg(feature = "learn")]
mod walk;

use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};
use outcome::{Failure, Outcome};
use output::OutputFolder;
use progress::Level;
use qv_open::{foreign, ground, mesh_file};
use reading::{Reading, RunArguments};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use terminal::{print_message, say};

const ROOT_EXAMPLE: &str = usage::help_text!(
    "Examples:\n  qv demo\n  qv inspect walk.mcap\n  qv diagnose walk.mcap --out out/why",
    "3 done, but part of the input was lost (reported)"
);

/// Find out why a robot and its simulator disagree, and correct the simulator
#[derive(Parser)]
#[command(name = "qv", version, arg_required_else_help = true, disable_help_flag = true, disable_version_flag = true)]
#[command(after_long_help = ROOT_EXAMPLE)]
struct Cli {
    /// Print only results, errors and data-loss warnings
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = "Common")]
    quiet: bool,
    /// Print the time of each stage
    #[arg(short, long, global = true, help_heading = "Common")]
    verbose: bool,
    /// Ignore qv.toml
    #[arg(long, global = true, help_heading = "Common")]
    no_config: bool,
    /// Print help: the basics with -h, everything with --help
    #[arg(short, long, global = true, action = clap::ArgAction::Help, help_heading = "Common")]
    help: Option<bool>,
    /// Print the version
    #[arg(short = 'V', long, action = clap::ArgAction::Version, help_heading = "Common")]
    version: Option<bool>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Record a simulated robot with a hidden effect and diagnose it
    #[command(after_long_help = demo::EXAMPLE)]
    Demo(demo::Demo),
    /// Print the contents of a recording: topics, rates, gaps and faults
    #[command(after_long_help = inspect::EXAMPLE)]
    Inspect(inspect::Inspect),
    /// List supported robots with their topics
    #[command(after_long_help = robots::EXAMPLE)]
    Robots(robots::Robots),
    /// List the physical effects that a diagnosis tests
    #[command(after_long_help = names::EFFECTS_EXAMPLE)]
    Effects(names::Effects),
    /// List the simulator parameters of a robot
    #[command(after_long_help = names::PARAMS_EXAMPLE)]
    Params(names::Params),
    /// Identify files and report what each command lacks
    #[command(after_long_help = check::EXAMPLE)]
    Check(check::Check),
    /// Replay a recording in the simulator and print errors by joint
    #[command(after_long_help = replay::EXAMPLE)]
    Replay(replay::Replay),
    /// Identify which physical effect explains the sim-to-real gap
    #[command(after_long_help = diagnose::EXAMPLE)]
    Diagnose(diagnose::Diagnose),
    /// Test whether a robot has changed since its calibration
    #[command(after_long_help = drift::EXAMPLE)]
    Drift(drift::DriftCheck),
    /// Propose the next motion to record, to separate open causes
    #[command(after_long_help = next::EXAMPLE)]
    Next(next::Next),
    /// Identify friction by terrain label from recordings
    #[command(after_long_help = contact::EXAMPLE)]
    Contact(contact::Contact),
    /// Reconstruct a Gaussian scene from images or video
    #[command(after_long_help = reconstruct::EXAMPLE)]
    Reconstruct(reconstruct::Reconstruct),
    /// Render cameras of a Gaussian scene
    #[command(after_long_help = render::EXAMPLE)]
    Render(render::Render),
    /// Extract a labelled, watertight collision mesh
    #[command(after_long_help = mesh::EXAMPLE)]
    Mesh(Box<mesh::Mesh>),
    /// Train, score and play locomotion policies
    #[cfg(feature = "learn")]
    #[command(after_long_help = walk::EXAMPLE)]
    Walk(walk::Walk),
    /// Train and test visual navigation in a reconstructed scene
    #[cfg(feature = "learn")]
    #[command(after_long_help = navigate::EXAMPLE)]
    Navigate(Box<navigate::Navigate>),
    /// Fine-tune a locomotion policy on recordings
    #[cfg(feature = "learn")]
    #[command(after_long_help = tune::EXAMPLE)]
    Tune(Box<tune::Tune>),
    /// Record a robot's topics over DDS, without ROS
    #[command(after_long_help = live::RECORD_EXAMPLE)]
    Record(live::Record),
    /// Watch a robot's data on a page that updates itself
    #[command(after_long_help = live::WATCH_EXAMPLE)]
    Watch(live::Watch),
    /// Process many recordings: diagnose, contact or tune
    #[command(after_long_help = fleet::EXAMPLE)]
    Fleet(fleet::Fleet),
    /// Assemble results into one HTML page
    #[command(after_long_help = report::EXAMPLE)]
    Report(report::Report),
    /// Write an interactive 3D page of scene, terrain, robot and slips
    #[command(after_long_help = view::EXAMPLE)]
    View(view::View),
    /// Print shell completions
    #[command(after_long_help = shell::COMPLETIONS_EXAMPLE)]
    Completions(shell::Completions),
    /// Write manual pages
    #[command(after_long_help = shell::MAN_EXAMPLE)]
    Man(shell::Manuals),
    /// Record a simulated Go2 with a known effect on a known terrain
    #[command(after_long_help = fixture::EXAMPLE)]
    Fixture(fixture::Fixture),
}

/// A command line that cannot be followed, as it is reported.
enum UsageError {
    Words(Box<clap::Error>, Option<String>),
    Config(Failure),
    /// What it would write is what it reads.
    Refused(Failure),
}

/// The command that was typed, with the options of `qv.toml`.
struct CommandLine {
    cli: Cli,
    /// The folder that it writes into.
    output: Option<PathBuf>,
    /// Its words, such as `walk train`.
    name: String,
}

fn understood() -> Result<CommandLine, UsageError> {
    let mut root = Cli::command();
    root.build();
    let typed = std::env::args_os().collect();
    let words = match std::env::current_dir() {
        Ok(folder) => config::with_file(typed, &folder, &root).map_err(UsageError::Config)?,
        Err(e) => return Err(UsageError::Config(format!("expected a current folder, found {e}").into())),
    };
    words.keep();
    words.ignored.iter().for_each(|what| print_message!("{what}"));
    let misused = |error: clap::Error| UsageError::Words(Box::new(error), words.remarks());
    let matches = Cli::command().try_get_matches_from(&words.all).map_err(misused)?;
    refuse_odd_paths(&root, &matches, &words.all).map_err(UsageError::Config)?;
    output::refuse(&root, &matches).map_err(UsageError::Refused)?;
    let output = output::targets(&root, &matches).folder;
    let cli = Cli::from_arg_matches(&matches).map_err(misused)?;
    progress::set(match (cli.quiet, cli.verbose) {
        (true, _) => Level::Quiet,
        (_, true) => Level::Verbose,
        _ => Level::Normal,
    });
    words.remarks().iter().for_each(|what| progress::remark(what));
    old_names(&root, &matches, &words.all).iter().for_each(|what| progress::remark(what));
    Ok(CommandLine { cli, output, name: name_of(&matches) })
}

/// The words of the command that was typed, such as `walk train`.
fn name_of(matches: &ArgMatches) -> String {
    let inner = std::iter::successors(matches.subcommand(), |(_, matches)| matches.subcommand());
    inner.map(|(name, _)| name).collect::<Vec<_>>().join(" ")
}

/// Options that were typed under a name of an older version, a line each.
fn old_names(root: &clap::Command, matches: &ArgMatches, words: &[OsString]) -> Vec<String> {
    let Some((command, _)) = output::innermost(root, matches) else { return Vec::new() };
    let options = words.iter().take_while(|word| *word != "--");
    let typed: Vec<&str> = options.filter_map(|word| word.to_str()?.strip_prefix("--")).collect();
    let typed: Vec<&str> = typed.into_iter().map(|word| word.split('=').next().unwrap_or(word)).collect();
    let mut lines = Vec::new();
    for argument in command.get_arguments() {
        let (Some(now), Some(others)) = (argument.get_long(), argument.get_all_aliases()) else { continue };
        let used = others.into_iter().filter(|old| typed.contains(old));
        lines.extend(used.map(|old| format!("--{old} is an older name of --{now}")));
    }
    lines
}

/// Says what of a command line is wrong, or prints the help that was asked for. A shell puts names of files into a command line.
fn print_misuse(error: &clap::Error) {
    let text = error.render().to_string();
    let safe = terminal::shown(&text);
    let is_help = !error.use_stderr() || safe == text;
    if is_help { drop(error.print()) } else { eprint!("{safe}") }
}

/// A command that writes stores the paths that it was given, as text.
///
/// # Errors
/// One of them is no UTF-8: another path would be stored.
fn refuse_odd_paths(root: &clap::Command, matches: &ArgMatches, words: &[OsString]) -> Result<(), Failure> {
    let writes = output::innermost(root, matches).is_some_and(|(command, _)| has_output(command));
    match words.iter().find(|word| word.to_str().is_none()) {
        Some(word) if writes => {
            let path = Path::new(word).display();
            Err(format!(
                "cannot store the path '{path}': its bytes are no UTF-8; give it another name, or a link to it"
            )
            .into())
        }
        _ => Ok(()),
    }
}

fn has_output(command: &clap::Command) -> bool {
    command.get_arguments().any(|arg| arg.get_id() == "out")
}

fn main() -> ExitCode {
    memory::keep();
    #[cfg(feature = "learn")]
    if policy_child::is_child() {
        return if policy_child::serve().is_ok() { ExitCode::SUCCESS } else { ExitCode::from(1) };
    }
    fleet::end_with_parent();
    let CommandLine { cli, output, name } = match understood() {
        Ok(found) => found,
        Err(UsageError::Config(error)) => {
            report(&error, "");
            return ExitCode::from(2);
        }
        Err(UsageError::Words(error, added)) => {
            print_misuse(&error);
            // Help and the version are no misuse.
            if let Some(added) = added.filter(|_| error.use_stderr()) {
                print_message!("{added}");
            }
            return ExitCode::from(error.exit_code() as u8);
        }
        Err(UsageError::Refused(error)) => {
            report(&error, "");
            return ExitCode::from(1);
        }
    };
    stop::watch();
    let result = output.map(|folder| OutputFolder::take(&folder)).transpose().and_then(|folder| {
        let ended = execute(cli.command);
        // What failed leaves what was there.
        let kept = folder.map_or(Ok(()), |folder| folder.end(ended.is_ok()));
        ended.and_then(|outcome| kept.map(|()| outcome))
    });
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Partial) => {
            print_message!("exit code 3: not everything could be used or done, for the reasons above");
            ExitCode::from(3)
        }
        Ok(Outcome::Changed) => ExitCode::from(4),
        Ok(Outcome::Stopped) => ExitCode::from(stop::STOPPED),
        Err(error) => {
            report(&error, &name);
            ExitCode::from(1)
        }
    }
}

/// Reports why a command failed, see [`failure`].
fn report(error: &Failure, command: &str) {
    terminal::error(&failure::message(&error.to_string(), command));
}

fn execute(command: Command) -> Result<Outcome, Failure> {
    match command {
        Command::Demo(command) => command.execute(),
        Command::Inspect(command) => command.execute().map_err(Failure::from),
        Command::Robots(command) => command.execute().map_err(Failure::from),
        Command::Effects(command) => command.execute().map_err(Failure::from),
        Command::Params(command) => command.execute().map_err(Failure::from),
        Command::Check(command) => command.execute(),
        Command::Replay(command) => command.execute().map_err(Failure::from),
        Command::Diagnose(command) => command.execute().map_err(Failure::from),
        Command::Drift(command) => command.execute(),
        Command::Next(command) => command.execute().map_err(Failure::from),
        Command::Contact(command) => command.execute().map_err(Failure::from),
        Command::Reconstruct(command) => command.execute(),
        Command::Render(command) => command.execute(),
        Command::Mesh(command) => command.execute(),
        #[cfg(feature = "learn")]
        Command::Walk(command) => command.execute(),
        #[cfg(feature = "learn")]
        Command::Navigate(command) => command.execute(),
        #[cfg(feature = "learn")]
        Command::Tune(command) => command.execute(),
        Command::Record(command) => command.execute(),
        Command::Watch(command) => command.execute(),
        Command::Fleet(command) => command.execute(Cli::command()),
        Command::Report(command) => command.execute(),
        Command::View(command) => command.execute(),
        Command::Completions(command) => command.execute(Cli::command()),
        Command::Man(command) => command.execute(Cli::command()),
        Command::Fixture(command) => command.execute().map_err(Failure::from),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// Commands of a page: lines of its blocks that begin with `$ qv` or `qv`, joined where they go on, without remarks and what a shell does.
    fn commands(text: &str) -> Vec<Vec<String>> {
        let blocks = text.split("\n```").skip(1).step_by(2);
        let joined: Vec<String> = blocks.map(|block| block.replace("\\\n", " ")).collect();
        let lines = joined.iter().flat_map(|block| block.lines());
        let typed = lines.filter_map(|line| line.strip_prefix("$ ").or(Some(line)).filter(|l| l.starts_with("qv ")));
        let of_shell = |word: &&str| !["#", "&&", ">", "|"].contains(word);
        typed.map(|line| line.split_whitespace().take_while(of_shell).map(String::from).collect()).collect()
    }

    /// What prints a script or a page of a manual has nothing to say as JSON; the rehearsal is no command of users.
    const WITHOUT_JSON: [&str; 6] = ["completions", "man", "slurm", "snakemake", "rehearse", "help"];

    #[test]
    fn every_command_speaks_json() {
        fn each(command: &clap::Command) {
            let mut inner = command.get_subcommands().peekable();
            let is_leaf = inner.peek().is_none();
            if is_leaf && !WITHOUT_JSON.contains(&command.get_name()) {
                assert!(command.get_arguments().any(|arg| arg.get_long() == Some("json")), "{}", command.get_name());
            }
            inner.for_each(each);
        }
        each(&Cli::command());
    }

    #[test]
    fn commands_of_the_docs_are_understood() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let folders = ["docs/guide", "docs/reference", "docs/theory", "docs/dev"].map(|folder| root.join(folder));
        let docs = folders.iter().flat_map(|folder| fs::read_dir(folder).unwrap()).map(|entry| entry.unwrap().path());
        let pages = docs.filter(|path| path.extension().is_some_and(|end| end == "md")).chain([root.join("README.md")]);
        let mut count = 0;
        for page in pages {
            for words in commands(&fs::read_to_string(&page).unwrap()) {
                let found = Cli::try_parse_from(&words);
                assert!(found.is_ok(), "{}: {}\n{}", page.display(), words.join(" "), found.err().unwrap());
                count += 1;
            }
        }
        assert!(count > 40, "only {count} commands were found");
    }
}
