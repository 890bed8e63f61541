//! `qv navigate look`: what a policy says of photographs beside what it says of the scene drawn from the same places.

use super::page::png_in_base64;
use super::place::Place;
use super::weights_file::{commanded, network_at};
use crate::capture::open_capture;
use crate::numbers::positive;
use crate::outcome::about;
use crate::output::{refuse_inputs, write_whole};
use crate::progress::remark;
use crate::scene::open_cameras;
use crate::terminal::print_message;
use crate::{Failure, Outcome, say};
use glam::DVec2;
use qv_core::{Camera, Pose, statistics};
use qv_mesh::similarity::Similarity;
use qv_nav::eye::Paints;
use qv_nav::net::{HEIGHT as ROWS, Net, WIDTH as COLUMNS};
use qv_nav::photographs::{Agreement, Pair, Photograph, PictureScores, Question, agreement, pairs, questions};
use qv_nav::score::Share;
use qv_page::parts::{card, grid, titled_card, track_with_interval};
use qv_page::{Page, Table, fixed, percent};
use qv_splat::captures::Capture;
use qv_splat::train::{Dataset, ReadOptions};
use serde::Deserialize;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Look {
    /// Weights of `qv navigate train` (weights.bin)
    weights: PathBuf,
    #[command(flatten)]
    place: Place,
    /// Read the capture of the scene: transforms.json, COLMAP or RGB-D
    #[arg(long, value_name = "CAPTURE", help_heading = "Input")]
    capture: PathBuf,
    /// Read refined cameras of `qv reconstruct` (cameras.json)
    #[arg(long, value_name = "FILE.json", help_heading = "Input")]
    cameras: Option<PathBuf>,
    /// Read the line printed by `qv mesh --scene-out .. --json`
    #[arg(long, value_name = "FILE.json", help_heading = "Input", hide_short_help = true)]
    moved: Option<PathBuf>,
    /// Use every Nth image, as held out by `qv reconstruct`; 1 for all
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..), help_heading = "What to test", hide_short_help = true)]
    hold_out: usize,
    /// Insert at most N cones per image
    #[arg(long, default_value_t = 4, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=100), value_name = "N", help_heading = "What to test", hide_short_help = true)]
    cones: usize,
    /// Skip images taken higher above the ground
    #[arg(long, value_name = "METRES", default_value_t = 3.0, value_parser = positive, help_heading = "Advanced", hide_short_help = true)]
    highest: f64,
    /// Write the page to this file
    #[arg(long, value_name = "FILE.html", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

/// Pairs that the page shows.
const SHOWN: usize = 24;

/// What was looked at, beside what came out.
struct PictureReport {
    pairs: Vec<Pair>,
    photographs: usize,
    /// Heights of their cameras above the ground \[m\], in order.
    heights: Vec<f64>,
}

impl Look {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let others = [&self.cameras, &self.moved, &self.place.mount].into_iter().flatten();
        let inputs = [&self.weights, self.place.scene()?, self.place.mesh()?, &self.capture];
        refuse_inputs(&self.out, others.chain(inputs))?;
        let (world, eye) = self.place.seen(self.place.rig()?, &Paints { count: 1, ..Paints::default() })?;
        let net = Net::default();
        let (parameters, input) = network_at(&self.weights, &net)?;
        let world = commanded(world, input);
        let (photographs, lost) = self.photographs()?;
        let mut looked = PictureReport { pairs: vec![], photographs: 0, heights: vec![] };
        let (mut narrow, mut high) = (0, 0);
        for (k, photograph) in photographs.iter().enumerate() {
            let ground = |p| world.map.height(p).or(self.place.floor);
            let Some(height) = above(photograph, ground).filter(|h| *h < self.highest) else {
                high += 1;
                continue;
            };
            let found = pairs(&world, &eye, photograph, self.cones, self.place.seed.wrapping_add(k as u64))?;
            if found.is_empty() {
                narrow += 1;
                continue;
            }
            looked.photographs += 1;
            looked.heights.push(height);
            looked.pairs.extend(found);
        }
        if narrow > 0 {
            remark(&format!("{narrow} images do not fill the view of the robot's camera (--mount) and are left out"));
        }
        if high > 0 {
            let most = self.highest;
            remark(&format!(
                "{high} images were taken from where the mesh has no ground below them, or from higher than {most} m, and are left out"
            ));
        }
        if looked.pairs.iter().all(|pair| pair.goal.is_none()) {
            let found = format!("none in {} of {} images", looked.photographs, photographs.len());
            return Err(about(
                &self.capture,
                format!("expected views in which a cone can stand on free ground, found {found}"),
            ));
        }
        looked.heights.sort_by(f64::total_cmp);
        let result = agreement(&world, &net, &parameters, &looked.pairs);
        let questions = questions(&world, &net, &parameters, &looked.pairs);
        write_whole(&self.out, to_html(&result, &looked, &questions)?.as_bytes())?;
        if self.json {
            let line = json!({"format": "qv-navigate-look/1", "photographs": looked.photographs, "heights_m": looked.heights,
                "agreement": result, "pictures": questions, "out": self.out, "lost": lost});
            say(&format!("{line}\n"))?;
        } else {
            say(&summary(&result, &looked))?;
        }
        lost.iter().for_each(|what| print_message!("lost: {what}"));
        Ok(if lost.is_empty() { Outcome::Done } else { Outcome::Partial })
    }

    /// Photographs where scene and mesh have them, and what of the capture was lost.
    fn photographs(&self) -> Result<(Vec<Photograph>, Vec<String>), Failure> {
        let result_from_scene = self.moved.as_deref().map_or(Ok(Similarity::IDENTITY), similarity)?;
        let opened = open_capture(&self.capture)?;
        let files = |path: &str| opened.read(path);
        let is_all = self.hold_out == 1;
        let reading = ReadOptions { hold_out: if is_all { 0 } else { self.hold_out }, ..ReadOptions::default() };
        let data = Dataset::new(&opened.capture, &files, &reading).map_err(|e| about(&self.capture, e))?;
        let chosen = if is_all { data.training } else { data.held_out };
        let found = self.cameras.as_deref().map(open_cameras).transpose()?;
        let (mut taken, mut lost) = (Vec::new(), data.lost);
        for photograph in chosen {
            let (colours, valid) = (photograph.colour(), photograph.valid());
            let Some(mut camera) = found.as_ref().map_or(Some(photograph.camera), |f| adopted(f, &photograph)) else {
                lost.push(format!("{}: expected it among the cameras of --cameras, found none", photograph.name));
                continue;
            };
            camera.camera_from_world = result_from_scene.of_camera(&camera.camera_from_world);
            taken.push(Photograph { camera, colours, valid });
        }
        Ok((taken, lost))
    }
}

