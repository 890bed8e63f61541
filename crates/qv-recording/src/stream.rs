//! Streaming MCAP files over any reader: whole messages come out, damaged chunks are skipped and named.
//!
//! Records are framed here, so that a damaged chunk costs only itself and no length is believed before its bytes are
//! there; compressed chunks are read by the crate `mcap`. Memory stays at two chunks, whatever the size of the file.

use crate::bounds::Bounds;
use crate::run::Loss;
use mcap::McapError;
use mcap::records::{ChunkHeader, MessageHeader, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;

/// When a message was logged, and when it was sent as far as the file says \[ns\]; both are one where it says no more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Times {
    pub logged: u64,
    pub sent: u64,
}

/// What the reader hands on.
pub(crate) trait MessageSink {
    /// A channel is announced, once.
    fn channel(&mut self, channel: &ChannelInfo);
    /// A message came.
    fn message(&mut self, channel: u16, times: Times, data: &[u8]);
}

/// A channel of a file with its schema.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ChannelInfo {
    /// Number within the file.
    pub id: u16,
    /// Topic.
    pub topic: String,
    /// `cdr` in ROS 2 bags.
    pub message_encoding: String,
    /// Message type; empty when the file has no schema for it.
    pub schema_name: String,
    /// `ros2msg` in ROS 2 bags.
    pub schema_encoding: String,
    /// The definition.
    pub schema_text: Vec<u8>,
}

/// No chunk, nor record outside of one, may claim more than this; rosbag2 writes chunks of about 1 MB.
const MAX_RECORD: u64 = 1 << 28;
/// As many bytes of messages are kept until their channel is announced, and each counts for some more.
const MAX_WAITING: usize = 1 << 26;
const WAITING_HEAD: usize = 64;
/// As many losses are named; of the others the number is.
const MOST_LOSSES: usize = 1000;
const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
const RECORD_HEAD: usize = 9;
/// A chunk record starts with times, sizes and checksum before the compression's name.
const CHUNK_HEAD: usize = 40;

/// Reads all messages of an MCAP file into `sink` and returns what was lost.
pub(crate) fn read_mcap(file: &str, source: impl Read, sink: &mut dyn MessageSink, bounds: &Bounds) -> Vec<Loss> {
    let mut state = State {
        file,
        sink,
        bounds,
        schemas: BTreeMap::new(),
        channels: BTreeSet::new(),
        lost: Vec::new(),
        last_time: 0,
        waiting: BTreeMap::new(),
        waiting_bytes: 0,
        full: false,
        undefined: 0,
        unnamed_losses: 0,
    };
    state.run(&mut Input { source, buffer: Vec::new(), start: 0, passed: 0, error: None });
    state.give_up_waiting();
    state.count_the_rest();
    state.lost
}

/// A buffered reader that can look ahead.
struct Input<R> {
    source: R,
    buffer: Vec<u8>,
    start: usize,
    passed: u64,
    error: Option<String>,
}

impl<R: Read> Input<R> {
    /// At least `n` bytes ahead, or what there is before the end.
    fn peek(&mut self, n: usize) -> &[u8] {
        if self.buffer.len() - self.start < n {
            self.buffer.drain(..self.start);
            self.start = 0;
            let missing = (n - self.buffer.len()) as u64;
            // `take` grows the buffer by what really comes, never by what is claimed.
            if let Err(error) = (&mut self.source).take(missing.max(1 << 16)).read_to_end(&mut self.buffer) {
                self.error.get_or_insert(error.to_string());
            }
        }
        &self.buffer[self.start..]
    }

    fn pass(&mut self, n: usize) {
        self.start += n;
        self.passed += n as u64;
    }
}

struct State<'a> {
    file: &'a str,
    sink: &'a mut dyn MessageSink,
    bounds: &'a Bounds,
    schemas: BTreeMap<u16, (String, String, Vec<u8>)>,
    /// Those that were announced.
    channels: BTreeSet<u16>,
    lost: Vec<Loss>,
    last_time: u64,
    /// Messages whose channel is not announced yet: its record may have been in a damaged chunk, and comes again at the
    /// end of the file.
    waiting: BTreeMap<u16, Vec<(Times, Vec<u8>)>>,
    waiting_bytes: usize,
    full: bool,
    /// Channels whose definition was one too many.
    undefined: usize,
    /// Losses after the first [`MOST_LOSSES`].
    unnamed_losses: usize,
}

