"""A spoiled pixel has a status, and its neighbours in the lanes do not change by a bit.

Fault 8 of ``docs/faults.md``. What is learned of the whole painting is that of the clean stack: a
spoiled pixel may change it, and that by little (``test_bad_input.py``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto.fit.saved import maps_of
from killed_jobs import stack as waves

SIZE = (31, 47)
"""No multiple of a lane: the last lanes are filled with copies."""
APART, FIRST = 9, 7
"""Rows and columns between spoiled pixels, and the first of them."""
SEEDS = (16, 4)
"""Rows and columns of pixels from which those between them start, those of the finer grid from
those of the coarser one. Of the spoiled pixels one is of the coarser grid: row and column 16."""
TINY, HUGE = np.float32(1e-42), np.finfo(np.float32).max
SPOILED: dict[str, Any] = {
    "nothing": np.nan,
    "more than all": np.inf,
    "less than nothing": -np.inf,
    "negative": -0.3,
    "black": 0.0,
    "minus zero": -0.0,
    "saturated": 7.0,
    "subnormal": TINY,
    "the largest number": HUGE,
    "the smallest number": -HUGE,
    "both": np.where(np.arange(12) % 2, HUGE, -HUGE)[:, None],
    "one photograph": np.where(np.arange(12) == 3, np.nan, 0.4)[:, None],
    "three photographs": np.where(np.arange(12) < 3, 0.4, np.nan)[:, None],
    "one band": np.where(np.arange(3) == 1, np.nan, 0.4)[None],
    "one photograph alone": np.where(np.arange(12) == 3, 0.9, 0.0)[:, None],
}
FITS: dict[str, dict[str, Any]] = {
    "painting": {"pooling": "painting"},
    "pixel": {"pooling": "pixel", "lobes": 2, "effort": "draft"},
    "lafortune": {"model": "lafortune", "lobes": 2, "effort": "draft"},
}


def clean() -> impasto.Stack:
    taken = waves(SIZE)
    samples = taken.samples.astype(np.float32) / 4095.0
    return impasto.Stack(samples, lights=taken.rig, saturation=5.0)


def spoiled(halo: int) -> tuple[impasto.Stack, np.ndarray, np.ndarray]:
    """A pixel of each kind; where they are, and what sees none of them."""
    samples = clean().samples.copy()
    touched, near = np.zeros(SIZE, bool), np.zeros(SIZE, bool)
    across = SIZE[1] // APART
    for number, kind in enumerate(SPOILED):
        row, column = (APART * at + FIRST for at in divmod(number, across))
        samples[:, :, row, column] = SPOILED[kind]
        touched[row, column] = True
        steps = [step for step in SEEDS if row % step == column % step == 0] if halo else []
        far = max(steps, default=1) - 1
        assert far <= halo
        rows, columns = (slice(max(at - far, 0), at + far + 1) for at in (row, column))
        near[rows, columns] = True
    assert touched.sum() == len(SPOILED)
    return impasto.Stack(samples, lights=clean().rig, saturation=5.0), touched, ~near


def check(found: Any, expected: Any, others: np.ndarray, names: set[str]) -> None:
    one, two = found.arrays(), expected.arrays()
    for name in sorted(names):
        assert one[name][..., others].tobytes() == two[name][..., others].tobytes(), name
        assert not np.isinf(one[name].astype(np.float64)).any(), name
    unknown = found.status >= impasto.Status.DARK
    np.testing.assert_array_equal(np.isnan(found.normal).any(0), unknown)


@pytest.mark.parametrize("fit", FITS)
def test_neighbours_of_spoiled_pixels_keep_their_bits(fit: str) -> None:
    model = impasto.learn_sbrdf(clean(), **FITS[fit])
    expected = model.apply(clean())
    taken, touched, others = spoiled(model.halo)
    assert others.sum() > 20 * touched.sum()
    found = model.apply(taken)
    check(found, expected, others, set(maps_of(found)))
    assert (found.status[touched] != expected.status[touched]).any()
