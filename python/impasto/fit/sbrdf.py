"""One call from photographs to normals, diffuse colours and one lobe for the painting."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto.checks import refractive_index
from impasto.errors import ArgumentError
from impasto.fit.border import (
    ProgressCallback,
    StackArguments,
    reporting,
    thread_count,
)
from impasto.fit.forward import predict
from impasto.fit.lafortune import KIND as LAFORTUNE
from impasto.fit.lafortune import LafortuneSbrdf, fit_lafortune, lafortune_fields
from impasto.fit.lobes import KIND as LOBES
from impasto.fit.lobes import LobeSbrdf, fit_lobes, lobe_count, lobe_fields
from impasto.fit.normals import Method, Normals, fit_normals
from impasto.fit.saved import sbrdf_fields
from impasto.fit.segments import SegmentSbrdf, checked_labels, fit_segments
from impasto.io.results import read_maps, rig_arrays, write_maps
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.status import Status

Model = Literal["torrance-sparrow", "lafortune"]
Pooling = Literal["painting", "segment", "pixel"]
Extraction = Literal["residual", "maximum", "papers"]

LOBES_OF = {"torrance-sparrow": 2, "lafortune": 3}
"""Lobes that a pixel may have, if nobody says otherwise."""

KIND = "impasto.Sbrdf"
"""Says in a saved file what it holds."""


@dataclass(frozen=True, eq=False, repr=False)
class Sbrdf:
    """A painting's surface: what :meth:`predict` needs to light it anew.

    In every map NaN stands exactly where ``status`` is 16 or more, with two exceptions: a
    :attr:`~impasto.Status.DARK` pixel has no normal but a known ``diffuse`` of 0; ``residual`` and
    ``sigma`` of an :attr:`~impasto.Status.EXACT` pixel are NaN where its samples (three lights in
    one band) are no more than its unknowns.

    Attributes
    ----------
    normal
        ``(3, y, x)`` float32 unit vectors.
    diffuse
        ``(band, y, x)`` float32, relative to the white board.
    beta, gamma
        The painting's lobe (six-band paper eq. 1, RGB paper eq. 9): strength relative to the white
        board, half-width of the facets in radians. ``beta`` is 0 where no highlight was found.
    index
        Index of refraction of the interface.
    covariance
        ``(2, 2)`` of (log beta, log gamma); infinite where there is no highlight. From the scatter
        of the pixels' own votes: it says how well the photographs determine the one lobe that fits
        all of them best, not how far a pixel's own lobe may be from it (``misfit``).
    verdict
        ``"fitted"``; ``"mixed"``: a lobe stands out, but ``describes`` is below 0.8: several
        varnishes, or gilding; ``"no-highlight"``: nothing stands out of the noise, ``beta`` is 0;
        ``"at-bound"``: a lobe as sharp as a mirror or as flat as paper.
    curve
        ``(n, 3)`` the measured lobe: phi (rad), specular part over its geometry factor, samples.
    path
        ``(n, 2)`` beta and gamma as they got better, the separate fit of the papers first.
    describes
        Share of the pixels which know their own strength (to 20 %, normal and colours following)
        that agree with the painting's (to 25 % or three standard deviations); NaN if none does.
    converged
        Whether the search for the lobe ended by its own tests; False: after its last step.
    misfit
        ``(y, x)`` float32, 0 to 1: by how much of ``beta`` the pixel's own strength differs from
        it beyond three standard deviations; 0 where the photographs cannot tell.
    residual
        ``(y, x)`` float32 root mean square of the weighted residuals, linear light.
    sigma
        ``(y, x)`` float32 standard deviation of the normal along its worst axis, radians, with the
        lobe known and colours following; noise from the pixel's own residuals.
    status
        ``(y, x)`` uint8, :class:`~impasto.Status`: that of the normals, and ``POOLED`` where the
        pixel's samples do not support the lobe: there ``normal`` and ``diffuse`` are those of
        ``normals``, and the lobe is the painting's only.
    normals
        The photometric stereo that the fit began with.
    rig
        Who lit and who looked.
    bands
        One name per band.
    """

    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    beta: float
    gamma: float
    index: float
    covariance: NDArray[np.float64]
    verdict: str
    curve: NDArray[np.float64]
    path: NDArray[np.float64]
    describes: float
    converged: bool
    misfit: NDArray[np.float32]
    residual: NDArray[np.float32]
    sigma: NDArray[np.float32]
    status: NDArray[np.uint8]
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
            ``(obs, band, y, x)`` float32; NaN where the normal is.
        """
        rig = Rig(
            self.rig if lights is None else lights,
            views=views,
            pitch_mm=lights.pitch_mm if isinstance(lights, Rig) else self.rig.pitch_mm,
        )
        return predict(
            self.normal, self.diffuse, self.beta, self.gamma, rig, index=self.index, threads=threads
        )

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
        share = float((self.status < Status.DARK).mean())
        size = f"{height} x {width} pixels, {len(self.bands)} bands"
        if self.verdict == "no-highlight":
            lobe = "no highlight"
        else:
            spread = [math.sqrt(self.covariance[i, i]) for i in range(2)]
            lobe = (
                f"beta {self.beta:.4g} ± {100 * spread[0]:.1f} %, "
                f"gamma {self.gamma:.4g} rad ± {100 * spread[1]:.1f} %"
            )
            if self.verdict == "mixed":
                lobe += f", but only {100 * self.describes:.0f} % of the pixels agree with it"
            elif self.verdict != "fitted":
                lobe += f" ({self.verdict})"
        if not self.converged:
            lobe += "; the search was still under way at its last step"
        return f"<Sbrdf {size}, {100 * share:.1f} % estimated: {lobe}>"


