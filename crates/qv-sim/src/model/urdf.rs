//! Reading a URDF: checks, merging of fixed joints, depth-first order.

use super::inertia::{MassProperties, positive_definite};
use super::{BaseKind, Frame, Geom, Joint, JointKind, Link, Model, Shape};
use crate::SimError;
use glam::{DMat3, DVec3};
use qv_core::Pose;
use std::collections::HashMap;

/// Gives the vertices \[m\] of the mesh file that a URDF names, or says why it cannot.
pub type MeshVertices<'a> = dyn Fn(&str) -> Result<Vec<DVec3>, String> + 'a;

/// How a URDF is read.
#[derive(Default)]
pub struct ModelOptions<'a> {
    /// How the root link is held.
    pub base: BaseKind,
    /// Rotor inertia given to every joint \[kg m²\]; URDF has no tag for it.
    pub armature: f64,
    /// Reads collision meshes, which become convex hulls. Without it they are left out and listed in
    /// [`Model::left_out`].
    pub mesh_vertices: Option<&'a MeshVertices<'a>>,
}

impl Model {
    /// Reads any URDF tree. Links behind fixed joints merge into the link that carries them.
    ///
    /// # Errors
    /// Names the link or joint: no or negative mass, inertia that is not positive definite, numbers that are not
    /// finite, an unknown parent or child, two parents, a loop, several roots, a joint type that has not one degree
    /// of freedom.
    pub fn from_urdf(xml: &str, options: &ModelOptions) -> Result<Self, SimError> {
        let robot = urdf_rs::read_from_string(xml).map_err(|e| SimError::UrdfSyntax(e.to_string()))?;
        let tree = Tree::new(&robot)?;
        let mut builder = Builder { robot: &robot, tree: &tree, options, model: empty(&robot.name, options.base) };
        builder.root()?;
        let mut model = builder.model;
        model.joint_names = model.joints.iter().map(|j| j.name.clone()).collect();
        if model.links.is_empty() {
            return Err(SimError::UrdfSyntax("no link that moves".into()));
        }
        check_masses(&model)?;
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
    fn new(robot: &urdf_rs::Robot) -> Result<Self, SimError> {
        let mut index = HashMap::new();
        for (i, link) in robot.links.iter().enumerate() {
            if index.insert(link.name.as_str(), i).is_some() {
                return Err(link_error(&link.name, "a unique name", "two links of that name"));
            }
        }
        let mut children = vec![Vec::new(); robot.links.len()];
        let mut parent_joint: Vec<Option<usize>> = vec![None; robot.links.len()];
        let mut child_link = Vec::new();
        let mut names = HashMap::new();
        for (j, joint) in robot.joints.iter().enumerate() {
            let find = |name: &str, role: &str| {
                index
                    .get(name)
                    .copied()
                    .ok_or_else(|| joint_error(&joint.name, &format!("a {role} link that exists"), format!("`{name}`")))
            };
            let (parent, child) = (find(&joint.parent.link, "parent")?, find(&joint.child.link, "child")?);
            if names.insert(joint.name.as_str(), j).is_some() {
                return Err(joint_error(&joint.name, "a unique name", "two joints of that name"));
            }
            if let Some(other) = parent_joint[child].replace(j) {
                let found = format!("`{}` and `{}`", robot.joints[other].name, joint.name);
                return Err(link_error(&joint.child.link, "one parent joint", found));
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
                format!("a second root beside `{}`", robot.links[root].name),
            ));
        }
        let tree = Self { children, child_link, root };
        tree.check_reached(robot)?;
        Ok(tree)
    }

    /// With one root and one parent each, a link that the root does not reach lies on a loop.
    fn check_reached(&self, robot: &urdf_rs::Robot) -> Result<(), SimError> {
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
    robot: &'a urdf_rs::Robot,
    tree: &'a Tree,
    options: &'a ModelOptions<'a>,
    model: Model,
}

/// A URDF link with the moving link that carries it (`None` is the world).
struct Visit {
    urdf_link: usize,
    carrier: Option<usize>,
    carrier_from_link: Pose,
}

impl Builder<'_> {
    fn root(&mut self) -> Result<(), SimError> {
        let root = self.tree.root;
        let carrier = match self.options.base {
            BaseKind::Fixed => None,
            BaseKind::Floating => {
                self.model.links.push(new_link(&self.robot.links[root].name, None, None, Pose::IDENTITY));
                Some(0)
            }
        };
        let visit = Visit { urdf_link: root, carrier, carrier_from_link: Pose::IDENTITY };
        self.absorb(&visit)?;
        // Joints still to be crossed, on a stack of our own: a URDF of a hundred thousand links in a row must not
        // overflow the program's.
        let mut pending = Vec::new();
        self.push_children(&visit, &mut pending);
        while let Some((joint, carrier, carrier_from_parent)) = pending.pop() {
            let visit = self.follow(joint, carrier, &carrier_from_parent)?;
            self.absorb(&visit)?;
            self.push_children(&visit, &mut pending);
        }
        Ok(())
    }

