//! What goes into the loop.

use super::settings::LoopSettings;
use crate::footing::Footing;
use crate::log::Log;
use crate::windows::{Window, windows};
use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, TaskRobot};
use qv_recording::Run;

/// What goes in.
pub struct Inputs<'a> {
    /// The robot.
    pub robot: &'a TaskRobot,
    /// The ground of its recordings.
    pub ground: &'a Ground,
    /// The ground that policies are trained on and compared on; often the same.
    pub train_on: &'a Ground,
    /// Its recordings.
    pub log: &'a Log,
    /// Training of its policy.
    pub start: &'a Checkpoint,
    /// Parameters that are known already, such as those of a diagnosis.
    pub given: Option<&'a [(String, f64)]>,
    /// Settings.
    pub settings: &'a LoopSettings,
}

impl Inputs<'_> {
    /// A hash of all of it (FNV-1a, 64 bits): what was kept under another is of other inputs.
    pub fn key(&self) -> String {
        let text = serde_json::to_string(self.settings).unwrap_or_default();
        let best = self.start.best.as_ref().map(|(_, actor)| actor.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
        let words = [
            env!("CARGO_PKG_VERSION").to_owned(),
            text,
            format!("{:?}", self.start.identity),
            format!("{:?} {:?} {best:?}", self.start.settings, self.given),
            format!("{:?}", self.ground.terrain),
            format!("{:?}", self.train_on.terrain),
        ];
        let bytes = words.iter().flat_map(|w| w.bytes().collect::<Vec<_>>());
        let recorded = self.log.runs.iter().flat_map(|(name, run)| recorded(name, run));
        let numbers = self.log.stretches.iter().flat_map(|s| s.states.iter().chain(&s.targets));
        let numbers = numbers.chain(&self.start.parameters).flat_map(|x| x.to_bits().to_le_bytes());
        let grounds = [self.ground, self.train_on];
        let places = grounds.into_iter().flat_map(|g| g.places.iter().flatten().flatten());
        let places = places.flat_map(|x| x.to_bits().to_le_bytes());
        let all = bytes.chain(numbers).chain(places).chain(recorded);
        let hash = all.fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
        format!("{hash:016x}")
    }
}

/// What fits read of a recording, as bytes.
fn recorded(name: &str, run: &Run) -> Vec<u8> {
    let (c, m) = (&run.commands, &run.measured);
    let all = [&c.position, &c.kp, &c.kd, &m.position, &m.velocity, &m.gyro, &m.orientation, &m.base_pose];
    let numbers = all.into_iter().flatten().flat_map(|series| series.time.iter().chain(&series.values));
    let mut bytes = format!("{name} {:?} {:?}", run.joint_names, run.faults).into_bytes();
    bytes.extend(numbers.flat_map(|x| x.to_bits().to_le_bytes()));
    bytes
}

/// Windows in which feet and ground agree.
pub(super) fn picked(
    inputs: &Inputs,
    footing: Option<&Footing>,
    length: usize,
    wanted: &dyn Fn(usize) -> bool,
) -> Vec<Window> {
    let mut all = windows(inputs.log, length, wanted);
    if let Some(footing) = footing {
        all.retain(|w| footing.contradiction(*w, length) <= inputs.settings.footing);
    }
    all
}
