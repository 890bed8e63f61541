//! An arm of two links, held at its foot, and how its motors were driven.

use qv_sim::{BaseKind, Model, ModelOptions};

pub const ARM: &str = r#"<robot name="arm">
<link name="bench"/>
<link name="upper"><inertial><origin xyz="0 0 -0.15"/><mass value="0.6"/><inertia ixx="0.004" iyy="0.004" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.12"/><mass value="0.4"/><inertia ixx="0.002" iyy="0.002" izz="0.0003" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="bench"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
</robot>"#;

/// The `run.toml` of its recordings.
pub const SETTINGS: &str =
    "robot = \"arm.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 12.0\nkd = 0.4\ntau_max = 20.0\n";

pub fn model() -> Model {
    Model::from_urdf(ARM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap()
}
