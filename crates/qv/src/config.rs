//! `qv.toml`: options that hold for every call in its folder and below.
//!
//! They are put into the command line behind the names of the commands, so that the rules of the options hold for them, too. A file says neither
//! where something is written nor to whom something is sent; one of another user says nothing.

use crate::Failure;
use crate::outcome::about;
use clap::{Arg, ArgAction, Command};
use qv_sim::names::unknown;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use toml::{Table, Value};

/// Name of the file.
const FILE: &str = "qv.toml";
/// Options that are none to be given once and for all.
const NEVER: [&str; 3] = ["help", "version", "no-config"];

/// Options that are typed or not given at all: where results go, and to whom, and for which model, a request with a key is sent.
const TYPED: [&str; 5] = ["ask", "model", "out", "replace", "scene-out"];

/// Words of the command line as they were understood: they belong to the process, as its arguments do.
static WORDS: OnceLock<Vec<String>> = OnceLock::new();

/// What was typed, and what `qv.toml` added.
pub struct Words {
    pub all: Vec<OsString>,
    /// The file, where it added something.
    pub file: Option<PathBuf>,
    pub added: Vec<String>,
    /// What a file says that is not followed, and why; a line each.
    pub ignored: Vec<String>,
}

impl Words {
    /// What was added, for people.
    pub fn remarks(&self) -> Option<String> {
        Some(format!("{} adds {}", self.file.as_ref()?.display(), self.added.join(" ")))
    }

    /// Keeps them for [`arguments`].
    pub fn keep(&self) {
        let text = self.all.iter().map(|word| word.to_string_lossy().into_owned()).collect();
        WORDS.set(text).ok();
    }
}

/// All words behind the name of the program, with what `qv.toml` added.
pub fn arguments() -> Vec<String> {
    let words = WORDS.get().cloned().unwrap_or_else(|| std::env::args().collect());
    words.into_iter().skip(1).collect()
}

