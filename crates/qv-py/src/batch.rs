//! Many environments of one robot. The engine keeps an environment in a lane of a register, so that its numbers lie apart in
//! memory: arrays of Python cannot be views of them. They are made once by `bind`, and every `step` reads or fills them.

use crate::errors::{opening, value};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use qv_open::{ground, robot_model};
use qv_sim::{BaseKind, BatchCommand, SimError, SimOptions, State};

type Array = Py<PyArray2<f32>>;

/// Bytes that an environment of the smallest robot takes.
const LEAST_BYTES: usize = 1024;

/// What an array can hold, and whether the engine reads it before a step or fills it after.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Name {
    Qpos,
    Qvel,
    Qacc,
    Torque,
    GeomForce,
    Encoder,
    EncoderSpeed,
    Gyro,
    Accelerometer,
    Orientation,
    Ctrl,
    CtrlSpeed,
    Kp,
    Kd,
    CtrlTorque,
    AddedTorque,
}

const NAMES: [(&str, Name); 16] = [
    ("qpos", Name::Qpos),
    ("qvel", Name::Qvel),
    ("qacc", Name::Qacc),
    ("torque", Name::Torque),
    ("geom_force", Name::GeomForce),
    ("encoder", Name::Encoder),
    ("encoder_speed", Name::EncoderSpeed),
    ("gyro", Name::Gyro),
    ("accelerometer", Name::Accelerometer),
    ("imu_orientation", Name::Orientation),
    ("ctrl", Name::Ctrl),
    ("ctrl_speed", Name::CtrlSpeed),
    ("kp", Name::Kp),
    ("kd", Name::Kd),
    ("ctrl_torque", Name::CtrlTorque),
    ("added_torque", Name::AddedTorque),
];

impl Name {
    fn of(text: &str) -> PyResult<Self> {
        let known: Vec<&str> = NAMES.iter().map(|(name, _)| *name).collect();
        NAMES
            .iter()
            .find(|(name, _)| *name == text)
            .map(|(_, name)| *name)
            .ok_or_else(|| PyKeyError::new_err(format!("expected an array of {}, found `{text}`", known.join(", "))))
    }

    fn is_input(self) -> bool {
        use Name::*;
        matches!(self, Ctrl | CtrlSpeed | Kp | Kd | CtrlTorque | AddedTorque)
    }

    /// Whether it is one of the three that the engine reads at once.
    fn is_imu(self) -> bool {
        matches!(self, Self::Gyro | Self::Accelerometer | Self::Orientation)
    }

    fn is_encoder(self) -> bool {
        matches!(self, Self::Encoder | Self::EncoderSpeed)
    }
}

/// A copy of all states and parameters of a batch.
#[pyclass(frozen, module = "quadverse._quadverse")]
pub struct Snapshot(qv_sim::Snapshot<f32>);

/// Many environments of one robot on one ground.
#[pyclass(module = "quadverse._quadverse", subclass)]
pub struct Batch {
    sim: qv_sim::Batch<f32>,
    /// Arrays that were bound, inputs and outputs.
    bound: Vec<(Name, Array)>,
    /// Where encoders and IMU are read together before they go to the arrays that are bound.
    passing: [Vec<f32>; 3],
}

