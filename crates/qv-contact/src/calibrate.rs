//! The calibration: priors, posteriors by windowed replay, the paper's grid search, errors of the base before and after.

use crate::ContactError;
use crate::ground::Ground;
use crate::measured::{Recording, TICK};
use crate::posterior::{Distribution, Evidence, evidence, interpolate, posterior};
use crate::prior::{Prior, RANGE};
use crate::report::{BaseError, Curves, Errors, Estimate, Place, Region, Report, Status, WindowCount};
use crate::robot::{self, IdentifiedRobot};
use crate::segments::{self, Search, Segment, base_errors};
use crate::simulate::Simulator;
use crate::windows::{self, Background, Losses, Window};
use qv_core::TriangleMesh;
use qv_recording::Run;
use qv_sim::Model;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Frictions of the coarse grid, and of the fine one about what was found.
const COARSE: usize = 16;
const FINE: usize = 13;
/// The fine grid reaches this far either way, in the logarithm.
const FINE_REACH: f64 = 0.36;
/// Rounds over the labels; all but the first on a fine grid, too.
const ROUNDS: usize = 3;
/// Information below which a prior is kept \[nats\].
const LITTLE: f64 = 0.15;
/// Least contact time of a label, summed over feet \[s\], and least number of windows.
const LEAST_CONTACT: f64 = 1.0;
const LEAST_WINDOWS: usize = 10;
/// Share of the contact time from which on feet slip on a label: it is searched whatever its prior, and its prior does not stand against the
/// recording (labels with friction above 0.5 have 3 to 6 %, gravel of 0.45 has 10, ice of 0.22 has 13, tiles of 0.18 half).
const SLIPS: f64 = 0.08;
/// Distance of prior and recording in standard deviations of both from which on they contradict each other.
const CONTRADICTS: f64 = 3.0;
/// Frictions, and how far they reach either way in the logarithm, by which it is seen how a moved robot moves what was found.
const SHIFT_GRID: usize = 5;
const SHIFTED: f64 = 0.3;
/// Frictions of the paper's search.
const SEARCHED: usize = 16;
const SEARCH_RANGE: [f64; 2] = [0.05, 1.0];

/// How to calibrate.
pub struct Options<'a> {
    /// Parameters that are known already, such as those of a diagnosis.
    pub given: Vec<(String, f64)>,
    /// Friction above which feet do not slip enough to show it (the paper's 0.5): a label whose prior mean and posterior mean are both at
    /// least this keeps its prior, and one with such a prior is left out of the grid search unless feet are seen to slip on it.
    pub slip_threshold: f64,
    /// The one friction of the comparison.
    pub uniform: f64,
    /// Length of the segments that are replayed open loop \[s\].
    pub segment: f64,
    /// Most windows that are looked at; of longer recordings evenly spread ones.
    pub most_windows: usize,
    /// Standard deviation of log friction that even endless evidence leaves: contacts of two simulators differ by that.
    pub own_error: f64,
    /// Seconds since some instant.
    pub clock: Option<&'a (dyn Fn() -> f64 + Sync)>,
    /// Reported the share that is done.
    pub progress: Option<&'a (dyn Fn(f64) + Sync)>,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self {
            given: Vec::new(),
            slip_threshold: 0.5,
            uniform: 0.8,
            segment: 2.0,
            most_windows: 800,
            own_error: 0.05,
            clock: None,
            progress: None,
        }
    }
}

