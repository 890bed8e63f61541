//! Angles, positions and orientations, as `<compiler>` has them written.

use super::attributes::Attributes;
use super::tree::Tree;
use crate::SimError;
use glam::{DMat3, DQuat, DVec3};
use qv_core::Pose;

/// What `<compiler>` says: <https://mujoco.readthedocs.io/en/stable/XMLreference.html#compiler>.
pub(super) struct Compiler {
    degrees: bool,
    pub autolimits: bool,
    sequence: [char; 3],
    /// Folder of the meshes, with a slash at its end unless it is empty.
    pub mesh_folder: String,
    /// `None` is "auto": where a body has no `<inertial>`.
    pub inertia_from_geoms: Option<bool>,
    pub groups: [f64; 2],
    /// Settings that change masses and are not followed, as they are written.
    pub left_out: Vec<String>,
}

impl Compiler {
    pub fn read(tree: &Tree) -> Result<Self, SimError> {
        let mut own = Self {
            degrees: true,
            autolimits: true,
            sequence: ['x', 'y', 'z'],
            mesh_folder: String::new(),
            inertia_from_geoms: None,
            groups: [0.0, 5.0],
            left_out: Vec::new(),
        };
        for section in tree.sections("compiler") {
            own.section(&Attributes::plain(tree, section))?;
        }
        Ok(own)
    }

    fn section(&mut self, compiler: &Attributes) -> Result<(), SimError> {
        match compiler.text("angle") {
            None => {}
            Some("degree") => self.degrees = true,
            Some("radian") => self.degrees = false,
            Some(other) => return Err(compiler.error("degree or radian as `angle`", format!("`{other}`"))),
        }
        self.autolimits = compiler.switch("autolimits")?.unwrap_or(self.autolimits);
        self.inertia_from_geoms = compiler.switch("inertiafromgeom")?.or(self.inertia_from_geoms);
        self.groups = compiler.vector("inertiagrouprange")?.unwrap_or(self.groups);
        if let Some(text) = compiler.text("eulerseq") {
            let letters: Vec<char> = text.chars().collect();
            self.sequence = <[char; 3]>::try_from(letters)
                .ok()
                .filter(|s| s.iter().all(|c| "xyzXYZ".contains(*c)))
                .ok_or_else(|| compiler.error("three letters of xyzXYZ as `eulerseq`", format!("`{text}`")))?;
        }
        if let Some(folder) = compiler.text("meshdir").or(compiler.text("assetdir")) {
            let folder = folder.trim_end_matches('/');
            self.mesh_folder = if folder.is_empty() { String::new() } else { format!("{folder}/") };
        }
        // Each changes masses when it is not at its default.
        let changes = [("boundmass", "0"), ("boundinertia", "0"), ("settotalmass", "-1"), ("balanceinertia", "false")];
        for (name, neutral) in changes {
            if let Some(value) = compiler.text(name).filter(|v| *v != neutral) {
                self.left_out
                    .push(format!("{name}=\"{value}\" of <compiler> {}", compiler.tree.place(compiler.element())));
            }
        }
        Ok(())
    }

    /// Radians of an angle in the file's unit.
    pub fn radians(&self, angle: f64) -> f64 {
        if self.degrees { angle.to_radians() } else { angle }
    }

    /// Position and orientation of a body, geom, site, inertial or frame.
    pub fn pose(&self, of: &Attributes) -> Result<Pose, SimError> {
        let position = DVec3::from_array(of.vector("pos")?.unwrap_or_default());
        Ok(Pose { position, rotation: self.rotation(of)? })
    }

    /// The nearest layer that states an orientation states all of it.
    fn rotation(&self, of: &Attributes) -> Result<DQuat, SimError> {
        for &layer in &of.layers {
            let own = Attributes::plain(of.tree, layer);
            if let Some(rotation) = self.own_rotation(&own)? {
                return Ok(rotation);
            }
        }
        Ok(DQuat::IDENTITY)
    }

    fn own_rotation(&self, of: &Attributes) -> Result<Option<DQuat>, SimError> {
        const WAYS: [&str; 5] = ["quat", "axisangle", "xyaxes", "zaxis", "euler"];
        let ways: Vec<&str> = WAYS.into_iter().filter(|name| of.text(name).is_some()).collect();
        let [way] = ways[..] else {
            return if ways.is_empty() { Ok(None) } else { Err(of.error("one orientation", ways.join(" and "))) };
        };
        let direction = |x: f64, y: f64, z: f64| {
            let error = || of.error(format!("directions that are not zero as `{way}`"), format!("{x} {y} {z}"));
            DVec3::new(x, y, z).try_normalize().ok_or_else(error)
        };
        let numbers = |n: usize| of.numbers(way, n, n).map(Option::unwrap_or_default);
        Ok(Some(match way {
            "quat" => {
                let q = numbers(4)?;
                let quaternion = Pose::from_position_wxyz([0.0; 3], [q[0], q[1], q[2], q[3]]);
                quaternion.ok_or_else(|| of.error("a quaternion that is not zero", format!("{q:?}")))?.rotation
            }
            "axisangle" => {
                let a = numbers(4)?;
                DQuat::from_axis_angle(direction(a[0], a[1], a[2])?, self.radians(a[3]))
            }
            "xyaxes" => {
                let a = numbers(6)?;
                let x = direction(a[0], a[1], a[2])?;
                let y = DVec3::new(a[3], a[4], a[5]);
                let y = y - x * x.dot(y);
                let y = direction(y.x, y.y, y.z)?;
                DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y)))
            }
            "zaxis" => {
                let a = numbers(3)?;
                z_to(direction(a[0], a[1], a[2])?)
            }
            _ => self.euler(&numbers(3)?),
        }))
    }

    fn euler(&self, angles: &[f64]) -> DQuat {
        let mut whole = DQuat::IDENTITY;
        for (letter, &angle) in self.sequence.iter().zip(angles) {
            let axis = match letter.to_ascii_lowercase() {
                'x' => DVec3::X,
                'y' => DVec3::Y,
                _ => DVec3::Z,
            };
            let turn = DQuat::from_axis_angle(axis, self.radians(angle));
            // Small letters turn with the frame, capitals stay with the parent's axes.
            whole = if letter.is_ascii_lowercase() { whole * turn } else { turn * whole };
        }
        whole
    }
}

/// The smallest rotation that takes z to a unit vector.
pub(super) fn z_to(direction: DVec3) -> DQuat {
    let axis = DVec3::Z.cross(direction);
    let sine = axis.length();
    // Straight up or down there is no axis; MuJoCo turns about x.
    let axis = if sine < 1e-10 { DVec3::X } else { axis / sine };
    DQuat::from_axis_angle(axis, sine.atan2(direction.z))
}
