"""Every pixel's own lobes about a free normal, and what they show under other lights."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto.checks import refractive_index
from impasto.errors import ArgumentError
from impasto.fit.border import ProgressCallback, StackArguments, reporting, thread_count
from impasto.fit.forward import predict
from impasto.fit.normals import Normals
from impasto.fit.saved import saved_normals
from impasto.io.results import SavedMaps, rig_arrays, rig_from_arrays, write_maps
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.status import Status

KIND = "impasto.LobeSbrdf"
"""Says in a saved file what it holds."""

MOST_LOBES = 3


@dataclass(frozen=True, eq=False, repr=False)
class LobeSbrdf:
    """A painting whose pixels have lobes of their own.

    The model is eq. 1 of the six-band paper with a strength per band and lobe, and a constant:
    ``irradiance * (diffuse N.L + sum over lobes of specular D F G / (N.V)) + ambient``. Varnish is
    a lobe with equal strengths, gold one with a diffuse part near 0 and coloured strengths.

    In every map NaN stands exactly where ``status`` is 16 or more, with two exceptions: a lobe
    that a pixel does not have (``lobes``) has a ``specular`` of 0 and no shape; and a
    :attr:`~impasto.Status.DARK` pixel has no normal but colours of 0.

    Attributes
    ----------
    normal
        ``(3, y, x)`` float32 unit vectors.
    diffuse
        ``(band, y, x)`` float32, relative to the white board.
    ambient
        ``(band, y, x)`` float32: light that comes whatever the lamp's direction (inter-reflections,
        a room that is not dark), relative to the white board.
    specular
        ``(lobe, band, y, x)`` float32: the strength (``beta`` of eq. 1) of each lobe in each band.
    gamma
        ``(lobe, y, x)`` float32: half-width of the lobe's facets, radians; narrowest first.
    gamma_sigma
        ``(lobe, y, x)`` float32: standard deviation of log gamma.
    lobes
        ``(y, x)`` uint8: how many lobes the photographs support.
    residual
        ``(y, x)`` float32 root mean square of the residuals, linear light.
    sigma
        ``(y, x)`` float32 standard deviation of the normal along its worst axis, radians; at
        most pi / 2, which says that the photographs leave the normal open.
    status
        ``(y, x)`` uint8, :class:`~impasto.Status`.
    index
        Index of refraction of the interface.
    normals
        The photometric stereo that the fit began with.
    rig
        Who lit and who looked.
    bands
        One name per band.
    """

    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    ambient: NDArray[np.float32]
    specular: NDArray[np.float32]
    gamma: NDArray[np.float32]
    gamma_sigma: NDArray[np.float32]
    lobes: NDArray[np.uint8]
    residual: NDArray[np.float32]
    sigma: NDArray[np.float32]
    status: NDArray[np.uint8]
    index: float
    normals: Normals
    rig: Rig
    bands: tuple[str, ...]

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        height, width = self.status.shape
        return height, width

    @property
    def pitch_mm(self) -> float | None:
        """Width of a pixel on the painting in mm, if known."""
        return self.rig.pitch_mm

    def predict(
        self,
        lights: Any = None,
        views: ArrayLike | None = None,
        *,
        threads: int | None = None,
    ) -> NDArray[np.float32]:
        """Samples that the surface shows, white board 1.0.

        Parameters
        ----------
        lights
            ``(obs, 3)`` directions, a sequence of :class:`~impasto.DistantLight` and
            :class:`~impasto.PointLight`, or a :class:`~impasto.Rig`; default: the rig's own.
        views
            ``(obs, 3)`` or ``(3,)`` directions to the eye; default: those of the rig, frontal for
            lights without one.
        threads
            None means every allowed core.

        Returns
        -------
        ndarray
            ``(obs, band, y, x)`` float32; NaN where the normal is. The ambient part is that of the
            photographs, times the light's intensity.
        """
        rig = Rig(
            self.rig if lights is None else lights,
            views=views,
            pitch_mm=lights.pitch_mm if isinstance(lights, Rig) else self.rig.pitch_mm,
        )
        # A lobe that a pixel does not have shows nothing, whatever its width.
        gamma = np.where(np.isnan(self.gamma), np.float32(1.0), self.gamma)
        shown = np.empty((len(rig.lights), len(self.bands), *self.shape), np.float32)
        for band in range(len(self.bands)):
            shown[:, band] = predict(
                self.normal,
                self.diffuse[band : band + 1],
                self.specular[:, band],
                gamma,
                rig,
                index=self.index,
                threads=threads,
            )[:, 0]
        shown += rig.intensities.astype(np.float32)[:, None, None, None] * self.ambient
        return shown

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an ``.npz``; the file appears whole or not at all.

        Raises
        ------
        ArgumentError
            Another suffix.
        """
        plain = {
            field.name: np.asarray(getattr(self, field.name))
            for field in fields(self)
            if field.name not in {"normals", "rig"}
        }
        stereo = {
            f"normals.{field.name}": np.asarray(getattr(self.normals, field.name))
            for field in fields(self.normals)
        }
        write_maps(path, KIND, plain | stereo | rig_arrays(self.rig))

    def __repr__(self) -> str:
        height, width = self.shape
        fine = self.status < Status.DARK
        size = f"{height} x {width} pixels, {len(self.bands)} bands"
        counts = np.bincount(self.lobes[fine].ravel(), minlength=2) / max(int(fine.sum()), 1)
        share = ", ".join(
            f"{100 * part:.0f} % with {count or 'no'} lobe{'s' * (count != 1)}"
            for count, part in enumerate(counts)
        )
        return f"<LobeSbrdf {size}, {100 * float(fine.mean()):.1f} % estimated: {share}>"


