//! How a recorder stamps torques beside positions and commands, found from what the laws leave at each way it may do so.

use super::{ActuatorModel, Alignment, Channels, RowInterpolation, Rows, Stamps, State, left, row_at};
use crate::parameters::Overrides;
use crate::robot::Rollout;
use crate::window::Window;
use qv_core::JointSeries;
use qv_sim::MotorCommand;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Offsets \[half ticks\] of commands and states that recorders are known to have, the natural one first.
const OFFSETS: [i64; 3] = [0, -1, 1];
/// Latencies \[s\] that are thought of beside an offset, and by what factor less they must leave than none: an offset and a latency of a tick
/// may make what another offset makes alone.
const LONGEST_LATENCY: f64 = 0.06;
const LATENCY_COSTS: f64 = 1.1;
/// Windows looked at.
const WINDOWS: usize = 12;

/// Offset of the command and of the state of a torque \[half ticks\].
type Offsets = [i64; 2];

/// The alignment, of those within a tick, that leaves the least torque unexplained in `windows`. Each joint may have a latency of its own
/// of a tick or more beside it, known or not: half a tick of that is not taken for the recorder's.
pub fn align(rollout: &Rollout, windows: &[&Window]) -> Alignment {
    let Some(first) = windows.first() else { return Alignment::default() };
    let tick = first.view.measured.position.as_ref().map_or(0.0, |p| qv_recording::median_interval(&p.time));
    let some: Vec<&Window> = windows.iter().step_by((windows.len() / WINDOWS).max(1)).copied().collect();
    let most = if tick > 0.0 { ((LONGEST_LATENCY / tick - 1.0) * 2.0).clamp(0.0, 120.0) as i64 } else { 0 };
    // In half ticks: what an alignment and a latency make together is the same number however it is divided among them.
    let latencies: Vec<i64> = std::iter::once(0).chain(2..=2 + most).collect();
    let candidates: Vec<Offsets> = OFFSETS.iter().flat_map(|&command| OFFSETS.map(|state| [command, -state])).collect();
    let with_latencies = |[command, state]: Offsets| {
        let of_command = latencies.iter().map(move |&l| [command + l, state]);
        of_command.chain(latencies.iter().map(move |&l| [command, state - l]))
    };
    let all: BTreeSet<Offsets> = candidates.iter().flat_map(|&c| with_latencies(c)).collect();
    let losses = losses(rollout, &some, all.into_iter().collect(), 0.5 * tick);
    let mut best: Option<(f64, Alignment)> = None;
    for halves in candidates {
        let mut least = vec![f64::INFINITY; rollout.law_joints.len()];
        for offsets in with_latencies(halves) {
            let cost = if offsets == halves { 1.0 } else { LATENCY_COSTS };
            least.iter_mut().zip(&losses[&offsets]).for_each(|(least, loss)| *least = least.min(cost * loss));
        }
        let loss: f64 = least.iter().filter(|x| x.is_finite()).sum();
        // The first of equals: none where there is nothing to distinguish them.
        if best.is_none_or(|(least, _)| loss < 0.98 * least) {
            let [command, state] = halves.map(|h| 0.5 * h as f64 * tick);
            best = Some((loss, Alignment { command, state }));
        }
    }
    best.map_or_else(Alignment::default, |(_, alignment)| alignment)
}

/// Sums of squares that the laws of the joints leave at each of some offsets, without latencies of their own, shape
/// `[law joints]` each.
fn losses(
    rollout: &Rollout,
    windows: &[&Window],
    offsets: Vec<Offsets>,
    half_tick: f64,
) -> BTreeMap<Offsets, Vec<f64>> {
    let of_joint = |&joint: &usize| ActuatorModel {
        latency: 0.0,
        seen_late: 0.0,
        ..ActuatorModel::new(rollout, &Overrides::new(), joint)
    };
    let laws: Vec<ActuatorModel> = rollout.law_joints.iter().map(of_joint).collect();
    let of_windows: Vec<Vec<Vec<f64>>> =
        windows.par_iter().map(|w| squares(rollout, w, &laws, &offsets, half_tick)).collect();
    let sum = |k: usize, j: usize| of_windows.iter().map(|w| w[j][k]).filter(|x| x.is_finite()).sum();
    let of_offsets = |(k, offsets)| (offsets, (0..laws.len()).map(|j| sum(k, j)).collect());
    offsets.into_iter().enumerate().map(of_offsets).collect()
}

