//! The `<worldbody>` becomes links and joints.
//!
//! <https://mujoco.readthedocs.io/en/stable/XMLreference.html#world-body-r>

use super::attributes::{Attributes, Classes};
use super::frames::Compiler;
use super::joints;
use super::schema::MAKERS;
use super::shapes::{Geom, Meshes, Shape};
use super::tree::Tree;
use crate::SimError;
use crate::model::inertia::MassProperties;
use crate::urdf::{Collision, Inertial, JointElement, JointType, LinkElement, Origin, Robot};
use glam::{DQuat, DVec3};
use qv_core::Pose;
use std::collections::{BTreeMap, HashSet};

/// Name of the link that is the world.
pub(super) const WORLD: &str = "world";

/// A body's own frame, where its link has another: a joint's anchor off the body's origin moves the link there.
pub(super) struct BodyFrame {
    /// Name of link and body.
    pub name: String,
    /// The body's origin in its link \[m\].
    pub link_from_body: DVec3,
}

/// An element of a body, those inside of <frame>s among them.
struct Item {
    element: usize,
    /// The frame around it, in the body.
    frame: Pose,
    class: usize,
}

/// Reads bodies into a robot.
pub(super) struct Reader<'a> {
    pub tree: &'a Tree,
    pub classes: &'a Classes,
    pub compiler: &'a Compiler,
    pub meshes: &'a Meshes<'a>,
    pub robot: Robot,
    pub left_out: Vec<String>,
    pub frames: Vec<BodyFrame>,
    /// Sites with the link that carries them and their pose in it.
    pub sites: Vec<(usize, String, Pose)>,
    /// Which element made which joint, and the position that MuJoCo starts from.
    pub joints: Vec<(usize, String, f64)>,
    /// Place of each joint's position in a keyframe, by element.
    pub places: BTreeMap<usize, usize>,
    /// Place of the free base's position in a keyframe.
    pub base_place: Option<usize>,
    /// Positions of a keyframe.
    pub positions: usize,
    names: HashSet<String>,
    shape_names: HashSet<String>,
    /// Elements that had their say, by tag.
    contacts: Vec<String>,
    /// Links with geoms whose mass is not known, and why.
    without_mass: Vec<(String, String)>,
    /// Bodies whose weight the file takes away, in words.
    weightless: Vec<String>,
}

impl<'a> Reader<'a> {
    pub fn new(tree: &'a Tree, classes: &'a Classes, compiler: &'a Compiler, meshes: &'a Meshes<'a>) -> Self {
        let names = HashSet::from([WORLD.to_owned()]);
        let name = tree.attribute(0, "model").unwrap_or("MuJoCo Model").to_owned();
        Self {
            tree,
            classes,
            compiler,
            meshes,
            robot: Robot { name, ..Robot::default() },
            left_out: compiler.left_out.clone(),
            frames: Vec::new(),
            sites: Vec::new(),
            joints: Vec::new(),
            places: BTreeMap::new(),
            base_place: None,
            positions: 0,
            names,
            shape_names: HashSet::new(),
            contacts: Vec::new(),
            without_mass: Vec::new(),
            weightless: Vec::new(),
        }
    }

    pub fn world(&mut self) -> Result<(), SimError> {
        self.robot.links.push(link(WORLD, 1));
        let mut top = Vec::new();
        for section in self.tree.sections("worldbody") {
            top.extend(self.items(section, 0)?);
        }
        self.number_positions(&top);
        self.ground(&top)?;
        let bodies: Vec<Item> = top.into_iter().filter(|i| self.tree.element(i.element).tag == "body").collect();
        let kept = self.robots(bodies)?;
        // On a stack of our own, as bodies may be nested to any depth: body, its parent link, the body frame of the parent.
        let mut pending: Vec<(Item, usize, DVec3)> = kept.into_iter().rev().map(|b| (b, 0, DVec3::ZERO)).collect();
        while let Some((body, parent, parent_from_body)) = pending.pop() {
            let (link, own, inside) = self.body(&body, parent, parent_from_body)?;
            let bodies = inside.into_iter().rev().filter(|i| self.tree.element(i.element).tag == "body");
            pending.extend(bodies.map(|b| (b, link, own)));
        }
        self.say_contacts();
        if !self.weightless.is_empty() {
            self.left_out.push(format!("gravcomp {}: all of the weight counts here", self.weightless.join(", ")));
        }
        Ok(())
    }

