//! The law of position-controlled motors, fitted to recorded torques: `tau = a kp (u c - q + d) + b kd (dc - v) + tau_ff`.
//!
//! Where torques were recorded, the law says far more of the commands than the motion does: a joint follows its command by degrees of its
//! load, but its torque is its gain times their difference, at once.

use super::samples::Samples;

/// Share of the samples that may contradict the law, as those at a limit do.
const TRIMMED: f64 = 0.1;

/// Share of the torque's variance up to which the law is used.
pub(super) const USED: f64 = 0.3;
/// What is left of torques that are all noise counts as so much.
const NOISE: f64 = 0.2;

/// Whose commands, positions and torques are put into one law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pairing {
    pub command: usize,
    pub position: usize,
    pub torque: usize,
    /// Factor on the command.
    pub unit: f64,
}

impl Pairing {
    pub fn own(joint: usize) -> Self {
        Self { command: joint, position: joint, torque: joint, unit: 1.0 }
    }
}

/// The law as it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Law {
    /// Factor on the position gain, and on the damping; where no damping was logged, the damping itself \[N m s/rad\].
    pub stiffness: f64,
    pub damping: f64,
    /// Offset of the command \[rad\], and its standard error over blocks.
    pub offset: f64,
    pub offset_error: f64,
    /// Offset with the stiffness that is stated \[rad\]: a latency weakens the fitted one, and an offset makes up for it.
    pub stated_offset: f64,
    /// Share of the torque's variance that is left.
    pub left: f64,
}

/// An offset of this size counts as much as this share of the variance \[rad, 1\].
const OFFSET: [f64; 2] = [0.2, 0.1];

impl Law {
    /// What a reading costs: what it leaves, and an offset that another reading may do without.
    pub fn cost(&self) -> f64 {
        self.left + OFFSET[1] * (self.offset.abs() / OFFSET[0]).min(2.0)
    }
}

/// Normal equations of at most four regressors.
#[derive(Clone, Copy, Default)]
struct Normal {
    a: [[f64; 4]; 4],
    b: [f64; 4],
}

impl Normal {
    fn add(&mut self, x: [f64; 4], y: f64) {
        for i in 0..4 {
            for j in 0..4 {
                self.a[i][j] += x[i] * x[j];
            }
            self.b[i] += x[i] * y;
        }
    }

    /// Elimination with pivots; regressors that are zero or a combination of others get the coefficient 0.
    fn solve(mut self) -> [f64; 4] {
        let scale: [f64; 4] = std::array::from_fn(|i| self.a[i][i]);
        let mut is_used = [false; 4];
        for _ in 0..4 {
            let rest = (0..4).filter(|&i| !is_used[i] && self.a[i][i] > 1e-9 * scale[i]);
            let Some(p) = rest.max_by(|&i, &j| (self.a[i][i] / scale[i]).total_cmp(&(self.a[j][j] / scale[j]))) else {
                break;
            };
            is_used[p] = true;
            for i in (0..4).filter(|&i| i != p) {
                let factor = self.a[i][p] / self.a[p][p];
                (0..4).for_each(|j| self.a[i][j] -= factor * self.a[p][j]);
                self.b[i] -= factor * self.b[p];
            }
        }
        std::array::from_fn(|i| if is_used[i] { self.b[i] / self.a[i][i] } else { 0.0 })
    }
}

/// One row of the law: regressors (error times gain, damping, gain) and torque less feed-forward; `None` where a value is missing.
fn row(s: &Samples, commands: &[f64], pairing: Pairing, forward: f64, i: usize) -> Option<([f64; 3], f64)> {
    let at = |joint: usize| i * s.joints + joint;
    let (command, position) = (commands[at(pairing.command)], s.position[at(pairing.position)]);
    let (kp, kd) = (s.kp[at(pairing.command)], s.kd[at(pairing.command)]);
    let speed = s.velocity[at(pairing.position)] * if kd > 0.0 { kd } else { 1.0 };
    let torque = s.torque[at(pairing.torque)] - forward * s.forward[at(pairing.command)];
    let x = [kp * (pairing.unit * command - position), speed, kp];
    (x.iter().all(|x| x.is_finite()) && torque.is_finite()).then_some((x, torque))
}

fn coefficients(rows: impl Iterator<Item = ([f64; 3], f64)>) -> [f64; 4] {
    let mut normal = Normal::default();
    rows.for_each(|(x, y)| normal.add([x[0], x[1], x[2], 0.0], y));
    normal.solve()
}

fn miss(c: &[f64; 4], x: &[f64; 3], y: f64) -> f64 {
    y - c[0] * x[0] - c[1] * x[1] - c[2] * x[2]
}

