//! How far a robot strays from the path that its commands describe.

use crate::ResidualError;
use crate::windows::yaw_of;
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::env::{End, VectorEnv};
use qv_policy::score::Decide;
use qv_policy::velocity::{Commands, VelocityTask};
use serde::{Deserialize, Serialize};

/// Kinds of command, as shares of the greatest that the policy was trained under: forwards, to the left, turning to the left.
pub const KINDS: [(&str, [f32; 3]); 6] = [
    ("slowly ahead", [0.5, 0.0, 0.0]),
    ("fast ahead", [0.9, 0.0, 0.0]),
    ("backwards", [-0.8, 0.0, 0.0]),
    ("to the left, ahead", [0.4, 0.7, 0.0]),
    ("a bend to the right", [0.6, 0.0, -0.6]),
    ("a bend to the left", [0.6, 0.0, 0.6]),
];

/// Commands of `count` walks, all kinds in turn, each varied by up to a fifth.
pub fn commands(ranges: &Commands, count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut random = Xoshiro256PlusPlus::of(seed, 41, 0);
    let of =
        |share: f32, [low, high]: [f32; 2]| if share < 0.0 { -share * low.min(0.0) } else { share * high.max(0.0) };
    (0..count)
        .map(|k| {
            let [x, y, turn] = KINDS[k % KINDS.len()].1;
            let varied = random.between(0.8, 1.1);
            [of(x, ranges.vx) * varied, of(y, ranges.vy) * varied, of(turn, ranges.wz) * varied]
        })
        .collect()
}

/// Commands of `count` walks, drawn uniformly from `ranges`: forwards, to the left \[m/s\], turning to the left \[rad/s\].
pub fn uniform(ranges: &Commands, count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut random = Xoshiro256PlusPlus::of(seed, 61, 0);
    let mut drawn = || [ranges.vx, ranges.vy, ranges.wz].map(|[low, high]| random.between(low, high));
    (0..count).map(|_| drawn()).collect()
}

/// Place after `time` \[s\] under a command from the origin: x, y \[m\] and heading \[rad\].
pub fn place([x, y, turn]: [f32; 3], time: f32) -> [f32; 3] {
    let angle = turn * time;
    // The mean direction of a velocity that turns: sin(a)/a and (1 - cos(a))/a.
    let (s, c) =
        if angle.abs() < 1e-4 { (1.0, 0.5 * angle) } else { (angle.sin() / angle, (1.0 - angle.cos()) / angle) };
    [time * (s * x - c * y), time * (c * x + s * y), angle]
}

/// How long a robot walks under a command before its path counts \[s\]: to get going from a stand takes every robot half a second, the one
/// that its simulator describes rightly, too.
pub const SETTLING: f32 = 1.0;
/// Length of the walks of a score \[s\].
pub const SECONDS: f32 = 8.0;

/// A path: x, y \[m\] and heading \[rad\] at each decision, from the place and heading at the start.
pub type Path = Vec<[f32; 3]>;

/// What a path says of a robot under a command.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct PathError {
    /// Mean distance from the commanded path over time \[m\].
    pub position: f32,
    /// Mean size of the heading's error \[rad\].
    pub heading: f32,
    /// Whether the robot fell; it then counts as one that stays where it fell.
    pub fell: bool,
}

/// Errors of a path that ought to last `decisions`.
pub fn error(path: &Path, command: [f32; 3], decisions: usize, rate: f32) -> PathError {
    let last = path.last().copied().unwrap_or_default();
    let (mut position, mut heading) = (0.0, 0.0);
    for k in 0..decisions {
        let [x, y, turn] = path.get(k).copied().unwrap_or(last);
        let [wanted_x, wanted_y, wanted] = place(command, (k + 1) as f32 / rate);
        position += (x - wanted_x).hypot(y - wanted_y);
        let off = turn - wanted;
        heading += off.sin().atan2(off.cos()).abs();
    }
    let count = decisions.max(1) as f32;
    PathError { position: position / count, heading: heading / count, fell: path.len() < decisions }
}