/// Calibrates the friction of the labels of `mesh` from `runs` of one robot on it, starting from `priors`, one for each
/// label that a triangle has, in the order of [`Ground::labels`].
///
/// # Errors
/// When the mesh has no labels, priors do not fit it, a run lacks what is needed, or all of them are too short.
pub fn calibrate(
    runs: &[Run],
    model: &Model,
    mesh: &TriangleMesh,
    priors: &[Prior],
    options: &Options,
) -> Result<Report, ContactError> {
    let started = options.clock.map(|clock| clock());
    check(options)?;
    let ground = Ground::new(mesh)?;
    let labels = ground.labels();
    if !priors.iter().map(|p| &p.label).eq(labels.iter()) {
        let found = priors.iter().map(|p| p.label.clone()).collect::<Vec<_>>().join(", ");
        return Err(ContactError::run("priors", labels.join(", "), found));
    }
    let first = runs.first().ok_or_else(|| ContactError::run("runs", "at least one", "none"))?;
    let means: Vec<f64> = priors.iter().map(|p| p.mean).collect();
    let terrain = ground.terrain(&means)?;
    let mut simulator = Simulator::new(first, model, &terrain, &options.given)?;
    let prepared = runs.iter().map(|run| Recording::new(run, simulator.rollout(), &ground));
    let recordings: Vec<Recording> = prepared.collect::<Result<_, _>>()?;
    distinct(&recordings)?;
    simulator.settle(&recordings[0])?;
    let mut job = Job::new(&simulator, &recordings, priors, options)?;
    let robot = job.robot()?;
    if let Some(robot) = &robot {
        job.simulator = &robot.simulator;
    }
    let mut fit = job.fit()?;
    if let Some(robot) = &robot {
        job.widen(&mut fit, robot)?;
    }
    let searched = job.search()?;
    let mut report = job.report(&fit, searched)?;
    report.robot = robot.as_ref().map_or_else(Vec::new, |robot| robot.values.clone());
    report.timing.runtime_s = options.clock.zip(started).map_or(0.0, |(clock, started)| clock() - started);
    Ok(report)
}

/// The same recording given twice would count twice.
fn distinct(recordings: &[Recording]) -> Result<(), ContactError> {
    let place = |r: &Recording| -> Vec<Option<[f64; 3]>> {
        r.instants.iter().map(|i| i.as_ref().map(|i| [i.state.q[0], i.state.q[1], i.state.q[2]])).collect()
    };
    let places: Vec<_> = recordings.iter().map(place).collect();
    for (k, later) in places.iter().enumerate() {
        if let Some(first) = places[..k].iter().position(|earlier| earlier == later) {
            let found = format!("recording {} and {} alike", first + 1, k + 1);
            return Err(ContactError::run("runs", "each recording once", found));
        }
    }
    Ok(())
}

fn check(options: &Options) -> Result<(), ContactError> {
    let numbers = [
        ("slip threshold", options.slip_threshold, 0.0, 10.0),
        ("uniform friction", options.uniform, 0.01, 10.0),
        ("length of a segment", options.segment, 0.2, 100.0),
        ("own error", options.own_error, 1e-3, 1.0),
    ];
    match numbers.into_iter().find(|(_, x, low, high)| !(*low..=*high).contains(x)) {
        Some((what, x, low, high)) => Err(ContactError::run(what, format!("{low} to {high}"), x.to_string())),
        None => Ok(()),
    }
}

/// Frictions evenly spread in the logarithm.
fn spread(range: [f64; 2], count: usize) -> Vec<f64> {
    (0..count).map(|k| range[0] * (range[1] / range[0]).powf(k as f64 / (count - 1) as f64)).collect()
}

/// A grid half as fine as the coarse one, with a fine one about `middle` in place of its points there.
fn grid_about(middle: f64) -> Vec<f64> {
    let near = |mu: &f64| (mu / middle).ln().abs() < FINE_REACH * 1.05;
    let mut grid: Vec<f64> = spread(RANGE, COARSE / 2).into_iter().filter(|mu| !near(mu)).collect();
    let ends = [middle * (-FINE_REACH).exp(), middle * FINE_REACH.exp()];
    grid.extend(spread(ends, FINE).into_iter().filter(|mu| (RANGE[0]..RANGE[1]).contains(mu)));
    grid.sort_by(f64::total_cmp);
    grid
}

/// What is calibrated.
struct Job<'a> {
    simulator: &'a Simulator<'a>,
    recordings: &'a [Recording<'a>],
    priors: &'a [Prior],
    options: &'a Options<'a>,
    segments: Vec<Segment>,
    windows: Vec<Window>,
    contact: Vec<f64>,
    /// Share of that time in which feet slipped, by label.
    slip_share: Vec<f64>,
    /// Simulated ticks that have ended, and all that will.
    ended: AtomicUsize,
    planned: usize,
}

/// What windows say.
struct Fit {
    background: Background,
    /// For each label, if it was touched.
    labels: Vec<Option<LabelEvidence>>,
}

/// What windows say of one label.
struct LabelEvidence {
    grid: Vec<f64>,
    losses: Losses,
    found: Evidence,
    after: Distribution,
    /// Standard deviation of log friction that comes of what is not known of the robot.
    of_robot: f64,
    /// Mean without what the prior says, where feet slip and it is below the slip threshold.
    lead: Option<f64>,
    /// Whether the prior was left out, since the recording contradicts it.
    is_contradicted: bool,
}

