//! Reading a URDF: checks, merging of fixed joints, depth-first order.

use super::inertia::{MassProperties, is_of_a_body, nearest_of_a_body, positive_definite, principal_moments};
use super::{BaseKind, Frame, Geom, Joint, JointKind, Link, MeshShape, Model, Shape};
use crate::SimError;
use crate::urdf::{self, Geometry, JointElement, JointType, LinkElement, Origin};
use glam::{DMat3, DVec3};
use qv_core::Pose;
use std::collections::HashMap;

/// Gives the mesh file \[m\] that a URDF or MJCF names, or says why it cannot.
pub type MeshReader<'a> = dyn Fn(&str) -> Result<MeshShape, String> + 'a;

/// How a URDF is read.
#[derive(Default)]
pub struct ModelOptions<'a> {
    /// How the root link is held.
    pub base: BaseKind,
    /// Rotor inertia given to every joint \[kg m²\]; URDF has no tag for it.
    pub armature: f64,
    /// Reads collision meshes, which become convex hulls. Without it they are left out and listed in
    /// [`Model::left_out`].
    pub mesh_reader: Option<&'a MeshReader<'a>>,
    /// Joints by name that do not move, with the positions \[rad or m\] that they are held at: as if they were fixed there.
    pub held: &'a [(String, f64)],
}

impl Model {
    /// Reads any URDF tree. Links behind fixed joints merge into the link that carries them; only then are masses and
    /// inertias judged. What cannot be as the file says is reported in [`Model::remarks`].
    ///
    /// A `floating` joint below the root, with fixed joints alone between them, leads to the free base: what the root carries
    /// beside it is the world.
    ///
    /// # Errors
    /// Names the link or joint, and the line: a moving link without mass, a free base without inertia, numbers that are not
    /// finite, an unknown parent or child, two parents, a loop, several roots, a joint type that has not one degree of
    /// freedom; and what [`urdf::Robot::parse`] refuses.
    pub fn from_urdf(xml: &str, options: &ModelOptions) -> Result<Self, SimError> {
        Self::from_robot(&urdf::Robot::parse(xml)?, options)
    }

    /// The model of a robot that was read from a file of any kind.
    ///
    /// # Errors
    /// As [`Model::from_urdf`].
    pub(crate) fn from_robot(robot: &urdf::Robot, options: &ModelOptions) -> Result<Self, SimError> {
        let tree = Tree::new(robot)?;
        let model = Model { remarks: robot.remarks.clone(), ..empty(&robot.name, options.base) };
        let mut builder = Builder { robot, tree: &tree, options, model, impossible: Vec::new() };
        builder.root()?;
        builder.judge()?;
        let mut model = builder.model;
        model.joint_names = model.joints.iter().map(|j| j.name.clone()).collect();
        if model.links.is_empty() {
            return Err(SimError::UrdfSyntax("no link that moves".into()));
        }
        Ok(model)
    }
}

fn empty(name: &str, base: BaseKind) -> Model {
    Model {
        name: name.to_owned(),
        base,
        links: Vec::new(),
        joints: Vec::new(),
        geoms: Vec::new(),
        frames: Vec::new(),
        left_out: Vec::new(),
        remarks: Vec::new(),
        still: Vec::new(),
        joint_names: Vec::new(),
    }
}

fn link_error(link: &str, expected: &str, found: impl ToString) -> SimError {
    SimError::Link { link: link.to_owned(), expected: expected.to_owned(), found: found.to_string() }
}

fn joint_error(joint: &str, expected: &str, found: impl ToString) -> SimError {
    SimError::Joint { joint: joint.to_owned(), expected: expected.to_owned(), found: found.to_string() }
}

/// Which joints leave each link, by index into the robot's lists.
struct Tree {
    children: Vec<Vec<usize>>,
    child_link: Vec<usize>,
    root: usize,
}

