//! `qv effects` and `qv params`: the names that other commands take, with what they mean.

use crate::ground::terrain_of;
use crate::open::{file_error, model_named};
use crate::{Outcome, say};
use qv_camera::EFFECTS;
use qv_gap::problem::library::{self, Effect};
use qv_recording::RecordingError;
use qv_sim::{BaseKind, Batch, ParameterInfo, SimOptions};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

pub const EFFECTS_EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv effects\n\
     \x20 qv effects --library mine.toml --json\n\
     \n\
     Names are those of `qv diagnose --without` and of report.json. Ranges are search ranges; for masses they end where a\n\
     link would have no mass. Fixed-base ranges (column `held`) in N m, N m s/rad, kg m² and kg are those of a Go2; they\n\
     scale with the motors and mass of the robot."
);

pub const PARAMS_EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv params go2\n\
     \x20 qv params arm.urdf --fixed-base --json\n\
     \n\
     Names are those of --params files, where `*` matches any joint: \"actuator.*.lag\" = 0.01 under [parameters].\n\
     A neutral value leaves the model unchanged. Values outside the range are accepted."
);

/// What ends a range when nothing does \[any unit\].
const NO_LIMIT: f64 = 1e9;

#[derive(clap::Args)]
pub struct Effects {
    /// Add effects from a file
    #[arg(long, value_name = "FILE.toml", help_heading = "Input")]
    library: Option<PathBuf>,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Effects {
    pub fn execute(&self) -> Result<Outcome, RecordingError> {
        let mut all = library::built_in();
        if let Some(path) = &self.library {
            let text =
                fs::read_to_string(path).map_err(|e| file_error(path, "a library of effects", &e.to_string()))?;
            let own = library::parse(&text, &path.display().to_string());
            all.extend(own.map_err(|e| file_error(path, "a library of effects", &e.to_string()))?);
        }
        if self.json {
            let camera = EFFECTS.iter().map(
                |e| json!({"name": e.name, "about": e.about, "unit": e.unit, "group": "camera", "walking": e.range, "held": Value::Null}),
            );
            let effects: Vec<Value> = all.iter().map(effect_json).chain(camera).collect();
            say(&format!("{}\n", json!({"format": "qv-effects/1", "effects": effects})))?;
        } else {
            say(&effects_table(&all))?;
        }
        Ok(Outcome::Done)
    }
}

fn effect_json(effect: &Effect) -> Value {
    let moves: Vec<&String> = effect.axes.iter().flat_map(|axis| axis.moves.keys()).collect();
    json!({
        "name": effect.name,
        "about": effect.about,
        "unit": effect.unit,
        "group": effect.interface.name(),
        "absolute": effect.absolute,
        "walking": (!effect.held_only).then_some(effect.range),
        "held": effect.shows_on_held().then_some(effect.held_range.unwrap_or(effect.range)),
        "moves": moves,
    })
}

fn effects_table(all: &[Effect]) -> String {
    let range = |[low, high]: [f64; 2]| format!("{low} to {high}");
    let mut rows = vec![["name", "group", "unit", "walking", "held", "what it is"].map(String::from)];
    rows.extend(all.iter().map(|effect| {
        let walking = if effect.held_only { "-".into() } else { range(effect.range) };
        let held = if effect.shows_on_held() { range(effect.held_range.unwrap_or(effect.range)) } else { "-".into() };
        let kind = if effect.absolute { "value: " } else { "" };
        let about = format!("{kind}{}", effect.about);
        [effect.name.clone(), effect.interface.name().into(), effect.unit.clone(), walking, held, about]
    }));
    rows.extend(
        EFFECTS
            .iter()
            .map(|e| [e.name.into(), "camera".into(), e.unit.into(), range(e.range), "-".into(), e.about.into()]),
    );
    let deviations = "Ranges are of deviations from the model, but for those whose text begins with `value:`.\n";
    format!("{}\n{deviations}", table(&rows))
}

#[derive(clap::Args)]
pub struct Params {
    /// Robot: go2, go1, a1, a2, anymal_c, or a URDF, MJCF or TOML file
    #[arg(value_name = "ROBOT")]
    robot: String,
    /// Fix the base, as for an arm
    #[arg(long = "fixed-base", alias = "held", help_heading = "Input")]
    held: bool,
    /// Set the terrain: plane, or a mesh with one material per label
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb", help_heading = "Input")]
    terrain: String,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Params {
    pub fn execute(&self) -> Result<Outcome, RecordingError> {
        let model = model_named(&self.robot, if self.held { BaseKind::Fixed } else { BaseKind::Floating })?;
        let terrain = terrain_of(&self.terrain)?;
        let simulator = Batch::<f32>::new(&model, &terrain, &SimOptions::default(), 1)
            .map_err(|e| file_error(Path::new(&self.robot), "a robot that can be simulated", &e.to_string()))?;
        let all = simulator.catalogue();
        if self.json {
            let parameters: Vec<Value> = all.iter().map(parameter_json).collect();
            let line = json!({"format": "qv-params/1", "robot": self.robot, "parameters": parameters});
            say(&format!("{line}\n"))?;
        } else {
            say(&parameters_table(all))?;
        }
        Ok(Outcome::Done)
    }
}

fn parameter_json(p: &ParameterInfo) -> Value {
    json!({"name": p.name, "unit": p.unit, "neutral": p.neutral, "range": [p.range.0, p.range.1], "about": p.description})
}

fn parameters_table(all: &[ParameterInfo]) -> String {
    let number = |x: f64| if x >= NO_LIMIT { "no limit".into() } else { x.to_string() };
    let mut rows = vec![["name", "unit", "neutral", "range", "what it is"].map(String::from)];
    rows.extend(all.iter().map(|p| {
        let range = format!("{} to {}", number(p.range.0), number(p.range.1));
        [p.name.clone(), p.unit.into(), number(p.neutral), range, p.description.into()]
    }));
    table(&rows)
}

/// Columns as wide as their widest text, the last one as it is.
fn table<const N: usize>(rows: &[[String; N]]) -> String {
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..N).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}"));
        text += cells.collect::<Vec<_>>().join("  ").trim_end();
        text.push('\n');
    }
    text
}
