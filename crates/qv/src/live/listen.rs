//! The loop of both commands: samples until somebody stops it, counted.

use super::Listening;
use crate::Failure;
use crate::outcome::about;
use crate::progress::remark;
use crate::stop;
use qv_go2::messages::{SPORT_MODE_STATE, SPORT_MODE_STATE_TYPE};
use qv_live::{Health, LiveError, Receiver, Sample, Subscription, address_of, subscriptions};
use qv_recording::mapping::Mapping;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Longest wait for a sample: a stop is heeded within it.
const PATIENCE: Duration = Duration::from_millis(100);
/// After so long without any message it is said that there is none.
const SILENCE: Duration = Duration::from_secs(10);

/// Topics of a robot, heard on an interface.
pub struct Listener {
    pub mapping: Mapping,
    pub subscriptions: Vec<Subscription>,
    pub health: Health,
    receiver: Receiver,
    until: Option<Duration>,
}

impl Listener {
    /// # Errors
    /// There is no such robot or interface, or DDS refuses.
    pub fn new(how: &Listening) -> Result<Self, Failure> {
        let unknown = || about(Path::new(&how.robot), "expected a robot of `qv robots`, or a robot file");
        let robot = qv_open::robot_mapping(&how.robot)?.ok_or_else(unknown)?;
        let sport = Subscription {
            topic: "/sportmodestate".into(),
            message_type: SPORT_MODE_STATE_TYPE.into(),
            definition: SPORT_MODE_STATE.into(),
        };
        // Robots with the same low messages have the same high ones.
        let is_like_go2 = robot.definitions.iter().any(|d| d.0 == qv_go2::messages::LOW_STATE_TYPE);
        let more = if is_like_go2 { vec![sport] } else { Vec::new() };
        let subscriptions = subscriptions(&robot, &more)?;
        let receiver = Receiver::new(address_of(&how.live)?, how.domain, &subscriptions)?;
        let health = Health::new(&subscriptions)?;
        let topics: Vec<String> = subscriptions.iter().map(Subscription::dds_topic).collect();
        remark(&format!("listening on {}, domain {}: {}", how.live, how.domain, topics.join(", ")));
        Ok(Self { mapping: robot, subscriptions, health, receiver, until: how.seconds.map(Duration::from_secs_f64) })
    }

    /// Shows `see` each message that is one of its type, and `idle` after each batch, until the time is over or somebody asks for a stop.
    ///
    /// # Errors
    /// Those of `see`.
    pub fn run(
        &mut self,
        mut see: impl FnMut(Sample) -> Result<(), LiveError>,
        mut idle: impl FnMut(&Health) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let asked = stop::asked();
        let begun = Instant::now();
        let mut is_said = false;
        while !asked.load(Ordering::Relaxed) && self.until.is_none_or(|until| begun.elapsed() < until) {
            for sample in self.receiver.take(PATIENCE) {
                if self.health.count(&sample) {
                    see(sample)?;
                }
            }
            idle(&self.health)?;
            if !is_said && begun.elapsed() > SILENCE && self.messages() == 0 {
                is_said = true;
                remark(
                    "no message yet: is the robot on this interface and in this domain, and is multicast let through?",
                );
            }
        }
        Ok(())
    }

    /// Messages of all topics.
    pub fn messages(&self) -> u64 {
        self.health.topics.iter().map(|topic| topic.messages).sum()
    }

    /// Whether something was lost on the way or was no message.
    pub fn is_partial(&self) -> bool {
        let refused: u64 = self.receiver.refused.iter().sum();
        refused > 0 || self.health.topics.iter().any(|topic| topic.lost > 0 || topic.garbage > 0)
    }

    /// Counts as JSON, one object for each topic.
    pub fn to_json(&self) -> Value {
        let topics = self.subscriptions.iter().zip(&self.health.topics).zip(&self.receiver.refused);
        let of = |((subscription, topic), refused): ((&Subscription, &qv_live::TopicHealth), &u64)| {
            json!({
                "topic": subscription.topic, "type": subscription.message_type, "messages": topic.messages, "lost": topic.lost,
                "garbage": topic.garbage + refused, "writers": topic.writers, "longest_gap_s": topic.longest_gap,
            })
        };
        Value::Array(topics.map(of).collect())
    }

    /// Counts as lines.
    pub fn to_text(&self) -> String {
        let mut text = String::from("topic              messages      lost   refused  longest gap [s]\n");
        for ((subscription, topic), refused) in
            self.subscriptions.iter().zip(&self.health.topics).zip(&self.receiver.refused)
        {
            let (name, garbage) = (&subscription.topic, topic.garbage + refused);
            _ = writeln!(
                text,
                "{name:<16} {:>10} {:>9} {garbage:>9} {:>16.3}",
                topic.messages, topic.lost, topic.longest_gap
            );
        }
        text
    }
}