def load_sbrdf(path: str | os.PathLike[str]) -> Sbrdf | LobeSbrdf | LafortuneSbrdf:
    """Read what the ``save`` of any result of :func:`fit_sbrdf` wrote.

    Raises
    ------
    CorruptInputError
        A file that is truncated, damaged or holds something else; the array is named.
    FileNotFoundError
        There is none.
    """
    with read_maps(path, KIND, LOBES, LAFORTUNE) as maps:
        if maps.kind == LOBES:
            return LobeSbrdf(**lobe_fields(maps))
        if maps.kind == LAFORTUNE:
            return LafortuneSbrdf(**lafortune_fields(maps))
        return Sbrdf(**sbrdf_fields(maps))


@overload
def fit_sbrdf(
    stack: Stack,
    *,
    model: Literal["torrance-sparrow"] = ...,
    pooling: Literal["painting"] = ...,
    extraction: Extraction = ...,
    joint: bool = ...,
    index: float = ...,
    normals: Normals | Method | None = ...,
    threads: int | None = ...,
    progress: bool | ProgressCallback = ...,
) -> Sbrdf: ...


@overload
def fit_sbrdf(
    stack: Stack,
    *,
    model: Literal["torrance-sparrow"] = ...,
    pooling: Literal["pixel"],
    lobes: int | None = ...,
    ambient: bool = ...,
    index: float = ...,
    normals: Normals | Method | None = ...,
    threads: int | None = ...,
    progress: bool | ProgressCallback = ...,
) -> LobeSbrdf: ...


@overload
def fit_sbrdf(
    stack: Stack,
    *,
    model: Literal["lafortune"],
    pooling: Literal["pixel"] = ...,
    lobes: int | None = ...,
    normals: Normals | Method | None = ...,
    threads: int | None = ...,
    progress: bool | ProgressCallback = ...,
) -> LafortuneSbrdf: ...


@overload
def fit_sbrdf(
    stack: Stack,
    *,
    model: Literal["torrance-sparrow"] = ...,
    pooling: Literal["segment"],
    segments: ArrayLike,
    extraction: Extraction = ...,
    joint: bool = ...,
    index: float = ...,
    normals: Normals | Method | None = ...,
    threads: int | None = ...,
    progress: bool | ProgressCallback = ...,
) -> SegmentSbrdf: ...


