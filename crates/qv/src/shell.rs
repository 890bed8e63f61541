//! What a shell and a reader of manuals want to know of the commands: `qv completions`, `qv man`.

use crate::outcome::about;
use crate::output::{make_folder, write_whole};
use crate::{Failure, Outcome, say};
use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use std::path::{Path, PathBuf};

pub const COMPLETIONS_EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv completions bash > ~/.local/share/bash-completion/completions/qv\n\
     \x20 qv completions zsh > ~/.zfunc/_qv          # with fpath+=~/.zfunc before compinit in ~/.zshrc\n\
     \x20 qv completions fish > ~/.config/fish/completions/qv.fish\n\
     \x20 qv completions powershell >> $PROFILE"
);
pub const MAN_EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv man ~/.local/share/man/man1 && man qv-diagnose"
);

#[derive(clap::Args)]
pub struct Completions {
    /// Shell to complete for
    #[arg(value_enum)]
    shell: Shell,
}

impl Completions {
    /// Of the commands of `root`.
    pub fn execute(&self, mut root: Command) -> Result<Outcome, Failure> {
        let mut text = vec![];
        clap_complete::generate(self.shell, &mut root, "qv", &mut text);
        say(&String::from_utf8_lossy(&text))?;
        Ok(Outcome::Done)
    }
}

#[derive(clap::Args)]
pub struct Manuals {
    /// Directory for qv.1, qv-diagnose.1, ... [created if missing]
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl Manuals {
    /// Of the commands of `root`.
    pub fn execute(&self, mut root: Command) -> Result<Outcome, Failure> {
        make_folder(&self.folder).map_err(|e| about(&self.folder, format!("expected a folder, found {e}")))?;
        root.build();
        let count = page(root, &self.folder)?;
        say(&format!("{count} pages written to {}\n", self.folder.display()))?;
        Ok(Outcome::Done)
    }
}

/// Writes the page of a command that was built, and those of the commands in it; gives how many.
fn page(command: Command, folder: &Path) -> Result<usize, Failure> {
    let name = command.get_display_name().unwrap_or(command.get_name()).to_owned();
    let inner: Vec<Command> =
        command.get_subcommands().filter(|c| !c.is_hide_set() && c.get_name() != "help").cloned().collect();
    let mut text = vec![];
    Man::new(command).render(&mut text)?;
    write_whole(&folder.join(format!("{name}.1")), &text)?;
    inner.into_iter().try_fold(1, |count, inner| Ok(count + page(inner, folder)?))
}