impl State<'_> {
    fn lose(&mut self, what: String, span: Option<[u64; 2]>) {
        if self.lost.len() >= MOST_LOSSES {
            self.unnamed_losses += 1;
            return;
        }
        self.lost.push(Loss { file: self.file.to_string(), what, span });
    }

    fn run<R: Read>(&mut self, input: &mut Input<R>) {
        let start = input.peek(MAGIC.len());
        if start.is_empty() {
            return self.lose("the file is empty: expected an MCAP file".into(), None);
        }
        if !start.starts_with(&MAGIC) {
            let found: Vec<String> = start.iter().take(8).map(|b| format!("{b:02x}")).collect();
            return self
                .lose(format!("expected an MCAP file (89 4d 43 41 50 ..), found bytes {}", found.join(" ")), None);
        }
        input.pass(MAGIC.len());
        let finished = self.records(input);
        if let Some(error) = input.error.take() {
            self.lose(format!("reading failed after {} bytes: {error}", input.passed), self.rest());
        } else if !finished {
            self.lose(
                format!("the file is cut off after {} bytes: everything later is missing", input.passed),
                self.rest(),
            );
        }
    }

    fn rest(&self) -> Option<[u64; 2]> {
        (self.last_time > 0).then_some([self.last_time, u64::MAX])
    }

    /// Walks the records; whether the footer was reached.
    fn records<R: Read>(&mut self, input: &mut Input<R>) -> bool {
        loop {
            let head = input.peek(RECORD_HEAD);
            if head.len() < RECORD_HEAD {
                return false;
            }
            let opcode = head[0];
            let length = u64::from_le_bytes(head[1..RECORD_HEAD].try_into().expect("eight bytes"));
            if !plausible(opcode, length) {
                if !self.resynchronise(input) {
                    return true;
                }
                continue;
            }
            let total = RECORD_HEAD + length as usize;
            let available = input.peek(total).len();
            let body = &input.buffer[input.start + RECORD_HEAD..input.start + total.min(available)];
            match opcode {
                op::FOOTER => return true,
                op::CHUNK if available < total => {
                    self.chunk(body, true);
                    return false;
                }
                _ if available < total => return false,
                op::CHUNK => self.chunk(body, false),
                _ => self.record(opcode, body),
            }
            input.pass(total);
        }
    }

    /// After bytes that are no record: finds the next chunk. Returns false at the end of the file.
    fn resynchronise<R: Read>(&mut self, input: &mut Input<R>) -> bool {
        let from = input.passed;
        loop {
            let ahead = input.peek(1 << 16);
            let enough = ahead.len() >= 1 << 16;
            let last = ahead.len().saturating_sub(RECORD_HEAD + CHUNK_HEAD + 8);
            if let Some(at) = (1..last.max(1)).find(|&at| is_chunk(&ahead[at..])) {
                input.pass(at);
                let text = format!("bytes {from} to {} are no records: skipped to the next chunk", input.passed);
                self.lose(text, None);
                return true;
            }
            if !enough {
                let text = format!("bytes after {from} are no records, and no chunk follows");
                self.lose(text, self.rest());
                return false;
            }
            input.pass(last.max(1));
        }
    }

    fn chunk(&mut self, body: &[u8], cut: bool) {
        let header = match chunk_header(body) {
            Ok(header) => header,
            Err(_) if cut => return,
            Err(found) => return self.lose(format!("chunk header: {found}"), None),
        };
        let span = Some([header.message_start_time, header.message_end_time]);
        let start = CHUNK_HEAD + header.compression.len();
        let data = &body[start.min(body.len())..];
        let data = &data[..data.len().min(header.compressed_size as usize)];
        let cut = cut || (data.len() as u64) < header.compressed_size;
        if header.uncompressed_size > MAX_RECORD {
            let text =
                format!("chunk: expected at most {MAX_RECORD} bytes, found a claim of {}", header.uncompressed_size);
            return self.lose(text, span);
        }
        let result = match header.compression.as_str() {
            "" => self.plain_chunk(&header, data, cut),
            "lz4" | "zstd" => {
                self.bounds.take(header.uncompressed_size).and_then(|()| self.compressed_chunk(&header, data, cut))
            }
            other => Err(format!("compression: expected lz4, zstd or none, found `{other}`")),
        };
        if let Err(reason) = result {
            self.lose(format!("chunk skipped: {reason}"), span);
        }
    }

    fn plain_chunk(&mut self, header: &ChunkHeader, mut data: &[u8], cut: bool) -> Result<(), String> {
        let found = crc32(data);
        if !cut && header.uncompressed_crc != 0 && header.uncompressed_crc != found {
            return Err(format!("expected checksum {:08x}, found {found:08x}", header.uncompressed_crc));
        }
        while let Some((head, rest)) = data.split_at_checked(RECORD_HEAD) {
            let length = u64::from_le_bytes(head[1..].try_into().expect("eight bytes"));
            let Some((body, rest)) = usize::try_from(length).ok().and_then(|n| rest.split_at_checked(n)) else {
                let text = format!("record: expected at most {} bytes, found a claim of {length}", rest.len());
                return if cut { Ok(()) } else { Err(text) };
            };
            self.record(head[0], body);
            data = rest;
        }
        Ok(())
    }

    /// Lets the crate `mcap` decompress: a reader of its own sees this one chunk.
    fn compressed_chunk(&mut self, header: &ChunkHeader, data: &[u8], cut: bool) -> Result<(), String> {
        let options = LinearReaderOptions {
            skip_start_magic: true,
            skip_end_magic: true,
            // The checksum comes before any message, unless the end is missing.
            prevalidate_chunk_crcs: !cut,
            record_length_limit: Some(MAX_RECORD as usize),
            ..Default::default()
        };
        let mut reader = LinearReader::new_with_options(options);
        let head = chunk_head(header);
        let mut left = [head.as_slice(), data].into_iter();
        let mut now: &[u8] = left.next().expect("the head");
        while let Some(event) = reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(need)) => {
                    if now.is_empty() {
                        now = left.next().unwrap_or(&[]);
                    }
                    let n = need.min(now.len());
                    reader.insert(n)[..n].copy_from_slice(&now[..n]);
                    reader.notify_read(n);
                    now = &now[n..];
                }
                Ok(LinearReadEvent::Record { data, opcode }) => self.record(opcode, data),
                Err(_) if cut => return Ok(()),
                Err(McapError::UnexpectedEof) => return Err("its bytes end early".into()),
                Err(error) => return Err(error.to_string()),
            }
        }
        Ok(())
    }

    fn record(&mut self, opcode: u8, body: &[u8]) {
        if opcode == op::MESSAGE {
            return match message_header(body) {
                Some((header, data)) => self.message(&header, data),
                None => self.lose(format!("message record: expected 22 bytes or more, found {}", body.len()), None),
            };
        }
        if !matches!(opcode, op::SCHEMA | op::CHANNEL) {
            return;
        }
        let mut fields = Fields { bytes: body };
        let known = if opcode == op::SCHEMA { self.schema(&mut fields) } else { self.announce(&mut fields) };
        if known.is_none() {
            self.lose(format!("record {opcode:#04x} of {} bytes: its lengths do not fit", body.len()), None);
        }
    }

    fn schema(&mut self, fields: &mut Fields) -> Option<()> {
        let id = fields.u16()?;
        let (name, encoding) = (fields.string()?, fields.string()?);
        let text = fields.block()?.to_vec();
        self.schemas.entry(id).or_insert((name, encoding, text));
        Some(())
    }

    fn announce(&mut self, fields: &mut Fields) -> Option<()> {
        let (id, schema_id) = (fields.u16()?, fields.u16()?);
        let (topic, message_encoding) = (fields.string()?, fields.string()?);
        if !self.channels.insert(id) {
            return Some(());
        }
        let schema = self.schemas.get(&schema_id);
        if !self.bounds.define(schema.map_or(0, |(_, _, text)| text.len())) {
            self.undefined += 1;
            return Some(());
        }
        let (schema_name, schema_encoding, schema_text) = schema.cloned().unwrap_or_default();
        self.sink.channel(&ChannelInfo { id, topic, message_encoding, schema_name, schema_encoding, schema_text });
        for (times, data) in self.waiting.remove(&id).unwrap_or_default() {
            self.sink.message(id, times, &data);
        }
        Some(())
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) {
        self.last_time = self.last_time.max(header.log_time);
        let times = Times { logged: header.log_time, sent: header.publish_time };
        if self.channels.contains(&header.channel_id) {
            self.sink.message(header.channel_id, times, data);
        } else if self.waiting_bytes + data.len() <= MAX_WAITING {
            self.waiting_bytes += data.len() + WAITING_HEAD;
            self.waiting.entry(header.channel_id).or_default().push((times, data.to_vec()));
        } else if !self.full {
            self.full = true;
            let text = format!("more than {MAX_WAITING} bytes of messages whose channel is not announced");
            self.lose(text, Some([header.log_time, u64::MAX]));
        }
    }

    /// At the end of the file: what still waits is lost, channel by channel.
    fn give_up_waiting(&mut self) {
        for (channel, messages) in std::mem::take(&mut self.waiting) {
            let times = || messages.iter().map(|(times, _)| times.logged);
            let span = times().min().zip(times().max()).map(|(from, to)| [from, to]);
            let text = format!("{} messages of channel {channel}, which was never announced", messages.len());
            self.lose(text, span);
        }
    }

    fn count_the_rest(&mut self) {
        let file = self.file.to_string();
        let mut add = |what: String| self.lost.push(Loss { file: file.clone(), what, span: None });
        if self.undefined > 0 {
            add(format!("{} channels: the definitions of all types have too many bytes", self.undefined));
        }
        if self.unnamed_losses > 0 {
            add(format!("{} losses more", self.unnamed_losses));
        }
    }
}

