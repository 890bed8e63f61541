//! The summary as a page.

use crate::fit::{Estimate, FEWEST};
use crate::gather::{Fleet, Line, SizeOf};
use crate::plan::{Command, Plan};
use qv_page::parts::{self, Mood};
use qv_page::{Board, Choice, Look, Page, Panel, Table, escape, significant};
use std::collections::BTreeMap;

/// Most rows of a table that names units.
const MOST: usize = 500;
/// Colours of a board's lines.
const TONES: usize = 8;
/// Nanoseconds of a day.
const DAY: f64 = 86_400e9;

/// The page of a summary, which is that of `plan`.
pub fn to_html(fleet: &Fleet, plan: &Plan) -> String {
    let sections = [
        head(fleet),
        section("Causes by robot", &causes(fleet)),
        section("Sizes by robot", &sizes(&fleet.sizes)),
        section("Over dates", &dates(fleet, plan)),
        section("What stands apart", &outliers(fleet)),
        section("Failures", &failures(fleet)),
        section("Units", &units(&fleet.units)),
    ];
    let title = format!("{} units, {}", fleet.units.len(), words(fleet.command));
    Page { title: &title, body: &sections.concat(), ..Page::default() }.to_html()
}

fn words(command: Command) -> &'static str {
    match command {
        Command::Diagnose => "qv diagnose",
        Command::Contact => "qv contact",
        Command::Tune => "qv tune",
        Command::Rehearse => "a rehearsal: nothing here was measured",
    }
}

fn section(title: &str, html: &str) -> String {
    if html.is_empty() { String::new() } else { format!("<h2>{}</h2>{}", escape(title), parts::card(html)) }
}

/// A table as HTML; nothing without rows.
fn shown(table: &Table) -> String {
    if table.is_empty() { String::new() } else { table.to_html() }
}

fn count(fleet: &Fleet, state: &str) -> usize {
    fleet.counts.get(state).copied().unwrap_or(0)
}

fn head(fleet: &Fleet) -> String {
    let [done, finding, failed, missing] = ["done", "finding", "failed", "missing"].map(|s| count(fleet, s));
    let mood = match (failed, missing) {
        (0, 0) => Mood::Good,
        (0, _) => Mood::Fair,
        _ => Mood::Bad,
    };
    let shared = fleet.causes.iter().filter(|c| c.robots.len() > 1).map(|c| {
        let robots: Vec<&str> = c.robots.iter().map(|r| r.0.as_str()).collect();
        format!("<p>{}: shared by {}.</p>", escape(&c.effect), escape(&robots.join(", ")))
    });
    let drifts = fleet.sizes.iter().filter(|s| s.drifts).map(|s| {
        let slope = s.per_day.map_or(f64::NAN, |slope| slope.value);
        let (size, robot) = (escape(&name(s)), escape(&s.robot));
        format!("<p>{size} of {robot} drifts by {} {} a day.</p>", significant(slope, 3), escape(&s.unit))
    });
    let text = format!(
        "<p>{} of {} units are done, {finding} of them with a finding that is no correction or with input that was lost; \
         {failed} failed, {missing} are missing.</p>",
        done + finding,
        fleet.units.len()
    );
    let rehearsal =
        if fleet.command == Command::Rehearse { "<p>A rehearsal: no recording was worked on.</p>" } else { "" };
    let options = if fleet.options.is_empty() {
        String::new()
    } else {
        format!("<p class=\"soft\">Options: <code>{}</code></p>", escape(&fleet.options.join(" ")))
    };
    let all: String = shared.chain(drifts).collect();
    parts::verdict(mood, &format!("{} robots", fleet.robots.len()), &format!("{text}{rehearsal}{all}{options}"))
}

fn causes(fleet: &Fleet) -> String {
    let mut robots = Table::with_left(&["robot", "units", "done", "verdicts"], &[3]);
    for robot in &fleet.robots {
        let verdicts: Vec<String> =
            robot.verdicts.iter().map(|(name, n)| format!("{} {n}", name.replace('_', " "))).collect();
        let cells =
            [escape(&robot.robot), robot.units.to_string(), robot.done.to_string(), escape(&verdicts.join(", "))];
        robots.row(&cells);
    }
    let mut table = Table::with_left(&["cause", "robot", "units with it", "of"], &[1]);
    for cause in &fleet.causes {
        for (robot, with, done) in &cause.robots {
            let cells = [escape(&cause.effect), escape(robot), with.to_string(), done.to_string()];
            table.row_with_bar(&cells, 2, *with as f64 / (*done).max(1) as f64);
        }
    }
    shown(&robots) + &shown(&table)
}

/// Such as `command_latency (all): command latency [ms]`.
fn name(size: &SizeOf) -> String {
    let unit = if size.unit.is_empty() { String::new() } else { format!(" [{}]", size.unit) };
    let parameter = if size.parameter == size.cause { String::new() } else { format!(": {}", size.parameter) };
    format!("{} ({}){parameter}{unit}", size.cause, size.scope)
}

fn interval(estimate: &Estimate) -> String {
    format!("{} to {}", significant(estimate.ci95[0], 3), significant(estimate.ci95[1], 3))
}