/// Words as one types them: those that a shell would read otherwise in quotes.
pub fn typed(words: &[String]) -> String {
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    match !word.is_empty() && word.chars().all(is_plain) {
        true => word.into(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

/// Words without some long options that take a value, and without their values.
#[cfg(feature = "learn")]
pub fn without(words: Vec<String>, options: &[&str]) -> Vec<String> {
    let mut words = words.into_iter();
    let mut kept = Vec::new();
    while let Some(word) = words.next() {
        if !long_of(&word).is_some_and(|long| options.contains(&long)) {
            kept.push(word);
        } else if !word.contains('=') {
            words.next();
        }
    }
    kept
}

/// Words with another value for a long option.
pub fn with_value(mut words: Vec<String>, option: &str, value: &str) -> Vec<String> {
    for k in 0..words.len() {
        if long_of(&words[k]) != Some(option) {
            continue;
        }
        if words[k].contains('=') {
            words[k] = format!("--{option}={value}");
        } else if k + 1 < words.len() {
            words[k + 1] = value.into();
        }
    }
    words
}

/// Commands that take no option of a file.
const OF_SHELLS: [&str; 3] = ["help", "completions", "man"];
/// Words with which no file is read.
const FILELESS: [&str; 5] = ["--no-config", "--help", "-h", "--version", "-V"];

/// The words with the options of the nearest `qv.toml`, in `folder` or above it.
///
/// # Errors
/// The file is no TOML, or has a key or a value that no command takes.
pub fn with_file(typed: Vec<OsString>, folder: &Path, root: &Command) -> Result<Words, Failure> {
    let none = |all, ignored| Ok(Words { all, file: None, added: vec![], ignored });
    let own = typed.iter().position(|word| word == "--").map_or(&typed[..], |end| &typed[..end]);
    // Help, and what a shell asks for, are given whatever stands in a file above.
    let asks_nothing = own.get(1).is_some_and(|word| OF_SHELLS.iter().any(|known| word == known));
    if asks_nothing || own.iter().any(|word| FILELESS.iter().any(|known| word == known)) {
        return none(typed, vec![]);
    }
    let Some(file) = folder.ancestors().map(|folder| folder.join(FILE)).find(|file| file.is_file()) else {
        return none(typed, vec![]);
    };
    if !is_own(&file) {
        let why = "it belongs to another user; copy it, or name its options";
        return none(typed, vec![format!("ignores '{}': {why}", file.display())]);
    }
    let text = std::fs::read_to_string(&file).map_err(|e| about(&file, format!("expected options, found {e}")))?;
    let table: Table = text.parse().map_err(|e| about(&file, format!("expected TOML, found {e}")))?;
    check(&table, root, "").map_err(|found| about(&file, found))?;
    let Some(called) = CommandChain::of(own, root) else { return none(typed, vec![]) };
    // Paths are reported as they are written where that is where one stands.
    let base = file.parent().filter(|base| *base != folder).map(Path::to_path_buf).unwrap_or_default();
    let (added, refused) = called.additions(&table, &base);
    let why = "it is taken from the command line alone";
    let ignored = refused.iter().map(|option| format!("ignores --{option} of '{}': {why}", file.display())).collect();
    let at = called.end;
    let mut all = typed;
    all.splice(at..at, added.iter().map(OsString::from));
    let file = Some(file).filter(|_| !added.is_empty());
    Ok(Words { all, file, added, ignored })
}

/// Whether a file belongs to who calls, as git asks of a repository: to this user, or to the one who called sudo.
#[cfg(unix)]
fn is_own(file: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let user = rustix::process::geteuid().as_raw();
    let caller = std::env::var("SUDO_UID").ok().and_then(|id| id.parse().ok()).filter(|_| user == 0);
    // The link and what it leads to.
    let owners = [std::fs::symlink_metadata(file), std::fs::metadata(file)];
    owners.iter().all(|found| found.as_ref().is_ok_and(|file| file.uid() == user || Some(file.uid()) == caller))
}

/// No owner is known there.
#[cfg(not(unix))]
fn is_own(_: &Path) -> bool {
    true
}

/// Looks whether commands take all of it. `place` is that of the table, with a dot at its end.
fn check(table: &Table, command: &Command, place: &str) -> Result<(), String> {
    for (key, value) in table {
        let name = format!("{place}{key}");
        if let Value::Table(inner) = value {
            let known = || command.get_subcommands().map(Command::get_name);
            let Some(inner_command) = command.get_subcommands().find(|c| c.get_name() == key) else {
                return Err(format!("[{name}]: expected a command, found {}", unknown("command", key, known())));
            };
            check(inner, inner_command, &format!("{name}."))?;
            continue;
        }
        let Some(arg) = option(command, key) else {
            let known = options(command).filter_map(Arg::get_long);
            let of = if place.is_empty() { "every command".into() } else { format!("qv {}", words_of(place)) };
            return Err(format!("{name}: expected an option of {of}, found {}", unknown("option", key, known)));
        };
        taken(arg, value).map_err(|expected| format!("{name}: expected {expected}, found {value}"))?;
    }
    Ok(())
}

fn words_of(place: &str) -> String {
    place.trim_end_matches('.').replace('.', " ")
}

/// Options with a long name.
fn options(command: &Command) -> impl Iterator<Item = &Arg> {
    command.get_arguments().filter(|arg| arg.get_long().is_some_and(|long| !NEVER.contains(&long)))
}

fn option<'c>(command: &'c Command, long: &str) -> Option<&'c Arg> {
    options(command).find(|arg| has_name(arg, long))
}

/// Whether a long name is the option's own, or one of an older version.
fn has_name(arg: &Arg, long: &str) -> bool {
    arg.get_long() == Some(long) || arg.get_all_aliases().is_some_and(|old| old.contains(&long))
}

fn is_flag(arg: &Arg) -> bool {
    matches!(arg.get_action(), ArgAction::SetTrue)
}

/// # Errors
/// What is expected instead.
fn taken(arg: &Arg, value: &Value) -> Result<(), &'static str> {
    let plain = |value: &Value| matches!(value, Value::String(_) | Value::Integer(_) | Value::Float(_));
    match value {
        Value::Boolean(_) if is_flag(arg) => Ok(()),
        _ if is_flag(arg) => Err("true or false"),
        Value::Array(list) if matches!(arg.get_action(), ArgAction::Append) && list.iter().all(plain) => Ok(()),
        value if plain(value) => Ok(()),
        _ if matches!(arg.get_action(), ArgAction::Append) => Err("text, a number, or a list of them"),
        _ => Err("text or a number"),
    }
}

/// The commands of a command line.
struct CommandChain<'c> {
    /// From the outermost, `qv`, to the innermost.
    commands: Vec<&'c Command>,
    /// Index of the word behind the name of the last one.
    end: usize,
    /// Options that are there already, as they are distinguished by.
    typed: BTreeSet<&'c str>,
}

impl<'c> CommandChain<'c> {
    /// None where no command is named.
    fn of(words: &[OsString], root: &'c Command) -> Option<Self> {
        let (mut commands, mut end) = (vec![root], 1);
        for (k, word) in words.iter().enumerate().skip(1) {
            // What is no text names no command.
            let Some(word) = word.to_str() else { break };
            // Options that stand before a command have no values.
            if word.starts_with('-') {
                continue;
            }
            let inner = commands[commands.len() - 1].get_subcommands().find(|c| c.get_name() == word);
            let Some(inner) = inner else { break };
            commands.push(inner);
            end = k + 1;
        }
        let is_typed = |arg: &&'c Arg| words.iter().any(|word| names(arg, &word.to_string_lossy()));
        let typed =
            commands.iter().flat_map(|c| options(c)).filter(is_typed).map(|arg| arg.get_id().as_str()).collect();
        (commands.len() > 1).then_some(Self { commands, end, typed })
    }

