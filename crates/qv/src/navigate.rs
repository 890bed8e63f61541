//! `qv navigate`: a network learns from pictures of a place to reach a cone in it, is tested, and its results become a page.

mod card;
mod legs;
mod look;
mod page;
mod train;

use crate::camera::open_camera;
use crate::output::{refuse_inputs, write_whole};
use crate::progress::remark;
use crate::scene::{about, open_scene};
use crate::{Failure, Outcome, say};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use card::CardArguments;
use image::ImageEncoder as _;
use legs::{LegsArguments, Stable};
use page::{FromAbove, Results, Strip, Tested};
use qv_nav::eye::{Paints, SplatEye};
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::net::{HEIGHT as ROWS, Net, WIDTH as COLUMNS};
use qv_nav::pilots::{BlobPilot, NetPilot, TeacherPilot};
use qv_nav::roll::{Pilot, Record, Stage, roll};
use qv_nav::score::{Row, compared};
use qv_nav::sight::Rig;
use qv_nav::task::{End, Episode, EpisodeSettings, Limits, PERIOD, Stratum, Trial};
use qv_nav::teacher::{TeacherSettings, World};
use qv_nav::veils::{Air, without_veils};
use qv_nav::{measured, weights};
use qv_open::ground::mesh_at;
use sha2::{Digest, Sha256};
use std::fs;
use std::path::{Path, PathBuf};

pub const EXAMPLE: &str = "Example:\n  qv navigate train --scene out/policy.ply --mesh out/mesh.glb --out out/nav\n  \
    qv navigate test out/nav/weights.bin --scene out/policy.ply --mesh out/mesh.glb --out out/nav/results.json\n  \
    qv navigate page out/nav/results.json --out out/nav/index.html\n  \
    qv navigate look out/nav/weights.bin --scene out/policy.ply --mesh out/mesh.glb --capture yard --out out/nav/look.html\n\n\
    The scene should be small (qv reconstruct --downscale 4 --cap 20000), in metres, z up, in the mesh's frame. Legs are a\n\
    follower of velocities without physics; with --walk they are a robot that walks in the simulator. Built with --features gpu, train --gpu draws and learns on the graphics card.\n\
    docs/navigation.md tells the rest.\n\n\
    Exit codes: 0 done, 1 failed, 2 wrong usage.";

/// Farthest from the base that a camera may sit \[m\]: what is taller is no robot that walks among cones.
const REACH: f64 = 5.0;
/// Height of the base over the ground \[m\]; most four-legged robots of this size have about that.
const HEIGHT: f64 = 0.3;

#[derive(clap::Args)]
pub struct Navigate {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Trains a policy: writes policy.onnx, weights.bin and metrics.json
    Train(train::Train),
    /// Tests weights on drawn episodes, beside the teacher and a follower of coloured blobs: writes results as JSON
    Test(Test),
    /// Says whether photographs of the place, with a cone laid into them, tell the policy the same as the drawn scene does: writes a page
    Look(look::Look),
    /// Makes one HTML file of the results of a test: shares, causes of failure, ways from above, what the policy saw
    Page(ToPage),
}

#[derive(clap::Args)]
struct ToPage {
    /// results.json of `qv navigate test`
    results: PathBuf,
    /// Other results of the same policy, such as on other legs: a row each
    #[arg(long, value_name = "RESULTS.json", num_args = 1..)]
    beside: Vec<PathBuf>,
    /// File for the page
    #[arg(long, value_name = "FILE.html")]
    out: PathBuf,
    /// One line of JSON at the end instead of the summary
    #[arg(long)]
    json: bool,
}

/// The place.
#[derive(clap::Args)]
struct Place {
    /// A scene of Gaussians (PLY, SPZ, GLB …)
    #[arg(long, value_name = "FILE")]
    scene: PathBuf,
    /// The labelled mesh of the same place
    #[arg(long, value_name = "FILE.glb")]
    mesh: PathBuf,
    /// Height of the floor wherever the mesh shows none, within its bounds, in metres: for captures that show little of their floor
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = finite)]
    floor: Option<f64>,
    /// The robot's camera, a file as for `qv diagnose --camera`: focal length, and where it sits; the base is 0.3 m above the ground
    #[arg(long, value_name = "FILE.toml")]
    mount: Option<PathBuf>,
    /// Leaves out Gaussians that hang more than so many metres over ground where the robot can get through; inf keeps all
    #[arg(long, value_name = "M", default_value_t = Air::default().from, value_parser = height)]
    air: f64,
    /// Of everything that is drawn
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// What is to be done in it.
#[derive(clap::Args)]
struct Task {
    #[command(flatten)]
    place: Place,
    /// How much cameras differ: wide, none, or as report.json of `qv diagnose --scene` says of the robot's own
    #[arg(long, value_name = "wide|none|report.json", default_value = "wide")]
    camera: String,
    /// Where cones are at the start, in turn; a place without anything high has no hidden ones
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [Start::View, Start::Turned, Start::Hidden])]
    starts: Vec<Start>,
    /// Least and greatest length of the way to a cone, in metres
    #[arg(long, value_name = "M,M", default_value = "2.5,7", value_parser = lengths)]
    distance: Lengths,
}

