//! A robot as its URDF states it, element by element.

use qv_core::Pose;

/// A robot as its URDF states it, before anything is merged or judged.
#[derive(Debug, Clone, Default)]
pub struct Robot {
    /// Name of the robot; may be empty.
    pub name: String,
    /// Links in the order of the file.
    pub links: Vec<LinkElement>,
    /// Joints in the order of the file.
    pub joints: Vec<JointElement>,
    /// What the file lacks or states twice, and how it was read, a sentence each.
    pub remarks: Vec<String>,
}

/// A `<link>`.
#[derive(Debug, Clone)]
pub struct LinkElement {
    /// Its name.
    pub name: String,
    /// Line of the file, counted from 1.
    pub line: usize,
    /// Mass, centre and inertia; `None` where the link has no `<inertial>`.
    pub inertial: Option<Inertial>,
    /// Shapes for contact.
    pub collisions: Vec<Collision>,
    /// Whether it stands between two joints of one body, and needs no mass. No URDF says so.
    pub is_between_joints: bool,
}

/// An `<inertial>`.
#[derive(Debug, Clone, Copy)]
pub struct Inertial {
    /// Line of the file, counted from 1.
    pub line: usize,
    /// Frame of the centre of mass, in the link's frame.
    pub origin: Origin,
    /// Mass \[kg\].
    pub mass: f64,
    /// ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, in the axes of `origin` \[kg m²\]; zeros where the element is
    /// absent.
    pub inertia: [f64; 6],
}

/// An `<origin>`: identity where it is absent.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Origin {
    /// Position \[m\].
    pub xyz: [f64; 3],
    /// Roll, pitch, yaw \[rad\], about fixed axes.
    pub rpy: [f64; 3],
    /// The rotation as a quaternion w, x, y, z in place of `rpy`: other kinds of files state it so, and angles would round it.
    pub wxyz: Option<[f64; 4]>,
}

impl Origin {
    /// As a transform; `None` where a number is not finite, or a quaternion is zero.
    pub fn pose(&self) -> Option<Pose> {
        match self.wxyz {
            Some(wxyz) => Pose::from_position_wxyz(self.xyz, wxyz),
            None => {
                self.xyz.iter().chain(&self.rpy).all(|x| x.is_finite()).then(|| Pose::from_xyz_rpy(self.xyz, self.rpy))
            }
        }
    }
}

impl From<Pose> for Origin {
    fn from(pose: Pose) -> Self {
        Self { xyz: pose.position.to_array(), rpy: [0.0; 3], wxyz: Some(pose.wxyz()) }
    }
}

/// A `<collision>`.
#[derive(Debug, Clone)]
pub struct Collision {
    /// Line of the file, counted from 1.
    pub line: usize,
    /// Its own name; `None` where it is named after its link.
    pub name: Option<String>,
    /// Frame of the shape in the link's frame.
    pub origin: Origin,
    /// The shape, or why there is none that can be used.
    pub geometry: Result<Geometry, String>,
}

/// A shape, in metres, as the file states it: sizes may be anything.
#[derive(Debug, Clone, PartialEq)]
pub enum Geometry {
    /// Radius.
    Sphere(f64),
    /// Edges.
    Box([f64; 3]),
    /// Along z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Whole length.
        length: f64,
    },
    /// Along z.
    Capsule {
        /// Radius.
        radius: f64,
        /// Length between the centres of its ends.
        length: f64,
    },
    /// A file.
    Mesh {
        /// Its name, as it is written.
        filename: String,
        /// Factors along x, y, z.
        scale: [f64; 3],
    },
    /// The convex hull of these points.
    Points(Vec<[f64; 3]>),
}

/// A `<joint>`.
#[derive(Debug, Clone)]
pub struct JointElement {
    /// Its name.
    pub name: String,
    /// Line of the file, counted from 1.
    pub line: usize,
    /// How the child may move.
    pub kind: JointType,
    /// Frame of the child at zero, in the parent's frame.
    pub origin: Origin,
    /// Name of the parent link.
    pub parent: String,
    /// Name of the child link.
    pub child: String,
    /// Axis in the child's frame; x where it is absent.
    pub axis: [f64; 3],
    /// Limits; zeros where the element is absent.
    pub limit: Limit,
    /// Damping \[N m s/rad\] and friction \[N m\], where they are stated.
    pub dynamics: Option<Dynamics>,
    /// Rotor inertia \[kg m²\]; `None` where the file cannot say, as in a URDF.
    pub armature: Option<f64>,
    /// Whether the joint follows another one.
    pub mimics: bool,
}

/// The `type` of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointType {
    /// Turns between limits.
    Revolute,
    /// Turns without limits.
    Continuous,
    /// Slides between limits.
    Prismatic,
    /// Does not move.
    Fixed,
    /// Moves freely.
    Floating,
    /// Moves in a plane.
    Planar,
    /// Turns about a point.
    Spherical,
}

impl JointType {
    /// All types with their names in a file.
    pub const NAMES: [(&'static str, Self); 7] = [
        ("revolute", Self::Revolute),
        ("continuous", Self::Continuous),
        ("prismatic", Self::Prismatic),
        ("fixed", Self::Fixed),
        ("floating", Self::Floating),
        ("planar", Self::Planar),
        ("spherical", Self::Spherical),
    ];

    /// Its name in a file.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }
}

/// A `<limit>`. Zero effort or velocity means that none is stated.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Limit {
    /// Least position \[rad or m\].
    pub lower: f64,
    /// Greatest position \[rad or m\].
    pub upper: f64,
    /// Greatest torque or force \[N m or N\].
    pub effort: f64,
    /// Greatest speed \[rad/s or m/s\].
    pub velocity: f64,
}

/// A `<dynamics>`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Dynamics {
    /// Viscous friction \[N m s/rad\].
    pub damping: f64,
    /// Coulomb friction \[N m\].
    pub friction: f64,
}