/// Turns a pose in the world into one from a start: x, y and heading.
pub fn from_start(start: &[f32], now: &[f32]) -> [f32; 3] {
    let yaw = yaw_of(&start[3..7]);
    let (c, s) = (yaw.cos(), yaw.sin());
    let [x, y] = [now[0] - start[0], now[1] - start[1]];
    let turn = yaw_of(&now[3..7]) - yaw;
    [c * x + s * y, c * y - s * x, turn.sin().atan2(turn.cos())]
}

/// Means over walks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct PathScore {
    /// Walks.
    pub walks: usize,
    /// Mean distance from the commanded path \[m\].
    pub position: f32,
    /// Its standard error over walks.
    pub position_se: f32,
    /// Mean size of the heading's error \[rad\].
    pub heading: f32,
    /// Walks that ended in a fall.
    pub fell: usize,
}

impl PathScore {
    /// One number to choose by, less is better: the distance, and one metre for each walk in a hundred that fell.
    pub fn cost(&self) -> f32 {
        self.position + 100.0 * self.fell as f32 / self.walks.max(1) as f32
    }

    /// By how many standard errors more walks of `self` fell than of `other`: the difference of two shares over its error, both being one share.
    fn falls_more(&self, other: &Self) -> f32 {
        let [own, others] = [self, other].map(|s| s.walks.max(1) as f32);
        let both = (self.fell + other.fell) as f32 / (own + others);
        let error = (both * (1.0 - both) * (1.0 / own + 1.0 / others)).sqrt();
        if error > 0.0 { (self.fell as f32 / own - other.fell as f32 / others) / error } else { 0.0 }
    }

    /// Whether these walks are better than `other` ones by `errors` standard errors: fewer fell, or as far as can be reported as many did, and they
    /// lie nearer to the commanded path. A single fall of a hundred is chance, and decides nothing.
    pub fn is_better(&self, other: &Self, errors: f32) -> bool {
        let more = self.falls_more(other);
        let noise = errors * self.position_se.hypot(other.position_se);
        // Of no errors nothing is chance.
        let limit = errors.max(1.96);
        more < -limit || (more < limit && other.position - self.position > noise)
    }

    /// Of some walks.
    pub fn of(errors: &[PathError]) -> Self {
        let count = errors.len().max(1) as f32;
        let mean = |of: &dyn Fn(&PathError) -> f32| errors.iter().map(of).sum::<f32>() / count;
        let position = mean(&|e| e.position);
        let variance = errors.iter().map(|e| (e.position - position).powi(2)).sum::<f32>() / (count - 1.0).max(1.0);
        Self {
            walks: errors.len(),
            position,
            position_se: (variance / count).sqrt(),
            heading: mean(&|e| e.heading),
            fell: errors.iter().filter(|e| e.fell).count(),
        }
    }
}

/// The path after the first `settling` decisions, from where the robot is then; empty when it fell before.
pub fn settled(path: &[[f32; 3]], settling: usize) -> Path {
    let Some((&start, rest)) = path.get(settling.saturating_sub(1)..).and_then(<[_]>::split_first) else {
        return Path::new();
    };
    let [x0, y0, heading] = start;
    let (s, c) = heading.sin_cos();
    let from = |&[x, y, h]: &[f32; 3]| {
        let [x, y, h] = [x - x0, y - y0, h - heading];
        [c * x + s * y, c * y - s * x, h.sin().atan2(h.cos())]
    };
    rest.iter().map(from).collect()
}

/// The path of a walk beyond [`SETTLING`], which ought to last `seconds` from there, and its error.
pub fn measured(path: &[[f32; 3]], command: [f32; 3], seconds: f32, rate: f32) -> (Path, PathError) {
    let path = settled(path, (SETTLING * rate) as usize);
    let error = error(&path, command, (seconds * rate) as usize, rate);
    (path, error)
}

