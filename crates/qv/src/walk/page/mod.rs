//! `walk.html`: what a policy does and how it was learnt, one file without network, light or dark as the reader's screen is.
//!
//! Words, tables and the film strip are there without a script; the view that moves is drawn by `view.js`, the plots by those of
//! all pages.

mod data;
mod facts;
mod film;
mod measures;
mod plots;
mod words;

use measures::{Measures, ends, mean};
use qv_page::parts::{self, Mood, card, key};
use qv_page::{Page, Table, escape, fixed, script_data};
use qv_policy::gait::{Check, Gait};
use qv_policy::play::WalkTrace;
use qv_policy::policy::PolicyFile;
use qv_policy::score::Score;
use qv_policy::train::Line;
use std::fmt::Write;

const STYLE: &str = include_str!("style.css");
const VIEW: &str = include_str!("view.js");

/// The page. `lines` are those of the training, none where it is not known; `score` is that of the policy. The gait is that of the score,
/// where it has one, else that of the play.
pub fn page(title: &str, lines: &[Line], score: Option<&Score>, played: &WalkTrace, policy: &PolicyFile) -> String {
    let measures = Measures::new(played);
    let gait = score.and_then(|score| score.gait.as_ref()).unwrap_or(&measures.gait);
    let checks = gait.checks(&played.feet);
    let mut text = said(&words::verdict(&policy.robot, score, played, &measures, &checks));
    text += &gait_table(&checks, gait);
    if !played.q.is_empty() {
        text += &view(played);
    }
    let learning = plots::learning(lines).to_card();
    if !learning.is_empty() {
        text += "<h2>Learning</h2><p class=\"soft\">Over samples in millions. Terms of the reward: those that stay 0 are left out.</p>";
        text += &learning;
    }
    if !played.q.is_empty() {
        text += "<h2>Commands and what was done</h2><p class=\"soft\">Click into a plot over time to see that moment above.</p>";
        text += &(plots::tracking(played, &measures).to_card() + &tracking_table(&measures));
        text += &format!("<h2>Feet</h2>{}{}", plots::feet(played).to_card(), feet_table(played, &measures));
        text +=
            &format!("<h2>Joints</h2>{}{}", plots::joints(played, policy).to_card(), joints_table(played, &measures));
    }
    text += &facts::table(policy);
    let numbers = script_data(&data::data(played).to_string());
    _ = write!(text, "<script type=\"application/json\" id=\"data\">{numbers}</script>");
    Page { title, style: STYLE, body: &text, script: VIEW, ..Page::default() }.to_html()
}

fn said(verdict: &words::Verdict) -> String {
    let sentences: Vec<String> = verdict.sentences.iter().map(|s| escape(s)).collect();
    let mut text = format!("<b>{}</b> {}", escape(&verdict.headline), sentences.join(" "));
    if verdict.against.is_empty() {
        _ = write!(text, "<p>{}</p>", words::in_favour());
        return parts::verdict(Mood::Good, "", &text);
    }
    _ = write!(text, "<p>Before it goes onto a robot:</p>{}", parts::list(&verdict.against));
    parts::verdict(Mood::Fair, "", &text)
}

/// Each figure of the gait against its bound.
fn gait_table(checks: &[Check], gait: &Gait) -> String {
    let mut table = Table::with_left(&["figure", "value", "bound", "verdict", "source"], &[3, 4]);
    for check in checks {
        let verdict = if check.passes() { "pass" } else { "fail" };
        let value = format!("{} {}", number(check.value, 2), check.unit);
        let bound = format!("{} {}", check.bound_text(), check.unit);
        let cells = [escape(&check.quantity), value, escape(&bound), verdict.into(), escape(check.source)];
        table.row(&cells);
    }
    let power = number(gait.power, 1);
    let card = card(&format!(
        "{}<p class=\"soft small\">Without noise, from rest; the first second after a change of command does not \
         count. Touchdown: peak force within 0.1 s of a landing, looked for at each physics step. Mechanical power as it walks: {power} W.</p>",
        table.to_html()
    ));
    format!("<h2>Gait against bounds</h2>{card}")
}

