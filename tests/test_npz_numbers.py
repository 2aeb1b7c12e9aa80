"""Numbers of damaged archives that the types of an array cannot hold are read without a warning."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto.io import read_stack, write_stack
from oracles.rigs import spiral

SIGNALLING = {
    "float16": np.array(0x7D01, np.uint16).view(np.float16),
    "float32": np.array(0x7FA00000, np.uint32).view(np.float32),
    "float64": np.array(0x7FF4000000000000, np.uint64).view(np.float64),
}
"""NaN with the bit of quiet ones at 0 (IEEE 754-2019, 6.2.1): processors raise a flag at them."""
NUMBERS = SIGNALLING | {
    "beyond float32": np.array(1e300),
    "beyond float64": np.array(np.longdouble("1e4000")),
}


def photographs() -> impasto.Stack:
    samples = np.random.default_rng(3).random((5, 1, 4, 6)).astype(np.float32)
    return impasto.Stack(samples, lights=spiral(5), scale=2.0, saturation=3.0)


def damaged(whole: Path, target: Path, number: np.ndarray[Any, Any]) -> Iterator[str]:
    """The archive with one number in each of its arrays of floats, in the type of that number."""
    with np.load(whole) as file:
        arrays = dict(file)
    for name, array in arrays.items():
        if array.dtype.kind == "f":
            other = array.astype(number.dtype)
            other.reshape(-1)[-1:] = number
            np.savez(target, **(arrays | {name: other}))
            yield name


@pytest.mark.parametrize("number", NUMBERS.values(), ids=NUMBERS)
@pytest.mark.parametrize("read", [read_stack, impasto.load_sbrdf], ids=["stack", "result"])
def test_no_number_makes_numpy_warn(
    tmp_path: Path, read: Callable[[Path], object], number: np.ndarray[Any, Any]
) -> None:
    whole = tmp_path / "whole.npz"
    if read is read_stack:
        write_stack(whole, photographs())
    else:
        impasto.fit_sbrdf(photographs(), pooling="painting", check=False).save(whole)
    outcomes = {}
    for name in damaged(whole, tmp_path / "damaged.npz", number):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", impasto.ImpastoWarning)
            try:
                read(tmp_path / "damaged.npz")
                outcomes[name] = "read"
            except (impasto.CorruptInputError, impasto.GeometryError) as error:
                outcomes[name] = str(error)
    # A map may have pixels without a number; a light or a scale may not.
    assert outcomes["samples" if read is read_stack else "normal"] == "read"
    assert {one == "read" for one in outcomes.values()} == {True, False}


@pytest.mark.parametrize("number", NUMBERS.values(), ids=NUMBERS)
def test_no_number_in_an_array_makes_numpy_warn(number: np.ndarray[Any, Any]) -> None:
    """The same in what is fitted, encoded and lit without a file."""
    samples = photographs().samples.astype(number.dtype)
    samples[0, 0, 0, 0] = number
    few = photographs().samples[0, 0].astype(number.dtype)
    few[0, 0] = number
    normal = np.zeros((3, 4, 6), number.dtype)
    normal[2] = 1.0
    normal[0, 0, 0] = number
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fitted = impasto.fit_normals(impasto.Stack(samples, lights=spiral(5), saturation=3.0))
        curve = impasto.Encoding("srgb", white=255.0)
        coded, decoded = curve.encode(few), curve.decode(few)
        lit = impasto.Surface(normal, np.full((1, 4, 6), 0.5)).predict(spiral(5))
    assert np.isfinite(fitted.normal[:, 1:]).all()
    assert np.isfinite(coded[1:]).all()
    assert np.isfinite(decoded[1:]).all()
    assert np.isfinite(lit[..., 1:, :]).all()


def test_a_scale_beyond_single_precision_makes_numpy_not_warn() -> None:
    stack = impasto.Stack(photographs().samples, lights=spiral(5), scale=1e300, saturation=3.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fitted = impasto.fit_normals(stack)
    assert (fitted.status != impasto.Status.FITTED).all()
