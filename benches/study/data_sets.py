"""The fixed data that settings are compared on: photographs to fit, and photographs held out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.rig import Rig
from impasto.simulate import capture, painting
from impasto.simulate import rig as rig_named
from impasto.simulate.photography import Model
from impasto.simulate.planning import Truth
from impasto.stack import Stack
from study import pigments
from study.journal import digest
from study.materials import MODELS, forward_of

LIGHTS = 60
"""Number of lights of the simulated dome; one in five is held out."""
LOWEST = 25.0
"""Degrees of elevation of its lowest light."""
HELD = 5
"""One photograph in this number is held out."""
FEWEST_VIEWS = 11
"""The same for the rig of 770 views, where comparing held-out photographs is slowest."""


@dataclass(frozen=True, eq=False)
class PaintingData:
    """One painting of a data set, or a part of one.

    Attributes
    ----------
    name
        Of the data set.
    stack
        What may be fitted.
    rig
        Who lit and saw the photographs that are held out.
    held
        ``(obs, band, y, x)`` float32 linear light of those, without noise where it is simulated.
    exposure
        Share of full scale of a white board: a camera sees no light beyond ``1 / exposure``.
    normal
        ``(3, y, x)`` true normals; None where nobody knows them.
    truth
        All there is to know of a whole painting whose photographs follow the model that is fitted.
    share
        Of the painting's pixels.
    """

    name: str
    stack: Stack
    rig: Rig
    held: NDArray[np.float32]
    exposure: float
    normal: NDArray[np.float32] | None
    truth: Truth | None = None
    share: float = 1.0

    @property
    def megapixels(self) -> float:
        """Size of a photograph."""
        return self.stack.shape[2] * self.stack.shape[3] / 1e6


Paintings: TypeAlias = tuple[PaintingData, ...]
"""A data set: paintings under the same lights."""


@dataclass(frozen=True)
class Recipe:
    """How to make a data set, and what it needs."""

    name: str
    make: Callable[[Recipe, Sizes, int, Path | None], tuple[Any, ...]]
    needs: tuple[str, ...] = ()
    """Files below the folder of real data."""
    views: bool = False
    """Whether every photograph has a view of its own."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """Edges in pixels: of simulated paintings, of those from 770 views, of windows of the icon.

    ``pigments`` are the pixels of a picture of pigments, at least. Radial bases take a tenth of a
    second to be built: a fifth to a third of the time of a million pixels, three quarters of that
    of a hundred thousand.

    ``paintings`` is how many of them a data set has; errors are of all of them together. By one
    painting of 48 pixels the same setting is 0.2 % or 2 % above the best, by sixteen it is 1.1 %
    with a deviation of 0.2 %: nine of 64 have as many pixels.
    """

    painting: int = 64
    views: int = 16
    icon: int = 64
    paintings: int = 9
    pigments: int = 1_000_000


QUICK = Sizes(painting=32, views=8, icon=40, paintings=2, pigments=100_000)
FULL = Sizes()


def dome(count: int = LIGHTS) -> NDArray[np.float64]:
    """``(obs, 3)`` directions over a dome; every run of consecutive ones is spread evenly.

    Equal areas by height and azimuth, from the additive sequence of the plastic number (Roberts
    2018), in which neither the first few nor every fifth lie in a ring.
    """
    plastic = 1.32471795724474602596
    turn = np.arange(1, count + 1)
    low = np.sin(np.radians(LOWEST))
    z = low + (1.0 - low) * ((0.5 + turn / plastic) % 1.0)
    azimuth = 2.0 * np.pi * ((0.5 + turn / plastic**2) % 1.0)
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)


def _split(count: int, step: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    held = np.arange(step // 2, count, step)
    return np.setdiff1d(np.arange(count), held), held


def _simulated(recipe: Recipe, sizes: Sizes, seed: int, folder: Path | None) -> Paintings:
    first = seed * sizes.paintings
    seeds = range(first, first + sizes.paintings)
    return tuple(_painted(recipe, sizes, number, folder) for number in seeds)


def _painted(recipe: Recipe, sizes: Sizes, seed: int, folder: Path | None) -> PaintingData:
    size = sizes.views if recipe.views else sizes.painting
    forward = None
    if recipe.needs and folder is not None:
        forward = forward_of((folder / recipe.needs[0]).parent, recipe.name)
    scene = painting(seed, (size, size), varnish="patches", relief=1.0 if recipe.views else 1.5)
    rig = rig_named("snel-lafortune") if recipe.views else Rig(dome())
    train, held = _split(len(rig), FEWEST_VIEWS if recipe.views else HELD)
    model: Model = "lafortune" if recipe.views else "torrance-sparrow"
    shadows = bool(recipe.needs)
    photographs = capture(
        scene, rig.take(train), "rgb", model=model, forward=forward, shadows=shadows, seed=seed
    )
    # Without noise, rounding or clipping: errors are those of the fit.
    truth = capture(
        scene, rig.take(held), "rgb", model=model, forward=forward, shadows=shadows,
        noise=False, bits=None, clip=False,
    ).stack  # fmt: skip
    return PaintingData(
        recipe.name, photographs.stack, truth.rig,
        np.array([truth.linear(i) for i in range(len(truth.rig))]),
        photographs.truth.exposure, photographs.truth.normal,
        photographs.truth if forward is None and not recipe.views else None,
    )  # fmt: skip


def _icon(recipe: Recipe, sizes: Sizes, seed: int, folder: Path | None) -> Paintings:
    """Windows in the middle of the icon's halves, quarters ..., row by row."""
    from impasto.io import read_stack

    del seed
    assert folder is not None
    stack = read_stack(folder / recipe.needs[0], encoding="srgb")
    train, held = _split(len(stack.rig), HELD + 1)
    fitted, shown = stack.take(train), stack.take(held)
    light = np.array([shown.linear(i) for i in range(len(held))])
    light = np.nan_to_num(light, posinf=1.0)
    across = math.isqrt(sizes.paintings - 1) + 1
    places = [divmod(number, across) for number in range(sizes.paintings)]
    windows = [_window(stack.shape[2:], sizes.icon, place, across) for place in places]
    return tuple(
        PaintingData(
            recipe.name, fitted._replace(samples=np.ascontiguousarray(fitted.samples[window])),
            shown.rig, light[window], 1.0, None,
        )
        for window in windows
    )  # fmt: skip


