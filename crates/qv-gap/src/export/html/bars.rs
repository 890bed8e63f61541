//! Bars: how far the gap closes, shares, the ranking.

use super::words::{escape, fixed, percent, significant, words};
use crate::report::{Cause, Gap, JointShare, RankedEffect, Report, Share, Verdict};
use qv_page::parts::{Bars, card, titled_card, track, track_with_interval};
use std::fmt::Write;

/// Places of the ranking that are shown at least and at most; those between when there is something to see.
const RANKS: [usize; 2] = [4, 8];

/// Before, after and floor as bars, and what share of the difference is closed, beside the picture of the robot.
pub(super) fn gap(report: &Report, picture: &str) -> String {
    let (gap, verdict, has_causes) = (&report.gap, report.verdict, !report.causes.is_empty());
    let seen = if gap.heldout { "on held-out windows" } else { "on the windows of the fit" };
    let largest = [gap.before, gap.after, gap.floor].into_iter().filter(|x| x.is_finite()).fold(1e-300, f64::max);
    let mut bars = Bars::new();
    for (name, value, color) in
        [("before", gap.before, "before"), ("after", gap.after, "after"), ("noise floor", gap.floor, "floor")]
    {
        if name == "after" && !has_causes {
            continue;
        }
        bars.row(name, &track(value / largest, color), &significant(value, 3));
    }
    let mut bars = bars.to_html();
    let unit = if gap.unit.is_empty() { String::new() } else { format!("{}, ", escape(&gap.unit)) };
    let _ =
        write!(bars, "<p class=\"soft small\">{unit}{seen}; the noise floor is what noise and numerics alone give</p>");
    let picture = if picture.is_empty() { String::new() } else { titled_card("Place of the cause", picture) };
    format!(
        "<h2>Error before and after</h2><div class=\"grid even\" style=\"--min:300px\">{picture}<div class=\"card\"><h3>Normalized error</h3>{bars}</div>{}</div>",
        closed(gap, verdict, has_causes, report.policy.explained)
    )
}

fn closed(gap: &Gap, verdict: Verdict, has_causes: bool, mostly: f64) -> String {
    let [before, after] = gap.joint_rms.map(|x| fixed(1e3 * x, 1));
    if verdict == Verdict::NoGap || !has_causes {
        let why = if verdict == Verdict::NoGap {
            "There is no gap."
        } else {
            "No effect is identified, so nothing is removed."
        };
        let off = if gap.joint_rms[0].is_finite() {
            format!("<p>Joint position error: <b>{before} mrad</b> RMS.</p>")
        } else {
            String::new()
        };
        return format!("<div class=\"card\"><h3>Removed</h3><p>{why}</p>{off}</div>");
    }
    let [low, high] = gap.closed_ci95;
    let interval = if low.is_finite() && high.is_finite() {
        format!("95 % interval {} to {} %", fixed(100.0 * low, 0), fixed(100.0 * high, 0))
    } else {
        "no interval".into()
    };
    let in_fit = gap.closed_in_fit.filter(|share| share.is_finite());
    let in_fit = in_fit.map_or(String::new(), |share| format!("; {} in the windows of the fit", percent(share)));
    let positions = if gap.joint_rms[0].is_finite() {
        format!(
            "<p>Joint positions: <b style=\"color:var(--before)\">{before}</b> → <b style=\"color:var(--after)\">{after} mrad</b> rms</p>"
        )
    } else {
        String::new()
    };
    format!(
        "<div class=\"card\"><h3>Removed, of the error above the noise floor</h3>\
         <div class=\"bars\" style=\"grid-template-columns:auto 1fr\"><span class=\"big\">{}</span>{}</div>\
         <p class=\"soft small\">{interval}{in_fit}</p>\
         <p class=\"soft small\">The gap counts as explained from {} on.</p>\
         {positions}{}</div>",
        percent(gap.closed),
        track_with_interval(gap.closed, gap.closed_ci95, "after"),
        percent(mostly),
        falls(gap)
    )
}

/// Difference of the two falls from which on a reader needs to be reported why.
const CONTRADICTS: f64 = 0.15;

/// Share by which a mean square falls; negative where it rises.
fn fall(before: f64, after: f64) -> f64 {
    1.0 - after / before
}

