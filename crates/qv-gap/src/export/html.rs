//! `report.html`: one file with its pictures and plots inside, no network, light or dark as the reader's screen is.

mod bars;
mod causes;
mod floor_plan;
mod heat_map;
mod robot;
mod sizes;
mod style;
mod together;
mod torque_balance;
mod torque_traces;
mod traces;
pub mod words;

use super::calibrated::cause_of;
use crate::problem::library::{Effect, built_in};
use crate::report::{Correction, Lead, Remainder, Report, Stage, Verdict, Where};
use bars::{joints, shares};
use qv_page::parts::{self, Bars, Mood, track};
use qv_page::{Page, Table};
use qv_sim::Model;
use std::fmt::Write;
use style::STYLE;
use words::{amount, escape, fixed, percent, significant, words};

/// The page. `title` names the recording; `notes` are said under the first screen, one paragraph each, such as what was lost.
/// `sections` are HTML that the caller made, after the curves; with a `model` the robot is drawn with the place of the cause. Parts of the report that
/// are empty take no room; what is not finite is a dash.
pub fn to_html(report: &Report, model: Option<&Model>, title: &str, notes: &[String], sections: &[String]) -> String {
    let library = built_in();
    let shown = shown(report);
    let picture = model.map_or(String::new(), |m| robot::robot(m, &report.traces, report.causes.first(), &library));
    let body = [
        verdict(report),
        bars::gap(report, &picture),
        parts::notes(notes),
        causes::causes(report, &library),
        leads(&report.leads),
        report.together.as_ref().map_or(String::new(), together::together),
        report.torque_balance.as_ref().map_or(String::new(), torque_balance::torque_balance),
        report.torque_balance.as_ref().map_or(String::new(), |b| torque_traces::torque_traces(&b.traces, &b.events)),
        sentences(report),
        sizes::sizes(&report.can_tell, if report.is_balanced() { "eight of ten" } else { "nine of ten" }),
        place(&shown),
        traces::traces(&shown.traces),
        sections.concat(),
        unexplained(&report.unexplained, report.verdict),
        corrections(report, &library),
        stages(&report.stages),
    ];
    let (title, heading) = (format!("Diagnosis of {title}"), format!("Diagnosis of {}", escape(title)));
    Page { title: &title, heading: &heading, style: STYLE, body: &body.concat(), ..Page::default() }.to_html()
}

/// The report with what its pictures show: without a cause, after is before.
fn shown(report: &Report) -> Report {
    let mut shown = report.clone();
    if report.causes.is_empty() {
        shown.heat_map.after.clear();
        shown.floor_plan.iter_mut().for_each(|p| p.after = f64::NAN);
        shown.traces.windows.iter_mut().for_each(|w| w.after = Default::default());
    }
    shown
}

fn verdict(report: &Report) -> String {
    let (mood, badge) = match report.verdict {
        Verdict::NoGap => (Mood::Good, "No gap"),
        Verdict::Explained => (Mood::Good, "Explained"),
        Verdict::PartlyExplained => (Mood::Fair, "Partly explained"),
        Verdict::Unexplained => (Mood::Bad, "Unexplained"),
    };
    let first = format!("{}{}", escape(&report.sentence), parts::answers(&answers(report)));
    let mut text = parts::verdict(mood, badge, &first);
    if !report.corrections_apply {
        let why = format!(
            "Correcting the effect raises the error of held-out windows from {} to {} (1 = a robot without a fault). No file applies it.",
            fixed(report.gap.before, 2),
            fixed(report.gap.after, 2)
        );
        text += &parts::verdict(Mood::Bad, "Not a correction", &why);
    }
    text
}

/// What a reader asks first: cause, size, how much it removes, how sure that is, what to do.
fn answers(report: &Report) -> Vec<(&'static str, String)> {
    let next = report.next.first().map_or(String::new(), |step| with_code(step));
    let [low, high] = report.gap.closed_ci95.map(percent);
    let Some(cause) = report.causes.first() else {
        let nearest = report.leads.first().and_then(|lead| lead.effects.first());
        return vec![("Nearest candidate", nearest.map_or(String::new(), |e| escape(&words(e)))), ("Next step", next)];
    };
    let sizes = causes::sizes(cause);
    let has_interval = causes::has_interval(cause);
    let removes = match report.corrections_apply {
        true => format!("{} ({low} to {high})", percent(report.gap.closed)),
        false => "no held-out error: not a correction".into(),
    };
    let sure = if report.is_balanced() {
        format!("tests with {} false alarms", percent(report.policy.held.alpha))
    } else {
        format!("{} (orders candidates, 0 to 1; no probability)", fixed(cause.score, 2))
    };
    vec![
        ("Cause", format!("<b>{}</b>", escape(&words(&cause.effect)))),
        (if has_interval { "Size (95 % interval)" } else { "Size" }, sizes.join("<br>")),
        ("Removes, of the held-out excess error", removes),
        (if report.is_balanced() { "Certainty" } else { "Score" }, sure),
        ("Next step", next),
    ]
}

