//! The navigation task of `qv-nav`, whose arrays are filled at every step.

use crate::errors::{opening, value};
use crate::render::Cloud;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use numpy::{PyArray2, PyArray4};
use pyo3::prelude::*;
use qv_nav::env::{ACTION, BESIDE, NavTask, PICTURE, TaskSettings};
use qv_nav::eye::SplatEye;
use qv_nav::legs::Effects;
use qv_nav::lens::LensSpread;
use qv_nav::map::{Map, MapSettings};
use qv_nav::net::{HEIGHT, WIDTH};
use qv_nav::sight::Rig;
use qv_nav::task::{End, Limits, PERIOD, Stratum};
use qv_nav::teacher::World;
use qv_nav::veils::{Air, without_veils};
use qv_open::ground::mesh_at;
use std::path::PathBuf;

/// Many robots that look for cones in a reconstructed place.
#[pyclass(module = "quadverse._quadverse")]
pub struct NavigationTask {
    task: NavTask,
    pictures: Vec<u8>,
    beside: Vec<f32>,
    rewards: Vec<f32>,
    ends: Vec<Option<End>>,
}

/// How cameras differ, by name.
fn spread(name: &str) -> PyResult<LensSpread> {
    match name {
        "wide" => Ok(LensSpread::wide()),
        "none" => Ok(LensSpread::none()),
        _ => Err(value(format!("camera: expected wide or none, found {name}"))),
    }
}

/// Where the goal is at the start, by name.
fn stratum(name: &str) -> PyResult<Stratum> {
    let known = [("in_view", Stratum::InView), ("turned", Stratum::Turned), ("hidden", Stratum::Hidden)];
    let found = known.iter().find(|(known, _)| *known == name).map(|(_, stratum)| *stratum);
    found.ok_or_else(|| value(format!("goals: expected in_view, turned or hidden, found {name}")))
}

#[pymethods]
impl NavigationTask {
    #[new]
    #[pyo3(signature = (cloud, mesh, n, seed, *, camera, hidden_effects, goals))]
    fn new(
        py: Python<'_>,
        cloud: &Cloud,
        mesh: PathBuf,
        n: usize,
        seed: u64,
        camera: &str,
        hidden_effects: bool,
        goals: Vec<String>,
    ) -> PyResult<Self> {
        let mut settings = TaskSettings { count: n, spread: spread(camera)?, ..TaskSettings::default() };
        settings.episodes.strata = goals.iter().map(|name| stratum(name)).collect::<PyResult<_>>()?;
        if hidden_effects {
            settings.effects = Effects::hidden();
        }
        let task = py.detach(|| {
            let mesh = mesh_at(&mesh, "a labelled mesh in GLB").map_err(opening)?;
            let map = Map::new(&mesh, &MapSettings::default()).map_err(value)?;
            let place = without_veils(cloud.gaussians(), &map, &Air::default());
            let eye = SplatEye::new(&place).as_made(Some(cloud.background()), cloud.is_antialiased());
            let world = World::new(map, Rig::default(), Limits::default());
            NavTask::new(world, Box::new(eye), settings, seed).map_err(value)
        })?;
        let (pictures, beside) = (vec![0; n * PICTURE], vec![0.0; n * BESIDE]);
        Ok(Self { task, pictures, beside, rewards: vec![0.0; n], ends: vec![None; n] })
    }

    fn __len__(&self) -> usize {
        self.task.count()
    }

    /// Rows, columns, colours of a picture.
    #[getter]
    fn picture_shape(&self) -> [usize; 3] {
        [HEIGHT, WIDTH, 3]
    }

    #[getter]
    fn state_size(&self) -> usize {
        BESIDE
    }

    #[getter]
    fn action_size(&self) -> usize {
        ACTION
    }

    /// Seconds of a step.
    #[getter]
    fn dt(&self) -> f64 {
        PERIOD
    }

    /// All episodes anew, with the random numbers of this seed.
    fn restart(&mut self, py: Python<'_>, seed: u64) -> PyResult<()> {
        let task = &mut self.task;
        py.detach(|| task.restart(seed)).map_err(value)
    }

    /// The next episode of those in the mask.
    fn reset(&mut self, py: Python<'_>, mask: PyReadonlyArray1<'_, bool>) -> PyResult<()> {
        let (task, mask) = (&mut self.task, mask.as_slice().map_err(value)?.to_vec());
        py.detach(|| task.reset(&mask)).map_err(value)
    }

    /// Pictures and the numbers beside them; of robots that are not in the mask, those of the last call.
    fn observe<'py>(&mut self, py: Python<'py>, mask: PyReadonlyArray1<'_, bool>) -> PyResult<ObservationArrays<'py>> {
        let mask = mask.as_slice().map_err(value)?.to_vec();
        let Self { task, pictures, beside, .. } = self;
        py.detach(|| task.observe(&mask, pictures, beside)).map_err(value)?;
        let n = task.count();
        let pictures = PyArray1::from_slice(py, pictures).reshape([n, HEIGHT, WIDTH, 3])?;
        Ok((pictures, PyArray1::from_slice(py, beside).reshape([n, BESIDE])?))
    }

    /// One step: rewards, and how the episode ended, as words; none for one that goes on. Nobody is reset.
    fn step<'py>(&mut self, py: Python<'py>, actions: PyReadonlyArray2<'_, f32>) -> PyResult<StepArrays<'py>> {
        let expected = [self.task.count(), ACTION];
        if actions.shape() != expected {
            return Err(value(format!("actions: expected the shape {expected:?}, found {:?}", actions.shape())));
        }
        let actions: Vec<f32> = actions.as_array().iter().copied().collect();
        let Self { task, rewards, ends, .. } = self;
        py.detach(|| task.step(&actions, rewards, ends)).map_err(value)?;
        Ok((PyArray1::from_slice(py, rewards), ends.iter().map(|end| end.map(End::name)).collect()))
    }

    /// The episode of a robot: the length of the shortest way to its goal [m], the goal's place [m], where it is at the
    /// start.
    fn episode(&self, env: usize) -> PyResult<(f64, [f64; 3], &'static str)> {
        if env >= self.task.count() {
            return Err(value(format!("environment: expected less than {}, found {env}", self.task.count())));
        }
        let episode = self.task.episode(env);
        Ok((episode.geodesic, episode.goal.place, episode.stratum.name()))
    }
}

/// Pictures, numbers beside them.
type ObservationArrays<'py> = (Bound<'py, PyArray4<u8>>, Bound<'py, PyArray2<f32>>);
/// Rewards, ends.
type StepArrays<'py> = (Bound<'py, PyArray1<f32>>, Vec<Option<&'static str>>);
