//! What the task remembers of one robot.

use super::settings::Commands;
use qv_core::random::Xoshiro256PlusPlus;

/// One robot of the task.
#[derive(Debug, Clone)]
pub struct Walker {
    /// Its random numbers.
    pub random: Xoshiro256PlusPlus,
    /// Commanded velocity: forwards \[m/s\], to the left \[m/s\], turning \[rad/s\].
    pub command: [f32; 3],
    /// Steps until another command.
    pub command_steps: u32,
    /// Steps of the episode.
    pub steps: u32,
    /// Phase of the clock when the episode began, in strides.
    pub first_phase: f32,
    /// Steps until a push.
    pub push_steps: u32,
    /// The last action and the one before.
    pub action: Vec<f32>,
    /// See `action`.
    pub action_before: Vec<f32>,
    /// Joint speeds a step ago \[rad/s\].
    pub dq: Vec<f32>,
    /// How long each foot has been in the air \[s\]; 0 on the ground.
    pub air: Vec<f32>,
    /// How long each foot has been on the ground under a command to move \[s\]; 0 in the air.
    pub stance: Vec<f32>,
    /// Share of time that each foot is on the ground, mean over the last `duty_time`, exponentially weighted.
    pub duty: Vec<f32>,
    /// Speed of each foot downwards a step ago \[m/s\].
    pub sinking: Vec<f32>,
    /// Highest point of each foot in its swing \[m\].
    pub peak: Vec<f32>,
    /// Place of the curriculum: kind of ground and level.
    pub place: [usize; 2],
    /// Where the episode began, x and y \[m\].
    pub start: [f32; 2],
    /// Path length that the commands of this episode asked for \[m\].
    pub asked: f32,
    /// Path length that it went in this episode \[m\].
    pub went: f32,
    /// Mean difference from the command over the last `steady_time`, exponentially weighted: forwards, to the left \[m/s\], turning \[rad/s\].
    pub strayed: [f32; 3],
    /// Heights of ground under the base at the last step \[m\].
    pub ground: f32,
}

impl Walker {
    /// A robot of `joints` and `feet`.
    pub fn new(joints: usize, feet: usize) -> Self {
        Self {
            random: Xoshiro256PlusPlus::new(0),
            command: [0.0; 3],
            command_steps: 0,
            steps: 0,
            first_phase: 0.0,
            push_steps: 0,
            action: vec![0.0; joints],
            action_before: vec![0.0; joints],
            dq: vec![0.0; joints],
            air: vec![0.0; feet],
            stance: vec![0.0; feet],
            duty: vec![1.0; feet],
            sinking: vec![0.0; feet],
            peak: vec![0.0; feet],
            place: [0; 2],
            start: [0.0; 2],
            asked: 0.0,
            went: 0.0,
            strayed: [0.0; 3],
            ground: 0.0,
        }
    }

    /// Whether the command says: stand.
    pub fn stands(&self) -> bool {
        self.command == [0.0; 3]
    }

    /// Phase of a clock of so many strides a second, decisions `dt` apart: 0 to 1.
    pub fn phase(&self, clock: f32, dt: f32) -> f32 {
        // In double precision, so that a long walk's phase is exact.
        let strides = f64::from(clock) * f64::from(self.steps) * f64::from(dt) + f64::from(self.first_phase);
        strides.rem_euclid(1.0) as f32
    }

    /// Draws a command.
    pub(crate) fn draw_command(&mut self, commands: &Commands, dt: f32) {
        /// Draws until a command lies outside the gap; ranges within it have none that does.
        const DRAWS: usize = 20;
        self.command_steps = (commands.every / dt).round() as u32;
        let random = &mut self.random;
        self.command = [0.0; 3];
        if random.unit() < commands.stand {
            return;
        }
        let axis = (random.unit() < commands.single_axis).then(|| random.below(3));
        for _ in 0..DRAWS {
            self.command = [commands.vx, commands.vy, commands.wz].map(|[low, high]| random.between(low, high));
            if let Some(axis) = axis {
                (0..3).filter(|k| *k != axis).for_each(|k| self.command[k] = 0.0);
            }
            if self.command.iter().map(|x| x * x).sum::<f32>() >= commands.gap * commands.gap {
                return;
            }
        }
    }

    /// Forgets the last episode.
    pub fn begin(&mut self) {
        self.steps = 0;
        self.asked = 0.0;
        self.went = 0.0;
        self.strayed = [0.0; 3];
        for list in [&mut self.action, &mut self.action_before, &mut self.dq, &mut self.air, &mut self.peak] {
            list.fill(0.0);
        }
        [&mut self.stance, &mut self.sinking].into_iter().for_each(|list| list.fill(0.0));
        self.duty.fill(1.0);
    }
}
