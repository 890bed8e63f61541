//! Someone's policy rolled out on a robot in the simulator: a [`Description`] says what it sees and what its actions
//! mean, [`roll`] runs it.
//!
//! Three policies of others, which `descriptions/` of qv-go2 describes, walk here as in MuJoCo. Each starts 1 mm above the ground and
//! walks for 4 s; the base paths are then apart by the millimetres of this table (`fixtures/mujoco/roll.py --compare`, largest
//! distance in the plane). In brackets: how far MuJoCo's own path moves for a start 1 um higher.
//!
//! | command (m/s, m/s, rad/s) | `rl_sar_go2` | `dls_go2` | `playground_go1` |
//! |---|---:|---:|---:|
//! | 0.5, 0, 0 | 6.8 (10.6) | 0.00 (0.00) | 1.6 (19.5) |
//! | 0.3, 0, 0 | 12.2 (22.4) | 0.00 (0.00) | 26.0 (25.2) |
//! | 0.5, 0, 0.5 | 0.01 (7.5) | 0.00 (0.00) | 0.05 (13.6) |
//! | 0.8, 0.2, -0.3 | 1.9 (21.6) | 0.00 (7.9) | 5.3 (33.1) |
//! | 0, 0, 0 | 4.5 (0.00) | 0.00 (0.00) | 0.00 (0.00) |

mod description;
mod error;
mod observe;
mod run;

pub use description::{
    ClockForm, Description, History, HistoryLayout, HistoryOrder, HistoryStart, Numbers, Observation, Simulation, Term,
    TermKind,
};
pub use error::RollError;
pub use observe::{Observer, RobotState};
pub use run::{RollTrace, roll};
