//! A servo whose position alone is recorded: its joint simulated over a whole recording, the other joints on their measured paths.
//!
//! ```text
//! (M + I) dv = u - G - K (x - q) - b v - d v |v| - f sign(v) - o - k x
//! T dw = s clip(kp (c(t - lag) - x) + tau_ff, tau_max) + s kd (dc - v) - w,   u = clip(w, cap)
//! f = fc + fs S + mu L,   S = exp(-|v| / vs)
//! ```
//!
//! `G` (gravity and coupling), `M = M_jj` and `K = dG_j / dq_j` are taken along the measured path `q` and linear in the links' parameters. Friction is
//! a proximal step, so that it sticks exactly (Moreau 1988; Acary and Brogliato 2008): `v <- soft(v*, h f / D)`. Its load-dependent part decides: with
//! Coulomb and viscous friction alone an added mass is taken for a spring (Duclusaud et al., arXiv 2410.08650).

/// Load `L` that presses on the gear.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LoadForm {
    /// No load.
    None,
    /// Of gravity and coupling, at low speeds.
    StaticExternal,
    /// Of gravity and coupling.
    External,
    /// Of the motor.
    Motor,
    /// Of the motor, at low speeds.
    StaticMotor,
}

/// All forms; the first that predicts as well as another is taken.
pub(crate) const FORMS: [LoadForm; 5] =
    [LoadForm::StaticExternal, LoadForm::External, LoadForm::Motor, LoadForm::StaticMotor, LoadForm::None];

/// Parameters of servos beside those that every robot has.
#[derive(Debug, Clone)]
pub(crate) struct Servos {
    pub form: LoadForm,
    /// Shape `[joints]` each.
    pub stribeck: Vec<f64>,
    pub load: Vec<f64>,
    pub offset: Vec<f64>,
    pub spring: Vec<f64>,
    /// Quadratic drag \[N m s²/rad²\].
    pub drag: Vec<f64>,
    /// Factors of the limits of the position's part.
    pub clip: Vec<f64>,
    /// Time constant of a low-pass filter of commanded positions \[s\], and reciprocal of the limit of their rate \[s/rad\], 0 without one.
    pub smoothing: Vec<f64>,
    pub slew: Vec<f64>,
    /// Greatest torques of the motors \[N m\], and delays of reported positions \[s\].
    pub cap: Vec<f64>,
    pub late: Vec<f64>,
    /// Usual top speeds in the references \[rad/s\].
    pub top: Vec<f64>,
    /// What links have beyond the model, shape `[links * 10]`.
    pub inertial: Vec<f64>,
}

/// Parameters of a joint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ServoJoint {
    pub coulomb: f64,
    pub stribeck: f64,
    /// It may take from the damping of the motor \[N m s/rad\].
    pub viscous: f64,
    pub load: f64,
    /// Torque that the motor needs beyond the rest \[N m\].
    pub offset: f64,
    pub armature: f64,
    pub spring: f64,
    pub drag: f64,
    pub kp: f64,
    pub kd: f64,
    pub strength: f64,
    /// \[s\]
    pub latency: f64,
    pub lag: f64,
    pub bias: f64,
    pub smoothing: f64,
    pub slew: f64,
    /// Delay of the reported positions \[s\]. The path, which is as late, carries the joint: it moves as if commands were late.
    pub late: f64,
    /// Limit of the position's part \[N m\], of the motor's torque, and speed of Stribeck's friction \[rad/s\].
    pub limit: f64,
    pub cap: f64,
    pub turn: f64,
    pub form: LoadForm,
}

/// What a joint is driven and loaded by, on the instants of its recording.
pub(crate) struct Drive<'a> {
    /// Between instants \[s\], and steps in it.
    pub step: f64,
    pub substeps: usize,
    /// Measured positions without the encoder's bias, and gravity and coupling, inertia, and slope of gravity there; shape `[instants]`.
    pub path: &'a [f64],
    pub carried: &'a [f64],
    pub inertia: &'a [f64],
    pub slope: &'a [f64],
    /// Position, speed and torque that are commanded, from the start of the recording on, at every step of the simulation.
    pub commands: [&'a [f64]; 3],
    /// Position and speed at the start.
    pub start: [f64; 2],
}

