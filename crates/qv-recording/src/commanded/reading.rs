//! How commands are read that were logged in another convention: as `run.toml` states it, or as it was found.

use super::shape::Shape;
use crate::run::{Commands, Run};
use qv_core::JointSeries;

/// How the commands of one joint are read: `scale` times those logged of joint `of`, plus `offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointReading {
    /// Whose commands they are.
    pub of: usize,
    /// Factor, such as -1 or π/180.
    pub scale: f64,
    /// What is added then \[rad\].
    pub offset: f64,
}

/// How all commands of a run are read.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandReading {
    /// Of each joint, shape `[n]`.
    pub joints: Vec<JointReading>,
    /// Added to the stamps of commands \[s\].
    pub delay: f64,
    /// Factors on the gains.
    pub gain_scale: [f64; 2],
    /// Velocity gains in place of those logged \[N m s/rad\].
    pub damping: Option<f64>,
    /// Whether the motors follow the feed-forward torques.
    pub uses_feed_forward: bool,
    /// What firmware does to the commanded positions.
    pub shape: Option<Shape>,
}

impl CommandReading {
    /// As they were logged.
    pub fn plain(joints: usize) -> Self {
        Self {
            joints: (0..joints).map(|of| JointReading { of, scale: 1.0, offset: 0.0 }).collect(),
            delay: 0.0,
            gain_scale: [1.0; 2],
            damping: None,
            uses_feed_forward: true,
            shape: None,
        }
    }

    /// Whether it changes nothing.
    pub fn is_plain(&self) -> bool {
        *self == Self::plain(self.joints.len())
    }

    /// Reads the commands of `run` so.
    pub fn apply(&self, run: &mut Run) {
        let gains = &mut run.actuator;
        gains.kp = gains.kp.map(|kp| kp * self.gain_scale[0]);
        gains.kd = self.damping.or(gains.kd.map(|kd| kd * self.gain_scale[1]));
        let Commands { position, velocity, torque, kp, kd } = &mut run.commands;
        for series in [&mut *position, &mut *velocity, &mut *torque, &mut *kp, &mut *kd].into_iter().flatten() {
            self.exchange(series);
            // Gains that `run.toml` states hold from the start on.
            if series.len() > 1 {
                series.time.iter_mut().for_each(|t| *t += self.delay);
            }
        }
        for (series, is_angle) in [(&mut *position, true), (&mut *velocity, false)] {
            let Some(series) = series else { continue };
            for row in series.values.chunks_exact_mut(series.joints) {
                for (x, joint) in row.iter_mut().zip(&self.joints) {
                    *x = *x * joint.scale + if is_angle { joint.offset } else { 0.0 };
                }
            }
        }
        let scaled = |series: &mut Option<JointSeries>, by: f64| {
            series.iter_mut().flat_map(|s| &mut s.values).for_each(|x| *x *= by);
        };
        scaled(kp, self.gain_scale[0]);
        scaled(kd, self.gain_scale[1]);
        if let (Some(kd), Some(damping)) = (kd, self.damping) {
            kd.values.fill(damping);
        }
        if !self.uses_feed_forward {
            *torque = None;
        }
        if let (Some(shape), Some(position)) = (self.shape, position) {
            *position = shape.of(position);
        }
    }

    fn exchange(&self, series: &mut JointSeries) {
        if series.joints != self.joints.len() || self.joints.iter().enumerate().all(|(k, j)| j.of == k) {
            return;
        }
        for row in series.values.chunks_exact_mut(series.joints) {
            let logged = row.to_vec();
            row.iter_mut().zip(&self.joints).for_each(|(x, joint)| *x = logged[joint.of]);
        }
    }
}