fn view(played: &WalkTrace) -> String {
    let mut text = String::from(
        "<h2>The walk</h2><div class=\"card\"><canvas id=\"view\" tabindex=\"0\" aria-label=\"The robot as it walks; drag to turn the view\"></canvas>\
         <div class=\"controls\"><button id=\"play\" type=\"button\">Pause</button>\
         <input id=\"time\" type=\"range\" min=\"0\" value=\"0\" step=\"1\" aria-label=\"time\">\
         <label>speed <select id=\"speed\"><option value=\"0.1\">0.1<option value=\"0.25\">0.25<option value=\"0.5\">0.5\
         <option value=\"1\" selected>1<option value=\"2\">2</select></label><span id=\"now\" class=\"soft\"></span></div>\
         <p class=\"soft\"><span class=\"dot on\"></span>foot on the ground <span class=\"dot off\"></span>in the air \
         ",
    );
    let keys = [key("soft", "path of the base"), key("good", "commanded velocity")].concat();
    _ = write!(text, "{keys}. Drag to turn the view.</p></div>");
    if let Some((what, svg)) = film::film(played) {
        _ = write!(text, "{}", card(&format!("<p class=\"soft\">{}</p>{svg}", escape(&what))));
    }
    text
}

/// A number in a table, a dash where it is not known.
fn number(x: Option<f32>, digits: usize) -> String {
    fixed(x.map_or(f64::NAN, f64::from), digits)
}

fn tracking_table(measures: &Measures) -> String {
    let mut table = Table::grouped(
        &[("from – to [s]", 1), ("commanded", 3), ("done, mean", 3), ("mean error", 2)],
        &["", "vx [m/s]", "vy [m/s]", "wz [rad/s]", "vx", "vy", "wz", "velocity [m/s]", "turning [rad/s]"],
    );
    for s in &measures.stretches {
        let time = format!("{}&nbsp;–&nbsp;{}", number(Some(s.from), 1), number(Some(s.to), 1));
        let commanded = s.command.map(|x| number(Some(x), 2));
        let done = [0, 1, 2].map(|k| number(s.done.map(|done| done[k]), 2));
        let error = [0, 1].map(|k| number(s.error.map(|error| error[k]), 3));
        table.row(&[&[time][..], &commanded, &done, &error].concat());
    }
    card(&format!(
        "{}<p class=\"soft small\">The first second after a change of command is left out of means and errors.</p>",
        table.to_html()
    ))
}

fn feet_table(played: &WalkTrace, measures: &Measures) -> String {
    let mut table = Table::grouped(
        &[
            ("foot", 1),
            ("swings", 1),
            ("swing time [s]", 3),
            ("height of a swing [cm]", 3),
            ("duty factor", 1),
            ("greatest force", 1),
        ],
        &["", "", "mean", "least", "most", "mean", "least", "most", "[%]", "[N]"],
    );
    for (k, (name, foot)) in played.feet.iter().zip(&measures.feet).enumerate() {
        let duty = measures.gait.feet.get(k).map(|foot| 100.0 * foot.duty);
        let times = || foot.swings.iter().map(|s| s.time);
        let heights = || foot.swings.iter().map(|s| 100.0 * s.height);
        let three = |mean: Option<f32>, ends: Option<[f32; 2]>, digits: usize| {
            [mean, ends.map(|e| e[0]), ends.map(|e| e[1])].map(|x| number(x, digits))
        };
        let (times, heights) = (three(mean(times()), ends(times()), 2), three(mean(heights()), ends(heights()), 1));
        let first = [escape(name), foot.swings.len().to_string()];
        let last = [number(duty, 0), number(Some(foot.force), 0)];
        table.row(&[&first[..], &times, &heights, &last].concat());
    }
    let slowest = 1.0 / played.rate;
    card(&format!(
        "{}<p class=\"soft small\">While a command says: move. Times are whole decisions of {slowest:.3} s; one decision without force is a bounce and no swing. Duty factor: share of time on the ground. \
         The robot weighs {:.0} N. Cost of transport: <b>{}</b> = sum over joints of |torque × speed|, by weight and way; no gain from braking, no heat of motors.</p>",
        table.to_html(),
        played.mass * qv_core::GRAVITY as f32,
        number(measures.gait.transport, 2)
    ))
}

