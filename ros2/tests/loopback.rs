//! Over this machine's loopback: one end publishes pictures and odometry and hears velocities, the other end is the node. The watchdog stops the
//! robot when pictures stop.

#[path = "policy/mod.rs"]
mod policy;

use cone_node::driver::{Driver, STALE};
use cone_node::messages::{Image, Odometry, Twist};
use cone_node::node::{CAMERA, COMMANDS, ConeNode, IMAGE, ODOMETRY, ODOMETRY_TYPE, TWIST, Topics};
use qv_nav::navigator::Navigator;
use ros2_client::{Publisher, Subscription};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

/// Longest wait for anything: a machine may be busy.
const PATIENCE: Duration = Duration::from_secs(90);

/// The robot's end.
struct Robot {
    pictures: Publisher<Image>,
    odometry: Publisher<Odometry>,
    commands: Subscription<Twist>,
    _topics: Topics,
}

impl Robot {
    fn new(domain: u16) -> Self {
        let mut topics = Topics::new("robot", domain, false).unwrap();
        Self {
            pictures: topics.publish(CAMERA, IMAGE).unwrap(),
            odometry: topics.publish(ODOMETRY, ODOMETRY_TYPE).unwrap(),
            commands: topics.subscribe(COMMANDS, TWIST).unwrap(),
            _topics: topics,
        }
    }

    /// Sends odometry, and pictures if asked to, ten times a second until a command is as it should be. Gives the time of that, and the time of the
    /// last picture.
    fn until(&self, what: &str, with_pictures: bool, is_it: impl Fn(&Twist) -> bool) -> Instant {
        let (began, mut sent) = (Instant::now(), None::<Instant>);
        while began.elapsed() < PATIENCE {
            if sent.is_none_or(|at| at.elapsed() > Duration::from_millis(100)) {
                sent = Some(Instant::now());
                // Before the other end is known, nobody takes them.
                let _ = self.odometry.publish(Odometry::default());
                if with_pictures {
                    let _ = self.pictures.publish(policy::picture(90));
                }
            }
            while let Some((twist, _)) = self.commands.take().unwrap() {
                if is_it(&twist) {
                    return Instant::now();
                }
            }
            sleep(Duration::from_millis(2));
        }
        panic!("{what}: expected within {} s, found nothing like it", PATIENCE.as_secs());
    }
}

#[test]
fn it_drives_while_pictures_come_and_stands_when_they_do_not() {
    // Tests of other processes have other domains, most often.
    let domain = 20 + (std::process::id() % 200) as u16;
    let is_over = Arc::new(AtomicBool::new(false));
    let to_end = Arc::clone(&is_over);
    let node = spawn(move || {
        let driver = Driver::new(Navigator::new(&policy::policy(), "red").unwrap());
        let mut node = ConeNode::new(Topics::new("cone_node", domain, false).unwrap(), driver).unwrap();
        let mut said = Vec::new();
        node.run(&to_end, &mut |words| said.push(words));
        said
    });
    let robot = Robot::new(domain);
    let stands = |twist: &Twist| *twist == Twist::default();
    robot.until("standing before a picture came", false, stands);
    robot.until("driving", true, |twist| !stands(twist));
    let driving = robot.until("driving on", true, |twist| !stands(twist));
    // Odometry goes on. The last picture was sent at most 0.1 s before the last command was heard.
    let stood = robot.until("standing after the last picture", false, stands);
    let waited = stood.duration_since(driving).as_secs_f64();
    assert!(waited > STALE - 0.35, "it stood {waited} s after it drove, with a picture not {STALE} s old");
    // On a busy machine a picture may still be on its way.
    sleep(Duration::from_secs(1));
    robot.until("standing a second later", false, stands);
    robot.until("standing on", false, |twist| {
        assert!(stands(twist), "it drove without a picture: {twist:?}");
        stands(twist)
    });
    robot.until("driving again", true, |twist| !stands(twist));
    is_over.store(true, Ordering::Relaxed);
    robot.until("standing at the end", true, stands);
    assert_eq!(node.join().unwrap(), Vec::<String>::new(), "nothing went wrong");
}
