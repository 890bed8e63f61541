//! The topics: a camera's pictures and odometry in, velocities out.

use crate::driver::Driver;
use crate::messages::{Image, Odometry, Twist, Vector3};
use qv_nav::task::PERIOD;
use ros2_client::names::NameError;
use ros2_client::{
    Context, ContextOptions, CreateError, MessageTypeName, Name, Node, NodeCreateError, NodeName, NodeOptions,
    Publisher, QosProfile, Subscription,
};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Where pictures and odometry come from, and where velocities go.
pub const CAMERA: &str = "/camera/color/image_raw";
/// See [`CAMERA`].
pub const ODOMETRY: &str = "/odom";
/// See [`CAMERA`].
pub const COMMANDS: &str = "/cmd_vel";

/// From one look for messages to the next.
const LOOK: Duration = Duration::from_millis(5);

/// Time in which the last command leaves.
const LEAVE: Duration = Duration::from_millis(300);

/// Ports of a domain begin at 7400 + 250 times its number, and there are 65 535 of them.
pub const LAST_DOMAIN: u16 = 232;

/// Why there is no node.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// The name of a topic or node is none.
    #[error("name: {0:?}")]
    Name(NameError),
    /// A domain that has no ports.
    #[error("domain: expected 0 to {LAST_DOMAIN}, found {0}")]
    Domain(u16),
    /// No node could be made.
    #[error("node: {0:?}")]
    Node(NodeCreateError),
    /// The network gave no topic, publisher or subscription.
    #[error("network: {0:?}")]
    Network(CreateError),
}

impl From<NameError> for NodeError {
    fn from(error: NameError) -> Self {
        Self::Name(error)
    }
}

impl From<NodeCreateError> for NodeError {
    fn from(error: NodeCreateError) -> Self {
        Self::Node(error)
    }
}

impl From<CreateError> for NodeError {
    fn from(error: CreateError) -> Self {
        Self::Network(error)
    }
}

/// Names and types of the topics, with a node that speaks of them: for this program, and for a test at the other end.
pub struct Topics {
    /// What others see of it.
    pub node: Node,
    /// How messages are sent: each must arrive, and only the last one counts.
    pub quality: QosProfile,
}

impl Topics {
    /// A node of this name in a domain (`ROS_DOMAIN_ID`). With `is_lossy`, pictures and odometry are taken from who sends without asking whether
    /// they arrived, as many drivers of cameras do.
    ///
    /// # Errors
    /// When the domain has no ports, the name is none, or the network allows no node.
    pub fn new(name: &str, domain: u16, is_lossy: bool) -> Result<Self, NodeError> {
        if domain > LAST_DOMAIN {
            return Err(NodeError::Domain(domain));
        }
        let context = Context::with_options(ContextOptions::new().domain_id(domain))?;
        let options = NodeOptions::new().start_parameter_services(false);
        let node = context.new_node(NodeName::new("/", name)?, options)?;
        let quality = if is_lossy { QosProfile::subscription_default() } else { QosProfile::publisher_default() };
        Ok(Self { node, quality })
    }

    /// What comes in from a topic.
    ///
    /// # Errors
    /// When the network gives none.
    pub fn subscribe<M: 'static>(
        &mut self,
        topic: &str,
        (package, kind): (&str, &str),
    ) -> Result<Subscription<M>, NodeError> {
        let kind = MessageTypeName::new(package, kind);
        let topic = self.node.create_topic(&Name::parse(topic)?, kind, &self.quality)?;
        Ok(self.node.create_subscription(&topic, Some(self.quality.clone()))?)
    }

    /// What goes out to a topic; each message must arrive.
    ///
    /// # Errors
    /// When the network gives none.
    pub fn publish<M: serde::Serialize>(
        &mut self,
        topic: &str,
        (package, kind): (&str, &str),
    ) -> Result<Publisher<M>, NodeError> {
        let (kind, quality) = (MessageTypeName::new(package, kind), QosProfile::publisher_default());
        let topic = self.node.create_topic(&Name::parse(topic)?, kind, &quality)?;
        Ok(self.node.create_publisher(&topic, Some(quality))?)
    }
}

