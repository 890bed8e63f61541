//! `walk.html`: what a policy does and how it was learnt, one file without network, light or dark as the reader's screen is.
//!
//! Words, tables and the film strip are there without a script; the view that moves and the plots are drawn by `view.js` and
//! `plots.js` from numbers that are in the page once.

mod data;
mod facts;
mod film;
mod measures;
mod words;

use measures::{Measures, ends, mean};
use qv_policy::play::Played;
use qv_policy::policy::PolicyFile;
use qv_policy::score::Score;
use qv_policy::train::Line;
use qv_page::escape;
use std::fmt::Write;

const STYLE: &str = include_str!("style.css");
const PLOTS: &str = include_str!("plots.js");
const VIEW: &str = include_str!("view.js");

/// The page. `lines` are those of the training, none where it is not known; `score` is that of the policy.
pub fn page(title: &str, lines: &[Line], score: Option<&Score>, played: &Played, policy: &PolicyFile) -> String {
    let title = escape(title);
    let measures = Measures::new(played);
    let mut text = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>{title}</title><style>{STYLE}</style><h1>{title}</h1>"
    );
    text += &said(&words::verdict(&policy.robot, score, played, &measures));
    if !played.q.is_empty() {
        text += &view(played);
    }
    if !lines.is_empty() {
        text += "<h2>Learning</h2><p class=\"soft\">Over samples in millions. Terms of the reward: those that stay 0 are left out; click a name to switch it off or on.</p>\
                 <div class=\"plots\" id=\"learning\"></div>";
    }
    if !played.q.is_empty() {
        text += &format!(
            "<h2>Commands and what was done</h2><p class=\"soft\">Click into a plot over time to see that moment above.</p>\
             <div class=\"plots\" id=\"tracking\"></div>{}\
             <h2>Feet</h2><div class=\"plots\" id=\"feet\"></div>{}\
             <h2>Joints</h2><p><label>joint <select id=\"joint\"></select></label></p><div class=\"plots\" id=\"joints\"></div>{}",
            tracking_table(&measures),
            feet_table(played, &measures),
            joints_table(played, &measures)
        );
    }
    text += &facts::table(policy);
    // `<` never stands in the numbers' text, so that no name ends the script.
    let numbers = data::data(lines, played, policy).to_string().replace('<', "\\u003c");
    _ = write!(
        text,
        "<script type=\"application/json\" id=\"data\">{numbers}</script><script>\"use strict\";\n{PLOTS}\n{VIEW}</script></html>\n"
    );
    text
}

fn said(verdict: &words::Verdict) -> String {
    let sentences: Vec<String> = verdict.sentences.iter().map(|s| escape(s)).collect();
    let class = if verdict.against.is_empty() { "verdict good" } else { "verdict" };
    let mut text = format!("<div class=\"{class}\"><b>{}</b> {}", escape(&verdict.headline), sentences.join(" "));
    if verdict.against.is_empty() {
        _ = write!(text, "<p>{}</p>", words::in_favour());
    } else {
        text += "<p>Before it goes onto a robot:</p><ul>";
        verdict.against.iter().for_each(|one| _ = write!(text, "<li>{}", escape(one)));
        text += "</ul>";
    }
    text + "</div>"
}

fn view(played: &Played) -> String {
    let mut text = String::from(
        "<h2>The walk</h2><div class=\"card\"><canvas id=\"view\" tabindex=\"0\" aria-label=\"The robot as it walks; drag to turn the view\"></canvas>\
         <div class=\"controls\"><button id=\"play\" type=\"button\">Pause</button>\
         <input id=\"time\" type=\"range\" min=\"0\" value=\"0\" step=\"1\" aria-label=\"time\">\
         <label>speed <select id=\"speed\"><option value=\"0.1\">0.1<option value=\"0.25\">0.25<option value=\"0.5\">0.5\
         <option value=\"1\" selected>1<option value=\"2\">2</select></label><span id=\"now\" class=\"soft\"></span></div>\
         <p class=\"soft\"><span class=\"dot on\"></span>foot on the ground <span class=\"dot off\"></span>in the air \
         <span class=\"key way\"></span>path of the base <span class=\"key asked\"></span>commanded velocity. Drag to turn the view.</p></div>",
    );
    if let Some((what, svg)) = film::film(played) {
        _ = write!(text, "<p class=\"soft\">{}</p>{svg}", escape(&what));
    }
    text
}

/// A number in a table, a dash where it is not known.
fn number(x: Option<f32>, digits: usize) -> String {
    x.filter(|x| x.is_finite()).map_or("–".into(), |x| format!("{x:.digits$}"))
}

