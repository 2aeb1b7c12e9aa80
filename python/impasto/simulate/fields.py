"""Random fields."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import is_whole
from impasto.errors import ArgumentError

Field = NDArray[np.float32]


def stream(seed: int, name: str) -> np.random.Generator:
    """An independent random stream for one purpose.

    The name is part of the seed, so an option that draws more numbers (or a new option)
    does not change any other stream.
    """
    key = zlib.crc32(name.encode())
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key,)))


def check_seed(seed: object) -> None:
    """A seed is an integer from 0 on."""
    if not (is_whole(seed) and seed >= 0):
        raise ArgumentError(f"seed: expected an integer from 0 on, found {seed!r}")


def smoothstep(
    low: float | NDArray[np.floating], high: float, value: NDArray[np.floating]
) -> Field:
    """0 below ``low``, 1 above ``high`` (or the other way round), a cubic between; any shape."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t), dtype=np.float32)


def blur(field: Field, sigma: float) -> Field:
    """Gaussian blur, ``sigma`` in pixels, edges reflected; sigma 0 returns the field."""
    import cv2

    if sigma <= 0.0:
        return field
    return np.asarray(cv2.GaussianBlur(field, (0, 0), sigma, borderType=cv2.BORDER_REFLECT_101))


def noise(
    rng: np.random.Generator, shape: tuple[int, int], cell: tuple[float, float] | float
) -> Field:
    """Smooth noise ``(y, x)``, mean about 0, standard deviation about 1.

    ``cell`` is the size of its features in pixels, one number or (rows, columns).
    """
    import cv2

    cell_y, cell_x = (cell, cell) if isinstance(cell, int | float) else cell
    rows = max(2, int(np.ceil(shape[0] / max(cell_y, 1.0))) + 3)
    columns = max(2, int(np.ceil(shape[1] / max(cell_x, 1.0))) + 3)
    coarse = rng.standard_normal((rows, columns), dtype=np.float32)
    # The grid reaches past the picture by a random part of a cell: no seams at its corner.
    offset_y, offset_x = rng.random(2)
    rows_at = np.arange(shape[0], dtype=np.float32) / max(cell_y, 1.0) + offset_y
    columns_at = np.arange(shape[1], dtype=np.float32) / max(cell_x, 1.0) + offset_x
    map_x, map_y = np.empty((2, *shape), np.float32)
    map_x[:], map_y[:] = columns_at, rows_at[:, None]
    fine = cv2.remap(coarse, map_x, map_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
    return np.asarray(fine * np.float32(1.35), dtype=np.float32)


def fractal(
    rng: np.random.Generator,
    shape: tuple[int, int],
    cell: tuple[float, float] | float,
    octaves: int = 4,
    gain: float = 0.5,
) -> Field:
    """A sum of ``octaves`` noises, each half the size and ``gain`` the strength of the last."""
    cell_y, cell_x = (cell, cell) if isinstance(cell, int | float) else cell
    total = np.zeros(shape, dtype=np.float32)
    strength, power = 1.0, 0.0
    for octave in range(octaves):
        size = (cell_y / 2**octave, cell_x / 2**octave)
        total += np.float32(strength) * noise(rng, shape, size)
        power += strength**2
        strength *= gain
    return np.asarray(total / np.float32(np.sqrt(power)), dtype=np.float32)
