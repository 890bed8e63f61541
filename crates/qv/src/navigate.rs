//! `qv navigate`: a network learns from pictures of a place to reach a cone in it, is tested, and its results become a page.

mod card;
mod exam;
mod legs;
mod look;
mod many;
mod page;
mod place;
mod train;
mod weights_file;

use crate::outcome::about;
use crate::output::{refuse_inputs, write_whole};
use crate::{Failure, Outcome, say};
use card::CardArguments;
use legs::{LegsArguments, Stable};
use page::{FromAbove, Results, Strip, TestRow, png_in_base64};
use place::Task;
use qv_nav::eye::Paints;
use qv_nav::map::MapSettings;
use qv_nav::net::{HEIGHT as ROWS, Net, WIDTH as COLUMNS};
use qv_nav::pilots::{BlobPilot, NetPilot, TeacherPilot};
use qv_nav::roll::{Pilot, Record, Stage, roll};
use qv_nav::score::{Row, compared};
use qv_nav::task::{End, Episode, PERIOD, Trial};
use std::fs;
use std::path::{Path, PathBuf};
use weights_file::{commanded, fingerprint, network_at};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv navigate train --scene out/policy.ply --terrain out/mesh.glb --out out/nav\n\
     \x20 qv navigate test out/nav/weights.bin --scene out/policy.ply --terrain out/mesh.glb --out out/nav/results.json\n\
     \x20 qv navigate look out/nav/weights.bin --scene out/policy.ply --terrain out/mesh.glb --capture yard --out out/nav/look.html\n\
     \x20 qv navigate page out/nav/results.json --out out/nav/index.html\n\
     \n\
     The scene should be small (qv reconstruct --downscale 4 --cap 20000), in metres, z up, in the frame of the mesh.\n\
     Guide: docs/guide/navigation.md."
);

#[derive(clap::Args)]
pub struct Navigate {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Train a navigation policy (DAgger, then PPO)
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv navigate train --scene out/policy.ply --terrain out/mesh.glb --out out/nav\n\
     \x20 qv navigate train --scene out/policy.ply --terrain out/mesh.glb --from out/nav/weights.bin --rounds 0 --ppo-rounds 20 --out out/ppo\n\
     \n\
     Results: policy.onnx, weights.bin, metrics.json."))]
    Train(train::Train),
    /// Measure the success rate on random episodes, beside baselines
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv navigate test out/nav/weights.bin --scene out/policy.ply --terrain out/mesh.glb --out out/nav/results.json"))]
    Test(Test),
    /// Compare policy outputs on real and rendered images
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv navigate look out/nav/weights.bin --scene out/policy.ply --terrain out/mesh.glb --capture yard --out out/nav/look.html"))]
    Look(look::Look),
    /// Write a page of test results: success, failures, paths
    #[command(after_long_help = crate::usage::help_text!("Examples:\n\
     \x20 qv navigate page out/nav/results.json --out out/nav/index.html"))]
    Page(ToPage),
}

#[derive(clap::Args)]
struct ToPage {
    /// Results of `qv navigate test` (results.json)
    results: PathBuf,
    /// Add results of the same policy with other low-level controllers
    #[arg(long, value_name = "RESULTS.json", num_args = 1.., help_heading = "Input")]
    beside: Vec<PathBuf>,
    /// Write the page to this file
    #[arg(long, value_name = "FILE.html", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

#[derive(clap::Args)]
struct Test {
    /// Weights of `qv navigate train` (weights.bin)
    weights: PathBuf,
    #[command(flatten)]
    task: Task,
    #[command(flatten)]
    many: many::Many,
    /// Test goals of a shape and of colours that no training draws
    #[arg(long, help_heading = "What to test")]
    unseen_goals: bool,
    /// Test in the drawn places of the training instead of in others
    #[arg(long, help_heading = "What to test", hide_short_help = true)]
    training_places: bool,
    /// Ask about N pictures without a goal
    #[arg(long, default_value_t = 400, value_parser = episodes, value_name = "N", help_heading = "What to test", hide_short_help = true)]
    pictures: usize,
    #[command(flatten)]
    legs: LegsArguments,
    /// Run N episodes
    #[arg(long, default_value_t = 200, value_parser = episodes, value_name = "N", help_heading = "What to test")]
    episodes: usize,
    /// Write the results to this file
    #[arg(long, value_name = "FILE.json", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
    #[command(flatten)]
    card: CardArguments,
}

/// Episodes of a test, from the command line.
fn episodes(text: &str) -> Result<usize, String> {
    crate::numbers::count(text, 1, 1_000_000)
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

impl Test {
    fn execute(&self) -> Result<Outcome, Failure> {
        let files = self.task.place.files().into_iter().chain(self.legs.files()).chain(self.many.files());
        let read = files.chain([&self.weights]);
        refuse_inputs(&self.out, read)?;
        let folder = self.out.parent().filter(|folder| !folder.as_os_str().is_empty());
        // Now, and not when all has been driven.
        folder.map_or(Ok(()), |folder| fs::create_dir_all(folder).map_err(|e| about(folder, e)))?;
        if self.many.is_asked() {
            return self.examine();
        }
        let net = Net::default();
        let (parameters, input) = network_at(&self.weights, &net)?;
        let (world, eye, camera) = self.task.open(&Paints { count: 1, ..Paints::default() })?;
        let world = commanded(world, input);
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
            rows.push(TestRow { name: name.into(), row, p_against_policy, trials: trials.clone() });
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
    use base64::Engine as _;
    use base64::engine::general_purpose::STANDARD;

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
    fn a_line_says_what_was_reached() {
        let text = line("blob", &Row::of(&[]), 1.0);
        assert!(text.starts_with("blob") && text.states("100.0 0.0 100.0"), "{text}");
    }
}
