//! The page of `qv navigate page`: shares with intervals, causes of failure, ways from above, and what the policy saw.

use crate::Failure;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::ImageEncoder as _;
use qv_nav::score::{Row, compared};
use qv_nav::task::{End, Episode, Trial};
use qv_page::parts::{Bars, card, grid, key, titled_card, track, track_with_interval};
use qv_page::{Page, Table, escape, fixed, percent};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;

/// The results of `qv navigate test`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Results {
    /// What carried the camera, and what drew its pictures.
    pub legs: String,
    /// See `legs`.
    pub eye: String,
    /// How cameras differed, as `--camera` says.
    #[serde(default)]
    pub camera: String,
    /// The beginning of the SHA-256 of the policy's weights.
    #[serde(default)]
    pub weights: String,
    /// Of the episodes.
    pub seed: u64,
    /// The episodes, the same for all rows.
    pub episodes: Vec<Episode>,
    /// The policy's row first.
    pub rows: Vec<TestRow>,
    /// The place from above.
    pub place: FromAbove,
    /// What the policy saw in some episodes.
    pub strips: Vec<Strip>,
}

/// A row of the table.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct TestRow {
    /// Who drove.
    pub name: String,
    /// Its figures.
    pub row: Row,
    /// McNemar's p against the policy.
    pub p_against_policy: f64,
    /// What came out of each episode.
    pub trials: Vec<Trial>,
}

/// A place from above.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FromAbove {
    /// Lower left and upper right corner \[m\].
    pub bounds: [[f64; 2]; 2],
    /// Height of a row \[m\].
    pub spacing: f64,
    /// Where no robot's middle may be: x from, x to, y of the middle \[m\].
    pub closed: Vec<[f64; 3]>,
}

/// Pictures of one episode side by side, as a PNG in base64.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Strip {
    /// Which episode.
    pub episode: usize,
    /// Times of the pictures \[s\].
    pub times: Vec<f64>,
    /// The PNG.
    pub png: String,
}

const STYLE: &str = ".above{width:100%;border-radius:6px}.closed{fill:var(--soft,#8888);opacity:.5}.way{fill:none;stroke-width:.04}\
.strip{width:100%;image-rendering:pixelated;border-radius:6px}";
/// Colours of the cones in drawings.
const CONES: [&str; 3] = ["#d33", "#36c", "#db2"];
/// Ways that are drawn at most.
const WAYS: usize = 24;

/// The whole page; `beside` are results of the same policy elsewhere.
pub fn to_html(results: &Results, beside: &[Results]) -> String {
    let mut body = table(results);
    body += &elsewhere(results, beside);
    body += &causes(results);
    body += &ways(results);
    body += &strips(results);
    Page { title: "Does it find the cone?", style: STYLE, body: &body, ..Page::default() }.to_html()
}

fn table(results: &Results) -> String {
    let heads = ["who drives", "reached", "", "95 % interval", "SPL", "time [s]", "p against the policy"];
    let mut table = Table::with_left(&heads, &[2]);
    for (k, tested) in results.rows.iter().enumerate() {
        let row = &tested.row;
        let interval = format!("{} to {}", percent(row.interval[0]), percent(row.interval[1]));
        table.row(&[
            escape(&tested.name),
            percent(row.success),
            track_with_interval(row.success, row.interval, "measured"),
            interval,
            fixed(row.spl, 2),
            row.time.map_or_else(|| "–".into(), |t| fixed(t, 1)),
            if k == 0 { "–".into() } else { fixed(tested.p_against_policy, 4) },
        ]);
    }
    let note = format!(
        "<p class=\"soft\">{} episodes of seed {}, the same for all rows. Legs: {}. Eye: {}. Wilson's intervals, McNemar's exact test.</p>",
        results.episodes.len(),
        results.seed,
        escape(&results.legs),
        escape(&results.eye)
    );
    card(&(table.to_html() + &note))
}

