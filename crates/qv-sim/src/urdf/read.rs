//! An XML tree becomes links and joints.

use super::elements::{
    Collision, Dynamics, Geometry, Inertial, JointElement, JointType, Limit, LinkElement, Origin, Robot,
};
use super::{attributes, kinds};
use crate::SimError;
use roxmltree::{Document, Error as XmlError, Node, ParsingOptions};
use std::borrow::Cow;

/// Prefixes that a file may use without declaring them: readers of ROS never asked for declarations.
const MOST_PREFIXES: usize = 64;

pub(super) fn robot(xml: &str) -> Result<Robot, SimError> {
    let xml = xml.trim_start_matches('\u{feff}');
    attributes::check(xml).map_err(SimError::UrdfSyntax)?;
    let text = with_prefixes(xml);
    let options = ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = Document::parse_with_options(&text, options)
        .map_err(|e| SimError::UrdfSyntax(kinds::of_text(xml, &e.to_string())))?;
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(SimError::UrdfSyntax(kinds::of_root(root.tag_name().name())));
    }
    if let Some(xacro) = kinds::as_xacro(root) {
        return Err(SimError::UrdfSyntax(xacro));
    }
    let version = version(root.attribute("version"));
    let mut reader = Reader { lines: Lines::new(&text), version, remarks: Vec::new() };
    let mut robot = Robot { name: root.attribute("name").unwrap_or_default().to_owned(), ..Default::default() };
    for element in root.children().filter(Node::is_element) {
        match element.tag_name().name() {
            "link" => robot.links.push(reader.link(element)?),
            // Old `<transmission>`s hold `<joint>`s as well; those are no children of the robot.
            "joint" => robot.joints.push(reader.joint(element)?),
            _ => {}
        }
    }
    robot.remarks = reader.remarks;
    Ok(robot)
}

/// The text with the prefixes declared that it uses without a declaration. Lines stay where they are.
fn with_prefixes(xml: &str) -> Cow<'_, str> {
    let mut text = Cow::Borrowed(xml);
    for _ in 0..MOST_PREFIXES {
        let options = ParsingOptions { allow_dtd: true, ..Default::default() };
        let prefix = match Document::parse_with_options(&text, options) {
            Err(XmlError::UnknownNamespace(prefix, _)) => prefix,
            _ => break,
        };
        let Some(at) = text.find("<robot").map(|at| at + "<robot".len()) else { break };
        text = Cow::Owned(format!("{} xmlns:{prefix}=\"undeclared:{prefix}\"{}", &text[..at], &text[at..]));
    }
    text
}

/// (1, 0) where it is absent or no version.
fn version(attribute: Option<&str>) -> (u32, u32) {
    let parse = |text: &str| {
        let (major, minor) = text.trim().split_once('.')?;
        Some((major.parse().ok()?, minor.parse().ok()?))
    };
    attribute.and_then(parse).unwrap_or((1, 0))
}

/// Where lines begin.
pub(crate) struct Lines(Vec<usize>);

impl Lines {
    pub(crate) fn new(text: &str) -> Self {
        Self(std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect())
    }

    pub(crate) fn of(&self, node: Node) -> usize {
        self.0.partition_point(|&start| start <= node.range().start)
    }
}

/// A link or joint by name, for messages.
#[derive(Clone, Copy)]
enum Owner<'a> {
    Link(&'a str),
    Joint(&'a str),
}

impl Owner<'_> {
    fn error(self, expected: String, found: String) -> SimError {
        match self {
            Self::Link(name) => SimError::Link { link: name.to_owned(), expected, found },
            Self::Joint(name) => SimError::Joint { joint: name.to_owned(), expected, found },
        }
    }

    fn words(self) -> String {
        match self {
            Self::Link(name) => format!("link `{name}`"),
            Self::Joint(name) => format!("joint `{name}`"),
        }
    }
}

struct Reader {
    lines: Lines,
    version: (u32, u32),
    remarks: Vec<String>,
}

impl Reader {
    fn link(&mut self, node: Node) -> Result<LinkElement, SimError> {
        let line = self.lines.of(node);
        let name = self.name(node)?;
        let owner = Owner::Link(&name);
        let inertial = match self.only(owner, node, "inertial")? {
            Some(inertial) => Some(self.inertial(owner, inertial)?),
            None => None,
        };
        let mut collisions = Vec::new();
        for collision in node.children().filter(|n| n.has_tag_name("collision")) {
            let line = self.lines.of(collision);
            let origin = self.origin(owner, collision)?;
            collisions.push(Collision { line, name: None, origin, geometry: self.geometry(owner, collision)? });
        }
        Ok(LinkElement { name, line, inertial, collisions, is_between_joints: false })
    }

