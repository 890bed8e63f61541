//! `cone_node out/nav/policy.onnx red` drives a robot with ROS 2 to a coloured cone. It was not run on a robot: keep the remote control at hand.

use clap::Parser;
use cone_node::driver::Driver;
use cone_node::node::{ConeNode, Topics};
use qv_nav::navigator::Navigator;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Drives a robot with ROS 2 to a coloured cone.
///
/// In: /camera/color/image_raw (640 x 480, looking down by 17 degrees) and /odom. Out: /cmd_vel, five times a second. A picture or odometry
/// older than 0.4 s, or an error, makes the robot stand still; so does the end of the program.
#[derive(Parser)]
struct Arguments {
    /// policy.onnx of `qv navigate train`
    policy: PathBuf,
    /// red, blue or yellow
    colour: String,
    /// Domain of DDS
    #[arg(long, env = "ROS_DOMAIN_ID", default_value_t = 0)]
    domain: u16,
    /// Take pictures and odometry from who sends with best effort
    #[arg(long)]
    best_effort: bool,
}

fn drive(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let bytes = std::fs::read(&arguments.policy).map_err(|error| format!("{}: {error}", arguments.policy.display()))?;
    let driver = Driver::new(Navigator::new(&bytes, &arguments.colour)?);
    let is_over = Arc::new(AtomicBool::new(false));
    let to_end = Arc::clone(&is_over);
    ctrlc::set_handler(move || to_end.store(true, Ordering::Relaxed))?;
    let mut topics = Topics::new("cone_node", arguments.domain, arguments.best_effort)?;
    // Reports others of the node; it ends with it.
    let spinner = topics.node.spinner()?;
    std::thread::spawn(|| futures::executor::block_on(spinner.spin()));
    ConeNode::new(topics, driver)?.run(&is_over, &mut |said| eprintln!("{said}"));
    Ok(())
}

fn main() -> ExitCode {
    match drive(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
