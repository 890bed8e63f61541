//! The page itself.

use super::Parts;
use super::ground::{FromAbove, from_above};
use crate::Failure;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::ImageEncoder as _;
use qv_core::{Material, TriangleMesh, label_colour};
use qv_page::escape;
use serde_json::Value;
use std::fmt::Write;

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1c2430;--soft:#5d6875;--paper:#f6f6f3;--card:#fff;--line:#dfe3e8;--accent:#1f6fb5;--before:#d9601a}\
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ee;--soft:#a3adb9;--paper:#14181d;--card:#1b2027;--line:#343d48;--accent:#6db3f2;--before:#ff9d5c}}\
*{box-sizing:border-box}body{margin:0 auto;max-width:1080px;padding:26px 20px 60px;background:var(--paper);color:var(--ink);\
font:15px/1.5 system-ui,-apple-system,'Segoe UI',sans-serif}\
h1{font-size:22px;margin:0 0 14px}h2{font-size:18px;margin:34px 0 10px}p{margin:4px 0}.soft{color:var(--soft);font-size:13px}\
.card{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:14px 18px;margin-bottom:14px;overflow-x:auto}\
.lead li{margin:6px 0;font-size:16px}.grid{display:grid;gap:14px;grid-template-columns:repeat(auto-fit,minmax(min(100%,420px),1fr))}\
figure{margin:0}figure img{width:100%;border-radius:6px;display:block}figcaption{color:var(--soft);font-size:13px}\
svg{display:block;width:100%;height:auto;border-radius:6px}.walk{fill:none;stroke:#fff;stroke-width:5;stroke-linejoin:round;paint-order:stroke}\
.walk.thin{stroke:#111;stroke-width:2}.slip{fill:#d5003c}\
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums;font-size:14px}\
th,td{padding:4px 10px;text-align:right;border-top:1px solid var(--line)}th{color:var(--soft);font-weight:600;border-top:0}\
th:first-child,td:first-child{text-align:left;padding-left:0}.key{display:inline-block;width:12px;height:12px;border-radius:3px;margin-right:6px}\
.bar{display:inline-block;height:10px;border-radius:3px;background:var(--accent);vertical-align:middle}.bar.before{background:var(--before)}";

/// The whole page.
///
/// # Errors
/// A picture cannot be encoded.
pub fn to_html(parts: &Parts) -> Result<String, Failure> {
    let mut text = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>From place and robot to a simulator that agrees</title><style>{STYLE}</style>\
         <h1>From place and robot to a simulator that agrees</h1>{}",
        summary(parts)
    );
    text += &photographs(parts);
    if let Some(mesh) = &parts.mesh {
        text += &ground(mesh, parts.contact.as_ref())?;
    }
    if let Some(contact) = &parts.contact {
        text += &friction(contact);
    }
    if let Some(diagnosis) = &parts.diagnosis {
        text += &causes(diagnosis);
    }
    if let Some(tuning) = &parts.tuning {
        text += &tuned(tuning, parts.paths.as_ref());
    }
    Ok(text + "</html>\n")
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
    let mut text = String::from(
        "<h2>The policy, trained on in the corrected simulator</h2><div class=\"card\"><table><tr><th>simulator</th>\
         <th>joints off on held-out recordings [mrad]</th><th>stays</th></tr>",
    );
    for candidate in list(&tuning["candidates"]) {
        let held = &candidate["held_out"];
        let milli = |value: &Value| value.as_f64().map_or("–".into(), |x| format!("{:.1}", 1e3 * x));
        _ = write!(
            text,
            "<tr><td>{}</td><td>{} ± {}</td><td>{}</td></tr>",
            escape(candidate["compensation"]["kind"].as_str().unwrap_or("–")),
            milli(&held["error"]),
            milli(&held["error_se"]),
            if held["stays"] == true { "yes" } else { "no" }
        );
    }
    text += "</table></div><div class=\"card\"><table><tr><th>distance from the commanded path over 8 s [m]</th><th>before</th><th>after</th></tr>";
    let mut row = |name: &str, before: &Value, after: &Value| {
        let cell = |score: &Value| format!("{} ± {}", number(&score["position"], 3), number(&score["position_se"], 3));
        _ = write!(text, "<tr><td>{name}</td><td>{}</td><td>{}</td></tr>", cell(before), cell(after));
    };
    row("expected, in a simulator fitted to held-out recordings", &tuning["before"], &tuning["after"]);
    if let Some([before, after]) = paths.and_then(strayed) {
        row("<b>on the made-up robot itself</b>", before, after);
    }
    text + "</table></div>"
}

