//! What was read of the topics of a bag.

use crate::RecordingError;
use crate::bursts::Sender;
use crate::cdr::Cursor;
use crate::definitions::standard;
use crate::mapping::{Mapping, MessageMapping, stream_of};
use crate::named::NamedJoints;
use crate::plan::{FieldSelection, Plan};
use crate::schema::Schema;
use crate::stream::{ChannelInfo, MessageSink, Times};
use std::collections::BTreeMap;

/// Nanoseconds in a second.
pub(crate) const SECOND: i64 = 1_000_000_000;

/// Field in which a Unitree robot counts milliseconds since it was switched on.
const TICK: &str = "tick";

/// What was read of one topic.
pub(crate) struct Topic {
    pub info: ChannelInfo,
    /// Logged at \[ns\], one per message.
    pub logged: Vec<i64>,
    /// Place of each message in the bag; kept for streams in use only.
    pub order: Vec<u32>,
    /// Which stream of the mapping it could be, and which of the stream's types it has.
    pub stream: Option<(usize, usize)>,
    pub plan: Option<Plan>,
    /// In place of a plan where messages name their joints.
    pub named: Option<NamedJoints>,
    /// The text of a robot's description: `None` where the topic has none.
    pub description: Option<Option<String>>,
    pub refused: Option<String>,
    pub has_header: bool,
    pub stamps: Vec<i64>,
    /// Whether messages have a [`TICK`], and what their sender says of its time.
    pub has_ticks: bool,
    pub sender: Sender,
    pub rows: Vec<f64>,
    pub row: Vec<f64>,
    pub errors: usize,
    pub first_error: Option<(i64, String)>,
}

/// What a mapping reads of a bag.
pub(crate) struct Collector<'a> {
    pub mapping: &'a Mapping,
    pub topics: Vec<Topic>,
    by_name: BTreeMap<(String, String), usize>,
    pub by_id: BTreeMap<u16, usize>,
    messages: u32,
}

impl<'a> Collector<'a> {
    pub fn new(mapping: &'a Mapping) -> Self {
        Self { mapping, topics: Vec::new(), by_name: BTreeMap::new(), by_id: BTreeMap::new(), messages: 0 }
    }
}

impl MessageSink for Collector<'_> {
    fn channel(&mut self, channel: &ChannelInfo) {
        let key = (channel.topic.clone(), channel.schema_name.clone());
        let index = match self.by_name.get(&key) {
            Some(&index) => index,
            None => {
                self.topics.push(Topic::new(channel, self.mapping));
                self.by_name.insert(key, self.topics.len() - 1);
                self.topics.len() - 1
            }
        };
        self.by_id.insert(channel.id, index);
    }

    fn message(&mut self, channel: u16, times: Times, data: &[u8]) {
        let Some(&index) = self.by_id.get(&channel) else { return };
        let place = self.messages;
        self.messages = self.messages.saturating_add(1);
        let [logged, sent] = [times.logged, times.sent].map(|t| i64::try_from(t).unwrap_or(i64::MAX));
        let topic = &mut self.topics[index];
        let before = topic.logged.len();
        topic.message(place, logged, data);
        if topic.logged.len() > before {
            topic.sender.sent.push(sent);
        }
    }
}

/// The channel with the definition that is built in, where the bag carries none.
fn with_definition(info: &ChannelInfo, mapping: &Mapping) -> ChannelInfo {
    let own = mapping.definitions.iter().find(|(name, _)| *name == info.schema_name).map(|(_, text)| text.clone());
    match own.or_else(|| standard(&info.schema_name)) {
        Some(text) if info.schema_text.is_empty() && !info.schema_name.is_empty() => {
            ChannelInfo { schema_encoding: "ros2msg".into(), schema_text: text.into_bytes(), ..info.clone() }
        }
        _ => info.clone(),
    }
}

impl Topic {
    fn new(info: &ChannelInfo, mapping: &Mapping) -> Self {
        let info = &with_definition(info, mapping);
        let mut topic = Self {
            info: info.clone(),
            logged: Vec::new(),
            order: Vec::new(),
            stream: None,
            plan: None,
            named: None,
            description: None,
            refused: None,
            has_header: false,
            stamps: Vec::new(),
            has_ticks: false,
            sender: Sender::default(),
            rows: Vec::new(),
            row: Vec::new(),
            errors: 0,
            first_error: None,
        };
        topic.stream = stream_of(mapping, &info.topic, &info.schema_name);
        if let Some((s, m)) = topic.stream
            && let Err(error) = topic.compile(&mapping.streams[s].messages[m])
        {
            topic.refused = Some(error.to_string());
        }
        let is_description = |name: &String| info.topic.ends_with(name.as_str());
        if info.schema_name == "std_msgs/msg/String" && mapping.description_topic.as_ref().is_some_and(is_description) {
            topic.description = Some(None);
        }
        // Only the plan needs the definition from here on.
        topic.info.schema_text = Vec::new();
        topic
    }