impl<'a> Job<'a> {
    fn new(
        simulator: &'a Simulator<'a>,
        recordings: &'a [Recording<'a>],
        priors: &'a [Prior],
        options: &'a Options<'a>,
    ) -> Result<Self, ContactError> {
        let segments = segments::cut(recordings, options.segment);
        let away: Vec<_> = segments.iter().filter(|s| s.held_out).map(|s| (s.run, s.from, s.from + s.ticks)).collect();
        let windows = windows::cut(recordings, &away, options.most_windows);
        let mut contact = vec![0.0; priors.len()];
        for recording in recordings {
            contact.iter_mut().zip(recording.contact_time(priors.len())).for_each(|(sum, t)| *sum += t);
        }
        let mut job = Self {
            simulator,
            recordings,
            priors,
            options,
            segments,
            windows,
            slip_share: vec![0.0; contact.len()],
            contact,
            ended: AtomicUsize::new(0),
            planned: 0,
        };
        let share = |(slipped, contact): (f64, &f64)| if *contact > 0.0 { (slipped / contact).min(1.0) } else { 0.0 };
        job.slip_share = job.slipped().into_iter().zip(&job.contact).map(share).collect();
        let pairs: usize = windows::counts(&job.windows).values().sum();
        let of_search = |l: &usize| job.segments.iter().filter(|s| !s.held_out && s.labels.contains(l)).count();
        let searched: usize = job.searched().iter().map(of_search).sum();
        let ticks = job.segments.first().map_or(0, |s| s.ticks);
        let in_windows = windows::TICKS * pairs * (COARSE / 2 + 3 * (COARSE / 2 + FINE - 2) / 2);
        job.planned = in_windows + ticks * (2 * SEARCHED * searched + 4 * job.segments.len());
        Ok(job)
    }

    /// Reports that simulations of so many ticks have ended.
    fn notify(&self, ticks: usize) {
        let ended = self.ended.fetch_add(ticks, Ordering::Relaxed) + ticks;
        if let Some(progress) = self.options.progress {
            progress((ended as f64 / self.planned.max(1) as f64).min(1.0));
        }
    }

    /// Whether a label keeps its prior: nothing was learned of it, or feet hardly slip on it. What a robot's faults do to feet that hardly slip
    /// looks like friction, too, and no walk depends on it.
    fn status(&self, label: usize, after: &Distribution) -> Status {
        let prior = &self.priors[label];
        if after.gain(&Distribution::prior(prior, RANGE)) < LITTLE {
            Status::Insensitive
        } else if prior.mean.min(after.mean()) >= self.options.slip_threshold {
            Status::Grips
        } else {
            Status::Refined
        }
    }

    fn slips(&self, label: usize) -> bool {
        self.slip_share[label] >= SLIPS
    }

    /// What windows say of a label. Where feet slip, a prior that the recording contradicts is left out.
    fn said(&self, label: usize, grid: Vec<f64>, losses: Losses, of_robot: f64) -> LabelEvidence {
        let found = evidence(&grid, &losses.windows, RANGE);
        let prior = &self.priors[label];
        let own_error = self.options.own_error.hypot(of_robot);
        let after = posterior(prior, &found, RANGE, own_error);
        let alone = posterior(&prior.wide(), &found, RANGE, own_error);
        let [mean, sd] = prior.log_moments();
        let [found_mean, found_sd] = alone.log_moments();
        let is_apart = (mean - found_mean).abs() > CONTRADICTS * sd.hypot(found_sd);
        let leads = self.slips(label) && alone.mean() < self.options.slip_threshold;
        let is_contradicted = leads && is_apart;
        let lead = leads.then(|| alone.mean());
        let after = if is_contradicted { alone } else { after };
        LabelEvidence { grid, losses, found, after, of_robot, lead, is_contradicted }
    }

    /// Every second window, for what does not need all.
    fn half(&self) -> Vec<Window> {
        self.windows.iter().step_by(2).cloned().collect()
    }

    /// Motors and the ground's softness, as windows show them beside friction; `None` where they cannot be found, or all is given.
    fn robot(&self) -> Result<Option<IdentifiedRobot<'a>>, ContactError> {
        let given: Vec<String> = self.options.given.iter().map(|(name, _)| name.clone()).collect();
        // A number for all joints needs fewer windows than the friction of each label.
        let half = self.half();
        robot::identify(self.simulator, self.recordings, &half, self.priors, &given)
    }

    /// Widens what was found by how far it moves when the robot is moved by its own uncertainty.
    fn widen(&self, fit: &mut Fit, robot: &IdentifiedRobot) -> Result<(), ContactError> {
        let of = |(label, said): (usize, &Option<LabelEvidence>)| {
            let refined = said.as_ref().filter(|s| self.status(label, &s.after) == Status::Refined);
            refined.map_or(self.priors[label].mean, |s| s.after.mean())
        };
        let frictions: Vec<f64> = fit.labels.iter().enumerate().map(of).collect();
        let half = self.half();
        for label in 0..fit.labels.len() {
            let Some(said) = fit.labels[label].take() else { continue };
            let grid = spread([frictions[label] * (-SHIFTED).exp(), frictions[label] * SHIFTED.exp()], SHIFT_GRID);
            let least = |simulator: &Simulator| {
                let varied = windows::FrictionGrid { label, frictions: &frictions, grid: &grid };
                let usual = &fit.background.usual;
                let losses = windows::losses(simulator, self.recordings, &half, usual, varied, &|_| {})?;
                Ok::<f64, ContactError>(evidence(&grid, &losses.windows, [grid[0], grid[SHIFT_GRID - 1]]).least.ln())
            };
            let here = least(self.simulator)?;
            let shifts = robot.moved.iter().map(|moved| Ok((least(moved)? - here).powi(2)));
            let shift = shifts.sum::<Result<f64, ContactError>>()?.sqrt();
            fit.labels[label] = Some(self.said(label, said.grid, said.losses, shift));
        }
        Ok(())
    }

    fn is_touched(&self, label: usize) -> bool {
        let windows = self.windows.iter().filter(|w| w.labels.contains(&label)).count();
        self.contact[label] >= LEAST_CONTACT && windows >= LEAST_WINDOWS
    }

    /// Labels of the paper's search.
    fn searched(&self) -> Vec<usize> {
        (0..self.priors.len())
            .filter(|&l| {
                let is_slippery = self.priors[l].mean < self.options.slip_threshold || self.slips(l);
                self.is_touched(l) && is_slippery
            })
            .collect()
    }

    /// Each label in turn, beside what was found for the others.
    fn fit(&self) -> Result<Fit, ContactError> {
        let mut frictions: Vec<f64> = self.priors.iter().map(|p| p.mean).collect();
        let mut labels: Vec<_> = self.priors.iter().map(|_| None).collect();
        let mut order: Vec<usize> = (0..self.priors.len()).filter(|&l| self.is_touched(l)).collect();
        let slipped = self.slipped();
        // Where feet slip most there is most to find, and the others depend on it.
        order.sort_by(|&a, &b| slipped[b].total_cmp(&slipped[a]));
        let mut background = windows::background(self.simulator, self.recordings, &self.windows, &frictions)?;
        let half = self.half();
        for round in 0..ROUNDS {
            // Only the last round needs all.
            let windows = if round + 1 < ROUNDS { &half } else { &self.windows };
            for &label in &order {
                let grid = if round == 0 { spread(RANGE, COARSE) } else { grid_about(frictions[label]) };
                let ticks = grid.len() * windows::TICKS;
                let losses = windows::losses(
                    self.simulator,
                    self.recordings,
                    windows,
                    &background.usual,
                    windows::FrictionGrid { label, frictions: &frictions, grid: &grid },
                    &|done| self.notify(done * ticks),
                )?;
                let said = self.said(label, grid, losses, 0.0);
                // Others are fitted beside what will be used. Where feet slip, the first rounds go where the recording leads: what is usual
                // there, and so the weight of what windows say, depends on it.
                let is_refined = self.status(label, &said.after) == Status::Refined;
                let used = if is_refined { said.after.mean() } else { self.priors[label].mean };
                frictions[label] = said.lead.filter(|_| round + 1 < ROUNDS).unwrap_or(used);
                labels[label] = Some(said);
            }
            if round + 1 < ROUNDS {
                background = windows::background(self.simulator, self.recordings, &self.windows, &frictions)?;
            }
        }
        Ok(Fit { background, labels })
    }

    fn search(&self) -> Result<Vec<Option<Search>>, ContactError> {
        let start: Vec<f64> = self.priors.iter().map(|p| p.mean).collect();
        let ticks = SEARCHED * self.segments.first().map_or(0, |s| s.ticks);
        let grid = spread(SEARCH_RANGE, SEARCHED);
        let done = |tasks: usize| self.notify(tasks * ticks);
        segments::search(self.simulator, self.recordings, &self.segments, &start, &self.searched(), &grid, &done)
    }

    /// Time in which feet slipped on each label \[s\].
    fn slipped(&self) -> Vec<f64> {
        let mut time = vec![0.0; self.priors.len()];
        for recording in self.recordings {
            recording.slips(0).iter().for_each(|s| time[s.label] += TICK);
        }
        time
    }

    fn region(&self, label: usize, fit: &Fit, grid: Option<Search>) -> Region {
        let prior = &self.priors[label];
        let before = Distribution::prior(prior, RANGE);
        let prior_estimate = Estimate::of(&before);
        let contact_time = self.contact[label];
        let mut region = Region {
            label: prior.label.clone(),
            friction: prior.mean,
            status: Status::NotTouched,
            prior: prior.clone(),
            prior_estimate,
            posterior: prior_estimate,
            is_lower_bound: false,
            evidence: 0.0,
            of_robot: 0.0,
            information: 0.0,
            sensitivity: [0.0; 2],
            contact_time,
            slip_share: self.slip_share[label],
            prior_is_contradicted: false,
            windows: self.windows.iter().filter(|w| w.labels.contains(&label)).count(),
            weight: 1.0,
            grid,
            curves: curves(&before, &before),
        };
        let Some(LabelEvidence { grid, losses, found, after, of_robot, is_contradicted, .. }) = &fit.labels[label]
        else {
            return region;
        };
        region.prior_is_contradicted = *is_contradicted;
        let logs: Vec<f64> = after.friction.iter().map(|mu| mu.ln()).collect();
        let loss = |mu: f64| interpolate(&logs, &found.losses, mu.ln());
        let movement = |mu: f64| {
            let k = grid.partition_point(|g| *g <= mu).clamp(1, grid.len() - 1) - 1;
            losses.movement[k]
        };
        region.weight = found.weight;
        region.of_robot = *of_robot;
        region.information = after.gain(&before);
        region.sensitivity = [movement(prior.mean), movement(after.mean())];
        region.status = self.status(label, after);
        if region.status == Status::Refined {
            region.friction = after.mean();
        }
        if region.status != Status::Insensitive {
            region.posterior = Estimate::of(after);
            region.evidence = loss(prior.mean) - loss(after.mean());
            // Far above nothing speaks against it, below something does.
            region.is_lower_bound = loss(RANGE[1]) < 1.0 && loss(RANGE[0]) > 3.0;
            region.curves = curves(&before, after);
        }
        region
    }

    fn report(&self, fit: &Fit, searched: Vec<Option<Search>>) -> Result<Report, ContactError> {
        let regions: Vec<Region> =
            searched.into_iter().enumerate().map(|(label, grid)| self.region(label, fit, grid)).collect();
        let slips: Vec<_> = self.recordings.iter().enumerate().flat_map(|(run, r)| r.slips(run)).collect();
        let background = &fit.background;
        Ok(Report {
            format: "qv-contact/1",
            base_error: self.base_error(&regions)?,
            windows: WindowCount {
                length: windows::TICKS as f64 * TICK,
                count: self.windows.len(),
                background: background.windows,
                background_is_all: background.is_of_all,
            },
            path: self.path(),
            slips,
            notes: notes(&regions, background.is_of_all, self.segments.is_empty().then_some(self.options.segment)),
            regions,
            robot: Vec::new(),
            timing: Default::default(),
        })
    }

    fn base_error(&self, regions: &[Region]) -> Result<BaseError, ContactError> {
        let of = |value: &dyn Fn(&Region) -> f64| regions.iter().map(value).collect::<Vec<f64>>();
        let sets = [
            vec![self.options.uniform; regions.len()],
            of(&|r| r.prior.mean),
            of(&|r| r.grid.as_ref().map_or(r.prior.mean, |g| g.friction)),
            of(&|r| r.friction),
        ];
        let ticks = 4 * self.segments.first().map_or(0, |s| s.ticks);
        let done = |tasks: usize| self.notify(tasks * ticks);
        let errors = base_errors(self.simulator, self.recordings, &self.segments, &sets, &done)?;
        let mean = |wanted: &dyn Fn(&Segment) -> bool| {
            let chosen: Vec<&Vec<f64>> =
                self.segments.iter().zip(&errors).filter(|(s, _)| wanted(s)).map(|(_, e)| e).collect();
            let of = |k: usize| chosen.iter().map(|e| e[k]).sum::<f64>() / chosen.len() as f64;
            let found =
                || Errors { uniform: of(0), prior: of(1), grid: of(2), posterior: of(3), segments: chosen.len() };
            (!chosen.is_empty()).then(found)
        };
        Ok(BaseError {
            segment: self.segments.first().map_or(self.options.segment, |s| s.ticks as f64 * TICK),
            uniform_friction: self.options.uniform,
            held_out: mean(&|s| s.held_out),
            all: mean(&|_| true),
        })
    }

    fn path(&self) -> Vec<Place> {
        let mut path = Vec::new();
        for (run, recording) in self.recordings.iter().enumerate() {
            for (k, instant) in recording.instants.iter().enumerate().step_by(2) {
                if let Some(i) = instant {
                    path.push(Place { run, time: recording.time(k), at: [i.state.q[0], i.state.q[1]] });
                }
            }
        }
        path
    }
}