/// Where to look when nothing is accused.
fn leads(leads: &[Lead]) -> String {
    if leads.is_empty() {
        return String::new();
    }
    let mut text =
        "<h2>Nearest candidates</h2><div class=\"card\"><p class=\"soft small\">None of these explains the gap. Effects of one \
                    line cannot be separated by this recording.</p>"
            .to_string();
    for lead in leads {
        let names: Vec<String> = lead.effects.iter().map(|e| words(e)).collect();
        let _ = write!(
            text,
            "<p><b>{}</b> ({}): would remove {} of the gap{}. To separate: {}.</p>",
            escape(&names.join(", or ")),
            escape(&crate::report::narrative::amounts(lead)),
            percent(lead.closed),
            joint_errors(lead.joint_rms),
            escape(&lead.separating_experiment)
        );
    }
    text + "</div>"
}

/// Errors of joints before and after; empty where positions are not compared.
fn joint_errors([before, after]: [f64; 2]) -> String {
    if before.is_nan() {
        return String::new();
    }
    format!(", joints {} to {} mrad", significant(1e3 * before, 3), significant(1e3 * after, 3))
}

/// What to do next beside what cannot be reported.
fn sentences(report: &Report) -> String {
    let list = |title: &str, sentences: &[String], tag: &str| {
        if sentences.is_empty() {
            return String::new();
        }
        let items: String = sentences.iter().map(|s| format!("<li>{}</li>", with_code(s))).collect();
        format!("<div><h2>{title}</h2><div class=\"card\"><{tag}>{items}</{tag}></div></div>")
    };
    let next = list("Next steps", &report.next, "ol");
    let cannot = list("What this recording cannot show", &report.cannot_tell, "ul");
    if next.is_empty() && cannot.is_empty() {
        String::new()
    } else {
        format!("<div class=\"grid wide\">{next}{cannot}</div>")
    }
}

/// What stands between backquotes is code.
fn with_code(text: &str) -> String {
    let parts: Vec<&str> = text.split('`').collect();
    let is_paired = parts.len() % 2 == 1;
    let part = |(i, part): (usize, &&str)| {
        if i % 2 == 1 && is_paired { format!("<code>{}</code>", escape(part)) } else { escape(part) }
    };
    parts.iter().enumerate().map(part).collect::<Vec<_>>().join(if is_paired { "" } else { "`" })
}

fn place(report: &Report) -> String {
    let Where { interfaces, joints: by_joint, legs, phases, times, regions } = &report.place;
    let groups = [shares("Interface", interfaces), shares("Leg", legs), shares("Phase", phases)].concat();
    let groups = if groups.is_empty() { groups } else { format!("<div class=\"stack\">{groups}</div>") };
    let by_joint = joints(by_joint);
    let mut parts = Vec::new();
    if !groups.is_empty() || !by_joint.is_empty() {
        parts.push(format!("<div class=\"grid wide\">{groups}{by_joint}</div>"));
    }
    parts.push(heat_map::heat_map(&report.heat_map));
    parts.push(heat_map::times(times));
    parts.push(floor_plan::floor_plan(&report.floor_plan, regions));
    parts.retain(|part| !part.is_empty());
    if parts.is_empty() {
        return String::new();
    }
    format!(
        "<h2>Error breakdown</h2><div class=\"stack\">{}</div>",
        parts.iter().map(|p| format!("<div>{p}</div>")).collect::<String>()
    )
}

fn unexplained(left: &Remainder, verdict: Verdict) -> String {
    let share = if left.share.is_finite() && verdict != Verdict::NoGap {
        format!("<p><b>{}</b> of the gap is not explained.</p>", percent(left.share))
    } else {
        String::new()
    };
    if share.is_empty() && left.depends_on.is_empty() {
        return String::new();
    }
    let mut text = format!("<h2>Remaining error</h2><div class=\"card\">{share}");
    if left.depends_on.is_empty() {
        text += "<p class=\"soft\">It correlates with none of the tested factors.</p>";
    } else {
        text += "<p class=\"soft small\">Factors that predict it, with the share of its variance in \
                 held-out windows (R²):</p>";
        let mut bars = Bars::new();
        for f in &left.depends_on {
            bars.row(&escape(&f.factor), &track(f.r2_heldout, "accent"), &fixed(f.r2_heldout, 2));
        }
        text += &bars.to_html();
    }
    text + "</div>"
}

