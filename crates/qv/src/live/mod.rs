//! `qv record` and `qv watch`: a robot that runs now. Without the feature `live` both say how to have it.

#[cfg(feature = "live")]
mod listen;
#[cfg(feature = "live")]
mod page;
mod record;
#[cfg(feature = "live")]
mod serve;
mod watch;

pub use record::{EXAMPLE as RECORD_EXAMPLE, Record};
pub use watch::{EXAMPLE as WATCH_EXAMPLE, Watch};

/// Where a robot is listened to, the same for both.
#[derive(clap::Args)]
#[cfg_attr(not(feature = "live"), allow(dead_code))]
struct Listening {
    /// Listen on this network interface: its name or its IPv4 address
    #[arg(long, value_name = "IFACE", help_heading = "Input")]
    live: String,
    /// Set the robot: go2, g1, ... or a TOML file that names topics
    #[arg(long, default_value = "go2", value_name = "ROBOT", help_heading = "Input")]
    robot: String,
    /// Set the DDS domain
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=232), help_heading = "Input")]
    domain: u16,
    /// End after this time [default: at Ctrl-C]
    #[arg(long, value_name = "SECONDS", value_parser = seconds, help_heading = "Input")]
    seconds: Option<f64>,
}

fn seconds(text: &str) -> Result<f64, String> {
    let time: f64 = text.parse().map_err(|_| format!("expected seconds, found {text}"))?;
    if time > 0.0 && time.is_finite() { Ok(time) } else { Err(format!("expected seconds above 0, found {text}")) }
}

/// Why a `qv` without the feature cannot.
#[cfg(not(feature = "live"))]
fn not_built() -> crate::Failure {
    "cannot listen to a robot: this qv was built without DDS; build it with `cargo install --path crates/qv --features live`".into()
}