fn tracking_table(measures: &Measures) -> String {
    let mut text = String::from(
        "<div class=\"scroll\"><table><tr><th>from – to [s]<th colspan=\"3\">commanded<th colspan=\"3\">done, mean<th colspan=\"2\">mean error</tr>\
         <tr class=\"units\"><th><th>vx [m/s]<th>vy [m/s]<th>wz [rad/s]<th>vx<th>vy<th>wz<th>velocity [m/s]<th>turning [rad/s]</tr>",
    );
    for s in &measures.stretches {
        _ = write!(text, "<tr><td>{:.1} – {:.1}", s.from, s.to);
        s.command.iter().for_each(|x| _ = write!(text, "<td>{x:.2}"));
        (0..3).for_each(|k| _ = write!(text, "<td>{}", number(s.done.map(|done| done[k]), 2)));
        (0..2).for_each(|k| _ = write!(text, "<td>{}", number(s.error.map(|error| error[k]), 3)));
        text += "</tr>";
    }
    text + "</table></div><p class=\"soft\">The first second after a change of command is left out of means and errors.</p>"
}

fn feet_table(played: &Played, measures: &Measures) -> String {
    let mut text = String::from(
        "<div class=\"scroll\"><table><tr><th>foot<th>swings<th colspan=\"3\">swing time [s]<th colspan=\"3\">height of a swing [cm]<th>duty factor<th>greatest force</tr>\
         <tr class=\"units\"><th><th><th>mean<th>least<th>most<th>mean<th>least<th>most<th>[%]<th>[N]</tr>",
    );
    for (name, foot) in played.feet.iter().zip(&measures.feet) {
        let times = || foot.swings.iter().map(|s| s.time);
        let heights = || foot.swings.iter().map(|s| 100.0 * s.height);
        _ = write!(text, "<tr><td>{}<td>{}", escape(name), foot.swings.len());
        let three = |mean: Option<f32>, ends: Option<[f32; 2]>| [mean, ends.map(|e| e[0]), ends.map(|e| e[1])];
        three(mean(times()), ends(times())).iter().for_each(|x| _ = write!(text, "<td>{}", number(*x, 2)));
        three(mean(heights()), ends(heights())).iter().for_each(|x| _ = write!(text, "<td>{}", number(*x, 1)));
        _ = write!(text, "<td>{}<td>{:.0}</tr>", number(foot.duty.map(|d| 100.0 * d), 0), foot.force);
    }
    let slowest = 1.0 / played.rate;
    text + &format!(
        "</table></div><p class=\"soft\">While a command says: move. Times are whole decisions of {slowest:.3} s; one decision without force is a bounce and no swing. Duty factor: share of time on the ground. \
         The robot weighs {:.0} N. Cost of transport: <b>{}</b> = sum over joints of |torque × speed|, by weight and way; no gain from braking, no heat of motors.</p>",
        played.mass * qv_core::GRAVITY as f32,
        number(measures.transport, 2)
    )
}

fn joints_table(played: &Played, measures: &Measures) -> String {
    let mut text = String::from(
        "<div class=\"scroll\"><table><tr><th>joint<th colspan=\"2\">mean torque<th colspan=\"2\">99 % of torques are below<th>limit<th>shaking</tr>\
         <tr class=\"units\"><th><th>[N m]<th>[% of limit]<th>[N m]<th>[% of limit]<th>[N m]<th>[N m/s]</tr>",
    );
    for (name, joint) in played.joints.iter().zip(&measures.joints) {
        let share = |x: f32| joint.limit.map(|limit| 100.0 * x / limit);
        let width = share(joint.high).filter(|x| x.is_finite()).unwrap_or(0.0).min(100.0);
        _ = write!(
            text,
            "<tr><td>{}<td>{:.2}<td>{}<td>{:.2}<td class=\"bar\" style=\"--w:{width:.0}%\">{}<td>{}<td>{:.0}</tr>",
            escape(name),
            joint.mean,
            number(share(joint.mean), 0),
            joint.high,
            number(share(joint.high), 0),
            number(joint.limit, 1),
            joint.change
        );
    }
    text + &format!(
        "</table></div><p class=\"soft\">Torques at the end of each decision. Shaking: root mean square of the change of torque per second. \
         Targets that zigzag: {:.1} % (independent random targets: 42 %).</p>",
        100.0 * measures.zigzag
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::walk::example::{file, lines, made_up};

    fn whole(text: &str) {
        for never in ["NaN", "inf<", ">inf", "http:", "https:", "src=", "<link", "@import", "url("] {
            assert!(!text.contains(never), "{never}");
        }
        assert_eq!(text.matches("</script>").count(), 2);
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
            "id=\"learning\"",
            "id=\"tracking\"",
            "id=\"feet\"",
            "id=\"joints\"",
            "<td>FR_foot<td>",
            "FL_hip_joint<td>",
            "Cost of transport: <b>",
            "50 Hz",
            "material.*.friction",
            "\"samples\":[",
        ] {
            assert!(page.contains(part), "{part}");
        }
        whole(&page);
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
        let page_of = |played: &Played| page("Fall", &[], None, played, &file());
        whole(&page_of(&played));
        assert!(page_of(&played).contains("falls after 0.0 s"));
        for nothing in [made_up(0), Played::default()] {
            let text = page_of(&nothing);
            whole(&text);
            assert!(
                text.contains("Nothing was played")
                    && !text.contains("id=\"view\"")
                    && !text.contains("id=\"learning\"")
            );
        }
    }
}
