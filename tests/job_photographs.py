"""Photographs for jobs, jobs that are interrupted, and results that are the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import impasto
from impasto.io import write_lights, write_png8, write_tiff16
from interrupted_jobs import interrupting
from killed_jobs import OPTIONS, stack

PIXEL: dict[str, Any] = {"pooling": "pixel", "effort": "draft", "lobes": 1}


def photographs(folder: Path, size: tuple[int, int] = (70, 90)) -> Path:
    """A light file beside 16-bit TIFFs with a mask, of which the last tile has nothing."""
    taken = stack(size)
    names = [f"light{index}.tif" for index in range(len(taken.rig))]
    for name, codes in zip(names, taken.samples, strict=True):
        write_tiff16(folder / name, codes << 4)
    write_lights(folder / "dirs.lp", taken.rig, names)
    mask = np.full((3, *size), 255, np.uint8)
    mask[:, 60:, 60:] = 0
    write_png8(folder / "mask.png", np.moveaxis(mask, 0, -1))
    return folder / "dirs.lp"


def same(one: impasto.Sbrdf, two: impasto.Sbrdf) -> None:
    """Every number of two results, bit for bit."""
    assert type(one) is type(two)
    first, second = one.arrays(), two.arrays()
    assert first.keys() == second.keys()
    for name, array in first.items():
        assert array.dtype == second[name].dtype, name
        assert array.shape == second[name].shape, name
        assert array.tobytes() == second[name].tobytes(), name


def interrupted(out: Path, after: int, **options: Any) -> None:
    """A job that ends after two tiles or more, as by Ctrl-C."""
    with interrupting(after) as stop:
        impasto.run(stack(), out, progress=stop, **OPTIONS | options)
    assert not out.exists()
