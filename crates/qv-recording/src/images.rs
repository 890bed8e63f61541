//! Images of a bag: compressed ones with their stamps, and what the camera says of itself.

use crate::bag::BagFile;
use crate::cdr::{Value, decode};
use crate::container::read_messages;
use crate::definitions::standard;
use crate::run::{Clock, Loss};
use crate::schema::Schema;
use crate::stream::{ChannelInfo, MessageSink, Times};
use std::collections::BTreeMap;
use std::io::Read;

/// Message type of images.
pub(crate) const COMPRESSED_IMAGE: &str = "sensor_msgs/msg/CompressedImage";
/// Message type of intrinsics.
pub(crate) const CAMERA_INFO: &str = "sensor_msgs/msg/CameraInfo";
/// Most images that are kept; of longer recordings every second, fourth and so on.
const MOST: usize = 512;
/// Header stamps this near to the log are believed \[ns\].
const AGREES: u64 = 1_000_000_000;

/// A compressed image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CompressedImage {
    /// When it was taken by its stamp \[ns since the epoch\].
    pub stamp: u64,
    /// A JPEG or PNG file.
    pub data: Vec<u8>,
}

/// What a camera says of itself (`sensor_msgs/msg/CameraInfo`).
#[derive(Debug, Clone, PartialEq)]
pub struct CameraInfo {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Name of the distortion model, such as `plumb_bob`.
    pub distortion_model: String,
    /// Its coefficients; for `plumb_bob` k1, k2, p1, p2, k3.
    pub distortion: Vec<f64>,
    /// Camera matrix, row by row.
    pub matrix: [f64; 9],
}

/// Images of one topic of a bag, in the order of their stamps.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Images {
    /// The topic; empty when no topic has images.
    pub topic: String,
    /// All topics with images.
    pub topics: Vec<String>,
    /// The images, thinned to some hundreds.
    pub images: Vec<CompressedImage>,
    /// Whether their stamps are those of headers.
    pub clock: Option<Clock>,
    /// The newest camera info of the bag.
    pub info: Option<CameraInfo>,
    /// Messages that could not be read, and the first reason.
    pub damaged: Option<(usize, String)>,
    /// What was lost of the files.
    pub lost: Vec<Loss>,
}

/// What is kept of a topic.
#[derive(Default)]
struct Topic {
    /// Log time, header stamp, file.
    kept: Vec<(u64, Option<u64>, Vec<u8>)>,
    count: usize,
    every: usize,
}

#[derive(Default)]
struct Collector {
    channels: BTreeMap<u16, (String, String, Option<Schema>)>,
    topics: BTreeMap<String, Topic>,
    /// The last one of each topic.
    infos: BTreeMap<String, CameraInfo>,
    damaged: Option<(usize, String)>,
}

/// Reads images of a bag of one or more files: those of `topic`, else of the topic that has most of them.
///
/// Stamps are those of the headers where they agree with the log within a second, else those of the log, as for all other streams.
pub fn read_images<R: Read>(files: impl IntoIterator<Item = BagFile<R>>, topic: Option<&str>) -> Images {
    let mut collector = Collector::default();
    let mut lost = Vec::new();
    for file in files {
        collector.channels.clear();
        lost.extend(read_messages(&file.name, file.source, &mut collector));
    }
    let topics: Vec<String> = collector.topics.keys().cloned().collect();
    let chosen = match topic {
        Some(name) => collector.topics.remove_entry(name),
        None => {
            let most = collector.topics.iter().max_by_key(|(_, t)| t.count).map(|(name, _)| name.clone());
            most.and_then(|name| collector.topics.remove_entry(&name))
        }
    };
    let info = info_of(chosen.as_ref().map_or("", |(name, _)| name), collector.infos);
    let mut out = Images { topics, info, damaged: collector.damaged, lost, ..Default::default() };
    let Some((name, topic)) = chosen else { return out };
    let agrees = |(logged, stamp, _): &(u64, Option<u64>, Vec<u8>)| stamp.is_some_and(|s| s.abs_diff(*logged) < AGREES);
    let by_header = topic.kept.iter().all(agrees);
    out.topic = name;
    out.clock = Some(if by_header { Clock::Header } else { Clock::Log });
    let image = |(logged, stamp, data): (u64, Option<u64>, Vec<u8>)| CompressedImage {
        stamp: if by_header { stamp.unwrap_or(logged) } else { logged },
        data,
    };
    out.images = topic.kept.into_iter().map(image).collect();
    out.images.sort_by_key(|i| i.stamp);
    out.images.dedup_by_key(|i| i.stamp);
    out
}

