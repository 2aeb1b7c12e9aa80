"""Lafortune lobes of every pixel: the three passes of the third paper."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto.fit.border import ProgressCallback, StackArguments, reporting, thread_count
from impasto.fit.forward import predict_lobes
from impasto.fit.normals import Normals
from impasto.fit.saved import saved_normals
from impasto.io.results import SavedMaps, rig_arrays, rig_from_arrays, write_maps
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.status import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KIND = "impasto.LafortuneSbrdf"
"""Says in a saved file what it holds."""


@dataclass(frozen=True, eq=False, repr=False)
class LafortuneSbrdf:
    """A painting whose pixels have Lafortune lobes of their own.

    Radiance ``irradiance (N.L) (diffuse + sum over lobes of specular d^exponent)`` with
    ``d = cxy (L.V - (N.L)(N.V)) + cz (N.L)(N.V)``, 0 where it is negative: Lafortune et al. 1997
    with ``Cx = Cy``, about the free normal of the third paper. Only ``specular * d**exponent``
    means anything: ``(cxy, cz)`` could be longer and ``specular`` smaller. Here, as in McAllister
    et al. 2002, the strength stands apart: ``cxy**2 + cz**2 = 2``, so that Phong's mirror lobe is
    (-1, 1) and ``specular`` its peak.

    In every map NaN stands exactly where ``status`` is 16 or more, with these exceptions: a lobe
    that a pixel does not have (``lobes``) has a ``specular`` of 0 and no shape; ``sigma`` is NaN
    where the normal is that of photometric stereo.

    Attributes
    ----------
    normal
        ``(3, y, x)`` float32 unit vectors: where a cosine lobe points that was fitted to the mean
        of the bands, with a diffuse term.
    diffuse
        ``(band, y, x)`` float32, relative to the white board.
    specular
        ``(lobe, band, y, x)`` float32 strength of each lobe in each band, from 0 on.
    cxy, cz, exponent
        ``(lobe, y, x)`` float32 shape of each lobe, the sharpest first.
    lobes
        ``(y, x)`` uint8: how many lobes the photographs support.
    residual
        ``(y, x)`` float32 root mean square of the residuals, linear light.
    sigma
        ``(y, x)`` float32 standard deviation of the normal along its worst axis, radians, from the
        pixel's own residuals.
    status
        ``(y, x)`` uint8, :class:`~impasto.Status`.
    verdict
        ``"fitted"``; ``"one-view"``: all photographs show the painting from one direction, which
        cannot tell a tilted normal from a tilted lobe: normals are those of photometric stereo,
        lobes are Phong's (``cxy = -1``, ``cz = 1``).
    normals
        The photometric stereo that the fit began with.
    rig
        Who lit and who looked.
    bands
        One name per band.
    """

    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    specular: NDArray[np.float32]
    cxy: NDArray[np.float32]
    cz: NDArray[np.float32]
    exponent: NDArray[np.float32]
    lobes: NDArray[np.uint8]
    residual: NDArray[np.float32]
    sigma: NDArray[np.float32]
    status: NDArray[np.uint8]
    verdict: str
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
        progress: bool | ProgressCallback = False,
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
        threads, progress
            None means every allowed core; a bool or a callable ``(done, total)``.

        Returns
        -------
        ndarray
            ``(obs, band, y, x)`` float32; NaN where the normal is.
        """
        rig = Rig(
            self.rig if lights is None else lights,
            views=views,
            pitch_mm=lights.pitch_mm if isinstance(lights, Rig) else self.rig.pitch_mm,
        )
        return predict_lobes(
            self.normal,
            self.diffuse,
            self.specular,
            self.cxy,
            self.cz,
            self.exponent,
            rig,
            threads=threads,
            progress=progress,
        )

    def lobe_plot(self, y: int, x: int, stack: Stack | None = None) -> Figure:
        """Draw a pixel's lobes: as ``impasto.plots.lobe_plot`` does."""
        from impasto.plots import lobe_plot

        return lobe_plot(self, y, x, stack)

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
        counts = np.bincount(self.lobes[fine], minlength=2) / max(int(fine.sum()), 1)
        share = ", ".join(
            f"{100 * part:.0f} % with {count or 'no'} lobe{'s' * (count != 1)}"
            for count, part in enumerate(counts)
            if part > 0
        )
        told = "" if self.verdict == "fitted" else f" ({self.verdict})"
        estimated = f"{100 * float(fine.mean()):.1f} % estimated"
        return f"<LafortuneSbrdf {size}, {estimated}{told}: {share or 'none'}>"


def fit_lafortune(
    stack: Stack,
    stereo: Normals,
    *,
    lobes: int,
    threads: int | None,
    progress: bool | ProgressCallback,
) -> LafortuneSbrdf:
    """Lobes of every pixel, from the maps of photometric stereo; see :func:`impasto.fit_sbrdf`."""
    with reporting(progress, "lobes") as callback:
        found = _core.fit_lafortune(
            StackArguments.of(stack),
            np.ascontiguousarray(stereo.normal, dtype=np.float32),
            np.ascontiguousarray(stereo.albedo, dtype=np.float32),
            np.ascontiguousarray(stereo.status, dtype=np.uint8),
            int(lobes),
            thread_count(threads),
            callback,
        )
    return LafortuneSbrdf(
        normal=found["normal"],
        diffuse=found["diffuse"],
        specular=found["specular"],
        cxy=found["cxy"],
        cz=found["cz"],
        exponent=found["exponent"],
        lobes=found["lobes"],
        residual=found["residual"],
        sigma=found["sigma"],
        status=found["status"],
        verdict="fitted" if found["views_differ"] else "one-view",
        normals=stereo,
        rig=stack.rig,
        bands=stack.bands,
    )


def lafortune_fields(maps: SavedMaps) -> dict[str, Any]:
    """The arguments of :class:`LafortuneSbrdf`, or a refusal that names file and array."""
    bands = tuple(str(name) for name in maps.array("bands", np.str_, (None,)))
    height, width = maps.array("status", np.uint8, (None, None)).shape
    count = maps.array("exponent", np.float32, (None, height, width)).shape[0]
    verdict = str(maps.array("verdict", np.str_, ()))
    maps.demand("verdict", verdict in {"fitted", "one-view"}, f"is {verdict!r}")
    planes: dict[str, tuple[int, ...]] = {
        "normal": (3,),
        "diffuse": (len(bands),),
        "specular": (count, len(bands)),
        "cxy": (count,),
        "cz": (count,),
        "exponent": (count,),
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
        "verdict": verdict,
        "normals": saved_normals(maps, len(bands), height, width),
        "rig": rig_from_arrays(maps),
        "bands": bands,
    }
