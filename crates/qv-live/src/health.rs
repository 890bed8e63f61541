//! What came on each topic: counts, rates, losses, and what was no message of its type.

use crate::subscription::{Sample, Subscription};
use qv_recording::RecordingError;
use qv_recording::cdr::decode;
use qv_recording::schema::Schema;
use std::collections::BTreeMap;

/// Span over which a rate is taken \[ns\].
const SPAN: u64 = 2_000_000_000;

/// What came on one topic.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TopicHealth {
    /// Messages that are what their type says.
    pub messages: u64,
    /// Messages that are not.
    pub garbage: u64,
    /// Why the last of them was refused.
    pub reason: Option<String>,
    /// Messages that their writers numbered and that never came.
    pub lost: u64,
    /// Writers so far: more than one on a topic is two robots, or somebody who publishes beside the robot.
    pub writers: usize,
    /// When the last one came \[ns since the epoch\]; 0 before the first.
    pub last: u64,
    /// Longest time between two messages \[s\].
    pub longest_gap: f64,
    /// Arrival of messages within the last two seconds.
    recent: std::collections::VecDeque<u64>,
    /// Last number of each writer.
    numbers: BTreeMap<u64, i64>,
    /// Length of messages that were decoded: those of one length and a fixed layout are alike.
    good_length: Option<usize>,
}

impl TopicHealth {
    /// Messages a second over the last two seconds before `now` \[ns since the epoch\].
    pub fn rate(&self, now: u64) -> f64 {
        let since = now.saturating_sub(SPAN);
        let count = self.recent.iter().filter(|t| **t > since).count();
        count as f64 / (SPAN as f64 * 1e-9)
    }
}

/// Counts of all topics.
pub struct Health {
    schemas: Vec<Schema>,
    /// One for each subscription.
    pub topics: Vec<TopicHealth>,
}

impl Health {
    /// # Errors
    /// A definition that is none.
    pub fn new(subscriptions: &[Subscription]) -> Result<Self, RecordingError> {
        let schema = |s: &Subscription| Schema::parse(&s.message_type, &s.definition);
        let schemas = subscriptions.iter().map(schema).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { topics: vec![TopicHealth::default(); schemas.len()], schemas })
    }

    /// Counts a sample. Returns whether it is a message of its type: what is not would end a reader of the file.
    pub fn count(&mut self, sample: &Sample) -> bool {
        let Some(topic) = self.topics.get_mut(sample.subscription) else { return false };
        let last = topic.numbers.insert(sample.writer, sample.sequence);
        topic.writers = topic.numbers.len();
        if let Some(missing) = last.map(|last| sample.sequence - last - 1).filter(|missing| *missing > 0) {
            topic.lost += missing as u64;
        }
        if topic.good_length != Some(sample.data.len()) {
            if let Err(error) = decode(&self.schemas[sample.subscription], &sample.data) {
                topic.garbage += 1;
                topic.reason = Some(error.to_string());
                return false;
            }
            topic.good_length = Some(sample.data.len());
        }
        if topic.last > 0 {
            let gap = sample.received.saturating_sub(topic.last) as f64 * 1e-9;
            topic.longest_gap = topic.longest_gap.max(gap);
        }
        topic.messages += 1;
        topic.last = topic.last.max(sample.received);
        topic.recent.push_back(sample.received);
        while topic.recent.front().is_some_and(|t| *t + SPAN < sample.received) {
            topic.recent.pop_front();
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_go2::messages::{LOW_STATE, LOW_STATE_TYPE, LowState, encode_low_state};

    fn subscription() -> Subscription {
        Subscription { topic: "/lowstate".into(), message_type: LOW_STATE_TYPE.into(), definition: LOW_STATE.into() }
    }

    fn sample(sequence: i64) -> Sample {
        let data = encode_low_state(&LowState::default());
        Sample { subscription: 0, received: 2_000_000 * sequence as u64, sent: None, writer: 1, sequence, data }
    }

    #[test]
    fn losses_gaps_and_rates_are_counted() {
        let mut health = Health::new(&[subscription()]).unwrap();
        let kept = |k: &i64| !(600..605).contains(k);
        (1..=2000).filter(kept).for_each(|k| assert!(health.count(&sample(k))));
        let topic = &health.topics[0];
        assert_eq!((topic.messages, topic.lost, topic.garbage, topic.writers), (1995, 5, 0, 1));
        assert!((topic.longest_gap - 0.012).abs() < 1e-9, "{}", topic.longest_gap);
        assert!((topic.rate(4_000_000_000) - 500.0).abs() < 3.0, "{}", topic.rate(4_000_000_000));
        assert_eq!(topic.rate(60_000_000_000), 0.0, "a peer that died has no rate");
    }

    #[test]
    fn what_is_no_message_is_refused_and_the_next_one_taken() {
        let mut health = Health::new(&[subscription()]).unwrap();
        assert!(health.count(&sample(1)));
        for bad in [vec![], vec![0, 1, 0, 0], vec![0xff; 1176], vec![0, 1, 0, 0, 7]] {
            assert!(!health.count(&Sample { data: bad, ..sample(2) }));
        }
        assert!(health.count(&sample(3)));
        let topic = &health.topics[0];
        assert_eq!((topic.messages, topic.garbage), (2, 4));
        assert!(topic.reason.is_some());
    }
}