/// Where the cone is at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Start {
    /// In the picture
    View,
    /// Beside or behind the robot
    Turned,
    /// Behind something
    Hidden,
}

impl std::fmt::Display for Start {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Self::View => "view",
            Self::Turned => "turned",
            Self::Hidden => "hidden",
        })
    }
}

/// Two lengths \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lengths([f64; 2]);

#[derive(clap::Args)]
struct Test {
    /// weights.bin of `qv navigate train`
    weights: PathBuf,
    #[command(flatten)]
    task: Task,
    #[command(flatten)]
    legs: LegsArguments,
    /// Episodes
    #[arg(long, default_value_t = 200, value_parser = episodes)]
    episodes: usize,
    /// File for the results
    #[arg(long, value_name = "FILE.json")]
    out: PathBuf,
    /// One line of JSON at the end instead of the summary
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    card: CardArguments,
}

/// How cameras differ, and how the camera sits.
fn camera(name: &str, rig: &Rig) -> Result<(LensSpread, Rig), Failure> {
    match name {
        "wide" => Ok((LensSpread::wide(), *rig)),
        "none" => Ok((LensSpread::none(), *rig)),
        _ if name.ends_with(".json") => {
            let file = Path::new(name);
            let text = fs::read_to_string(file).map_err(|e| about(file, e))?;
            let report = serde_json::from_str(&text).map_err(|e| about(file, format!("expected JSON, found {e}")))?;
            Ok(measured::camera(&report, rig).map_err(|e| about(file, e))?)
        }
        _ => Err(format!("--camera: expected wide, none or a report.json, found `{name}`").into()),
    }
}

fn lengths(text: &str) -> Result<Lengths, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|x| x.trim().parse().ok()).collect();
    match numbers[..] {
        [least, most] if text.matches(',').count() == 1 && least > 0.0 && least < most && most.is_finite() => {
            Ok(Lengths([least, most]))
        }
        _ => Err(format!("expected two lengths in metres, the first less, such as 2.5,7, found `{text}`")),
    }
}

/// Episodes of a test, from the command line.
fn episodes(text: &str) -> Result<usize, String> {
    crate::numbers::count(text, 1, 1_000_000)
}

/// A height of the floor, from the command line \[m\].
fn finite(text: &str) -> Result<f64, String> {
    let found = text.trim().parse::<f64>().ok().filter(|h| h.abs() < 1e4);
    found.ok_or_else(|| format!("expected a height in metres, of less than 10 km, found `{text}`"))
}

/// A height above the ground, from the command line \[m\].
fn height(text: &str) -> Result<f64, String> {
    let found = text.trim().parse::<f64>().ok().filter(|h| *h > 0.0);
    found.ok_or_else(|| format!("expected a height above 0 in metres, or inf, found `{text}`"))
}

impl Navigate {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        match &self.command {
            Command::Train(command) => command.execute(),
            Command::Test(command) => command.execute(),
            Command::Look(command) => command.execute(),
            Command::Page(command) => command.execute(),
        }
    }
}

impl Task {
    fn episodes(&self) -> EpisodeSettings {
        let stratum = |start: &Start| match start {
            Start::View => Stratum::InView,
            Start::Turned => Stratum::Turned,
            Start::Hidden => Stratum::Hidden,
        };
        let strata = self.starts.iter().map(stratum).collect();
        EpisodeSettings { geodesic: self.distance.0, strata, ..Default::default() }
    }

