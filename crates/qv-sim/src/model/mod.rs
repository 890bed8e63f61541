//! The robot: a tree of rigid links moved by joints, with its collision shapes.

pub(crate) mod inertia;
mod mechanics;
mod mesh;
mod urdf;

pub use mechanics::Mechanics;
pub use mesh::MeshShape;
pub use urdf::{MeshReader, ModelOptions};

use crate::SimError;
use glam::{DMat3, DVec3};
use qv_core::Pose;

/// How the root link is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BaseKind {
    /// The root link moves freely: 7 positions (xyz, wxyz) and 6 velocities (linear in world, angular in body).
    #[default]
    Floating,
    /// The root link is the world.
    Fixed,
}

/// A moving rigid body: a URDF link with all links that are fixed to it.
#[derive(Debug, Clone)]
pub struct Link {
    /// Name of the URDF link that carries the joint.
    pub name: String,
    /// Index of the parent link; `None` for the floating base and for links that hang on the fixed world.
    pub parent: Option<usize>,
    /// Index of the joint that moves it; `None` for the floating base.
    pub joint: Option<usize>,
    /// Pose in the parent link (or in the world) when the joint is at zero.
    pub parent_from_link: Pose,
    /// Mass \[kg\].
    pub mass: f64,
    /// Centre of mass in the link frame \[m\].
    pub com: DVec3,
    /// Rotational inertia about the centre of mass, in link axes \[kg m²\].
    pub inertia: DMat3,
}

/// What a joint lets its link do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about the axis \[rad\].
    Revolute,
    /// Slides along the axis \[m\].
    Prismatic,
}

/// A joint of one degree of freedom. For prismatic joints read N for N m and m for rad.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// Index of the link that it moves.
    pub link: usize,
    /// Turning or sliding.
    pub kind: JointKind,
    /// Unit axis in the frame of the moved link.
    pub axis: DVec3,
    /// Lower position limit \[rad\]; minus infinity for continuous joints.
    pub lower: f64,
    /// Upper position limit \[rad\]; infinity for continuous joints.
    pub upper: f64,
    /// Largest torque \[N m\]; infinity when the URDF states none.
    pub effort: f64,
    /// Largest speed \[rad/s\]; infinity when the URDF states none.
    pub velocity: f64,
    /// Rotor inertia seen at the joint \[kg m²\].
    pub armature: f64,
    /// Viscous friction \[N m s/rad\].
    pub viscous_friction: f64,
    /// Coulomb friction \[N m\].
    pub coulomb_friction: f64,
}

/// A collision shape, centred on its own frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// Radius \[m\].
    Sphere(f64),
    /// Half extents \[m\].
    Box(DVec3),
    /// Segment along z with a radius.
    Capsule {
        /// Radius \[m\].
        radius: f64,
        /// Half the length of the segment \[m\].
        half_length: f64,
    },
    /// Axis along z.
    Cylinder {
        /// Radius \[m\].
        radius: f64,
        /// Half the height \[m\].
        half_length: f64,
    },
    /// Vertices of a convex hull \[m\].
    Hull(Vec<DVec3>),
}

/// A collision shape on a link.
#[derive(Debug, Clone)]
pub struct Geom {
    /// `link` or `link.k` when a URDF link has several shapes.
    pub name: String,
    /// Index of the moving link.
    pub link: usize,
    /// Pose of the shape in the link frame.
    pub link_from_geom: Pose,
    /// The shape.
    pub shape: Shape,
}

/// A named frame: any URDF link, also one that was merged.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Name of the URDF link.
    pub name: String,
    /// Moving link that carries it; `None` for the fixed world.
    pub link: Option<usize>,
    /// Pose in that link.
    pub link_from_frame: Pose,
}

/// Joints of a robot that is simulated: its mass matrix has the square of them.
const MOST_JOINTS: usize = 1000;

/// A robot. Order of `links` and `joints`: depth first, children in the order of the URDF file.
#[derive(Debug, Clone)]
pub struct Model {
    /// Name in the URDF.
    pub name: String,
    /// How the root is held.
    pub base: BaseKind,
    /// Moving links; with a floating base, link 0 is the base.
    pub links: Vec<Link>,
    /// Joints, in the order of positions and commands.
    pub joints: Vec<Joint>,
    /// Collision shapes.
    pub geoms: Vec<Geom>,
    /// All named frames.
    pub frames: Vec<Frame>,
    /// Parts of the URDF that were left out, in words (collision meshes that nobody could read).
    pub left_out: Vec<String>,
    /// What the URDF says that cannot be so, or leaves open, and how it was read, a sentence each. Nothing is lost by these.
    pub remarks: Vec<String>,
    /// Joints of the file that do not move here: fixed ones, and those that the options hold.
    pub still: Vec<String>,
    joint_names: Vec<String>,
}