fn sizes(sizes: &[SizeOf]) -> String {
    let heads = ["size", "robot", "units", "mean", "95 % interval", "change a day", "95 % interval", "from", "to"];
    let mut table = Table::with_left(&heads, &[1]);
    for size in sizes {
        let date = |k: usize| size.dates.get(k).and_then(|d| d.get(..10)).unwrap_or("–").to_owned();
        let slope = size.per_day.as_ref();
        let change = slope.map_or("–".into(), |s| significant(s.value, 3));
        let cells = [
            escape(&name(size)),
            escape(&size.robot),
            size.units.to_string(),
            significant(size.mean.value, 3),
            interval(&size.mean),
            if size.drifts { format!("<b>{change}</b>") } else { change },
            slope.map_or("–".into(), interval),
            date(0),
            date(1),
        ];
        table.row(&cells);
    }
    shown(&table)
}

/// Sizes over the dates of their recordings, a line for each robot.
fn dates(fleet: &Fleet, plan: &Plan) -> String {
    let first = plan.units.iter().filter_map(|unit| unit.start_ns()).min();
    let mut found: BTreeMap<_, BTreeMap<&str, Vec<(f64, f64)>>> = BTreeMap::new();
    for (unit, line) in plan.units.iter().zip(&fleet.units) {
        let Some((start, first)) = unit.start_ns().zip(first) else { continue };
        let days = (start - first) as f64 / DAY;
        for size in &line.finding.sizes {
            found.entry(size.key()).or_default().entry(&unit.robot).or_default().push((days, size.value));
        }
    }
    found.retain(|_, robots| robots.values().any(|points| points.iter().any(|p| p.0 != points[0].0)));
    if found.is_empty() {
        return String::new();
    }
    let mut board = Board::new("days since the first recording");
    let mut options = Vec::new();
    for (k, ((cause, scope, parameter, unit), robots)) in found.into_iter().enumerate() {
        options.push(format!("{cause} ({scope})"));
        let mut panel = Panel { title: parameter, unit, when: vec![vec![k]], ..Panel::default() };
        for (index, (robot, mut points)) in robots.into_iter().enumerate() {
            points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
            let [x, y]: [Vec<f64>; 2] = [points.iter().map(|p| p.0).collect(), points.iter().map(|p| p.1).collect()];
            let largest = y.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            let columns = (board.column(&x, 1e-4), board.column(&y, (1e-5 * largest).max(1e-12)));
            let line = qv_page::Line::new(robot, &format!("c{}", index % TONES), columns.0, columns.1);
            panel.lines.push(line.looking(Look::Dots));
        }
        board.panels.push(panel);
    }
    board.choices = vec![Choice { name: "size".into(), options, first: 0 }];
    let from = first.map(crate::gather::utc).unwrap_or_default();
    format!("<p class=\"soft\">Day 0 is {from}.</p>") + &board.to_card()
}

fn outliers(fleet: &Fleet) -> String {
    let rule = format!(
        "<p class=\"soft\">A unit stands apart where the robust z-score (0.6745 times the distance from the median over the \
         median distance) is beyond {}; of at least {FEWEST} units.</p>",
        significant(fleet.outlier_z, 2)
    );
    let mut table = Table::with_left(&["unit", "robot", "what", "value", "z"], &[1, 2]);
    for one in fleet.outliers.iter().take(MOST) {
        let cells =
            [escape(&one.id), escape(&one.robot), escape(&one.what), significant(one.value, 3), significant(one.z, 2)];
        table.row(&cells);
    }
    rule + if table.is_empty() { "<p>None.</p>" } else { "" } + &shown(&table)
}

fn failures(fleet: &Fleet) -> String {
    let mut table = Table::with_left(&["how", "why", "units", "such as"], &[1, 3]);
    for failure in &fleet.failures {
        let first = fleet.units.iter().find(|line| failure.units.first() == Some(&line.id));
        let example = first.and_then(|line| line.recordings.first()).map_or("", String::as_str);
        let cells =
            [escape(failure.kind.words()), escape(&failure.reason), failure.units.len().to_string(), escape(example)];
        table.row(&cells);
    }
    let mut refused = Table::with_left(&["could not be opened", "why"], &[0, 1]);
    for one in fleet.refused.iter().take(MOST) {
        refused.row(&[escape(&one.path), escape(&one.reason)]);
    }
    let mut repeated = Table::with_left(&["is there twice", "same as"], &[0, 1]);
    for one in fleet.repeated.iter().take(MOST) {
        repeated.row(&[escape(&one.path), escape(&one.same_as)]);
    }
    [table, refused, repeated].iter().map(shown).collect()
}

fn units(lines: &[Line]) -> String {
    let mut table = Table::with_left(&["unit", "robot", "recording", "start", "state", "what"], &[1, 2, 3, 4, 5]);
    for line in lines.iter().take(MOST) {
        let what = line.reason.as_deref().unwrap_or(&line.finding.sentence);
        let cells = [
            format!("<code>{}</code>", escape(&line.id)),
            escape(&line.robot),
            escape(&line.recordings.join(", ")),
            line.start.as_deref().map_or("–".into(), escape),
            line.state.into(),
            escape(what),
        ];
        table.row(&cells);
    }
    let rest = lines.len().saturating_sub(MOST);
    let note = if rest > 0 { format!("<p class=\"soft\">{rest} more are in fleet.json.</p>") } else { String::new() };
    shown(&table) + &note
}
