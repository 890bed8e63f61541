//! A picture of the robot with the place of the cause marked.

use super::words::escape;
use crate::problem::library::{Effect, Scope};
use crate::report::{Cause, Traces};
use glam::DVec3;
use qv_core::Pose;
use qv_page::picture::range;
use qv_sim::{BaseKind, Model, Shape};
use std::collections::BTreeSet;
use std::fmt::Write;

const WIDTH: f64 = 340.0;
const HEIGHT: f64 = 250.0;
/// Free border \[pixels\].
const BORDER: f64 = 26.0;
/// From where the robot is seen: turned about z, then looked at from above \[rad\].
const AZIMUTH: f64 = -0.6;
const ELEVATION: f64 = 0.35;
/// Names beside marks at most: more would lie on each other.
const NAMES: usize = 4;

/// A limb from one joint to the next, or to the end of its link.
struct Limb {
    link: usize,
    from: DVec3,
    to: DVec3,
}

/// The picture of a robot in the pose in which its recording begins, the parts that the cause acts on marked; empty where nothing can be drawn.
pub(super) fn robot(model: &Model, traces: &Traces, cause: Option<&Cause>, library: &[Effect]) -> String {
    let poses = model.world_from_links(&posture(model, traces));
    let limbs = limbs(model, &poses);
    let Some(view) = View::of(&limbs) else { return String::new() };
    let marked = cause.map_or_else(Marks::default, |cause| Marks::of(model, cause, library));
    let mut svg = trunk(model, &poses, &view, &marked);
    for limb in limbs.iter().filter(|limb| !is_trunk(model, limb.link)) {
        let class = if marked.links.contains(&limb.link) { "limb marked" } else { "limb" };
        let ([x1, y1], [x2, y2]) = (view.at(limb.from), view.at(limb.to));
        let _ = write!(svg, "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>");
    }
    for (j, joint) in model.joints.iter().enumerate() {
        let is_marked = marked.joints.contains(&j);
        let [x, y] = view.at(poses[joint.link].position);
        let (class, radius) = if is_marked { ("pin marked", 7.0) } else { ("pin", 3.5) };
        let name = escape(&joint.name);
        let _ = write!(
            svg,
            "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"><title>{name}</title></circle>"
        );
    }
    svg += &names(model, &poses, &marked, &view);
    let where_text = marked.text(model);
    format!(
        "<figure><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"Robot {}: {where_text}\">{svg}</svg>\
         <figcaption>{where_text}</figcaption></figure>",
        escape(&model.name)
    )
}

/// Whether a link is a floating base that limbs hang on, which is drawn as an area.
fn is_trunk(model: &Model, link: usize) -> bool {
    let limbs = model.links.iter().filter(|l| l.parent == Some(link)).count();
    link == 0 && model.base == BaseKind::Floating && limbs >= 3
}

/// The area between the joints on a floating base.
fn trunk(model: &Model, poses: &[Pose], view: &View, marked: &Marks) -> String {
    let hips = (0..model.links.len()).filter(|&l| model.links[l].parent == Some(0));
    let corners: Vec<[f64; 2]> = hips.map(|l| view.at(poses[l].position)).collect();
    if !is_trunk(model, 0) {
        return String::new();
    }
    let points: Vec<String> = around(corners).iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    let class = if marked.links.contains(&0) { "trunk marked" } else { "trunk" };
    format!("<polygon class=\"{class}\" points=\"{}\"/>", points.join(" "))
}

/// Points in the order of their directions from their middle.
fn around(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let count = points.len().max(1) as f64;
    let middle = [0, 1].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / count);
    let angle = |p: &[f64; 2]| (p[1] - middle[1]).atan2(p[0] - middle[0]);
    points.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    points
}

/// Positions at the start of the recording where it is kept, else zero within the limits.
fn posture(model: &Model, traces: &Traces) -> Vec<f64> {
    let mut q = match model.base {
        BaseKind::Floating => vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        BaseKind::Fixed => Vec::new(),
    };
    let measured = traces.windows.first().map(|w| &w.measured.position);
    for joint in &model.joints {
        let column = traces.joints.iter().position(|name| *name == joint.name);
        let known = measured.zip(column).and_then(|(row, column)| row.get(column).copied());
        let middle = 0.0_f64.max(joint.lower).min(joint.upper);
        q.push(known.filter(|x| x.is_finite()).unwrap_or(middle));
    }
    q
}

