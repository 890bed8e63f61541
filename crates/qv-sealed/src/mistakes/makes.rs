//! The twelve mistakes, each at three sizes, and what must be reported first of each.

use super::robots::{Firmware, Motors, RobotKind, record};
use qv_core::JointSeries;
use qv_core::random::SplitMix64;
use qv_recording::Run;
use qv_sim::SimError;

/// A mistake in the command channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Mistake {
    JointsExchanged,
    LegsExchanged,
    SignTurned,
    OffsetOfOne,
    OffsetOfGroup,
    Degrees,
    GainsPerDegree,
    GainsOfTenth,
    DampingLoggedAsZero,
    StampsLate,
    ShapedByFirmware,
    TorqueUnit,
}

/// All of them.
pub const MISTAKES: [Mistake; 12] = [
    Mistake::JointsExchanged,
    Mistake::LegsExchanged,
    Mistake::SignTurned,
    Mistake::OffsetOfOne,
    Mistake::OffsetOfGroup,
    Mistake::Degrees,
    Mistake::GainsPerDegree,
    Mistake::GainsOfTenth,
    Mistake::DampingLoggedAsZero,
    Mistake::StampsLate,
    Mistake::ShapedByFirmware,
    Mistake::TorqueUnit,
];

/// Sizes of each.
pub const SIZES: usize = 3;

/// A recording with a mistake, and what the first report of it must state.
#[derive(Debug, Clone, PartialEq)]
pub struct MistakenRun {
    /// The recording.
    pub run: Run,
    /// Words of the first report.
    pub words: &'static str,
    /// Joints that must be reported with these words, and no others; none where it is all of them at once.
    pub joints: Vec<String>,
}

impl MistakenRun {
    /// Whether what was `reported` (channel and detail, first to last) names the mistake first, at the right joints.
    pub fn is_named_by(&self, reported: &[(String, String)]) -> bool {
        let Some(first) = reported.first().filter(|(_, detail)| detail.contains(self.words)) else { return false };
        let with_words = reported.iter().filter(|(_, detail)| detail.contains(self.words));
        let mut found: Vec<&str> = with_words.filter_map(|(channel, _)| channel.strip_prefix("commands ")).collect();
        let mut wanted: Vec<&str> = self.joints.iter().map(String::as_str).collect();
        found.sort_unstable();
        wanted.sort_unstable();
        found == wanted && (self.joints.is_empty() || first.0.starts_with("commands "))
    }
}

fn columns(series: &mut Option<JointSeries>, change: &mut dyn FnMut(&mut [f64])) {
    if let Some(series) = series {
        series.values.chunks_exact_mut(series.joints).for_each(&mut *change);
    }
}

/// Records `kind` with `mistake` at a size of 0, 1 or 2.
///
/// # Errors
/// The simulation cannot be made.
pub fn plant(kind: RobotKind, mistake: Mistake, size: usize, seed: u64) -> Result<MistakenRun, SimError> {
    let mut draws = SplitMix64::of(seed, 77);
    let of = |three: [f64; SIZES]| three[size];
    // A latency undoes late stamps.
    let plain = Motors { has_causes: false, ..Motors::default() };
    let motors = match mistake {
        Mistake::DampingLoggedAsZero => Motors { damping: of([0.5, 1.0, 2.0]), ..plain },
        Mistake::ShapedByFirmware => {
            let firmware = [Firmware::LowPass(0.02), Firmware::LowPass(0.04), Firmware::RateLimit(0.8)][size];
            Motors { firmware, ..plain }
        }
        _ => plain,
    };
    let mut run = record(kind, motors, seed)?;
    let count = run.joint_names.len();
    let (commands, words) = (&mut run.commands, words(mistake));
    let mut joints = Vec::new();
    match mistake {
        Mistake::JointsExchanged => {
            let a = draws.index(count);
            // Of a trotting robot diagonal legs are commanded alike.
            let other = (a + 1 + size) % count;
            joints.extend([a, other]);
            columns(&mut commands.position, &mut |row| row.swap(a, other));
        }
        Mistake::LegsExchanged => {
            let legs = kind.legs();
            joints.extend(legs.iter().flatten());
            columns(&mut commands.position, &mut |row| legs.iter().for_each(|[a, b]| row.swap(*a, *b)));
        }
        Mistake::SignTurned => {
            let first = draws.index(count);
            joints.extend((0..=size).map(|k| (first + k) % count));
            columns(&mut commands.position, &mut |row| joints.iter().for_each(|j| row[*j] = -row[*j]));
        }
        Mistake::OffsetOfOne | Mistake::OffsetOfGroup => {
            joints = if mistake == Mistake::OffsetOfOne { vec![draws.index(count)] } else { kind.group() };
            let by = of([0.06, 0.1, 0.2]) * draws.sign();
            columns(&mut commands.position, &mut |row| joints.iter().for_each(|j| row[*j] += by));
        }
        Mistake::Degrees => {
            joints = (0..[1, count / 2, count][size]).collect();
            columns(&mut commands.position, &mut |row| joints.iter().for_each(|j| row[*j] = row[*j].to_degrees()));
        }
        Mistake::GainsPerDegree | Mistake::GainsOfTenth => {
            let by = if mistake == Mistake::GainsOfTenth { 0.1 } else { std::f64::consts::PI / 180.0 };
            columns(&mut commands.kp, &mut |row| row.iter_mut().for_each(|x| *x *= by));
            // Both, the position gain alone, both a little off.
            let both = size != 1;
            columns(&mut commands.kd, &mut |row| row.iter_mut().for_each(|x| *x *= if both { by } else { 1.0 }));
        }
        Mistake::DampingLoggedAsZero => columns(&mut commands.kd, &mut |row| row.fill(0.0)),
        Mistake::StampsLate => {
            let by = of([0.01, 0.015, 0.03]);
            for series in [&mut commands.position, &mut commands.kp, &mut commands.kd].into_iter().flatten() {
                series.time.iter_mut().for_each(|t| *t += by);
            }
        }
        Mistake::ShapedByFirmware => {}
        Mistake::TorqueUnit => {
            let by = of([1.0 / 0.63, 2.5, 4.0]);
            columns(&mut run.measured.torque, &mut |row| row.iter_mut().for_each(|x| *x *= by));
        }
    }
    let joints = joints.into_iter().map(|j| run.joint_names[j].clone()).collect();
    Ok(MistakenRun { run, words, joints })
}

fn words(mistake: Mistake) -> &'static str {
    match mistake {
        Mistake::JointsExchanged | Mistake::LegsExchanged => "follows the commands of",
        Mistake::SignTurned => "the sign is turned",
        Mistake::OffsetOfOne | Mistake::OffsetOfGroup => "off by a constant",
        Mistake::Degrees => ": degrees",
        Mistake::GainsPerDegree => "57.296 times the kp",
        Mistake::GainsOfTenth => "10 times the kp",
        Mistake::DampingLoggedAsZero => "kd was logged as 0",
        Mistake::StampsLate => "the stamps are late",
        Mistake::ShapedByFirmware => "shaped by firmware",
        Mistake::TorqueUnit => "torques of all joints are",
    }
}
