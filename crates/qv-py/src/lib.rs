//! The native part of the Python package `quadverse`: batches, recordings, replay, diagnosis, the velocity and the navigation task as classes
//! of Python over numpy. What needs no speed is plain Python in `python/quadverse`.

mod batch;
mod errors;
mod navigation;
mod recording;
mod render;
mod report;
mod velocity;
mod waiting;

use pyo3::prelude::*;

/// The module that `quadverse` imports.
#[pymodule]
fn _quadverse(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<batch::Batch>()?;
    module.add_class::<batch::Snapshot>()?;
    module.add_class::<recording::Recording>()?;
    module.add_class::<render::Cloud>()?;
    module.add_class::<velocity::VelocityTask>()?;
    module.add_class::<navigation::NavigationTask>()?;
    module.add_function(wrap_pyfunction!(recording::open, module)?)?;
    module.add_function(wrap_pyfunction!(render::open_cloud, module)?)?;
    module.add_function(wrap_pyfunction!(render::render, module)?)?;
    module.add_function(wrap_pyfunction!(report::replay, module)?)?;
    module.add_function(wrap_pyfunction!(report::diagnose, module)?)
}
