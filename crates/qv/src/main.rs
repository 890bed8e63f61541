//! The command line `qv`. Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done with part of the input lost, 130 stopped.

mod ask;
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
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
mod fixture;
mod fleet;
mod inspect;
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
mod stop;
mod terminal;
#[cfg(feature = "learn")]
mod tune;
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

/// Makes a legged robot's simulator agree with the robot.
#[derive(Parser)]
#[command(name = "qv", version, arg_required_else_help = true)]
struct Cli {
    /// Reports nothing but results, errors and what was lost
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Reports how long each stage took
    #[arg(short, long, global = true)]
    verbose: bool,
    /// Takes no options from qv.toml
    #[arg(long, global = true)]
    no_config: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Records a made-up robot that hides an effect, diagnoses it, and shows what was hidden beside what was found
    #[command(after_help = demo::EXAMPLE)]
    Demo(demo::Demo),
    /// What is in a recording: streams, rates, what was measured and what derived, gaps and faults
    #[command(after_help = inspect::EXAMPLE)]
    Inspect(inspect::Inspect),
    /// The robots whose messages are known, with their topics
    #[command(after_help = robots::EXAMPLE)]
    Robots(robots::Robots),
    /// The effects that a diagnosis knows: what each is, its unit and range
    #[command(after_help = names::EFFECTS_EXAMPLE)]
    Effects(names::Effects),
    /// The names of a robot's simulation parameters, with unit, neutral value and range
    #[command(after_help = names::PARAMS_EXAMPLE)]
    Params(names::Params),
    /// Says what any file is, what of it is used, and what is missing for which command
    #[command(after_help = check::EXAMPLE)]
    Check(check::Check),
    /// Replays a recording in the simulator and shows how far the two are apart, joint by joint
    #[command(after_help = replay::EXAMPLE)]
    Replay(replay::Replay),
    /// Says where the gap between simulator and robot lies, which effect causes it, and how far it shrinks
    #[command(after_help = diagnose::EXAMPLE)]
    Diagnose(diagnose::Diagnose),
    /// Which motion to record next, so that the causes that a diagnosis leaves open are distinguished
    #[command(after_help = next::EXAMPLE)]
    Next(next::Next),
    /// Finds the friction of each material of a labelled ground from recordings of a robot that walked on it
    #[command(after_help = contact::EXAMPLE)]
    Contact(contact::Contact),
    /// Makes a scene of Gaussians from photographs with cameras
    #[command(after_help = reconstruct::EXAMPLE)]
    Reconstruct(reconstruct::Reconstruct),
    /// Draws what cameras see of a scene of Gaussians
    #[command(after_help = render::EXAMPLE)]
    Render(render::Render),
    /// Turns a scene of Gaussians, or depth images, into a watertight, labelled collision mesh
    #[command(after_help = mesh::EXAMPLE)]
    Mesh(Box<mesh::Mesh>),
    /// Teaches a robot to walk after velocity commands, scores what it learnt, and shows it
    #[cfg(feature = "learn")]
    #[command(after_help = walk::EXAMPLE)]
    Walk(walk::Walk),
    /// Teaches a network to reach a cone in a reconstructed place from what a camera sees, and tests it
    #[cfg(feature = "learn")]
    #[command(after_help = navigate::EXAMPLE)]
    Navigate(Box<navigate::Navigate>),
    /// Trains a policy on under what recordings show of the robot's motors, and says by how much it strays less
    #[cfg(feature = "learn")]
    #[command(after_help = tune::EXAMPLE)]
    Tune(Box<tune::Tune>),
    /// Diagnoses (or calibrates, or tunes on) many recordings, each in a process of its own, and says what they share
    #[command(after_help = fleet::EXAMPLE)]
    Fleet(fleet::Fleet),
    /// Puts what reconstruction, contact, replay and diagnosis found on one page
    #[command(after_help = report::EXAMPLE)]
    Report(report::Report),
    /// Makes one HTML file in which one looks around: place, ground, robot as recorded and simulated, slips, causes
    #[command(after_help = view::EXAMPLE)]
    View(view::View),
    /// Prints what a shell needs to complete commands and options
    #[command(after_help = shell::COMPLETIONS_EXAMPLE)]
    Completions(shell::Completions),
    /// Writes manual pages, one for each command
    #[command(after_help = shell::MAN_EXAMPLE)]
    Man(shell::Manuals),
    /// Makes up a recording of the Go2 with a known cause, and the ground that it walked on
    #[command(hide = true, after_help = fixture::EXAMPLE)]
    Fixture(fixture::Fixture),
}

/// A command line that cannot be followed, as it is reported.
enum UsageError {
    Words(Box<clap::Error>, Option<String>),
    Config(Failure),
    /// What it would write is what it reads.
    Refused(Failure),
}

/// The command that was typed, with the options of `qv.toml`, and the folder that it writes into.
fn understood() -> Result<(Cli, Option<PathBuf>), UsageError> {
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
    Ok((cli, output))
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
    let (cli, output) = match understood() {
        Ok(found) => found,
        Err(UsageError::Config(error)) => {
            print_message!("{error}");
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
            print_message!("{error}");
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
        Ok(Outcome::Partial) => ExitCode::from(3),
        Ok(Outcome::Stopped) => ExitCode::from(stop::STOPPED),
        Err(error) => {
            print_message!("{error}");
            ExitCode::from(1)
        }
    }
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
        let docs = fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
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
