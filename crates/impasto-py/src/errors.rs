//! The one map from Rust's errors to Python's exceptions.

use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyType;

use impasto::Error;

/// The Python exception of an error. No wildcard: a new variant must be given its class here.
pub(crate) fn to_python(py: Python<'_>, error: &Error) -> PyErr {
    let class = match error {
        Error::Cancelled => return PyKeyboardInterrupt::new_err(()),
        Error::Memory { .. } => return PyMemoryError::new_err(error.to_string()),
        Error::Argument { .. } => "ArgumentError",
        Error::Geometry { .. } => "GeometryError",
    };
    named(py, class, error.to_string())
}

/// A panic of the numerics: a defect that is to be reported, with the place it came from.
pub(crate) fn internal(py: Python<'_>, panic: &(dyn std::any::Any + Send)) -> PyErr {
    let text = panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("a panic without a message");
    named(py, "InternalError", format!("a defect in impasto, please report it: {text}"))
}

/// An exception of `impasto.errors`, by its name.
pub(crate) fn named(py: Python<'_>, class: &str, message: String) -> PyErr {
    let class = py
        .import("impasto.errors")
        .and_then(|module| module.getattr(class))
        .and_then(|class| class.cast_into::<PyType>().map_err(PyErr::from));
    match class {
        Ok(class) => PyErr::from_type(class, message),
        Err(_) => PyRuntimeError::new_err(message),
    }
}
