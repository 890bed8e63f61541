//! Clouds of Gaussians, from files or arrays, and what cameras see of them.

use crate::errors::value;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use qv_core::GaussianCloud;
use qv_raster::{Image, Outputs, Scene, Settings, View};
use qv_splat::captures::cameras_json;
use qv_splat::files::read_named;
use qv_splat::lens::Distorter;
use std::fs;
use std::path::{Path, PathBuf};

/// Gaussians of a scene.
#[pyclass(frozen, module = "quadverse._quadverse")]
pub struct Cloud {
    cloud: GaussianCloud,
    background: [f32; 3],
    antialias: bool,
    remarks: Vec<String>,
}

/// Reads a scene of Gaussians of any format.
#[pyfunction]
pub fn open_cloud(py: Python<'_>, path: PathBuf) -> PyResult<Cloud> {
    let inside = path.join("meta.json");
    let path = if inside.is_file() { inside } else { path };
    let wrong = |error: String| PyOSError::new_err(format!("{}: {error}", path.display()));
    py.detach(|| {
        let bytes = fs::read(&path).map_err(|e| wrong(format!("expected a scene of Gaussians, found {e}")))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut beside = |name: &str| fs::read(folder.join(name)).map_err(|e| format!("{name}: {e}"));
        let file = read_named(&bytes, &name, &mut beside).map_err(|e| wrong(e.to_string()))?;
        let mut remarks: Vec<String> = file.lost.into_iter().chain(file.remarks).collect();
        if file.left_out > 0 {
            remarks.push(format!("{} Gaussians whose numbers are not finite were left out", file.left_out));
        }
        Ok(Cloud {
            cloud: file.cloud,
            background: file.background.unwrap_or_default(),
            antialias: file.antialias,
            remarks,
        })
    })
}

impl Cloud {
    /// The Gaussians themselves.
    pub fn gaussians(&self) -> &GaussianCloud {
        &self.cloud
    }

    /// What it was made to be drawn over, red, green, blue as shown, 0 to 1; black where nothing is known.
    pub fn background(&self) -> [f32; 3] {
        self.background
    }

    /// Whether it was made to be drawn with anti-aliasing.
    pub fn is_antialiased(&self) -> bool {
        self.antialias
    }
}

#[pymethods]
impl Cloud {
    #[new]
    fn new(
        means: PyReadonlyArray2<'_, f32>,
        log_scales: PyReadonlyArray2<'_, f32>,
        rotations: PyReadonlyArray2<'_, f32>,
        opacity_logits: PyReadonlyArray1<'_, f32>,
        sh: PyReadonlyArray2<'_, f32>,
    ) -> PyResult<Self> {
        let means = rows::<3>(&means, "means")?;
        let sh_rows = rows::<3>(&sh, "sh")?;
        let per_one = sh_rows.len() / means.len().max(1);
        let degree = (0..=GaussianCloud::MAX_SH_DEGREE).find(|&d| (usize::from(d) + 1).pow(2) == per_one);
        let Some(sh_degree) = degree.filter(|_| per_one * means.len() == sh_rows.len()) else {
            let found = format!("{} rows for {} Gaussians", sh_rows.len(), means.len());
            return Err(value(format!("sh: expected 1, 4, 9 or 16 rows of 3 for each Gaussian, found {found}")));
        };
        let cloud = GaussianCloud {
            means,
            log_scales: rows::<3>(&log_scales, "log_scales")?,
            rotations: rows::<4>(&rotations, "rotations")?,
            opacity_logits: opacity_logits.as_array().iter().copied().collect(),
            sh_degree,
            sh: sh_rows,
            feature_count: 0,
            features: Vec::new(),
        };
        cloud.check().map_err(value)?;
        Ok(Self { cloud, background: [0.0; 3], remarks: Vec::new(), antialias: false })
    }

    fn __len__(&self) -> usize {
        self.cloud.len()
    }

    /// Centres [m], shape `[N, 3]`.
    #[getter]
    fn means<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        table(py, &self.cloud.means)
    }

    /// Logarithms of the standard deviations [ln m], shape `[N, 3]`.
    #[getter]
    fn log_scales<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        table(py, &self.cloud.log_scales)
    }

    /// Quaternions w, x, y, z, shape `[N, 4]`.
    #[getter]
    fn rotations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        table(py, &self.cloud.rotations)
    }

    /// Opacities before the logistic function, shape `[N]`.
    #[getter]
    fn opacity_logits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.cloud.opacity_logits)
    }

    /// Spherical harmonics, those of a Gaussian in rows that follow each other, shape `[N (degree + 1)², 3]`.
    #[getter]
    fn sh<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        table(py, &self.cloud.sh)
    }

    /// What was lost of the file, or done with its numbers, a line each.
    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.remarks.clone()
    }
}

/// What cameras see: a dict for each with its name, colour, alpha, depth.
#[pyfunction]
pub fn render<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    cameras: &str,
    background: Option<[f32; 3]>,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let cameras = cameras_json::read(cameras).map_err(value)?.cameras;
    let outputs = Outputs { depth: true, ..Default::default() };
    let settings = Settings { outputs, background: background.unwrap_or(cloud.background), antialias: cloud.antialias };
    let images = py.detach(|| {
        let mut images = Vec::with_capacity(cameras.len());
        // One by one, so that no more than one is in memory twice.
        for one in &cameras {
            let lens =
                Distorter::new(&one.camera, &one.distortion).map_err(|e| value(format!("camera {}: {e}", one.name)))?;
            let view = View::of(lens.pinhole);
            let (drawn, _) = qv_raster::render(&Scene::still(&cloud.cloud), &[view], &settings).map_err(value)?;
            images.extend(drawn.into_iter().map(|image| lens.distort(image)));
        }
        PyResult::Ok(images)
    })?;
    cameras.iter().zip(&images).map(|(camera, image)| columns(py, &camera.name, image)).collect()
}

fn columns<'py>(py: Python<'py>, name: &str, image: &Image) -> PyResult<Bound<'py, PyDict>> {
    let (size, all) = ([image.height, image.width], PyDict::new(py));
    all.set_item("name", name)?;
    all.set_item("colour", PyArray1::from_slice(py, &image.colour).reshape([image.height, image.width, 3])?)?;
    all.set_item("alpha", PyArray1::from_slice(py, &image.alpha).reshape(size)?)?;
    all.set_item("depth", PyArray1::from_slice(py, &image.depth).reshape(size)?)?;
    Ok(all)
}

fn rows<const N: usize>(array: &PyReadonlyArray2<'_, f32>, what: &str) -> PyResult<Vec<[f32; N]>> {
    let array = array.as_array();
    if array.ncols() != N {
        return Err(value(format!("{what}: expected {N} columns, found {}", array.ncols())));
    }
    Ok(array.rows().into_iter().map(|row| std::array::from_fn(|column| row[column])).collect())
}

fn table<'py, const N: usize>(py: Python<'py>, rows: &[[f32; N]]) -> PyResult<Bound<'py, PyArray2<f32>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), N])
}
