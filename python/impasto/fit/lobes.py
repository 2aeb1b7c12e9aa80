"""Every pixel's own lobes about a free normal, and what they show under other lights."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import StackArguments
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import is_whole, refractive_index
from impasto.effort import PRESETS, Effort
from impasto.errors import ArgumentError
from impasto.fit.normals import Normals
from impasto.fit.result import PerPixelSbrdf, shared_fields
from impasto.fit.saved import over
from impasto.fit.start import StartArguments
from impasto.io.results import SavedMaps
from impasto.stack import Stack
from impasto.surface import Surface

MOST_LOBES = 3


@dataclass(frozen=True, eq=False, repr=False)
class LobeSbrdf(PerPixelSbrdf):
    """A painting whose pixels have Torrance-Sparrow lobes of their own.

    The model is eq. 1 of the six-band paper with a strength per band and lobe, and a constant:
    ``irradiance * (diffuse N.L + sum over lobes of specular D F G / (N.V)) + ambient``. Varnish is
    a lobe with equal strengths (``beta`` of eq. 1), gold one with a diffuse part near 0 and
    coloured strengths. What every result has: :class:`Sbrdf`. ``sigma`` is at most pi / 2, which
    says that the photographs leave the normal open. There is no ``verdict`` as in the results
    whose pixels share a lobe or a condition (:class:`PooledSbrdf`, :class:`LafortuneSbrdf`):
    ``lobes``, ``status`` and ``converged`` say it for each pixel.

    Attributes
    ----------
    specular
        ``(lobe, band, y, x)`` float32: the strength (``beta`` of eq. 1) of each lobe in each band;
        0 where a pixel has fewer lobes.
    lobes
        ``(y, x)`` uint8: how many lobes the photographs support.
    ambient
        ``(band, y, x)`` float32: light that comes whatever the lamp's direction (inter-reflections,
        a room that is not dark), relative to the white board.
    gamma
        ``(lobe, y, x)`` float32: half-width of the lobe's facets, radians; narrowest first.
    gamma_sigma
        ``(lobe, y, x)`` float32: standard deviation of log gamma; NaN, too, where a search that was
        cut short (``converged``; mostly by ``effort="draft"``) left one whose width nothing tells.
    tinted
        ``(lobe, y, x)`` bool: whether the photographs ask for a strength per band (gold, bronzing);
        False where one strength serves all of them (varnish), or the pixel has no such lobe.
    converged
        ``(y, x)`` bool: whether the pixel's last search ended by its own tests; False where it
        ran out of steps or stalled, and where nothing is estimated.
    index
        Index of refraction of the interface.
    """

    SHAPE: ClassVar[tuple[str, ...]] = ("gamma",)

    ambient: NDArray[np.float32] = field(metadata=over("band", "y", "x"))
    gamma: NDArray[np.float32] = field(metadata=over("lobe", "y", "x", unit="rad"))
    gamma_sigma: NDArray[np.float32] = field(metadata=over("lobe", "y", "x"))
    tinted: NDArray[np.bool_] = field(metadata=over("lobe", "y", "x", dtype=np.bool_))
    converged: NDArray[np.bool_] = field(metadata=over("y", "x", dtype=np.bool_))
    index: float = field(metadata=over(dtype=np.float64))

    def surface(self) -> Surface:
        """The painting with every pixel's lobes and what is ambient, ready to be lit."""
        return Surface.torrance_sparrow(
            self.normal,
            self.diffuse,
            self.specular,
            self.gamma,
            index=self.index,
            ambient=self.ambient,
            **self._place(),
        )

    @property
    def width(self) -> NDArray[np.float32]:
        """``gamma``, by the name that lobes of all models have."""
        return self.gamma

    def _shape_sigma(self, lobe: int, y: int, x: int) -> float:
        return float(self.gamma_sigma[lobe, y, x])

    def report(self) -> dict[str, Any]:
        """Plain numbers of the gloss for a report file."""
        return {**super().report(), "index": self.index}

    def _demand(self, maps: SavedMaps, prefix: str = "") -> None:
        refractive_index(self.index)


def fit_lobes(
    stack: Stack,
    stereo: Normals,
    *,
    lobes: int,
    ambient: bool,
    index: float,
    threads: int | None,
    progress: bool | ProgressCallback,
    effort: Effort = PRESETS["standard"],
    typical: bool = True,
    sparing: bool = True,
) -> LobeSbrdf:
    """Lobes of every pixel, from the maps of photometric stereo; see :func:`impasto.fit_sbrdf`.

    Only here: ``typical=False`` asks no other pixel what is typical of the painting, and
    ``sparing=False`` gives a pixel every lobe that lowers its cost, worth its unknowns or not.
    """
    with reporting(progress, "lobes") as callback:
        found = _core.fit_lobes(
            StackArguments.of(stack),
            StartArguments.of(stereo),
            "torrance-sparrow",
            lobes,
            ambient,
            effort.rounds,
            typical,
            sparing,
            effort.iterations,
            effort.start,
            effort.precision,
            index,
            thread_count(threads),
            callback,
        )
    return LobeSbrdf(
        **shared_fields(found, stack, stereo),
        ambient=found["ambient"],
        specular=found["specular"],
        gamma=found["numbers"][:, 0],
        gamma_sigma=found["spread"],
        tinted=found["tinted"].view(np.bool_),
        lobes=found["lobes"],
        converged=found["converged"].view(np.bool_),
        index=index,
    )


def lobe_count(lobes: Any) -> int:
    """Lobes per pixel, checked."""
    if not (is_whole(lobes) and 1 <= lobes <= MOST_LOBES):
        raise ArgumentError(f"lobes: expected 1 to {MOST_LOBES} per pixel, found {lobes!r}")
    return int(lobes)
