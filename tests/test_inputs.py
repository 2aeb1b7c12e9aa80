"""What the samples are stored in, and in which unit, changes no bit of a fit's shapes."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import impasto
from circumstances import SIZE
from impasto import simulate

FITS = {
    "fit_normals": lambda stack: impasto.fit_normals(stack),
    "fit_sbrdf": lambda stack: impasto.fit_sbrdf(stack, pooling="painting"),
}
FIT = pytest.mark.parametrize("fit", FITS.values(), ids=FITS)

PROPORTIONAL = {"albedo", "diffuse", "beta", "residual"}
"""What is in the unit of the samples; everything else has none of it."""


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    """8-bit codes with a pedestal, noise and a few clipped highlights."""
    painting = simulate.painting(seed=6, size=SIZE, varnish="gloss")
    system = "tominaga-six-band-adaptation"
    return simulate.capture(painting, system, bits=8, exposure=0.8).stack


def rebuilt(stack: impasto.Stack, samples: Any, **changes: Any) -> impasto.Stack:
    options = {
        "lights": stack.rig,
        "bands": stack.bands,
        "saturation": stack.saturation,
        "scale": stack.scale,
        "black": stack.black,
    } | changes
    return impasto.Stack(samples, **options)


def numbers(result: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Every number of a result by name."""
    found = {}
    for field in fields(result):
        value = getattr(result, field.name)
        if isinstance(value, impasto.Normals):
            found |= numbers(value, f"{field.name}.")
        elif isinstance(value, np.ndarray | float):
            found[prefix + field.name] = np.asarray(value)
    return found


def assert_same(one: Any, other: Any) -> None:
    expected, found = numbers(one), numbers(other)
    assert expected.keys() == found.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(values, found[name], err_msg=name)


@FIT
@pytest.mark.parametrize("kind", [np.uint16, np.float16, np.float32, np.float64])
def test_one_number_in_any_type_is_one_number(stack: impasto.Stack, fit: Any, kind: Any) -> None:
    assert stack.samples.dtype == np.uint8
    # Whole numbers up to 255 are themselves in each of these types.
    assert_same(fit(stack), fit(rebuilt(stack, stack.samples.astype(kind))))


def layouts(samples: np.ndarray) -> dict[str, np.ndarray]:
    """The same numbers laid out in memory in other ways."""
    wide = np.full((*samples.shape[:3], 2 * samples.shape[3]), 7, samples.dtype)
    wide[..., ::2] = samples
    locked = samples.copy()
    locked.setflags(write=False)
    return {
        "read-only": locked,
        "columns first": np.asfortranarray(samples),
        "every other column": wide[..., ::2],
        "upside down": np.ascontiguousarray(samples[:, :, ::-1])[:, :, ::-1],
        "interleaved bands": np.moveaxis(np.ascontiguousarray(np.moveaxis(samples, 1, 3)), 3, 1),
    }


@FIT
def test_memory_layout_does_not_matter(stack: impasto.Stack, fit: Any) -> None:
    expected = fit(stack)
    before = stack.samples.copy()
    for name, samples in layouts(stack.samples).items():
        np.testing.assert_array_equal(samples, before, err_msg=name)
        assert_same(expected, fit(rebuilt(stack, samples)))
    np.testing.assert_array_equal(stack.samples, before, err_msg="samples are read, not written")


@FIT
@pytest.mark.parametrize("power", [-20, -1, 3, 24])
@pytest.mark.parametrize("where", ["samples", "scale"])
def test_a_power_of_two_in_the_light_changes_no_other_bit(
    stack: impasto.Stack, fit: Any, power: int, where: str
) -> None:
    # Products of four samples stay within single precision's range of 2^-126 to 2^127.
    codes, factor = stack.samples.astype(np.float32), 2.0**power
    if where == "scale":
        brighter = rebuilt(stack, codes, scale=stack.scale * factor)
    else:
        brighter = rebuilt(
            stack,
            codes * np.float32(factor),
            saturation=stack.saturation * factor,
            black=stack.black * factor,
        )
    expected, found = numbers(fit(stack)), numbers(fit(brighter))
    for name, values in expected.items():
        proportional = name.removeprefix("normals.") in PROPORTIONAL
        scaled = values * values.dtype.type(factor) if proportional else values
        if name == "curve":  # phi, specular part over its geometry factor, samples
            scaled = values * np.array([1.0, factor, 1.0])
        if name == "path":  # beta, gamma
            scaled = values * np.array([factor, 1.0])
        np.testing.assert_array_equal(found[name], scaled, err_msg=name)