/// Positions of a joint at each instant \[rad\] as its encoder reports them, and the torque that its motor is asked for after each
/// \[N m\], without its sign.
pub(crate) fn simulate(joint: &ServoJoint, drive: &Drive) -> (Vec<f64>, Vec<f64>) {
    let h = drive.step / drive.substeps as f64;
    let late = (joint.latency + joint.late) / h;
    let count = drive.path.len();
    let [mut x, mut v] = drive.start;
    let follow = qv_sim::lag_gain(h, joint.lag);
    let mut lagged: Option<f64> = None;
    let mut turned = Vec::with_capacity(count);
    let mut torques = Vec::with_capacity(count);
    for t in 0..count {
        turned.push(x + joint.bias);
        torques.push(0.0f64);
        let next = (t + 1).min(count - 1);
        for k in 0..drive.substeps {
            let part = k as f64 / drive.substeps as f64;
            let between = |of: &[f64]| of[t] + part * (of[next] - of[t]);
            let [c, dc, ahead] = drive.commands.map(|of| delayed(of, (t * drive.substeps + k) as f64 - late));
            let carried = between(drive.carried);
            // Less inertia than a step can follow runs away.
            let inertia = (between(drive.inertia) + joint.armature).max(h * h * joint.strength * joint.kp);
            let pull = (joint.kp * (c - x - joint.bias) + ahead).clamp(-joint.limit, joint.limit);
            let load = carried + between(drive.slope) * (x - between(drive.path));
            let slow = (-v.abs() / joint.turn).exp();
            let motor = joint.strength * (pull + joint.kd * (dc - v));
            let pressed = match joint.form {
                LoadForm::None => 0.0,
                LoadForm::StaticExternal => load.abs() * slow,
                LoadForm::External => load.abs(),
                LoadForm::Motor => motor.abs(),
                LoadForm::StaticMotor => motor.abs() * slow,
            };
            let friction = joint.coulomb + joint.stribeck * slow + joint.load * pressed;
            let passive = joint.viscous + joint.drag * v.abs();
            // A motor that follows at once damps implicitly; one that lags has the torque of earlier speeds.
            let before = lagged.unwrap_or(motor);
            let now = before + follow * (motor - before);
            lagged = Some(now);
            torques[t] = torques[t].max(now.abs());
            let (torque, damping) = if joint.lag > 0.0 {
                (now.clamp(-joint.cap, joint.cap), passive.max(0.0))
            } else if motor.abs() > joint.cap {
                (motor.clamp(-joint.cap, joint.cap), passive.max(0.0))
            } else {
                (joint.strength * (pull + joint.kd * dc), (joint.strength * joint.kd + passive).max(0.0))
            };
            let torque = torque - load - joint.offset - joint.spring * x;
            let whole = inertia + h * damping;
            let free = (inertia * v + h * torque) / whole;
            v = free.signum() * (free.abs() - h * friction / whole).max(0.0);
            x += h * v;
        }
    }
    (turned, torques)
}

/// Commanded positions as the firmware of a servo passes them on: low-pass filtered, then limited in rate; `step` is between samples \[s\].
pub(crate) fn shaped(commands: &[f64], joint: &ServoJoint, step: f64) -> Vec<f64> {
    let share = qv_sim::lag_gain(step, joint.smoothing);
    let most = if joint.slew > 0.0 { step / joint.slew } else { f64::INFINITY };
    let mut smooth = commands.first().copied().unwrap_or(0.0);
    let mut out = smooth;
    commands
        .iter()
        .map(|c| {
            smooth += share * (c - smooth);
            out += (smooth - out).clamp(-most, most);
            out
        })
        .collect()
}

