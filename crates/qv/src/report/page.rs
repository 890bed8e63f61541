//! The page itself.

use super::ground::{FromAbove, from_above};
use super::parts::Parts;
use crate::Failure;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::ImageEncoder as _;
use qv_core::{Material, TriangleMesh, label_colour};
use qv_page::number::DASH;
use qv_page::parts::{Bars, card, grid, track};
use qv_page::{Page, Table, escape, fixed, percent};
use serde_json::Value;

/// What this page has beside the style of all pages.
const STYLE: &str = ".lead li{margin:6px 0;font-size:16px}.walk{fill:none;stroke:#fff;stroke-width:5;stroke-linejoin:round;paint-order:stroke}\
.walk.thin{stroke:#111;stroke-width:2}.slip{fill:#d5003c}svg{border-radius:6px}";
/// The page's title.
const TITLE: &str = "From place and robot to a simulator that agrees";

/// The whole page.
///
/// # Errors
/// A picture cannot be encoded.
pub fn to_html(parts: &Parts) -> Result<String, Failure> {
    let mut text = summary(parts);
    if let Some(diagnosis) = &parts.diagnosis {
        text += &causes(diagnosis);
    }
    if let Some(contact) = &parts.contact {
        text += &friction(contact);
    }
    if let Some(tuning) = &parts.tuning {
        text += &tuned(tuning, parts.paths.as_ref());
    }
    text += &place(parts);
    text += &photographs(parts);
    if let Some(mesh) = &parts.mesh {
        text += &ground(mesh, parts.contact.as_ref())?;
    }
    Ok(Page { title: TITLE, style: STYLE, body: &text, ..Page::default() }.to_html())
}

/// Paths of the policy before and after.
fn strayed(paths: &Value) -> Option<[&Value; 2]> {
    match list(&paths["policies"]) {
        [before, after] => Some([&before["paths"], &after["paths"]]),
        _ => None,
    }
}

/// Joints of each simulator on held-out recordings, and how far policies stray.
fn tuned(tuning: &Value, paths: Option<&Value>) -> String {
    let mut simulators = Table::new(&["simulator", "joints off on held-out recordings [mrad]", "stays"]);
    for candidate in list(&tuning["candidates"]) {
        let held = &candidate["held_out"];
        let milli = |value: &Value| fixed(value.as_f64().map_or(f64::NAN, |x| 1e3 * x), 1);
        simulators.row(&[
            escape(candidate["compensation"]["kind"].as_str().unwrap_or(DASH)),
            format!("{} ± {}", milli(&held["error"]), milli(&held["error_se"])),
            if held["stays"] == true { "yes" } else { "no" }.into(),
        ]);
    }
    let mut strays = Table::new(&["distance from the commanded path over 8 s [m]", "before", "after"]);
    let mut row = |name: &str, before: &Value, after: &Value| {
        let cell = |score: &Value| format!("{} ± {}", number(&score["position"], 3), number(&score["position_se"], 3));
        strays.row(&[name.to_string(), cell(before), cell(after)]);
    };
    row("expected, in a simulator fitted to held-out recordings", &tuning["before"], &tuning["after"]);
    if let Some([before, after]) = paths.and_then(strayed) {
        row("<b>on the simulated robot itself</b>", before, after);
    }
    let cards = [card(&simulators.to_html()), card(&strays.to_html())].concat();
    format!("<h2>The policy, trained on in the corrected simulator</h2>{cards}")
}