impl Model {
    /// Names of the joints in order.
    pub fn joint_names(&self) -> &[String] {
        &self.joint_names
    }

    /// Looks whether every index leads to something, in the order that the engine counts by: it looks up no index twice. Parts of a model can
    /// be changed after it was read.
    pub(crate) fn check_indices(&self) -> Result<(), SimError> {
        let wrong = |what: &str, expected: String, found: usize| {
            Err(SimError::Value { what: format!("model: {what}"), expected, found: found as f64 })
        };
        if self.joints.len() > MOST_JOINTS {
            return wrong("joints", format!("at most {MOST_JOINTS}"), self.joints.len());
        }
        if self.joint_names.len() != self.joints.len() {
            return wrong("joint names", format!("{}, one for each joint", self.joints.len()), self.joint_names.len());
        }
        let mut joints = 0;
        for (index, link) in self.links.iter().enumerate() {
            let is_base = index == 0 && self.base == BaseKind::Floating;
            let is_root = is_base || self.base == BaseKind::Fixed;
            let has_parent = link.parent.map_or(is_root, |parent| !is_base && parent < index);
            if !has_parent {
                let parent = link.parent.unwrap_or(usize::MAX);
                return wrong(&format!("parent of link {index}"), "a link before it".into(), parent);
            }
            let expected = (!is_base).then_some(joints);
            if link.joint != expected {
                return wrong(
                    &format!("joint of link {index}"),
                    format!("{expected:?}"),
                    link.joint.unwrap_or(usize::MAX),
                );
            }
            joints += usize::from(!is_base);
        }
        if joints != self.joints.len() {
            return wrong("links with a joint", self.joints.len().to_string(), joints);
        }
        let linked = self.geoms.iter().map(|geom| geom.link).chain(self.frames.iter().filter_map(|frame| frame.link));
        match linked.max().filter(|&link| link >= self.links.len()) {
            Some(link) => wrong("link of a shape or frame", format!("below {}", self.links.len()), link),
            None => Ok(()),
        }
    }

    /// Number of positions: joints, plus 7 for a floating base.
    pub fn nq(&self) -> usize {
        self.joints.len() + if self.base == BaseKind::Floating { 7 } else { 0 }
    }

    /// Number of velocities: joints, plus 6 for a floating base.
    pub fn nv(&self) -> usize {
        self.joints.len() + self.base_dofs()
    }

    /// 6 for a floating base, 0 for a fixed one.
    pub fn base_dofs(&self) -> usize {
        if self.base == BaseKind::Floating { 6 } else { 0 }
    }

    /// Index of a joint by name.
    pub fn joint_index(&self, name: &str) -> Option<usize> {
        self.joint_names.iter().position(|n| n == name)
    }

    /// A named frame.
    pub fn frame(&self, name: &str) -> Option<&Frame> {
        self.frames.iter().find(|f| f.name == name)
    }

    /// Total mass of what moves \[kg\].
    pub fn mass(&self) -> f64 {
        self.links.iter().map(|l| l.mass).sum()
    }

    /// Pose of every link in the world for positions `q` (shape `[nq]`), with the base at the identity when fixed.
    ///
    /// # Panics
    /// When `q` is shorter than `nq`.
    pub fn world_from_links(&self, q: &[f64]) -> Vec<Pose> {
        self.world_from_scaled_links(q, |_| 1.0)
    }

    /// The same for a robot whose link `l` is `length(l)` times as long (`link.*.length_scale`).
    pub fn world_from_scaled_links(&self, q: &[f64], length: impl Fn(usize) -> f64) -> Vec<Pose> {
        let offset = self.nq() - self.joints.len();
        let mut poses: Vec<Pose> = Vec::with_capacity(self.links.len());
        for link in &self.links {
            let pose = match (link.joint, link.parent) {
                (None, _) => {
                    Pose::from_position_wxyz([q[0], q[1], q[2]], [q[3], q[4], q[5], q[6]]).unwrap_or(Pose::IDENTITY)
                }
                (Some(j), parent) => {
                    let world_from_parent = parent.map_or(Pose::IDENTITY, |p| poses[p]);
                    let rest = link.parent_from_link;
                    let scale = parent.map_or(1.0, &length);
                    let rest = Pose { position: scale * rest.position, ..rest };
                    world_from_parent * rest * self.joints[j].motion(q[offset + j])
                }
            };
            poses.push(pose);
        }
        poses
    }
}

impl Joint {
    /// Pose of the moved link in the frame where it rests at zero, for joint position `q`.
    pub fn motion(&self, q: f64) -> Pose {
        match self.kind {
            JointKind::Revolute => Pose { position: DVec3::ZERO, rotation: glam::DQuat::from_axis_angle(self.axis, q) },
            JointKind::Prismatic => Pose { position: self.axis * q, rotation: glam::DQuat::IDENTITY },
        }
    }
}
