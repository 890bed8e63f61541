//! A policy on a robot: `policy.onnx`, the robot's recall, and the reflex. The same as `Navigator` of `python/quadverse/navigation.py`; a test
//! compares both.

use crate::NavError;
use crate::goals::{GoalSet, colour_of, turn_hues, turn_of};
use crate::net::{COLOUR, HEIGHT, HIDDEN, SIGHT, STATE, WIDTH};
use crate::onnx::POOL;
use crate::recall::{Planar, Recall};
use crate::reflex::Reflex;
use crate::sight::{COLOURS, Rig};
use crate::task::Limits;
use glam::DVec2;
use qv_policy::onnx::{Numbers, OnnxModel};

/// Rows and columns of the camera's picture.
pub const FRAME: [usize; 2] = [POOL * HEIGHT, POOL * WIDTH];

/// Decides five times a second ([`crate::task::PERIOD`]); a new one for each cone that is to be found.
pub struct Navigator {
    model: OnnxModel,
    recall: Recall,
    reflex: Reflex,
    limits: Limits,
    /// Distance of the head before the base \[m\].
    head: f64,
    goal: [f32; COLOUR],
    /// How far the hues of frames are turned \[degrees\].
    turn: f32,
    memory: Vec<f32>,
    last: [f64; 3],
}

impl Navigator {
    /// Over the bytes of `policy.onnx`, to the goal of a colour: one of [`COLOURS`], or for a policy that takes any colour what
    /// [`colour_of`] takes.
    ///
    /// # Errors
    /// When the file is no such policy, or the colour is none of them.
    pub fn new(policy: &[u8], colour: &str) -> Result<Self, NavError> {
        let model = OnnxModel::from_bytes(policy)?;
        let (goal, turn) = if model.metadata("goal") == Some("colour") {
            (GoalSet::coloured().code(0), turn_of(colour_of(colour)?))
        } else {
            let known = COLOURS.iter().position(|name| *name == colour);
            let at = known.ok_or_else(|| NavError::value("colour", &COLOURS.join(", "), colour))?;
            (GoalSet::named().code(at), 0.0)
        };
        let recall = Recall::new(half_sides(model.metadata("half_sides").unwrap_or_default())?);
        Ok(Self {
            model,
            recall,
            reflex: Reflex::default(),
            limits: Limits::default(),
            head: Rig::default().head,
            goal,
            turn,
            memory: vec![0.0; HIDDEN],
            last: [0.0; 3],
        })
    }

    /// A command (forwards, to the left \[m/s\], turning \[rad/s\]). `frame` are bytes of [`FRAME`], red, green, blue; `gravity` is a unit vector in
    /// base axes; `odometry` is the pose since the start.
    ///
    /// # Errors
    /// When the frame has another size, a number is not finite, or the model fails. What was recalled before stays, but for the way that was gone.
    pub fn decide(&mut self, frame: &[u8], gravity: [f64; 3], odometry: Planar) -> Result<[f64; 3], NavError> {
        let expected = FRAME[0] * FRAME[1] * 3;
        if frame.len() != expected {
            return Err(NavError::value("bytes of the frame", &expected.to_string(), frame.len()));
        }
        if !(odometry.place.is_finite() && odometry.yaw.is_finite()) {
            return Err(NavError::value("odometry", "finite numbers", format!("{odometry:?}")));
        }
        self.recall.go(odometry);
        let mut state = [0.0; STATE];
        state[..COLOUR].copy_from_slice(&self.goal);
        state[COLOUR..].iter_mut().zip(gravity).for_each(|(to, x)| *to = x as f32);
        let recall = self.recall.features();
        let mut frame = frame.to_vec();
        turn_hues(&mut frame, self.turn);
        let inputs = [
            ("frame", Numbers::Bytes(&frame)),
            ("state", Numbers::Floats(&state)),
            ("recall", Numbers::Floats(&recall)),
            ("memory", Numbers::Floats(&self.memory)),
        ];
        let mut said = self.model.run(&inputs, &["command", "sight", "next_memory"])?;
        let (memory, sight, command) = (said.pop(), said.pop(), said.pop());
        let command: [f32; 3] = sized("command", command)?;
        let sight: [f32; SIGHT] = sized("sight", sight)?;
        let memory: [f32; HIDDEN] = sized("next_memory", memory)?;
        self.memory.copy_from_slice(&memory);
        let wanted = self.reflex.apply(&self.recall, self.head, &self.limits, command.map(f64::from));
        self.recall.see(&sight);
        self.last = self.limits.limited(self.last, wanted);
        Ok(self.last)
    }
}

