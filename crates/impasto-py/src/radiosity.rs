//! Light between the cells of a relief.

#![allow(clippy::needless_pass_by_value, reason = "pyo3 hands arguments over by value")]

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use impasto::Error;
use impasto::radiosity::{FormFactors, Rows};

use crate::errors::to_python;
use crate::run;
use crate::scene::slice;

/// Where the entries of each lit cell begin and the last ones end `(n + 1,)`; per entry the cell that
/// lights it, and its share.
type Entries<'py> =
    (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>);

/// Form factors between the cells of heights `(y, x)`, in sides of a cell, with normals `(3, y, x)`.
#[pyfunction]
#[pyo3(signature = (height, normal, threads=1))]
pub(crate) fn form_factors<'py>(
    py: Python<'py>,
    height: PyReadonlyArray2<'py, f32>,
    normal: PyReadonlyArray3<'py, f32>,
    threads: usize,
) -> PyResult<Entries<'py>> {
    let refuse = |error: Error| to_python(py, &error);
    let size = [height.shape()[0], height.shape()[1]];
    if normal.shape() != [3, size[0], size[1]] {
        let problem = format!("expected (3, {}, {}), found {:?}", size[0], size[1], normal.shape());
        return Err(refuse(Error::argument("normal", problem)));
    }
    let (height, normal) =
        (slice("height", &height).map_err(refuse)?, slice("normal", &normal).map_err(refuse)?);
    let found = run::call(py, threads, None, |run| FormFactors::new(height, normal, size, run))?;
    Ok((found.first.into_pyarray(py), found.cell.into_pyarray(py), found.share.into_pyarray(py)))
}

/// Light `(k, n)` that cells get from each other when they send `(k, n)`.
#[pyfunction]
#[pyo3(signature = (first, cell, share, sent, threads=1))]
pub(crate) fn gather<'py>(
    py: Python<'py>,
    first: PyReadonlyArray1<'py, u64>,
    cell: PyReadonlyArray1<'py, u32>,
    share: PyReadonlyArray1<'py, f64>,
    sent: PyReadonlyArray2<'py, f32>,
    threads: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let refuse = |error: Error| to_python(py, &error);
    let rows = Rows::new(
        slice("first", &first).map_err(refuse)?,
        slice("cell", &cell).map_err(refuse)?,
        slice("share", &share).map_err(refuse)?,
    );
    let (rows, size) = (rows.map_err(refuse)?, [sent.shape()[0], sent.shape()[1]]);
    if size[1] != rows.cells() {
        let problem = format!("expected (k, {}), found {size:?}", rows.cells());
        return Err(refuse(Error::argument("sent", problem)));
    }
    let sent = slice("sent", &sent).map_err(refuse)?;
    let shares = size[0] * share.as_slice()?.len();
    let found = run::call_on(py, shares, threads, None, |run| rows.gather(sent, run))?;
    found.into_pyarray(py).reshape(size)
}