fn joints_table(played: &WalkTrace, measures: &Measures) -> String {
    let mut table = Table::grouped(
        &[("joint", 1), ("mean torque", 2), ("99 % of torques are below", 2), ("limit", 1), ("shaking", 1)],
        &["", "[N m]", "[% of limit]", "[N m]", "[% of limit]", "[N m]", "[N m/s]"],
    );
    for (name, joint) in played.joints.iter().zip(&measures.joints) {
        let share = |x: f32| joint.limit.map(|limit| 100.0 * x / limit);
        let cells = [
            escape(name),
            number(Some(joint.mean), 2),
            number(share(joint.mean), 0),
            number(Some(joint.high), 2),
            number(share(joint.high), 0),
            number(joint.limit, 1),
            number(Some(joint.change), 0),
        ];
        table.row_with_bar(&cells, 4, share(joint.high).map_or(0.0, |share| f64::from(share) / 100.0));
    }
    card(&format!(
        "{}<p class=\"soft small\">Torques at the end of each decision. Shaking: root mean square of the change of torque per second. \
         Targets that zigzag: {} % (independent random targets: 42 %).</p>",
        table.to_html(),
        fixed(100.0 * f64::from(measures.zigzag), 1)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::walk::example::{file, lines, made_up};
    use qv_page::read;

    fn whole(text: &str) {
        let still = read::without_scripts(text);
        for never in ["NaN", "inf<", ">inf", "http:", "https:", "src=", "<link", "@import", "url("] {
            assert!(!still.contains(never), "{never}");
        }
        let plots = if text.contains("class=\"board-data\"") { read::boards(text).len() } else { 0 };
        assert_eq!(text.matches("</script>").count(), 2 + plots, "the view's numbers, the plots', what draws them");
        assert_eq!(text.matches("<tr").count(), text.matches("</tr>").count());
    }

    #[test]
    fn all_parts_are_there() {
        let score = Score { robots: 64, velocity_error: 0.061, velocity_error_se: 0.004, ..Default::default() };
        let page = page("Walk of go2", &lines(100), Some(&score), &made_up(300), &file());
        for part in [
            "0.061 ± 0.004 m/s",
            "id=\"view\"",
            "class=\"film\"",
            "<td>FR_foot</td><td>",
            "FL_hip_joint</td><td>",
            "Cost of transport: <b>",
            "50 Hz",
            "material.*.friction",
        ] {
            assert!(page.contains(part), "{part}");
        }
        whole(&page);
        let boards = read::boards(&page);
        let links: Vec<&str> = boards.iter().map(|b| b.link.as_str()).collect();
        assert_eq!(links, ["", "time", "time", "time"]);
        assert_eq!(boards.iter().map(|b| b.panels.len()).collect::<Vec<_>>(), [7, 3, 3, 24]);
    }

    #[test]
    fn a_browser_shows_the_page() {
        let score = Score { robots: 64, velocity_error: 0.061, velocity_error_se: 0.004, ..Default::default() };
        let page = page("Walk of go2", &lines(100), Some(&score), &made_up(300), &file());
        crate::browser::check("walk", &page);
    }

    #[test]
    fn twenty_seconds_are_small() {
        let page = page("Walk", &lines(2000), None, &made_up(1000), &file());
        assert!(page.len() < 1_000_000, "{} bytes", page.len());
    }

    #[test]
    fn no_name_breaks_the_page() {
        let mut played = made_up(100);
        let nasty = "</script><script>alert(\"1\" & '2')</script>".to_string();
        (played.joints[0], played.feet[0]) = (nasty.clone(), nasty.clone());
        let page = page(
            &nasty,
            &lines(3),
            None,
            &played,
            &PolicyFile { robot: nasty.clone(), ground: nasty.clone(), ..file() },
        );
        assert!(!page.contains("<script>alert"));
        whole(&page);
    }

    #[test]
    fn who_fell_at_once_or_was_never_played_has_a_page() {
        let mut played = made_up(1);
        played.fell = Some(0);
        played.q[0][2] = f32::NAN;
        let page_of = |played: &WalkTrace| page("Fall", &[], None, played, &file());
        whole(&page_of(&played));
        assert!(page_of(&played).states("falls 0.0"));
        for nothing in [made_up(0), WalkTrace::default()] {
            let text = page_of(&nothing);
            whole(&text);
            assert!(text.states("Nothing") && !text.contains("id=\"view\"") && read::boards(&text).is_empty());
        }
    }
}