/// Runs every robot of a task under its command for `seconds` beyond [`SETTLING`]; paths from there and their errors.
///
/// # Errors
/// When a number is not finite or the simulator refuses something.
pub fn walk(
    mut policy: impl Decide,
    task: &mut VelocityTask,
    commands: &[[f32; 3]],
    seconds: f32,
    seed: u64,
) -> Result<Vec<(Path, PathError)>, ResidualError> {
    task.judged = true;
    task.restart(seed, 0)?;
    let (count, joints) = (task.count(), task.actions());
    if commands.len() != count {
        return Err(ResidualError::input("walks", format!("{count} commands"), commands.len()));
    }
    commands.iter().enumerate().for_each(|(env, command)| task.command(env, *command));
    let rate = task.settings().rate;
    let (steps, settling) = ((seconds * rate) as usize, (SETTLING * rate) as usize);
    let width = 7 + joints;
    let starts = task.motion().0.to_vec();
    let mut seen = (vec![0.0; count * task.observations()], vec![0.0; count * task.privileged()]);
    let (mut actions, mut rewards, mut ends) = (vec![0.0; count * joints], vec![0.0; count], vec![End::No; count]);
    let (mut paths, mut fallen) = (vec![Path::new(); count], vec![false; count]);
    for _ in 0..settling + steps {
        task.observe(&mut seen.0, &mut seen.1);
        policy.decide(count, &seen.0, &mut actions)?;
        fallen.iter().enumerate().filter(|(_, f)| **f).for_each(|(env, _)| actions[env * joints..][..joints].fill(0.0));
        task.step(&actions, &mut rewards, &mut ends)?;
        let q = task.motion().0;
        for env in 0..count {
            fallen[env] |= ends[env] == End::Failed;
            if !fallen[env] {
                paths[env].push(from_start(&starts[env * width..], &q[env * width..]));
            }
        }
    }
    Ok(paths.into_iter().zip(commands).map(|(path, &c)| measured(&path, c, seconds, rate)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_fall_is_chance_and_many_are_not() {
        let of = |position: f32, fell: usize| PathScore { position, position_se: 0.02, heading: 0.0, fell, walks: 96 };
        assert!(of(0.2, 1).is_better(&of(0.38, 0), 2.0), "one fall of 96 is chance");
        assert!(!of(0.2, 6).is_better(&of(0.38, 0), 2.0), "six are not");
        assert!(of(0.4, 0).is_better(&of(0.38, 6), 2.0), "falling less counts more than a path");
        assert!(!of(0.35, 0).is_better(&of(0.38, 0), 2.0) && of(0.35, 0).is_better(&of(0.38, 0), 0.0), "within noise");
    }

    #[test]
    fn a_path_on_command_has_no_error_and_one_that_stays_has_its_distance() {
        let command = [0.5, 0.1, 0.7];
        let path: Path = (1..=400).map(|k| place(command, k as f32 * 0.02)).collect();
        let found = error(&path, command, 400, 50.0);
        assert!(found.position < 1e-5 && found.heading < 1e-5 && !found.fell, "{found:?}");
        // Small steps of a velocity that turns give the same place.
        let (mut x, mut y) = (0.0f64, 0.0f64);
        for k in 0..80_000 {
            let angle = 0.7 * (f64::from(k) + 0.5) * 1e-4;
            x += 1e-4 * (0.5 * angle.cos() - 0.1 * angle.sin());
            y += 1e-4 * (0.5 * angle.sin() + 0.1 * angle.cos());
        }
        let [ex, ey, _] = place(command, 8.0);
        assert!((x - f64::from(ex)).abs() < 1e-4 && (y - f64::from(ey)).abs() < 1e-4, "{x} {y} {ex} {ey}");
        // From any moment on, the path of a command is the same.
        let later = settled(&path, 50);
        let found = error(&later, command, 350, 50.0);
        assert!(later.len() == 350 && found.position < 1e-5 && found.heading < 1e-5 && !found.fell, "{found:?}");
        assert!(settled(&path[..20], 50).is_empty());
        let found = error(&vec![[0.0; 3]], [0.5, 0.0, 0.0], 400, 50.0);
        assert!(found.fell && (found.position - 2.005).abs() < 1e-3, "{found:?}");
    }
}
