//! ROS 2 bags in sqlite3 (`.db3`), as rosbag2 writes them: tables `topics`, `messages` and, from Iron on, `message_definitions`.
//!
//! Source: rosbag2_storage_sqlite3, schema versions 1 to 4. The database is held in memory: it came as a reader, and pages
//! of sqlite3 lie anywhere in a file.

use crate::bounds::Bounds;
use crate::run::Loss;
use crate::stream::{ChannelInfo, MessageSink, Times};
use rusqlite::limits::Limit;
use rusqlite::{Connection, Error, Row};
use std::collections::BTreeMap;
use std::io::Read;

/// No database may be larger: one that is compressed could claim anything.
const MAX_DATABASE: u64 = 1 << 34;
/// Places of the versions that a database needs to be written and read with. 2 is a log beside the file, which one in memory cannot
/// have.
const VERSIONS: std::ops::Range<usize> = 18..20;
/// Steps of the interpreter of queries that any database may take, and for each of its bytes; a message takes some 20 in all, and 8 bytes or more.
const SLACK_STEPS: u64 = 1_000_000;
const STEPS_OF_BYTE: u64 = 20;
const STEPS_BETWEEN: i32 = 1000;

/// Reads all messages in the order of their log times into `sink` and returns what was lost.
pub(crate) fn read_database(file: &str, source: impl Read, sink: &mut dyn MessageSink, bounds: &Bounds) -> Vec<Loss> {
    let mut reader = Reader { file, sink, bounds, lost: Vec::new(), last: None };
    if let Err(reason) = reader.read(source) {
        let span = reader.last.map(|t| [t, u64::MAX]);
        reader.lose(format!("sqlite3: {reason}: everything later is missing"), span);
    }
    reader.lost
}

struct Reader<'a> {
    file: &'a str,
    sink: &'a mut dyn MessageSink,
    bounds: &'a Bounds,
    lost: Vec<Loss>,
    last: Option<u64>,
}

impl Reader<'_> {
    fn lose(&mut self, what: String, span: Option<[u64; 2]>) {
        self.lost.push(Loss { file: self.file.to_owned(), what, span });
    }

    fn read(&mut self, source: impl Read) -> Result<(), String> {
        let (database, size) = open(source)?;
        for (table, column) in [("messages", "data"), ("topics", "name"), ("topics", "type")] {
            check_bytes(&database, table, column, size)?;
        }
        let channels = self.topics(&database).map_err(|e| e.to_string())?;
        self.messages(&database, &channels).map_err(|e| e.to_string())
    }

    /// Announces the topics; their numbers in the database become those of channels.
    fn topics(&mut self, database: &Connection) -> Result<BTreeMap<i64, u16>, Error> {
        let definitions = definitions(database);
        let mut undefined = 0;
        let mut select = database.prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id")?;
        let one = |row: &Row| Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?, row.get(2)?, row.get(3)?));
        let rows: Vec<(i64, String, String, String)> = select.query_map([], one)?.collect::<Result<_, _>>()?;
        let mut channels = BTreeMap::new();
        for (id, topic, schema_name, message_encoding) in rows {
            let Ok(channel) = u16::try_from(channels.len()) else {
                self.lose(format!("topic {topic}: expected 65536 topics at most"), None);
                break;
            };
            let definition = definitions.get(&schema_name);
            if !self.bounds.define(definition.map_or(0, |(_, text)| text.len())) {
                undefined += 1;
                continue;
            }
            let (schema_encoding, text) = definition.cloned().unwrap_or_default();
            let schema_text = text.into_bytes();
            let info = ChannelInfo { id: channel, topic, message_encoding, schema_name, schema_encoding, schema_text };
            self.sink.channel(&info);
            channels.insert(id, channel);
        }
        if undefined > 0 {
            self.lose(format!("{undefined} topics: the definitions of all types have too many bytes"), None);
        }
        Ok(channels)
    }

    fn messages(&mut self, database: &Connection, channels: &BTreeMap<i64, u16>) -> Result<(), Error> {
        let mut select = database.prepare("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id")?;
        let mut rows = select.query([])?;
        let mut foreign = 0;
        while let Some(row) = rows.next()? {
            let (topic, time): (i64, i64) = (row.get(0)?, row.get(1)?);
            let data = row.get_ref(2)?;
            match (channels.get(&topic), data.as_blob()) {
                (Some(&channel), Ok(data)) => {
                    let time = u64::try_from(time).unwrap_or(0);
                    self.sink.message(channel, Times { logged: time, sent: time }, data);
                    self.last = Some(time);
                }
                _ => foreign += 1,
            }
        }
        if foreign > 0 {
            self.lose(format!("{foreign} messages of topics that are not listed, or that are no bytes"), None);
        }
        Ok(())
    }
}

/// The database, and how many bytes it has.
fn open(source: impl Read) -> Result<(Connection, usize), String> {
    let mut bytes = Vec::new();
    source.take(MAX_DATABASE).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    if let Some(versions) = bytes.get_mut(VERSIONS) {
        versions.iter_mut().filter(|v| **v == 2).for_each(|v| *v = 1);
    }
    let mut database = Connection::open_in_memory().map_err(|e| e.to_string())?;
    limit(&database, bytes.len()).map_err(|e| e.to_string())?;
    database.deserialize_read_exact("main", bytes.as_slice(), bytes.len(), true).map_err(|e| e.to_string())?;
    only_tables(&database)?;
    Ok((database, bytes.len()))
}