/// A series at a place between its samples, held at both ends.
fn delayed(of: &[f64], place: f64) -> f64 {
    let last = of.len() - 1;
    if place <= 0.0 {
        return of[0];
    }
    let low = (place as usize).min(last);
    let high = (low + 1).min(last);
    of[low] + (place - low as f64).min(1.0) * (of[high] - of[low])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joint() -> ServoJoint {
        ServoJoint {
            coulomb: 0.0,
            stribeck: 0.0,
            viscous: 0.0,
            load: 0.0,
            offset: 0.0,
            armature: 0.02,
            spring: 0.0,
            drag: 0.0,
            kp: 20.0,
            kd: 0.4,
            strength: 1.0,
            latency: 0.0,
            lag: 0.0,
            bias: 0.0,
            smoothing: 0.0,
            slew: 0.0,
            late: 0.0,
            limit: f64::INFINITY,
            cap: f64::INFINITY,
            turn: 0.1,
            form: LoadForm::None,
        }
    }

    fn moved(joint: &ServoJoint, load: f64) -> Vec<f64> {
        moved_by(joint, load, &[0.3; 4000])
    }

    fn moved_by(joint: &ServoJoint, load: f64, moving: &[f64]) -> Vec<f64> {
        let zeros = vec![0.0; 400];
        let still = vec![0.0; 4000];
        let drive = Drive {
            step: 0.01,
            substeps: 10,
            path: &zeros,
            carried: &vec![load; 400],
            inertia: &vec![0.03; 400],
            slope: &zeros,
            commands: [moving, &still, &still],
            start: [0.0; 2],
        };
        simulate(joint, &drive).0
    }

    #[test]
    fn a_step_is_that_of_an_oscillator() {
        // 0.05 x'' + 0.4 x' + 20 (x - 0.3) = 0.
        let all = moved(&joint(), 0.0);
        let (w, d): (f64, f64) = (20.0, 4.0);
        let natural = (w * w - d * d).sqrt();
        for k in [5usize, 20, 60] {
            let t = 0.01 * k as f64;
            let exact = 0.3 * (1.0 - (-d * t).exp() * ((natural * t).cos() + d / natural * (natural * t).sin()));
            assert!((all[k] - exact).abs() < 6e-3, "{t}: {} {exact}", all[k]);
        }
    }

    #[test]
    fn friction_sticks_exactly_where_the_servo_cannot_break_it_away() {
        let stuck = ServoJoint { coulomb: 7.0, ..joint() };
        assert!(moved(&stuck, 0.0).iter().all(|x| *x == 0.0));
        // It comes to rest within the band of friction about where the load would hold it.
        let slack = ServoJoint { coulomb: 1.0, ..joint() };
        let rest = moved(&slack, 2.0)[399];
        assert!((rest - (0.3 - 2.0 / 20.0)).abs() <= 1.0 / 20.0 + 1e-9, "{rest}");
    }

    #[test]
    fn drag_brakes_fast_motion_and_a_lag_delays_the_torque() {
        let plain = moved(&joint(), 0.0);
        let braked = moved(&ServoJoint { drag: 0.5, ..joint() }, 0.0);
        // The motor has the torque of its first command from the start: the step comes after 0.1 s.
        let step: Vec<f64> = (0..4000).map(|k| if k < 100 { 0.0 } else { 0.3 }).collect();
        // A lag takes kp times itself from the damping, 0.4 of 1.2 N m s/rad.
        let prompt = moved_by(&ServoJoint { kd: 1.2, ..joint() }, 0.0, &step);
        let late = moved_by(&ServoJoint { kd: 1.2, lag: 0.02, ..joint() }, 0.0, &step);
        assert!(braked[8] < plain[8] - 1e-3 && (braked[399] - 0.3).abs() < 1e-3, "{} {}", braked[8], plain[8]);
        assert!(late[12] < 0.6 * prompt[12] && (late[399] - 0.3).abs() < 1e-2, "{} {}", late[12], prompt[12]);
    }

    #[test]
    fn a_cap_bounds_the_acceleration() {
        let plain = moved(&joint(), 0.0);
        // 1 N m on 0.05 kg m²: 20 rad/s² at most.
        let capped = moved(&ServoJoint { cap: 1.0, ..joint() }, 0.0);
        assert!((capped[5] - 0.5 * 20.0 * 0.05 * 0.05).abs() < 2e-3, "{}", capped[5]);
        assert!((capped[399] - 0.3).abs() < 1e-3 && plain[5] > 1.5 * capped[5]);
    }

    #[test]
    fn shaped_commands_lag_and_keep_to_their_rate() {
        let step = vec![0.0; 10].into_iter().chain(vec![1.0; 400]).collect::<Vec<f64>>();
        let limited = shaped(&step, &ServoJoint { slew: 0.5, ..joint() }, 0.01);
        assert!(
            (limited[59] - 1.0).abs() < 1e-9 && (limited[34] - 0.5).abs() < 1e-9,
            "{} {}",
            limited[34],
            limited[59]
        );
        let smooth = shaped(&step, &ServoJoint { smoothing: 0.5, ..joint() }, 0.01);
        assert!((smooth[59] - (1.0 - (-1.0f64).exp())).abs() < 1e-9, "{}", smooth[59]);
        assert_eq!(shaped(&step, &joint(), 0.01), step);
    }

    #[test]
    fn load_friction_grows_with_the_load() {
        let pressed = ServoJoint { load: 0.9, form: LoadForm::StaticExternal, ..joint() };
        // It starts against 6 N m with 6 N m of the servo less the load, and stays for it.
        let all = moved(&pressed, 5.0);
        assert!(all.iter().all(|x| *x == 0.0), "{}", all[399]);
        assert!(moved(&joint(), 5.0)[399] > 0.04);
    }
}
