//! Gains that a recording does not state, from its torques.

use crate::run::{ActuatorKind, Run};
use qv_core::JointSeries;

/// Share of the torque's variance that gains must explain: what is left is friction in the motors, noise, and limits.
const EXPLAINED: f64 = 0.95;
/// Samples that two numbers need not to be a chance.
const LEAST: usize = 50;

/// Fits `torque = kp (q_des - q) - kd dq` by least squares to each joint of a run that has commanded positions and measured
/// torques and states no gains, and makes them the run's, where they explain 95 % of the torque of every joint. Reports either way.
pub(crate) fn from_torques(run: &mut Run) {
    let c = &run.commands;
    let states_gains = c.kp.is_some() || c.kd.is_some() || run.actuator.kp.is_some() || c.torque.is_some();
    let (Some(target), Some(position), Some(torque)) = (&c.position, &run.measured.position, &run.measured.torque)
    else {
        return;
    };
    if states_gains || run.actuator.kind != ActuatorKind::Pd {
        return;
    }
    // A command with the stamp of a torque may be what made it or what follows from it: what explains more is so.
    let fits = |counts_at_once: bool| -> Vec<Option<Fit>> {
        let speed = run.measured.velocity.as_ref();
        let one = |j| fit(target, position, speed, torque, counts_at_once, j);
        (0..run.joint_names.len()).map(one).collect()
    };
    let explained = |fits: &[Option<Fit>]| fits.iter().map(|f| f.map_or(0.0, |f| f.explained)).sum::<f64>();
    let (at_once, later) = (fits(true), fits(false));
    let fits = if explained(&later) > explained(&at_once) { later } else { at_once };
    let Some(start) = target.time.first().copied() else { return };
    let good = |f: &Option<Fit>| f.filter(|f| f.explained >= EXPLAINED && f.kp > 0.0 && f.kd >= 0.0);
    let Some(all) = fits.iter().map(good).collect::<Option<Vec<Fit>>>() else {
        let worst = fits.iter().zip(&run.joint_names).min_by(|(a, _), (b, _)| {
            let share = |f: &Option<Fit>| f.map_or(-1.0, |f| f.explained);
            share(a).total_cmp(&share(b))
        });
        if let Some((fit, name)) = worst {
            let share = fit.map_or(0.0, |f| 100.0 * f.explained);
            run.remarks.push(format!(
                "no message states gains, and the torques do not report them: of `{name}` they would explain {share:.0} %"
            ));
        }
        return;
    };
    let series = |of: fn(&Fit) -> f64| JointSeries::new(vec![start], all.iter().map(of).collect(), all.len()).ok();
    (run.commands.kp, run.commands.kd) = (series(|f| f.kp), series(|f| f.kd));
    let range = |of: fn(&Fit) -> f64| {
        let all = all.iter().map(of);
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        format!("{low:.3} to {high:.3}")
    };
    run.remarks.push(format!(
        "no message states gains: those that the torques report are used, kp {}, kd {}",
        range(|f| f.kp),
        range(|f| f.kd)
    ));
}

#[derive(Debug, Clone, Copy)]
struct Fit {
    kp: f64,
    kd: f64,
    explained: f64,
}

fn fit(
    target: &JointSeries,
    q: &JointSeries,
    dq: Option<&JointSeries>,
    torque: &JointSeries,
    counts_at_once: bool,
    joint: usize,
) -> Option<Fit> {
    let at = |series: &JointSeries, time: f64| series.index_at(time).map(|i| (series.time[i], series.row(i)[joint]));
    // Normal equations of error and speed against torque.
    let (mut ee, mut ev, mut vv, mut et, mut vt, mut tt, mut count) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0usize);
    for (i, &time) in torque.time.iter().enumerate() {
        let t = torque.row(i)[joint];
        // Of the same instant: a position that is older would be another one.
        let position = at(q, time).filter(|(stamp, _)| *stamp == time).map(|(_, x)| x);
        let speed = dq.map_or(Some(0.0), |dq| at(dq, time).filter(|(stamp, _)| *stamp == time).map(|(_, x)| x));
        let before = target.index_at(time).filter(|&i| counts_at_once || target.time[i] < time);
        let before = before.or_else(|| target.index_at(time)?.checked_sub(1)).map(|i| target.row(i)[joint]);
        let (Some(position), Some(speed), Some(target)) = (position, speed, before) else { continue };
        let (error, speed) = (target - position, -speed);
        if !(error.is_finite() && speed.is_finite() && t.is_finite()) {
            continue;
        }
        ee += error * error;
        ev += error * speed;
        vv += speed * speed;
        et += error * t;
        vt += speed * t;
        tt += t * t;
        count += 1;
    }
    let determinant = ee * vv - ev * ev;
    let (kp, kd) = if determinant > 1e-9 * ee * vv {
        ((et * vv - vt * ev) / determinant, (vt * ee - et * ev) / determinant)
    } else {
        (et / ee, 0.0)
    };
    let explained = (kp * et + kd * vt) / tt;
    (count >= LEAST && kp.is_finite() && explained.is_finite()).then_some(Fit { kp, kd, explained })
}