/// The fields of a record, each length checked against the bytes before anything is taken.
struct Fields<'a> {
    bytes: &'a [u8],
}

impl<'a> Fields<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.bytes.split_at_checked(n)?;
        self.bytes = rest;
        Some(head)
    }

    fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.take(2)?.try_into().ok()?))
    }

    fn block(&mut self) -> Option<&'a [u8]> {
        let length = u32::from_le_bytes(self.take(4)?.try_into().ok()?);
        self.take(length as usize)
    }

    fn string(&mut self) -> Option<String> {
        Some(String::from_utf8_lossy(self.block()?).into_owned())
    }
}

/// Opcodes 1 to 15 are defined, those from 128 on are private.
fn plausible(opcode: u8, length: u64) -> bool {
    ((1..=15).contains(&opcode) || opcode >= 128) && length <= MAX_RECORD
}

/// Whether bytes look like the start of a chunk record whose sizes agree.
fn is_chunk(bytes: &[u8]) -> bool {
    if bytes[0] != op::CHUNK || bytes.len() < RECORD_HEAD + CHUNK_HEAD + 8 {
        return false;
    }
    let length = u64::from_le_bytes(bytes[1..RECORD_HEAD].try_into().expect("eight bytes"));
    match chunk_header(&bytes[RECORD_HEAD..]) {
        Ok(header) => {
            let rest = (CHUNK_HEAD + header.compression.len()) as u64;
            length <= MAX_RECORD && header.compressed_size.checked_add(rest) == Some(length)
        }
        Err(_) => false,
    }
}