/// From each link's origin to the joints on it, and to the end of a link without any.
fn limbs(model: &Model, poses: &[Pose]) -> Vec<Limb> {
    let mut all = Vec::new();
    for (l, link) in model.links.iter().enumerate() {
        let from = poses[l].position;
        let children: Vec<usize> = (0..model.links.len()).filter(|&c| model.links[c].parent == Some(l)).collect();
        all.extend(children.iter().map(|&c| Limb { link: l, from, to: poses[c].position }));
        if children.is_empty() {
            all.push(Limb { link: l, from, to: poses[l].transform_point(end(model, l)) });
        }
        // What stands on the world is joined to where it stands.
        if link.parent.is_none() && model.base == BaseKind::Fixed {
            all.push(Limb { link: usize::MAX, from: DVec3::ZERO, to: from });
        }
    }
    all
}

/// Farthest middle of a shape or frame on a link, in its frame; twice its centre of mass where it has neither.
fn end(model: &Model, link: usize) -> DVec3 {
    let reach = |shape: &Shape| {
        if let Shape::Capsule { half_length, .. } | Shape::Cylinder { half_length, .. } = shape {
            *half_length
        } else {
            0.0
        }
    };
    let shapes = model.geoms.iter().filter(|g| g.link == link).flat_map(|g| {
        let along = DVec3::Z * reach(&g.shape);
        [g.link_from_geom.transform_point(along), g.link_from_geom.transform_point(-along)]
    });
    let frames = model.frames.iter().filter(|f| f.link == Some(link)).map(|f| f.link_from_frame.position);
    let farthest = shapes.chain(frames).max_by(|a, b| a.length().total_cmp(&b.length()));
    farthest.filter(|p| p.length() > 1e-6).unwrap_or(2.0 * model.links[link].com)
}

/// Where things are on the picture.
struct View {
    scale: f64,
    middle: [f64; 2],
}

impl View {
    /// All limbs within the picture; `None` where they have no size.
    fn of(limbs: &[Limb]) -> Option<Self> {
        let points: Vec<[f64; 2]> = limbs.iter().flat_map(|l| [l.from, l.to]).map(projected).collect();
        let [x, y] = [range(points.iter().map(|p| p[0]))?, range(points.iter().map(|p| p[1]))?];
        let fits = |[low, high]: [f64; 2], pixels: f64| (pixels - 2.0 * BORDER) / (high - low).max(1e-9);
        let scale = fits(x, WIDTH).min(fits(y, HEIGHT));
        let has_size = (x[1] - x[0]).max(y[1] - y[0]) > 1e-6;
        has_size.then_some(Self { scale, middle: [0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])] })
    }

    fn at(&self, point: DVec3) -> [f64; 2] {
        let [x, y] = projected(point);
        [0.5 * WIDTH + self.scale * (x - self.middle[0]), 0.5 * HEIGHT - self.scale * (y - self.middle[1])]
    }
}

/// Right and up of a point as it is seen.
fn projected(p: DVec3) -> [f64; 2] {
    let (sin, cos) = AZIMUTH.sin_cos();
    let (right, depth) = (cos * p.x - sin * p.y, sin * p.x + cos * p.y);
    [right, ELEVATION.cos() * p.z + ELEVATION.sin() * depth]
}

/// What a cause acts on.
#[derive(Default)]
struct Marks {
    joints: BTreeSet<usize>,
    links: BTreeSet<usize>,
    /// Why nothing of the robot is marked.
    elsewhere: Option<&'static str>,
    has_cause: bool,
}

impl Marks {
    fn of(model: &Model, cause: &Cause, library: &[Effect]) -> Self {
        let kind = library.iter().find(|e| e.name == cause.effect).map(|e| e.scope);
        let is_named = |name: &str| {
            cause.scope.iter().any(|scope| {
                let is_all = scope == "all" && !matches!(kind, Some(Scope::Ground | Scope::World));
                is_all || scope == name || (scope.len() <= 3 && name.starts_with(&format!("{scope}_")))
            })
        };
        let mut marked = Self { has_cause: true, ..Self::default() };
        match kind {
            Some(Scope::Feet) => {
                marked.links.extend(model.geoms.iter().filter(|g| is_named(&g.name)).map(|g| g.link));
            }
            Some(Scope::Base) if model.base == BaseKind::Floating => _ = marked.links.insert(0),
            Some(Scope::Links | Scope::Base) => {
                marked.links.extend((0..model.links.len()).filter(|&l| is_named(&model.links[l].name)))
            }
            Some(Scope::Ground) => marked.elsewhere = Some("the terrain, not a part of the robot"),
            Some(Scope::World) => marked.elsewhere = Some("the robot as a whole"),
            Some(Scope::Joints) | None => {}
        }
        if marked.links.is_empty() && marked.elsewhere.is_none() {
            marked.joints.extend((0..model.joints.len()).filter(|&j| is_named(&model.joints[j].name)));
            marked.links.extend((0..model.links.len()).filter(|&l| kind.is_none() && is_named(&model.links[l].name)));
        }
        marked
    }