    /// The elements of a body, those in <frame>s with the frame around them.
    fn items(&self, body: usize, class: usize) -> Result<Vec<Item>, SimError> {
        let mut items = Vec::new();
        let below = |of: usize, frame: Pose, class: usize| {
            self.tree.element(of).children.iter().rev().map(move |&element| Item { element, frame, class })
        };
        let mut pending: Vec<Item> = below(body, Pose::IDENTITY, class).collect();
        while let Some(item) = pending.pop() {
            if self.tree.element(item.element).tag != "frame" {
                items.push(item);
                continue;
            }
            let class = self.classes.inside(self.tree, item.element, item.class)?;
            let own = self.compiler.pose(&Attributes::plain(self.tree, item.element))?;
            pending.extend(below(item.element, item.frame * own, class));
        }
        Ok(items)
    }

    /// Where a keyframe has the positions of each joint: depth first, whatever is read of them.
    fn number_positions(&mut self, top: &[Item]) {
        let mut pending: Vec<usize> = top.iter().rev().map(|i| i.element).collect();
        while let Some(element) = pending.pop() {
            let own = self.tree.element(element);
            let count = match own.tag.as_str() {
                // A <frame> may hold joints, too.
                "body" | "frame" => {
                    pending.extend(own.children.iter().rev().copied());
                    0
                }
                "freejoint" => 7,
                "joint" => match self.tree.attribute(element, "type") {
                    Some("free") => 7,
                    Some("ball") => 4,
                    _ => 1,
                },
                _ => 0,
            };
            if count > 0 {
                self.places.insert(element, self.positions);
                self.positions += count;
            }
        }
    }

    /// What stands on the world itself: planes are the terrain, which is another input.
    fn ground(&mut self, top: &[Item]) -> Result<(), SimError> {
        let mut others = Vec::new();
        for item in top.iter().filter(|i| self.tree.element(i.element).tag == "geom") {
            let geom = Attributes::new(self.tree, self.classes, item.element, item.class)?;
            let place = self.tree.place(item.element);
            match geom.text("type") {
                Some(kind @ ("plane" | "hfield")) => {
                    self.robot
                        .remarks
                        .push(format!("the {kind} {place} is ground: the terrain is given apart from the robot"));
                }
                _ => others.push(place),
            }
        }
        if !others.is_empty() {
            self.left_out.push(format!("geoms that are fixed in the world {}", others.join(", ")));
        }
        for item in top.iter().filter(|i| MAKERS.contains(&self.tree.element(i.element).tag.as_str())) {
            self.left_out.push(format!("{} {}", self.tree.label(item.element), self.tree.place(item.element)));
        }
        Ok(())
    }

    /// The bodies that are the robot: the free one with most joints alone, or all that are fixed in the world.
    fn robots(&mut self, bodies: Vec<Item>) -> Result<Vec<Item>, SimError> {
        let mut best: Option<(usize, bool, usize)> = None;
        let mut all = Vec::new();
        for (index, body) in bodies.iter().enumerate() {
            let is_free = self.free_joint(body)?.is_some();
            let joints = self.joints_below(body.element);
            if best.is_none_or(|(most, _, _)| joints > most) {
                best = Some((joints, is_free, index));
            }
            all.push(is_free);
        }
        let Some((_, robot_is_free, robot)) = best else {
            return Err(self.tree.error(0, "a <body> in its <worldbody>", "none"));
        };
        let mut kept = Vec::new();
        for (index, body) in bodies.into_iter().enumerate() {
            if index == robot || !(robot_is_free || all[index]) {
                kept.push(body);
            } else {
                let what = if all[index] { "is free" } else { "is fixed in the world" };
                let (label, place) = (self.tree.label(body.element), self.tree.place(body.element));
                self.left_out.push(format!("{label}, which {what} beside the robot {place}"));
            }
        }
        Ok(kept)
    }

