//! The page of `qv watch`: topics, what is wrong with the data, what the channels are, and whether the robot changed.

use super::listen::Listener;
use qv_live::Health;
use qv_page::parts::{self, Mood};
use qv_page::{Page, Table, escape, fixed};
use std::time::{SystemTime, UNIX_EPOCH};

/// A topic that comes at less than this share of its usual rate is late.
const LATE: f64 = 0.8;

/// What the checks of the last seconds found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CheckResult {
    /// What is wrong, a line each.
    pub faults: Vec<String>,
    /// What each channel was compared with and what came of it.
    pub conventions: Vec<String>,
    /// Whether the robot is the one that was calibrated.
    pub drift: Option<String>,
}

/// Names of topics, and the largest rates so far \[Hz\].
pub struct Topics {
    names: Vec<String>,
    usual: Vec<f64>,
}

impl Topics {
    pub fn of(listener: &Listener) -> Self {
        let names: Vec<String> = listener.subscriptions.iter().map(|s| s.topic.clone()).collect();
        Self { usual: vec![0.0; names.len()], names }
    }

    /// The page as it is now.
    pub fn render(&mut self, title: &str, health: &Health, checked: &CheckResult) -> String {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
        let heads = ["topic", "rate [Hz]", "messages", "lost", "refused", "writers", "longest gap [s]"];
        let mut table = Table::with_left(&heads, &[0]);
        let mut wrong: Vec<String> = Vec::new();
        for ((name, usual), topic) in self.names.iter().zip(&mut self.usual).zip(&health.topics) {
            let rate = topic.rate(now);
            if topic.messages > 0 && rate < LATE * *usual {
                wrong.push(format!("{name}: {rate:.0} Hz, {:.0} Hz before", *usual));
            }
            *usual = usual.max(rate);
            if topic.lost > 0 {
                wrong.push(format!("{name}: {} messages were lost on the way", topic.lost));
            }
            if topic.writers > 1 {
                wrong.push(format!("{name}: {} writers", topic.writers));
            }
            if let Some(reason) = &topic.reason {
                wrong.push(format!("{name}: {} messages are none of its type ({reason})", topic.garbage));
            }
            table.row(&[
                escape(name),
                fixed(rate, 1),
                topic.messages.to_string(),
                topic.lost.to_string(),
                topic.garbage.to_string(),
                topic.writers.to_string(),
                fixed(topic.longest_gap, 3),
            ]);
        }
        wrong.extend(checked.faults.iter().cloned());
        let is_heard = health.topics.iter().any(|topic| topic.messages > 0);
        let head = match (is_heard, wrong.len()) {
            (false, _) => parts::verdict(Mood::Fair, "silent", "<p>No message yet.</p>"),
            (true, 0) => parts::verdict(Mood::Good, "well", "<p>Nothing wrong in the last seconds.</p>"),
            (true, n) => parts::verdict(Mood::Bad, &format!("{n} findings"), &parts::list(&wrong)),
        };
        let drift = checked
            .drift
            .as_ref()
            .map_or(String::new(), |text| parts::titled_card("Drift", &format!("<p>{}</p>", escape(text))));
        let conventions = match checked.conventions.is_empty() {
            true => String::new(),
            false => parts::titled_card("Conventions", &parts::list(&checked.conventions)),
        };
        let body = head + &parts::titled_card("Topics", &table.to_html()) + &drift + &conventions;
        Page { title, body: &body, ..Page::default() }.to_html()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_live::Health;

    #[test]
    fn a_browser_shows_the_page() {
        let mut health = Health::new(&[]).unwrap();
        let mut topic = qv_live::TopicHealth::default();
        (topic.messages, topic.lost, topic.longest_gap) = (500, 3, 0.012);
        health.topics = vec![topic];
        let mut topics = Topics { names: vec!["/lowstate".into()], usual: vec![500.0] };
        let checked = CheckResult {
            faults: vec!["3.2 s: gap in joint states".into()],
            conventions: vec!["quaternion: w first".into()],
            drift: Some("No parameter changed.".into()),
        };
        let html = topics.render("Robot on eth0", &health, &checked);
        assert!(html.contains("/lowstate") && html.contains("3 messages were lost"), "{html}");
        crate::browser::check("watch", &html);
    }
}
