//! What holds for the help of every command.

use super::Cli;
#[path = "../../../fixtures/words.rs"]
mod words;
use clap::{Arg, Command, CommandFactory};

/// Lines that `-h` may have.
const SCREEN: usize = 40;
/// Options that `-h` may show, beside common ones.
const BASICS: usize = 12;
/// Characters of a line of help.
const LINE: usize = 80;
/// Heading of options that every command has.
const COMMON: &str = "Common";

/// Every command with its name, as it is typed; those of clap itself left out.
fn each(command: &Command, name: &str, check: &mut dyn FnMut(&Command, &str)) {
    check(command, name);
    for inner in command.get_subcommands().filter(|inner| inner.get_name() != "help") {
        each(inner, &format!("{name} {}", inner.get_name()), check);
    }
}

fn of_all(check: &mut dyn FnMut(&Command, &str)) {
    let mut root = Cli::command();
    root.build();
    each(&root, "qv", check);
}

fn basics(command: &Command) -> Vec<&Arg> {
    let shown = |arg: &&Arg| !arg.is_hide_set() && !arg.is_hide_short_help_set();
    let options = command.get_arguments().filter(|arg| !arg.is_positional()).filter(shown);
    options.filter(|arg| arg.get_help_heading() != Some(COMMON)).collect()
}

#[test]
fn short_help_fits_a_screen_and_shows_the_basics() {
    of_all(&mut |command, name| {
        let text = command.clone().render_help().to_string();
        let count = text.lines().count();
        assert!(count <= SCREEN, "{name} -h has {count} lines:\n{text}");
        let basics: Vec<String> = basics(command).iter().map(|arg| arg.to_string()).collect();
        assert!(basics.len() <= BASICS, "{name} -h shows {} options: {}", basics.len(), basics.join(", "));
    });
}

#[test]
fn every_option_has_a_heading_and_a_line_of_help() {
    of_all(&mut |command, name| {
        for arg in command.get_arguments().filter(|arg| !arg.is_hide_set()) {
            let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
            let length = help.chars().count();
            assert!((1..=LINE).contains(&length) && !help.contains('\n'), "{name} {arg}: {length} characters: {help}");
            assert!(!help.ends_with('.'), "{name} {arg}: a line, not a sentence: {help}");
            let has_heading = arg.is_positional() || arg.get_help_heading().is_some();
            assert!(has_heading, "{name} {arg}: expected a heading");
        }
        let about = command.get_about().map(ToString::to_string).unwrap_or_default();
        assert!((1..=LINE).contains(&about.chars().count()), "{name}: {about}");
    });
}

#[test]
fn every_command_has_examples_and_exit_codes() {
    let mut count = 0;
    of_all(&mut |command, name| {
        let text = command.clone().render_long_help().to_string();
        let starts = |line: &str| text.lines().any(|l| l.trim_start().starts_with(line));
        assert!(starts("Examples:") && starts(name) && starts("Exit codes:"), "{name} --help:\n{text}");
        assert!(starts("0 done, 1 failed, 2 usage error"), "{name} --help:\n{text}");
        count += 1;
    });
    assert!(count > 30, "only {count} commands");
}

#[test]
fn help_uses_the_words_of_the_field() {
    of_all(&mut |command, name| {
        let text = command.clone().render_long_help().to_string();
        let found = words::old_words(&text);
        assert!(found.is_empty(), "{name} --help: {found:?}\n{text}");
    });
}

#[test]
fn a_robot_a_terrain_and_a_calibration_have_one_name() {
    of_all(&mut |command, name| {
        for arg in command.get_arguments() {
            let Some(long) = arg.get_long() else { continue };
            let one = ["ground", "correction", "calibrated", "calibration", "around", "urdf", "model-file"];
            assert!(!one.contains(&long), "{name} --{long}: expected --terrain, --params or --robot");
            if long == "robot" {
                let names = arg.get_value_names().unwrap_or_default();
                assert!(names.len() == 1 && names[0] == "ROBOT", "{name} --robot {names:?}");
            }
        }
    });
}
