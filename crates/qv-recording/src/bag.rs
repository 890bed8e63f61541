//! ROS 2 bags become runs: streams chosen, clocks joined, channels filled.

use crate::bursts::even_out;
use crate::choose::{TopicChoice, choose_robot, choose_streams};
use crate::clean::{Samples, columns, median_interval, put_in_order};
use crate::container::read_messages;
use crate::mapping::{Channel, ChannelFields, Mapping, MessageMapping, state_stream};
use crate::run::{Base, Clock, Commands, Fault, FaultKind, Loss, Robot, Run, Source};
use crate::stream::{ChannelInfo, MessageSink, Times};
use crate::topic::{Collector, SECOND, Topic};
use crate::{RecordingError, faults, gains, imu};
use qv_core::statistics::median;
use std::io::Read;

/// One file of a bag, in the order of time.
pub struct BagFile<R> {
    /// Name for messages.
    pub name: String,
    /// Its bytes.
    pub source: R,
}

/// A clock that goes back, or an hour ahead, was set.
const BACKWARD_JUMP: i64 = SECOND / 10;
const FORWARD_JUMP: i64 = 3600 * SECOND;

/// Reads a bag of one or more files, as `mapping` says.
///
/// Each stream is put on one clock: the stamp in the message's header where there is one that agrees with the log
/// within a second, else the time of logging ([`Source::clock`] says which). Time 0 is the first joint state.
///
/// # Errors
/// When nothing usable is there: no joint states, or a robot of another shape. Anything less is named in
/// [`Run::lost`] and [`Run::faults`].
pub fn read_bag<R: Read>(
    files: impl IntoIterator<Item = BagFile<R>>,
    mapping: &Mapping,
) -> Result<Run, RecordingError> {
    read_bag_of(files, std::slice::from_ref(mapping), None)
}

/// Reads a bag as the one of `mappings` says whose messages are in it; one of a certain robot is preferred to a generic one.
/// `namespace` (such as `/robot1`) picks one of several robots whose topics lie below names of their own.
///
/// # Errors
/// As [`read_bag`]; and when the bag has several robots, whose topics are named.
pub fn read_bag_of<R: Read>(
    files: impl IntoIterator<Item = BagFile<R>>,
    mappings: &[Mapping],
    namespace: Option<&str>,
) -> Result<Run, RecordingError> {
    let mut all = Collectors(mappings.iter().map(Collector::new).collect());
    let mut lost = Vec::new();
    for file in files {
        all.0.iter_mut().for_each(|c| c.by_id.clear());
        lost.extend(read_messages(&file.name, file.source, &mut all));
    }
    let robot = choose_robot(&all.0, namespace, &lost)?;
    run_of(all.0.swap_remove(robot), namespace, lost)
}

/// What was read of a bag becomes a run.
fn run_of(mut collector: Collector, namespace: Option<&str>, lost: Vec<Loss>) -> Result<Run, RecordingError> {
    let mapping = collector.mapping;
    let mut faults = Vec::new();
    let jumps = join_clocks(&mut collector.topics);
    let TopicChoice { topics: chosen, namespace, remarks } = choose_streams(&collector, namespace, &lost, &mut faults)?;
    let mut evened = Vec::new();
    let clocks: Vec<Clock> = collector.topics.iter_mut().map(|topic| clock_of(topic, &mut evened)).collect();
    let states = chosen[state_stream(mapping)?].expect("joint states were chosen or it is an error");
    let epoch = first_stamp(stamps_of(&collector.topics[states], clocks[states]));
    for (place, jump, topic) in jumps {
        let time = (place - epoch) as f64 / SECOND as f64;
        let detail = format!("the clock jumped by {:+.3} s: the stretches were joined", jump as f64 / SECOND as f64);
        faults.push(Fault { kind: FaultKind::ClockJump, channel: topic, time, count: 1, detail });
    }
    let sources = sources(&collector.topics, &clocks, &chosen, epoch);
    let mut run = empty_run(mapping, epoch as u64, sources);
    (run.lost, run.remarks) = (lost, remarks);
    run.remarks.extend(evened);
    if let Some(named) = collector.topics[states].named.as_ref().filter(|_| mapping.joint_names.is_empty()) {
        run.joint_names = named.all_names();
        run.joint_parameters = vec![Default::default(); run.joint_names.len()];
    }
    for (stream, topic) in chosen.iter().enumerate() {
        if let Some(topic) = *topic {
            let clock = clocks[topic];
            let topic = &mut collector.topics[topic];
            report_errors(topic, epoch, &mut faults);
            let message = &mapping.streams[stream].messages[topic.stream.expect("chosen by stream").1];
            let mut found = Vec::new();
            take(&mut run, topic, message, clock, epoch, &mut found);
            // The sender's clock says in which order messages were sent: sorting by it loses nothing.
            found.retain(|f| !(clock.is_of_sender() && f.kind == FaultKind::OutOfOrder));
            faults.extend(found);
        }
    }
    if let Some(text) = description(&collector.topics, mapping, &namespace) {
        run.robot = Robot::Urdf(text);
    }
    run.base =
        if run.measured.base_pose.is_some() || run.measured.acceleration.is_some() { Base::Free } else { Base::Fixed };
    if run.measured.position.is_none() {
        return Err(RecordingError::run("joint positions", "finite values", "none"));
    }
    if let Some(rpy) = mapping.imu_rotation {
        let remarks = imu::to_trunk(&mut run, qv_core::Pose::from_xyz_rpy([0.0; 3], rpy).rotation, true);
        run.remarks.extend(remarks);
    }
    say_missing_commands(&run, mapping, &mut faults);
    add_gains(&mut run, mapping);
    run.note_uncommanded();
    run.faults = faults;
    if let Some(one) = run.measured.position.as_ref().filter(|p| p.len() == 1) {
        let (channel, detail) = ("position".into(), "expected samples at several times, found one".into());
        run.faults.push(Fault { kind: FaultKind::Missing, channel, time: one.time[0], count: 1, detail });
    }
    faults::examine(&mut run, Some(mapping));
    Ok(run)
}