def _window(shape: tuple[int, ...], edge: int, place: tuple[int, int], across: int) -> Any:
    """The index of a square in the middle of one of ``across * across`` cells of an image."""
    corners = [
        ((2 * at + 1) * size // across - edge) // 2 for at, size in zip(place, shape, strict=True)
    ]
    return np.s_[..., *(slice(corner, corner + edge) for corner in corners)]


def _pigments(
    recipe: Recipe, sizes: Sizes, seed: int, folder: Path | None
) -> tuple[pigments.PigmentData]:
    assert folder is not None
    camera = recipe.name.removeprefix(OF_PIGMENTS)
    return (pigments.pigment_data(recipe.name, camera, folder, sizes.pigments, seed),)


OF_PIGMENTS = "pigments, "
PIGMENTS = tuple(f"{OF_PIGMENTS}{camera}" for camera in pigments.CAMERAS)
"""Data sets of pigments, one per camera."""

RECIPES = (
    Recipe("own model", _simulated),
    *(Recipe(model, _simulated, (f"brdf/{file}",)) for model, (file, _) in MODELS.items()),
    Recipe("icon", _icon, ("icon_rti/dirs.lp",)),
    Recipe("770 views", _simulated, views=True),
    *(
        Recipe(name, _pigments, needs)
        for name, (_, needs) in zip(PIGMENTS, pigments.CAMERAS.values(), strict=True)
    ),
)


def digests(folder: Path | None) -> dict[str, str]:
    """Digests of the real data that recipes need and find."""
    found = {}
    for recipe in RECIPES:
        if folder is None or not recipe.needs or _absent(recipe, folder):
            continue
        paths = [folder / name for name in recipe.needs]
        # A light file is hashed with the photographs beside it, a table alone.
        whole = [path.parent if path.suffix == ".lp" else path for path in paths]
        found[recipe.name] = "+".join(digest(path) for path in whole)
    return found


def _absent(recipe: Recipe, folder: Path | None) -> list[str]:
    return [name for name in recipe.needs if folder is None or not (folder / name).is_file()]


def available(
    sizes: Sizes, seed: int, folder: Path | None
) -> tuple[dict[str, Callable[[], tuple[Any, ...]]], dict[str, str]]:
    """Makers of the data sets that are available, and why the others are not.

    Parameters
    ----------
    sizes
        In pixels.
    seed
        Of paintings and noise.
    folder
        Real data; None: none.

    Returns
    -------
    tuple
        What makes each data set (:data:`Paintings`, of pigments one
        :class:`~study.pigments.PigmentData`); the reasons by name.
    """
    if folder is not None and not folder.is_dir():
        raise ArgumentError(f"data: there is no folder {folder}")
    made: dict[str, Callable[[], tuple[Any, ...]]] = {}
    missing: dict[str, str] = {}
    for recipe in RECIPES:
        if absent := _absent(recipe, folder):
            are, they = ("is", "it is") if len(absent) == 1 else ("are", "they are")
            names = ", ".join(absent)
            missing[recipe.name] = f"{names} {are} not at hand ({they} not part of impasto)"
            continue

        def make(recipe: Recipe = recipe) -> tuple[Any, ...]:
            return recipe.make(recipe, sizes, seed, folder)

        made[recipe.name] = make
    return made, missing
