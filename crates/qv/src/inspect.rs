//! `qv inspect`: one screen about a recording.

use crate::can_tell::RecordingRequest;
use crate::open::open_run;
use crate::{Outcome, RunArguments, say};
use qv_core::JointSeries;
use qv_recording::commanded::Check;
use qv_recording::conventions::table;
use qv_recording::run::{ActuatorKind, Base, Clock, Fault, Loss, Robot, Run, Source};
use qv_recording::{RecordingError, derive, median_interval};
use serde_json::{Value, json};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv inspect walk.mcap\n\
     \x20 qv inspect recordings/walk_split --pose-topic /lio/odom --json\n\
     \x20 qv inspect walk.mcap --detectable",
    "3 done, but part of the input was lost (reported)"
);

#[derive(clap::Args)]
pub struct Inspect {
    #[command(flatten)]
    run: RunArguments,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
    /// Print the smallest detectable size of each effect (90 % power)
    #[arg(long = "detectable", alias = "can-tell", help_heading = "What to test")]
    can_tell: bool,
    /// Set the terrain for --detectable: plane, or a labelled mesh
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb", requires = "can_tell", help_heading = "Input")]
    terrain: String,
}

/// Columns and lines of a screen.
const SCREEN: usize = 100;
const LINES: usize = 40;

/// A channel as the screen shows it.
struct Row {
    name: &'static str,
    count: usize,
    rate: f64,
    /// How, where it was not recorded.
    derived: Option<String>,
}

impl Inspect {
    pub fn execute(&self) -> Result<Outcome, RecordingError> {
        let run = open_run(&self.run)?;
        if self.can_tell {
            let asked =
                RecordingRequest { run: &run, path: &self.run.run, reading: &self.run.reading, terrain: &self.terrain };
            say(&asked.answer(self.json)?)?;
            return Ok(if run.is_partial() { Outcome::Partial } else { Outcome::Done });
        }
        say(&if self.json { format!("{}\n", to_json(&run)) } else { screen(&run) })?;
        Ok(if run.is_partial() { Outcome::Partial } else { Outcome::Done })
    }
}

fn channels(run: &Run) -> Vec<Row> {
    let (c, m) = (&run.commands, &run.measured);
    let all: [(&'static str, &Option<JointSeries>); 13] = [
        ("command position", &c.position),
        ("command velocity", &c.velocity),
        ("command torque", &c.torque),
        ("command kp", &c.kp),
        ("command kd", &c.kd),
        ("position", &m.position),
        ("velocity", &m.velocity),
        ("torque", &m.torque),
        ("gyro", &m.gyro),
        ("acceleration", &m.acceleration),
        ("orientation", &m.orientation),
        ("foot force", &m.foot_force),
        ("base pose", &m.base_pose),
    ];
    let row = |(name, series): (&'static str, &Option<JointSeries>)| {
        series.as_ref().map(|s| Row { name, count: s.len(), rate: 1.0 / median_interval(&s.time), derived: None })
    };
    let mut rows: Vec<Row> = all.into_iter().filter_map(row).collect();
    let mut derived = |name: &'static str, wanted: bool, d: Option<derive::DerivedChannel>| {
        if let Some(d) = d.filter(|_| wanted) {
            let rate = 1.0 / median_interval(&d.series.time);
            rows.push(Row {
                name,
                count: d.series.len(),
                rate,
                derived: Some(format!("{}, -3 dB at {:.1} Hz", d.method, d.bandwidth)),
            });
        }
    };
    derived("velocity", m.velocity.is_none(), derive::joint_velocity(run));
    derived("base velocity", m.base_pose.is_some(), m.base_pose.as_ref().and_then(derive::base_velocity));
    derived("base angular velocity", m.gyro.is_none(), m.base_pose.as_ref().and_then(derive::base_angular_velocity));
    rows
}