/// The policy on other legs, before another eye or in another place. p is against its row above, where the episodes are the same.
fn elsewhere(results: &Results, beside: &[Results]) -> String {
    let heads = ["the policy with", "reached", "", "95 % interval", "SPL", "p"];
    let mut table = Table::with_left(&heads, &[2]);
    for other in std::iter::once(results).chain(beside) {
        let (Some(own), Some(tested)) = (results.rows.first(), other.rows.first()) else { continue };
        let row = &tested.row;
        let p = match other.episodes == results.episodes {
            true => fixed(compared(&own.trials, &tested.trials), 4),
            false => "other episodes".into(),
        };
        table.row(&[
            escape(&format!("{}; eye: {}; camera: {}", other.legs, other.eye, other.camera)),
            percent(row.success),
            track_with_interval(row.success, row.interval, "measured"),
            format!("{} to {}", percent(row.interval[0]), percent(row.interval[1])),
            fixed(row.spl, 2),
            if std::ptr::eq(other, results) { "–".into() } else { p },
        ]);
    }
    match beside.is_empty() {
        true => String::new(),
        false => format!("<h2>The same policy elsewhere</h2>{}", card(&table.to_html())),
    }
}

fn causes(results: &Results) -> String {
    let cards: Vec<String> = results
        .rows
        .iter()
        .map(|tested| {
            let mut bars = Bars::new();
            for (end, count) in End::ALL.iter().zip(tested.row.ends) {
                let share = count as f64 / tested.row.episodes.max(1) as f64;
                let tone = if *end == End::Reached { "after" } else { "before" };
                bars.row(end.name(), &track(share, tone), &count.to_string());
            }
            titled_card(&tested.name, &bars.to_html())
        })
        .collect();
    format!("<h2>How episodes ended</h2>{}", grid(300, &cards.concat()))
}

/// The policy's ways from above: failures first, so that they are not hidden among the rest.
fn ways(results: &Results) -> String {
    let Some(policy) = results.rows.first() else { return String::new() };
    let mut pairs: Vec<(usize, &Episode, &Trial)> =
        results.episodes.iter().zip(&policy.trials).enumerate().map(|(k, (e, t))| (k, e, t)).collect();
    pairs.sort_by_key(|(k, _, trial)| (trial.reached(), *k));
    let half = |reached: bool| pairs.iter().filter(move |(_, _, t)| t.reached() == reached).take(WAYS / 2);
    let cards: Vec<String> = half(false)
        .chain(half(true))
        .map(|(k, episode, trial)| {
            let title = format!("{k}: {}, {}, {} s", episode.stratum.name(), trial.end.name(), fixed(trial.time, 1));
            titled_card(&title, &way(&results.place, episode, trial))
        })
        .collect();
    let keys = format!("{} way of the robot's middle &nbsp; circles: cones, the goal filled", key("measured", "the"));
    format!("<h2>Ways of the policy, failures first</h2><p class=\"soft\">{keys}</p>{}", grid(220, &cards.concat()))
}

fn way(place: &FromAbove, episode: &Episode, trial: &Trial) -> String {
    let [low, high] = place.bounds;
    // The picture's y goes down.
    let (x, y) = (|x: f64| x - low[0], |y: f64| high[1] - y);
    let mut svg = format!(
        "<svg class=\"above\" role=\"img\" aria-label=\"Way from above\" viewBox=\"0 0 {:.2} {:.2}\">",
        high[0] - low[0],
        high[1] - low[1]
    );
    for [from, to, middle] in &place.closed {
        let _ = write!(
            svg,
            "<rect class=\"closed\" x=\"{:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"{:.3}\"/>",
            x(*from),
            y(*middle) - 0.5 * place.spacing,
            to - from,
            place.spacing
        );
    }
    let points: Vec<String> =
        trial.track.iter().map(|p| format!("{:.2},{:.2}", x(f64::from(p[0])), y(f64::from(p[1])))).collect();
    let _ = write!(svg, "<polyline class=\"way\" stroke=\"var(--measured)\" points=\"{}\"/>", points.join(" "));
    for (k, cone) in std::iter::once(&episode.goal).chain(&episode.others).enumerate() {
        let colour = CONES[cone.colour.min(CONES.len() - 1)];
        let fill = if k == 0 { colour } else { "none" };
        let (cx, cy) = (x(cone.place[0]), y(cone.place[1]));
        let _ = write!(
            svg,
            "<circle cx=\"{cx:.2}\" cy=\"{cy:.2}\" r=\".13\" fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\".05\"/>"
        );
    }
    let (cx, cy) = (x(episode.start[0]), y(episode.start[1]));
    let _ = write!(svg, "<circle cx=\"{cx:.2}\" cy=\"{cy:.2}\" r=\".07\" fill=\"var(--measured)\"/></svg>");
    svg
}

