//! How a robot walks and stands, from contacts, forces, torques and speeds of a roll: duty factors, swings, touchdowns, power, torque
//! reserve, each against a bound. The score that chooses the policy of a training, `qv walk score` and the pages share it.

use serde::{Deserialize, Serialize};

/// Time after a change of the command that does not count \[s\].
const SETTLING: f32 = 1.0;
/// A time without force that is shorter is a bounce and no swing \[s\].
const BOUNCE: f32 = 0.03;
/// Time after a landing in which its peak force is looked for \[s\].
const IMPACT: f32 = 0.1;
/// Share of the time that torques stay below what the reserve is measured by.
const MOSTLY: f32 = 0.99;
/// Height of the Go2's base in its stand \[m\]: times of swings scale with the square root of heights (Alexander 1989, dynamic similarity).
const HEIGHT: f32 = 0.32;

/// What a robot did in one decision, of one robot.
#[derive(Debug, Clone, Copy)]
pub struct GaitSample<'a> {
    /// Forwards, to the left \[m/s\], turning \[rad/s\].
    pub command: [f32; 3],
    /// Velocity of the base in its heading's axes: forwards, to the left \[m/s\], turning \[rad/s\].
    pub velocity: [f32; 3],
    /// Peak force of the ground on each foot since the last sample, upwards \[N\].
    pub peaks: &'a [f32],
    /// Which feet touch the ground.
    pub touching: &'a [bool],
    /// Joint torques \[N m\].
    pub torques: &'a [f32],
    /// Joint speeds \[rad/s\].
    pub speeds: &'a [f32],
}

/// What a meter must know of a robot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GaitScale {
    /// Time between samples \[s\].
    pub dt: f32,
    /// Mass \[kg\].
    pub mass: f32,
    /// Height of the base in the stand \[m\].
    pub height: f32,
    /// Largest torque of each joint \[N m\]; `None` where the model states none.
    pub efforts: Vec<Option<f32>>,
}

/// One foot under commands to move.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FootGait {
    /// Share of time on the ground.
    pub duty: f32,
    /// Mean time of a whole swing \[s\]; `None` of none.
    pub swing: Option<f32>,
    /// Mean of the peak forces of its landings, in body weights; `None` of none.
    pub touchdown: Option<f32>,
}

/// How a robot walks and stands.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Gait {
    /// One for each foot; none where nothing was commanded.
    pub feet: Vec<FootGait>,
    /// Largest less least duty factor.
    pub duty_spread: Option<f32>,
    /// Longest less shortest mean swing of the feet, over their mean.
    pub asymmetry: Option<f32>,
    /// Peak force that 95 % of all landings stay below, in body weights.
    pub touchdown_p95: Option<f32>,
    /// Mean of the sum of |torque x speed| under commands to move \[W\].
    pub power: Option<f32>,
    /// That power over weight and speed: the mechanical cost of transport.
    pub transport: Option<f32>,
    /// Share of the time with all feet on the ground under commands to stand.
    pub stand: Option<f32>,
    /// Mean of the sum of |torque x speed| under commands to stand \[W\].
    pub stand_power: Option<f32>,
    /// Least quotient of a joint's largest torque and the one that it stays below for 99 % of the time.
    pub torque_reserve: Option<f32>,
    /// Difference of the mean velocity from the command, the mean over commands to move \[m/s\].
    pub velocity_error: Option<f32>,
    /// The same of the turning rate \[rad/s\].
    pub turning_error: Option<f32>,
    /// Robots that fell.
    pub fell: usize,
    /// Mass of the robot \[kg\].
    pub mass: f32,
    /// Height of the base in the stand \[m\].
    pub height: f32,
}

/// One foot as it is measured.
#[derive(Debug, Clone, Default)]
struct FootLog {
    on: usize,
    swings: Vec<f32>,
    peaks: Vec<f32>,
    /// Decisions in the air; `None` for a swing whose beginning was not seen.
    air: Option<usize>,
    was_on: bool,
    /// Decisions in which the peak of the last landing is still looked for.
    landing: usize,
}