impl Tree {
    fn new(robot: &urdf::Robot) -> Result<Self, SimError> {
        let mut index = HashMap::new();
        for (i, link) in robot.links.iter().enumerate() {
            if index.insert(link.name.as_str(), i).is_some() {
                let lines = lines(robot.links.iter().filter(|l| l.name == link.name).map(|l| l.line));
                return Err(link_error(&link.name, "a unique name", format!("two links of that name ({lines})")));
            }
        }
        let mut children = vec![Vec::new(); robot.links.len()];
        let mut parent_joint: Vec<Option<usize>> = vec![None; robot.links.len()];
        let mut child_link = Vec::new();
        let mut names = HashMap::new();
        for (j, joint) in robot.joints.iter().enumerate() {
            let find = |name: &str, role: &str| {
                index.get(name).copied().ok_or_else(|| {
                    let found = format!("`{name}` (line {})", joint.line);
                    joint_error(&joint.name, &format!("a {role} link that exists"), found)
                })
            };
            let (parent, child) = (find(&joint.parent, "parent")?, find(&joint.child, "child")?);
            if let Some(first) = names.insert(joint.name.as_str(), j) {
                let lines = lines([robot.joints[first].line, joint.line].into_iter());
                return Err(joint_error(&joint.name, "a unique name", format!("two joints of that name ({lines})")));
            }
            if let Some(other) = parent_joint[child].replace(j) {
                let other = &robot.joints[other];
                let lines = lines([other.line, joint.line].into_iter());
                let found = format!("`{}` and `{}` ({lines})", other.name, joint.name);
                return Err(link_error(&joint.child, "one parent joint", found));
            }
            children[parent].push(j);
            child_link.push(child);
        }
        let mut roots = (0..robot.links.len()).filter(|&i| parent_joint[i].is_none());
        let root = roots.next().ok_or_else(|| match robot.links.first() {
            Some(link) => link_error(&link.name, "a tree with a root link", "a loop"),
            None => SimError::UrdfSyntax("no links".into()),
        })?;
        if let Some(other) = roots.next() {
            let name = &robot.links[other].name;
            return Err(link_error(
                name,
                "one root link",
                format!("a second root beside `{}` (line {})", robot.links[root].name, robot.links[other].line),
            ));
        }
        let tree = Self { children, child_link, root };
        tree.check_reached(robot)?;
        Ok(tree)
    }

    /// The floating joint that leads to the free base: the one that fixed joints alone part from the root. `None` where the
    /// root itself is the base.
    fn free_joint(&self, robot: &urdf::Robot) -> Result<Option<usize>, SimError> {
        let mut found: Option<usize> = None;
        let mut stack = vec![self.root];
        while let Some(link) = stack.pop() {
            for &j in &self.children[link] {
                match (robot.joints[j].kind, found) {
                    (JointType::Fixed, _) => stack.push(self.child_link[j]),
                    (JointType::Floating, None) => found = Some(j),
                    (JointType::Floating, Some(other)) => {
                        let (one, two) = (&robot.joints[other], &robot.joints[j]);
                        let found = format!("`{}` as well ({})", one.name, lines([one.line, two.line].into_iter()));
                        return Err(joint_error(&two.name, "one floating joint, that of the base", found));
                    }
                    _ => {}
                }
            }
        }
        Ok(found)
    }

    /// With one root and one parent each, a link that the root does not reach lies on a loop.
    fn check_reached(&self, robot: &urdf::Robot) -> Result<(), SimError> {
        let mut reached = vec![false; robot.links.len()];
        let mut stack = vec![self.root];
        while let Some(link) = stack.pop() {
            reached[link] = true;
            stack.extend(self.children[link].iter().map(|&j| self.child_link[j]));
        }
        match reached.iter().position(|&r| !r) {
            Some(link) => Err(link_error(&robot.links[link].name, "a tree", "a loop")),
            None => Ok(()),
        }
    }
}

