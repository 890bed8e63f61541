//! The place that a robot finds its way in, and what is to be done there.

use crate::Failure;
use crate::camera::open_camera;
use crate::outcome::about;
use crate::progress::remark;
use crate::scene::open_scene;
use qv_nav::eye::{Paints, SplatEye};
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::measured;
use qv_nav::sight::Rig;
use qv_nav::task::{EpisodeSettings, Limits, Stratum};
use qv_nav::teacher::{TeacherSettings, World};
use qv_nav::veils::{Air, without_veils};
use qv_open::ground::mesh_at;
use std::fs;
use std::path::{Path, PathBuf};

/// Farthest from the base that a camera may sit \[m\]: what is taller is no robot that walks among cones.
const REACH: f64 = 5.0;

/// Height of the base over the ground \[m\]; most four-legged robots of this size have about that.
pub(super) const HEIGHT: f64 = 0.3;

/// What is missing where no place is named.
const MISSING: &str =
    "expected FILE, found none: --scene and --terrain name a place, and --places N of train and test draws some";

/// The place.
#[derive(clap::Args)]
pub(super) struct Place {
    /// Read the Gaussian scene (PLY, SPZ, GLB, ...)
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    pub(super) scene: Option<PathBuf>,
    /// Set the terrain: the labelled mesh of the same scene
    #[arg(long = "terrain", value_name = "FILE.glb", alias = "mesh", help_heading = "Input")]
    pub(super) mesh: Option<PathBuf>,
    /// Assume this floor height where the mesh has no floor
    #[arg(long, value_name = "METRES", allow_hyphen_values = true, value_parser = finite, help_heading = "Advanced", hide_short_help = true)]
    pub(super) floor: Option<f64>,
    /// Read camera intrinsics and extrinsics (as `diagnose --camera`)
    #[arg(long, value_name = "FILE.toml", help_heading = "Input", hide_short_help = true)]
    pub(super) mount: Option<PathBuf>,
    /// Remove floaters higher than this above free ground; inf keeps all
    #[arg(long, value_name = "METRES", default_value_t = Air::default().from, value_parser = height, help_heading = "Advanced", hide_short_help = true)]
    pub(super) air: f64,
    /// Set the random seed
    #[arg(long, default_value_t = 0, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    pub(super) seed: u64,
}

/// What is to be done in it.
#[derive(clap::Args)]
pub(super) struct Task {
    #[command(flatten)]
    pub(super) place: Place,
    /// Set camera randomization: wide, none, or report.json
    ///
    /// A report.json of `qv diagnose --scene` sets the camera of the robot.
    #[arg(
        long,
        value_name = "wide|none|report.json",
        default_value = "wide",
        help_heading = "Training",
        hide_short_help = true
    )]
    pub(super) camera: String,
    /// Place cones in view, out of view (turned) or occluded (hidden)
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [Start::View, Start::Turned, Start::Hidden], help_heading = "What to test", hide_short_help = true)]
    pub(super) starts: Vec<Start>,
    /// Set the path length to a cone: least, greatest
    #[arg(long, value_name = "METRES,METRES", default_value = "2.5,7", value_parser = lengths, help_heading = "What to test", hide_short_help = true)]
    pub(super) distance: Lengths,
}

/// Where the cone is at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Start {
    /// In view
    View,
    /// Out of view: beside or behind the robot
    Turned,
    /// Occluded
    Hidden,
}

impl std::fmt::Display for Start {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Self::View => "view",
            Self::Turned => "turned",
            Self::Hidden => "hidden",
        })
    }
}

/// Two lengths \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lengths(pub(super) [f64; 2]);

/// How cameras differ, and how the camera sits.
fn camera(name: &str, rig: &Rig) -> Result<(LensSpread, Rig), Failure> {
    match name {
        "wide" => Ok((LensSpread::wide(), *rig)),
        "none" => Ok((LensSpread::none(), *rig)),
        _ if name.ends_with(".json") => {
            let file = Path::new(name);
            let text = fs::read_to_string(file).map_err(|e| about(file, e))?;
            let report = serde_json::from_str(&text).map_err(|e| about(file, format!("expected JSON, found {e}")))?;
            Ok(measured::camera(&report, rig).map_err(|e| about(file, e))?)
        }
        _ => Err(format!("--camera: expected wide, none or a report.json, found `{name}`").into()),
    }
}

fn lengths(text: &str) -> Result<Lengths, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|x| x.trim().parse().ok()).collect();
    match numbers[..] {
        [least, most] if text.matches(',').count() == 1 && least > 0.0 && least < most && most.is_finite() => {
            Ok(Lengths([least, most]))
        }
        _ => Err(format!("expected two lengths in metres, the first less, such as 2.5,7, found `{text}`")),
    }
}

/// Where a robot can go on the mesh of a file.
pub(super) fn map_at(mesh: &Path, floor: Option<f64>) -> Result<Map, Failure> {
    let read = mesh_at(mesh, "a labelled mesh in GLB")?;
    Map::new(&read, &MapSettings { floor, ..Default::default() }).map_err(|e| {
        let hint = "--floor METRES sets the height of a floor that the mesh lacks";
        about(mesh, if floor.is_none() { format!("{e}; {hint}") } else { e.to_string() })
    })
}

/// A height of the floor, from the command line \[m\].
pub(super) fn finite(text: &str) -> Result<f64, String> {
    let found = text.trim().parse::<f64>().ok().filter(|h| h.abs() < 1e4);
    found.ok_or_else(|| format!("expected a height in metres, of less than 10 km, found `{text}`"))
}