fn curves(before: &Distribution, after: &Distribution) -> Curves {
    let relative = |d: &Distribution| {
        let top = d.probability.iter().copied().fold(1e-300, f64::max);
        d.probability.iter().step_by(2).map(|p| p / top).collect()
    };
    let friction = before.friction.iter().step_by(2).copied().collect();
    Curves { friction, prior: relative(before), posterior: relative(after) }
}

fn notes(regions: &[Region], background_is_all: bool, without_segment: Option<f64>) -> Vec<String> {
    let mut notes = Vec::new();
    for r in regions {
        if r.prior.is_put_within_range() {
            notes.push(format!("{}: prior {}", r.label, r.prior.source));
        }
        if r.prior_is_contradicted {
            notes.push(format!(
                "{}: the prior, {:.2} with {:.2}, contradicts the recording, in which feet slip {:.0} % of the time: it is left out",
                r.label,
                r.prior.mean,
                r.prior.sd,
                100.0 * r.slip_share
            ));
        }
        match r.status {
            Status::NotTouched => {
                notes.push(format!("{}: feet stood on it for {:.1} s: the prior is kept", r.label, r.contact_time));
            }
            Status::Insensitive => notes.push(format!(
                "{}: the recording adds little to the prior ({:.2} nats): the prior is kept",
                r.label, r.information
            )),
            Status::Grips => notes.push(format!(
                "{}: above the friction at which feet slip: the prior is used, though the recording reports {:.2} ({:.2} to {:.2}); faults of motors \
                 look like friction of such a label",
                r.label, r.posterior.mean, r.posterior.interval90[0], r.posterior.interval90[1]
            )),
            Status::Refined if r.is_lower_bound => notes.push(format!(
                "{}: feet slipped too little: friction is at least about {:.2}",
                r.label, r.posterior.interval90[0]
            )),
            Status::Refined => {}
        }
    }
    if let Some(length) = without_segment {
        notes.push(format!(
            "no recording has a stretch of {length} s without gaps: errors of the base are not reported"
        ));
    }
    if background_is_all {
        notes.push("too few windows without slip: the usual error is computed from all windows".into());
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fine_grid_lies_about_what_was_found_and_reaches_the_ends() {
        for middle in [0.031, 0.2, 0.9, 1.49] {
            let grid = grid_about(middle);
            assert!(grid.windows(2).all(|w| w[1] > w[0] * 1.001), "{grid:?}");
            let near = grid.iter().filter(|mu| (*mu / middle).ln().abs() < 0.2).count();
            assert!(near >= 4, "{middle}: {grid:?}");
            assert!(grid[0] < 0.05 && grid[grid.len() - 1] > 1.0, "{grid:?}");
        }
    }

    #[test]
    fn options_that_mean_nothing_are_named() {
        assert!(check(&Options::default()).is_ok());
        let error = check(&Options { segment: f64::NAN, ..Default::default() }).unwrap_err().to_string();
        assert!(error.contains("segment"), "{error}");
        assert!(check(&Options { uniform: -1.0, ..Default::default() }).is_err());
    }
}