/// Measures the gait of one robot, sample by sample; meters of several robots of one kind can be joined.
#[derive(Debug, Clone)]
pub struct GaitMeter {
    scale: GaitScale,
    feet: Vec<FootLog>,
    torques: Vec<Vec<f32>>,
    command: Option<[f32; 3]>,
    since: usize,
    /// Samples, sums of power and of speed, under commands to move.
    moving: [f64; 3],
    /// Samples, those with all feet on the ground, sum of power, under commands to stand.
    standing: [f64; 3],
    /// Samples and sums of velocities under the present command to move.
    present: [f64; 4],
    /// Errors of mean velocities and turning rates under commands before.
    errors: Vec<[f32; 2]>,
    fell: usize,
}

impl GaitMeter {
    /// Of a robot with so many feet.
    pub fn new(scale: &GaitScale, feet: usize) -> Self {
        Self {
            torques: vec![Vec::new(); scale.efforts.len()],
            scale: scale.clone(),
            feet: vec![FootLog::default(); feet],
            command: None,
            since: 0,
            moving: [0.0; 3],
            standing: [0.0; 3],
            present: [0.0; 4],
            errors: Vec::new(),
            fell: 0,
        }
    }

    /// Notes that the robot fell: samples of a robot that lies are nobody's gait.
    pub fn note_fall(&mut self) {
        self.fell += 1;
    }

    /// The next sample.
    pub fn add(&mut self, sample: &GaitSample) {
        if self.command != Some(sample.command) {
            self.errors.extend(self.present_error());
            self.present = [0.0; 4];
            self.command = Some(sample.command);
            self.since = 0;
        }
        self.since += 1;
        if (self.since as f32) * self.scale.dt <= SETTLING {
            for (foot, touches) in self.feet.iter_mut().zip(sample.touching) {
                (foot.air, foot.was_on, foot.landing) = (None, *touches, 0);
            }
            return;
        }
        let power: f32 = sample.torques.iter().zip(sample.speeds).map(|(t, w)| (t * w).abs()).sum();
        if sample.command == [0.0; 3] {
            let all = f64::from(u8::from(sample.touching.iter().all(|on| *on)));
            add_to(&mut self.standing, [1.0, all, f64::from(power)]);
            return;
        }
        let [vx, vy, wz] = sample.velocity;
        add_to(&mut self.moving, [1.0, f64::from(power), f64::from(vx.hypot(vy))]);
        add_to(&mut self.present, [1.0, f64::from(vx), f64::from(vy), f64::from(wz)]);
        self.torques.iter_mut().zip(sample.torques).for_each(|(all, torque)| all.push(torque.abs()));
        let weight = self.scale.mass * qv_core::GRAVITY as f32;
        for ((foot, &touches), peak) in self.feet.iter_mut().zip(sample.touching).zip(sample.peaks) {
            foot.add(touches, peak / weight, self.scale.dt);
        }
    }

    /// Error of the mean velocity and of the mean turning rate under the present command.
    fn present_error(&self) -> Option<[f32; 2]> {
        let [samples, vx, vy, wz] = self.present;
        let command = self.command.filter(|_| samples > 0.0)?;
        let [vx, vy, wz] = [vx, vy, wz].map(|sum| (sum / samples) as f32);
        Some([(vx - command[0]).hypot(vy - command[1]), (wz - command[2]).abs()])
    }

    /// Joins errors and falls of another meter, and nothing of its gait.
    pub fn join_errors(&mut self, other: &Self) {
        self.errors.extend(other.errors.iter().copied().chain(other.present_error()));
        self.fell += other.fell;
    }

    /// Joins what another meter of the same kind of robot measured.
    pub fn join(&mut self, other: Self) {
        self.join_errors(&other);
        add_to(&mut self.moving, other.moving);
        add_to(&mut self.standing, other.standing);
        self.torques.iter_mut().zip(other.torques).for_each(|(all, more)| all.extend(more));
        for (foot, more) in self.feet.iter_mut().zip(other.feet) {
            foot.on += more.on;
            foot.swings.extend(more.swings);
            foot.peaks.extend(more.peaks);
        }
    }