/// A height above the ground, from the command line \[m\].
fn height(text: &str) -> Result<f64, String> {
    let found = text.trim().parse::<f64>().ok().filter(|h| *h > 0.0);
    found.ok_or_else(|| format!("expected a height above 0 in metres, or inf, found `{text}`"))
}

impl Task {
    pub(super) fn episodes(&self) -> EpisodeSettings {
        let stratum = |start: &Start| match start {
            Start::View => Stratum::InView,
            Start::Turned => Stratum::Turned,
            Start::Hidden => Stratum::Hidden,
        };
        let strata = self.starts.iter().map(stratum).collect();
        EpisodeSettings { geodesic: self.distance.0, strata, ..Default::default() }
    }

    /// The place; in a training, its Gaussians are painted otherwise from episode to episode.
    pub(super) fn open(&self, paints: &Paints) -> Result<(World, SplatEye, LensSpread), Failure> {
        let (spread, rig) = camera(&self.camera, &self.place.rig()?)?;
        let (world, eye) = self.place.seen(rig, paints)?;
        let mesh = self.place.mesh()?;
        self.episodes().draw(&world, self.starts.len(), self.place.seed).map_err(|e| {
            about(
                mesh,
                format!("{e}; --starts and --distance say which episodes there are, such as --starts view,turned"),
            )
        })?;
        Ok((world, eye, spread))
    }
}

impl Place {
    /// How the stated camera sits.
    pub(super) fn rig(&self) -> Result<Rig, Failure> {
        let Some(file) = &self.mount else { return Ok(Rig::default()) };
        let camera = open_camera(file, None)?.rig;
        let focal = camera.intrinsics.fx * 640.0 / f64::from(camera.intrinsics.width);
        if !(focal > 10.0 && focal < 1e4) {
            return Err(about(file, format!("expected fx of 10 to 10000 px for 640 columns, found {focal}")));
        }
        let place = camera.base_from_camera.position;
        if !(place.length() < REACH && place.z > -HEIGHT) {
            let expected = format!("a camera above the ground, within {REACH} m of the base");
            return Err(about(file, format!("base_from_camera: expected {expected}, found {place}")));
        }
        Ok(Rig::default().mounted(&camera.base_from_camera, focal))
    }

    /// The files that are read.
    pub(super) fn files(&self) -> Vec<&PathBuf> {
        self.scene.iter().chain(&self.mesh).chain(&self.mount).collect()
    }

    /// The place, whether or not an episode can be drawn in it.
    pub(super) fn seen(&self, rig: Rig, paints: &Paints) -> Result<(World, SplatEye), Failure> {
        let map = map_at(self.mesh()?, self.floor)?;
        let eye = self.eye(self.scene()?, &map, paints)?;
        Ok((World::with(map, rig, Limits::default(), self.teacher(&rig)), eye))
    }

    /// How the expert drives with such a camera.
    pub(super) fn teacher(&self, rig: &Rig) -> TeacherSettings {
        let usual = TeacherSettings::default();
        // A camera on a mast looks over what hides a cone from a dog.
        let over = if self.mount.is_some() { HEIGHT + rig.place[2] } else { usual.eye };
        TeacherSettings { eye: over, ..usual }
    }

    /// The scene that was named.
    pub(super) fn scene(&self) -> Result<&PathBuf, Failure> {
        self.scene.as_ref().ok_or_else(|| MISSING.replace("FILE", "--scene FILE").into())
    }

    /// The mesh that was named.
    pub(super) fn mesh(&self) -> Result<&PathBuf, Failure> {
        self.mesh.as_ref().ok_or_else(|| MISSING.replace("FILE", "--terrain FILE.glb").into())
    }

    /// A scene of the place as it is drawn.
    pub(super) fn eye(&self, file: &Path, map: &Map, paints: &Paints) -> Result<SplatEye, Failure> {
        let opened = open_scene(file)?;
        let scene = opened.cloud;
        let [low, high] = map.bounds();
        let is_over = |[x, y, _]: &[f32; 3]| {
            (low.x..=high.x).contains(&f64::from(*x)) && (low.y..=high.y).contains(&f64::from(*y))
        };
        if !scene.means.iter().any(is_over) {
            let expected = format!(
                "Gaussians over the mesh, at x {:.1} to {:.1} m, y {:.1} to {:.1} m",
                low.x, high.x, low.y, high.y
            );
            return Err(about(file, format!("expected {expected}, found none of {} there", scene.len())));
        }
        let cloud = without_veils(&scene, map, &Air { from: self.air, ..Air::default() });
        match scene.len() - cloud.len() {
            0 => {}
            hang => remark(&format!(
                "{}: {hang} of {} Gaussians hang more than {} m over free ground and are left out (--air)",
                file.display(),
                scene.len(),
                self.air
            )),
        }
        let eye = SplatEye::painted(&cloud, paints, self.seed).as_made(opened.background, opened.antialias);
        if eye.count() > 200_000 {
            remark(&format!(
                "{}: with so many Gaussians pictures take long, and a GPU holds them eight times",
                file.display()
            ));
        }
        Ok(eye)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn cameras_and_lengths() {
        let rig = Rig::default();
        assert_eq!(camera("none", &rig).unwrap().0, LensSpread::none());
        assert_eq!(lengths("1.2, 2.5"), Ok(Lengths([1.2, 2.5])));
        for bad in ["", "3", "3,2", "1,2,3", "a,2", "1,inf", "-1,2"] {
            assert!(lengths(bad).unwrap_err().states("lengths"), "{bad}");
        }
        assert!(camera("posterior", &rig).unwrap_err().to_string().states("report.json"));
        assert!(camera("no/report.json", &rig).unwrap_err().to_string().contains("no/report.json"));
    }
}
