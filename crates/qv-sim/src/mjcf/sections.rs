//! What an MJCF says beside its bodies and actuators.

use super::attributes::Attributes;
use super::bodies::Reader;
use super::joints::fixed;
use super::tree::Tree;
use crate::urdf::LinkElement;
use crate::{BaseKind, Model, SimError};

/// Name of the frame that the simulator takes for the IMU's.
const IMU: &str = "imu";

/// Makes links without mass of the sites, so that they are frames; that of the IMU is one more under [`IMU`].
pub(super) fn sites(tree: &Tree, reader: &mut Reader) {
    let imu = imu_site(tree, reader);
    for (link, name, pose) in std::mem::take(&mut reader.sites) {
        let is_imu = imu.as_ref() == Some(&name);
        // Sites and bodies may share names, frames may not.
        let mut add = |name: &str| {
            if reader.robot.links.iter().any(|l| l.name == name) {
                return;
            }
            let line = reader.robot.links[link].line;
            let own = LinkElement {
                name: name.to_owned(),
                line,
                inertial: None,
                collisions: Vec::new(),
                is_between_joints: false,
            };
            reader.robot.links.push(own);
            let parent = reader.robot.links[link].name.clone();
            let mut joint = fixed(&format!("{name}_site"), line, pose);
            (joint.parent, joint.child) = (parent, name.to_owned());
            reader.robot.joints.push(joint);
        };
        add(&name);
        if is_imu {
            add(IMU);
        }
    }
}

/// The site of the gyroscope or accelerometer, else the one whose name says so.
fn imu_site(tree: &Tree, reader: &mut Reader) -> Option<String> {
    let mut found: Vec<String> = Vec::new();
    for sensor in tree.section("sensor") {
        let is_imu = ["gyro", "accelerometer"].contains(&tree.element(sensor).tag.as_str());
        if let Some(site) = tree.attribute(sensor, "site").filter(|_| is_imu)
            && !found.iter().any(|known| known == site)
        {
            found.push(site.to_owned());
        }
    }
    if found.is_empty() {
        let named = reader.sites.iter().map(|(_, name, _)| name);
        found = named.filter(|name| name.to_lowercase().contains(IMU)).cloned().collect();
    }
    // Of several that of this name, else the first, is the trunk's.
    let chosen = found.iter().find(|name| *name == IMU).or(found.first()).cloned();
    if let (Some(chosen), true) = (&chosen, found.len() > 1) {
        let others: Vec<String> = found.iter().filter(|f| *f != chosen).map(|f| format!("`{f}`")).collect();
        reader.robot.remarks.push(format!("the IMU is that at site `{chosen}`, not at {}", others.join(", ")));
    }
    chosen
}

/// Names the sections without a counterpart here.
pub(super) fn left_out(tree: &Tree, reader: &mut Reader) {
    for section in ["equality", "tendon", "deformable", "extension"] {
        for element in tree.section(section) {
            let place = tree.place(element);
            reader.left_out.push(format!("{} of <{section}> {place}", tree.label(element)));
        }
    }
    let pairs: Vec<usize> = tree.section("contact");
    if let Some(&first) = pairs.first() {
        let count = pairs.len();
        reader.left_out.push(format!("<contact>, {count} pairs and exclusions {}", tree.place(first)));
    }
}

/// Reports the settings of `<option>`, which are the caller's here. Returns the time step \[s\].
pub(super) fn option(tree: &Tree, reader: &mut Reader) -> Result<Option<f64>, SimError> {
    let mut timestep = None;
    for section in tree.sections("option") {
        let own = Attributes::plain(tree, section);
        timestep = own.number("timestep")?.or(timestep);
        let gravity = own.vector::<3>("gravity")?.is_some_and(|g| g != [0.0, 0.0, -9.81]);
        let settings = tree.element(section).attributes.iter().filter(|(name, _)| name != "gravity" || gravity);
        let settings: Vec<String> = settings.map(|(name, value)| format!("{name} {value}")).collect();
        if !settings.is_empty() {
            let place = tree.place(section);
            reader.robot.remarks.push(format!("<option> {} {place} is the caller's to set", settings.join(", ")));
        }
    }
    Ok(timestep)
}

/// The stance of a keyframe, in the order of the model's joints.
pub(super) fn stand(tree: &Tree, reader: &Reader, model: &Model) -> Result<Option<Stand>, SimError> {
    let keys: Vec<usize> = tree.section("keyframe").into_iter().filter(|&k| tree.element(k).tag == "key").collect();
    let named = keys.iter().find(|&&k| tree.attribute(k, "name") == Some("home"));
    let with_positions = |k: &&usize| tree.attribute(**k, "qpos").is_some();
    let Some(&key) = named.filter(with_positions).or(keys.iter().find(with_positions)) else { return Ok(None) };
    let own = Attributes::plain(tree, key);
    let count = reader.positions;
    let positions = own.numbers("qpos", count, count)?.unwrap_or_default();
    let base = match (model.base, reader.base_place) {
        (BaseKind::Floating, Some(at)) => Some(std::array::from_fn(|i| positions[at + i])),
        _ => None,
    };
    let of = |name: &String| {
        let element = reader.joints.iter().find(|(_, n, _)| n == name).map(|(element, _, _)| element);
        element.and_then(|e| reader.places.get(e)).map_or(0.0, |&at| positions[at])
    };
    Ok(Some(Stand { base, joints: model.joint_names().iter().map(of).collect() }))
}

/// A stance.
#[derive(Debug, Clone, PartialEq)]
pub struct Stand {
    /// Pose of a free base: x, y, z \[m\], w, x, y, z.
    pub base: Option<[f64; 7]>,
    /// Position of each joint of the model \[rad or m\].
    pub joints: Vec<f64>,
}
