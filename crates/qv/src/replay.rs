//! `qv replay`: how far the simulator is from the robot.

use crate::ground::{check_ground, terrain_of};
use crate::inspect::known;
use crate::numbers::within;
use crate::open::{
    beyond_range, check_joints, file_error, find_gains, lost_from, lost_from_model, model_of, open_run, parameters_of,
    remarks_of, write_error,
};
use crate::output::{make_folder, put, stream};
use crate::progress::spinner;
use crate::provenance::provenance;
use crate::terminal::print_message;
use crate::{Outcome, RunArguments, say};
use qv_recording::derive::joint_velocity;
use qv_recording::lag::Lag;

use qv_recording::{RecordingError, Run};
use qv_replay::{ReplayOptions, lag_remark, layout, to_html, to_json, verdict, write_mcap};
use qv_sim::Model;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::slice;
use std::time::Instant;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv replay walk.mcap --out out/replay\n\
     \x20 qv replay walk.mcap --robot go2 --terrain yard.glb --params out/why/calibrated.toml --out out/replay\n\
     \n\
     Results: replay.html, replay.json, replay.mcap (Foxglove, Rerun), replay.layout.json (Foxglove).\n\
     A parameter file sets simulator parameters by name, such as \"joint.*.coulomb_friction\" = 0.2 (names: qv params go2).",
    "3 done, but part of the input was lost (reported)"
);

#[derive(clap::Args)]
pub struct Replay {
    #[command(flatten)]
    run: RunArguments,
    /// Set the terrain: plane, or a labelled mesh (z up, frame of the poses)
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb", help_heading = "Input")]
    terrain: String,
    /// Read simulator parameters (calibrated.toml)
    #[arg(long, value_name = "FILE.toml", help_heading = "Input")]
    params: Option<PathBuf>,
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Set the length of windows that restart at the measured state
    #[arg(long, default_value_t = 0.3, value_name = "SECONDS", value_parser = window_length, allow_negative_numbers = true, help_heading = "What to test")]
    window: f64,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Replay {
    pub fn execute(&self) -> Result<Outcome, RecordingError> {
        let mut run = open_run(&self.run)?;
        let model = model_of(&run, &self.run.run, self.run.reading.robot.as_deref())?;
        let terrain = terrain_of(&self.terrain)?;
        run.remarks.extend(check_ground(&run, &terrain)?);
        check_joints(&mut run, &model, &terrain, self.run.reading.fix)?;
        let options = ReplayOptions {
            window: self.window,
            parameters: parameters_of(self.params.as_deref(), &model, &terrain)?,
            ..Default::default()
        };
        let bar = spinner("simulating");
        find_gains(slice::from_mut(&mut run), &model, &terrain, &options.parameters)?;
        let clock = Instant::now();
        let replay = qv_replay::replay(&run, &model, &terrain, &options)?;
        let factor = replay.simulated / clock.elapsed().as_secs_f64();
        bar.finish_and_clear();
        let mut report = to_json(&replay, factor);
        let lost = lost(&run, &model, &replay);
        report["lost"] = lost.as_slice().into();
        let mut remarks = remarks_of(&run, &model);
        remarks.extend(beyond_range(&options.parameters, &model, &terrain));
        report["remarks"] = remarks.as_slice().into();
        let read = [Some(self.run.run.as_path()), Some(Path::new(&self.terrain)), self.params.as_deref()];
        report["provenance"] = provenance(read.into_iter().chain([self.run.reading.robot_file()]).flatten());
        let notes = notes(&run, &remarks, &replay);
        self.write(&run, &model, &replay, &report, &notes)?;
        if self.json {
            say(&format!("{report}\n"))?;
        } else {
            say(&format!("{}written to {}\n", summary(&replay, &notes, factor), self.out.display()))?;
        }
        lost.iter().for_each(|what| print_message!("{what}"));
        Ok(if lost.is_empty() { Outcome::Done } else { Outcome::Partial })
    }

    fn write(
        &self,
        run: &Run,
        model: &Model,
        replay: &qv_replay::Replay,
        report: &Value,
        notes: &[String],
    ) -> Result<(), RecordingError> {
        let failed = |name: &str, e: std::io::Error| write_error(&self.out.join(name), &e);
        make_folder(&self.out).map_err(|e| failed("", e))?;
        put(&self.out.join("replay.json"), format!("{report:#}\n")).map_err(|e| failed("replay.json", e))?;
        let title = self.run.run.display().to_string();
        let html = to_html(replay, &title, notes);
        put(&self.out.join("replay.html"), html).map_err(|e| failed("replay.html", e))?;
        let path = self.out.join("replay.mcap");
        let remarks = |e: qv_replay::ReplayError| file_error(&path, "room for the whole of it", &e.to_string());
        stream(
            &path,
            |e| failed("replay.mcap", e),
            |file| write_mcap(replay, model, run.epoch, file).map_err(remarks),
        )?;
        let arranged = format!("{:#}\n", layout(replay));
        put(&self.out.join("replay.layout.json"), arranged).map_err(|e| failed("replay.layout.json", e))
    }
}

/// Every part of the input that the replay did without.
fn lost(run: &Run, model: &Model, replay: &qv_replay::Replay) -> Vec<String> {
    let mut lost = lost_from(run);
    let others = run.joint_names.iter().enumerate().filter(|(_, name)| !model.joint_names().contains(name));
    lost.extend(others.map(|(j, name)| format!("joint {name} of the recording: {}", why_unused(run, j, model))));
    lost.extend(lost_from_model(model));
    lost.extend(replay.ran_away.map(|time| format!("the simulation of the whole run ran away at {time:.3} s")));
    if replay.windows.ran_away > 0 {
        lost.push(format!("the simulation ran away in {} windows", replay.windows.ran_away));
    }
    if replay.windows.windows.is_empty() {
        lost.push("no window could be compared".into());
    }
    lost
}

/// Why the model has no moving joint for a joint of the recording.
fn why_unused(run: &Run, joint: usize, model: &Model) -> &'static str {
    let is_measured = |s: &qv_core::JointSeries| s.column(joint).any(f64::is_finite);
    match model.still.contains(&run.joint_names[joint]) {
        false => "the model has none of that name",
        true if run.measured.position.as_ref().is_some_and(is_measured) => "the model has it as one that does not move",
        true => "none of its positions is a number: the model's is held",
    }
}