/// Those of one window, shape `[laws][offsets]`. A row is looked for once for all joints, and read once for all offsets
/// with the same one of the command or the state.
fn squares(
    rollout: &Rollout,
    window: &Window,
    laws: &[ActuatorModel],
    offsets: &[Offsets],
    half_tick: f64,
) -> Vec<Vec<f64>> {
    let mut tables: Vec<(Stamps, Table)> = Vec::new();
    let of_law = |law: &ActuatorModel| {
        let column = rollout.columns[law.joint];
        let Some((channels, stamps)) = Channels::new(&window.view, column).zip(Stamps::new(rollout, window, law))
        else {
            return vec![f64::NAN; offsets.len()];
        };
        let at = tables.iter().position(|t| t.0 == stamps).unwrap_or_else(|| {
            let times: Vec<f64> = stamps.times(window).collect();
            tables.push((stamps, Table::new(&channels, &times, offsets, half_tick)));
            tables.len() - 1
        });
        let table = &tables[at].1;
        let asked: BTreeMap<i64, Vec<MotorCommand>> = table.asked(&channels);
        let states: BTreeMap<i64, Vec<State>> = table.states(&channels);
        let rows = Rows::new(rollout, window, law, stamps);
        let of_offsets = |[command, state]: &Offsets| {
            let read = asked[command].iter().copied().zip(states[state].iter().copied());
            left(law, &rows, read).iter().map(|x| x * x).sum()
        };
        offsets.iter().map(of_offsets).collect()
    };
    laws.iter().map(of_law).collect()
}

/// Rows of the channels at stamps less offsets, which are the same for all joints.
struct Table {
    /// By the command's offset: rows of each of its series that there is.
    commands: BTreeMap<i64, Vec<Vec<usize>>>,
    /// By the state's: places in the positions and the velocities.
    states: BTreeMap<i64, [Vec<RowInterpolation>; 2]>,
}

impl Table {
    fn new(channels: &Channels, times: &[f64], offsets: &[Offsets], half_tick: f64) -> Self {
        let at = |halves: i64| times.iter().map(move |t| t - half_tick * halves as f64);
        let rows = |halves: i64| {
            let of = |series: &JointSeries| at(halves).map(|t| row_at(series, t)).collect();
            (halves, channels.commands().into_iter().flatten().map(of).collect())
        };
        let places = |halves: i64| {
            let of = |series: &JointSeries| at(halves).map(|t| RowInterpolation::new(series, t, 0)).collect();
            (halves, [of(channels.q), of(channels.dq)])
        };
        let distinct = |k: usize| offsets.iter().map(|o| o[k]).collect::<BTreeSet<i64>>().into_iter();
        Self { commands: distinct(0).map(rows).collect(), states: distinct(1).map(places).collect() }
    }

    /// The commands of one joint by offset.
    fn asked(&self, channels: &Channels) -> BTreeMap<i64, Vec<MotorCommand>> {
        let stamps = self.states.values().next().map_or(0, |places| places[0].len());
        let of = |(&halves, rows): (&i64, &Vec<Vec<usize>>)| {
            let at = |i: usize| {
                let mut rows = rows.iter();
                channels.asked_in(|_| rows.next().map_or(0, |r| r[i]))
            };
            (halves, (0..stamps).map(at).collect())
        };
        self.commands.iter().map(of).collect()
    }

    /// The states of one joint by offset.
    fn states(&self, channels: &Channels) -> BTreeMap<i64, Vec<State>> {
        let of = |(&halves, [q, dq]): (&i64, &[Vec<RowInterpolation>; 2])| {
            let state = |(q, dq): (&RowInterpolation, &RowInterpolation)| State {
                q: q.of(channels.q, channels.column),
                dq: dq.of(channels.dq, channels.column),
            };
            (halves, q.iter().zip(dq).map(state).collect())
        };
        self.states.iter().map(of).collect()
    }
}