    fn push_children(&self, visit: &Visit, pending: &mut Vec<(usize, Option<usize>, Pose)>) {
        let joints = self.tree.children[visit.urdf_link].iter().rev();
        pending.extend(joints.map(|&j| (j, visit.carrier, visit.carrier_from_link)));
    }

    /// Crosses a joint: a fixed one keeps the carrier, any other makes a new moving link.
    fn follow(&mut self, joint: usize, carrier: Option<usize>, carrier_from_link: &Pose) -> Result<Visit, SimError> {
        let urdf = &self.robot.joints[joint];
        let xyz = [urdf.origin.xyz[0], urdf.origin.xyz[1], urdf.origin.xyz[2]];
        let rpy = [urdf.origin.rpy[0], urdf.origin.rpy[1], urdf.origin.rpy[2]];
        if xyz.iter().chain(&rpy).any(|x| !x.is_finite()) {
            return Err(joint_error(&urdf.name, "a finite origin", format!("xyz {xyz:?} rpy {rpy:?}")));
        }
        let carrier_from_joint = *carrier_from_link * Pose::from_xyz_rpy(xyz, rpy);
        let urdf_link = self.tree.child_link[joint];
        if urdf.joint_type == urdf_rs::JointType::Fixed {
            return Ok(Visit { urdf_link, carrier, carrier_from_link: carrier_from_joint });
        }
        if urdf.mimic.is_some() {
            self.model.left_out.push(format!("mimic of joint `{}`: it moves by itself", urdf.name));
        }
        let link = self.model.links.len();
        let index = self.model.joints.len();
        self.model.joints.push(read_joint(urdf, link, self.options.armature)?);
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
        let own = mass_properties(urdf)?.transformed(&visit.carrier_from_link);
        let Some(carrier) = visit.carrier else { return Ok(()) };
        let link = &mut self.model.links[carrier];
        let whole = MassProperties { mass: link.mass, com: link.com, inertia: link.inertia }.welded(&own);
        (link.mass, link.com, link.inertia) = (whole.mass, whole.com, whole.inertia);
        for (k, collision) in urdf.collision.iter().enumerate() {
            let name = if urdf.collision.len() == 1 { urdf.name.clone() } else { format!("{}.{k}", urdf.name) };
            let link_from_geom = visit.carrier_from_link * origin_pose(&urdf.name, &collision.origin)?;
            match self.read_shape(&urdf.name, &collision.geometry)? {
                Ok(shape) => self.model.geoms.push(Geom { name, link: carrier, link_from_geom, shape }),
                Err(reason) => self.model.left_out.push(format!("collision shape of link `{}`: {reason}", urdf.name)),
            }
        }
        Ok(())
    }

    /// The shape; the inner error says why it is left out, the outer one why the file is wrong.
    fn read_shape(&self, link: &str, geometry: &urdf_rs::Geometry) -> Result<Result<Shape, String>, SimError> {
        let positive = |values: &[f64]| {
            if values.iter().all(|v| v.is_finite() && *v > 0.0) {
                Ok(())
            } else {
                Err(link_error(link, "collision shapes with positive, finite sizes", format!("{values:?}")))
            }
        };
        let shape = match geometry {
            urdf_rs::Geometry::Sphere { radius } => {
                positive(&[*radius])?;
                Shape::Sphere(*radius)
            }
            urdf_rs::Geometry::Box { size } => {
                positive(&[size[0], size[1], size[2]])?;
                Shape::Box(DVec3::new(size[0], size[1], size[2]) * 0.5)
            }
            urdf_rs::Geometry::Cylinder { radius, length } => {
                positive(&[*radius, *length])?;
                Shape::Cylinder { radius: *radius, half_length: length * 0.5 }
            }
            urdf_rs::Geometry::Capsule { radius, length } => {
                positive(&[*radius, *length])?;
                Shape::Capsule { radius: *radius, half_length: length * 0.5 }
            }
            urdf_rs::Geometry::Mesh { filename, scale } => {
                let scale = scale.map_or(DVec3::ONE, |s| DVec3::new(s[0], s[1], s[2]));
                return Ok(self.read_mesh(filename, scale));
            }
        };
        Ok(Ok(shape))
    }

    fn read_mesh(&self, filename: &str, scale: DVec3) -> Result<Shape, String> {
        let read = self.options.mesh_vertices.ok_or_else(|| format!("no reader for mesh `{filename}`"))?;
        let vertices: Vec<DVec3> = read(filename)?.into_iter().map(|v| v * scale).collect();
        if vertices.len() < 4 || vertices.iter().any(|v| !v.is_finite()) {
            return Err(format!("mesh `{filename}` has no four finite vertices"));
        }
        let (hull, _) = parry3d_f64::transformation::try_convex_hull(&vertices)
            .map_err(|e| format!("mesh `{filename}` has no convex hull: {e}"))?;
        Ok(Shape::Hull(hull))
    }
}

fn new_link(name: &str, parent: Option<usize>, joint: Option<usize>, parent_from_link: Pose) -> Link {
    Link { name: name.to_owned(), parent, joint, parent_from_link, mass: 0.0, com: DVec3::ZERO, inertia: DMat3::ZERO }
}