/// How far the error falls in plain words, and why joints and score say different things where they do.
fn falls(gap: &Gap) -> String {
    let [before, after] = gap.joint_rms;
    let (score, joints) = (fall(gap.before, gap.after), fall(before * before, after * after));
    let rms = fall(before, after);
    // The camera's gap has another unit, and joints have no part in it.
    if !(score.is_finite() && joints.is_finite()) || gap.closed_in_fit.is_none() {
        return String::new();
    }
    let data = if gap.heldout { "held-out data" } else { "the data of the fit" };
    let falls = |share: f64| match share < 0.0 {
        true => format!("rises by {}", percent(-share)),
        false => format!("falls {}", percent(share)),
    };
    let mrad = |[before, after]: [f64; 2]| format!("{} to {} mrad", fixed(1e3 * before, 1), fixed(1e3 * after, 1));
    let mut text = format!(
        "<p>Error on {data} {} (mean square of all channels, {} to {}); of the joints alone it {} ({}).</p>",
        falls(score),
        significant(gap.before, 3),
        significant(gap.after, 3),
        falls(rms),
        mrad(gap.joint_rms)
    );
    if (score - joints).abs() > CONTRADICTS {
        text += "<p>The two differ because the first weights every channel by its noise, and the second counts joint positions only.</p>";
    }
    let Some(of) = gap.joint_rms_apart else { return text };
    let _ = write!(
        text,
        "<p>In {} of {} windows simulation and recording diverge, as after a slip or at a joint stop: there the joint error changes from {}. \
         In the other {} it changes from {}.</p>",
        of.apart,
        of.apart + of.agree,
        mrad(of.rms_apart),
        of.agree,
        mrad(of.rms_agree)
    );
    text
}

/// A card of named shares; empty without any.
pub(super) fn shares(title: &str, shares: &[Share]) -> String {
    if shares.is_empty() {
        return String::new();
    }
    let mut bars = Bars::new();
    for s in shares {
        bars.row(&escape(&s.name), &track(s.share, "accent"), &percent(s.share));
    }
    titled_card(title, &bars.to_html())
}

/// Joints with their shares and errors; empty without any.
pub(super) fn joints(joints: &[JointShare]) -> String {
    if joints.is_empty() {
        return String::new();
    }
    let largest = joints.iter().map(|j| j.share).filter(|x| x.is_finite()).fold(1e-12, f64::max);
    let mut bars = Bars::new();
    // Where torques are compared there is no error of positions.
    let has_errors = joints.iter().any(|j| j.pos_rms.is_finite());
    for j in joints {
        let (share, bar) = (percent(j.share), track(j.share / largest, "accent"));
        if has_errors {
            bars.row_of_four(&escape(&j.name), &bar, &share, &fixed(1e3 * j.pos_rms, 1));
        } else {
            bars.row(&escape(&j.name), &bar, &share);
        }
    }
    let title = if has_errors { "Joint: share of the gap, error before [mrad]" } else { "Joint: share of the gap" };
    titled_card(title, &bars.to_html())
}

/// All that was considered, best first, as far as it is worth reading; empty without any.
pub(super) fn ranking(ranking: &[RankedEffect], causes: &[Cause]) -> String {
    if ranking.is_empty() {
        return String::new();
    }
    let likely = ranking.iter().take_while(|r| r.score >= 0.005).count();
    let shown = likely.clamp(RANKS[0], RANKS[1]).min(ranking.len());
    let mut bars = Bars::new();
    for r in &ranking[..shown] {
        let accused = causes.iter().any(|c| c.effect == r.effect);
        let name = if accused { format!("<b>{}</b>", escape(&words(&r.effect))) } else { escape(&words(&r.effect)) };
        let bar = track(r.score, if accused { "accent" } else { "floor" });
        bars.row(&name, &bar, &fixed(r.score, 2));
    }
    let mut text = format!(
        "<h3>Candidates by score</h3><p>Each candidate alone; several effects can be present together.</p>{}",
        bars.to_html()
    );
    if ranking.len() > shown {
        let rest: f64 = ranking[shown..].iter().map(|r| r.score).filter(|p| p.is_finite()).sum();
        let _ =
            write!(text, "<p class=\"soft small\">{} more with {} in sum</p>", ranking.len() - shown, fixed(rest, 2));
    }
    card(&text)
}
