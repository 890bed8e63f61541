//! Samples over DDS, by RustDDS: pure Rust, so that nothing has to be installed on a robot. It only reads.

use crate::LiveError;
use crate::subscription::{Sample, Subscription};
use rustdds::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SimpleDataReader};
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, Duration, QosPolicies, QosPolicyBuilder, RepresentationIdentifier,
    Subscriber, TopicKind,
};
use std::convert::Infallible;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::task::{Wake, Waker};
use std::thread::{self, Thread};
use std::time::{SystemTime, UNIX_EPOCH};

/// Messages of a topic that are kept until they are taken: eight seconds at 500 Hz.
const DEPTH: i32 = 4096;
/// Messages that are handed on at once at most.
const BATCH: usize = 4096;
/// Encodings that a bag holds: plain CDR of either byte order.
const ENCODINGS: [RepresentationIdentifier; 2] = [RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE];

/// Bytes of a message with their encapsulation.
struct Raw(Vec<u8>);

struct AsTheyCame;

#[derive(Clone)]
struct Copy;

impl DeserializerAdapter<Raw> for AsTheyCame {
    type Error = Infallible;
    type Decoded = Raw;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &ENCODINGS
    }

    fn transform_decoded(decoded: Raw) -> Raw {
        decoded
    }
}

impl Decode<'_, Raw> for Copy {
    type Error = Infallible;

    fn decode_bytes(self, bytes: &[u8], encoding: RepresentationIdentifier) -> Result<Raw, Infallible> {
        let mut all = Vec::with_capacity(4 + bytes.len());
        all.extend(encoding.to_bytes());
        all.extend([0, 0]);
        all.extend(bytes);
        Ok(Raw(all))
    }
}

impl DefaultDecoder<Raw> for AsTheyCame {
    type Decoder = Copy;
    const DECODER: Copy = Copy;
}

/// Wakes the thread that waits for samples.
struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

type Reader = SimpleDataReader<Raw, AsTheyCame>;

/// Subscriptions on one interface.
pub struct Receiver {
    readers: Vec<Reader>,
    // Both end with the receiver, and its readers with them.
    _subscriber: Subscriber,
    _participant: DomainParticipant,
    /// Refused messages, by subscription: in an encoding that no bag has.
    pub refused: Vec<u64>,
}

impl Receiver {
    /// Subscribes in a domain on the interface with `address`.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn new(address: IpAddr, domain: u16, subscriptions: &[Subscription]) -> Result<Self, LiveError> {
        let failed = |what: &str, reason: String| LiveError::Dds { what: what.into(), reason };
        let participant = DomainParticipantBuilder::new(domain)
            .with_only_networks([address])
            .same_host_loopback(address.is_loopback())
            .build()
            .map_err(|e| failed("a participant", e.to_string()))?;
        let qos = quality();
        let subscriber = participant.create_subscriber(&qos).map_err(|e| failed("a subscriber", e.to_string()))?;
        let mut readers = Vec::new();
        for one in subscriptions {
            let reader = participant
                .create_topic(one.dds_topic(), one.dds_type(), &qos, TopicKind::NoKey)
                .and_then(|topic| subscriber.create_simple_datareader_no_key(&topic, Some(qos.clone())))
                .map_err(|e| failed(&one.topic, e.to_string()))?;
            readers.push(reader);
        }
        let refused = vec![0; readers.len()];
        Ok(Self { readers, _subscriber: subscriber, _participant: participant, refused })
    }

    /// What has come, after waiting for at most `patience`; in the order of arrival by topic. Called by one thread.
    pub fn take(&mut self, patience: std::time::Duration) -> Vec<Sample> {
        let found = self.take_now();
        if !found.is_empty() {
            return found;
        }
        let waker = Waker::from(Arc::new(Unpark(thread::current())));
        self.readers.iter().for_each(|reader| reader.set_waker(Some(waker.clone())));
        // What came meanwhile wakes nobody.
        let found = self.take_now();
        if found.is_empty() {
            thread::park_timeout(patience);
            return self.take_now();
        }
        found
    }

    fn take_now(&mut self) -> Vec<Sample> {
        let mut found = Vec::new();
        for (subscription, reader) in self.readers.iter().enumerate() {
            reader.drain_read_notifications();
            while found.len() < BATCH {
                match reader.try_take_one() {
                    Ok(Some(change)) => {
                        let mut hasher = DefaultHasher::new();
                        change.writer_guid.hash(&mut hasher);
                        found.push(Sample {
                            subscription,
                            received: now(),
                            sent: change.write_options.source_timestamp().map(|t| nanoseconds(t.to_ticks())),
                            writer: hasher.finish(),
                            sequence: change.sequence_number.into(),
                            data: change.sample.0,
                        });
                    }
                    Ok(None) => break,
                    Err(_) => self.refused[subscription] += 1,
                }
            }
        }
        found
    }
}

/// Reliable where the writer is: what is lost on the way is asked for again.
fn quality() -> QosPolicies {
    QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time: Duration::from_millis(100) })
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: DEPTH })
        .build()
}

fn now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64)
}

/// Of ticks of 2^-32 s.
fn nanoseconds(ticks: u64) -> u64 {
    ((u128::from(ticks) * 1_000_000_000) >> 32) as u64
}

/// Names and IPv4 addresses of the interfaces of this machine.
fn addresses() -> Vec<(String, Ipv4Addr)> {
    let of_one = |one: netdev::Interface| one.ipv4_addrs().first().map(|address| (one.name.clone(), *address));
    netdev::get_interfaces().into_iter().filter_map(of_one).collect()
}

/// The address of an interface, by its name or the address itself; `lo` is 127.0.0.1.
///
/// # Errors
/// There is no such interface, or it has no IPv4 address.
pub fn address_of(interface: &str) -> Result<IpAddr, LiveError> {
    if let Ok(address) = interface.parse() {
        return Ok(address);
    }
    if interface == "lo" {
        return Ok(Ipv4Addr::LOCALHOST.into());
    }
    let addresses = addresses();
    let found = addresses.iter().find(|(name, _)| name == interface);
    found.map(|(_, address)| (*address).into()).ok_or_else(|| {
        let names: Vec<&str> = addresses.iter().map(|(name, _)| name.as_str()).collect();
        let reason = format!("no such interface with an IPv4 address; there are {}", names.join(", "));
        LiveError::Interface { interface: interface.into(), reason }
    })
}