fn robot_name(run: &Run) -> &str {
    match &run.robot {
        Robot::Named(name) => name,
        Robot::Urdf(text) if qv_sim::mjcf::is_mjcf(text) => "MJCF",
        Robot::Urdf(_) => "URDF",
    }
}

fn base_name(run: &Run) -> &'static str {
    match run.base {
        Base::Fixed => "fixed",
        Base::Free => "free",
    }
}

fn screen(run: &Run) -> String {
    let [start, end] = run.span();
    let mut text = format!(
        "{} base {}, {} joints, {:.3} s of joint states, {:.1} MB decoded\n",
        robot_name(run),
        base_name(run),
        run.joints(),
        end - start,
        run.bytes() as f64 / 1e6
    );
    text += &format!("  {}\n", wrap(&run.joint_names, SCREEN - 2));
    text += &actuator(run);
    let width = run.sources.iter().map(|s| s.name.len() + s.type_name.len() + 1).max().unwrap_or(0).clamp(20, 44);
    text += &format!(
        "\n{:<w$} {:>8} {:>7} {:>9} {:>8} {:>8}  clock\n",
        "streams",
        "messages",
        "rate Hz",
        "jitter ms",
        "from s",
        "to s",
        w = width + 2
    );
    for s in &run.sources {
        text += &stream_line(s, width);
    }
    text += &channel_lines(&channels(run));
    text += &convention_lines(&table(run));
    for remarks in &run.remarks {
        text += &fold("  ", remarks);
    }
    text += &findings(&run.faults, &run.lost, LINES.saturating_sub(text.lines().count() + 2).max(5));
    text
}

/// Recorded channels of one count and rate share a line, since most do; what is derived says how.
fn channel_lines(rows: &[Row]) -> String {
    let mut text = String::from("\nchannels\n");
    let mut lines: Vec<(String, Vec<&str>)> = Vec::new();
    for row in rows.iter().filter(|r| r.derived.is_none()) {
        // What stands once has no rate.
        let key = match row.rate.is_finite() {
            true => format!("{:>8} samples at {:>6.1} Hz", row.count, row.rate),
            false => format!("{:>8} samples{:13}", row.count, ""),
        };
        match lines.iter_mut().find(|(k, _)| *k == key) {
            Some((_, names)) => names.push(row.name),
            None => lines.push((key, vec![row.name])),
        }
    }
    for (key, names) in lines {
        text += &fold(&format!("  {key}  "), &names.join(", "));
    }
    for row in rows {
        if let Some(how) = &row.derived {
            text += &fold("  ", &format!("{}, derived: {how}", row.name));
        }
    }
    text
}

/// A line for each comparison of channels.
fn convention_lines(checks: &[Check]) -> String {
    let mut text = if checks.is_empty() { String::new() } else { "\nconventions\n".to_string() };
    for check in checks {
        let mark = match check.is_ours {
            Some(true) => "ok",
            Some(false) => "! ",
            None => "- ",
        };
        text += &fold(&format!("  {mark} {:<40}", check.name), &check.found);
    }
    text
}

fn actuator(run: &Run) -> String {
    let a = &run.actuator;
    let kind = match a.kind {
        ActuatorKind::Pd => "position and velocity gains",
        ActuatorKind::Torque => "torque",
    };
    let number = |name: &str, x: Option<f64>| x.map_or(String::new(), |x| format!(", {name} {x}"));
    let gains = if run.commands.kp.is_some() { ", gains in each command" } else { "" };
    format!("  actuators: {kind}{gains}{}{}{}\n", number("kp", a.kp), number("kd", a.kd), number("tau_max", a.tau_max))
}