/// An output of the model as an array.
fn sized<const N: usize>(name: &str, numbers: Option<Vec<f32>>) -> Result<[f32; N], NavError> {
    let wrong = |numbers: Vec<f32>| {
        NavError::value(&format!("policy.onnx, numbers of the output {name}"), &N.to_string(), numbers.len())
    };
    numbers.unwrap_or_default().try_into().map_err(wrong)
}

/// Two positive lengths, as the policy's file shows them.
fn half_sides(result: &str) -> Result<DVec2, NavError> {
    let wrong = || NavError::value("policy.onnx, half_sides", "two positive lengths", format!("`{result}`"));
    let sides: Vec<f64> = result.split_whitespace().map(str::parse).collect::<Result<_, _>>().map_err(|_| wrong())?;
    match sides[..] {
        [x, y] if x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite() => Ok(DVec2::new(x, y)),
        _ => Err(wrong()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::net::Net;
    use crate::onnx::to_bytes;
    use qv_core::random::Xoshiro256PlusPlus;

    fn policy(half_sides: [f64; 2]) -> Vec<u8> {
        let net = Net::default();
        let parameters = net.draw(&mut Xoshiro256PlusPlus::new(4));
        to_bytes(&net, &parameters, &Limits::default(), half_sides).unwrap()
    }

    #[test]
    fn commands_change_within_limits_and_the_same_frames_give_the_same() {
        let frame = vec![90; FRAME[0] * FRAME[1] * 3];
        let driven = || {
            let mut navigator = Navigator::new(&policy([3.0, 2.5]), "blue").unwrap();
            (0..3).map(|_| navigator.decide(&frame, [0.0, 0.0, -1.0], Planar::default()).unwrap()).collect::<Vec<_>>()
        };
        let commands = driven();
        let change = Limits::default().change;
        for (before, after) in std::iter::once(&[0.0; 3]).chain(&commands).zip(&commands) {
            assert!((0..3).all(|k| (after[k] - before[k]).abs() <= change[k] + 1e-12), "{commands:?}");
        }
        assert!(commands[0] != [0.0; 3] && commands == driven(), "{commands:?}");
    }

    #[test]
    fn what_is_no_policy_or_no_frame_is_named() {
        let said = |policy: &[u8], colour: &str| Navigator::new(policy, colour).err().unwrap().to_string();
        assert!(said(&policy([3.0, 2.5]), "green").states("colour"));
        assert!(said(&policy([3.0, -1.0]), "red").states("half_sides `3 -1`"));
        assert!(said(b"policy", "red").states("ONNX"));
        let mut navigator = Navigator::new(&policy([3.0, 2.5]), "red").unwrap();
        let frame = vec![90; FRAME[0] * FRAME[1] * 3];
        let down = [0.0, 0.0, -1.0];
        let short = navigator.decide(&frame[1..], down, Planar::default()).unwrap_err().to_string();
        assert!(short.states("921600 921600 921599"), "{short}");
        let nowhere = Planar { place: DVec2::new(f64::NAN, 0.0), yaw: 0.0 };
        assert!(navigator.decide(&frame, down, nowhere).unwrap_err().to_string().contains("odometry"));
        let bad = navigator.decide(&frame, [0.0, f64::NAN, -1.0], Planar::default()).unwrap_err().to_string();
        assert!(bad.states("`state`"), "{bad}");
    }
}
