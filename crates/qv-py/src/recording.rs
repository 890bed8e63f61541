//! Recordings as columns of numpy.

use crate::errors::opening;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use qv_core::JointSeries;
use qv_open::Reading;
use qv_recording::Run;
use qv_recording::run::{Base, Robot};
use std::path::PathBuf;

/// What a robot recorded.
#[pyclass(frozen, module = "quadverse._quadverse")]
pub struct Recording {
    pub run: Run,
    pub path: PathBuf,
    pub robot: Option<String>,
}

/// Reads a bag, a table, or a dataset of another program.
#[pyfunction]
#[pyo3(signature = (path, robot = None, pose_topic = None, namespace = None))]
pub fn open(
    py: Python<'_>,
    path: PathBuf,
    robot: Option<String>,
    pose_topic: Option<String>,
    namespace: Option<String>,
) -> PyResult<Recording> {
    let reading = Reading { pose_topic, robot: robot.clone(), namespace, fix: false };
    let run = py.detach(|| qv_open::open_run(&path, &reading, &|_, _| {})).map_err(opening)?;
    Ok(Recording { run, path, robot })
}

/// One channel: its times \[s\], shape `[T]`, and its values, shape `[T, columns]`.
type Channel<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// A table of numbers in the order of rows.
pub fn table<'py>(py: Python<'py>, values: &[f64], rows: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let columns = values.len().checked_div(rows).unwrap_or(0);
    PyArray1::from_slice(py, values).reshape([rows, columns])
}

#[pymethods]
impl Recording {
    #[getter]
    fn path(&self) -> String {
        self.path.display().to_string()
    }

    #[getter]
    fn robot(&self) -> Option<String> {
        match (&self.robot, &self.run.robot) {
            (Some(given), _) => Some(given.clone()),
            (None, Robot::Named(name)) => Some(name.clone()),
            (None, _) => None,
        }
    }

    #[getter]
    fn base(&self) -> &'static str {
        match self.run.base {
            Base::Free => "free",
            Base::Fixed => "fixed",
        }
    }

    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.run.joint_names.clone()
    }

    #[getter]
    fn foot_names(&self) -> Vec<String> {
        self.run.foot_names.clone()
    }

    #[getter]
    fn span(&self) -> (f64, f64) {
        let [from, to] = self.run.span();
        (from, to)
    }

    /// Channels that were recorded.
    #[getter]
    fn channels(&self) -> Vec<&'static str> {
        self.series().into_iter().filter(|(_, series)| series.is_some()).map(|(name, _)| name).collect()
    }

    fn channel<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Channel<'py>> {
        let found = self.series().into_iter().find(|(known, _)| *known == name).and_then(|(_, series)| series);
        let Some(series) = found else {
            let known = self.channels().join(", ");
            return Err(PyKeyError::new_err(format!("expected a channel of {known}, found `{name}`")));
        };
        Ok((PyArray1::from_slice(py, &series.time), table(py, &series.values, series.time.len())?))
    }

    /// What was lost of it or could not be used as it is, a line each.
    #[getter]
    fn lost(&self) -> Vec<String> {
        qv_open::lost_from(&self.run)
    }

    /// How it was read where that is not a matter of course, a line each.
    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.run.remarks.clone()
    }

    /// Faults of the data, as the text of a JSON list.
    fn faults_json(&self) -> String {
        serde_json::to_string(&self.run.faults).expect("faults are plain data")
    }
}

impl Recording {
    fn series(&self) -> [(&'static str, Option<&JointSeries>); 13] {
        let (measured, commands) = (&self.run.measured, &self.run.commands);
        [
            ("position", measured.position.as_ref()),
            ("velocity", measured.velocity.as_ref()),
            ("torque", measured.torque.as_ref()),
            ("gyro", measured.gyro.as_ref()),
            ("acceleration", measured.acceleration.as_ref()),
            ("orientation", measured.orientation.as_ref()),
            ("foot_force", measured.foot_force.as_ref()),
            ("base_pose", measured.base_pose.as_ref()),
            ("command.position", commands.position.as_ref()),
            ("command.velocity", commands.velocity.as_ref()),
            ("command.torque", commands.torque.as_ref()),
            ("command.kp", commands.kp.as_ref()),
            ("command.kd", commands.kd.as_ref()),
        ]
    }
}
