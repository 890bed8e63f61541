//! The last seconds of what came, as a run.

use crate::LiveError;
use crate::recorder::Recorder;
use crate::subscription::{Sample, Subscription};
use qv_recording::mapping::Mapping;
use qv_recording::{BagFile, Run, read_bag};
use std::collections::VecDeque;
use std::io::Cursor;

/// Samples of the last seconds, and no more than a number of bytes of them.
pub struct Recent {
    samples: VecDeque<Sample>,
    span: u64,
    bytes: usize,
    most: usize,
}

impl Recent {
    /// Keeps `seconds` \[s\], and of a flood the last `most` bytes.
    pub fn new(seconds: f64, most: usize) -> Self {
        Self { samples: VecDeque::new(), span: (seconds * 1e9) as u64, bytes: 0, most }
    }

    /// Adds a sample, and drops what is too old.
    pub fn push(&mut self, sample: Sample) {
        let now = sample.received;
        self.bytes += sample.data.len();
        self.samples.push_back(sample);
        while self.samples.front().is_some_and(|s| s.received + self.span < now || self.bytes > self.most) {
            self.bytes -= self.samples.pop_front().map_or(0, |s| s.data.len());
        }
    }

    /// Samples that are kept.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// What is kept as a run: read as a bag is, with the same checks.
    ///
    /// # Errors
    /// When nothing usable came, such as no joint states.
    pub fn to_run(&self, subscriptions: &[Subscription], mapping: &Mapping) -> Result<Run, LiveError> {
        let mut recorder = Recorder::new(Cursor::new(Vec::new()), subscriptions)?;
        self.samples.iter().try_for_each(|sample| recorder.write(sample))?;
        let mut source = recorder.finish()?;
        source.set_position(0);
        Ok(read_bag(vec![BagFile { name: "live".into(), source }], mapping)?)
    }
}
