//! Names that MuJoCo has: what has another one, such as a misspelt joint, would be left out in silence.
//!
//! The names are those of MuJoCo 4.0's own schema (`mj_printSchema`), with some of earlier versions:
//! <https://mujoco.readthedocs.io/en/stable/XMLreference.html>. Only elements that are read here are looked at.

use super::tree::Tree;

/// Elements of MuJoCo that make bodies or shapes of others, and are not followed here.
pub(super) const MAKERS: [&str; 4] = ["composite", "flexcomp", "replicate", "attach"];

/// Elements inside of an element that is read.
const INSIDE: [(&str, &str); 9] = [
    (
        "mujoco",
        "compiler option size statistic visual default extension asset worldbody deformable contact tendon equality \
         actuator sensor custom keyframe",
    ),
    ("worldbody", OF_BODIES),
    ("body", OF_BODIES),
    ("frame", OF_BODIES),
    (
        "default",
        "default mesh texture material joint geom site camera light pair equality tendon general motor position velocity \
         intvelocity orientation pid damper cylinder muscle adhesion dcmotor plugin",
    ),
    ("asset", "mesh hfield skin texture material model"),
    ("compiler", "lengthrange"),
    ("option", "flag"),
    ("keyframe", "key"),
];

const OF_BODIES: &str =
    "body frame inertial joint freejoint geom site camera light plugin composite flexcomp replicate attach";

/// Attributes of an element that is read, with or without effect here.
const ATTRIBUTES: [(&str, &str); 16] = [
    (
        "compiler",
        "alignfree angle assetdir autolimits balanceinertia boundinertia boundmass conflict convexhull coordinate \
         discardvisual eulerseq exactmeshinertia fitaabb fusestatic inertiafromgeom inertiagrouprange meshdir passthrough \
         savecanonical savecompiled saveinertial settotalmass strippath texturedir usethread",
    ),
    ("default", "class"),
    (
        "mesh",
        "builtin class content_type face file inertia material maxhullvert name normal params refpos refquat scale \
         smoothnormal texcoord vertex",
    ),
    ("worldbody", OF_BODY),
    ("body", OF_BODY),
    ("frame", "axisangle childclass euler name pos quat xyaxes zaxis"),
    ("inertial", "axisangle diaginertia euler fullinertia mass pos quat xyaxes zaxis"),
    (
        "joint",
        "actuatorfrclimited actuatorfrcrange actuatorgravcomp armature axis class damping frictionloss group limited \
         margin name pos range ref solimpfriction solimplimit solreffriction solreflimit springdamper springref \
         springyield stiffness type user",
    ),
    ("freejoint", "align group name"),
    (
        "geom",
        "adhesion axisangle castshadow class conaffinity condim contype density euler fitscale fluidcoef fluidshape \
         friction fromto gap group hfield margin mass material mesh name pos priority quat rgba shellinertia size solimp \
         solmix solref surfacevel type user xyaxes zaxis",
    ),
    ("site", "axisangle class euler fromto group material mesh name pos quat rgba size type user xyaxes zaxis"),
    (
        "general",
        "actdim actearly actlimited actrange armature biasprm biastype body class cranklength cranksite ctrllimited \
         ctrlrange damping delay dynprm dyntype ffrange forcelimited forcerange gainprm gaintype gear group inheritrange \
         input interp joint jointinparent lengthrange name nsample refsite site slidersite tendon user velrange",
    ),
    ("motor", OF_ACTUATORS),
    ("position", OF_ACTUATORS),
    ("velocity", OF_ACTUATORS),
    ("key", "act ctrl mpos mquat name plastic qpos qvel time"),
];

const OF_BODY: &str = "axisangle childclass euler fuse gravcomp mocap name pos quat simple sleep user xyaxes zaxis";

const OF_ACTUATORS: &str = "armature class cranklength cranksite ctrllimited ctrlrange damping dampratio delay \
     forcelimited forcerange gear group inheritrange interp joint jointinparent kp kv lengthrange name nsample refsite \
     site slidersite tendon timeconst user";

fn names_of(table: &[(&str, &'static str)], tag: &str) -> Option<&'static str> {
    table.iter().find(|(own, _)| *own == tag).map(|(_, names)| *names)
}

fn has(names: &str, name: &str) -> bool {
    names.split_whitespace().any(|known| known == name)
}

/// A line for each element whose name is none of MuJoCo's, and for each such attribute of the elements of one tag.
pub(super) fn strange(tree: &Tree) -> Vec<String> {
    let mut elements = Vec::new();
    let mut attributes: Vec<(String, String, String, usize)> = Vec::new();
    let mut pending = vec![0];
    while let Some(index) = pending.pop() {
        let own = tree.element(index);
        if let Some(known) = names_of(&ATTRIBUTES, &own.tag) {
            for (name, _) in own.attributes.iter().filter(|(name, _)| !has(known, name)) {
                match attributes.iter_mut().find(|(tag, other, ..)| *tag == own.tag && other == name) {
                    Some((.., more)) => *more += 1,
                    None => {
                        let place = format!("{} {}", tree.label(index), tree.place(index));
                        attributes.push((own.tag.clone(), name.clone(), place, 0));
                    }
                }
            }
        }
        // What is inside of elements that are not read has no say.
        let Some(known) = names_of(&INSIDE, &own.tag) else {
            if own.tag == "actuator" && index != 0 {
                pending.extend(own.children.iter().rev().copied());
            }
            continue;
        };
        for &child in own.children.iter().rev() {
            let tag = &tree.element(child).tag;
            if has(known, tag) {
                pending.push(child);
            } else {
                let place = tree.place(child);
                elements.push(format!(
                    "{} in {} {place}: MuJoCo has no <{tag}> there",
                    tree.label(child),
                    tree.label(index)
                ));
            }
        }
    }
    let more = |count: usize| if count == 0 { String::new() } else { format!(" and {count} more") };
    let remarks = attributes.into_iter().map(|(tag, name, place, others)| {
        format!("attribute `{name}` of {place}{}: MuJoCo's <{tag}> has none of that name", more(others))
    });
    elements.extend(remarks);
    elements
}

/// Elements that make bodies and are not followed, as they are named in messages.
pub(super) fn makers(tree: &Tree) -> Vec<String> {
    let mut found = Vec::new();
    let mut pending: Vec<usize> = tree.sections("worldbody").collect();
    pending.reverse();
    while let Some(index) = pending.pop() {
        let own = tree.element(index);
        if MAKERS.contains(&own.tag.as_str()) {
            found.push(format!("{} {}", named(tree, index), tree.place(index)));
        } else {
            pending.extend(own.children.iter().rev().copied());
        }
    }
    found
}

/// The element with its tag, whose name alone says little.
fn named(tree: &Tree, index: usize) -> String {
    let tag = &tree.element(index).tag;
    tree.attribute(index, "name").map_or_else(|| format!("<{tag}>"), |name| format!("<{tag}> `{name}`"))
}