def fit_sbrdf(
    stack: Stack,
    *,
    model: Model = "torrance-sparrow",
    pooling: Pooling = "painting",
    segments: ArrayLike | None = None,
    lobes: int | None = None,
    ambient: bool = True,
    extraction: Extraction = "residual",
    joint: bool = True,
    index: float = 1.45,
    normals: Normals | Method | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Sbrdf | SegmentSbrdf | LobeSbrdf | LafortuneSbrdf:
    """Estimate normals, diffuse colours and the gloss of a painting.

    Photometric stereo first. Then the specular part of the samples gives one (beta, gamma) for
    the painting by Levenberg-Marquardt (six-band paper eq. 6, RGB paper eq. 10). The papers stop
    here; ``joint`` goes on: the lobe, every normal and all colours are fitted to all samples
    together, so that what a highlight did to a normal is taken back, and normals that scatter
    do not widen the lobe. Robust residual scales keep shadows, and pixels that the model does not
    describe, from ruling the others.

    With ``pooling="pixel"`` every pixel has lobes of its own, each with a width and a strength per
    band, and its normal is fitted with them: for gilding, metal leaf, and varnish that differs
    from place to place. It asks for many lights (some 20 or more); where a pixel's photographs do
    not support a lobe it has fewer (``lobes``).

    With ``model="lafortune"``, the third paper's three passes, every pixel by itself: its normal
    by a cosine lobe with a diffuse term, on the mean of the bands; Lafortune lobes on that mean,
    one more at a time while Schwarz's criterion (BIC) falls; the colours of all terms, band by
    band, by non-negative least squares. Made for hundreds of photographs, each with a view of its
    own; clipped samples count for nothing.

    Parameters
    ----------
    stack
        Photographs with their lights.
    model
        ``"torrance-sparrow"``, the first two papers', or ``"lafortune"``, the third's.
    pooling
        ``"painting"``: one Torrance-Sparrow lobe for all pixels. ``"segment"``: one for every part
        that ``segments`` tells apart; a part whose pixels do not determine a lobe has the
        painting's, and says so. ``"pixel"``: every pixel its own; Lafortune lobes always are.
    segments
        With ``pooling="segment"``: ``(y, x)`` whole numbers, the same for the pixels of one part;
        below 0: of none. Every part takes as long as the painting.
    lobes
        Lobes per pixel at most, 1 to 3; default: 2, of Lafortune's 3.
    ambient
        With ``pooling="pixel"``: whether every pixel has a constant per band for light that comes
        from everywhere, as between the facets of a relief.
    extraction
        Which samples carry the first estimate of the lobe: ``"residual"`` (default): all that are
        not in shadow, by what the diffuse part leaves; ``"maximum"``: each pixel's brightest
        photograph; ``"papers"``: the same divided by its geometry factor ``F G / (N.V)``, as eq. 6
        and 10 are written.
    joint
        False stops at that estimate, with the normals and colours of photometric stereo: the
        papers' procedure.
    index
        Index of refraction of the interface; 1.45 in the papers.
    normals
        What :func:`impasto.fit_normals` returned, or the name of one of its methods; default:
        its own default.
    threads
        None means every allowed core.
    progress
        True: a bar on stderr; or a callable ``(done, total)`` in tiles, which starts anew for
        each of the two stages.

    Returns
    -------
    Sbrdf
        Maps and the lobe. With ``pooling="segment"`` a :class:`SegmentSbrdf`, a lobe for every
        part; with ``pooling="pixel"`` a :class:`LobeSbrdf`, maps of every pixel's
        lobes; with ``model="lafortune"`` a :class:`LafortuneSbrdf`.

    Raises
    ------
    ArgumentError
        An unknown name, an index outside 1 to 100, lobes outside 1 to 3, normals of another size,
        segments that are no whole numbers ``(y, x)``, or without ``pooling="segment"``.
    GeometryError
        Lights that cannot determine normals.

    References
    ----------
    S. Tominaga and N. Tanaka, papers on measuring and rendering art paintings by an RGB camera
    (eq. 9, 10) and by a six-band camera (eq. 1, 6). E. Snel, J. Heuberger, W. Pasman and
    E. Jansen, Acquisition and rendering of paintings (section 4). E. Lafortune et al., Non-linear
    approximation of reflectance functions, SIGGRAPH 1997.
    """
    _one_of(model, Model, "model")
    _one_of(pooling, Pooling, "pooling")
    _one_of(extraction, Extraction, "extraction")
    index = refractive_index(index)
    most = lobe_count(LOBES_OF[model] if lobes is None else lobes)
    if pooling == "segment":
        labels = checked_labels(segments, stack.shape[2:])
    elif segments is not None:
        raise ArgumentError(f'segments: pooling is {pooling!r}; only "segment" takes them')
    if pooling == "segment" and model == "lafortune":
        raise ArgumentError('pooling: Lafortune lobes are fitted pixel by pixel, found "segment"')
    stereo = _stereo(stack, normals, threads, progress)
    if model == "lafortune":
        return fit_lafortune(stack, stereo, lobes=most, threads=threads, progress=progress)
    if pooling == "pixel":
        return fit_lobes(
            stack,
            stereo,
            lobes=most,
            ambient=ambient,
            index=index,
            threads=threads,
            progress=progress,
        )
    if pooling == "segment":

        def pooled_fit(stereo: Normals) -> Sbrdf:
            return fit_sbrdf(
                stack,
                extraction=extraction,
                joint=joint,
                index=index,
                normals=stereo,
                threads=threads,
                progress=progress,
            )

        return fit_segments(labels, stereo, pooled_fit)
    with reporting(progress, "gloss") as callback:
        pooled = _core.fit_pooled(
            StackArguments.of(stack),
            np.ascontiguousarray(stereo.normal, dtype=np.float32),
            np.ascontiguousarray(stereo.albedo, dtype=np.float32),
            np.ascontiguousarray(stereo.status, dtype=np.uint8),
            extraction,
            bool(joint),
            index,
            thread_count(threads),
            callback,
        )
    return Sbrdf(
        normal=pooled["normal"],
        diffuse=pooled["diffuse"],
        beta=pooled["beta"],
        gamma=pooled["gamma"],
        index=index,
        covariance=np.array(pooled["covariance"], dtype=np.float64),
        verdict=pooled["verdict"],
        curve=np.array(pooled["curve"], dtype=np.float64).reshape(-1, 3),
        path=np.array(pooled["path"], dtype=np.float64).reshape(-1, 2),
        describes=pooled["describes"],
        converged=pooled["converged"],
        residual=pooled["residual"],
        sigma=pooled["sigma"],
        misfit=pooled["misfit"],
        status=pooled["status"],
        normals=stereo,
        rig=stack.rig,
        bands=stack.bands,
    )


def _stereo(
    stack: Stack,
    normals: Normals | Method | None,
    threads: int | None,
    progress: bool | ProgressCallback,
) -> Normals:
    if normals is None:
        return fit_normals(stack, threads=threads, progress=progress)
    if isinstance(normals, str):
        return fit_normals(stack, method=normals, threads=threads, progress=progress)
    if not isinstance(normals, Normals):
        raise ArgumentError(
            "normals: expected what impasto.fit_normals returns, the name of one of its methods "
            f"or None, found {type(normals).__name__}"
        )
    _, bands, height, width = stack.shape
    if normals.albedo.shape != (bands, height, width):
        raise ArgumentError(
            f"normals: their albedo has the shape {normals.albedo.shape}, the stack needs "
            f"{(bands, height, width)}; fit them to this stack"
        )
    return normals


def _one_of(value: Any, names: Any, argument: str) -> None:
    if value not in get_args(names):
        expected = " or ".join(map(repr, get_args(names)))
        raise ArgumentError(f"{argument}: expected {expected}, found {value!r}")
