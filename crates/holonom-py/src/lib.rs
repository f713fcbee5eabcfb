//! Python binding of Holonom: conversions only. Text marked JSON in `_core.pyi` is made here.

mod checksum;
mod dense;
mod geometry;
mod model;
mod report;
mod sink;
mod state;
mod watched;

use holonom::method::Code;
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(_core, ModelError, PyException, "A model that cannot be used; JSON.");
create_exception!(_core, SimulationError, PyException, "A run that cannot start; JSON.");

/// JSON Schema of model files.
#[pyfunction]
fn schema() -> String {
    holonom::io::json_schema()
}

/// Reference page of model files, Markdown.
#[pyfunction]
fn model_reference() -> String {
    holonom::io::reference_markdown()
}

/// Version of the core.
#[pyfunction]
fn version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}

/// Names of the channels that every run stores.
#[pyfunction]
fn diagnostics() -> Vec<String> {
    holonom::system::diagnostics().into_iter().map(|channel| channel.name).collect()
}

/// JSON object of what was built: profile, target and the vector instructions that kernels use on this machine.
#[pyfunction]
fn build() -> String {
    let profile = if cfg!(debug_assertions) { "debug" } else { "release" };
    let target = format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS);
    serde_json::json!({ "profile": profile, "target": target, "simd": simd() }).to_string()
}

#[cfg(target_arch = "x86_64")]
fn simd() -> &'static str {
    use std::arch::is_x86_feature_detected as has;
    if has!("avx2") && has!("fma") { "AVX2 and FMA" } else { "SSE2" }
}

#[cfg(not(target_arch = "x86_64"))]
fn simd() -> &'static str {
    if cfg!(target_feature = "neon") { "NEON" } else { "none" }
}

/// JSON list of the integration codes.
#[pyfunction]
fn methods() -> String {
    report::methods()
}

/// Name of the code that a method and a formula mean; none where there is no such pair.
#[pyfunction]
#[pyo3(signature = (method, formula=None))]
fn find_method(method: &str, formula: Option<&str>) -> Option<&'static str> {
    Code::find(method, formula).ok().map(|code| code.info().name)
}

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("ModelError", module.py().get_type::<ModelError>())?;
    module.add("SimulationError", module.py().get_type::<SimulationError>())?;
    module.add_class::<model::CoreModel>()?;
    module.add_function(wrap_pyfunction!(model::parse, module)?)?;
    module.add_function(wrap_pyfunction!(checksum::checksum, module)?)?;
    module.add_function(wrap_pyfunction!(schema, module)?)?;
    module.add_function(wrap_pyfunction!(model_reference, module)?)?;
    module.add_function(wrap_pyfunction!(version, module)?)?;
    module.add_function(wrap_pyfunction!(diagnostics, module)?)?;
    module.add_function(wrap_pyfunction!(build, module)?)?;
    module.add_function(wrap_pyfunction!(methods, module)?)?;
    module.add_function(wrap_pyfunction!(find_method, module)?)?;
    Ok(())
}