    /// The figures.
    pub fn gait(&self) -> Gait {
        let [samples, power, speed] = self.moving;
        let weight = f64::from(self.scale.mass) * qv_core::GRAVITY;
        let moves = samples > 0.0;
        let feet: Vec<FootGait> = self.feet.iter().filter(|_| moves).map(|foot| foot.gait(samples as f32)).collect();
        let peaks: Vec<f32> = self.feet.iter().flat_map(|foot| foot.peaks.iter().copied()).collect();
        let swings: Option<Vec<f32>> = feet.iter().map(|foot| foot.swing).collect();
        let swings = swings.filter(|swings| !swings.is_empty());
        let [still, all, stand_power] = self.standing;
        let errors: Vec<[f32; 2]> = self.errors.iter().copied().chain(self.present_error()).collect();
        let error = |k: usize| mean(&errors.iter().map(|error| error[k]).collect::<Vec<f32>>());
        let reserve = self.torques.iter().zip(&self.scale.efforts).filter_map(|(torques, effort)| {
            let most = quantile(torques, MOSTLY)?;
            effort.filter(|_| most > 0.0).map(|effort| effort / most)
        });
        Gait {
            duty_spread: spread(feet.iter().map(|foot| foot.duty)),
            asymmetry: swings.and_then(|s| Some(spread(s.iter().copied())? / (s.iter().sum::<f32>() / s.len() as f32))),
            touchdown_p95: quantile(&peaks, 0.95),
            power: moves.then(|| (power / samples) as f32),
            transport: (speed > 0.0).then(|| (power / (weight * speed)) as f32),
            stand: (still > 0.0).then(|| (all / still) as f32),
            stand_power: (still > 0.0).then(|| (stand_power / still) as f32),
            torque_reserve: reserve.reduce(f32::min),
            velocity_error: error(0),
            turning_error: error(1),
            fell: self.fell,
            mass: self.scale.mass,
            height: self.scale.height,
            feet,
        }
    }
}

impl FootLog {
    fn add(&mut self, touches: bool, peak: f32, dt: f32) {
        self.on += usize::from(touches);
        match (self.was_on, touches, self.air) {
            (true, false, _) => self.air = Some(1),
            (false, false, Some(air)) => self.air = Some(air + 1),
            (false, true, Some(air)) => {
                if air as f32 * dt > BOUNCE {
                    self.swings.push(air as f32 * dt);
                    self.peaks.push(0.0);
                    self.landing = (IMPACT / dt).round() as usize;
                }
                self.air = None;
            }
            _ => {}
        }
        if let Some(last) = self.peaks.last_mut().filter(|_| self.landing > 0) {
            *last = last.max(peak);
            self.landing -= 1;
        }
        self.was_on = touches;
    }

    fn gait(&self, samples: f32) -> FootGait {
        FootGait { duty: self.on as f32 / samples, swing: mean(&self.swings), touchdown: mean(&self.peaks) }
    }
}

fn add_to<const N: usize>(sums: &mut [f64; N], more: [f64; N]) {
    sums.iter_mut().zip(more).for_each(|(sum, x)| *sum += x);
}

fn mean(values: &[f32]) -> Option<f32> {
    (!values.is_empty()).then(|| values.iter().sum::<f32>() / values.len() as f32)
}

/// Largest less least; `None` of nothing.
fn spread(values: impl Iterator<Item = f32>) -> Option<f32> {
    let ends = values.fold(None, |ends: Option<[f32; 2]>, x| Some(ends.map_or([x; 2], |[a, b]| [a.min(x), b.max(x)])));
    ends.map(|[low, high]| high - low)
}

/// The value that a share of all lies below; `None` of nothing.
fn quantile(values: &[f32], share: f32) -> Option<f32> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    sorted.get(((sorted.len() as f32 * share) as usize).min(sorted.len().saturating_sub(1))).copied()
}

/// One figure of a gait against its bound.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    /// What, with the foot where it is one's.
    pub quantity: String,
    /// The figure; `None` where nothing was measured, which fails.
    pub value: Option<f32>,
    /// Least and greatest that pass.
    pub bound: [f32; 2],
    /// Unit of both.
    pub unit: &'static str,
    /// Where the bound comes from.
    pub source: &'static str,
}