fn origin_pose(link: &str, origin: &urdf_rs::Pose) -> Result<Pose, SimError> {
    let xyz = [origin.xyz[0], origin.xyz[1], origin.xyz[2]];
    let rpy = [origin.rpy[0], origin.rpy[1], origin.rpy[2]];
    if xyz.iter().chain(&rpy).any(|x| !x.is_finite()) {
        return Err(link_error(link, "finite origins", format!("xyz {xyz:?} rpy {rpy:?}")));
    }
    Ok(Pose::from_xyz_rpy(xyz, rpy))
}

fn mass_properties(link: &urdf_rs::Link) -> Result<MassProperties, SimError> {
    let inertial = &link.inertial;
    let mass = inertial.mass.value;
    let i = &inertial.inertia;
    let tensor = [i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz];
    if !mass.is_finite() || mass < 0.0 {
        return Err(link_error(&link.name, "a finite mass of at least 0 kg", mass));
    }
    if tensor.iter().any(|x| !x.is_finite()) {
        return Err(link_error(&link.name, "a finite inertia", format!("{tensor:?}")));
    }
    let inertia = DMat3::from_cols(
        DVec3::new(i.ixx, i.ixy, i.ixz),
        DVec3::new(i.ixy, i.iyy, i.iyz),
        DVec3::new(i.ixz, i.iyz, i.izz),
    );
    let none = tensor.iter().all(|&x| x == 0.0);
    if !none && !positive_definite(&inertia) {
        return Err(link_error(&link.name, "a positive definite inertia", format!("{tensor:?}")));
    }
    if !none && !positive_definite(&(DMat3::IDENTITY * (0.51 * (i.ixx + i.iyy + i.izz)) - inertia)) {
        // A principal moment above the sum of the others, with 2 % for rounding: no body has that.
        return Err(link_error(&link.name, "an inertia that a body can have", format!("{tensor:?}")));
    }
    if mass == 0.0 && !none {
        return Err(link_error(&link.name, "a mass that goes with its inertia", mass));
    }
    if mass == 0.0 {
        return Ok(MassProperties::ZERO);
    }
    let own = MassProperties { mass, com: DVec3::ZERO, inertia };
    Ok(own.transformed(&origin_pose(&link.name, &inertial.origin)?))
}

fn read_joint(urdf: &urdf_rs::Joint, link: usize, armature: f64) -> Result<Joint, SimError> {
    use urdf_rs::JointType;
    let (kind, limited) = match urdf.joint_type {
        JointType::Revolute => (JointKind::Revolute, true),
        JointType::Continuous => (JointKind::Revolute, false),
        JointType::Prismatic => (JointKind::Prismatic, true),
        ref other => {
            return Err(joint_error(
                &urdf.name,
                "fixed, revolute, continuous or prismatic",
                format!("{other:?}").to_lowercase(),
            ));
        }
    };
    let axis = DVec3::new(urdf.axis.xyz[0], urdf.axis.xyz[1], urdf.axis.xyz[2]);
    if !axis.is_finite() || axis.length() < 1e-6 {
        return Err(joint_error(&urdf.name, "a finite axis that is not zero", axis));
    }
    let limit = &urdf.limit;
    if [limit.lower, limit.upper, limit.effort, limit.velocity].iter().any(|x| x.is_nan()) {
        return Err(joint_error(&urdf.name, "limits that are numbers", format!("{limit:?}")));
    }
    let (lower, upper) = if limited { (limit.lower, limit.upper) } else { (f64::NEG_INFINITY, f64::INFINITY) };
    if lower > upper {
        return Err(joint_error(&urdf.name, "a lower limit below the upper", format!("{lower} > {upper}")));
    }
    // A joint whose limits are both zero is how exporters write "no limit given".
    let unlimited = lower == 0.0 && upper == 0.0;
    let (lower, upper) = if unlimited { (f64::NEG_INFINITY, f64::INFINITY) } else { (lower, upper) };
    let dynamics = urdf.dynamics.as_ref();
    let (viscous, coulomb) = (dynamics.map_or(0.0, |d| d.damping), dynamics.map_or(0.0, |d| d.friction));
    if !(viscous >= 0.0 && coulomb >= 0.0 && viscous.is_finite() && coulomb.is_finite()) {
        return Err(joint_error(&urdf.name, "damping and friction of at least 0", format!("{viscous} and {coulomb}")));
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
        armature,
        viscous_friction: viscous,
        coulomb_friction: coulomb,
    })
}

/// Every moving link needs a mass of its own, or of links fixed to it.
fn check_masses(model: &Model) -> Result<(), SimError> {
    for link in &model.links {
        if link.mass <= 0.0 {
            return Err(link_error(
                &link.name,
                "an inertial with a positive mass, on it or on a link fixed to it",
                "none",
            ));
        }
        if link.joint.is_none() && !positive_definite(&link.inertia) {
            return Err(link_error(&link.name, "a positive definite inertia (it is the free base)", link.inertia));
        }
    }
    Ok(())
}
