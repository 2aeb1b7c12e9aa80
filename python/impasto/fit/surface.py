"""A painting's maps as the numerics light them: one form for prediction and for pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.checks import refractive_index
from impasto.errors import ArgumentError
from impasto.waiting import floats

Map: TypeAlias = NDArray[np.float32]
LobeModel = Literal["torrance-sparrow", "lafortune"]


@dataclass(frozen=True, slots=True)
class LobeArguments:
    """A lobe of every pixel; a number or a map ``(y, x)``, C-contiguous.

    A strength ``(band, y, x)`` has a colour of its own; any other one has the light's.
    """

    strength: float | Map
    shape: tuple[float | Map, ...]


@dataclass(frozen=True, slots=True)
class SurfaceArguments:
    """Maps of a painting whose lobes are of one model, checked and C-contiguous."""

    normal: Map
    diffuse: Map
    lobes: tuple[LobeArguments, ...]
    model: LobeModel = "torrance-sparrow"
    index: float = 1.45
    ambient: Map | None = None

    @classmethod
    def of_coats(
        cls, normal: ArrayLike, diffuse: ArrayLike, beta: ArrayLike, gamma: ArrayLike, index: Any
    ) -> SurfaceArguments:
        """Coats of varnish, which reflect without a colour.

        ``beta`` and ``gamma`` are a number, ``(y, x)``, or with several coats ``(coat,)`` or
        ``(coat, y, x)``.
        """
        normal, diffuse = _ground(normal, diffuse)
        strengths = _coats(beta, diffuse.shape[1:], "beta")
        widths = _coats(gamma, diffuse.shape[1:], "gamma")
        if len(strengths) != len(widths):
            raise ArgumentError(f"beta: {len(strengths)} coats, but gamma has {len(widths)}")
        lobes = tuple(
            LobeArguments(strength, (width,))
            for strength, width in zip(strengths, widths, strict=True)
        )
        return cls(normal, diffuse, lobes, index=refractive_index(index))

    @classmethod
    def of_lobes(
        cls,
        normal: ArrayLike,
        diffuse: ArrayLike,
        specular: ArrayLike,
        shape: Mapping[str, ArrayLike],
        *,
        model: LobeModel,
        index: float = 1.45,
        ambient: ArrayLike | None = None,
    ) -> SurfaceArguments:
        """Lobes with colours of their own: ``specular (lobe, band, y, x)``, 0 where there is none.

        ``shape`` holds the model's own numbers by name, ``(lobe, y, x)`` each: ``gamma``, or
        ``cxy``, ``cz`` and ``exponent``.
        """
        normal, diffuse = _ground(normal, diffuse)
        numbers = {name: floats(numbers) for name, numbers in shape.items()}
        specular = floats(specular)
        count = specular.shape[:1] or (0,)
        for name, map_, expected in (
            ("specular", specular, (*count, *diffuse.shape)),
            *((name, map_, (*count, *diffuse.shape[1:])) for name, map_ in numbers.items()),
        ):
            if map_.shape != expected:
                raise ArgumentError(f"{name}: expected shape {expected}, found {map_.shape}")
        lobes = tuple(
            LobeArguments(strength, tuple(planes))
            for strength, *planes in zip(specular, *numbers.values(), strict=True)
        )
        constant = None if ambient is None else floats(ambient)
        if constant is not None and constant.shape != diffuse.shape:
            raise ArgumentError(f"ambient: expected {diffuse.shape}, found {constant.shape}")
        return cls(normal, diffuse, lobes, model, refractive_index(index), constant)

    @property
    def tinted(self) -> bool:
        """Whether anything but the diffuse part has a colour per band."""
        return self.ambient is not None or any(np.ndim(lobe.strength) == 3 for lobe in self.lobes)


def _ground(normal: ArrayLike, diffuse: ArrayLike) -> tuple[Map, Map]:
    normals, colours = floats(normal), floats(diffuse)
    if colours.ndim != 3 or 0 in colours.shape:
        raise ArgumentError(f"diffuse: expected (band, y, x), found shape {colours.shape}")
    expected = (3, *colours.shape[1:])
    if normals.shape != expected:
        raise ArgumentError(f"normal: expected shape {expected}, found {normals.shape}")
    return normals, colours


def _coats(values: ArrayLike, size: tuple[int, ...], name: str) -> list[float | Map]:
    array = floats(values) if np.ndim(values) else np.asarray(values, dtype=np.float32)
    if array.ndim < 2:
        return [float(value) for value in array.reshape(-1)]
    coats = array.reshape(-1, *array.shape[-2:])
    if array.ndim > 3 or coats.shape[1:] != size:
        raise ArgumentError(
            f"{name}: expected a number, (coat,), {size} or (coat, *{size}), found {array.shape}"
        )
    return list(coats)
