//! `qv record`: what a robot says now, as the file that `ros2 bag record` writes.

use super::Listening;
use crate::{Failure, Outcome};
use std::path::PathBuf;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv record --live eth0 --out walk.mcap\n\
     \x20 qv record --live 192.168.123.99 --seconds 30 --out walk.mcap\n\
     \x20 qv inspect walk.mcap\n\
     \n\
     Every second of the recording is on the disk when it is over. An existing file is never replaced. Nothing is published.\n\
     See docs/guide/live.md.",
    "3 done, but messages were lost or were none of their type (reported)"
);

#[derive(clap::Args)]
#[cfg_attr(not(feature = "live"), allow(dead_code))]
pub struct Record {
    #[command(flatten)]
    listening: Listening,
    /// Write the recording to this new file
    #[arg(long, value_name = "FILE.mcap", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

#[cfg(not(feature = "live"))]
impl Record {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        Err(super::not_built())
    }
}

#[cfg(feature = "live")]
impl Record {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        use super::listen::Listener;
        use crate::outcome::about;
        let mut listener = Listener::new(&self.listening)?;
        // Written in place: what a power cut leaves is the recording up to then.
        let file = std::fs::File::options().write(true).create_new(true).open(&self.out);
        let file = file.map_err(|e| about(&self.out, format!("cannot begin a recording: {e}; name a new file")))?;
        let mut recorder = qv_live::Recorder::new(file, &listener.subscriptions)?;
        let ended = listener.run(|sample| recorder.write(&sample), |_| Ok(()));
        // What came before an error is kept.
        recorder.finish()?;
        ended?;
        if listener.messages() == 0 {
            std::fs::remove_file(&self.out).ok();
            return Err(about(&self.out, "cannot record: no message came; look at --live, --domain and --robot"));
        }
        if self.json {
            let line = serde_json::json!({ "format": "qv-record/1", "out": self.out, "topics": listener.to_json() });
            crate::say(&format!("{line}\n"))?;
        } else {
            crate::say(&format!("{}written to {}\n", listener.to_text(), self.out.display()))?;
        }
        Ok(if listener.is_partial() { Outcome::Partial } else { Outcome::Done })
    }
}