    /// The place; in a training, its Gaussians are painted otherwise from episode to episode.
    fn open(&self, paints: &Paints) -> Result<(World, SplatEye, LensSpread), Failure> {
        let (spread, rig) = camera(&self.camera, &self.place.rig()?)?;
        let (world, eye) = self.place.seen(rig, paints)?;
        self.episodes().draw(&world, self.starts.len(), self.place.seed).map_err(|e| {
            about(
                &self.place.mesh,
                format!("{e}; --starts and --distance say which episodes there are, such as --starts view,turned"),
            )
        })?;
        Ok((world, eye, spread))
    }
}

impl Place {
    /// How the stated camera sits.
    fn rig(&self) -> Result<Rig, Failure> {
        let Some(file) = &self.mount else { return Ok(Rig::default()) };
        let camera = open_camera(file, None)?.rig;
        let focal = camera.intrinsics.fx * 640.0 / f64::from(camera.intrinsics.width);
        if !(focal > 10.0 && focal < 1e4) {
            return Err(about(file, format!("expected fx of 10 to 10000 px for 640 columns, found {focal}")));
        }
        let place = camera.base_from_camera.position;
        if !(place.length() < REACH && place.z > -HEIGHT) {
            let expected = format!("a camera above the ground, within {REACH} m of the base");
            return Err(about(file, format!("base_from_camera: expected {expected}, found {place}")));
        }
        Ok(Rig::default().mounted(&camera.base_from_camera, focal))
    }

    /// The files that are read.
    fn files(&self) -> Vec<&PathBuf> {
        [&self.scene, &self.mesh].into_iter().chain(&self.mount).collect()
    }

    /// The place, whether or not an episode can be drawn in it.
    fn seen(&self, rig: Rig, paints: &Paints) -> Result<(World, SplatEye), Failure> {
        let mesh = mesh_at(&self.mesh, "a labelled mesh in GLB")?;
        let map = Map::new(&mesh, &MapSettings { floor: self.floor, ..Default::default() })
            .map_err(|e| about(&self.mesh, e))?;
        let eye = self.eye(&self.scene, &map, paints)?;
        let usual = TeacherSettings::default();
        // A camera on a mast looks over what hides a cone from a dog.
        let over = if self.mount.is_some() { HEIGHT + rig.place[2] } else { usual.eye };
        Ok((World::with(map, rig, Limits::default(), TeacherSettings { eye: over, ..usual }), eye))
    }

    /// A scene of the place as it is drawn.
    fn eye(&self, file: &Path, map: &Map, paints: &Paints) -> Result<SplatEye, Failure> {
        let opened = open_scene(file)?;
        let scene = opened.cloud;
        let [low, high] = map.bounds();
        let is_over = |[x, y, _]: &[f32; 3]| {
            (low.x..=high.x).contains(&f64::from(*x)) && (low.y..=high.y).contains(&f64::from(*y))
        };
        if !scene.means.iter().any(is_over) {
            let expected = format!(
                "Gaussians over the mesh, at x {:.1} to {:.1} m, y {:.1} to {:.1} m",
                low.x, high.x, low.y, high.y
            );
            return Err(about(file, format!("expected {expected}, found none of {} there", scene.len())));
        }
        let cloud = without_veils(&scene, map, &Air { from: self.air, ..Air::default() });
        match scene.len() - cloud.len() {
            0 => {}
            hang => remark(&format!(
                "{}: {hang} of {} Gaussians hang more than {} m over free ground and are left out (--air)",
                file.display(),
                scene.len(),
                self.air
            )),
        }
        let eye = SplatEye::painted(&cloud, paints, self.seed).as_made(opened.background, opened.antialias);
        if eye.count() > 200_000 {
            remark(&format!(
                "{}: with so many Gaussians pictures take long, and a graphics card holds them eight times",
                file.display()
            ));
        }
        Ok(eye)
    }
}