struct Builder<'a> {
    robot: &'a urdf::Robot,
    tree: &'a Tree,
    options: &'a ModelOptions<'a>,
    model: Model,
    /// Links of the URDF whose inertia no body can have, with the moving link that each is part of.
    impossible: Vec<(usize, usize)>,
}

/// A URDF link with the moving link that carries it (`None` is the world).
struct Visit {
    urdf_link: usize,
    carrier: Option<usize>,
    carrier_from_link: Pose,
}

impl Builder<'_> {
    fn root(&mut self) -> Result<(), SimError> {
        let free = self.tree.free_joint(self.robot)?;
        let base = match (self.options.base, free) {
            (BaseKind::Fixed, _) => None,
            (BaseKind::Floating, None) => Some(self.tree.root),
            (BaseKind::Floating, Some(joint)) => Some(self.tree.child_link[joint]),
        };
        // The base is link 0, wherever it stands in the file.
        if let Some(base) = base {
            self.model.links.push(new_link(&self.robot.links[base].name, None, None, Pose::IDENTITY));
        }
        let start = base.unwrap_or(self.tree.root);
        self.all_below(Visit { urdf_link: start, carrier: base.map(|_| 0), carrier_from_link: Pose::IDENTITY })?;
        if start != self.tree.root {
            self.all_below(Visit { urdf_link: self.tree.root, carrier: None, carrier_from_link: Pose::IDENTITY })?;
        }
        Ok(())
    }

    fn all_below(&mut self, visit: Visit) -> Result<(), SimError> {
        self.absorb(&visit)?;
        // Joints still to be crossed, on a stack of our own: a URDF of a hundred thousand links in a row must not
        // overflow the program's.
        let mut pending = Vec::new();
        self.push_children(&visit, &mut pending);
        while let Some((joint, carrier, carrier_from_parent)) = pending.pop() {
            if self.is_free_base(joint, carrier) {
                continue;
            }
            let visit = self.follow(joint, carrier, &carrier_from_parent)?;
            self.absorb(&visit)?;
            self.push_children(&visit, &mut pending);
        }
        Ok(())
    }

    /// Whether the free base hangs on this joint: it is read by itself.
    fn is_free_base(&self, joint: usize, carrier: Option<usize>) -> bool {
        let is_floating = self.robot.joints[joint].kind == JointType::Floating;
        is_floating && carrier.is_none() && self.options.base == BaseKind::Floating
    }

    fn push_children(&self, visit: &Visit, pending: &mut Vec<(usize, Option<usize>, Pose)>) {
        let joints = self.tree.children[visit.urdf_link].iter().rev();
        pending.extend(joints.map(|&j| (j, visit.carrier, visit.carrier_from_link)));
    }

    /// Crosses a joint: a fixed one keeps the carrier, any other makes a new moving link.
    fn follow(&mut self, joint: usize, carrier: Option<usize>, carrier_from_link: &Pose) -> Result<Visit, SimError> {
        let urdf = &self.robot.joints[joint];
        let parent_from_joint = urdf.origin.pose().ok_or_else(|| {
            let Origin { xyz, rpy, .. } = urdf.origin;
            let found = format!("xyz {xyz:?} rpy {rpy:?} (line {})", urdf.line);
            joint_error(&urdf.name, "a finite origin", found)
        })?;
        let carrier_from_joint = *carrier_from_link * parent_from_joint;
        let urdf_link = self.tree.child_link[joint];
        // The joint of a free base holds it where the base is held.
        let holds = urdf.kind == JointType::Floating && carrier.is_none();
        if urdf.kind == JointType::Fixed || holds {
            self.model.still.push(urdf.name.clone());
            return Ok(Visit { urdf_link, carrier, carrier_from_link: carrier_from_joint });
        }
        let link = self.model.links.len();
        let joint = read_joint(urdf, link, self.options.armature, &mut self.model.remarks)?;
        if let Some((_, position)) = self.options.held.iter().find(|(name, _)| *name == urdf.name) {
            self.model.still.push(urdf.name.clone());
            return Ok(Visit { urdf_link, carrier, carrier_from_link: carrier_from_joint * joint.motion(*position) });
        }
        if urdf.mimics {
            self.model.left_out.push(format!("mimic of joint `{}`: it moves by itself", urdf.name));
        }
        let index = self.model.joints.len();
        self.model.joints.push(joint);
        let name = &self.robot.links[urdf_link].name;
        self.model.links.push(new_link(name, carrier, Some(index), carrier_from_joint));
        Ok(Visit { urdf_link, carrier: Some(link), carrier_from_link: Pose::IDENTITY })
    }

    /// Adds mass, shapes and frame of a URDF link to the moving link that carries it.
    fn absorb(&mut self, visit: &Visit) -> Result<(), SimError> {
        let urdf = &self.robot.links[visit.urdf_link];
        self.model.frames.push(Frame {
            name: urdf.name.clone(),
            link: visit.carrier,
            link_from_frame: visit.carrier_from_link,
        });
        let Some(carrier) = visit.carrier else { return Ok(()) };
        let own = mass_properties(urdf)?;
        if !is_of_a_body(&own.inertia) {
            self.impossible.push((visit.urdf_link, carrier));
        }
        let own = own.transformed(&visit.carrier_from_link);
        let link = &mut self.model.links[carrier];
        let whole = MassProperties { mass: link.mass, com: link.com, inertia: link.inertia }.welded(&own);
        (link.mass, link.com, link.inertia) = (whole.mass, whole.com, whole.inertia);
        for (k, collision) in urdf.collisions.iter().enumerate() {
            let name = match &collision.name {
                Some(name) => name.clone(),
                None if urdf.collisions.len() == 1 => urdf.name.clone(),
                None => format!("{}.{k}", urdf.name),
            };
            let link_from_geom = visit.carrier_from_link * origin_pose(urdf, &collision.origin, collision.line)?;
            match self.read_shape(collision) {
                Ok(shape) => self.model.geoms.push(Geom { name, link: carrier, link_from_geom, shape }),
                Err(reason) => self.model.left_out.push(format!("collision shape of link `{}`: {reason}", urdf.name)),
            }
        }
        Ok(())
    }

    /// The shape; the error says why it is left out.
    fn read_shape(&self, collision: &urdf::Collision) -> Result<Shape, String> {
        let geometry = collision.geometry.as_ref().map_err(Clone::clone)?;
        let sizes: &[f64] = match geometry {
            Geometry::Sphere(radius) => &[*radius],
            Geometry::Box(size) => size,
            Geometry::Cylinder { radius, length } | Geometry::Capsule { radius, length } => &[*radius, *length],
            Geometry::Mesh { scale, .. } if scale.iter().all(|s| s.is_finite()) => &[],
            Geometry::Points(_) => &[],
            Geometry::Mesh { scale, .. } => scale,
        };
        if !sizes.iter().all(|v| v.is_finite() && *v > 0.0) {
            return Err(format!("sizes {sizes:?} m, where positive ones are needed (line {})", collision.line));
        }
        Ok(match geometry {
            Geometry::Sphere(radius) => Shape::Sphere(*radius),
            Geometry::Box(size) => Shape::Box(DVec3::from_array(*size) * 0.5),
            Geometry::Cylinder { radius, length } => Shape::Cylinder { radius: *radius, half_length: length * 0.5 },
            Geometry::Capsule { radius, length } => Shape::Capsule { radius: *radius, half_length: length * 0.5 },
            Geometry::Mesh { filename, scale } => return self.read_mesh(filename, DVec3::from_array(*scale)),
            Geometry::Points(points) => {
                let points: Vec<DVec3> = points.iter().copied().map(DVec3::from_array).collect();
                return hull(&points).map(Shape::Hull).map_err(|e| format!("its points have {e}"));
            }
        })
    }

    fn read_mesh(&self, filename: &str, scale: DVec3) -> Result<Shape, String> {
        let read = self.options.mesh_reader.ok_or_else(|| format!("no reader for mesh `{filename}`"))?;
        let vertices: Vec<DVec3> = read(filename)?.vertices.into_iter().map(|v| v * scale).collect();
        hull(&vertices).map(Shape::Hull).map_err(|e| format!("mesh `{filename}` has {e}"))
    }

    /// Looks at the mass and inertia of every moving link, as merged.
    fn judge(&mut self) -> Result<(), SimError> {
        let robot = self.robot;
        for l in 0..self.model.links.len() {
            let own = self.impossible.iter().filter(|(_, carrier)| *carrier == l);
            let members: Vec<&LinkElement> = own.map(|(urdf_link, _)| &robot.links[*urdf_link]).collect();
            let link = &mut self.model.links[l];
            let line = robot.links.iter().find(|u| u.name == link.name).map_or(0, |u| u.line);
            let is_between_joints = || robot.links.iter().any(|u| u.is_between_joints && u.name == link.name);
            if link.mass <= 0.0 && !is_between_joints() {
                let expected = "an inertial with a positive mass, on it or on a link fixed to it";
                return Err(link_error(&link.name, expected, format!("none (line {line})")));
            }
            // What files say of links without a fault stays as it is, bit by bit.
            let mut how = "used as they are";
            if !members.is_empty() && !positive_definite(&link.inertia) {
                link.inertia = nearest_of_a_body(&link.inertia);
                how = "the nearest inertia of a body is used";
            }
            if link.joint.is_none() && !positive_definite(&link.inertia) {
                let found = format!("{} (line {line})", link.inertia);
                return Err(link_error(&link.name, "a positive definite inertia (it is the free base)", found));
            }
            if !members.is_empty() {
                let remarks = remarks_of(&members, &link.name, how);
                self.model.remarks.push(remarks);
            }
        }
        Ok(())
    }
}