    fn free_joint(&self, body: &Item) -> Result<Option<usize>, SimError> {
        let class = self.classes.inside(self.tree, body.element, body.class)?;
        let items = self.items(body.element, class)?;
        Ok(items.iter().map(|i| i.element).find(|&e| joints::is_free(self.tree, e)))
    }

    fn joints_below(&self, body: usize) -> usize {
        let (mut count, mut pending) = (0, vec![body]);
        while let Some(element) = pending.pop() {
            let own = self.tree.element(element);
            count += usize::from(own.tag == "joint" && !joints::is_free(self.tree, element));
            pending.extend(own.children.iter().copied());
        }
        count
    }

    /// Makes the links of a body. Returns its link, its origin in that, and what is inside.
    fn body(
        &mut self,
        body: &Item,
        parent: usize,
        parent_from_body: DVec3,
    ) -> Result<(usize, DVec3, Vec<Item>), SimError> {
        let class = self.classes.inside(self.tree, body.element, body.class)?;
        let items = self.items(body.element, class)?;
        let own = self.compiler.pose(&Attributes::plain(self.tree, body.element))?;
        let mut at = body.frame * own;
        at.position += parent_from_body;
        let name = self.body_name(body.element)?;
        let compensated = Attributes::plain(self.tree, body.element).number_or("gravcomp", 0.0)?;
        if compensated != 0.0 {
            self.weightless.push(format!("{compensated} of body `{name}` {}", self.tree.place(body.element)));
        }
        let (link, link_from_body) = self.joints(&name, body.element, &items, parent, at)?;
        if link_from_body != DVec3::ZERO {
            self.frames.push(BodyFrame { name, link_from_body });
        }
        self.contents(link, link_from_body, &items)?;
        Ok((link, link_from_body, items))
    }

    fn body_name(&mut self, body: usize) -> Result<String, SimError> {
        let stated = self.tree.attribute(body, "name").map(str::to_owned);
        let name = stated.unwrap_or_else(|| format!("body_{}", self.robot.links.len()));
        if !self.names.insert(name.clone()) {
            return Err(self.tree.error(body, "a name of its own", format!("`{name}` again")));
        }
        Ok(name)
    }

    /// The links and joints of a body: one for each of its joints, or a fixed one. Each link but the last weighs nothing.
    fn joints(
        &mut self,
        name: &str,
        body: usize,
        items: &[Item],
        parent: usize,
        mut at: Pose,
    ) -> Result<(usize, DVec3), SimError> {
        let tags = ["joint", "freejoint"];
        let own: Vec<&Item> =
            items.iter().filter(|i| tags.contains(&self.tree.element(i.element).tag.as_str())).collect();
        let line = self.tree.element(body).line;
        if own.is_empty() {
            let child = self.push_link(name, line);
            self.push_joint(joints::fixed(&format!("{name}_fixed"), line, at), parent, child);
            return Ok((child, DVec3::ZERO));
        }
        let (mut parent, mut anchor) = (parent, DVec3::ZERO);
        for (k, item) in own.iter().enumerate() {
            let is_last = k + 1 == own.len();
            let joint = Attributes::new(self.tree, self.classes, item.element, item.class)?;
            let joint_name = match self.tree.attribute(item.element, "name") {
                Some(name) => name.to_owned(),
                None => format!("{name}_joint{}", if k == 0 { String::new() } else { format!("_{k}") }),
            };
            let link_name = if is_last { name.to_owned() } else { format!("{name}:{joint_name}") };
            let child = self.push_link(&link_name, line);
            self.robot.links[child].is_between_joints = !is_last;
            if joints::is_free(self.tree, item.element) {
                if own.len() > 1 || parent != 0 {
                    return Err(joint.error("a free joint alone, on a body of the world", "another"));
                }
                self.base_place = self.places.get(&item.element).copied();
                let (free, lost) = joints::free(&joint, &joint_name, at)?;
                self.left_out.extend(lost);
                self.push_joint(free, parent, child);
                return Ok((child, DVec3::ZERO));
            }
            let read = joints::read(&joint, self.compiler, &joint_name, &item.frame)?;
            self.left_out.extend(read.left_out);
            // The link's frame stands in the joint's anchor, turned back by what the joint stands at in the drawing.
            at.position += at.rotation * (read.anchor - anchor);
            let turned = at * start(&read.element, -read.reference);
            let element = JointElement { origin: Origin::from(turned), ..read.element };
            self.joints.push((item.element, joint_name, read.reference));
            self.push_joint(element, parent, child);
            (parent, anchor, at) = (child, read.anchor, Pose::IDENTITY);
        }
        Ok((parent, -anchor))
    }