fn strips(results: &Results) -> String {
    if results.strips.is_empty() {
        return String::new();
    }
    let ended = |k: usize| results.rows.first().and_then(|r| r.trials.get(k)).map_or("", |t| t.end.name());
    let cards: Vec<String> = results
        .strips
        .iter()
        .map(|strip| {
            let times: Vec<String> = strip.times.iter().map(|t| fixed(*t, 1)).collect();
            let title = format!("{}: {}; seconds {}", strip.episode, ended(strip.episode), times.join(", "));
            let image = format!("<img class=\"strip\" alt=\"\" src=\"data:image/png;base64,{}\">", escape(&strip.png));
            titled_card(&title, &image)
        })
        .collect();
    format!("<h2>What the policy saw</h2>{}", cards.concat())
}

/// Red, green, blue of so many columns and rows as a PNG in base64.
pub(super) fn png_in_base64(rgb: &[u8], [width, height]: [usize; 2]) -> Result<String, Failure> {
    let mut png = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut png);
    encoder.write_image(rgb, width as u32, height as u32, image::ExtendedColorType::Rgb8)?;
    Ok(STANDARD.encode(png))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use qv_nav::sight::Cone;
    use qv_nav::task::Stratum;

    #[test]
    fn a_page_has_the_table_ways_and_strips_and_escapes_names() {
        let goal = Cone { place: [1.0, 1.0, 0.0], height: 0.45, colour: 0, look: 0, turn: 0.0 };
        let (others, stratum) = (vec![Cone { colour: 1, ..goal }], Stratum::Hidden);
        let episode =
            Episode { start: [0.0; 2], yaw: 0.0, goal, others, stratum, geodesic: 3.0, seed: 1, is_absent: false };
        let trial = |end| Trial {
            end,
            time: 4.0,
            length: 2.0,
            shortest: 1.0,
            nearest: 0.3,
            seen: None,
            track: vec![[0.0, 0.0, 0.0], [0.5, 0.5, 0.0]],
        };
        let trials = vec![trial(End::Pushed), trial(End::Reached)];
        let tested = |name: &str| TestRow {
            name: name.into(),
            row: Row::of(&trials),
            p_against_policy: 0.5,
            trials: trials.clone(),
        };
        let results = Results {
            legs: "follower".into(),
            eye: "splat".into(),
            camera: "wide".into(),
            weights: "00ff".into(),
            seed: 3,
            episodes: vec![episode; 2],
            rows: vec![tested("policy"), tested("<b>")],
            place: FromAbove { bounds: [[-2.0; 2], [2.0; 2]], spacing: 0.05, closed: vec![[-1.0, 1.0, 0.5]] },
            strips: vec![Strip { episode: 0, times: vec![0.0, 2.0], png: "AAAA".into() }],
        };
        let text = to_html(&results, &[]);
        assert!(text.states("50.0 50.0") || text.states("50 50"), "the share");
        assert!(text.contains("&lt;b&gt;") && !text.contains("<b>"));
        assert_eq!(text.matches("<polyline").count(), 2);
        assert!(text.find("cone pushed, 4.0 s").unwrap() < text.find("reached, 4.0 s").unwrap(), "failures first");
        assert!(text.contains("data:image/png;base64,AAAA") && text.states("seconds 0.0 2.0"));
        let back: Results = serde_json::from_slice(&serde_json::to_vec(&results).unwrap()).unwrap();
        assert_eq!(to_html(&back, &[]), text);
        // The same policy on other legs, and in other episodes.
        assert!(!text.contains("The same policy elsewhere"));
        let walked = Results { legs: "a <dog>".into(), ..results.clone() };
        let mut moved = results.clone();
        moved.episodes[0].yaw += 1.0;
        let text = to_html(&results, &[walked, moved]);
        assert!(text.contains("a &lt;dog&gt;"));
        crate::browser::check("navigate", &text);
        assert!(text.contains("1.0000") && text.matches("other episodes").count() == 1, "{text}");
    }
}
