//! What kind of file a bag is, by its first bytes: MCAP, sqlite3, either of them compressed as a whole.

use crate::bounds::Bounds;
use crate::run::Loss;
use crate::stream::{MessageSink, Times, read_mcap};
use std::io::{Cursor, Read};

/// First bytes of what zstd compressed.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
const SQLITE: &[u8] = b"SQLite format 3\0";
const ROS_1: &[u8] = b"#ROSBAG V";
/// Bytes that distinguish kinds.
const HEAD: u64 = 16;

/// Reads all messages of `source` into `sink` and returns what was lost. The file is MCAP or, with the feature `sqlite`, a
/// sqlite3 database; each may be compressed by zstd as a whole, and so may each message (rosbag2's `compression_mode` FILE and
/// MESSAGE). What unpacks to a hundred times the bytes of the file, and to more than 32 MB, is lost.
pub(crate) fn read_messages(file: &str, source: impl Read, sink: &mut dyn MessageSink) -> Vec<Loss> {
    let bounds = Bounds::default();
    let mut plain = Plain { sink, bounds: bounds.clone(), damaged: None, bytes: Vec::new() };
    let mut lost = read_kind(file, Box::new(bounds.count(source)), &mut plain, &bounds, true);
    lost.extend(plain.damaged.map(|what| Loss { file: file.to_owned(), what, span: None }));
    lost
}

fn read_kind<'a>(
    file: &str,
    mut source: Box<dyn Read + 'a>,
    sink: &mut dyn MessageSink,
    bounds: &Bounds,
    may_be_compressed: bool,
) -> Vec<Loss> {
    let lose = |what: String| vec![Loss { file: file.to_owned(), what, span: None }];
    let mut head = Vec::new();
    // An error here comes again where the rest is read.
    let _ = source.by_ref().take(HEAD).read_to_end(&mut head);
    let (is_zstd, is_sqlite, is_ros_1) = (head.starts_with(&ZSTD), head.starts_with(SQLITE), head.starts_with(ROS_1));
    let whole = Cursor::new(head).chain(source);
    if is_ros_1 {
        return lose(
            "expected a bag of ROS 2, found one of ROS 1: `pip install rosbags`, then `rosbags-convert --src FILE.bag --dst \
             DIRECTORY` makes one of ROS 2"
                .into(),
        );
    }
    if is_zstd && may_be_compressed {
        return match zstd::stream::read::Decoder::new(whole) {
            Ok(decoder) => read_kind(file, Box::new(bounds.limit(decoder)), sink, bounds, false),
            Err(error) => lose(format!("expected what zstd compressed, found: {error}")),
        };
    }
    if is_sqlite {
        #[cfg(feature = "sqlite")]
        return crate::sqlite::read_database(file, whole, sink, bounds);
        #[cfg(not(feature = "sqlite"))]
        return lose("a bag in sqlite3, and this program was built without the feature `sqlite`".into());
    }
    read_mcap(file, whole, sink, bounds)
}

/// Hands messages on that were compressed one by one. A message in CDR begins with 0, so that none is taken for compressed.
struct Plain<'a> {
    sink: &'a mut dyn MessageSink,
    bounds: Bounds,
    damaged: Option<String>,
    bytes: Vec<u8>,
}

/// No single message may become more than this.
const MAX_MESSAGE: u64 = 1 << 28;

impl MessageSink for Plain<'_> {
    fn channel(&mut self, channel: &crate::stream::ChannelInfo) {
        self.sink.channel(channel);
    }

    fn message(&mut self, channel: u16, times: Times, data: &[u8]) {
        if !data.starts_with(&ZSTD) {
            return self.sink.message(channel, times, data);
        }
        self.bytes.clear();
        let read = zstd::stream::read::Decoder::new(data)
            .and_then(|decoder| self.bounds.limit(decoder.take(MAX_MESSAGE)).read_to_end(&mut self.bytes));
        match read {
            Ok(_) => self.sink.message(channel, times, &self.bytes),
            Err(error) => {
                self.damaged.get_or_insert(format!(
                    "a message at {} ns is no whole zstd frame that can be read: {error}",
                    times.logged
                ));
            }
        }
    }
}

/// When the first message of a bag was logged \[ns\]; `None` where there is none. Reads no further than that needs.
pub fn first_log_time(source: impl Read) -> Option<u64> {
    struct First(Option<u64>);
    impl MessageSink for First {
        fn channel(&mut self, _: &crate::stream::ChannelInfo) {}
        fn message(&mut self, _: u16, times: Times, _: &[u8]) {
            self.0 = Some(self.0.map_or(times.logged, |t| t.min(times.logged)));
        }
    }
    let mut first = First(None);
    // A bag's first chunk is a megabyte or so; a database is only whole as a whole.
    let mut head = Vec::new();
    let mut source = source;
    let _ = source.by_ref().take(FIRST).read_to_end(&mut head);
    let is_database = head.starts_with(SQLITE) || head.starts_with(&ZSTD);
    if is_database {
        let _ = read_messages("", Cursor::new(head).chain(source), &mut first);
    } else {
        let _ = read_messages("", head.as_slice(), &mut first);
    }
    first.0
}

/// Bytes of an MCAP file that hold its first messages.
const FIRST: u64 = 1 << 24;