/// Puts what a topic has into the channels of the run.
fn take(run: &mut Run, topic: &mut Topic, message: &MessageMapping, clock: Clock, epoch: i64, faults: &mut Vec<Fault>) {
    let name = topic.info.topic.clone();
    let (samples, widths): (Samples, Vec<usize>) = match topic.named.take() {
        Some(named) => {
            let names = named.all_names();
            let strange: Vec<&str> =
                names.iter().filter(|n| !run.joint_names.contains(n)).map(String::as_str).collect();
            if !strange.is_empty() {
                run.remarks.push(format!("{name} has joints that are not read: {}", strange.join(" ")));
            }
            for twice in named.names_twice() {
                let what = format!("joint {twice} is named more than once in a message: its last value there is read");
                run.lost.push(Loss { file: name.clone(), what, span: None });
            }
            let samples = named.samples(seconds(topic, clock, epoch), &run.joint_names);
            (put_in_order(samples, &name, true, faults), vec![run.joint_names.len(); message.fields.len()])
        }
        None => {
            let samples = put_in_order(samples(topic, clock, epoch), &name, false, faults);
            let width = |c: &ChannelFields| c.fields.iter().map(|f| f.elements.len()).sum();
            (samples, message.fields.iter().map(width).collect())
        }
    };
    let mut first = 0;
    for (channel, width) in message.fields.iter().zip(widths) {
        let own = columns(&samples, first, width);
        first += width;
        // Of two streams with one channel, the one that has it counts.
        if own.is_some() || slot(run, channel.channel).is_none() {
            *slot(run, channel.channel) = own;
        }
    }
}

/// The text of the robot's description: that of its own namespace, else any.
fn description(topics: &[Topic], mapping: &Mapping, namespace: &str) -> Option<String> {
    let own = format!("{namespace}{}", mapping.description_topic.as_deref()?);
    let with_text = topics.iter().filter_map(|t| Some((t, t.description.as_ref()?.as_ref()?)));
    with_text.max_by_key(|(t, _)| t.info.topic == own).map(|(_, text)| text.clone())
}

/// Where every stream of commands may be absent, one has to be there.
fn say_missing_commands(run: &Run, mapping: &Mapping, faults: &mut Vec<Fault>) {
    let is_of_commands = |c: &ChannelFields| c.channel.is_command();
    let streams = mapping.streams.iter().filter(|s| s.messages.iter().any(|m| m.fields.iter().any(is_of_commands)));
    let streams: Vec<&crate::mapping::StreamMapping> = streams.collect();
    if run.commands == Commands::default() && !streams.is_empty() && streams.iter().all(|s| s.optional) {
        let topics: Vec<&str> = streams.iter().map(|s| s.preferred_topic.as_str()).collect();
        let detail = format!("expected commands (as on {}), found none", topics.join(" or "));
        faults.push(Fault { kind: FaultKind::Missing, channel: "commands".into(), time: 0.0, count: 1, detail });
    }
}