/// Corrections of one kind, value and nominal value.
struct Line<'a> {
    first: &'a Correction,
    names: Vec<String>,
}

fn corrections(report: &Report, library: &[Effect]) -> String {
    if report.corrections.is_empty() {
        return String::new();
    }
    let mut lines: Vec<Line> = Vec::new();
    for c in &report.corrections {
        let (kind, name) = kind_and_name(&c.parameter);
        let same = |l: &&mut Line| {
            let shown = |c: &Correction| [amount(&kind, c.value, &c.unit), amount(&kind, c.nominal, &c.unit)];
            kind_and_name(&l.first.parameter).0 == kind && shown(l.first) == shown(c)
        };
        match lines.iter_mut().find(same) {
            Some(line) => line.names.push(name),
            None => lines.push(Line { first: c, names: vec![name] }),
        }
    }
    let mut table = Table::with_left(&["parameter", "of", "was", "is", "cause"], &[1, 4]);
    for line in &lines {
        let c = line.first;
        let kind = kind_and_name(&c.parameter).0;
        let cause = cause_of(c, &report.causes, library).map(words).unwrap_or_default();
        table.row(&[
            format!("<code>{}</code>", escape(&kind)),
            escape(&line.names.join(", ")),
            escape(&amount(&kind, c.nominal, &c.unit)),
            format!("<b>{}</b>", escape(&amount(&kind, c.value, &c.unit))),
            escape(&cause),
        ]);
    }
    let (count, table) = (report.corrections.len(), table.to_html());
    let html =
        format!("<details><summary>{count} simulator parameters, as in calibrated.toml</summary>{table}</details>");
    format!("<h2>Corrections</h2>{}", parts::card(&html))
}

/// `actuator.*.lag` and `knee` of `actuator.knee.lag`; a name without a part is its own kind.
fn kind_and_name(parameter: &str) -> (String, String) {
    let parts = ["joint", "actuator", "sensor", "link", "geom", "material"];
    let split = parameter.split_once('.').filter(|(kind, _)| parts.contains(kind));
    let named = split.and_then(|(kind, rest)| {
        let (name, field) = rest.rsplit_once('.')?;
        let of_a_part = kind != "sensor" || !["imu", "pose", "foot_force"].contains(&name);
        of_a_part.then(|| (format!("{kind}.*.{field}"), name.to_owned()))
    });
    named.unwrap_or_else(|| (parameter.to_owned(), String::new()))
}

/// What was simulated. How long it took is another time in every run, and stands in report.json alone.
fn stages(stages: &[Stage]) -> String {
    let all: usize = stages.iter().map(|s| s.steps).sum();
    if all == 0 {
        return String::new();
    }
    let mut text = format!(
        "<h2>Simulation effort</h2><div class=\"card small\"><p>{} million simulated steps</p>",
        significant(1e-6 * all as f64, 3)
    );
    let mut bars = Bars::new();
    for s in stages {
        let steps =
            if s.steps > 0 { format!("{} M steps", significant(1e-6 * s.steps as f64, 2)) } else { "–".into() };
        bars.row_of_four(&escape(&s.name), &track(s.steps as f64 / all as f64, "floor"), &steps, "");
    }
    text += &bars.to_html();
    text + "</div>"
}

#[cfg(test)]
mod tests {
    use super::{kind_and_name, with_code};

    #[test]
    fn code_is_marked() {
        assert_eq!(with_code("use `a < b`."), "use <code>a &lt; b</code>.");
        assert_eq!(with_code("an odd ` one"), "an odd ` one");
    }

    #[test]
    fn kinds_of_parameters() {
        let of = |p: &str| {
            let (kind, name) = kind_and_name(p);
            format!("{kind} {name}")
        };
        assert_eq!(of("actuator.knee.lag"), "actuator.*.lag knee");
        assert_eq!(of("geom.foot.1.radius_offset"), "geom.*.radius_offset foot.1");
        assert_eq!(of("sensor.imu.tilt_roll"), "sensor.imu.tilt_roll ");
        assert_eq!(of("terrain.patch.friction"), "terrain.patch.friction ");
    }
}