impl Check {
    /// Whether the figure is within its bound.
    pub fn passes(&self) -> bool {
        self.value.is_some_and(|x| x >= self.bound[0] && x <= self.bound[1])
    }

    /// How far the figure is outside, as a share of the bound, at most 2.
    pub fn excess(&self) -> f32 {
        let Some(x) = self.value else { return 2.0 };
        let [low, high] = self.bound;
        let outside =
            if x < low { (low - x) / low.abs().max(1e-3) } else { (x - high).max(0.0) / high.abs().max(1e-3) };
        outside.min(2.0)
    }

    /// The bound in words.
    pub fn bound_text(&self) -> String {
        match self.bound {
            [low, f32::INFINITY] => format!(">= {low:.2}"),
            [f32::NEG_INFINITY, high] => format!("<= {high:.2}"),
            [low, high] => format!("{low:.2} to {high:.2}"),
        }
    }
}

const TROT: &str = "trots of quadrupeds have duty factors from 0.5 on (Hildebrand 1965); 0.65 leaves time to swing";
const EVEN: &str =
    "a robot that is its own mirror image has equal legs; a public policy of a 15 kg robot (DLS Lab) has 0.06";
const SWINGS: &str = "the same public policy: 0.29 to 0.33 s; scaled with the square root of the height";
const SYMMETRY: &str = "symmetry index of 10 % (Robinson et al. 1987)";
const SOFT: &str = "the same public policy: 0.8 to 1.6 body weights";
const COST: &str = "45 W at 0.5 m/s for 15.2 kg; the same public policy: 34 W";
const STILL: &str = "a stand holds itself by friction and gains; 3 W for 15 kg";
const TRACKING: &str = "0.07 m/s is a drift of 0.28 m in 4 s";
const FALLS: &str = "a robot that falls in simulation falls on the ground";
const SPARE: &str = "half of the torque is left for a stumble";

impl Gait {
    /// All figures against their bounds; `feet` are the names of the feet.
    pub fn checks(&self, feet: &[String]) -> Vec<Check> {
        let most = f32::INFINITY;
        let time = (self.height / HEIGHT).sqrt();
        let check = |quantity: String, value, bound, unit, source| Check { quantity, value, bound, unit, source };
        let mut out = Vec::new();
        for (k, name) in feet.iter().enumerate() {
            let foot = self.feet.get(k);
            out.push(check(format!("duty factor of {name}"), foot.map(|f| f.duty), [0.5, 0.65], "", TROT));
            let swing = foot.and_then(|f| f.swing);
            out.push(check(format!("swing of {name}"), swing, [0.25 * time, 0.35 * time], "s", SWINGS));
            let peak = foot.and_then(|f| f.touchdown);
            out.push(check(format!("touchdown of {name}"), peak, [-most, 1.5], "body weights", SOFT));
        }
        let transport = 45.0 / (15.2 * qv_core::GRAVITY as f32 * 0.5);
        let stand_power = self.stand_power.map(|power| power / self.mass.max(1e-6));
        for (quantity, value, bound, unit, source) in [
            ("spread of the duty factors", self.duty_spread, [-most, 0.06], "", EVEN),
            ("asymmetry of the swings", self.asymmetry, [-most, 0.1], "", SYMMETRY),
            ("touchdown, 95th percentile", self.touchdown_p95, [-most, 2.0], "body weights", SOFT),
            ("cost of transport", self.transport, [-most, transport], "", COST),
            ("four-foot stand", self.stand, [0.98, most], "of the time", STILL),
            ("power of the stand", stand_power, [-most, 0.2], "W/kg", STILL),
            ("error of the mean velocity", self.velocity_error, [-most, 0.07], "m/s", TRACKING),
            ("error of the mean turning rate", self.turning_error, [-most, 0.05], "rad/s", TRACKING),
            ("falls", Some(self.fell as f32), [-most, 0.0], "", FALLS),
            ("torque reserve", self.torque_reserve, [2.0, most], "", SPARE),
        ] {
            out.push(check(quantity.into(), value, bound, unit, source));
        }
        out
    }

