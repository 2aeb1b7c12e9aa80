//! The border between Python and the numerics: borrow, detach, call, wrap.
//!
//! No formula and no loop over pixels lives here. Arrays are borrowed, never copied; every call
//! releases the interpreter and reports progress, and answers Ctrl-C unless it is brief ([`run`]);
//! every error becomes a Python exception ([`errors`]).

use pyo3::prelude::*;

mod arrays;
mod environment;
mod errors;
#[cfg(feature = "gpu")]
mod gpu;
mod highlight;
mod lafortune;
mod lobes;
mod plan;
mod pooled;
mod radiosity;
mod relight;
mod run;
mod sbrdf;
mod scene;
mod spectral;
mod stereo;
mod surface;

/// How the extension was built and what it runs on.
#[pyfunction]
fn build_info() -> BuildInfo {
    BuildInfo {
        version: env!("CARGO_PKG_VERSION"),
        sources: env!("IMPASTO_SOURCES"),
        debug: cfg!(debug_assertions),
        simd: run::level().name(),
    }
}

#[derive(IntoPyObject)]
struct BuildInfo {
    version: &'static str,
    sources: &'static str,
    debug: bool,
    simd: &'static str,
}

/// The numerics of impasto.
#[pymodule(gil_used = false)]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    // Before any thread can fork: a child must not inherit it half initialised.
    run::level();
    module.add_function(wrap_pyfunction!(build_info, module)?)?;
    module.add_function(wrap_pyfunction!(highlight::fit_highlight, module)?)?;
    module.add_function(wrap_pyfunction!(radiosity::form_factors, module)?)?;
    module.add_function(wrap_pyfunction!(radiosity::gather, module)?)?;
    module.add_function(wrap_pyfunction!(relight::cast_shadows, module)?)?;
    module.add_function(wrap_pyfunction!(relight::soft_shadows, module)?)?;
    module.add_function(wrap_pyfunction!(relight::sky_visibility, module)?)?;
    module.add_function(wrap_pyfunction!(surface::reduced_surface, module)?)?;
    module.add_function(wrap_pyfunction!(relight::display_from_bands, module)?)?;
    module.add_function(wrap_pyfunction!(relight::integrate_normals, module)?)?;
    module.add_function(wrap_pyfunction!(relight::linear_from_bands, module)?)?;
    module.add_function(wrap_pyfunction!(relight::paint, module)?)?;
    module.add_function(wrap_pyfunction!(relight::render, module)?)?;
    module.add_function(wrap_pyfunction!(lobes::fit_lobes, module)?)?;
    module.add_function(wrap_pyfunction!(lobes::learn_lobes, module)?)?;
    module.add_function(wrap_pyfunction!(lobes::apply_lobes, module)?)?;
    module.add_function(wrap_pyfunction!(lafortune::fit_lafortune, module)?)?;
    module.add_function(wrap_pyfunction!(lafortune::views_differ, module)?)?;
    module.add_function(wrap_pyfunction!(pooled::learn_pooled, module)?)?;
    module.add_function(wrap_pyfunction!(pooled::apply_pooled, module)?)?;
    module.add_function(wrap_pyfunction!(sbrdf::predict, module)?)?;
    module.add_function(wrap_pyfunction!(sbrdf::add_residual_scores, module)?)?;
    module.add_function(wrap_pyfunction!(sbrdf::rig_equations, module)?)?;
    module.add_function(wrap_pyfunction!(stereo::fit_normals, module)?)?;
    module.add_function(wrap_pyfunction!(stereo::learn_normals, module)?)?;
    module.add_function(wrap_pyfunction!(spectral::spectral_estimator, module)?)?;
    module.add_class::<environment::Environment>()?;
    module.add_class::<plan::Plan>()?;
    module.add_class::<plan::SurfaceStatistics>()?;
    module.add_class::<relight::ToneCurve>()?;
    module.add_class::<spectral::SpectralEstimator>()?;
    #[cfg(feature = "gpu")]
    {
        module.add_function(wrap_pyfunction!(gpu::gpu_adapters, module)?)?;
        module.add_function(wrap_pyfunction!(gpu::gpu_render, module)?)?;
        module.add_class::<gpu::GpuRenderer>()?;
    }
    module.add("STATUS", arrays::status_names())?;
    module.add("CONDITION_LIMIT", impasto::stereo::CONDITION_LIMIT)?;
    module.add("HALO", impasto::sbrdf::HALO)?;
    module.add("TYPICAL_PIXELS", impasto::sbrdf::TYPICAL_PIXELS)?;
    module.add("RANK_LIMIT", impasto::stereo::RANK_LIMIT)?;
    Ok(())
}