/// The camera information of a topic of images: the only one, or that whose topic begins like it for longest, as
/// `/front/image_raw/compressed` and `/front/camera_info` do; none where several begin alike and differ.
fn info_of(images: &str, infos: BTreeMap<String, CameraInfo>) -> Option<CameraInfo> {
    let alike = |topic: &str| topic.bytes().zip(images.bytes()).take_while(|(a, b)| a == b).count();
    let most = infos.keys().map(|topic| alike(topic)).max()?;
    let mut nearest = infos.into_iter().filter(|(topic, _)| alike(topic) == most).map(|(_, info)| info);
    let first = nearest.next()?;
    nearest.all(|other| other == first).then_some(first)
}

impl MessageSink for Collector {
    fn channel(&mut self, channel: &ChannelInfo) {
        let wanted = [COMPRESSED_IMAGE, CAMERA_INFO].contains(&channel.schema_name.as_str());
        if !wanted || channel.message_encoding != "cdr" {
            return;
        }
        let own = String::from_utf8_lossy(&channel.schema_text).into_owned();
        let definition = if own.is_empty() { standard(&channel.schema_name).unwrap_or(own) } else { own };
        let schema = Schema::parse(&channel.schema_name, &definition).ok();
        if channel.schema_name == COMPRESSED_IMAGE {
            self.topics.entry(channel.topic.clone()).or_default();
        }
        self.channels.insert(channel.id, (channel.topic.clone(), channel.schema_name.clone(), schema));
    }

    fn message(&mut self, channel: u16, times: Times, data: &[u8]) {
        let Some((topic, type_name, schema)) = self.channels.get(&channel) else { return };
        let is_image = type_name == COMPRESSED_IMAGE;
        if is_image {
            let kept = self.topics.entry(topic.clone()).or_default();
            kept.count += 1;
            // Most are not decoded, so that a long recording costs no more than a short one.
            if !(kept.count - 1).is_multiple_of(kept.every.max(1)) {
                return;
            }
        }
        let decoded = match schema {
            Some(schema) => decode(schema, data).map_err(|e| e.to_string()),
            None => Err(format!("{type_name}: expected a definition that can be read, found none")),
        };
        match decoded {
            Ok(value) if is_image => match image(&value) {
                Some((stamp, data)) => {
                    let topic = self.topics.get_mut(topic).expect("made above");
                    topic.keep(times.logged, stamp, data);
                }
                None => self.spoilt(format!("{type_name}: expected a sequence of bytes `data`, found none")),
            },
            Ok(value) => {
                if let Some(info) = camera_info(&value) {
                    self.infos.insert(topic.clone(), info);
                }
            }
            Err(error) => self.spoilt(error),
        }
    }
}

impl Collector {
    fn spoilt(&mut self, why: String) {
        let damaged = self.damaged.get_or_insert((0, why));
        damaged.0 += 1;
    }
}

impl Topic {
    fn keep(&mut self, logged: u64, stamp: Option<u64>, data: Vec<u8>) {
        self.kept.push((logged, stamp, data));
        if self.kept.len() >= MOST {
            let mut index = 0;
            self.kept.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.every = 2 * self.every.max(1);
        }
    }
}

/// Stamp and file of an image.
fn image(value: &Value) -> Option<(Option<u64>, Vec<u8>)> {
    let Some(Value::Bytes(data)) = value.get("data") else { return None };
    let part = |name: &str| value.get(&format!("header.stamp.{name}")).and_then(Value::as_f64);
    let stamp = part("sec")
        .zip(part("nanosec"))
        .map(|(s, ns)| (s.max(0.0) as u64).saturating_mul(1_000_000_000).saturating_add(ns as u64));
    Some((stamp, data.clone()))
}

