//! Where the gap lies: its shares by joint, leg, phase, time and place, and by interface.

use crate::GapError;
use crate::inference::linear_scores::{by_effect, of_replicates};
use crate::inference::linearised::{LinearisedProblem, LinearisedWindow};
use crate::inference::regions::REACH;
use crate::inference::regions::never_left;
use crate::inference::regions::place;
use crate::inference::search::{Search, fitted};
use crate::inference::short_windows::feet;
use crate::problem::columns::{Extent, Suspect};
use crate::problem::library::Interface;
use crate::report::{JointShare, RegionShare, Share, TimeShare, Where};
use qv_fit::linear::squared;
use qv_rollout::Channel;
use qv_rollout::channels;
use qv_rollout::law;
use qv_sim::Shape;

/// A foot this near to the ground counts as standing on it \[m\].
const ON_THE_GROUND: f64 = 0.006;
/// Edge of a cell of the floor \[m\].
const CELL: f64 = 0.5;
/// Share of the gap from which a cell is reported.
const WORTH_TELLING: f64 = 0.08;

/// Shares of the nominal simulator's gap. Interfaces and found regions are filled in later.
pub fn places(study: &LinearisedProblem) -> Where {
    let rollout = &study.rollout;
    let names = rollout.model.joint_names();
    let bins = rollout.cut.bins();
    let mut joints = vec![0.0; names.len()];
    let mut squares = vec![(0.0, 0usize); names.len()];
    let mut phases = [0.0; 3];
    let mut times = Vec::new();
    for seen in &study.seen {
        let separate = study.whitener(seen).separate(seen.index, &seen.raw);
        let phase = phases_of(study, seen);
        let (mut first, mut total) = (0, 0.0);
        for &channel in &rollout.channels {
            let width = channels::width(channel, bins);
            for k in 0..width {
                // What noise alone gives is no gap.
                let excess = (separate.motion[first + k].powi(2) - 1.0).max(0.0);
                total += excess;
                let Some(j) = channel.joint() else { continue };
                joints[j] += excess;
                if let (Some(foot), Some(phase)) = (rollout.feet.of_joint[j], &phase) {
                    phases[phase[foot][k]] += excess;
                }
                if matches!(channel, Channel::Position(_)) {
                    squares[j].0 += seen.raw.motion[first + k].powi(2);
                    squares[j].1 += 1;
                }
            }
            first += width;
        }
        let of_law = law::bins(rollout);
        for (i, x) in separate.law.iter().enumerate() {
            let excess = (x * x - 1.0).max(0.0) * bins as f64 / of_law as f64;
            joints[rollout.law_joints[i / of_law]] += excess;
            total += excess;
        }
        let start = seen.window.start;
        times.push(TimeShare { start, end: start + rollout.cut.window, share: total });
    }
    let all: f64 = joints.iter().sum::<f64>().max(1e-300);
    let legs = rollout.feet.names.iter().enumerate().map(|(foot, name)| {
        let of_leg = rollout.feet.of_joint.iter().zip(&joints).filter(|(f, _)| **f == Some(foot));
        Share { name: name.clone(), share: of_leg.map(|(_, e)| e / all).sum() }
    });
    let legs = legs.collect();
    let of_joint = |(j, name): (usize, &String)| JointShare {
        name: name.clone(),
        share: joints[j] / all,
        pos_rms: (squares[j].0 / squares[j].1.max(1) as f64).sqrt(),
    };
    let in_phases = phases.iter().sum::<f64>().max(1e-300);
    let phases = if rollout.feet.names.is_empty() || !rollout.free {
        Vec::new()
    } else {
        ["stance", "swing", "impact"]
            .iter()
            .zip(phases)
            .map(|(name, e)| Share { name: (*name).into(), share: e / in_phases })
            .collect()
    };
    let in_time = times.iter().map(|t| t.share).sum::<f64>().max(1e-300);
    times.iter_mut().for_each(|t| t.share /= in_time);
    Where {
        interfaces: Vec::new(),
        joints: names.iter().enumerate().map(of_joint).collect(),
        legs,
        phases,
        times,
        regions: Vec::new(),
    }
}