/// Gains of the mapping, or those that the torques show, where no message has any.
fn add_gains(run: &mut Run, mapping: &Mapping) {
    let is_gain = |c: &ChannelFields| c.channel == Channel::CommandKp;
    if mapping.streams.iter().any(|s| s.messages.iter().any(|m| m.fields.iter().any(is_gain))) {
        return;
    }
    match &mapping.gains {
        Some([kp, kd]) => {
            let start = run.commands.position.as_ref().map_or(0.0, |s| s.time[0]);
            let n = run.joint_names.len();
            let row = |row: &Vec<f64>| if let [all] = row[..] { vec![all; n] } else { row.clone() };
            let one = |gains: &Vec<f64>| qv_core::JointSeries::new(vec![start], row(gains), n).ok();
            (run.commands.kp, run.commands.kd) = (one(kp), one(kd));
        }
        None => gains::from_torques(run),
    }
}

fn empty_run(mapping: &Mapping, epoch: u64, sources: Vec<Source>) -> Run {
    Run {
        foot_names: mapping.foot_names.clone(),
        imu_position: mapping.imu_position,
        epoch,
        sources,
        ..Run::empty(Robot::Named(mapping.robot.clone()), Base::Free, mapping.joint_names.clone())
    }
}

/// All mappings see all messages.
struct Collectors<'a>(Vec<Collector<'a>>);

impl MessageSink for Collectors<'_> {
    fn channel(&mut self, channel: &ChannelInfo) {
        self.0.iter_mut().for_each(|c| c.channel(channel));
    }

    fn message(&mut self, channel: u16, times: Times, data: &[u8]) {
        self.0.iter_mut().for_each(|c| c.message(channel, times, data));
    }
}

/// Finds places where the recorder's clock was set and takes the jump out of everything later, in all topics.
/// Returns the stamp before each jump, its size \[ns\] and the topic that showed it.
fn join_clocks(topics: &mut [Topic]) -> Vec<(i64, i64, String)> {
    let mut jumps = Vec::new();
    // More jumps than this are no clock but noise; sorting deals with the rest.
    while jumps.len() < 16 {
        let found = topics.iter().filter_map(|t| first_jump(&t.logged).map(|i| (t.order[i], t, i)));
        let Some((place, topic, index)) = found.min_by_key(|(place, _, _)| *place) else { break };
        let before = topic.logged[index - 1];
        let jump = topic.logged[index].saturating_sub(before).saturating_sub(period(&topic.logged));
        jumps.push((before, jump, topic.info.topic.clone()));
        for topic in topics.iter_mut() {
            let first = first_after(topic, place, jump);
            topic.logged[first..].iter_mut().for_each(|logged| *logged = logged.saturating_sub(jump));
        }
    }
    jumps
}

/// Median time between messages \[ns\].
fn period(logged: &[i64]) -> i64 {
    let mut steps: Vec<f64> = logged.windows(2).map(|w| w[1].saturating_sub(w[0]) as f64).collect();
    median(&mut steps).max(0.0) as i64
}

/// Index of a topic's first message after its clock jumped, which another topic showed at a place in the bag: recorders write some messages
/// late that they logged before.
fn first_after(topic: &Topic, place: u32, jump: i64) -> usize {
    const LATE: usize = 16;
    let logged = &topic.logged;
    let there = topic.order.iter().position(|p| *p >= place).unwrap_or(logged.len());
    let period = period(logged);
    let has_jumped = |i: &usize| {
        let step = logged[*i].saturating_sub(logged[i - 1]).saturating_sub(period);
        step.saturating_sub(jump).saturating_abs() < step.saturating_abs()
    };
    (there.max(1)..logged.len().min(there + LATE)).find(has_jumped).unwrap_or(there)
}

/// Index of the first message after a jump that lasts: a lone late message is out of order, no jump.
fn first_jump(logged: &[i64]) -> Option<usize> {
    (1..logged.len()).find(|&i| {
        let is_jump = |later: i64| {
            let step = later.saturating_sub(logged[i - 1]);
            !(-BACKWARD_JUMP..=FORWARD_JUMP).contains(&step)
        };
        is_jump(logged[i]) && logged[i..].iter().take(5).all(|&later| is_jump(later)) && logged.len() > i + 1
    })
}

/// Header stamps when they stay within a second of the (joined) log, else the log.
fn choose_clock(topic: &mut Topic) -> Clock {
    let agrees = topic.stamps.len() == topic.logged.len()
        && !topic.stamps.is_empty()
        && topic.stamps.iter().zip(&topic.logged).all(|(s, l)| s.saturating_sub(*l).abs() < SECOND);
    if agrees { Clock::Header } else { Clock::Log }
}

