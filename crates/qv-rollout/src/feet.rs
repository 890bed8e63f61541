//! Which shapes of a robot are its feet, and which joints move each.

use qv_recording::Run;
use qv_sim::{BaseKind, Model, Shape};

/// Feet of a robot: shapes that touch the ground.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Feet {
    /// Names, such as `FL`.
    pub names: Vec<String>,
    /// Shape of each foot in the model.
    pub geoms: Vec<usize>,
    /// Foot of each joint; `None` for a joint of no leg.
    pub of_joint: Vec<Option<usize>>,
}

/// Feet by the run's names (the shape on a link of that prefix that reaches lowest; joints by the same prefix), or, where it names
/// none and the base is free, the spheres at the ends of the model's legs.
pub fn feet_of(run: &Run, model: &Model) -> Feet {
    if run.foot_names.is_empty() && model.base == BaseKind::Floating {
        return feet_of_model(model);
    }
    let mut feet = Feet { of_joint: vec![None; model.joints.len()], ..Default::default() };
    for name in &run.foot_names {
        let prefix = format!("{name}_");
        let Some(geom) = lowest_sphere(model, |link| model.links[link].name.starts_with(&prefix)) else { continue };
        for (_, foot) in model.joint_names().iter().zip(&mut feet.of_joint).filter(|(n, _)| n.starts_with(&prefix)) {
            *foot = Some(feet.names.len());
        }
        feet.names.push(name.clone());
        feet.geoms.push(geom);
    }
    feet
}

/// A foot for each chain of joints that ends in a sphere, called by the first word of its link (`FL` of `FL_calf`) where that is no other's.
pub fn feet_of_model(model: &Model) -> Feet {
    let mut feet = Feet { of_joint: vec![None; model.joints.len()], ..Default::default() };
    let ends = (1..model.links.len()).filter(|&l| model.links.iter().all(|other| other.parent != Some(l)));
    let ends: Vec<(usize, usize)> = ends.filter_map(|l| Some((l, lowest_sphere(model, |link| link == l)?))).collect();
    let word = |link: usize| model.links[link].name.split('_').next().unwrap_or_default();
    for &(end, geom) in &ends {
        let is_own = ends.iter().filter(|(other, _)| word(*other) == word(end)).count() == 1;
        let name = if is_own { word(end) } else { &model.links[end].name };
        let mut link = Some(end);
        while let Some(l) = link {
            if let Some(joint) = model.links[l].joint.filter(|j| feet.of_joint[*j].is_none()) {
                feet.of_joint[joint] = Some(feet.names.len());
            }
            link = model.links[l].parent;
        }
        feet.names.push(name.to_string());
        feet.geoms.push(geom);
    }
    feet
}

/// The sphere on the wanted links that reaches lowest when all joints are at zero.
fn lowest_sphere(model: &Model, wanted: impl Fn(usize) -> bool) -> Option<usize> {
    let poses = model.world_from_links(&vec![0.0; model.nq()]);
    let depth = |g: &usize| {
        let geom = &model.geoms[*g];
        poses[geom.link].transform_point(geom.link_from_geom.position).z
    };
    let spheres = (0..model.geoms.len())
        .filter(|&g| wanted(model.geoms[g].link) && matches!(model.geoms[g].shape, Shape::Sphere(_)));
    spheres.min_by(|a, b| depth(a).total_cmp(&depth(b)))
}