/// Corners of the convex hull; the error says what the points lack.
fn hull(points: &[DVec3]) -> Result<Vec<DVec3>, String> {
    if points.len() < 4 || points.iter().any(|v| !v.is_finite()) {
        return Err("no four finite vertices".into());
    }
    let (hull, _) = parry3d_f64::transformation::try_convex_hull(points).map_err(|e| format!("no convex hull: {e}"))?;
    Ok(hull)
}

/// What is reported for links whose inertias no body can have.
fn remarks_of(members: &[&LinkElement], carrier: &str, how: &str) -> String {
    let one = |link: &&LinkElement| {
        let [a, b, c] = link.inertial.map_or([0.0; 3], |i| principal_moments(&matrix(&i.inertia)));
        format!("`{}` ({a:.3e}, {b:.3e}, {c:.3e} kg m², line {})", link.name, link.line)
    };
    let names: Vec<String> = members.iter().map(one).collect();
    let within = if members.iter().all(|m| m.name == carrier) { String::new() } else { format!(" within `{carrier}`") };
    format!("no body has the principal moments of link {}: {how}{within}", names.join(", "))
}

/// "line 3", "lines 3 and 7".
fn lines(lines: impl Iterator<Item = usize>) -> String {
    let all: Vec<String> = lines.map(|l| l.to_string()).collect();
    format!("line{} {}", if all.len() == 1 { "" } else { "s" }, all.join(" and "))
}