/// The clock of a topic; bursts are put where their messages were sent, which `remarks` get.
fn clock_of(topic: &mut Topic, remarks: &mut Vec<String>) -> Clock {
    let clock = choose_clock(topic);
    let is_header = clock == Clock::Header;
    let stamps = if is_header { &mut topic.stamps } else { &mut topic.logged };
    let Some(evened) = even_out(stamps, &topic.sender) else { return clock };
    remarks.push(format!("{}: {}", topic.info.topic, evened.how));
    let Some(of_sender) = evened.clock else { return clock };
    if is_header {
        topic.logged.clone_from(&topic.stamps);
    }
    of_sender
}

fn stamps_of(topic: &Topic, clock: Clock) -> &[i64] {
    if clock == Clock::Header { &topic.stamps } else { &topic.logged }
}

/// The earliest stamp, those half a day off the median left out.
fn first_stamp(stamps: &[i64]) -> i64 {
    let mut sorted = stamps.to_vec();
    sorted.sort_unstable();
    let middle = sorted.get(sorted.len() / 2).copied().unwrap_or(0);
    sorted.into_iter().find(|s| middle.saturating_sub(*s) < 12 * FORWARD_JUMP).unwrap_or(middle)
}

fn seconds(topic: &Topic, clock: Clock, epoch: i64) -> Vec<f64> {
    let seconds = |ns: &i64| ns.saturating_sub(epoch) as f64 / SECOND as f64;
    stamps_of(topic, clock).iter().map(seconds).collect()
}

fn samples(topic: &mut Topic, clock: Clock, epoch: i64) -> Samples {
    let time = seconds(topic, clock, epoch);
    let width = topic.width();
    Samples { time, rows: std::mem::take(&mut topic.rows), width }
}

fn sources(topics: &[Topic], clocks: &[Clock], chosen: &[Option<usize>], epoch: i64) -> Vec<Source> {
    let seconds = |ns: i64| ns.saturating_sub(epoch) as f64 / SECOND as f64;
    let one = |(index, topic): (usize, &Topic)| {
        let time: Vec<f64> = stamps_of(topic, clocks[index]).iter().map(|&ns| seconds(ns)).collect();
        source(&topic.info.topic, &topic.info.schema_name, &time, clocks[index], chosen.contains(&Some(index)))
    };
    topics.iter().enumerate().map(one).collect()
}

/// The figures of a stream with stamps `time` \[s\] in the order of arrival.
pub(crate) fn source(name: &str, type_name: &str, time: &[f64], clock: Clock, used: bool) -> Source {
    let period = median_interval(time);
    let near = time.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 0.0 && *d < 1.5 * period);
    let (sum, count) = near.fold((0.0, 0usize), |(sum, n), d| (sum + (d - period).powi(2), n + 1));
    let first = time.iter().copied().fold(f64::INFINITY, f64::min);
    let last = time.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Source {
        name: name.into(),
        type_name: type_name.into(),
        count: time.len(),
        rate: 1.0 / period,
        jitter: if count == 0 { f64::NAN } else { (sum / count as f64).sqrt() },
        span: if time.is_empty() { [0.0, 0.0] } else { [first, last] },
        clock,
        used,
    }
}

fn report_errors(topic: &Topic, epoch: i64, faults: &mut Vec<Fault>) {
    if let Some((logged, reason)) = &topic.first_error {
        let time = logged.saturating_sub(epoch) as f64 / SECOND as f64;
        let detail = format!("{} messages could not be decoded, the first: {reason}", topic.errors);
        let kind = FaultKind::Missing;
        faults.push(Fault { kind, channel: topic.info.topic.clone(), time, count: topic.errors, detail });
    }
}

/// The place of a channel in a run.
pub(crate) fn slot(run: &mut Run, channel: Channel) -> &mut Option<qv_core::JointSeries> {
    let (c, m) = (&mut run.commands, &mut run.measured);
    match channel {
        Channel::CommandPosition => &mut c.position,
        Channel::CommandVelocity => &mut c.velocity,
        Channel::CommandTorque => &mut c.torque,
        Channel::CommandKp => &mut c.kp,
        Channel::CommandKd => &mut c.kd,
        Channel::Position => &mut m.position,
        Channel::Velocity => &mut m.velocity,
        Channel::Torque => &mut m.torque,
        Channel::Gyro => &mut m.gyro,
        Channel::Acceleration => &mut m.acceleration,
        Channel::Orientation => &mut m.orientation,
        Channel::FootForce => &mut m.foot_force,
        Channel::BasePose => &mut m.base_pose,
    }
}