impl Test {
    fn execute(&self) -> Result<Outcome, Failure> {
        let read = self.task.place.files().into_iter().chain(self.legs.files()).chain([&self.weights]);
        refuse_inputs(&self.out, read)?;
        let folder = self.out.parent().filter(|folder| !folder.as_os_str().is_empty());
        // Now, and not when all has been driven.
        folder.map_or(Ok(()), |folder| fs::create_dir_all(folder).map_err(|e| about(folder, e)))?;
        let net = Net::default();
        let parameters = weights_at(&self.weights, &net)?;
        let (world, eye, camera) = self.task.open(&Paints { count: 1, ..Paints::default() })?;
        let eye = self.card.eye(eye)?;
        let stage = Stage::new(&world, &*eye, camera);
        let stable = self.legs.open(&self.task.place)?;
        let episodes = self.task.episodes().draw(&world, self.episodes, self.task.place.seed)?;
        let count = episodes.len().clamp(1, 64);
        let limits = world.limits;
        let (policy, strips) = seen(&stage, &stable, &episodes, &mut NetPilot::new(&net, &parameters, count), count)?;
        let teacher = trials(&stage, &stable, &episodes, &mut TeacherPilot { limits }, count)?;
        let blob = trials(&stage, &stable, &episodes, &mut BlobPilot { limits }, count)?;
        let mut rows = Vec::new();
        for (name, trials) in [("policy", &policy), ("teacher", &teacher), ("blob", &blob)] {
            let row = Row::of(trials);
            let p_against_policy = compared(&policy, trials);
            if !self.json {
                say(&line(name, &row, p_against_policy))?;
            }
            rows.push(Tested { name: name.into(), row, p_against_policy, trials: trials.clone() });
        }
        let spacing = MapSettings::default().spacing;
        let bounds = world.map.bounds().map(|p| p.to_array());
        let results = Results {
            legs: stable.name().into(),
            eye: "splat".into(),
            camera: self.task.camera.clone(),
            weights: fingerprint(&parameters),
            seed: self.task.place.seed,
            episodes,
            rows,
            place: FromAbove { bounds, spacing, closed: world.map.closed_rows() },
            strips,
        };
        write_whole(&self.out, &serde_json::to_vec(&results)?)?;
        if self.json {
            say(&format!("{}\n", serde_json::to_string(&results)?))?;
        }
        Ok(Outcome::Done)
    }
}

impl ToPage {
    fn execute(&self) -> Result<Outcome, Failure> {
        let results = results_at(&self.results)?;
        let beside = self.beside.iter().map(|file| results_at(file)).collect::<Result<Vec<_>, _>>()?;
        let other = self.beside.iter().zip(&beside).find(|(_, other)| other.weights != results.weights);
        if let Some((file, other)) = other {
            let found =
                format!("of {} where those of {} are {}", other.weights, self.results.display(), results.weights);
            return Err(about(file, format!("--beside: expected results of the same weights, found those {found}")));
        }
        refuse_inputs(&self.out, self.beside.iter().chain([&self.results]))?;
        write_whole(&self.out, page::to_html(&results, &beside).as_bytes())?;
        match self.json {
            true => say(&format!("{}\n", serde_json::json!({"format": "qv-navigate-page/1", "out": self.out})))?,
            false => say(&format!("written to {}\n", self.out.display()))?,
        }
        Ok(Outcome::Done)
    }
}

fn results_at(path: &Path) -> Result<Results, Failure> {
    let bytes = fs::read(path).map_err(|e| about(path, e))?;
    let wrong = |found: String| about(path, format!("expected results of `qv navigate test`, found {found}"));
    let results: Results = serde_json::from_slice(&bytes).map_err(|e| wrong(e.to_string()))?;
    let count = results.episodes.len();
    match results.rows.iter().find(|tested| tested.trials.len() != count) {
        Some(cut) => Err(wrong(format!("{} trials of {count} episodes in row {}", cut.trials.len(), cut.name))),
        None if results.rows.is_empty() => Err(wrong("no rows".into())),
        None => Ok(results),
    }
}

/// What weights are told apart by: the beginning of their SHA-256.
fn fingerprint(parameters: &[f32]) -> String {
    let hash = Sha256::digest(weights::to_bytes(parameters));
    hash.iter().take(8).map(|byte| format!("{byte:02x}")).collect()
}

fn weights_at(path: &Path, net: &Net) -> Result<Vec<f32>, Failure> {
    let bytes = fs::read(path).map_err(|e| about(path, e))?;
    weights::from_bytes(&bytes, net).map_err(|e| about(path, e))
}

/// Episodes of which the policy's pictures are kept, and pictures of each.
const STRIPS: usize = 12;
const PICTURES: usize = 10;

/// The trials of the policy, and what it saw in the first episodes.
fn seen(
    stage: &Stage,
    stable: &Stable,
    episodes: &[Episode],
    pilot: &mut dyn Pilot,
    count: usize,
) -> Result<(Vec<Trial>, Vec<Strip>), Failure> {
    let mut legs = stable.legs(stage.world, count)?;
    let rolled = roll(stage, &mut *legs, episodes, pilot, |k| k < STRIPS, &mut |_| {})?;
    let kept = rolled.iter().enumerate().filter(|(_, (_, record))| !record.is_empty());
    let strips = kept.map(|(episode, (_, record))| strip(episode, record)).collect::<Result<_, Failure>>()?;
    Ok((rolled.into_iter().map(|(trial, _)| trial).collect(), strips))
}

