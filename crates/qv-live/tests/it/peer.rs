//! A peer of another make in a process of its own: the Python types of Unitree's kit on Cyclone DDS. It needs a Python with `cyclonedds` and
//! `unitree-sdk2py-dimos`, named by QV_LIVE_PYTHON; without one the tests say that they skip.

use crate::skipped::skipped;
use qv_live::{Health, Receiver, Sample, Subscription, address_of, subscriptions};
use qv_recording::cdr::{Value, decode};
use qv_recording::schema::Schema;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const PEER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/it/peer.py");
/// Cyclone on loopback without multicast, which `lo` has not.
const LOOPBACK: &str = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\" multicast=\"false\"/></Interfaces></General>\
     <Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";

/// A Python that can be the peer.
fn python() -> Option<String> {
    let python = std::env::var("QV_LIVE_PYTHON").ok()?;
    let found = Command::new(&python).args(["-c", "import cyclonedds, unitree_sdk2py"]).output().ok()?;
    found.status.success().then_some(python)
}

fn peer(python: &str, domain: u16, count: u32, hertz: u32, what: &str) -> Child {
    let words = [domain.to_string(), count.to_string(), hertz.to_string(), what.to_string()];
    Command::new(python).arg(PEER).args(words).env("CYCLONEDDS_URI", LOOPBACK).stdout(Stdio::piped()).spawn().unwrap()
}

struct Heard {
    health: Health,
    samples: Vec<Sample>,
    state: usize,
    subscriptions: Vec<Subscription>,
}

/// All that comes until the peer is gone and nothing has come for a second.
fn hear(domain: u16, mut peer: Child) -> Heard {
    let mapping = qv_recording::robots::built_in("go2").unwrap().mapping;
    let subscriptions = subscriptions(&mapping, &[]).unwrap();
    let state = subscriptions.iter().position(|s| s.topic == "/lowstate").unwrap();
    let mut receiver = Receiver::new(address_of("lo").unwrap(), domain, &subscriptions).unwrap();
    let mut health = Health::new(&subscriptions).unwrap();
    let (mut samples, mut last, begun) = (Vec::new(), Instant::now(), Instant::now());
    loop {
        let found = receiver.take(Duration::from_millis(100));
        if !found.is_empty() {
            last = Instant::now();
        }
        samples.extend(found.into_iter().filter(|sample| health.count(sample)));
        let is_gone = peer.try_wait().unwrap().is_some();
        if is_gone && last.elapsed() > Duration::from_secs(1) || begun.elapsed() > Duration::from_secs(180) {
            break;
        }
    }
    peer.kill().ok();
    peer.wait().unwrap();
    let said: Vec<String> = BufReader::new(peer.stdout.take().unwrap()).lines().map_while(Result::ok).collect();
    assert!(said.iter().any(|line| line == "begun"), "the peer said {said:?}");
    Heard { health, samples, state, subscriptions }
}

fn ticks(heard: &Heard) -> Vec<u64> {
    let subscription = &heard.subscriptions[heard.state];
    let schema = Schema::parse(&subscription.message_type, &subscription.definition).unwrap();
    let tick = |sample: &Sample| match decode(&schema, &sample.data).unwrap().get("tick") {
        Some(Value::Unsigned(tick)) => *tick,
        other => panic!("expected a tick, found {other:?}"),
    };
    heard.samples.iter().filter(|s| s.subscription == heard.state).map(tick).collect()
}

#[test]
fn a_peer_of_another_make_is_heard_without_a_loss() {
    let Some(python) = python() else {
        return skipped("QV_LIVE_PYTHON names no Python with cyclonedds and unitree_sdk2py");
    };
    let heard = hear(61, peer(&python, 61, 2500, 500, "-"));
    assert_eq!(ticks(&heard), (0..2500).collect::<Vec<u64>>());
    let topic = &heard.health.topics[heard.state];
    assert_eq!((topic.messages, topic.lost, topic.garbage, topic.writers), (2500, 0, 0, 1));
    assert!(heard.samples[0].sent.is_some_and(|sent| sent.abs_diff(heard.samples[0].received) < 1_000_000_000));
}

#[test]
fn a_peer_that_dies_and_garbage_on_the_wire_cost_nothing_that_came() {
    let Some(python) = python() else {
        return skipped("QV_LIVE_PYTHON names no Python with cyclonedds and unitree_sdk2py");
    };
    let died = hear(62, peer(&python, 62, 1000, 500, "die"));
    let found = ticks(&died);
    // What was under way when it died may be gone; what came is whole and in order.
    assert!(found.len() >= 990 && found.windows(2).all(|w| w[1] > w[0]), "{} of 1000", found.len());
    let noisy = hear(63, peer(&python, 63, 500, 200, "garbage"));
    assert_eq!(ticks(&noisy), (0..500).collect::<Vec<u64>>());
}

#[test]
fn a_flood_is_taken_or_counted() {
    let Some(python) = python() else {
        return skipped("QV_LIVE_PYTHON names no Python with cyclonedds and unitree_sdk2py");
    };
    let heard = hear(64, peer(&python, 64, 20_000, 1_000_000, "-"));
    let topic = &heard.health.topics[heard.state];
    assert!(topic.messages > 0 && topic.messages + topic.lost <= 20_000, "{topic:?}");
    assert!(
        topic.messages + topic.lost > 19_000,
        "what did not come is counted: {} and {}",
        topic.messages,
        topic.lost
    );
}
