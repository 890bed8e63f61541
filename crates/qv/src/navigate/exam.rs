//! `qv navigate test` in many places: a table with one row for each place and pilot.

use super::Test;
use super::many::TRAINED;
use super::weights_file::{fingerprint, network_at};
use crate::outcome::about;
use crate::output::write_whole;
use crate::progress::{Stages, remark};
use crate::{Failure, Outcome, say};
use qv_nav::exam::{Answers, Exam, ExamRow, ExamSettings, PILOTS, examine};
use qv_nav::eye::Paints;
use qv_nav::goals::GoalKind;
use qv_nav::lens::LensSpread;
use qv_nav::net::Net;
use qv_nav::places::{Role, Site, SiteSettings, TrainingPlaces, number};
use qv_nav::score::{Mean, Share};
use qv_nav::task::Trial;
use qv_nav::weights::GoalInput;
use serde::Serialize;
use std::fs;

/// The results of `qv navigate test` in many places.
#[derive(Serialize)]
struct ManyResults {
    format: &'static str,
    weights: String,
    /// Which goals: `trained`, `unseen`, or `named`.
    goals: String,
    seed: u64,
    /// Whether the places were compared with those of the training.
    checked: bool,
    pilots: [&'static str; 5],
    places: Vec<PlaceResult>,
    all: Vec<ExamRow>,
    said: [Answers; 2],
}

#[derive(Serialize)]
struct PlaceResult {
    #[serde(flatten)]
    exam: Exam,
    rows: Vec<ExamRow>,
}

impl Test {
    /// The test in many places.
    pub(super) fn examine(&self) -> Result<Outcome, Failure> {
        let net = Net::default();
        let (parameters, input) = network_at(&self.weights, &net)?;
        let goals = match (input, self.unseen_goals) {
            (GoalInput::Name, true) => {
                return Err("--unseen-goals: expected weights whose goals are colours, found some with names".into());
            }
            (GoalInput::Name, false) => None,
            (GoalInput::Colour, true) => Some(GoalKind::Unseen),
            (GoalInput::Colour, false) => Some(GoalKind::Trained),
        };
        let trained = self.trained()?;
        let count = self.many.places.unwrap_or(0);
        let numbers: Vec<u64> = match (&trained, self.training_places) {
            (Some(trained), true) => trained.numbers().take(count as usize).collect(),
            (None, true) => {
                return Err(about(
                    &self.weights,
                    format!("--training-places: expected {TRAINED} beside it, found none"),
                ));
            }
            _ => (0..count).map(|index| number(Role::Test, self.task.place.seed, index)).collect(),
        };
        let mut sites = self.many.scenes(&self.task.place, goals, &Paints { count: 1, ..Paints::default() })?;
        let settings = SiteSettings { goals, rig: self.task.place.rig()?, ..SiteSettings::default() };
        for number in numbers {
            let (site, eye) = Site::drawn(number, &settings)?;
            sites.push(site.seen_by(Box::new(eye)));
        }
        match &trained {
            Some(trained) if !self.training_places => {
                trained.check_unseen(&sites).map_err(|e| about(&self.weights, e))?;
            }
            Some(_) => {}
            None => {
                remark(&format!("no {TRAINED} beside the weights: not checked whether a place was one of the training"))
            }
        }
        if sites.is_empty() {
            return Err("expected at least one place: --places or --with-scene".into());
        }
        let exam = ExamSettings {
            episodes: self.episodes.div_ceil(sites.len()),
            pictures: self.pictures.div_ceil(sites.len()),
            seed: self.task.place.seed,
            spread: match self.task.camera.as_str() {
                "none" => LensSpread::none(),
                _ => LensSpread::wide(),
            },
        };
        let mut results = Vec::new();
        let stages = Stages::new();
        for (k, site) in sites.iter().enumerate() {
            stages.at(k as f64 / sites.len() as f64, &site.name);
            let exam = examine(site, &net, &parameters, &exam)?;
            let rows = exam.trials.iter().map(|trials| ExamRow::of(trials)).collect();
            results.push(PlaceResult { exam, rows });
        }
        stages.finish();
        self.report(ManyResults {
            format: "qv-navigate-places-test/1",
            weights: fingerprint(&parameters),
            goals: goals.map_or("named", |kind| if kind == GoalKind::Unseen { "unseen" } else { "trained" }).into(),
            seed: self.task.place.seed,
            checked: trained.is_some(),
            pilots: PILOTS,
            all: (0..PILOTS.len()).map(|k| ExamRow::of(&together(&results, k))).collect(),
            said: [0, 1].map(|k| results.iter().fold(Answers::default(), |sum, r| sum.and(r.exam.said[k]))),
            places: results,
        })
    }

    /// In which places the network was trained, if that is beside its weights.
    fn trained(&self) -> Result<Option<TrainingPlaces>, Failure> {
        let path = self.weights.with_file_name(TRAINED);
        match fs::read(&path) {
            Ok(bytes) => Ok(Some(serde_json::from_slice(&bytes).map_err(|e| about(&path, e))?)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(about(&path, e)),
        }
    }

    fn report(&self, results: ManyResults) -> Result<Outcome, Failure> {
        write_whole(&self.out, &serde_json::to_vec(&results)?)?;
        if self.json {
            say(&format!("{}\n", serde_json::to_string(&results)?))?;
            return Ok(Outcome::Done);
        }
        let mut text = String::new();
        for place in &results.places {
            text += &table(&place.exam.place, &place.rows, place.exam.said);
        }
        text += &table(&format!("all {} places", results.places.len()), &results.all, results.said);
        say(&text)?;
        Ok(Outcome::Done)
    }
}

/// Trials of one pilot in all places.
fn together(results: &[PlaceResult], pilot: usize) -> Vec<Trial> {
    results.iter().flat_map(|result| result.exam.trials[pilot].iter().cloned()).collect()
}

fn percent(share: &Share) -> String {
    let [low, high] = share.interval.map(|x| 100.0 * x);
    format!("{:.1} % ({low:.1} to {high:.1})", 100.0 * share.share)
}

fn mean(mean: &Mean) -> String {
    let [low, high] = mean.interval;
    format!("{:.2} ({low:.2} to {high:.2})", mean.value)
}

/// The lines of one place.
fn table(name: &str, rows: &[ExamRow], said: [Answers; 2]) -> String {
    let count = rows.first().map_or(0, |row| row.row.episodes);
    let mut text = format!("{name}: {count} episodes\n");
    for (pilot, row) in PILOTS.iter().zip(rows) {
        let reached = Share::of(row.row.reached, row.row.episodes);
        text += &format!(
            "  {pilot:13} reached {}, SPL {}, collisions {}, pushed {}, length {} m\n",
            percent(&reached),
            mean(&row.spl),
            percent(&row.collisions),
            percent(&row.pushed),
            mean(&row.length)
        );
    }
    for (pilot, said) in [PILOTS[0], PILOTS[2]].iter().zip(said) {
        text += &format!(
            "  {pilot:13} false goals {} of {} pictures without one; found {} of {} with one; balanced {:.2} (a guess: 0.50)\n",
            percent(&said.imagined()),
            said.without[0],
            percent(&said.found()),
            said.with[0],
            said.balanced()
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn a_table_says_shares_with_their_numbers() {
        let rows: Vec<ExamRow> = PILOTS.iter().map(|_| ExamRow::of(&[])).collect();
        let said = Answers { with: [10, 9], without: [40, 2] };
        let text = table("yard 1", &rows, [said, Answers::default()]);
        assert!(text.states("yard 1 0 episodes false goals 5.0 of 40 90.0 of 10"), "{text}");
    }
}