#[pymethods]
impl Batch {
    #[new]
    #[pyo3(signature = (robot, n, terrain = "plane", *, base = "free", timestep = 0.001, max_command_latency = 0.0, keep_contacts = false, self_collision = false))]
    fn new(
        py: Python<'_>,
        robot: &str,
        n: usize,
        terrain: &str,
        base: &str,
        timestep: f64,
        max_command_latency: f64,
        keep_contacts: bool,
        self_collision: bool,
    ) -> PyResult<Self> {
        let base = match base {
            "free" => BaseKind::Floating,
            "fixed" => BaseKind::Fixed,
            other => return Err(value(format!("base: expected free or fixed, found `{other}`"))),
        };
        // A number that no memory holds would end the program.
        let least = n.checked_mul(LEAST_BYTES).is_some_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok());
        if !least {
            return Err(value(format!("n: expected as many environments as the memory holds, found {n}")));
        }
        let options =
            SimOptions { timestep, max_command_latency, keep_contacts, self_collision, ..SimOptions::default() };
        let sim = py.detach(|| {
            let model = robot_model(robot, base).map_err(opening)?;
            let terrain = ground::terrain_of(terrain).map_err(opening)?;
            qv_sim::Batch::new(&model, &terrain, &options, n).map_err(value)
        })?;
        Ok(Self { sim, bound: Vec::new(), passing: Default::default() })
    }

    fn __len__(&self) -> usize {
        self.sim.len()
    }

    #[getter]
    fn nq(&self) -> usize {
        self.sim.model().nq()
    }

    #[getter]
    fn nv(&self) -> usize {
        self.sim.model().nv()
    }

    #[getter]
    fn timestep(&self) -> f64 {
        self.sim.options().timestep
    }

    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.sim.model().joint_names().to_vec()
    }

    #[getter]
    fn geom_names(&self) -> Vec<String> {
        self.sim.model().geoms.iter().map(|g| g.name.clone()).collect()
    }

    #[getter]
    fn link_names(&self) -> Vec<String> {
        self.sim.model().links.iter().map(|l| l.name.clone()).collect()
    }

    /// How the robot's file was read, and what was left out of it.
    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.sim.model().remarks.iter().chain(&self.sim.model().left_out).cloned().collect()
    }

    #[pyo3(signature = (name, *, writable = false))]
    fn bind<'py>(&mut self, py: Python<'py>, name: &str, writable: bool) -> PyResult<Bound<'py, PyAny>> {
        let name = Name::of(name)?;
        let array = match self.find(name) {
            Some(array) => array.clone_ref(py),
            None => self.make(py, name)?,
        };
        if name.is_input() || writable {
            return Ok(array.into_bound(py).into_any());
        }
        // A view that Python may not write to: what is written there would never reach the engine. Other libraries take no
        // such views through DLPack.
        let view = array.bind(py).call_method0("view")?;
        let flags = PyDict::new(py);
        flags.set_item("write", false)?;
        view.call_method("setflags", (), Some(&flags))?;
        Ok(view)
    }

    #[pyo3(signature = (n = 1))]
    fn step(&mut self, py: Python<'_>, n: usize) -> PyResult<()> {
        self.read_inputs(py)?;
        let sim = &mut self.sim;
        py.detach(|| sim.step_many_parallel(n));
        self.fill(py)
    }

    #[pyo3(signature = (qpos, qvel = None, environments = None))]
    fn set_state(
        &mut self,
        py: Python<'_>,
        qpos: PyReadonlyArray2<'_, f64>,
        qvel: Option<PyReadonlyArray2<'_, f64>>,
        environments: Option<Vec<usize>>,
    ) -> PyResult<()> {
        let which = environments.unwrap_or_else(|| (0..self.sim.len()).collect());
        let rows = |array: &PyReadonlyArray2<'_, f64>, what: &str, width: usize| {
            let shape = [array.shape()[0], array.shape()[1]];
            if shape != [which.len(), width] {
                let expected = format!("{what}: expected the shape ({}, {width})", which.len());
                return Err(value(format!("{expected}, found ({}, {})", shape[0], shape[1])));
            }
            Ok(array.as_array().iter().copied().collect::<Vec<f64>>())
        };
        let (nq, nv) = (self.nq(), self.nv());
        let q = rows(&qpos, "qpos", nq)?;
        let v = qvel.map(|v| rows(&v, "qvel", nv)).transpose()?.unwrap_or_else(|| vec![0.0; nv * which.len()]);
        for (row, &env) in which.iter().enumerate() {
            let state = State { q: q[nq * row..][..nq].to_vec(), v: v[nv * row..][..nv].to_vec() };
            self.sim.set_state(env, &state).map_err(value)?;
        }
        self.fill(py)
    }

    fn snapshot(&self) -> Snapshot {
        Snapshot(self.sim.snapshot())
    }

    fn restore(&mut self, py: Python<'_>, snapshot: &Snapshot) -> PyResult<()> {
        self.sim.restore(&snapshot.0).map_err(value)?;
        self.fill(py)
    }

    fn contacts<'py>(&self, py: Python<'py>, environment: usize) -> PyResult<Bound<'py, PyDict>> {
        let all = self.sim.contacts(environment).map_err(value)?;
        let table = PyDict::new(py);
        let vectors = |of: fn(&qv_sim::ContactPoint) -> [f64; 3]| {
            let flat: Vec<f64> = all.iter().flat_map(of).collect();
            PyArray1::from_vec(py, flat).reshape([all.len(), 3])
        };
        table.set_item("geom", PyArray1::from_vec(py, all.iter().map(|c| c.geom as i64).collect()))?;
        table.set_item("link", PyArray1::from_vec(py, all.iter().map(|c| c.link as i64).collect()))?;
        let other = all.iter().map(|c| c.other.map_or(-1, |link| link as i64)).collect();
        table.set_item("other", PyArray1::from_vec(py, other))?;
        table.set_item("point", vectors(|c| c.point)?)?;
        table.set_item("normal", vectors(|c| c.normal)?)?;
        table.set_item("force", vectors(|c| c.force)?)?;
        table.set_item("distance", PyArray1::from_vec(py, all.iter().map(|c| c.distance).collect()))?;
        Ok(table)
    }

    fn faulty<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let all: Result<Vec<bool>, SimError> = (0..self.sim.len()).map(|env| self.sim.is_faulty(env)).collect();
        Ok(PyArray1::from_vec(py, all.map_err(value)?))
    }

    #[pyo3(signature = (pattern = "*"))]
    fn parameter_names(&self, pattern: &str) -> Vec<String> {
        let all = self.sim.catalogue().iter().map(|p| p.name.clone());
        all.filter(|name| pattern == "*" || fits(pattern, name)).collect()
    }

    /// Unit, neutral value, range worth searching, and what it does.
    fn parameter_info(&self, name: &str) -> PyResult<(String, f64, (f64, f64), String)> {
        let info = &self.sim.catalogue()[self.sim.parameter_index(name).map_err(value)?];
        Ok((info.unit.into(), info.neutral, info.range, info.description.into()))
    }

    fn read_parameters<'py>(&self, py: Python<'py>, names: Vec<String>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut all = Vec::with_capacity(self.sim.len() * names.len());
        for env in 0..self.sim.len() {
            for name in &names {
                all.push(self.sim.parameter(env, name).map_err(value)?);
            }
        }
        PyArray1::from_vec(py, all).reshape([self.sim.len(), names.len()])
    }

    fn write_parameters(&mut self, names: Vec<String>, values: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let ids: Result<Vec<usize>, SimError> = names.iter().map(|name| self.sim.parameter_index(name)).collect();
        let (ids, values) = (ids.map_err(value)?, values.as_array());
        if values.dim() != (self.sim.len(), ids.len()) {
            let expected = format!("({}, {})", self.sim.len(), ids.len());
            return Err(value(format!("parameters: expected the shape {expected}, found {:?}", values.dim())));
        }
        for ((env, k), &new) in values.indexed_iter() {
            // What is as it was costs nothing, and a neutral value is not kept.
            let is_new = self.sim.parameter(env, &names[k]).map_err(value)? != new;
            if is_new {
                self.sim.set_parameter_at(env, ids[k], new).map_err(value)?;
            }
        }
        Ok(())
    }

    fn reset_parameters(&mut self, environment: usize) -> PyResult<()> {
        self.sim.reset_parameters(environment).map_err(value)
    }

    /// A force [N] and a torque [N m] on a link at its centre of mass, world axes, held until set again.
    fn set_wrench(&mut self, environment: usize, link: usize, force: [f64; 3], torque: [f64; 3]) -> PyResult<()> {
        self.sim.set_wrench(environment, link, force, torque).map_err(value)
    }

    /// A push: so much is added to the velocities of one environment.
    fn add_velocity(&mut self, py: Python<'_>, environment: usize, change: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let change: Vec<f64> = change.as_array().iter().copied().collect();
        self.sim.add_velocity(environment, &change).map_err(value)?;
        self.fill(py)
    }
}

