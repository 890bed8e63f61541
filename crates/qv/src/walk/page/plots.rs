//! The plots: learning over samples; commands, feet and joints over time.

use super::measures::Measures;
use qv_page::{Board, Choice, Column, Line, Look, Panel, Stretch, fixed};
use qv_policy::play::WalkTrace;
use qv_policy::policy::PolicyFile;
use qv_policy::score::Score;
use qv_policy::train;

/// Points of a learning curve: more cannot be seen.
const POINTS: usize = 300;
/// Points on each side over which ends of episodes are counted: few end within one.
const AROUND: usize = 5;
/// Figures of the task that are no terms of its reward.
const NO_TERMS: [&str; 5] = ["velocity_error", "turning_error", "swing_time", "swing_height", "level"];
/// Colours of lines that have no meaning of their own.
const TONES: [&str; 8] = ["c0", "c1", "c2", "c3", "c4", "c5", "c6", "c7"];

fn wide(values: impl Iterator<Item = f32>) -> Vec<f64> {
    values.map(f64::from).collect()
}

fn titled(title: &str, unit: &str, lines: Vec<Line>) -> Panel {
    Panel { title: title.into(), unit: unit.into(), lines, half: true, ..Panel::default() }
}

/// Lines of different colours; dashed from the ninth on, where colours begin again.
fn coloured(lines: impl Iterator<Item = Line>) -> Vec<Line> {
    let look = |k: usize| if k < TONES.len() { Look::Plain } else { Look::Dashed };
    lines.enumerate().map(|(k, l)| Line { tone: TONES[k % TONES.len()].into(), look: look(k), ..l }).collect()
}

/// Curves of a training over samples in millions; neighbouring iterations share a point where there are many.
pub fn learning(lines: &[train::Line]) -> Board {
    let mut board = Board::new("samples [millions]");
    if lines.is_empty() {
        return board;
    }
    let chunks: Vec<&[train::Line]> = lines.chunks(lines.len().div_ceil(POINTS)).collect();
    let samples: Vec<f64> = chunks.iter().filter_map(|c| c.last()).map(|line| millions(line.samples)).collect();
    let samples = board.column(&samples, 1e-4);
    let figure =
        |name: &str, line: &train::Line| line.figures.iter().find(|(n, _)| *n == name).map_or(f32::NAN, |f| f.1);
    let mut curve = |name: &str, step: f64, of: &dyn Fn(&train::Line) -> f32| {
        let mean = |chunk: &&[train::Line]| chunk.iter().map(of).sum::<f32>() / chunk.len() as f32;
        let values = wide(chunks.iter().map(mean));
        Line::new(name, "c0", samples, board.column(&values, step))
    };
    let reward = curve("training", 1e-5, &|l| l.iteration.reward);
    let velocity = curve("training", 1e-4, &|l| figure("velocity_error", l));
    let turning = curve("training", 1e-4, &|l| figure("turning_error", l));
    let std = curve("mean", 1e-4, &|l| l.iteration.std);
    let rate = curve("end of the iteration", 1e-8, &|l| l.iteration.rate);
    // A term that is switched off is no line.
    let is_term = |name: &str| !NO_TERMS.contains(&name) && lines.iter().any(|line| figure(name, line) != 0.0);
    let names = lines[0].figures.iter().map(|f| f.0).filter(|name| is_term(name));
    let terms = coloured(names.map(|name| curve(name, 1e-4, &|l| figure(name, l))));
    let failed = board.column(&failed(&chunks), 1e-4);
    let failed = Line::new("episodes of training", "c0", samples, failed);
    let scored = ScoredIterations::new(&mut board, lines);
    let [scored_velocity, scored_turning] = [
        scored.line(&mut board, "score", &|s| s.velocity_error),
        scored.line(&mut board, "score", &|s| s.turning_error),
    ];
    let scored_fell = scored.line(&mut board, "robots of the score", &|s| s.fell as f32 / s.robots.max(1) as f32);
    let beside = |line: Line, other: Option<Line>| std::iter::once(line).chain(other).collect::<Vec<Line>>();
    board.panels = vec![
        titled("Reward of a step", "", vec![reward]),
        Panel { zero: true, ..titled("Velocity error", "m/s", beside(velocity, scored_velocity)) },
        Panel { zero: true, ..titled("Turning error", "rad/s", beside(turning, scored_turning)) },
        Panel { zero: true, ..titled("Share that fell", "", beside(failed, scored_fell)) },
        Panel { zero: true, ..titled("Standard deviation of actions", "", vec![std]) },
        Panel { log: true, ..titled("Learning rate", "", vec![rate]) },
        Panel { half: false, ..titled("Terms of the reward", "1/s", terms) },
    ];
    board.panels.retain(|panel| !panel.lines.is_empty());
    board
}