/// Types of the topics.
pub const IMAGE: (&str, &str) = ("sensor_msgs", "Image");
/// See [`IMAGE`].
pub const ODOMETRY_TYPE: (&str, &str) = ("nav_msgs", "Odometry");
/// See [`IMAGE`].
pub const TWIST: (&str, &str) = ("geometry_msgs", "Twist");

/// The node.
pub struct ConeNode {
    pictures: Subscription<Image>,
    odometry: Subscription<Odometry>,
    commands: Publisher<Twist>,
    driver: Driver,
    clock: Instant,
    /// Others must not forget the node while it runs.
    _topics: Topics,
}

impl ConeNode {
    /// Joins a driver to the topics.
    ///
    /// # Errors
    /// When the network gives no topic.
    pub fn new(mut topics: Topics, driver: Driver) -> Result<Self, NodeError> {
        Ok(Self {
            pictures: topics.subscribe(CAMERA, IMAGE)?,
            odometry: topics.subscribe(ODOMETRY, ODOMETRY_TYPE)?,
            commands: topics.publish(COMMANDS, TWIST)?,
            driver,
            clock: Instant::now(),
            _topics: topics,
        })
    }

    /// Drives until `is_over` says so, and then stands still. What goes wrong is commanded to `tell`; the robot stands still meanwhile.
    pub fn run(&mut self, is_over: &AtomicBool, tell: &mut dyn FnMut(String)) {
        let mut next = Instant::now();
        while !is_over.load(Ordering::Relaxed) {
            self.take(tell);
            if Instant::now() >= next {
                self.decide(tell);
                // Not later and later when a decision took long, and no burst after it.
                next = (next + Duration::from_secs_f64(PERIOD)).max(Instant::now());
            }
            thread::sleep(LOOK);
        }
    }

    /// Takes what came in.
    fn take(&mut self, tell: &mut dyn FnMut(String)) {
        loop {
            match self.pictures.take() {
                Ok(Some((picture, _))) => self.driver.see(picture, self.clock.elapsed().as_secs_f64()),
                Ok(None) => break,
                Err(error) => return tell(format!("{CAMERA}: {error:?}")),
            }
        }
        loop {
            match self.odometry.take() {
                Ok(Some((odometry, _))) => self.driver.moved(odometry.pose.pose, self.clock.elapsed().as_secs_f64()),
                Ok(None) => break,
                Err(error) => return tell(format!("{ODOMETRY}: {error:?}")),
            }
        }
    }

    fn decide(&mut self, tell: &mut dyn FnMut(String)) {
        let command = self.driver.decide(self.clock.elapsed().as_secs_f64()).unwrap_or_else(|error| {
            tell(error.to_string());
            [0.0; 3]
        });
        if let Err(error) = self.publish(command) {
            tell(format!("{COMMANDS}: {error}"));
        }
    }

    fn publish(&self, [x, y, turning]: [f64; 3]) -> Result<(), String> {
        let twist = Twist { linear: Vector3 { x, y, z: 0.0 }, angular: Vector3 { x: 0.0, y: 0.0, z: turning } };
        self.commands.publish(twist).map_err(|error| format!("{error:?}"))
    }
}

/// Whatever ends it, an error or a panic as well: the robot stands still.
impl Drop for ConeNode {
    fn drop(&mut self) {
        // There is no one left to show.
        let _ = self.publish([0.0; 3]);
        // The command has to leave before the network is closed.
        thread::sleep(LEAVE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_names_and_domains_are_refused() {
        let said = |name: &str, domain| Topics::new(name, domain, false).err().unwrap().to_string();
        assert_eq!(said("node", 233), "domain: expected 0 to 232, found 233");
        assert!(said("no node", 199).contains("name"), "{}", said("no node", 199));
    }
}