/// Stance 0, swing 1 or impact 2 of each foot in each bin; `None` for a robot without feet on a ground.
fn phases_of(study: &LinearisedProblem, seen: &LinearisedWindow) -> Option<Vec<Vec<usize>>> {
    let rollout = &study.rollout;
    if !rollout.free || rollout.feet.geoms.is_empty() {
        return None;
    }
    let starts = rollout.starts(&seen.window.view, Default::default()).ok()?;
    let bins = rollout.cut.bins();
    let heights: Vec<Option<Vec<f64>>> = (0..=bins)
        .map(|b| {
            let state = starts.at(seen.window.start + b as f64 * rollout.cut.bin)?;
            let poses = rollout.model.world_from_links(&state.q);
            let height = |g: &usize| {
                let geom = &rollout.model.geoms[*g];
                let centre = poses[geom.link].transform_point(geom.link_from_geom.position);
                let radius = if let Shape::Sphere(r) = geom.shape { r } else { 0.0 };
                let ground = rollout.terrain.height_below(centre.x, centre.y, centre.z + 1.0).unwrap_or(0.0);
                centre.z - radius - ground
            };
            Some(rollout.feet.geoms.iter().map(height).collect())
        })
        .collect();
    let lowest = heights.iter().flatten().flatten().copied().fold(f64::INFINITY, f64::min);
    let stands = |b: usize, foot: usize| heights[b].as_ref().is_none_or(|h| h[foot] < lowest + ON_THE_GROUND);
    let of_foot = |foot: usize| {
        let phase = |b: usize| match (stands(b, foot), stands(b + 1, foot)) {
            (true, true) => 0,
            (false, false) => 1,
            _ => 2,
        };
        (0..bins).map(phase).collect()
    };
    Some((0..rollout.feet.geoms.len()).map(of_foot).collect())
}

/// Shares of the log evidence for each interface: that of its likeliest effect by one linear step, beyond what that effect has in the
/// median recording without one (contacts of another engine have much in nearly all).
///
/// # Errors
/// When the normal equations are no good.
pub fn interfaces(study: &mut LinearisedProblem) -> Result<Vec<Share>, GapError> {
    let search = Search::new(study, 1.0)?;
    let here = by_effect(&search, &search.study.nominal(fitted));
    let replicates = of_replicates(&search);
    let usual = |effect: usize| {
        let mut of_effect: Vec<f64> = replicates.iter().map(|g| g[effect].max(0.0)).collect();
        of_effect.sort_by(f64::total_cmp);
        of_effect.get(of_effect.len() / 2).copied().unwrap_or(0.0)
    };
    let effects = &search.study.columns.effects;
    let gain = |interface: Interface| {
        let of_interface = (0..effects.len()).filter(|&e| effects[e].interface == interface);
        of_interface.map(|e| here[e] - usual(e)).fold(0.0, f64::max)
    };
    let gains = Interface::ALL.map(|i| (i, gain(i)));
    let total: f64 = gains.iter().map(|g| g.1).sum();
    let share = |(i, gain): (Interface, f64)| Share {
        name: i.name().into(),
        share: if total > 0.0 { gain / total } else { 0.25 },
    };
    Ok(gains.map(share).to_vec())
}

/// A suspect without its region if the robot never left that: it is all the ground there is.
pub fn as_stated(study: &LinearisedProblem, suspect: &Suspect) -> Suspect {
    let is_all = matches!(suspect.extent, Some(Extent::Region(r)) if never_left(study, &feet(study), r));
    Suspect { extent: suspect.extent.filter(|_| !is_all), ..suspect.clone() }
}

/// Where the robot was in each window, and the gap there.
struct Floor(Vec<([f64; 2], f64)>);

impl Floor {
    fn new(study: &LinearisedProblem) -> Self {
        let level =
            |seen: &LinearisedWindow| (squared(&seen.residual) / seen.residual.len() as f64 - study.floor).max(0.0);
        Self(study.seen.iter().map(|s| (place(&s.window), level(s))).collect())
    }

    /// Share of the gap in a rectangle and `reach` beside it: feet stand away from the trunk, whose places these are.
    fn share(&self, x: [f64; 2], y: [f64; 2], reach: f64) -> f64 {
        let total: f64 = self.0.iter().map(|p| p.1).sum::<f64>().max(1e-300);
        let is_in = |at: f64, [low, high]: [f64; 2]| (low - reach..high + reach).contains(&at);
        let inside = |p: &[f64; 2]| is_in(p[0], x) && is_in(p[1], y);
        self.0.iter().filter(|(p, _)| inside(p)).map(|p| p.1).sum::<f64>() / total
    }
}

/// The share of a region that was found.
pub fn region(study: &LinearisedProblem, [x0, x1, y0, y1]: [f64; 4]) -> RegionShare {
    let (x, y) = ([x0, x1], [y0, y1]);
    RegionShare { name: "found".into(), x, y, share: Floor::new(study).share(x, y, REACH) }
}

/// Cells of the floor with more than their share.
pub fn cells(study: &LinearisedProblem) -> Vec<RegionShare> {
    let floor = Floor::new(study);
    let known = floor.0.iter().filter(|(p, _)| p[0].is_finite());
    let mut cells: Vec<[i64; 2]> = known.map(|(p, _)| p.map(|c| (c / CELL).floor() as i64)).collect();
    cells.sort_unstable();
    cells.dedup();
    let edge = |k: i64| [k as f64 * CELL, (k + 1) as f64 * CELL];
    let cell = |[i, j]: [i64; 2]| {
        let (x, y) = (edge(i), edge(j));
        RegionShare { name: format!("cell {i}, {j}"), x, y, share: floor.share(x, y, 0.0) }
    };
    cells.into_iter().map(cell).filter(|c| c.share > WORTH_TELLING).collect()
}