/// What a reader of the numbers should know: what was lost, derived, left out.
fn notes(run: &Run, remarks: &[String], replay: &qv_replay::Replay) -> Vec<String> {
    let mut notes: Vec<String> = remarks.iter().map(|t| format!("{t}.")).collect();
    notes.extend(run.lost.iter().map(|l| format!("Lost from {}: {}.", l.file, l.what)));
    notes.extend(
        run.faults.iter().take(8).map(|f| format!("{:.3} s: {} in {}: {}.", f.time, f.kind, f.channel, f.detail)),
    );
    if let (None, Some(d)) = (&run.measured.velocity, joint_velocity(run)) {
        notes.push(format!("Joint velocities were not measured: {}, -3 dB at {:.1} Hz.", d.method, d.bandwidth));
    }
    if replay.windows.skipped > 0 {
        notes.push(format!("{} windows were left out: something is missing in them.", replay.windows.skipped));
    }
    if replay.windows.ran_away > 0 {
        notes.push(format!("{} windows were left out: the simulation ran away.", replay.windows.ran_away));
    }
    notes
}

fn summary(replay: &qv_replay::Replay, notes: &[String], factor: f64) -> String {
    let (whole, windows) = (&replay.errors, &replay.window_errors);
    let mut text = String::from(
        "                         position rms        velocity    torque     lag behind     lag behind\n\
         joint                windows  whole run      windows   windows        command     simulation\n\
         \x20                       mrad       mrad        rad/s       N m             ms             ms\n",
    );
    for (j, name) in replay.joint_names.iter().enumerate() {
        let (w, e) = (&windows.joints[j], &whole.joints[j]);
        let lag = |lags: &[Lag]| lags.iter().find(|l| l.joint == *name).map_or(f64::NAN, |l| 1e3 * l.lag);
        text += &format!(
            "{name:<20} {:>10} {:>10} {:>10} {:>9} {:>14} {:>14}\n",
            known(1e3 * w.position, 2),
            known(1e3 * e.position, 2),
            known(w.velocity, 3),
            known(w.torque, 3),
            known(lag(&replay.command_lags), 1),
            known(lag(&replay.model_lags), 1)
        );
    }
    let (mean, count) = (1e3 * windows.position_mean(), replay.windows.windows.len());
    text += &format!("{:<20} {:>10} {:>10}\n", "mean", known(mean, 2), known(1e3 * whole.position_mean(), 2));
    text += &lag_remark(replay).map_or(String::new(), |remark| remark + "\n");
    for p in &windows.phases {
        let (rms, share) = (known(1e3 * p.position, 2), 100.0 * p.share);
        text += &format!("{:<20} {rms:>10}   {share:.0} % of the time\n", p.phase.name());
    }
    if let Some(b) = whole.base {
        text += &format!(
            "base, open loop: {} m mean, {} m and {} rad of yaw at the end\n",
            known(b.position_mean, 3),
            known(b.position_final, 3),
            known(b.yaw_final, 3)
        );
    }
    let skipped = replay.windows.skipped;
    text += &format!("{count} windows of {} s ({skipped} left out), {factor:.0} x real time\n", replay.windows.length);
    for note in notes {
        text += &format!("{note}\n");
    }
    // One sentence a line.
    text + &verdict(replay).replace(". ", ".\n") + "\n"
}

fn window_length(text: &str) -> Result<f64, String> {
    within(text, 0.01, 1000.0)
}