/// A stream; a name too long for its column keeps its end, where types differ.
fn stream_line(s: &Source, width: usize) -> String {
    let clock = match s.clock {
        Clock::Header => "header stamp",
        Clock::Log => "log time",
        Clock::Published => "sender (publish_time)",
        Clock::Tick => "sender (tick)",
        Clock::Column => "time column",
    };
    let unused = if s.used { "" } else { ", unused" };
    let mut name = format!("{} {}", s.name, s.type_name);
    if name.chars().count() > width {
        let tail: Vec<char> = name.chars().rev().take(width - 3).collect();
        name = format!("...{}", tail.into_iter().rev().collect::<String>());
    }
    let [from, to] = s.span;
    format!(
        "  {name:<width$} {:>8} {:>7} {:>9} {from:>8.2} {to:>8.2}  {clock}{unused}\n",
        s.count,
        known(s.rate, 1),
        known(1e3 * s.jitter, 3)
    )
}

/// What is not known, such as the rate of one message, is a dash.
pub fn known(x: f64, digits: usize) -> String {
    if x.is_finite() { format!("{x:.digits$}") } else { "-".into() }
}

/// What is wrong, in at most about `most` lines; losses are all reported.
fn findings(faults: &[Fault], lost: &[Loss], most: usize) -> String {
    if faults.is_empty() && lost.is_empty() {
        return "\nno gaps, no faults, nothing lost\n".into();
    }
    let mut text = String::from("\nfindings\n");
    for l in lost {
        text += &fold("  ", &format!("LOST {}: {}{}", l.file, l.what, span(l.span)));
    }
    let shown = most.saturating_sub(lost.len()).max(3);
    for f in faults.iter().take(shown) {
        let mark = if f.kind.is_partial() { "!" } else { " " };
        let what = format!("{} in {} ({}): {}", f.kind, f.channel, f.count, f.detail);
        text += &fold(&format!("  {mark} {:>9.3} s  ", f.time), &what);
    }
    if faults.len() > shown {
        text += &format!("  and {} more: see --json\n", faults.len() - shown);
    }
    text
}

/// A span of log times, seconds since the epoch.
fn span(span: Option<[u64; 2]>) -> String {
    match span {
        None => String::new(),
        Some([from, u64::MAX]) => format!(" (from {:.3} s since the epoch on)", from as f64 * 1e-9),
        Some([from, to]) => format!(" ({:.3} to {:.3} s since the epoch)", from as f64 * 1e-9, to as f64 * 1e-9),
    }
}

/// A line that goes on under its own start where the screen ends.
fn fold(head: &str, text: &str) -> String {
    let words: Vec<String> = text.split_whitespace().map(String::from).collect();
    let indent = head.chars().count();
    format!("{head}{}\n", wrap(&words, SCREEN - indent).replace("\n  ", &format!("\n{:indent$}", "")))
}

/// Words in lines of at most `width`, all but the first of which start with two blanks more.
fn wrap(names: &[String], width: usize) -> String {
    let mut text = String::new();
    let mut column = 0;
    for name in names {
        if column > 0 && column + name.len() > width {
            text += "\n  ";
            column = 0;
        }
        if column > 0 {
            text += " ";
        }
        text += name;
        column += name.len() + 1;
    }
    text
}

fn how(row: &Row) -> String {
    row.derived.as_ref().map_or_else(|| "recorded".into(), |how| format!("derived: {how}"))
}

fn to_json(run: &Run) -> Value {
    let [start, end] = run.span();
    let channels: Vec<Value> = channels(run)
        .into_iter()
        .map(|r| json!({"name": r.name, "samples": r.count, "rate": r.rate, "how": how(&r)}))
        .collect();
    json!({
        "format": "qv-inspect/1",
        "robot": robot_name(run),
        "base": base_name(run),
        "joints": run.joint_names,
        "duration": end - start,
        "epoch_ns": run.epoch,
        "decoded_bytes": run.bytes(),
        "streams": run.sources,
        "channels": channels,
        "conventions": table(run),
        "faults": run.faults,
        "lost": run.lost,
        "remarks": run.remarks,
        "partial": run.is_partial(),
    })
}