fn chunk_header(body: &[u8]) -> Result<ChunkHeader, String> {
    let long = |at: usize| body.get(at..at + 8).map(|b| u64::from_le_bytes(b.try_into().expect("eight bytes")));
    let short = |at: usize| body.get(at..at + 4).map(|b| u32::from_le_bytes(b.try_into().expect("four bytes")));
    let parse = || {
        let name_length = short(28)? as usize;
        let name = body.get(32..32usize.checked_add(name_length.min(64))?)?;
        Some(ChunkHeader {
            message_start_time: long(0)?,
            message_end_time: long(8)?,
            uncompressed_size: long(16)?,
            uncompressed_crc: short(24)?,
            compression: String::from_utf8_lossy(name).into_owned(),
            compressed_size: long(32 + name_length.min(64))?,
        })
    };
    parse().ok_or_else(|| format!("expected {CHUNK_HEAD} bytes or more, found {}", body.len()))
}

/// The bytes of a chunk record up to its compressed data.
fn chunk_head(header: &ChunkHeader) -> Vec<u8> {
    let mut bytes = vec![op::CHUNK];
    let length = (CHUNK_HEAD + header.compression.len()) as u64 + header.compressed_size;
    bytes.extend_from_slice(&length.to_le_bytes());
    for time in [header.message_start_time, header.message_end_time, header.uncompressed_size] {
        bytes.extend_from_slice(&time.to_le_bytes());
    }
    bytes.extend_from_slice(&header.uncompressed_crc.to_le_bytes());
    bytes.extend_from_slice(&(header.compression.len() as u32).to_le_bytes());
    bytes.extend_from_slice(header.compression.as_bytes());
    bytes.extend_from_slice(&header.compressed_size.to_le_bytes());
    bytes
}

fn message_header(body: &[u8]) -> Option<(MessageHeader, &[u8])> {
    let (head, data) = body.split_at_checked(22)?;
    let long = |at: usize| u64::from_le_bytes(head[at..at + 8].try_into().expect("eight bytes"));
    let header = MessageHeader {
        channel_id: u16::from_le_bytes([head[0], head[1]]),
        sequence: u32::from_le_bytes(head[2..6].try_into().expect("four bytes")),
        log_time: long(6),
        publish_time: long(14),
    };
    Some((header, data))
}

/// CRC-32 (IEEE 802.3, reflected), by a table of 256.
fn crc32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0u32; 256];
        let mut n = 0;
        while n < 256 {
            let mut c = n as u32;
            let mut k = 0;
            while k < 8 {
                c = if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 };
                k += 1;
            }
            table[n] = c;
            n += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |c, &b| TABLE[((c ^ u32::from(b)) & 0xff) as usize] ^ (c >> 8))
}
