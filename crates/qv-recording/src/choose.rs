//! Which topics of a bag are the streams of a mapping, and which robot they are of.

use crate::RecordingError;
use crate::mapping::{Mapping, StreamMapping, namespace_of, state_stream};
use crate::run::{Fault, FaultKind, Loss};
use crate::topic::{Collector, Topic};

/// The topics that were chosen.
pub(crate) struct TopicChoice {
    /// Of each stream of the mapping.
    pub topics: Vec<Option<usize>>,
    /// First part of the names of the robot's topics; empty where they have none of their own.
    pub namespace: String,
    /// What is read of several.
    pub remarks: Vec<String>,
}

/// The mapping whose joint states the bag has.
///
/// # Errors
/// Joint states of several certain robots, which are named with their topics.
pub(crate) fn choose_robot(
    collectors: &[Collector],
    namespace: Option<&str>,
    lost: &[Loss],
) -> Result<usize, RecordingError> {
    if collectors.len() == 1 {
        return Ok(0);
    }
    let mut found = Vec::new();
    let mut nearly = None;
    for (index, collector) in collectors.iter().enumerate() {
        let states = state_stream(collector.mapping)?;
        let stream = &collector.mapping.streams[states];
        let own = collector.topics.iter().filter(|t| t.stream.is_some_and(|(s, _)| s == states));
        let own = own.filter(|t| namespace.is_none_or(|ns| namespace_of(stream, &t.info.topic) == Some(ns)));
        let own: Vec<&Topic> = own.collect();
        if !own.is_empty() {
            nearly = nearly.or(Some(index));
        }
        if let Some(topic) = own.iter().find(|t| t.is_usable()) {
            found.push((index, collector.mapping, &topic.info.topic));
        }
    }
    let certain: Vec<_> = found.iter().filter(|(_, mapping, _)| !mapping.generic).collect();
    match (&certain[..], found.first(), nearly) {
        ([(index, _, _)], _, _) => Ok(*index),
        ([], Some((index, _, _)), _) => Ok(*index),
        ([], None, Some(index)) => Ok(index),
        ([], None, None) => Err(none_of(collectors, namespace, lost)),
        (several, _, _) => {
            let one = |(_, mapping, topic): &&(usize, &Mapping, &String)| format!("{} on {topic}", mapping.robot);
            let names: Vec<String> = several.iter().map(one).collect();
            let found = format!("{} (`--robot NAME` says which is read)", names.join(" and "));
            Err(RecordingError::run("robot", "one in the recording", found))
        }
    }
}

fn none_of(collectors: &[Collector], namespace: Option<&str>, lost: &[Loss]) -> RecordingError {
    let streams = collectors.iter().filter_map(|c| Some(&c.mapping.streams[state_stream(c.mapping).ok()?]));
    let streams: Vec<&StreamMapping> = streams.collect();
    let types: Vec<&str> = streams.iter().flat_map(|s| &s.messages).map(|m| m.name.as_str()).collect();
    let below = namespace.unwrap_or_default();
    let mut topics: Vec<String> = streams.iter().map(|s| format!("{below}{}", s.preferred_topic)).collect();
    topics.dedup();
    let role = streams.first().map_or("joint states", |s| s.role.as_str());
    let expected = format!("messages of type {} (as on {})", types.join(" or "), topics.join(" or "));
    let found = collectors.first().map_or_else(String::new, |c| list_topics(&c.topics, lost));
    let topics = collectors.iter().flat_map(|c| &c.topics).map(|t| t.info.schema_name.as_str());
    match robots_with(&topics.collect::<Vec<_>>()) {
        others if others.is_empty() => RecordingError::run(role, expected, found),
        others => {
            RecordingError::run(role, expected, format!("{found} (`--robot {}` reads these)", others.join(" or ")))
        }
    }
}

/// Built-in robots whose joint states come in messages of one of these types.
fn robots_with(types: &[&str]) -> Vec<&'static str> {
    let reads = |name: &&str| {
        let mapping = crate::robots::built_in(name).map(|robot| robot.mapping);
        let states = mapping.and_then(|m| Some(m.streams[state_stream(&m).ok()?].messages.clone()));
        states.is_some_and(|messages| messages.iter().any(|m| types.contains(&m.name.as_str())))
    };
    crate::robots::names().filter(reads).collect()
}