/// Pictures at equal times, side by side.
fn strip(episode: usize, record: &Record) -> Result<Strip, Failure> {
    let last = record.len() - 1;
    let count = PICTURES.min(record.len());
    let steps: Vec<usize> = (0..count).map(|k| k * last / (count - 1).max(1)).collect();
    let size = 3 * COLUMNS * ROWS;
    let mut rgb = Vec::with_capacity(count * size);
    for row in 0..ROWS {
        for step in &steps {
            rgb.extend_from_slice(&record.pictures[step * size + row * 3 * COLUMNS..][..3 * COLUMNS]);
        }
    }
    let times = steps.iter().map(|step| *step as f64 * PERIOD).collect();
    Ok(Strip { episode, times, png: png_in_base64(&rgb, [count * COLUMNS, ROWS])? })
}

/// Red, green, blue of so many columns and rows as a PNG in base64.
fn png_in_base64(rgb: &[u8], [width, height]: [usize; 2]) -> Result<String, Failure> {
    let mut png = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut png);
    encoder.write_image(rgb, width as u32, height as u32, image::ExtendedColorType::Rgb8)?;
    Ok(STANDARD.encode(png))
}

fn trials(
    stage: &Stage,
    stable: &Stable,
    episodes: &[Episode],
    pilot: &mut dyn Pilot,
    count: usize,
) -> Result<Vec<Trial>, Failure> {
    let mut legs = stable.legs(stage.world, count)?;
    let rolled = roll(stage, &mut *legs, episodes, pilot, |_| false, &mut |_| {})?;
    Ok(rolled.into_iter().map(|(trial, _)| trial).collect())
}

/// Such as `policy   reached 92.0 % (87.4 to 95.0), SPL 0.80, 9.1 s; lost 3, slow 2`.
fn line(name: &str, row: &Row, p: f64) -> String {
    let [low, high] = row.interval.map(|x| 100.0 * x);
    let time = row.time.map_or(String::new(), |t| format!(", {t:.1} s"));
    let others = End::ALL.iter().zip(row.ends).skip(1).filter(|(_, n)| *n > 0);
    let others: Vec<String> = others.map(|(end, n)| format!("{} {n}", end.name())).collect();
    let beside = if name == "policy" {
        String::new()
    } else {
        format!(" (p {} against the policy)", if p < 0.0005 { "< 0.001".into() } else { format!("= {p:.3}") })
    };
    let (share, ends) = (100.0 * row.success, others.join(", "));
    let ends = if ends.is_empty() { ends } else { format!("; {ends}") };
    format!("{name:8} reached {share:.1} % ({low:.1} to {high:.1}), SPL {:.2}{time}{ends}{beside}\n", row.spl)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn a_strip_shows_first_and_last_picture() {
        let mut record = Record::default();
        for step in 0..31u8 {
            record.pictures.extend(std::iter::repeat_n(step, 3 * COLUMNS * ROWS));
            record.commands.push([0.0; 3]);
        }
        let strip = strip(4, &record).unwrap();
        assert_eq!((strip.episode, strip.times.len(), strip.times[0], strip.times[9]), (4, 10, 0.0, 6.0));
        let image = image::load_from_memory(&STANDARD.decode(strip.png).unwrap()).unwrap().to_rgb8();
        assert_eq!((image.width(), image.height()), (800, 60));
        assert_eq!((image.get_pixel(79, 59).0, image.get_pixel(799, 0).0), ([0; 3], [30; 3]));
    }

    #[test]
    fn cameras_and_lines() {
        let rig = Rig::default();
        assert_eq!(camera("none", &rig).unwrap().0, LensSpread::none());
        assert_eq!(lengths("1.2, 2.5"), Ok(Lengths([1.2, 2.5])));
        for bad in ["", "3", "3,2", "1,2,3", "a,2", "1,inf", "-1,2"] {
            assert!(lengths(bad).unwrap_err().states("lengths"), "{bad}");
        }
        assert!(camera("posterior", &rig).unwrap_err().to_string().states("report.json"));
        assert!(camera("no/report.json", &rig).unwrap_err().to_string().contains("no/report.json"));
        let text = line("blob", &Row::of(&[]), 1.0);
        assert!(text.starts_with("blob") && text.states("100.0 0.0 100.0"), "{text}");
    }
}
