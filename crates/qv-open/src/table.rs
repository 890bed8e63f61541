//! Tables with their descriptions become runs.

use crate::model::{read_model, read_urdf};
use qv_recording::mapping::Mapping;
use qv_recording::run::Base;
use qv_recording::{RecordingError, Run, robots};
use qv_sim::ModelOptions;
use qv_sim::mjcf::is_mjcf;
use std::io::Read;
use std::path::Path;

/// The mapping of a built-in robot whose joints are known.
pub fn mapping_of(robot: &str) -> Option<Mapping> {
    robots::built_in(robot).map(|robot| robot.mapping).filter(|m| !m.joint_names.is_empty())
}

/// Turns the channels of an IMU that the site of an MJCF says is mounted at an angle: a table alone cannot, as the site may be
/// in an included file.
fn turn_imu(run: &mut Run, text: &str, beside: &Path) {
    // What is wrong with a robot is said where it is used.
    let model = read_model(text, beside, &ModelOptions::default()).ok();
    if let Some(rotation) = model.as_ref().and_then(qv_recording::imu::mount_of).filter(|_| run.base == Base::Free) {
        let remarks = qv_recording::imu::to_trunk(run, rotation, false);
        run.remarks.extend(remarks);
    }
}

/// The run of a table with the text of its description, and where that lies.
pub fn run_of_table(csv: impl Read, toml_path: &Path, toml_text: &str) -> Result<Run, RecordingError> {
    let robot = qv_recording::robot_of(toml_text)?;
    let mapping = mapping_of(&robot);
    let (urdf, remarks) = match &mapping {
        Some(_) => (None, None),
        None => urdf_beside(toml_path, &robot).map(|(text, note)| (Some(text), note))?,
    };
    let mut run = qv_recording::read_table(csv, toml_text, urdf.as_deref(), mapping.as_ref())?;
    run.remarks.extend(remarks);
    if let Some(text) = urdf.filter(|text| is_mjcf(text))
        && !qv_recording::states_imu(toml_text)?
    {
        let path = toml_path.parent().unwrap_or(Path::new(".")).join(&robot);
        turn_imu(&mut run, &text, path.parent().unwrap_or(Path::new(".")));
    }
    Ok(run)
}

/// The text of the URDF that a description names, and a sentence where some of it is not in its encoding.
pub fn urdf_beside(toml_path: &Path, robot: &str) -> Result<(String, Option<String>), RecordingError> {
    let path = toml_path.parent().unwrap_or(Path::new(".")).join(robot);
    read_urdf(&path, "a robot known by name (go2), or a URDF or MJCF file")
}