/// The camera of a photograph as another capture has it, which may be of smaller pictures.
fn adopted(found: &Capture, photograph: &qv_splat::train::Photograph) -> Option<Camera> {
    let camera = found.cameras.iter().find(|one| one.name == photograph.name)?.camera;
    let [across, down] = [
        f64::from(photograph.camera.width) / f64::from(camera.width),
        f64::from(photograph.camera.height) / f64::from(camera.height),
    ];
    let Camera { width, height, .. } = photograph.camera;
    let (fx, cx, fy, cy) = (camera.fx * across, camera.cx * across, camera.fy * down, camera.cy * down);
    Some(Camera { fx, fy, cx, cy, width, height, ..camera })
}

/// Height of a camera over the ground below it \[m\].
fn above(photograph: &Photograph, ground: impl Fn(DVec2) -> Option<f64>) -> Option<f64> {
    let eye = photograph.camera.camera_from_world.inverse().position;
    ground(eye.truncate()).map(|ground| eye.z - ground)
}

/// As `qv mesh --json` prints it.
#[derive(Deserialize)]
struct Move {
    scale: f64,
    position: [f64; 3],
    rotation_wxyz: [f64; 4],
}

/// The move in what `qv mesh --json` printed.
fn similarity(file: &Path) -> Result<Similarity, Failure> {
    let text = fs::read_to_string(file).map_err(|e| about(file, e))?;
    let line: Value = serde_json::from_str(&text).map_err(|e| about(file, format!("expected JSON, found {e}")))?;
    let moved = &line["result_from_scene"];
    let is_turn = |q: &[f64; 4]| (q.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-3;
    Move::deserialize(moved)
        .ok()
        .filter(|found| found.scale > 0.0 && is_turn(&found.rotation_wxyz))
        .and_then(|found| {
            let pose = Pose::from_position_wxyz(found.position, found.rotation_wxyz)?;
            Some(Similarity { scale: found.scale, pose })
        })
        .ok_or_else(|| about(file, format!("expected `result_from_scene` of `qv mesh --json`, found {moved}")))
}

fn rows(result: &Agreement) -> [(&'static str, &PictureScores); 2] {
    [("drawn", &result.drawn), ("photographed", &result.photographed)]
}

/// Such as `12.3 deg`, or a dash.
fn or_dash(value: Option<f64>, write: impl Fn(f64) -> String) -> String {
    value.map_or_else(|| "–".into(), write)
}

fn bearing(found: &PictureScores) -> String {
    or_dash(found.bearing, |off| format!("{}°", fixed(off.to_degrees(), 1)))
}

fn distance(found: &PictureScores) -> String {
    or_dash(found.distance, |off| percent(off.exp_m1()))
}

/// Such as `3 of 150, 2 % (1 % to 6 %)`.
fn of_questions(found: &PictureScores, result: &Agreement) -> String {
    let Share { hits, n, share, interval: [low, high] } = Share::of(found.imagined, result.questions);
    format!("{hits} of {n}, {} ({} to {})", percent(share), percent(low), percent(high))
}

fn heights(looked: &PictureReport) -> String {
    let mut all = looked.heights.clone();
    let (low, high) = (all[0], all[all.len() - 1]);
    format!("{low:.2} to {high:.2} m above the ground, in the middle {:.2} m", statistics::median(&mut all))
}

fn summary(result: &Agreement, looked: &PictureReport) -> String {
    let mut text = format!(
        "{} images, {}: {} views with a cone, {} questions without\n",
        looked.photographs,
        heights(looked),
        result.views,
        result.questions
    );
    for (name, found) in rows(result) {
        let [low, high] = found.interval.map(|x| 100.0 * x);
        text += &format!(
            "{name:13} cone found {:.1} % ({low:.1} to {high:.1}), bearing off {}, distance off {}, false goals {}\n",
            100.0 * found.share,
            bearing(found),
            distance(found),
            of_questions(found, result)
        );
    }
    text + &format!("McNemar's exact test of what is found, captured against drawn: p = {:.4}\n", result.p)
}

const STYLE: &str = ".pair{width:100%;image-rendering:pixelated;border-radius:6px}";

/// What was said of the pictures of a pair.
fn said(questions: &[Question], pair: usize) -> String {
    let one = |q: &Question| {
        let answer = |a: &qv_nav::photographs::PictureAnswer| match a.sure > 0.5 {
            true => format!("seen at {}°, {} m", fixed(a.bearing_rad.to_degrees(), 0), fixed(a.distance_m, 1)),
            false => "not seen".into(),
        };
        let (left, right) = (answer(&q.photographed), answer(&q.drawn));
        format!("{}: {left} ({}) | {right} ({})", q.colour, percent(q.photographed.sure), percent(q.drawn.sure))
    };
    let lines: Vec<String> = questions.iter().filter(|q| q.pair == pair).map(one).collect();
    format!("<p class=\"soft\">{}</p>", lines.join("<br>"))
}

fn to_html(result: &Agreement, looked: &PictureReport, questions: &[Question]) -> Result<String, Failure> {
    let heads =
        ["picture", "cone found", "", "95 % interval", "bearing off", "distance off", "found where there is none"];
    let mut table = Table::with_left(&heads, &[2]);
    for (name, found) in rows(result) {
        table.row(&[
            name.into(),
            percent(found.share),
            track_with_interval(found.share, found.interval, "measured"),
            format!("{} to {}", percent(found.interval[0]), percent(found.interval[1])),
            bearing(found),
            distance(found),
            of_questions(found, result),
        ]);
    }
    let answer = match result.p {
        p if p < 0.05 => "The policy does not see images as it sees the scene: it may do worse on the robot than here.",
        _ => "No difference between images and scene is beyond chance. With few views that is weak evidence.",
    };
    let note = format!(
        "<p class=\"soft\">{} images, {}. {} views with a cone. The same cone is inserted into the image and into the drawn scene, \
         and the network is asked of each picture alone whether it sees a cone of that colour, in which direction, and how far away. \
         Errors are medians over the cones that are found. Where there is no cone it is asked for each of the three colours. \
         McNemar's exact test of what is found: p = {}.</p>",
        looked.photographs,
        heights(looked),
        result.views,
        fixed(result.p, 4)
    );
    let step = looked.pairs.len().div_ceil(SHOWN).max(1);
    let mut cards = String::new();
    for (k, pair) in looked.pairs.iter().enumerate().step_by(step) {
        let title = format!(
            "{k}: {}",
            pair.goal.map_or("no cone".into(), |goal| {
                let away = pair.base.position.truncate().distance(goal.axis());
                format!("{} cone, {} m", qv_nav::sight::COLOURS[goal.colour], fixed(away, 1))
            })
        );
        let rows = pair.photographed.chunks_exact(3 * COLUMNS).zip(pair.drawn.chunks_exact(3 * COLUMNS));
        let rgb: Vec<u8> = rows.flat_map(|(a, b)| [a, b].concat()).collect();
        let png = png_in_base64(&rgb, [2 * COLUMNS, ROWS])?;
        cards += &titled_card(
            &title,
            &format!(
                "<img class=\"pair\" alt=\"captured and drawn\" src=\"data:image/png;base64,{png}\">{}",
                said(questions, k)
            ),
        );
    }
    let body = format!(
        "{}<h2>Captured (left) and drawn (right)</h2><p class=\"soft\">{} of {} views.</p>{}",
        card(&(format!("<p>{answer}</p>") + &table.to_html() + &note)),
        looked.pairs.len().div_ceil(step),
        looked.pairs.len(),
        grid(300, &cards)
    );
    Ok(Page { title: "Does the policy see images as it sees the scene?", style: STYLE, body: &body, ..Page::default() }
        .to_html())
}