    /// Options of the file that the command line leaves open, and names of those that are not taken from a file. `base` is put before relative paths.
    fn additions<'t>(&self, table: &'t Table, base: &Path) -> (Vec<String>, Vec<&'t str>) {
        let (mut added, mut refused, mut here) = (vec![], vec![], Some(table));
        for (depth, command) in self.commands.iter().enumerate() {
            if depth > 0 {
                here = here.and_then(|table| table.get(command.get_name())).and_then(Value::as_table);
            }
            for (key, value) in here.into_iter().flatten() {
                let Some(arg) = option(command, key).filter(|arg| self.is_open(command, arg)) else { continue };
                if TYPED.contains(&key.as_str()) {
                    refused.push(key.as_str());
                    continue;
                }
                match value {
                    Value::Boolean(true) => added.push(format!("--{key}")),
                    Value::Boolean(false) => {}
                    Value::Array(list) => added.extend(list.iter().map(|v| format!("--{key}={}", text(arg, v, base)))),
                    one => added.push(format!("--{key}={}", text(arg, one, base))),
                }
            }
        }
        (added, refused)
    }

    /// Whether neither an option nor one that goes against it was typed.
    fn is_open(&self, command: &Command, arg: &Arg) -> bool {
        let against = |a: &Arg, b: &Arg| command.get_arg_conflicts_with(a).iter().any(|c| c.get_id() == b.get_id());
        let goes_against = |other: &&str| {
            let other = command.get_arguments().find(|a| a.get_id() == *other);
            other.is_some_and(|other| against(other, arg) || against(arg, other))
        };
        !self.typed.contains(arg.get_id().as_str()) && !self.typed.iter().any(goes_against)
    }
}

/// The name of an option that a word is, with a value or without, if it is a long one.
fn long_of(word: &str) -> Option<&str> {
    word.strip_prefix("--").map(|long| long.split('=').next().unwrap_or(long))
}

/// Whether a word of the command line is this option, with a value or without.
fn names(arg: &Arg, word: &str) -> bool {
    if let Some(long) = long_of(word) {
        return has_name(arg, long);
    }
    let shorts = word.strip_prefix('-').unwrap_or("");
    arg.get_short().is_some_and(|short| shorts.contains(short)) && shorts.chars().all(char::is_alphabetic)
}

