//! ROS 2 bags in sqlite3 (`.db3`), as rosbag2 writes them: tables `topics`, `messages` and, from Iron on, `message_definitions`.
//!
//! Source: rosbag2_storage_sqlite3, schema versions 1 to 4. The database is held in memory: it came as a reader, and pages
//! of sqlite3 lie anywhere in a file.

use crate::run::Loss;
use crate::stream::{ChannelInfo, MessageSink};
use rusqlite::{Connection, Error, Row};
use std::collections::BTreeMap;
use std::io::Read;

/// No database may be larger: one that is compressed could claim anything.
const MAX_DATABASE: u64 = 1 << 34;
/// Places of the versions that a database needs to be written and read with. 2 is a log beside the file, which one in memory cannot
/// have.
const VERSIONS: std::ops::Range<usize> = 18..20;

/// Reads all messages in the order of their log times into `sink` and returns what was lost.
pub(crate) fn read_database(file: &str, source: impl Read, sink: &mut dyn MessageSink) -> Vec<Loss> {
    let mut reader = Reader { file, sink, lost: Vec::new(), last: None };
    if let Err(reason) = reader.read(source) {
        let span = reader.last.map(|t| [t, u64::MAX]);
        reader.lose(format!("sqlite3: {reason}: everything later is missing"), span);
    }
    reader.lost
}

struct Reader<'a> {
    file: &'a str,
    sink: &'a mut dyn MessageSink,
    lost: Vec<Loss>,
    last: Option<u64>,
}

impl Reader<'_> {
    fn lose(&mut self, what: String, span: Option<[u64; 2]>) {
        self.lost.push(Loss { file: self.file.to_owned(), what, span });
    }

    fn read(&mut self, source: impl Read) -> Result<(), String> {
        let database = open(source)?;
        let channels = self.topics(&database).map_err(|e| e.to_string())?;
        self.messages(&database, &channels).map_err(|e| e.to_string())
    }

    /// Announces the topics; their numbers in the database become those of channels.
    fn topics(&mut self, database: &Connection) -> Result<BTreeMap<i64, u16>, Error> {
        let definitions = definitions(database);
        let mut select = database.prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id")?;
        let one = |row: &Row| Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?, row.get(2)?, row.get(3)?));
        let rows: Vec<(i64, String, String, String)> = select.query_map([], one)?.collect::<Result<_, _>>()?;
        let mut channels = BTreeMap::new();
        for (id, topic, schema_name, message_encoding) in rows {
            let Ok(channel) = u16::try_from(channels.len()) else {
                self.lose(format!("topic {topic}: expected 65536 topics at most"), None);
                break;
            };
            let (schema_encoding, text) = definitions.get(&schema_name).cloned().unwrap_or_default();
            let schema_text = text.into_bytes();
            let info = ChannelInfo { id: channel, topic, message_encoding, schema_name, schema_encoding, schema_text };
            self.sink.channel(&info);
            channels.insert(id, channel);
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
                    self.sink.message(channel, time, data);
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

fn open(source: impl Read) -> Result<Connection, String> {
    let mut bytes = Vec::new();
    source.take(MAX_DATABASE).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    if let Some(versions) = bytes.get_mut(VERSIONS) {
        versions.iter_mut().filter(|v| **v == 2).for_each(|v| *v = 1);
    }
    let mut database = Connection::open_in_memory().map_err(|e| e.to_string())?;
    database.deserialize_read_exact("main", bytes.as_slice(), bytes.len(), true).map_err(|e| e.to_string())?;
    only_tables(&database)?;
    Ok(database)
}

/// A view could count to infinity under the name of a table; rosbag2 makes none.
fn only_tables(database: &Connection) -> Result<(), String> {
    let view = "SELECT name FROM sqlite_schema WHERE type = 'view'";
    match database.query_row(view, [], |row| row.get::<_, String>(0)) {
        Ok(name) => Err(format!("expected tables, found the view `{name}`")),
        Err(Error::QueryReturnedNoRows) => Ok(()),
        Err(e) => Err(e.to_string()),
    }
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
}