/// Share of the episodes that ended in a fall, around each point; nothing is known where none ended.
fn failed(chunks: &[&[train::Line]]) -> Vec<f64> {
    let share = |at: usize| {
        let near = &chunks[at.saturating_sub(AROUND)..(at + AROUND + 1).min(chunks.len())];
        let sum = |k: usize| near.iter().copied().flatten().map(|line| line.iteration.ends[k]).sum::<usize>() as f64;
        sum(0) / (sum(0) + sum(1))
    };
    (0..chunks.len()).map(share).collect()
}

/// Iterations that were scored.
struct ScoredIterations<'a> {
    scores: Vec<&'a Score>,
    samples: Column,
}

impl<'a> ScoredIterations<'a> {
    fn new(board: &mut Board, lines: &'a [train::Line]) -> Self {
        let all = lines.iter().filter_map(|line| Some((millions(line.samples), line.score.as_ref()?)));
        let (samples, scores): (Vec<f64>, Vec<&Score>) = all.unzip();
        Self { scores, samples: board.column(&samples, 1e-4) }
    }

    fn line(&self, board: &mut Board, name: &str, of: &dyn Fn(&Score) -> f32) -> Option<Line> {
        let values = wide(self.scores.iter().map(|score| of(score)));
        (!values.is_empty())
            .then(|| Line::new(name, "c1", self.samples, board.column(&values, 1e-4)).looking(Look::Dots))
    }
}

fn millions(samples: u64) -> f64 {
    samples as f64 / 1e6
}

/// A board over the time of the play: it moves with the others, and a click shows that moment in the view.
struct OverTime {
    board: Board,
    time: Column,
}

impl OverTime {
    fn new(played: &WalkTrace) -> Self {
        let mut board = Board::new("time [s]");
        (board.link, board.reports) = ("time".into(), true);
        let rate = f64::from(played.rate.max(1e-3));
        let time: Vec<f64> = (0..played.q.len()).map(|k| (k + 1) as f64 / rate).collect();
        let time = board.column(&time, 1e-4);
        Self { board, time }
    }

    fn line(&mut self, name: &str, tone: &str, step: f64, values: impl Iterator<Item = f32>) -> Line {
        let column = self.board.column(&wide(values), step);
        Line::new(name, tone, self.time, column)
    }
}

/// What was commanded and what was done; each command is a stretch to go to.
pub fn tracking(played: &WalkTrace, measures: &Measures) -> Board {
    let mut over = OverTime::new(played);
    for (k, (title, unit)) in
        [("Forwards", "m/s"), ("To the left", "m/s"), ("Turning to the left", "rad/s")].into_iter().enumerate()
    {
        let done = if k == 2 { &played.turning } else { &played.velocity };
        let commanded = over.line("commanded", "c1", 1e-3, played.commands.iter().map(|c| c[k]));
        let done = over.line("done", "c0", 1e-3, done.iter().map(|v| v[k]));
        over.board.panels.push(Panel { half: k < 2, ..titled(title, unit, vec![commanded, done]) });
    }
    let stretch = |s: &super::measures::Stretch| {
        let [from, to] = [s.from, s.to].map(f64::from);
        let [vx, vy, wz] = s.command.map(|x| fixed(x.into(), 2));
        Stretch { name: format!("{} to {} s: {vx}, {vy}, {wz}", fixed(from, 1), fixed(to, 1)), x: [from, to] }
    };
    over.board.stretches = measures.stretches.iter().filter(|s| s.to > s.from).map(stretch).collect();
    over.board
}