/// Fits the law, twice: the second time without the samples that contradict it most. `None` where torques do not vary.
pub(super) fn fit(s: &Samples, commands: &[f64], pairing: Pairing, forward: f64) -> Option<Law> {
    let rows: Vec<([f64; 3], f64)> = (0..s.time.len()).filter_map(|i| row(s, commands, pairing, forward, i)).collect();
    if rows.len() < 100 {
        return None;
    }
    let first = coefficients(rows.iter().copied());
    let mut misses: Vec<f64> = rows.iter().map(|(x, y)| miss(&first, x, *y).abs()).collect();
    let keep = ((1.0 - TRIMMED) * rows.len() as f64) as usize;
    let limit = *misses.select_nth_unstable_by(keep, f64::total_cmp).1;
    let near: Vec<([f64; 3], f64)> = rows.iter().copied().filter(|(x, y)| miss(&first, x, *y).abs() <= limit).collect();
    let c = coefficients(near.iter().copied());
    let mean = near.iter().map(|(_, y)| y).sum::<f64>() / near.len() as f64;
    let all: f64 = near.iter().map(|(_, y)| (y - mean).powi(2)).sum();
    let left: f64 = near.iter().map(|(x, y)| miss(&c, x, *y).powi(2)).sum();
    let offset_error = spread_of_offset(&near, &c);
    let offset = c[2] / c[0];
    let stated_offset = if s.states_gains { mean_offset(&near, 1.0, c[1]) } else { offset };
    (all > 1e-6 * near.len() as f64).then(|| Law {
        stiffness: c[0],
        damping: c[1],
        offset,
        offset_error,
        stated_offset,
        left: left / all,
    })
}

/// As [`fit`]; where torques are too small to fit a law, what the law of other joints leaves of them: its `stiffness` and `damping` are `usual`.
pub(super) fn judge(
    s: &Samples,
    commands: &[f64],
    pairing: Pairing,
    forward: f64,
    usual: Option<[f64; 2]>,
) -> Option<Law> {
    let free = fit(s, commands, pairing, forward)?;
    let Some([stiffness, damping]) = usual.filter(|_| free.left >= USED) else { return Some(free) };
    let rows: Vec<([f64; 3], f64)> = (0..s.time.len()).filter_map(|i| row(s, commands, pairing, forward, i)).collect();
    let n = rows.len() as f64;
    let offset = mean_offset(&rows, stiffness, damping);
    let c = [stiffness, damping, offset * stiffness, 0.0];
    let mean = rows.iter().map(|(_, y)| y).sum::<f64>() / n;
    let all: f64 = rows.iter().map(|(_, y)| (y - mean).powi(2)).sum();
    let left: f64 = rows.iter().map(|(x, y)| miss(&c, x, *y).powi(2)).sum();
    let offset_error = spread_of_offset(&rows, &c);
    // Torques that are all noise leave all of it.
    Some(Law { stiffness, damping, offset, offset_error, stated_offset: offset, left: NOISE * left / all })
}

/// Mean offset of the command with a stiffness and a damping \[rad\].
fn mean_offset(rows: &[([f64; 3], f64)], stiffness: f64, damping: f64) -> f64 {
    let without = [stiffness, damping, 0.0, 0.0];
    rows.iter().map(|(x, y)| miss(&without, x, *y) / (x[2] * stiffness)).sum::<f64>() / rows.len() as f64
}

/// Standard error of the offset, by what is left in eighths of the recording.
fn spread_of_offset(rows: &[([f64; 3], f64)], c: &[f64; 4]) -> f64 {
    let of_block = |block: &[([f64; 3], f64)]| {
        let sum: f64 = block.iter().map(|(x, y)| miss(c, x, *y) / (x[2] * c[0])).sum();
        sum / block.len() as f64
    };
    let blocks: Vec<f64> = rows.chunks(rows.len().div_ceil(8).max(1)).map(of_block).collect();
    let n = blocks.len() as f64;
    (blocks.iter().map(|x| x * x).sum::<f64>() / (n * (n - 1.0).max(1.0))).sqrt()
}

/// Factor on the command at which the law fits best, whatever it is: the command and the position in one fit each.
pub(super) fn free_unit(s: &Samples, commands: &[f64], joint: usize) -> Option<f64> {
    let mut normal = Normal::default();
    for i in 0..s.time.len() {
        let Some((x, y)) = row(s, commands, Pairing { unit: 0.0, ..Pairing::own(joint) }, 1.0, i) else { continue };
        normal.add([x[2] * commands[i * s.joints + joint], x[0], x[1], x[2]], y);
    }
    let [command, position, ..] = normal.solve();
    Some(command / position).filter(|u| u.is_finite() && *u != 0.0)
}
