//! The file of a [`Checkpoint`]: one line of JSON with settings and lengths, then all numbers as little-endian f32.

use crate::PolicyError;
use crate::score::Score;
use crate::train::{Checkpoint, TrainSettings};
use serde::{Deserialize, Serialize};

/// First bytes of the file, with its version.
const MAGIC: &str = "quadverse walk checkpoint 3";

#[derive(Serialize, Deserialize)]
struct Header {
    magic: String,
    settings: TrainSettings,
    identity: [String; 2],
    epoch: u64,
    iterations: u64,
    steps: u64,
    /// Numbers of rate (1), parameters, both means, curriculum, best parameters.
    lengths: [usize; 6],
    best: Option<Score>,
}

impl Checkpoint {
    /// The file.
    ///
    /// # Errors
    /// When a setting has no form in JSON (a number that is not finite).
    pub fn to_bytes(&self) -> Result<Vec<u8>, PolicyError> {
        let empty = Vec::new();
        let rate = vec![self.rate];
        let best = self.best.as_ref().map_or(&empty, |(_, parameters)| parameters);
        let arrays = [&rate, &self.parameters, &self.first, &self.second, &self.curriculum, best];
        let header = Header {
            magic: MAGIC.into(),
            settings: self.settings.clone(),
            identity: self.identity.clone(),
            epoch: self.epoch,
            iterations: self.iterations,
            steps: self.steps,
            lengths: arrays.map(Vec::len),
            best: self.best.as_ref().map(|(score, _)| score.clone()),
        };
        let mut out = serde_json::to_vec(&header).map_err(|e| bad(&e.to_string()))?;
        out.push(b'\n');
        arrays.iter().for_each(|a| a.iter().for_each(|x| out.extend(x.to_le_bytes())));
        Ok(out)
    }

    /// # Errors
    /// When the bytes are no such file, are cut off, or hold a number that is not finite.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, PolicyError> {
        let end = bytes.iter().position(|&b| b == b'\n').ok_or_else(|| bad("no line of JSON at its beginning"))?;
        let mut value: serde_json::Value = serde_json::from_slice(&bytes[..end]).map_err(|e| bad(&e.to_string()))?;
        // Policies of earlier versions see no clock.
        if let Some(task) = value.pointer_mut("/settings/task").and_then(serde_json::Value::as_object_mut) {
            task.entry("clock").or_insert(0.0.into());
        }
        if let Some(magic) = value["magic"].as_str().filter(|magic| *magic != MAGIC) {
            return Err(bad(&format!("expected `{MAGIC}`, found `{magic}`; train again with this version")));
        }
        let header: Header = serde_json::from_value(value).map_err(|e| bad(&e.to_string()))?;
        let body = &bytes[end + 1..];
        let wanted =
            header.lengths.iter().try_fold(0usize, |sum, &n| sum.checked_add(n)).and_then(|n| n.checked_mul(4));
        if wanted != Some(body.len()) {
            return Err(bad(&format!("expected {wanted:?} bytes of numbers, found {}", body.len())));
        }
        let numbers: Vec<f32> = body.chunks_exact(4).map(|c| f32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
        if let Some(at) = numbers.iter().position(|x| !x.is_finite()) {
            return Err(bad(&format!("number {at} is {}", numbers[at])));
        }
        let mut rest = numbers.as_slice();
        let mut take = |count: usize| {
            let (now, after) = rest.split_at(count);
            rest = after;
            now.to_vec()
        };
        let [rate, parameters, first, second, curriculum, best] = header.lengths.map(&mut take);
        Ok(Self {
            settings: header.settings,
            identity: header.identity,
            epoch: header.epoch,
            iterations: header.iterations,
            steps: header.steps,
            rate: *rate.first().ok_or_else(|| bad("no learning rate"))?,
            parameters,
            first,
            second,
            curriculum,
            best: header.best.map(|score| (score, best)),
        })
    }
}

fn bad(reason: &str) -> PolicyError {
    PolicyError::Text { what: "checkpoint".into(), reason: reason.into() }
}
