//! Many places: drawn ones, and scenes beside them.

use super::place::Place;
use crate::Failure;
use crate::outcome::about;
use qv_core::random::Xoshiro256PlusPlus;
use qv_nav::eye::{Eye, Paints};
use qv_nav::goals::{Goal, GoalKind, GoalSet};
use qv_nav::places::{Site, hash_of};
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// File in the results of a training that says in which places it was.
pub(super) const TRAINED: &str = "places.json";

/// Which places.
#[derive(clap::Args)]
pub(super) struct Many {
    /// Draw N yards and rooms from seeds instead of, or beside, a scene
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(0..=1_000_000), help_heading = "Input")]
    pub(super) places: Option<u64>,
    /// Add a scene with its mesh, and its floor height, as another place
    ///
    /// Such as `kitchen/scene.ply,kitchen/mesh.glb` or `kitchen/scene.ply,kitchen/mesh.glb,0.02` (m).
    #[arg(long, value_name = "SCENE,MESH[,FLOOR]", num_args = 1.., help_heading = "Input")]
    pub(super) with_scene: Vec<ScenePlace>,
}

/// A scene with its mesh.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ScenePlace {
    pub(super) scene: PathBuf,
    pub(super) mesh: PathBuf,
    pub(super) floor: Option<f64>,
}

impl FromStr for ScenePlace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<&str> = text.split(',').collect();
        let wrong = || format!("expected SCENE,MESH or SCENE,MESH,FLOOR, found `{text}`");
        let (scene, mesh, floor) = match parts[..] {
            [scene, mesh] => (scene, mesh, None),
            [scene, mesh, floor] => (scene, mesh, Some(super::place::finite(floor)?)),
            _ => return Err(wrong()),
        };
        if scene.is_empty() || mesh.is_empty() {
            return Err(wrong());
        }
        Ok(Self { scene: scene.into(), mesh: mesh.into(), floor })
    }
}

impl Many {
    /// Whether many places are asked for.
    pub(super) fn is_asked(&self) -> bool {
        self.places.is_some() || !self.with_scene.is_empty()
    }

    /// The files that are read.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.with_scene.iter().flat_map(|given| [&given.scene, &given.mesh])
    }

    /// The scenes as places, with goals that are drawn; or with the cones of a network that knows goals by name.
    pub(super) fn scenes(&self, place: &Place, goals: Option<GoalKind>, paints: &Paints) -> Result<Vec<Site>, Failure> {
        self.with_scene.iter().map(|given| site(given, place, goals, paints)).collect()
    }
}

/// Goals of a scene that is given.
const GOALS: usize = 16;

fn site(given: &ScenePlace, place: &Place, goals: Option<GoalKind>, paints: &Paints) -> Result<Site, Failure> {
    let map = super::place::map_at(&given.mesh, given.floor)?;
    let eye = place.eye(&given.scene, &map, paints)?;
    let bytes = |path: &Path| fs::read(path).map_err(|e| about(path, e));
    let hash = hash_of(bytes(&given.scene)?.into_iter().chain(bytes(&given.mesh)?));
    let (set, eye): (GoalSet, Box<dyn Eye>) = match goals {
        None => (GoalSet::named(), Box::new(eye)),
        Some(kind) => {
            let goals = Goal::draw(kind, GOALS, &mut Xoshiro256PlusPlus::of(place.seed, 73, hash));
            let eye = eye.having(&goals, place.seed);
            (GoalSet::of(goals), Box::new(eye))
        }
    };
    let name = given.scene.display().to_string();
    let rig = place.rig()?;
    let site = Site::given((name, hash), map, (rig, place.teacher(&rig)), set, eye);
    site.map_err(|e| {
        about(&given.mesh, format!("{e}; a third part of --with-scene sets the height of a floor that it lacks"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_of_the_command_line() {
        let given: ScenePlace = "a/s.ply,a/m.glb,0.1".parse().unwrap();
        assert_eq!((given.mesh, given.floor), (PathBuf::from("a/m.glb"), Some(0.1)));
        assert_eq!("s.ply,m.glb".parse::<ScenePlace>().unwrap().floor, None);
        for bad in ["", "s.ply", "s.ply,", "s.ply,m.glb,x", "a,b,1,2"] {
            assert!(bad.parse::<ScenePlace>().is_err(), "{bad}");
        }
    }
}