    fn push_link(&mut self, name: &str, line: usize) -> usize {
        self.names.insert(name.to_owned());
        self.robot.links.push(link(name, line));
        self.robot.links.len() - 1
    }

    fn push_joint(&mut self, joint: JointElement, parent: usize, child: usize) {
        let name = |link: usize| self.robot.links[link].name.clone();
        let joint = JointElement { parent: name(parent), child: name(child), ..joint };
        self.robot.joints.push(joint);
    }

    /// Mass, shapes and sites of a body.
    fn contents(&mut self, link: usize, link_from_body: DVec3, items: &[Item]) -> Result<(), SimError> {
        let place = Pose { position: link_from_body, rotation: DQuat::IDENTITY };
        let mut inertial = None;
        let mut geoms = Vec::new();
        for item in items {
            let element = item.element;
            let link_from_frame = place * item.frame;
            match self.tree.element(element).tag.as_str() {
                "inertial" => {
                    inertial = Some((element, self.inertial(&Attributes::plain(self.tree, element), link_from_frame)?))
                }
                "geom" => {
                    let attributes = Attributes::new(self.tree, self.classes, element, item.class)?;
                    let mut geom = Geom::read(&attributes, self.compiler, self.meshes)?;
                    geom.pose = link_from_frame * geom.pose;
                    self.contact_of(&attributes, geom.collides);
                    geoms.push(geom);
                }
                "site" => {
                    let site = Attributes::new(self.tree, self.classes, element, item.class)?;
                    if let Some(name) = self.tree.attribute(element, "name") {
                        let pose = link_from_frame * self.compiler.pose(&site)?;
                        self.sites.push((link, name.to_owned(), pose));
                    }
                }
                tag if tag == "plugin" || MAKERS.contains(&tag) => {
                    self.left_out.push(format!("{} {}", self.tree.label(element), self.tree.place(element)));
                }
                _ => {}
            }
        }
        let stated = inertial.filter(|_| self.compiler.inertia_from_geoms != Some(true));
        self.robot.links[link].inertial = match stated {
            Some((_, inertial)) => Some(inertial),
            None if self.compiler.inertia_from_geoms == Some(false) => None,
            None => self.mass_of(link, &geoms),
        };
        for geom in geoms {
            self.collision(link, geom);
        }
        Ok(())
    }

    fn inertial(&self, inertial: &Attributes, link_from_frame: Pose) -> Result<Inertial, SimError> {
        let line = self.tree.element(inertial.element()).line;
        let needed = |name: &str| inertial.error(format!("an attribute `{name}`"), "none");
        let mass = inertial.number("mass")?.ok_or_else(|| needed("mass"))?;
        let pose = link_from_frame * self.compiler.pose(inertial)?;
        let inertia = match (inertial.vector::<6>("fullinertia")?, inertial.vector::<3>("diaginertia")?) {
            // Written as xx, yy, zz, xy, xz, yz.
            (Some([xx, yy, zz, xy, xz, yz]), _) => [xx, xy, xz, yy, yz, zz],
            (None, Some([x, y, z])) => [x, 0.0, 0.0, y, 0.0, z],
            // Without mass there is nothing to state.
            (None, None) if mass == 0.0 => [0.0; 6],
            (None, None) => return Err(needed("diaginertia")),
        };
        Ok(Inertial { line, origin: Origin::from(pose), mass, inertia })
    }