    fn inertial(&mut self, owner: Owner, node: Node) -> Result<Inertial, SimError> {
        let line = self.lines.of(node);
        let origin = self.origin(owner, node)?;
        let mass = self.only(owner, node, "mass")?.ok_or_else(|| self.missing(owner, node, "a <mass>"))?;
        let mass = self.number(owner, mass, "value")?;
        let inertia = match self.only(owner, node, "inertia")? {
            Some(inertia) => {
                let mut tensor = [0.0; 6];
                for (value, name) in tensor.iter_mut().zip(["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]) {
                    *value = self.number(owner, inertia, name)?;
                }
                tensor
            }
            None => {
                self.remarks.push(format!("{} has a mass and no <inertia> (line {line}): a point mass", owner.words()));
                [0.0; 6]
            }
        };
        Ok(Inertial { line, origin, mass, inertia })
    }

    /// The inner error says why the shape is left out.
    fn geometry(&self, owner: Owner, node: Node) -> Result<Result<Geometry, String>, SimError> {
        let line = self.lines.of(node);
        let shape = node.children().find(|n| n.has_tag_name("geometry"));
        let Some(shape) = shape.and_then(|g| g.children().find(Node::is_element)) else {
            return Ok(Err(format!("it has no shape (line {line})")));
        };
        let length = |name: &str| self.number(owner, shape, name);
        Ok(Ok(match shape.tag_name().name() {
            "sphere" => Geometry::Sphere(length("radius")?),
            "box" => Geometry::Box(self.vector(owner, shape, "size")?),
            "cylinder" => Geometry::Cylinder { radius: length("radius")?, length: length("length")? },
            "capsule" => Geometry::Capsule { radius: length("radius")?, length: length("length")? },
            "mesh" => {
                let scale = match shape.attribute("scale") {
                    Some(_) => self.vector(owner, shape, "scale")?,
                    None => [1.0; 3],
                };
                Geometry::Mesh { filename: self.text(owner, shape, "filename")?.to_owned(), scale }
            }
            other => return Ok(Err(format!("shapes <{other}> are unknown (line {line})"))),
        }))
    }

    fn joint(&mut self, node: Node) -> Result<JointElement, SimError> {
        let line = self.lines.of(node);
        let name = self.name(node)?;
        let owner = Owner::Joint(&name);
        let kind = self.text(owner, node, "type")?.trim();
        let kind =
            JointType::NAMES.iter().find(|(known, _)| *known == kind).map(|(_, kind)| *kind).ok_or_else(|| {
                let known = JointType::NAMES.map(|(name, _)| name).join(", ");
                owner.error(format!("a type of joint ({known})"), format!("`{kind}` (line {line})"))
            })?;
        let end = |reader: &mut Self, role: &str| {
            let element = reader.only(owner, node, role)?;
            let element = element.ok_or_else(|| reader.missing(owner, node, &format!("a <{role}>")))?;
            Ok::<_, SimError>(reader.text(owner, element, "link")?.to_owned())
        };
        let (parent, child) = (end(self, "parent")?, end(self, "child")?);
        let axis = match self.only(owner, node, "axis")? {
            Some(axis) => self.vector(owner, axis, "xyz")?,
            None => [1.0, 0.0, 0.0],
        };
        let dynamics = match self.only(owner, node, "dynamics")? {
            Some(dynamics) => Some(Dynamics {
                damping: self.number_or(owner, dynamics, "damping", 0.0)?,
                friction: self.number_or(owner, dynamics, "friction", 0.0)?,
            }),
            None => None,
        };
        let (origin, limit) = (self.origin(owner, node)?, self.limit(owner, node, kind)?);
        let mimics = node.children().any(|n| n.has_tag_name("mimic"));
        Ok(JointElement { line, kind, origin, parent, child, axis, limit, dynamics, armature: None, mimics, name })
    }

    fn limit(&mut self, owner: Owner, joint: Node, kind: JointType) -> Result<Limit, SimError> {
        let Some(node) = self.only(owner, joint, "limit")? else { return Ok(Limit::default()) };
        // From version 1.2 on an absent limit is none; before, 0 is what exporters write for none.
        let (lower, upper, rest) =
            if self.version >= (1, 2) { (f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY) } else { (0.0, 0.0, 0.0) };
        if self.version < (1, 2) && kind != JointType::Fixed && node.attribute("velocity").is_none() {
            let line = self.lines.of(node);
            self.remarks
                .push(format!("{}: its <limit> states no `velocity` (line {line}): none is set", owner.words()));
        }
        Ok(Limit {
            lower: self.number_or(owner, node, "lower", lower)?,
            upper: self.number_or(owner, node, "upper", upper)?,
            effort: self.number_or(owner, node, "effort", rest)?,
            velocity: self.number_or(owner, node, "velocity", rest)?,
        })
    }

    fn origin(&self, owner: Owner, node: Node) -> Result<Origin, SimError> {
        let Some(origin) = self.only(owner, node, "origin")? else { return Ok(Origin::default()) };
        let vector = |name: &str| match origin.attribute(name) {
            Some(_) => self.vector(owner, origin, name),
            None => Ok([0.0; 3]),
        };
        let xyz = vector("xyz")?;
        if self.version >= (1, 1) && origin.attribute("quat_xyzw").is_some() && origin.attribute("rpy").is_none() {
            return Ok(Origin { xyz, rpy: rpy_of(self.numbers(owner, origin, "quat_xyzw")?), wxyz: None });
        }
        Ok(Origin { xyz, rpy: vector("rpy")?, wxyz: None })
    }

    /// The child of that name. A second one that says something else is an error: which of the two holds, no reader can know.
    fn only<'a>(&self, owner: Owner, node: Node<'a, 'a>, name: &str) -> Result<Option<Node<'a, 'a>>, SimError> {
        let mut found = node.children().filter(|n| n.has_tag_name(name));
        let Some(first) = found.next() else { return Ok(None) };
        match found.find(|other| !is_same(first, *other)) {
            None => Ok(Some(first)),
            Some(other) => {
                let (a, b) = (self.lines.of(first), self.lines.of(other));
                let within = node.tag_name().name();
                let found = format!("two that differ (lines {a} and {b})");
                Err(owner.error(format!("one <{name}> in a <{within}>"), found))
            }
        }
    }

