//! Nets that learn corrections which an inverse found: first along the recording, then at states that the net itself reached (DAgger, Ross et
//! al. 2011).

use super::fit::{Samples, fit};
use super::inputs::{position_inputs, position_scaling, torque_inputs};
use super::inverse::Inverse;
use super::position::{Look, Past, remember};
use super::settings::SupervisedSettings;
use super::stage::{Acts, Stage};
use super::torque::Watch;
use super::{NetKind, PositionResidual, ResidualNet, TorqueResidual, UNIT};
use crate::ResidualError;
use crate::windows::{Lane, Replayer, Window};
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::compensate::Compensator;
use qv_policy::net::Mlp;
use serde::Serialize;

/// What a round did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Round {
    /// Samples so far.
    pub samples: usize,
    /// Mean squared error of the net over the samples, in squares of [`UNIT`].
    pub loss: f64,
    /// Mean joint error of the net that drives windows of the training by itself \[rad\].
    pub driven: f64,
}

/// Lanes that are corrected together: their probes fill some ten megabytes.
const TOGETHER: usize = 96;
/// A joint that is farther than this from the recording is lost \[rad\].
pub(super) const LOST: f32 = 0.8;

/// Teaches a net of positions on windows of a log, on top of a lane's parameters and biases.
///
/// # Errors
/// When a setting means nothing, there are no windows, or a number is not finite.
pub fn train_position(
    replayer: &Replayer,
    windows: &[Window],
    lane: &Lane,
    settings: &SupervisedSettings,
    notify: impl FnMut(&Round),
) -> Result<ResidualNet, ResidualError> {
    let inputs = position_inputs(replayer.robot);
    Teacher { replayer, lane, settings, acts: Acts::Position }.train(
        windows,
        [inputs, replayer.log.joints],
        NetKind::Position,
        notify,
    )
}

/// Teaches a net of torques on windows of a log, on top of a lane's parameters and biases.
///
/// # Errors
/// As [`train_position`].
pub fn train_torque(
    replayer: &Replayer,
    windows: &[Window],
    lane: &Lane,
    settings: &SupervisedSettings,
    notify: impl FnMut(&Round),
) -> Result<ResidualNet, ResidualError> {
    let inputs = torque_inputs(replayer.robot);
    Teacher { replayer, lane, settings, acts: Acts::Torque }.train(windows, [inputs, 1], NetKind::Torque, notify)
}

struct Teacher<'a> {
    replayer: &'a Replayer<'a>,
    lane: &'a Lane,
    settings: &'a SupervisedSettings,
    acts: Acts,
}

/// At most so many windows, spread evenly, of those that leave room for `length` decisions.
pub(super) fn spread(
    replayer: &Replayer,
    windows: &[Window],
    length: usize,
    most: usize,
) -> Result<Vec<Window>, ResidualError> {
    let log = replayer.log;
    let has_room = |w: &&Window| {
        let decisions = log.stretches.get(w.stretch).map_or(0, |s| s.decisions(log.joints));
        w.decision >= crate::windows::WARM && w.decision + length <= decisions
    };
    let fitting: Vec<Window> = windows.iter().filter(has_room).copied().collect();
    if fitting.is_empty() {
        let found = format!("{} windows, none of them with room", windows.len());
        return Err(ResidualError::input("windows of a training", format!("some with {length} decisions"), found));
    }
    let count = most.min(fitting.len());
    Ok((0..count).map(|k| fitting[k * fitting.len() / count]).collect())
}