impl Batch {
    fn find(&self, name: Name) -> Option<&Array> {
        self.bound.iter().find(|(known, _)| *known == name).map(|(_, array)| array)
    }

    fn width(&self, name: Name) -> usize {
        let model = self.sim.model();
        match name {
            Name::Qpos => model.nq(),
            Name::Qvel | Name::Qacc => model.nv(),
            Name::GeomForce => 3 * model.geoms.len(),
            Name::Gyro | Name::Accelerometer => 3,
            Name::Orientation => 4,
            _ => model.joints.len(),
        }
    }

    fn make(&mut self, py: Python<'_>, name: Name) -> PyResult<Array> {
        let array = PyArray2::<f32>::zeros(py, [self.sim.len(), self.width(name)], false).unbind();
        self.bound.push((name, array.clone_ref(py)));
        // An array that cannot be filled is not bound.
        if let Err(error) = self.fill(py) {
            self.bound.pop();
            return Err(error);
        }
        Ok(array)
    }

    /// The engine takes what the bound inputs hold.
    fn read_inputs(&mut self, py: Python<'_>) -> PyResult<()> {
        let taken = |name: Name| {
            let array = self.bound.iter().find(|(known, _)| *known == name).map(|(_, array)| array.bind(py));
            array.map(|array| array.try_readonly().map_err(value)).transpose()
        };
        let (ctrl, speed, kp, kd) = (taken(Name::Ctrl)?, taken(Name::CtrlSpeed)?, taken(Name::Kp)?, taken(Name::Kd)?);
        let (torque, added) = (taken(Name::CtrlTorque)?, taken(Name::AddedTorque)?);
        let given = [&ctrl, &speed, &kp, &kd, &torque];
        if given.iter().any(|array| array.is_some()) {
            let none = vec![0.0; self.sim.len() * self.sim.model().joints.len()];
            let (q, kp, kd) = (slice(&ctrl)?, slice(&kp)?, slice(&kd)?);
            let (q, kp, kd) = (q.unwrap_or(&none), kp.unwrap_or(&none), kd.unwrap_or(&none));
            let command = BatchCommand { q, dq: slice(&speed)?, kp, kd, tau: slice(&torque)? };
            self.sim.set_commands(&command).map_err(value)?;
        }
        if let Some(added) = &added {
            self.sim.set_added_torques(added.as_slice().map_err(value)?).map_err(value)?;
        }
        Ok(())
    }