    /// The mass that its geoms give a body.
    fn mass_of(&mut self, link: usize, geoms: &[Geom]) -> Option<Inertial> {
        let mut whole = MassProperties::ZERO;
        for geom in geoms {
            match geom.mass_properties() {
                Ok(own) => whole = whole.welded(&own),
                Err(reason) => {
                    let name = &self.robot.links[link].name;
                    let lost = format!("the mass of a geom of body `{name}` (line {}): {reason}", geom.line);
                    self.without_mass.push((name.clone(), lost.clone()));
                    self.left_out.push(lost);
                }
            }
            if let (Ok(Shape::Mesh(mesh)), true) = (&geom.shape, geom.weighs) {
                let (name, line) = (&self.robot.links[link].name, geom.line);
                let of = if mesh.is_closed() {
                    "the volume of its mesh"
                } else {
                    "the convex hull of its mesh, which is not closed,"
                };
                self.robot.remarks.push(format!("body `{name}` weighs what {of} does (line {line})"));
            }
        }
        let line = geoms.first().map_or(0, |g| g.line);
        let m = whole.inertia;
        (whole.mass > 0.0).then(|| Inertial {
            line,
            origin: Origin { xyz: whole.com.to_array(), ..Origin::default() },
            mass: whole.mass,
            inertia: [m.x_axis.x, m.x_axis.y, m.x_axis.z, m.y_axis.y, m.y_axis.z, m.z_axis.z],
        })
    }

    /// Why geoms of a body, or of those that are fixed to it, give it no mass.
    pub fn reasons_without_mass(&self, body: &str) -> Vec<String> {
        let carrier = |link: &str| {
            let mut link = link;
            let fixed = |link: &str| self.robot.joints.iter().find(|j| j.child == link && j.kind == JointType::Fixed);
            while let Some(joint) = fixed(link) {
                link = &joint.parent;
            }
            link.to_owned()
        };
        self.without_mass.iter().filter(|(link, _)| carrier(link) == body).map(|(_, reason)| reason.clone()).collect()
    }

    fn collision(&mut self, link: usize, geom: Geom) {
        if !geom.collides {
            return;
        }
        let body = self.robot.links[link].name.clone();
        if let Ok(Shape::Ellipsoid(_)) = &geom.shape {
            let remarks =
                format!("the ellipsoid of body `{body}` (line {}) is a hull of it, 2 % flatter at most", geom.line);
            self.robot.remarks.push(remarks);
        }
        let geometry = match &geom.shape {
            Ok(shape) => match shape.geometry() {
                Some(geometry) => Ok(geometry),
                None => Err(format!("a plane on a body (line {})", geom.line)),
            },
            Err(reason) => Err(reason.clone()),
        };
        // Names of shapes are those of parameters: each once.
        let name = geom.name.filter(|name| self.shape_names.insert(name.clone()));
        self.robot.links[link].collisions.push(Collision {
            line: geom.line,
            name,
            origin: Origin::from(geom.pose),
            geometry,
        });
    }

    /// Remembers what a geom says about contact.
    fn contact_of(&mut self, geom: &Attributes, collides: bool) {
        const SETTINGS: [&str; 7] = ["friction", "condim", "solref", "solimp", "margin", "gap", "priority"];
        for name in SETTINGS.into_iter().filter(|name| collides && geom.text(name).is_some()) {
            if !self.contacts.iter().any(|known| known == name) {
                self.contacts.push(name.to_owned());
            }
        }
    }

    fn say_contacts(&mut self) {
        if !self.contacts.is_empty() {
            let names = self.contacts.join(", ");
            self.robot
                .remarks
                .push(format!("{names} of geoms are not taken: the ground has friction and stiffness here"));
        }
    }
}

fn link(name: &str, line: usize) -> LinkElement {
    LinkElement { name: name.to_owned(), line, inertial: None, collisions: Vec::new(), is_between_joints: false }
}

/// What a joint does at a position.
fn start(joint: &JointElement, position: f64) -> Pose {
    let axis = DVec3::from_array(joint.axis).normalize_or_zero();
    match joint.kind {
        JointType::Prismatic => Pose { position: axis * position, rotation: DQuat::IDENTITY },
        _ => Pose { position: DVec3::ZERO, rotation: DQuat::from_axis_angle(axis, position) },
    }
}