def fit_lobes(
    stack: Stack,
    stereo: Normals,
    *,
    lobes: int,
    ambient: bool,
    index: float,
    threads: int | None,
    progress: bool | ProgressCallback,
    free: bool = True,
    rounds: int = 2,
    typical: bool = True,
) -> LobeSbrdf:
    """Lobes of every pixel, from the maps of photometric stereo; see :func:`impasto.fit_sbrdf`."""
    with reporting(progress, "lobes") as callback:
        found = _core.fit_lobes(
            StackArguments.of(stack),
            np.ascontiguousarray(stereo.normal, dtype=np.float32),
            np.ascontiguousarray(stereo.albedo, dtype=np.float32),
            np.ascontiguousarray(stereo.status, dtype=np.uint8),
            "torrance-sparrow",
            lobes,
            bool(ambient),
            free,
            rounds,
            typical,
            index,
            thread_count(threads),
            callback,
        )
    return LobeSbrdf(
        normal=found["normal"],
        diffuse=found["diffuse"],
        ambient=found["ambient"],
        specular=found["specular"],
        gamma=found["numbers"][:, 0],
        gamma_sigma=found["spread"],
        lobes=found["lobes"],
        residual=found["residual"],
        sigma=found["sigma"],
        status=found["status"],
        index=index,
        normals=stereo,
        rig=stack.rig,
        bands=stack.bands,
    )


def lobe_count(lobes: Any) -> int:
    """Lobes per pixel, checked."""
    whole = isinstance(lobes, int | np.integer) and not isinstance(lobes, bool)
    if not (whole and 1 <= lobes <= MOST_LOBES):
        raise ArgumentError(f"lobes: expected 1 to {MOST_LOBES} per pixel, found {lobes!r}")
    return int(lobes)


def lobe_fields(maps: SavedMaps) -> dict[str, Any]:
    """The arguments of :class:`LobeSbrdf`, or a refusal that names file and array."""
    bands = tuple(str(name) for name in maps.array("bands", np.str_, (None,)))
    height, width = maps.array("status", np.uint8, (None, None)).shape
    count = maps.array("gamma", np.float32, (None, height, width)).shape[0]
    planes: dict[str, tuple[int, ...]] = {
        "normal": (3,),
        "diffuse": (len(bands),),
        "ambient": (len(bands),),
        "specular": (count, len(bands)),
        "gamma": (count,),
        "gamma_sigma": (count,),
        "residual": (),
        "sigma": (),
    }
    return {
        **{
            name: maps.array(name, np.float32, (*sizes, height, width))
            for name, sizes in planes.items()
        },
        "lobes": maps.array("lobes", np.uint8, (height, width)),
        "status": maps.array("status", np.uint8, (height, width)),
        "index": refractive_index(float(maps.array("index", np.float64, ()))),
        "normals": saved_normals(maps, len(bands), height, width),
        "rig": rig_from_arrays(maps),
        "bands": bands,
    }