    /// The bound outputs take what the engine holds.
    fn fill(&mut self, py: Python<'_>) -> PyResult<()> {
        let (count, joints) = (self.sim.len(), self.sim.model().joints.len());
        let [first, second, third] = &mut self.passing;
        if self.bound.iter().any(|(name, _)| name.is_imu()) {
            first.resize(3 * count, 0.0);
            second.resize(3 * count, 0.0);
            third.resize(4 * count, 0.0);
            self.sim.read_imu(first, second, third).map_err(value)?;
            for (name, array) in self.bound.iter().filter(|(name, _)| name.is_imu()) {
                let from: &[f32] = match name {
                    Name::Gyro => first,
                    Name::Accelerometer => second,
                    _ => third,
                };
                array.bind(py).try_readwrite().map_err(value)?.as_slice_mut().map_err(value)?.copy_from_slice(from);
            }
        }
        if self.bound.iter().any(|(name, _)| name.is_encoder()) {
            first.resize(count * joints, 0.0);
            second.resize(count * joints, 0.0);
            self.sim.read_encoders(first, second).map_err(value)?;
            for (name, array) in self.bound.iter().filter(|(name, _)| name.is_encoder()) {
                let from: &[f32] = if *name == Name::Encoder { first } else { second };
                array.bind(py).try_readwrite().map_err(value)?.as_slice_mut().map_err(value)?.copy_from_slice(from);
            }
        }
        for (name, array) in &self.bound {
            let read = match name {
                Name::Qpos => qv_sim::Batch::read_positions,
                Name::Qvel => qv_sim::Batch::read_velocities,
                Name::Qacc => qv_sim::Batch::read_accelerations,
                Name::Torque => qv_sim::Batch::read_torques,
                Name::GeomForce => qv_sim::Batch::read_geom_forces,
                _ => continue,
            };
            let mut array = array.bind(py).try_readwrite().map_err(value)?;
            read(&self.sim, array.as_slice_mut().map_err(value)?).map_err(value)?;
        }
        Ok(())
    }
}

fn slice<'a>(array: &'a Option<PyReadonlyArray2<'_, f32>>) -> PyResult<Option<&'a [f32]>> {
    array.as_ref().map(|array| array.as_slice().map_err(value)).transpose()
}

/// Whether `name` is `pattern` with text without a dot for each `*`.
fn fits(pattern: &str, name: &str) -> bool {
    let (patterns, parts): (Vec<&str>, Vec<&str>) = (pattern.split('.').collect(), name.split('.').collect());
    patterns.len() == parts.len() && patterns.iter().zip(&parts).all(|(pattern, part)| fits_part(pattern, part))
}

fn fits_part(pattern: &str, part: &str) -> bool {
    let Some((head, tail)) = pattern.split_once('*') else { return pattern == part };
    let Some(rest) = part.strip_prefix(head) else { return false };
    (0..=rest.len()).filter(|&at| rest.is_char_boundary(at)).any(|at| fits_part(tail, &rest[at..]))
}