/// The topic of each stream of the mapping, all of one robot.
///
/// # Errors
/// No joint states, or those of several robots.
pub(crate) fn choose_streams(
    collector: &Collector,
    namespace: Option<&str>,
    lost: &[Loss],
    faults: &mut Vec<Fault>,
) -> Result<TopicChoice, RecordingError> {
    let mapping = collector.mapping;
    let states = state_stream(mapping)?;
    let (state, namespace, others, remarks) = choose_states(collector, states, namespace)?;
    let mut topics = Vec::new();
    for (s, stream) in mapping.streams.iter().enumerate() {
        let fits = |t: &&Topic| t.stream.is_some_and(|(of, _)| of == s);
        let is_anothers = |t: &Topic| others.iter().any(|other| is_below(&t.info.topic, other));
        let candidates = collector.topics.iter().enumerate().filter(|(_, t)| fits(t) && t.is_usable());
        let best = if s == states {
            state
        } else {
            let own = format!("{namespace}{}", stream.preferred_topic);
            let rank = |t: &Topic| {
                let topic = &t.info.topic;
                let has_ending = namespace_of(stream, topic).is_some();
                (*topic == own, is_below(topic, &namespace), has_ending, t.logged.len())
            };
            candidates.filter(|(_, t)| !is_anothers(t)).max_by_key(|(_, t)| rank(t)).map(|(index, _)| index)
        };
        if best.is_none() {
            let topic = collector.topics.iter().find(fits);
            let reason = topic.and_then(|t| t.refused.clone().or(t.first_error.as_ref().map(|e| e.1.clone())));
            let types: Vec<&str> = stream.messages.iter().map(|m| m.name.as_str()).collect();
            let expected = format!("messages of type {} (as on {})", types.join(" or "), stream.preferred_topic);
            let found = reason.clone().unwrap_or_else(|| list_topics(&collector.topics, lost));
            if s == states {
                let found = match topic.filter(|_| reason.is_some()) {
                    Some(t) => format!("{} {}: {found}", t.info.topic, t.info.schema_name),
                    None => found,
                };
                return Err(RecordingError::run(stream.role.as_str(), expected, found));
            }
            let kind = if reason.is_some() { FaultKind::WrongRobot } else { FaultKind::Missing };
            let detail = format!("expected {expected}, found {found}");
            if !stream.optional || reason.is_some() {
                faults.push(Fault { kind, channel: stream.role.clone(), time: 0.0, count: 1, detail });
            }
        }
        topics.push(best);
    }
    Ok(TopicChoice { topics, namespace, remarks })
}

/// Whether a topic's name begins with a namespace.
fn is_below(topic: &str, namespace: &str) -> bool {
    topic.strip_prefix(namespace).is_some_and(|rest| rest.starts_with('/'))
}

type States = (Option<usize>, String, Vec<String>, Vec<String>);

/// The topic of the joint states, its namespace, those of other robots, and what is reported for them.
fn choose_states(collector: &Collector, states: usize, wanted: Option<&str>) -> Result<States, RecordingError> {
    let stream = &collector.mapping.streams[states];
    let all = collector.topics.iter().enumerate().filter(|(_, t)| t.stream.is_some_and(|(s, _)| s == states));
    let all: Vec<(usize, &Topic)> = all.filter(|(_, t)| t.is_usable()).collect();
    let is_copy = |t: &Topic| stream.copies.iter().any(|copy| t.info.topic.ends_with(copy.as_str()));
    let namespaces = all.iter().filter(|(_, t)| !is_copy(t)).filter_map(|(_, t)| t.namespace_in(stream));
    let mut namespaces: Vec<&str> = namespaces.collect();
    namespaces.sort_unstable();
    namespaces.dedup();
    let has_preferred = all.iter().any(|(_, t)| t.info.topic == stream.preferred_topic);
    let named = |list: &[&str]| {
        let one = |ns: &&str| {
            all.iter().find(|(_, t)| t.namespace_in(stream) == Some(*ns)).map(|(_, t)| t.info.topic.as_str())
        };
        list.iter().filter_map(one).collect::<Vec<_>>().join(" and ")
    };
    let own = match wanted {
        Some(wanted) => {
            if !namespaces.contains(&wanted) {
                let found = named(&namespaces);
                let found = if found.is_empty() { "none".into() } else { found };
                return Err(RecordingError::run(stream.role.as_str(), format!("a topic below `{wanted}`"), found));
            }
            Some(wanted)
        }
        None if has_preferred => Some(""),
        None if namespaces.len() > 1 => {
            let found = format!("{} (`--namespace NAME` says which is read)", named(&namespaces));
            return Err(RecordingError::run(stream.role.as_str(), "those of one robot", found));
        }
        None => namespaces.first().copied(),
    };
    let rank = |t: &Topic| (own.is_some() && t.namespace_in(stream) == own, !is_copy(t), t.logged.len());
    let best = match wanted.is_none() && has_preferred {
        true => all.iter().find(|(_, t)| t.info.topic == stream.preferred_topic),
        false => all.iter().max_by_key(|(_, t)| rank(t)),
    };
    let others: Vec<&str> = namespaces.into_iter().filter(|ns| Some(*ns) != own && !ns.is_empty()).collect();
    let remarks = match own {
        Some("") if !others.is_empty() => {
            vec![format!(
                "other robots of the recording are not read: {} (`--namespace NAME` reads one)",
                named(&others)
            )]
        }
        _ => Vec::new(),
    };
    let others = others.into_iter().map(str::to_owned).collect();
    Ok((best.map(|(index, _)| *index), own.unwrap_or_default().to_owned(), others, remarks))
}

fn list_topics(topics: &[Topic], lost: &[Loss]) -> String {
    let name = |t: &Topic| format!("{} {} ({})", t.info.topic, t.info.schema_name, t.logged.len());
    let names: Vec<String> = topics.iter().take(12).map(name).collect();
    let found = if names.is_empty() { "no topic at all".to_string() } else { format!("topics {}", names.join(", ")) };
    match lost.first() {
        Some(loss) => format!("{found}; lost: {}: {}", loss.file, loss.what),
        None => found,
    }
}

impl Topic {
    /// As [`namespace_of`] its name.
    fn namespace_in(&self, stream: &StreamMapping) -> Option<&str> {
        namespace_of(stream, &self.info.topic)
    }
}
