//! What is listened to, and what comes.

use crate::LiveError;
use qv_recording::definitions;
use qv_recording::mapping::Mapping;

/// A topic with its type, by the names of ROS 2.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subscription {
    /// Such as `/lowstate`.
    pub topic: String,
    /// Such as `unitree_go/msg/LowState`.
    pub message_type: String,
    /// Its definition, those of the types inside included, in the text form of ROS 2 (`ros2msg`).
    pub definition: String,
}

impl Subscription {
    /// The topic in DDS, such as `rt/lowstate`.
    pub fn dds_topic(&self) -> String {
        format!("rt/{}", self.topic.trim_start_matches('/'))
    }

    /// The type in DDS, such as `unitree_go::msg::dds_::LowState_`.
    pub fn dds_type(&self) -> String {
        let mut parts: Vec<&str> = self.message_type.split('/').collect();
        let last = parts.pop().unwrap_or_default();
        parts.push("dds_");
        format!("{}::{last}_", parts.join("::"))
    }
}

/// The topics of a robot file, and `more`. A type of several that a topic may have is the first one; topics whose type has no definition are
/// left out.
///
/// # Errors
/// None of them has a definition.
pub fn subscriptions(mapping: &Mapping, more: &[Subscription]) -> Result<Vec<Subscription>, LiveError> {
    let own = |name: &str| mapping.definitions.iter().find(|d| d.0 == name).map(|d| d.1.clone());
    let of_stream = |topic: &String, name: &String| {
        let definition = own(name).or_else(|| definitions::standard(name))?;
        Some(Subscription { topic: topic.clone(), message_type: name.clone(), definition })
    };
    let streams = mapping.streams.iter().filter_map(|s| of_stream(&s.preferred_topic, &s.messages.first()?.name));
    let all: Vec<Subscription> = streams.chain(more.iter().cloned()).collect();
    if all.is_empty() {
        let (what, reason) = (mapping.robot.clone(), "no topic of this robot has a definition".to_string());
        return Err(LiveError::Dds { what, reason });
    }
    Ok(all)
}

/// One message as it came.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sample {
    /// Which subscription.
    pub subscription: usize,
    /// When it came \[ns since the epoch\].
    pub received: u64,
    /// When its writer says that it was sent \[ns since the epoch\].
    pub sent: Option<u64>,
    /// Who sent it: a number for each writer.
    pub writer: u64,
    /// Number that its writer gave it: one more than the last one's.
    pub sequence: i64,
    /// CDR with its four bytes of encapsulation, as a bag holds it.
    pub data: Vec<u8>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_that_ros_2_gives_in_dds() {
        let mapping = qv_recording::robots::built_in("go2").unwrap().mapping;
        let all = subscriptions(&mapping, &[]).unwrap();
        let names: Vec<(String, String)> = all.iter().map(|s| (s.dds_topic(), s.dds_type())).collect();
        assert!(names.contains(&("rt/lowstate".into(), "unitree_go::msg::dds_::LowState_".into())), "{names:?}");
        assert!(names.contains(&("rt/lowcmd".into(), "unitree_go::msg::dds_::LowCmd_".into())), "{names:?}");
    }
}