    /// What is marked, as HTML.
    fn text(&self, model: &Model) -> String {
        let joints = self.joints.iter().map(|&j| model.joints[j].name.as_str());
        let names: Vec<&str> = joints.chain(self.links.iter().map(|&l| model.links[l].name.as_str())).collect();
        let is_all = self.joints.len() > 1 && self.joints.len() == model.joints.len();
        match (self.elsewhere, names.len()) {
            (Some(what), _) => format!("The cause acts on {what}."),
            _ if is_all => "The cause acts on all joints (marked).".into(),
            (None, 0) if self.has_cause => "The cause has no place on the robot.".into(),
            (None, 0) => "No place is marked: no effect is identified.".into(),
            (None, 1..=NAMES) => format!("The cause acts on {} (marked).", escape(&names.join(", "))),
            (None, count) => format!("The cause acts on {count} parts (marked)."),
        }
    }
}

/// Names beside few marks.
fn names(model: &Model, poses: &[Pose], marked: &Marks, view: &View) -> String {
    let joints = marked.joints.iter().map(|&j| (model.joints[j].name.as_str(), poses[model.joints[j].link].position));
    let links =
        marked.links.iter().map(|&l| (model.links[l].name.as_str(), poses[l].transform_point(model.links[l].com)));
    let all: Vec<(&str, DVec3)> = joints.chain(links).collect();
    if all.len() > NAMES {
        return String::new();
    }
    let one = |(name, place): &(&str, DVec3)| {
        let [x, y] = view.at(*place);
        // Names stay within the picture.
        let (anchor, x) = if x > 0.6 * WIDTH { ("end", x - 11.0) } else { ("start", x + 11.0) };
        format!(
            "<text class=\"label halo\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>",
            y + 4.0,
            escape(name)
        )
    };
    all.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::library::built_in;

    fn cause(effect: &str, scope: &[&str]) -> Cause {
        Cause {
            effect: effect.into(),
            score: 0.9,
            scope: scope.iter().map(|s| (*s).into()).collect(),
            parameters: Vec::new(),
            closed_alone: f64::NAN,
            confusable_with: Vec::new(),
            separating_experiment: String::new(),
            by_recording: Vec::new(),
        }
    }

    fn go2() -> Model {
        let options = qv_sim::ModelOptions { base: BaseKind::Floating, ..Default::default() };
        Model::from_urdf(&qv_go2::model::urdf(), &options).unwrap()
    }

    fn drawn(effect: &str, scope: &[&str]) -> String {
        robot(&go2(), &Traces::default(), Some(&cause(effect, scope)), &built_in())
    }

    #[test]
    fn the_part_that_is_named_is_marked() {
        let of_leg = drawn("joint_coulomb_friction", &["FL"]);
        assert_eq!(of_leg.matches("pin marked").count(), 3, "{of_leg}");
        let of_joint = drawn("joint_coulomb_friction", &["FR_calf_joint"]);
        assert!(
            of_joint.matches("pin marked").count() == 1 && of_joint.contains(">FR_calf_joint</text>"),
            "{of_joint}"
        );
        assert_eq!(drawn("joint_coulomb_friction", &["all"]).matches("pin marked").count(), 12);
        assert!(drawn("ground_friction", &["all"]).contains("the terrain"), "{}", drawn("ground_friction", &["all"]));
    }

    #[test]
    fn without_a_cause_the_robot_is_drawn_and_nothing_is_marked() {
        let html = robot(&go2(), &Traces::default(), None, &built_in());
        assert!(
            html.contains("<polygon class=\"trunk\"")
                && html.contains("<line class=\"limb\"")
                && !html.contains("marked\"")
                && !html.contains("NaN"),
            "{html}"
        );
    }
}