/// No value is longer than the database, and no more is computed than its rows need: pages that are used twice could hold rows without end.
fn limit(database: &Connection, size: usize) -> Result<(), Error> {
    database.set_limit(Limit::SQLITE_LIMIT_LENGTH, i32::try_from(size).unwrap_or(i32::MAX))?;
    let most = SLACK_STEPS + size as u64 * STEPS_OF_BYTE;
    let mut done = 0;
    let is_too_much = move || {
        done += STEPS_BETWEEN as u64;
        done > most
    };
    database.progress_handler(STEPS_BETWEEN, Some(is_too_much))
}

/// Refuses what rosbag2 never makes, and what could compute without end under the name of a table: views, virtual tables, columns that are
/// computed.
fn only_tables(database: &Connection) -> Result<(), String> {
    let first = |query: &str| match database.query_row(query, [], |row| row.get::<_, String>(0)) {
        Ok(name) => Ok(Some(name)),
        Err(Error::QueryReturnedNoRows) => Ok(None),
        Err(e) => Err(e.to_string()),
    };
    let other = "SELECT type || ' `' || name || '`' FROM sqlite_schema WHERE type NOT IN ('table', 'index', 'trigger')
        OR (type = 'table' AND coalesce(rootpage, 0) = 0)";
    if let Some(found) = first(other)? {
        return Err(format!("expected tables, found the {found}"));
    }
    let computed =
        "SELECT c.name FROM sqlite_schema s, pragma_table_xinfo(s.name) c WHERE s.type = 'table' AND c.hidden > 0";
    match first(computed)? {
        Some(name) => Err(format!("expected columns that are stored, found `{name}`, which is computed")),
        None => Ok(()),
    }
}

/// A value that all rows share by default, or pages that are used twice, could make a small database hold more bytes than it has.
fn check_bytes(database: &Connection, table: &str, column: &str, size: usize) -> Result<(), String> {
    let query = format!("SELECT coalesce(sum(octet_length({column})), 0) FROM {table}");
    let found: i64 = database.query_row(&query, [], |row| row.get(0)).map_err(|e| e.to_string())?;
    if usize::try_from(found).is_ok_and(|found| found <= size) {
        return Ok(());
    }
    Err(format!("expected at most {size} bytes in `{table}.{column}`, found {found}"))
}

/// Encoding and text of the definition of each type; none in bags before Iron.
fn definitions(database: &Connection) -> BTreeMap<String, (String, String)> {
    let read = || {
        let text = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions";
        let mut select = database.prepare(text)?;
        let one = |row: &Row| Ok((row.get(0)?, (row.get(1)?, row.get(2)?)));
        select.query_map([], one)?.collect::<Result<BTreeMap<String, (String, String)>, Error>>()
    };
    let mut all = read().unwrap_or_default();
    // What says `unknown` says nothing.
    all.retain(|_, (encoding, text)| encoding.starts_with("ros2") && !text.is_empty());
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_is_no_table() {
        let database = Connection::open_in_memory().unwrap();
        assert_eq!(only_tables(&database), Ok(()));
        let endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i, 1, i, x'00' FROM n";
        database.execute_batch(&format!("CREATE VIEW messages(id, topic_id, timestamp, data) AS {endless}")).unwrap();
        assert_eq!(only_tables(&database), Err("expected tables, found the view `messages`".into()));
    }

    /// What is lost of a database, and how many bytes of messages came.
    fn read(schema: &str, rows: &str) -> (Vec<Loss>, usize) {
        struct Sum(usize);
        impl MessageSink for Sum {
            fn channel(&mut self, _: &ChannelInfo) {}
            fn message(&mut self, _: u16, _: Times, data: &[u8]) {
                self.0 += data.len();
            }
        }
        let database = Connection::open_in_memory().unwrap();
        let topics = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
            INSERT INTO topics VALUES (1, '/a', 'b/msg/C', 'cdr');";
        database.execute_batch(&format!("{topics} {schema}; {rows}")).unwrap();
        let bytes = database.serialize("main").unwrap().to_vec();
        let mut sum = Sum(0);
        let lost = read_database("", bytes.as_slice(), &mut sum, &Bounds::default());
        (lost, sum.0)
    }

    #[test]
    fn what_a_database_computes_is_refused() {
        let plain = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)";
        let (lost, bytes) = read(plain, "INSERT INTO messages VALUES (1, 1, 5, x'0102'), (2, 1, 6, x'03')");
        assert!(lost.is_empty() && bytes == 3, "{lost:?}");
        let start = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER";
        let some = "INSERT INTO messages(topic_id, timestamp) VALUES (1, 5), (1, 6)";
        for kind in ["VIRTUAL", "STORED"] {
            let (lost, bytes) = read(&format!("{start}, data BLOB AS (zeroblob(1000)) {kind})"), some);
            assert!(lost.len() == 1 && bytes == 0, "{kind}: {lost:?}");
        }
        // A default is stored once, and read for each row that is older than its column.
        let many = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 100)
            INSERT INTO messages(topic_id, timestamp) SELECT 1, i FROM n;";
        let late = format!("{many} ALTER TABLE messages ADD COLUMN data BLOB DEFAULT x'{}'", "00".repeat(4000));
        let (lost, bytes) = read(&format!("{start})"), &late);
        assert!(lost.len() == 1 && bytes == 0, "{lost:?}");
    }
}