    fn name(&self, node: Node) -> Result<String, SimError> {
        let tag = node.tag_name().name();
        let line = self.lines.of(node);
        let name = node.attribute("name");
        let missing = || SimError::UrdfSyntax(format!("a <{tag}> without a name (line {line})"));
        name.map(str::to_owned).ok_or_else(missing)
    }

    fn missing(&self, owner: Owner, node: Node, what: &str) -> SimError {
        let (tag, line) = (node.tag_name().name(), self.lines.of(node));
        owner.error(format!("{what} in its <{tag}>"), format!("none (line {line})"))
    }

    fn text<'a>(&self, owner: Owner, node: Node<'a, '_>, name: &str) -> Result<&'a str, SimError> {
        node.attribute(name).ok_or_else(|| self.missing(owner, node, &format!("an attribute `{name}`")))
    }

    fn number(&self, owner: Owner, node: Node, name: &str) -> Result<f64, SimError> {
        Ok(self.numbers::<1>(owner, node, name)?[0])
    }

    fn number_or(&self, owner: Owner, node: Node, name: &str, absent: f64) -> Result<f64, SimError> {
        if node.attribute(name).is_some() { self.number(owner, node, name) } else { Ok(absent) }
    }

    fn vector(&self, owner: Owner, node: Node, name: &str) -> Result<[f64; 3], SimError> {
        self.numbers(owner, node, name)
    }

    fn numbers<const N: usize>(&self, owner: Owner, node: Node, name: &str) -> Result<[f64; N], SimError> {
        let text = self.text(owner, node, name)?;
        let mut words = text.split_whitespace();
        let mut numbers = [0.0; N];
        let read = numbers.iter_mut().all(|x| match words.next().and_then(|w| w.parse().ok()) {
            Some(value) => {
                *x = value;
                true
            }
            None => false,
        });
        if read && words.next().is_none() {
            return Ok(numbers);
        }
        let (tag, line) = (node.tag_name().name(), self.lines.of(node));
        let expected = if N == 1 { "a number".to_owned() } else { format!("{N} numbers with blanks between them") };
        Err(owner.error(format!("{expected} as `{name}` of its <{tag}>"), format!("`{text}` (line {line})")))
    }
}

/// Whether two elements have the same attributes and contents.
fn is_same(a: Node, b: Node) -> bool {
    let of = |node: Node| {
        let elements = node.descendants().filter(Node::is_element);
        elements
            .map(|n| {
                let mut attributes: Vec<_> =
                    n.attributes().map(|a| (a.name().to_owned(), a.value().to_owned())).collect();
                attributes.sort();
                (n.tag_name().name().to_owned(), attributes)
            })
            .collect::<Vec<_>>()
    };
    of(a) == of(b)
}

/// Roll, pitch and yaw of a quaternion x, y, z, w of any length; zeros for none.
fn rpy_of([x, y, z, w]: [f64; 4]) -> [f64; 3] {
    let rotation = glam::DQuat::from_xyzw(x, y, z, w);
    if rotation.length() < 1e-12 {
        return [0.0; 3];
    }
    // R = Rz(yaw) Ry(pitch) Rx(roll).
    let (yaw, pitch, roll) = rotation.normalize().to_euler(glam::EulerRot::ZYX);
    [roll, pitch, yaw]
}