/// A number of a report, or a dash.
fn number(value: &Value, digits: usize) -> String {
    value.as_f64().map_or("–".into(), |x| format!("{x:.digits$}"))
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// A sentence for each part.
fn summary(parts: &Parts) -> String {
    let mut said: Vec<String> = vec![];
    if let Some(scores) = &parts.scores {
        said.push(format!(
            "The place is {} Gaussians, learned from {} photographs; photographs that were held out are met with {} dB (SSIM {}).",
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
    for (part, key) in [(&parts.contact, "sentence"), (&parts.replay, "verdict"), (&parts.diagnosis, "sentence")] {
        said.extend(part.as_ref().and_then(|report| report[key].as_str()).map(escape));
    }
    said.extend(parts.tuning.as_ref().and_then(|report| report["why"].as_str()).map(escape));
    if let Some([before, after]) = parts.paths.as_ref().and_then(strayed) {
        said.push(format!(
            "The made-up robot strays {} m from the commanded path with the policy as it was, and {} m with the tuned one.",
            number(&before["position"], 3),
            number(&after["position"], 3)
        ));
    }
    let items: Vec<String> = said.iter().map(|sentence| format!("<li>{sentence}</li>")).collect();
    format!("<div class=\"card\"><ul class=\"lead\">{}</ul></div>", items.concat())
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
        "<h2>The place: photographs that were held out, and what is drawn there</h2>\
         <p class=\"soft\">Left the photograph, right the scene of Gaussians from the same place.</p><div class=\"grid\">{}</div>",
        figures.concat()
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
                "<span class=\"key\" style=\"background:rgb({r},{g},{b})\"></span>{} &nbsp; ",
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
    let mut text = String::from(
        "<h2>Friction of each label</h2><div class=\"card\"><table><tr><th>label</th><th>before</th><th>after</th>\
         <th>90 % interval</th><th></th><th>feet on it</th><th>slipping</th></tr>",
    );
    for region in list(&contact["regions"]) {
        let used = if region["status"] == "refined" { "posterior" } else { "prior_estimate" };
        let interval = &region[used]["interval90"];
        _ = write!(
            text,
            "<tr><td>{}</td><td>{}</td><td><b>{}</b></td><td>{} to {}</td><td>{}</td><td>{} s</td><td>{} %</td></tr>",
            escape(region["label"].as_str().unwrap_or("–")),
            number(&region["prior_estimate"]["mean"], 2),
            number(&region["friction"], 3),
            number(&interval[0], 2),
            number(&interval[1], 2),
            escape(&region["status"].as_str().unwrap_or("–").replace('_', " ")),
            number(&region["contact_time"], 1),
            region["slip_share"].as_f64().map_or("–".into(), |share| format!("{:.0}", 100.0 * share)),
        );
    }
    text += "</table>";
    let held_out = &contact["base_error"]["held_out"];
    let errors = if held_out.is_object() { held_out } else { &contact["base_error"]["all"] };
    let most = ["uniform", "prior", "posterior"].iter().filter_map(|key| errors[key].as_f64()).fold(0.0, f64::max);
    if most > 0.0 {
        _ = write!(
            text,
            "<p class=\"soft\">Mean error of the base when {} s are replayed open loop</p><table>",
            number(&contact["base_error"]["segment"], 1)
        );
        for (key, words) in
            [("uniform", "one friction everywhere"), ("prior", "friction by label, before"), ("posterior", "after")]
        {
            let value = errors[key].as_f64().unwrap_or(0.0);
            let kind = if key == "posterior" { "bar" } else { "bar before" };
            _ = write!(
                text,
                "<tr><td>{words}</td><td style=\"text-align:left;width:60%\"><span class=\"{kind}\" style=\"width:{:.1}%\"></span></td><td>{:.1} cm</td></tr>",
                90.0 * value / most,
                100.0 * value
            );
        }
        text += "</table>";
    }
    text + "</div>"
}

fn causes(diagnosis: &Value) -> String {
    let gap = &diagnosis["gap"];
    let mut text = format!(
        "<h2>What still makes robot and simulator differ</h2><div class=\"card\"><p>{}</p>\
         <p class=\"soft\">Gap {} before, {} after, {} of noise alone.</p>",
        escape(diagnosis["sentence"].as_str().unwrap_or("–")),
        number(&gap["before"], 2),
        number(&gap["after"], 2),
        number(&gap["floor"], 2)
    );
    if !list(&diagnosis["causes"]).is_empty() {
        text += "<table><tr><th>cause</th><th>probability</th><th>size</th><th>95 % interval</th><th>closes alone</th></tr>";
    }
    for cause in list(&diagnosis["causes"]) {
        for (k, parameter) in list(&cause["parameters"]).iter().enumerate() {
            let first = |words: String| if k == 0 { words } else { String::new() };
            let share = |value: &Value| value.as_f64().map_or("–".into(), |x| format!("{:.0} %", 100.0 * x));
            _ = write!(
                text,
                "<tr><td>{}</td><td>{}</td><td>{} {} {}</td><td>{} to {}</td><td>{}</td></tr>",
                first(escape(&cause["effect"].as_str().unwrap_or("–").replace('_', " "))),
                first(share(&cause["probability"])),
                escape(parameter["name"].as_str().unwrap_or("")),
                number(&parameter["value"], 4),
                escape(parameter["unit"].as_str().unwrap_or("")),
                number(&parameter["ci95"][0], 4),
                number(&parameter["ci95"][1], 4),
                first(share(&cause["closed_alone"])),
            );
        }
    }
    if !list(&diagnosis["causes"]).is_empty() {
        text += "</table>";
    }
    let shares: Vec<String> = list(&diagnosis["where"]["interfaces"])
        .iter()
        .filter_map(|one| Some(format!("{} {:.0} %", escape(one["name"].as_str()?), 100.0 * one["share"].as_f64()?)))
        .collect();
    text + &format!("<p class=\"soft\">Where the gap lies: {}.</p></div>", shares.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

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
            diagnosis: None,
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
        for part in
            ["Slippery &lt;tiles&gt;.", "a&lt;b", "not touched", "0.200", "5.0 cm", "base64,AQID", "Better by far."]
        {
            assert!(page.contains(part), "{part}");
        }
        for part in [
            "a&lt;net</td><td>12.3 ± 1.0",
            "0.400 ± 0.010",
            "0.500 ± 0.020",
            "strays 0.500 m",
            "0.111 m with the tuned",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("What still makes") && !page.contains("NaN"));
    }
}