fn new_link(name: &str, parent: Option<usize>, joint: Option<usize>, parent_from_link: Pose) -> Link {
    Link { name: name.to_owned(), parent, joint, parent_from_link, mass: 0.0, com: DVec3::ZERO, inertia: DMat3::ZERO }
}

fn origin_pose(link: &LinkElement, origin: &Origin, line: usize) -> Result<Pose, SimError> {
    let Origin { xyz, rpy, .. } = *origin;
    let wrong = || link_error(&link.name, "finite origins", format!("xyz {xyz:?} rpy {rpy:?} (line {line})"));
    origin.pose().ok_or_else(wrong)
}

fn matrix([xx, xy, xz, yy, yz, zz]: &[f64; 6]) -> DMat3 {
    DMat3::from_cols(DVec3::new(*xx, *xy, *xz), DVec3::new(*xy, *yy, *yz), DVec3::new(*xz, *yz, *zz))
}

fn mass_properties(link: &LinkElement) -> Result<MassProperties, SimError> {
    let Some(inertial) = &link.inertial else { return Ok(MassProperties::ZERO) };
    let (mass, tensor, line) = (inertial.mass, &inertial.inertia, inertial.line);
    if !mass.is_finite() || mass < 0.0 {
        return Err(link_error(&link.name, "a finite mass of at least 0 kg", format!("{mass} (line {line})")));
    }
    if tensor.iter().any(|x| !x.is_finite()) {
        return Err(link_error(&link.name, "a finite inertia", format!("{tensor:?} (line {line})")));
    }
    if mass == 0.0 && tensor.iter().all(|&x| x == 0.0) {
        return Ok(MassProperties::ZERO);
    }
    let own = MassProperties { mass, com: DVec3::ZERO, inertia: matrix(tensor) };
    Ok(own.transformed(&origin_pose(link, &inertial.origin, line)?))
}

