//! What a play says about a gait, in numbers.

use qv_policy::gait::Gait;
use qv_policy::play::WalkTrace;
use qv_policy::velocity::Noise;

/// One swing of a foot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// How long it lasted \[s\].
    pub time: f32,
    /// Highest point of the foot's lowest point over the ground \[m\].
    pub height: f32,
}

/// One foot under commands to move.
#[derive(Debug, Clone, Default)]
pub struct Foot {
    /// Whole swings. A single decision without force is a bounce and no swing.
    pub swings: Vec<Swing>,
    /// Greatest force of the ground, upwards \[N\].
    pub force: f32,
}

/// One joint.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Joint {
    /// Mean size of its torque \[N m\].
    pub mean: f32,
    /// Size that 99 % of its torques stay below \[N m\].
    pub high: f32,
    /// Its limit \[N m\], where known.
    pub limit: Option<f32>,
    /// Root mean square of the change of torque per second \[N m/s\].
    pub change: f32,
}

/// A stretch of time under one command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Its beginning \[s\].
    pub from: f32,
    /// Its end \[s\].
    pub to: f32,
    /// The command: forwards, to the left \[m/s\], turning \[rad/s\].
    pub command: [f32; 3],
    /// Means of what was done, without the first second; `None` where it lasted no longer.
    pub done: Option<[f32; 3]>,
    /// Mean size of the error of velocity \[m/s\] and of turning \[rad/s\], over the same time.
    pub error: Option<[f32; 2]>,
}

/// All of it.
#[derive(Debug, Clone, Default)]
pub struct Measures {
    /// One for each foot.
    pub feet: Vec<Foot>,
    /// One for each joint.
    pub joints: Vec<Joint>,
    /// In order.
    pub stretches: Vec<Stretch>,
    /// Sum of the errors as a share of what they were if the robot stood still; `None` where nothing was commanded.
    pub off: Option<f32>,
    /// How it walks and stands in this play.
    pub gait: Gait,
    /// Share of joint targets that zigzag, see [`zigzag`].
    pub zigzag: f32,
}

impl Measures {
    pub fn new(played: &WalkTrace) -> Self {
        let stretches = stretches(played);
        Self {
            feet: (0..played.feet.len()).map(|foot| of_foot(played, foot)).collect(),
            joints: (0..played.joints.len()).map(|joint| of_joint(played, joint)).collect(),
            off: off(&stretches),
            stretches,
            gait: played.gait(),
            zigzag: zigzag(played),
        }
    }

    /// Whether every foot swings.
    pub fn walks(&self) -> bool {
        !self.feet.is_empty() && self.feet.iter().all(|foot| !foot.swings.is_empty())
    }

    /// All swings of all feet.
    pub fn swings(&self) -> impl Iterator<Item = &Swing> {
        self.feet.iter().flat_map(|foot| &foot.swings)
    }
}

/// Mean; `None` of nothing.
pub fn mean(values: impl Iterator<Item = f32>) -> Option<f32> {
    let (sum, count) = values.fold((0.0f64, 0usize), |(sum, count), x| (sum + f64::from(x), count + 1));
    (count > 0).then(|| (sum / count as f64) as f32)
}

/// Least and greatest; `None` of nothing.
pub fn ends(values: impl Iterator<Item = f32>) -> Option<[f32; 2]> {
    values.fold(None, |ends: Option<[f32; 2]>, x| Some(ends.map_or([x, x], |[low, high]| [low.min(x), high.max(x)])))
}

fn of_foot(played: &WalkTrace, foot: usize) -> Foot {
    let on = |step: usize| played.foot_forces[step][foot] > 0.0;
    let moves = |step: usize| played.commands[step] != [0.0; 3];
    let (mut swings, mut since) = (Vec::new(), None);
    for step in 1..played.foot_forces.len() {
        match (on(step - 1), on(step), since) {
            (true, false, _) if moves(step) => since = Some(step),
            (false, true, Some(from)) if step - from == 1 => since = None,
            (false, true, Some(from)) => {
                let height = (from..step).map(|k| played.foot_heights[k][foot]).fold(0.0, f32::max);
                swings.push(Swing { time: (step - from) as f32 / played.rate, height });
                since = None;
            }
            _ => {}
        }
    }
    let force = played.foot_forces.iter().map(|f| f[foot]).fold(0.0, f32::max);
    Foot { swings, force }
}

fn of_joint(played: &WalkTrace, joint: usize) -> Joint {
    let torque: Vec<f32> = played.torques.iter().map(|t| t[joint]).collect();
    let mut sizes: Vec<f32> = torque.iter().map(|t| t.abs()).collect();
    sizes.sort_by(f32::total_cmp);
    let high = sizes.get((0.99 * sizes.len() as f32) as usize).or(sizes.last());
    Joint {
        mean: mean(sizes.iter().copied()).unwrap_or(0.0),
        high: high.copied().unwrap_or(0.0),
        limit: played.efforts.get(joint).copied().flatten(),
        change: mean(torque.windows(2).map(|w| ((w[1] - w[0]) * played.rate).powi(2))).unwrap_or(0.0).sqrt(),
    }
}