    /// One number to compare gaits by, less is better: the sum of what figures are outside of their bounds, as shares, for a foot on average.
    pub fn cost(&self) -> f32 {
        let names: Vec<String> = (0..self.feet.len().max(1)).map(|k| k.to_string()).collect();
        let own = 3 * names.len();
        let excess: Vec<f32> = self.checks(&names).iter().map(Check::excess).collect();
        excess[..own].iter().sum::<f32>() / names.len() as f32 + excess[own..].iter().sum::<f32>()
    }
}

/// `fit to try on hardware: yes`, or no with the checks that fail, the worst first.
pub fn verdict(checks: &[Check]) -> String {
    let mut failed: Vec<&Check> = checks.iter().filter(|check| !check.passes()).collect();
    failed.sort_by(|a, b| b.excess().total_cmp(&a.excess()));
    if failed.is_empty() {
        return "fit to try on hardware: yes".into();
    }
    let reasons = failed.iter().map(|check| {
        let value = check.value.map_or("not measured".into(), |x| format!("{x:.2}"));
        format!("{} {value} ({})", check.quantity, check.bound_text())
    });
    format!("fit to try on hardware: no, because {}", reasons.collect::<Vec<_>>().join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A trot of 0.5 s with swings of 0.22 s, or of a shorter one of the first foot.
    fn trot(short: usize) -> Gait {
        let scale = GaitScale { dt: 0.02, mass: 15.0, height: 0.32, efforts: vec![Some(20.0)] };
        let mut meter = GaitMeter::new(&scale, 4);
        for step in 0..500 {
            let command = if step < 400 { [0.5, 0.0, 0.0] } else { [0.0; 3] };
            let phase = |foot: usize| (step + if foot == 1 || foot == 2 { 12 } else { 0 }) % 25;
            let touching: Vec<bool> =
                (0..4).map(|f| step >= 400 || phase(f) >= if f == 0 { short } else { 11 }).collect();
            let peaks: Vec<f32> = touching.iter().map(|on| if *on { 147.0 } else { 0.0 }).collect();
            meter.add(&GaitSample {
                command,
                velocity: [0.5, 0.0, 0.0],
                peaks: &peaks,
                touching: &touching,
                torques: &[5.0],
                speeds: &[if step < 400 { 4.0 } else { 0.0 }],
            });
        }
        meter.gait()
    }

    #[test]
    fn a_known_trot_has_the_known_figures() {
        let gait = trot(11);
        for foot in &gait.feet {
            assert!((foot.duty - 0.56).abs() < 0.01 && (foot.swing.unwrap() - 0.22).abs() < 1e-5, "{foot:?}");
            assert!((foot.touchdown.unwrap() - 147.0 / (15.0 * 9.81)).abs() < 1e-3);
        }
        assert!(gait.duty_spread.unwrap() < 0.01 && gait.asymmetry.unwrap() < 1e-4);
        assert_eq!((gait.stand, gait.stand_power, gait.torque_reserve), (Some(1.0), Some(0.0), Some(4.0)));
        assert!((gait.power.unwrap() - 20.0).abs() < 1e-3);
        assert!((gait.transport.unwrap() - 20.0 / (15.0 * 9.81 * 0.5)).abs() < 1e-3);
    }

    #[test]
    fn a_limp_is_named_and_costs() {
        let (even, limp) = (trot(13), trot(4));
        assert!(limp.cost() > even.cost() + 1.0);
        let names = ["FL", "FR", "RL", "RR"].map(String::from);
        let text = verdict(&limp.checks(&names));
        assert!(text.starts_with("fit to try on hardware: no") && text.contains("duty factor of FL"), "{text}");
        assert!(text.contains("spread of the duty factors"), "{text}");
    }

    #[test]
    fn nothing_measured_is_not_fit() {
        let empty = GaitMeter::new(&GaitScale { dt: 0.02, mass: 15.0, height: 0.3, efforts: Vec::new() }, 4).gait();
        assert!(empty.feet.is_empty() && empty.cost() > 10.0);
        assert!(verdict(&empty.checks(&["a".into()])).contains("not measured"));
    }
}