fn camera_info(value: &Value) -> Option<CameraInfo> {
    let number = |name: &str| value.get(name).and_then(Value::as_f64);
    let numbers = |name: &str| match value.get(name) {
        Some(Value::Array(all)) => all.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>(),
        _ => None,
    };
    let distortion_model = match value.get("distortion_model") {
        Some(Value::String(name)) => name.clone(),
        _ => String::new(),
    };
    Some(CameraInfo {
        width: number("width")? as u32,
        height: number("height")? as u32,
        distortion_model,
        distortion: numbers("d").or_else(|| numbers("D"))?,
        matrix: numbers("k").or_else(|| numbers("K"))?.try_into().ok()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time: u64) -> Times {
        Times { logged: time, sent: time }
    }
    use crate::cdr::Writer;

    const IMAGE: &str = "std_msgs/Header header\nstring format\nuint8[] data\n===\nMSG: std_msgs/Header\n\
        builtin_interfaces/Time stamp\nstring frame_id\n";
    const INFO: &str = "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n\
        ===\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
    const START: u64 = 1_700_000_000_000_000_000;

    fn channel(id: u16, topic: &str, name: &str, text: &str) -> ChannelInfo {
        ChannelInfo {
            id,
            topic: topic.into(),
            message_encoding: "cdr".into(),
            schema_name: name.into(),
            schema_encoding: "ros2msg".into(),
            schema_text: text.as_bytes().to_vec(),
        }
    }

    fn compressed(stamp: u64, data: &[u8]) -> Vec<u8> {
        let mut writer = Writer::new();
        writer.time(stamp).string("camera").string("jpeg").u32(data.len() as u32);
        data.iter().for_each(|b| {
            writer.u8(*b);
        });
        writer.finish()
    }

    #[test]
    fn images_and_camera_are_read_and_thinned() {
        let mut collector = Collector::default();
        collector.channel(&channel(1, "/front", COMPRESSED_IMAGE, IMAGE));
        collector.channel(&channel(2, "/info", CAMERA_INFO, INFO));
        for k in 0..2000u64 {
            collector.message(1, at(START + k), &compressed(START + k - 5, &[k as u8, 7]));
        }
        collector.message(1, at(START + 5000), &[0, 1, 0, 0, 9]);
        let mut writer = Writer::new();
        writer
            .time(START)
            .string("camera")
            .u32(480)
            .u32(640)
            .string("plumb_bob")
            .f64_sequence(&[0.1, 0.0, 0.0, 0.0, 0.0]);
        [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0].iter().for_each(|x| {
            writer.f64(*x);
        });
        collector.message(2, at(START), &writer.finish());
        let topic = &collector.topics["/front"];
        assert!(topic.kept.len() < MOST && topic.kept.len() > MOST / 4, "{}", topic.kept.len());
        let steps: Vec<u64> = topic.kept.windows(2).map(|w| w[1].0 - w[0].0).collect();
        assert!(steps.iter().all(|s| *s == steps[0]), "{steps:?}");
        assert_eq!((topic.kept[0].1, &topic.kept[0].2[..]), (Some(START - 5), &[0u8, 7][..]));
        let info = collector.infos.values().next().unwrap();
        assert_eq!((info.width, info.height, info.matrix[4], info.distortion[0]), (640, 480, 501.0, 0.1));
        collector.message(1, at(START + 6000), &[0, 1, 0, 0, 9]);
    }

    #[test]
    fn damage_is_counted_and_nothing_is_nothing() {
        let mut collector = Collector::default();
        collector.channel(&channel(1, "/front", COMPRESSED_IMAGE, IMAGE));
        collector.message(1, at(START), &[0, 1, 0, 0, 9]);
        assert_eq!(collector.damaged.as_ref().unwrap().0, 1);
        let none = read_images([BagFile { name: "x".into(), source: &b""[..] }], None);
        assert!(none.images.is_empty() && none.topics.is_empty() && !none.lost.is_empty());
    }
}