/// A number of a report, or a dash.
fn number(value: &Value, digits: usize) -> String {
    fixed(value.as_f64().unwrap_or(f64::NAN), digits)
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// What was found, a sentence for each part: the cause, friction, what the tuned policy gains. What the place is comes after it.
fn summary(parts: &Parts) -> String {
    let mut said: Vec<String> = vec![];
    for (part, key) in [(&parts.diagnosis, "sentence"), (&parts.contact, "sentence"), (&parts.tuning, "why")] {
        said.extend(part.as_ref().and_then(|report| report[key].as_str()).map(escape));
    }
    if let Some([before, after]) = parts.paths.as_ref().and_then(strayed) {
        said.push(format!(
            "Path-tracking error of the simulated robot: {} m before and {} m after fine-tuning.",
            number(&before["position"], 3),
            number(&after["position"], 3)
        ));
    }
    said.extend(parts.replay.as_ref().and_then(|report| report["verdict"].as_str()).map(escape));
    said.extend(parts.navigation.as_ref().map(|(results, page)| cones(results, page)));
    if let Some(view) = &parts.view {
        said.push(format!(
            "<a href=\"{}\">Look around in the place</a>: robot, slips and causes, in three dimensions.",
            escape(view)
        ));
    }
    sentences(&said)
}

/// How often cones are found, with a link.
fn cones(results: &Value, page: &str) -> String {
    let reached = |tested: &Value| {
        let share = percent(tested["row"]["success"].as_f64().unwrap_or(f64::NAN));
        format!("{} {share}", escape(tested["name"].as_str().unwrap_or(DASH)))
    };
    let all: Vec<String> = list(&results["rows"]).iter().map(reached).collect();
    let count = list(&results["episodes"]).len();
    format!(
        "Of {count} cones in the reconstructed place are reached: {} (<a href=\"{}\">what it saw, and its ways</a>).",
        all.join(", "),
        escape(page)
    )
}

fn sentences(said: &[String]) -> String {
    let items: Vec<String> = said.iter().map(|sentence| format!("<li>{sentence}</li>")).collect();
    if items.is_empty() { String::new() } else { card(&format!("<ul class=\"lead\">{}</ul>", items.concat())) }
}

/// What the place is made of; nothing where neither scene nor ground is given.
fn place(parts: &Parts) -> String {
    let mut said: Vec<String> = vec![];
    if let Some(scores) = &parts.scores {
        said.push(format!(
            "The scene has {} Gaussians, trained on {} images: held-out PSNR {} dB, SSIM {}.",
            number(&scores["gaussians"], 0),
            number(&scores["photographs"], 0),
            number(&scores["mean"]["psnr"], 1),
            number(&scores["mean"]["ssim"], 3)
        ));
    }
    if let Some(mesh) = &parts.mesh {
        let names: Vec<&str> = used(mesh).map(|(_, material)| material.name.as_str()).collect();
        said.push(format!("The ground is {} triangles of {}.", mesh.triangles.len(), escape(&names.join(", "))));
    }
    if said.is_empty() { String::new() } else { format!("<h2>The place</h2>{}", sentences(&said)) }
}

fn photographs(parts: &Parts) -> String {
    if parts.pictures.is_empty() {
        return String::new();
    }
    let figure = |(name, png): &(String, Vec<u8>)| {
        format!(
            "<figure><img alt=\"{0}\" src=\"data:image/png;base64,{1}\"><figcaption>{0}</figcaption></figure>",
            escape(name),
            STANDARD.encode(png)
        )
    };
    let figures: Vec<String> = parts.pictures.iter().map(figure).collect();
    format!(
        "<h2>Scene: held-out images and renderings</h2>\
         <p class=\"soft\">Left the image, right the rendered scene.</p>{}",
        grid(420, &figures.concat())
    )
}

fn png(picture: &FromAbove) -> Result<Vec<u8>, Failure> {
    let mut out = vec![];
    let encoder = image::codecs::png::PngEncoder::new(&mut out);
    let (width, height) = (picture.width as u32, picture.height as u32);
    encoder.write_image(&picture.rgb, width, height, image::ExtendedColorType::Rgb8)?;
    Ok(out)
}

/// Materials that some triangle has, with their index.
fn used(mesh: &TriangleMesh) -> impl Iterator<Item = (usize, &Material)> {
    let is_used = |label: &usize| mesh.labels.iter().any(|l| usize::from(*l) == *label);
    mesh.materials.iter().enumerate().filter(move |(label, _)| is_used(label))
}

fn ground(mesh: &TriangleMesh, contact: Option<&Value>) -> Result<String, Failure> {
    let Some(picture) = from_above(mesh) else { return Ok(String::new()) };
    let way = contact.map_or(String::new(), |contact| picture.way(contact));
    // White below, black on top, so that it is seen on every label.
    let thin = way.replace("class=\"walk\"", "class=\"walk thin\"");
    let thin = thin.split("<circle").next().unwrap_or_default();
    let keys: Vec<String> = used(mesh)
        .map(|(label, material)| {
            let [r, g, b] = label_colour(label);
            format!(
                "<span class=\"swatch\" style=\"background:rgb({r},{g},{b})\"></span>{} &nbsp; ",
                escape(&material.name)
            )
        })
        .collect();
    Ok(format!(
        "<h2>The ground from above</h2><div class=\"card\"><svg viewBox=\"0 0 {0} {1}\"><image width=\"{0}\" height=\"{1}\" \
         href=\"data:image/png;base64,{2}\"/>{thin_below}{thin}</svg><p>{3}<span class=\"soft\">black: the robot's way; red: where feet slipped</span></p></div>",
        picture.width,
        picture.height,
        STANDARD.encode(png(&picture)?),
        keys.concat(),
        thin_below = way
    ))
}

fn friction(contact: &Value) -> String {
    let mut table =
        Table::with_left(&["label", "before", "after", "90 % interval", "status", "feet on it", "slipping"], &[4]);
    for region in list(&contact["regions"]) {
        let used = if region["status"] == "refined" { "posterior" } else { "prior_estimate" };
        let interval = &region[used]["interval90"];
        table.row(&[
            escape(region["label"].as_str().unwrap_or(DASH)),
            number(&region["prior_estimate"]["mean"], 2),
            format!("<b>{}</b>", number(&region["friction"], 3)),
            format!("{} to {}", number(&interval[0], 2), number(&interval[1], 2)),
            escape(&region["status"].as_str().unwrap_or(DASH).replace('_', " ")),
            format!("{} s", number(&region["contact_time"], 1)),
            share(&region["slip_share"]),
        ]);
    }
    format!("<h2>Friction of each label</h2>{}", card(&(table.to_html() + &base_error(contact))))
}

/// Error of the base with one friction everywhere, with the priors, and with what was found.
fn base_error(contact: &Value) -> String {
    let held_out = &contact["base_error"]["held_out"];
    let errors = if held_out.is_object() { held_out } else { &contact["base_error"]["all"] };
    let most = ["uniform", "prior", "posterior"].iter().filter_map(|key| errors[key].as_f64()).fold(0.0, f64::max);
    if most <= 0.0 {
        return String::new();
    }
    let mut bars = Bars::new();
    let rows = [("uniform", "one friction everywhere"), ("prior", "friction by label, before"), ("posterior", "after")];
    for (key, words) in rows {
        let value = errors[key].as_f64().unwrap_or(0.0);
        let tone = if key == "posterior" { "after" } else { "before" };
        bars.row(words, &track(value / most, tone), &format!("{} cm", fixed(100.0 * value, 1)));
    }
    format!(
        "<p class=\"soft\">Mean error of the base when {} s are replayed open loop</p>{}",
        number(&contact["base_error"]["segment"], 1),
        bars.to_html()
    )
}

/// A share of a report in percent, or a dash.
fn share(value: &Value) -> String {
    percent(value.as_f64().unwrap_or(f64::NAN))
}

fn causes(diagnosis: &Value) -> String {
    let gap = &diagnosis["gap"];
    let mut text = format!(
        "<h2>What makes robot and simulator differ</h2><div class=\"card\"><p>{}</p>\
         <p class=\"soft\">Gap {} before, {} after, {} of noise alone.</p>",
        escape(diagnosis["sentence"].as_str().unwrap_or("–")),
        number(&gap["before"], 2),
        number(&gap["after"], 2),
        number(&gap["floor"], 2)
    );
    let heads = ["cause", "score", "size", "95 % interval", "closes alone"];
    let mut table = Table::new(&heads);
    for cause in list(&diagnosis["causes"]) {
        for (k, parameter) in list(&cause["parameters"]).iter().enumerate() {
            let first = |words: String| if k == 0 { words } else { String::new() };
            table.row(&[
                first(escape(&cause["effect"].as_str().unwrap_or(DASH).replace('_', " "))),
                first(number(&cause["score"], 2)),
                format!(
                    "{} {} {}",
                    escape(parameter["name"].as_str().unwrap_or("")),
                    number(&parameter["value"], 4),
                    escape(parameter["unit"].as_str().unwrap_or(""))
                ),
                format!("{} to {}", number(&parameter["ci95"][0], 4), number(&parameter["ci95"][1], 4)),
                first(share(&cause["closed_alone"])),
            ]);
        }
    }
    if !table.is_empty() {
        text += &table.to_html();
    }
    let shares: Vec<String> = list(&diagnosis["where"]["interfaces"])
        .iter()
        .filter_map(|one| Some(format!("{} {}", escape(one["name"].as_str()?), percent(one["share"].as_f64()?))))
        .collect();
    text + &format!("<p class=\"soft\">Where the gap lies: {}.</p></div>", shares.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use serde_json::json;

    #[test]
    fn what_is_not_there_has_no_heading() {
        let parts = Parts {
            scores: None,
            pictures: vec![],
            mesh: None,
            contact: None,
            replay: Some(json!({"verdict": "Near."})),
            diagnosis: None,
            tuning: None,
            paths: None,
            navigation: None,
            view: None,
        };
        let page = to_html(&parts).unwrap();
        assert!(page.contains("Near.") && !page.contains("<h2>"));
    }

    #[test]
    fn parts_that_are_there_are_told_and_no_name_breaks_the_page() {
        let contact = json!({
            "sentence": "Slippery <tiles>.",
            "regions": [{"label": "a<b", "friction": 0.2, "status": "not_touched", "prior_estimate": {"mean": 0.5},
                "posterior": {"interval90": [0.15, 0.25]}, "contact_time": 3.0, "slip_share": 0.4}],
            "base_error": {"segment": 2.0, "held_out": null, "all": {"uniform": 0.2, "prior": 0.1, "posterior": 0.05}},
        });
        let parts = Parts {
            scores: None,
            pictures: vec![("view".into(), vec![1, 2, 3])],
            mesh: None,
            contact: Some(contact),
            replay: None,
            diagnosis: Some(json!({"sentence": "The gap is backlash.", "gap": {}})),
            view: Some("../view/view.html".into()),
            navigation: Some((
                json!({"episodes": [{}, {}], "rows": [{"name": "po<licy", "row": {"success": 0.5}}]}),
                "../navigate/index.html".into(),
            )),
            tuning: Some(json!({
                "why": "Better by far.",
                "candidates": [{"compensation": {"kind": "a<net"}, "held_out": {"error": 0.0123, "error_se": 0.001, "stays": true}}],
                "before": {"position": 0.4, "position_se": 0.01}, "after": {"position": 0.2, "position_se": 0.01},
            })),
            paths: Some(
                json!({"policies": [{"paths": {"position": 0.5, "position_se": 0.02}}, {"paths": {"position": 0.111}}]}),
            ),
        };
        let page = to_html(&parts).unwrap();
        crate::browser::check("pipeline", &page);
        assert!(page.states("Of 2 50"), "{page}");
        assert!(page.contains("href=\"../navigate/index.html\""));
        for part in
            ["Slippery &lt;tiles&gt;.", "a&lt;b", "not touched", "0.200", "5.0 cm", "base64,AQID", "Better by far."]
        {
            assert!(page.contains(part), "{part}");
        }
        for part in [
            "a&lt;net</td><td>12.3 ± 1.0",
            "0.400 ± 0.010",
            "0.500 ± 0.020",
            "0.500 m before",
            "0.111 m after fine-tuning",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("NaN") && page.contains("<a href=\"../view/view.html\">"));
        let order = [
            "gap is backlash",
            "Slippery",
            "Better by far",
            "m before and",
            "Look around",
            "What makes",
            "Friction of",
            "Scene: held-out",
        ];
        let places: Vec<usize> = order.iter().map(|part| page.find(part).unwrap()).collect();
        assert!(places.is_sorted(), "what was found comes first, then the place: {places:?}");
    }
}
