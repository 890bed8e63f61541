//! The velocity task of `qv-policy`, whose arrays are filled at every step.

use crate::errors::value;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use qv_policy::env::{End, VectorEnv};
use qv_policy::velocity::{Ground, TaskSettings, observation_parts};

/// Many Go2 that learn to follow commanded velocities on a plane.
#[pyclass(module = "quadverse._quadverse")]
pub struct VelocityTask {
    task: qv_policy::velocity::VelocityTask,
    observations: Vec<f32>,
    privileged: Vec<f32>,
    rewards: Vec<f32>,
    ends: Vec<End>,
}

#[pymethods]
impl VelocityTask {
    #[new]
    fn new(py: Python<'_>, n: usize, seed: u64) -> PyResult<Self> {
        let task = py.detach(|| {
            let robot = qv_go2::walk::robot().map_err(value)?;
            let mut task = qv_policy::velocity::VelocityTask::new(robot, Ground::plane(), TaskSettings::default(), n)
                .map_err(value)?;
            task.restart(seed, 0).map_err(value)?;
            PyResult::Ok(task)
        })?;
        let (observations, privileged) = (vec![0.0; n * task.observations()], vec![0.0; n * task.privileged()]);
        Ok(Self { task, observations, privileged, rewards: vec![0.0; n], ends: vec![End::No; n] })
    }

    fn __len__(&self) -> usize {
        self.task.count()
    }

    #[getter]
    fn observation_size(&self) -> usize {
        self.task.observations()
    }

    #[getter]
    fn action_size(&self) -> usize {
        self.task.actions()
    }

    /// Seconds of a step.
    #[getter]
    fn dt(&self) -> f32 {
        self.task.settings().dt()
    }

    /// Seconds until the time of an episode is over.
    #[getter]
    fn episode(&self) -> f32 {
        self.task.settings().episode
    }

    /// Parts of an observation and their lengths.
    #[getter]
    fn observation_parts(&self) -> Vec<(&'static str, usize)> {
        let joints = self.task.actions();
        let parts = observation_parts(self.task.settings().clock);
        parts.into_iter().map(|(name, size)| (name, if size == 0 { joints } else { size })).collect()
    }

    /// Offset and scale that bring observations to the size of one.
    fn scaling<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<f32>>) {
        let (offset, scale) = self.task.observation_scaling();
        (PyArray1::from_vec(py, offset), PyArray1::from_vec(py, scale))
    }

    /// The same for what only a critic sees.
    fn privileged_scaling<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<f32>>) {
        let (offset, scale) = self.task.privileged_scaling();
        (PyArray1::from_vec(py, offset), PyArray1::from_vec(py, scale))
    }

    /// All episodes anew, with the random numbers of this seed.
    fn restart(&mut self, py: Python<'_>, seed: u64) -> PyResult<()> {
        let task = &mut self.task;
        py.detach(|| task.restart(seed, 0)).map_err(value)
    }

    fn reset(&mut self, mask: PyReadonlyArray1<'_, bool>) -> PyResult<()> {
        let mask = mask.as_slice().map_err(value)?;
        if mask.len() != self.task.count() {
            return Err(value(format!("mask: expected {} environments, found {}", self.task.count(), mask.len())));
        }
        self.task.reset(mask).map_err(value)
    }

    fn observe<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let Self { task, observations, privileged, .. } = self;
        py.detach(|| task.observe(observations, privileged));
        PyArray1::from_slice(py, observations).reshape([task.count(), task.observations()])
    }

    /// What only a critic should see, as it was when `observe` was called.
    fn privileged<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        PyArray1::from_slice(py, &self.privileged).reshape([self.task.count(), self.task.privileged()])
    }

    /// One step: rewards, who failed, whose time is over. Nobody is reset.
    fn step<'py>(&mut self, py: Python<'py>, actions: PyReadonlyArray2<'_, f32>) -> PyResult<StepArrays<'py>> {
        let expected = [self.task.count(), self.task.actions()];
        if actions.shape() != expected {
            return Err(value(format!("actions: expected the shape {expected:?}, found {:?}", actions.shape())));
        }
        let actions: Vec<f32> = actions.as_array().iter().copied().collect();
        if let Some(at) = actions.iter().position(|a| !a.is_finite()) {
            let (row, column) = (at / expected[1], at % expected[1]);
            return Err(value(format!("actions[{row}, {column}]: expected a finite number, found {}", actions[at])));
        }
        let Self { task, rewards, ends, .. } = self;
        py.detach(|| task.step(&actions, rewards, ends)).map_err(value)?;
        let ended = |how: End| PyArray1::from_vec(py, ends.iter().map(|&end| end == how).collect());
        Ok((PyArray1::from_slice(py, rewards), ended(End::Failed), ended(End::TimeOut)))
    }

    /// What is worth watching since the last call, by name: means over environments and steps.
    fn figures(&mut self) -> Vec<(&'static str, f32)> {
        self.task.figures()
    }
}

/// Rewards, failed, over.
type StepArrays<'py> = (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<bool>>);