fn read_joint(urdf: &JointElement, link: usize, armature: f64, remarks: &mut Vec<String>) -> Result<Joint, SimError> {
    let wrong =
        |expected: &str, found: String| joint_error(&urdf.name, expected, format!("{found} (line {})", urdf.line));
    let (kind, limited) = match urdf.kind {
        JointType::Revolute => (JointKind::Revolute, true),
        JointType::Continuous => (JointKind::Revolute, false),
        JointType::Prismatic => (JointKind::Prismatic, true),
        JointType::Floating => {
            return Err(wrong(
                "fixed joints alone above a floating one (it is that of the free base)",
                "others".into(),
            ));
        }
        other => return Err(wrong("fixed, revolute, continuous or prismatic", other.name().into())),
    };
    let axis = DVec3::from_array(urdf.axis);
    if !axis.is_finite() || axis.length() < 1e-6 {
        return Err(wrong("a finite axis that is not zero", axis.to_string()));
    }
    let limit = &urdf.limit;
    if [limit.lower, limit.upper, limit.effort, limit.velocity].iter().any(|x| x.is_nan()) {
        return Err(wrong("limits that are numbers", format!("{limit:?}")));
    }
    let (lower, upper) = if limited { (limit.lower, limit.upper) } else { (f64::NEG_INFINITY, f64::INFINITY) };
    let (lower, upper) = if lower > upper {
        let sentence = format!("limits {lower} to {upper} (line {}) are upside down: swapped", urdf.line);
        remarks.push(format!("joint `{}`: {sentence}", urdf.name));
        (upper, lower)
    } else {
        (lower, upper)
    };
    // A joint whose limits are both zero is how exporters write "no limit given".
    let unlimited = lower == 0.0 && upper == 0.0;
    let (lower, upper) = if unlimited { (f64::NEG_INFINITY, f64::INFINITY) } else { (lower, upper) };
    let dynamics = urdf.dynamics.as_ref();
    let (viscous, coulomb) = (dynamics.map_or(0.0, |d| d.damping), dynamics.map_or(0.0, |d| d.friction));
    if !(viscous >= 0.0 && coulomb >= 0.0 && viscous.is_finite() && coulomb.is_finite()) {
        return Err(wrong("damping and friction of at least 0", format!("{viscous} and {coulomb}")));
    }
    let stated = |x: f64| if x > 0.0 { x } else { f64::INFINITY };
    Ok(Joint {
        name: urdf.name.clone(),
        link,
        kind,
        axis: axis.normalize(),
        lower,
        upper,
        effort: stated(limit.effort),
        velocity: stated(limit.velocity),
        armature: urdf.armature.unwrap_or(armature),
        viscous_friction: viscous,
        coulomb_friction: coulomb,
    })
}