fn stretches(played: &WalkTrace) -> Vec<Stretch> {
    let (mut out, mut begin) = (Vec::new(), 0);
    for chunk in played.commands.chunk_by(|a, b| a == b) {
        let (from, end, command) = (begin, begin + chunk.len(), chunk[0]);
        let settled = (from + played.rate as usize).min(end)..end;
        let all = |k: usize| {
            let one = |step: usize| if k < 2 { played.velocity[step][k] } else { played.turning[step][2] };
            mean(settled.clone().map(one))
        };
        let velocity = |step: usize| {
            let [vx, vy, _] = played.velocity[step];
            (vx - command[0]).hypot(vy - command[1])
        };
        let turning = |step: usize| (played.turning[step][2] - command[2]).abs();
        let done = all(0).zip(all(1)).zip(all(2)).map(|((x, y), w)| [x, y, w]);
        let error = mean(settled.clone().map(velocity)).zip(mean(settled.clone().map(turning)));
        let [from, to] = [from, end].map(|step| step as f32 / played.rate);
        out.push(Stretch { from, to, command, done, error: error.map(|(v, w)| [v, w]) });
        begin = end;
    }
    out
}

/// Errors beside those of a robot that stands still, which are the commands; a turning rate in rad/s counts as a speed in m/s, as in
/// `Score::cost`.
fn off(stretches: &[Stretch]) -> Option<f32> {
    let known = stretches.iter().filter_map(|s| {
        let time = s.to - s.from;
        let [vx, vy, wz] = s.command;
        s.error.map(|[v, w]| (time * (v + w), time * (vx.hypot(vy) + wz.abs())))
    });
    let (error, asked) = known.fold((0.0, 0.0), |(a, b), (x, y)| (a + x, b + y));
    (asked > 0.0).then(|| error / asked)
}

/// Share of joint targets that turned back three times in a row, by more than the encoders' noise of training each time. Independent
/// random targets give 10/24 (alternating permutations of four), a smooth gait gives none.
fn zigzag(played: &WalkTrace) -> f32 {
    let noise = Noise::default().position;
    let turns = |w: &[Vec<f32>], j: usize| {
        let step = |k: usize| w[k + 1][j] - w[k][j];
        let large = (0..3).all(|k| step(k).abs() > noise);
        large && step(0) * step(1) < 0.0 && step(1) * step(2) < 0.0
    };
    let all = played.targets.windows(4).flat_map(|w| (0..w[0].len()).map(move |j| f32::from(u8::from(turns(w, j)))));
    mean(all).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::walk::example::made_up;

    #[test]
    fn a_known_gait_has_the_known_numbers() {
        let measures = Measures::new(&made_up(500));
        for foot in &measures.feet {
            assert!(foot.swings.len() >= 18 && foot.swings.iter().all(|s| (s.time - 0.24).abs() < 1e-4));
            assert!(foot.swings.iter().all(|s| (s.height - 0.05).abs() < 1e-3));
            assert_eq!(foot.force, 75.0);
        }
        assert!(measures.gait.feet.iter().all(|foot| (foot.duty - 0.52).abs() < 0.02));
        let stretch = measures.stretches[0];
        assert!((measures.stretches.len() == 1) && (stretch.to - 10.0).abs() < 1e-4);
        let [v, w] = stretch.error.unwrap();
        assert!((v - 0.02f32.hypot(0.01)).abs() < 1e-4 && (w - 0.02).abs() < 1e-4);
        let joint = measures.joints[0];
        assert!((joint.high - 5.0).abs() < 0.05 && joint.limit == Some(23.7));
        // Amplitude x angular frequency / sqrt 2, a little less as a difference over 0.02 s.
        assert!((joint.change / (5.0 * 4.0 * std::f32::consts::PI / 2f32.sqrt()) - 1.0).abs() < 0.02);
        assert_eq!((measures.zigzag, measures.gait.stand), (0.0, None));
    }

    #[test]
    fn targets_that_shake_are_seen_and_nothing_is_no_number() {
        let mut played = made_up(100);
        played.targets.iter_mut().enumerate().for_each(|(k, t)| t.fill(if k % 2 == 0 { 0.1 } else { -0.1 }));
        assert_eq!(Measures::new(&played).zigzag, 1.0);
        let empty = Measures::new(&made_up(0));
        assert!(empty.off.is_none() && empty.gait.power.is_none() && empty.swings().next().is_none());
        assert!(empty.gait.feet.is_empty() && empty.joints.iter().all(|j| j.high == 0.0));
    }
}