/// A value as it is typed. A relative path counts from where the file lies: one of an option that takes nothing else, or one of a
/// file that is there.
fn text(arg: &Arg, value: &Value, base: &Path) -> String {
    let Value::String(text) = value else { return value.to_string() };
    let beside = base.join(text);
    let takes = |what: &str| arg.get_value_names().into_iter().flatten().any(|name| name.contains(what));
    let is_path = arg.get_value_parser().type_id() == std::any::TypeId::of::<PathBuf>();
    if is_path || (takes("FILE") && beside.is_file()) { beside.display().to_string() } else { text.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use clap::CommandFactory as _;
    use std::fs;

    #[test]
    fn words_are_quoted_as_a_shell_reads_them() {
        let words = ["walk", "--vx=-1,1", "a b", "it's $HOME;", ""].map(String::from);
        assert_eq!(typed(&words), "walk --vx=-1,1 'a b' 'it'\\''s $HOME;' ''");
    }

    #[test]
    fn the_value_of_an_option_is_replaced_in_its_place() {
        let words = |text: &str| text.split(' ').map(String::from).collect::<Vec<_>>();
        let found = with_value(words("diagnose --reference a b --out why run.mcap"), "out", "x y");
        assert_eq!(found.join("|"), "diagnose|--reference|a|b|--out|x y|run.mcap");
        assert_eq!(with_value(words("diagnose run --out=why"), "out", "new").join(" "), "diagnose run --out=new");
    }

    /// Words with a file in a folder `lab`, called from `lab/day`.
    fn words(name: &str, file: &str, typed: &str) -> Result<Vec<String>, String> {
        let lab = std::env::temp_dir().join(format!("qv-config-{name}-{}", std::process::id())).join("lab");
        fs::create_dir_all(lab.join("day")).unwrap();
        fs::write(lab.join(FILE), file).unwrap();
        fs::write(lab.join("yard.glb"), "").unwrap();
        let typed = typed.split(' ').map(OsString::from).collect();
        let found = with_file(typed, &lab.join("day"), &built());
        fs::remove_dir_all(lab.parent().unwrap()).unwrap();
        let lab = format!("{}/", lab.display());
        let plain = |word: OsString| word.to_string_lossy().replace(&lab, "LAB/");
        found.map(|words| words.all.into_iter().map(plain).collect()).map_err(|e| e.to_string().replace(&lab, "LAB/"))
    }

    fn built() -> Command {
        let mut command = crate::Cli::command();
        command.build();
        command
    }

    const FILE_OF_LAB: &str = "quiet = true\n[diagnose]\nterrain = \"yard.glb\"\nparams = \"p.toml\"\nseed = 3\nwithout = [\"backlash\", \"imu_tilt\"]\njson = false\n\
        [walk.train]\niterations = 900\n";

    #[test]
    fn what_is_not_typed_comes_from_the_file() {
        let found = words("a", FILE_OF_LAB, "qv diagnose run.mcap --out o").unwrap();
        let expected = "qv diagnose --quiet --params=LAB/p.toml --seed=3 --terrain=LAB/yard.glb --without=backlash --without=imu_tilt run.mcap --out o";
        assert_eq!(found.join(" "), expected);
        assert_eq!(
            words("b", FILE_OF_LAB, "qv walk train").unwrap().join(" "),
            "qv walk train --quiet --iterations=900"
        );
        assert_eq!(words("c", FILE_OF_LAB, "qv effects").unwrap().join(" "), "qv effects --quiet");
    }

    #[test]
    fn the_command_line_wins() {
        let found = words("d", FILE_OF_LAB, "qv -v diagnose run.mcap --terrain plane --seed=9 --params x").unwrap();
        // --quiet goes against -v.
        assert_eq!(
            found.join(" "),
            "qv -v diagnose --without=backlash --without=imu_tilt run.mcap --terrain plane --seed=9 --params x"
        );
        let found = words("e", FILE_OF_LAB, "qv diagnose run.mcap --no-config").unwrap();
        assert_eq!(found.join(" "), "qv diagnose run.mcap --no-config");
        let plan = "[fleet.plan]\njobs = 3\n";
        assert_eq!(
            words("f", plan, "qv fleet plan lab --out f -- --jobs 9").unwrap().join(" "),
            "qv fleet plan --jobs=3 lab --out f -- --jobs 9"
        );
    }

    #[test]
    fn where_things_go_is_not_taken_from_a_file() {
        let file = "[contact]\nask = \"http://elsewhere\"\nmodel = \"m\"\nout = \"/etc\"\n[mesh]\nout = \"/etc/passwd\"\nscene-out = \"x\"";
        assert_eq!(words("n", file, "qv contact run").unwrap().join(" "), "qv contact run");
        assert_eq!(words("o", file, "qv mesh scene.ply").unwrap().join(" "), "qv mesh scene.ply");
    }

    #[cfg(unix)]
    #[test]
    fn a_file_of_another_user_is_ignored() {
        let folder = std::env::temp_dir().join(format!("qv-config-owner-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let file = folder.join(FILE);
        fs::write(&file, "quiet = true").unwrap();
        assert!(is_own(&file));
        // Only root may give a file away.
        if std::os::unix::fs::chown(&file, Some(65_534), None).is_ok() {
            let typed = ["qv", "effects"].map(OsString::from).to_vec();
            let found = with_file(typed, &folder, &built()).unwrap();
            assert!(found.added.is_empty() && found.ignored[0].states("another"), "{:?}", found.ignored);
        }
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_no_command_takes_is_named_with_the_nearest() {
        for (name, file, parts) in [
            ("g", "[diagnose]\nterain = \"a\"", ["LAB/qv.toml", "diagnose.terain", "nearest: terrain", "qv diagnose"]),
            ("h", "[diagnos]\nseed = 1", ["LAB/qv.toml", "[diagnos]", "nearest: diagnose", "command"]),
            (
                "i",
                "[walk.train]\niteration = 1",
                ["LAB/qv.toml", "walk.train.iteration", "nearest: iterations", "qv walk train"],
            ),
            ("j", "seed = 1", ["LAB/qv.toml", "seed", "every command", "option"]),
            ("k", "[diagnose]\njson = 1", ["LAB/qv.toml", "diagnose.json", "true or false", "found 1"]),
            ("l", "[diagnose]\nseed = [1, 2]", ["LAB/qv.toml", "diagnose.seed", "text or a number", "[1, 2]"]),
            ("m", "[diagnose\nseed = 1", ["LAB/qv.toml", "expected TOML", "line 1", "unclosed table"]),
        ] {
            // The file is looked at whole, whichever command is called.
            let error = words(name, file, "qv effects").unwrap_err();
            assert!(parts.iter().all(|part| error.contains(part)), "{error}");
        }
    }

    #[test]
    fn every_option_can_be_in_the_file() {
        fn each(command: &Command) {
            for arg in options(command) {
                assert!(arg.get_action().takes_values() || is_flag(arg), "{} of {}", arg.get_id(), command.get_name());
            }
            command.get_subcommands().for_each(each);
        }
        each(&built());
    }
}