impl Teacher<'_> {
    fn train(
        &self,
        windows: &[Window],
        [inputs, outputs]: [usize; 2],
        kind: NetKind,
        mut notify: impl FnMut(&Round),
    ) -> Result<ResidualNet, ResidualError> {
        let settings = self.settings;
        settings.check()?;
        let windows = spread(self.replayer, windows, settings.length + settings.ahead - 1, settings.windows)?;
        let sizes: Vec<usize> =
            std::iter::once(inputs).chain(settings.hidden.iter().copied()).chain([outputs]).collect();
        let net = Mlp::new(&sizes);
        let mut random = Xoshiro256PlusPlus::of(settings.seed, 61, 0);
        let mut parameters = net.draw(0.1, &mut random);
        let mut samples = Samples::default();
        let mut best: Option<(f64, ResidualNet)> = None;
        let mut last: Option<ResidualNet> = None;
        for _ in 0..=settings.rounds {
            for together in windows.chunks(TOGETHER) {
                match self.acts {
                    Acts::Position => self.positions(last.as_ref(), together, &mut samples)?,
                    Acts::Torque => self.torques(last.as_ref(), together, &mut samples)?,
                }
            }
            let loss = fit(&net, &mut parameters, &samples, settings.passes, settings.rate, &mut random)?;
            let now = ResidualNet::new(kind, self.replayer.robot, &net, &parameters, settings.clip);
            let driven = self.driven(&now, &windows)?;
            notify(&Round { samples: samples.count, loss, driven });
            if best.as_ref().is_none_or(|(least, _)| driven < *least) {
                best = Some((driven, now.clone()));
            }
            last = Some(now);
        }
        best.map(|(_, net)| net).ok_or_else(|| ResidualError::input("rounds of a training", "at least one", 0))
    }

    fn driven(&self, net: &ResidualNet, windows: &[Window]) -> Result<f64, ResidualError> {
        let lanes: Vec<Lane> = (0..windows.len()).map(|window| Lane { window, ..self.lane.clone() }).collect();
        let compensator = net.compensator(self.replayer.robot, self.replayer.log.substeps, lanes.len())?;
        Ok(self.replayer.replay(windows, &lanes, self.settings.length, Some(compensator))?.joints())
    }

    fn begin(&self, windows: &[Window]) -> Result<(Stage<'_>, Inverse<'_>), ResidualError> {
        let lanes: Vec<Lane> = (0..windows.len()).map(|window| Lane { window, ..self.lane.clone() }).collect();
        let mut stage = Stage::new(self.replayer, windows.len(), self.lane)?;
        self.replayer.begin(&mut stage.batch, windows, &lanes, &mut None)?;
        let inverse = Inverse::new(self.replayer, windows.len(), self.lane, self.acts, self.settings)?;
        Ok((stage, inverse))
    }

    /// Puts lanes back on the recording.
    fn put_back(&self, stage: &mut Stage, at: &[Window]) -> Result<(), ResidualError> {
        for (env, &at) in at.iter().enumerate() {
            stage.batch.move_to(env, &self.replayer.start(at, 0, &self.lane.bias))?;
        }
        Ok(())
    }

    fn is_lost(&self, stage: &Stage, env: usize, at: Window) -> bool {
        let joints = self.replayer.log.joints;
        let (real, _) = self.replayer.log.stretches[at.stretch].state(joints, at.decision);
        let sim = &stage.q[env * (7 + joints)..][..7 + joints];
        let is_near = |k: usize| (sim[k] - real[k]).abs() < LOST;
        !(7..7 + joints).all(is_near)
    }

    /// Samples of windows: corrections, under a net or along the recording.
    fn positions(
        &self,
        net: Option<&ResidualNet>,
        windows: &[Window],
        samples: &mut Samples,
    ) -> Result<(), ResidualError> {
        let (replayer, robot, joints) = (self.replayer, self.replayer.robot, self.replayer.log.joints);
        let (mut stage, mut inverse) = self.begin(windows)?;
        let (look, (offset, scale)) = (Look::new(robot), position_scaling(robot));
        let mut past = Past::new(joints, windows.len());
        let mut driver = net.map(|net| PositionResidual::new(net, robot, windows.len())).transpose()?;
        for (env, w) in windows.iter().enumerate() {
            let ago = |k: usize| replayer.targets(Window { decision: w.decision - k, ..*w }, 0);
            past.set(env, ago(1), ago(2));
            if let Some(driver) = &mut driver {
                driver.set_past(env, ago(1), ago(2));
            }
        }
        let mut row = vec![0.0; offset.len()];
        for k in 0..self.settings.length {
            let later = |k: usize| -> Vec<Window> {
                windows.iter().map(|w| Window { decision: w.decision + k, ..*w }).collect()
            };
            let at = later(k);
            stage.ask(0, |env| at[env]);
            stage.look()?;
            let mut moved = vec![0.0; windows.len() * joints];
            if let Some(driver) = &mut driver {
                driver.corrections(&stage.seen(), &mut moved);
            }
            let found = inverse.solve(&stage, &at, &moved)?;
            for (env, found) in found.iter().enumerate() {
                let own = &mut past.numbers[env * 3 * joints..][..3 * joints];
                let moved = &mut moved[env * joints..][..joints];
                look.input(env, &stage.seen(), own, &mut row);
                if let Some(found) = found.as_ref().filter(|_| !self.is_lost(&stage, env, at[env])) {
                    row.iter_mut().zip(&offset).zip(&scale).for_each(|((x, offset), scale)| *x = (*x - offset) * scale);
                    let output: Vec<f32> = found.iter().map(|x| x / UNIT).collect();
                    samples.push(&row, &output);
                    if driver.is_none() {
                        moved.copy_from_slice(found);
                    }
                }
                remember(own, &stage.asked[env * joints..][..joints], moved);
            }
            stage.decide(Acts::Position, &moved, |env| at[env])?;
            if driver.is_none() {
                self.put_back(&mut stage, &later(k + 1))?;
            }
        }
        Ok(())
    }

    /// The same for torques: the net acts at each physics step, a correction is held for a decision.
    fn torques(
        &self,
        net: Option<&ResidualNet>,
        windows: &[Window],
        samples: &mut Samples,
    ) -> Result<(), ResidualError> {
        let (log, robot, joints) = (self.replayer.log, self.replayer.robot, self.replayer.log.joints);
        let (mut stage, mut inverse) = self.begin(windows)?;
        let mut watch = Watch::new(robot, log.substeps, windows.len());
        let mut driver = net.map(|net| TorqueResidual::new(net, robot, log.substeps, windows.len())).transpose()?;
        let none = vec![0.0; windows.len() * joints];
        let mut moved = none.clone();
        let mut row = vec![0.0; torque_inputs(robot)];
        for k in 0..self.settings.length {
            let later = |k: usize| -> Vec<Window> {
                windows.iter().map(|w| Window { decision: w.decision + k, ..*w }).collect()
            };
            let at = later(k);
            stage.look()?;
            // The net's last correction is where the search begins.
            let base = if driver.is_some() { moved.clone() } else { none.clone() };
            let found = inverse.solve(&stage, &at, &base)?;
            let lost: Vec<bool> = (0..at.len()).map(|env| self.is_lost(&stage, env, at[env])).collect();
            for substep in 0..log.substeps {
                stage.ask(substep, |env| at[env]);
                stage.look()?;
                watch.watch(&stage.seen());
                match &mut driver {
                    Some(driver) => driver.corrections(&stage.seen(), &mut moved),
                    None => moved
                        .chunks_exact_mut(joints)
                        .zip(&found)
                        .for_each(|(moved, found)| moved.copy_from_slice(found.as_deref().unwrap_or(&none[..joints]))),
                }
                for (env, found) in found.iter().enumerate() {
                    // One physics step of each decision, in turn: neighbours say the same.
                    let Some(found) = found.as_ref().filter(|_| !lost[env] && (env + k) % log.substeps == substep)
                    else {
                        continue;
                    };
                    for (j, x) in found.iter().enumerate() {
                        watch.input(env, j, &mut row);
                        samples.push(&row, &[x / UNIT]);
                    }
                }
                stage.add(&moved)?;
                stage.step(&none)?;
            }
            if driver.is_none() {
                self.put_back(&mut stage, &later(k + 1))?;
            }
        }
        Ok(())
    }
}

impl ResidualNet {
    /// The net as a compensator of so many environments, at so many physics steps a decision.
    ///
    /// # Errors
    /// When it does not fit the robot.
    pub fn compensator(
        &self,
        robot: &qv_policy::velocity::TaskRobot,
        substeps: usize,
        count: usize,
    ) -> Result<Box<dyn Compensator>, ResidualError> {
        Ok(match self.kind {
            NetKind::Position => Box::new(PositionResidual::new(self, robot, count)?),
            NetKind::Torque => Box::new(TorqueResidual::new(self, robot, substeps, count)?),
        })
    }
}