    /// Whether its messages can be read, and there are some.
    pub fn is_usable(&self) -> bool {
        (self.plan.is_some() || self.named.is_some()) && !self.logged.is_empty()
    }

    /// Numbers of a message that go into channels: all but its time, which comes last.
    pub fn width(&self) -> usize {
        self.row.len() - if self.has_header { 2 } else { usize::from(self.has_ticks) }
    }

    fn compile(&mut self, message: &MessageMapping) -> Result<(), RecordingError> {
        let fields = &message.fields;
        let found = |expected: &str, found: &str| RecordingError::Field {
            type_name: self.info.schema_name.clone(),
            expected: expected.to_string(),
            found: format!("`{found}`"),
        };
        if self.info.message_encoding != "cdr" {
            return Err(found("message encoding `cdr`", &self.info.message_encoding));
        }
        if self.info.schema_encoding != "ros2msg" {
            return Err(found("schema encoding `ros2msg`", &self.info.schema_encoding));
        }
        let schema = Schema::parse(&self.info.schema_name, &String::from_utf8_lossy(&self.info.schema_text))?;
        if let Some(names) = &message.names {
            let paths = fields.iter().flat_map(|f| f.fields.iter().map(|w| w.path.clone())).collect();
            self.named = Some(NamedJoints::new(schema, names, paths)?);
            return Ok(());
        }
        if fields.iter().any(|f| f.channel.is_of_joints() && f.fields.iter().all(|w| w.elements.is_empty())) {
            let expected = "a robot file whose `joints` say in which order they are: the message has no names";
            return Err(RecordingError::Field {
                type_name: self.info.schema_name.clone(),
                expected: expected.into(),
                found: "none".into(),
            });
        }
        self.has_header = schema.root().fields.first().is_some_and(|f| f.name == "header");
        let mut wanted: Vec<FieldSelection> = fields.iter().flat_map(|f| f.fields.iter().cloned()).collect();
        if self.has_header {
            wanted.extend(
                ["sec", "nanosec"].map(|f| FieldSelection { path: format!("header.stamp.{f}"), elements: vec![0] }),
            );
        }
        self.has_ticks = !self.has_header && schema.root().fields.iter().any(|f| f.name == TICK);
        if self.has_ticks {
            wanted.push(FieldSelection { path: TICK.into(), elements: vec![0] });
        }
        let plan = Plan::compile(&schema, &wanted)?;
        self.row = vec![0.0; plan.width()];
        self.plan = Some(plan);
        Ok(())
    }

    fn message(&mut self, place: u32, logged: i64, data: &[u8]) {
        if let Some(named) = &mut self.named {
            match named.read(data) {
                Err(error) => {
                    self.errors += 1;
                    self.first_error.get_or_insert((logged, error.to_string()));
                }
                Ok(stamp) => {
                    self.logged.push(logged);
                    self.order.push(place);
                    self.stamps.extend(stamp.map(|(sec, nanosec)| sec as i64 * SECOND + nanosec as i64));
                }
            }
            return;
        }
        if let Some(text @ None) = &mut self.description {
            let mut cursor = Cursor::new(data).ok();
            *text =
                cursor.as_mut().and_then(|c| c.string("data").ok()).map(|s| String::from_utf8_lossy(s).into_owned());
        }
        let Some(plan) = &self.plan else {
            self.logged.push(logged);
            self.order.push(place);
            return;
        };
        if let Err(error) = plan.read(data, &mut self.row) {
            self.errors += 1;
            self.first_error.get_or_insert((logged, error.to_string()));
            return;
        }
        self.logged.push(logged);
        self.order.push(place);
        let width = self.width();
        match self.row[width..] {
            [sec, nanosec] => self.stamps.push(sec as i64 * SECOND + nanosec as i64),
            [tick] => self.sender.ticks.push(tick),
            _ => {}
        }
        self.rows.extend_from_slice(&self.row[..width]);
    }
}