/// When feet are on the ground, how high they are and what they carry.
pub fn feet(played: &WalkTrace) -> Board {
    let mut over = OverTime::new(played);
    let count = played.feet.len();
    let mut of = |step: f64, value: &dyn Fn(usize, usize) -> f32| {
        let line = |f: usize| over.line(&played.feet[f], "c0", step, (0..played.q.len()).map(|k| value(k, f)));
        coloured((0..count).map(line).collect::<Vec<_>>().into_iter())
    };
    let forces = of(0.1, &|k, f| played.foot_forces[k][f]);
    let heights = of(1e-5, &|k, f| played.foot_heights[k][f]);
    let gait = forces.iter().map(|line| line.clone().looking(Look::Bar)).collect();
    let heights = heights.into_iter().map(|line| line.times(100.0)).collect();
    let panel = |title, unit, lines| Panel { half: false, ..titled(title, unit, lines) };
    over.board.panels = vec![
        panel("Gait: feet on the ground", "", gait),
        panel("Height of the feet over the ground", "cm", heights),
        panel("Vertical force on the feet", "N", forces),
    ];
    over.board.panels.retain(|panel| !panel.lines.is_empty());
    over.board
}

/// Angle, target and torque of each joint, to choose from.
pub fn joints(played: &WalkTrace, policy: &PolicyFile) -> Board {
    let mut over = OverTime::new(played);
    for j in 0..played.joints.len() {
        let target = over.line("target", "c1", 1e-3, played.targets.iter().map(|t| t[j]));
        let angle = over.line("angle", "c0", 1e-3, played.q.iter().map(|q| q[7 + j]));
        let torque = over.line("torque", "c0", 1e-2, played.torques.iter().map(|t| t[j]));
        let limits = [&policy.lower, &policy.upper].map(|l| l.get(j).map_or(f64::NAN, |x| f64::from(*x)));
        let limits = format!("rad; limits {} to {}", fixed(limits[0], 3), fixed(limits[1], 3));
        let effort = played.efforts.get(j).copied().flatten();
        let effort = effort.map_or("N m".into(), |limit| format!("N m; limit ±{}", fixed(limit.into(), 1)));
        for (title, unit, lines) in
            [("Angle and its target", limits, vec![target, angle]), ("Torque", effort, vec![torque])]
        {
            over.board.panels.push(Panel { half: false, when: vec![vec![j]], ..titled(title, &unit, lines) });
        }
    }
    over.board.choices = vec![Choice { name: "joint".into(), options: played.joints.clone(), first: 0 }];
    over.board
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::walk::example::{file, lines, made_up};

    #[test]
    fn learning_curves_are_short_and_what_is_not_known_is_a_gap() {
        let board = learning(&lines(1000));
        let titles: Vec<&str> = board.panels.iter().map(|p| p.title.as_str()).collect();
        assert_eq!((titles.len(), titles[6]), (7, "Terms of the reward"));
        let (samples, reward) = board.points(&board.panels[0].lines[0]);
        assert_eq!((samples.len(), reward.len()), (250, 250));
        assert_eq!(board.points(&board.panels[1].lines[1]).0.len(), 50);
        assert_eq!(board.panels[6].lines.len(), 1);
        let failed = |count| {
            let board = learning(&lines(count));
            board.points(&board.panels[3].lines[0]).1[0]
        };
        assert!(failed(3).is_nan() && (failed(1000) - 0.25).abs() < 1e-4);
        assert!(learning(&[]).to_html().is_empty());
        assert_eq!(learning(&lines(3)).panels[1].lines.len(), 1, "none was scored");
    }

    #[test]
    fn all_joints_and_feet_are_there() {
        let played = made_up(300);
        let board = joints(&played, &file());
        assert_eq!((board.choices[0].options.len(), board.panels.len()), (12, 24));
        let (time, angle) = board.points(&board.panels[6].lines[1]);
        assert!((time[0] - 0.02).abs() < 1e-9 && (angle[77] - f64::from(played.q[77][10])).abs() < 6e-4);
        let board = feet(&played);
        assert_eq!((board.panels.len(), board.panels[0].lines.len()), (3, 4));
        assert!(board.panels[0].lines.iter().all(|l| l.look == Look::Bar));
        let (_, height) = board.points(&board.panels[1].lines[0]);
        assert!((height.iter().fold(0.0_f64, |m, h| m.max(*h)) - 5.0).abs() < 0.1);
        let board = tracking(&played, &Measures::new(&played));
        assert_eq!((board.panels.len(), board.stretches.len(), board.reports), (3, 1, true));
    }
}
