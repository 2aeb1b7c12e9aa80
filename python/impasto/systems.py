"""Systems by name: the procedures of three papers, and that of impasto.

>>> from impasto import simulate, systems
>>> capture = simulate.default_capture("tominaga-rgb-camera", size=(32, 32))
>>> system = systems.get("tominaga-rgb-camera")
>>> sbrdf, reflectance = system.measure(capture.stack, capture.truth.camera)
>>> pictures = system.render(sbrdf, reflectance)
>>> sorted(pictures)
['figure-12']
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np

from impasto._internal.calls import ProgressCallback
from impasto._internal.checks import one_of
from impasto.bands import Camera
from impasto.effort import EffortLike
from impasto.errors import ArgumentError
from impasto.fit.average import with_mean_albedo
from impasto.fit.lafortune import LafortuneSbrdf
from impasto.fit.normals import Method, Normals, fit_normals
from impasto.fit.pooled import Extraction, PooledSbrdf
from impasto.fit.reflectance import Estimator, Reflectance, fit_reflectance, matching_camera
from impasto.fit.sbrdf import fit_sbrdf
from impasto.highlights import leave_out_highlights, reconstruct_highlights
from impasto.image import Image
from impasto.lights import DistantLight
from impasto.render import render
from impasto.scene import Scene
from impasto.stack import Stack, checked_stack
from impasto.training import TrainingSpectra, general_training

__all__ = ["SYSTEMS", "System", "get"]

Name = Literal["impasto", "tominaga-rgb-camera", "tominaga-six-band-adaptation", "snel-lafortune"]

Highlights = Literal["censored", "reconstructed", "left-out"]
"""What becomes of clipped samples."""

Progress = bool | ProgressCallback

ABOVE = DistantLight((0.0, 0.71, 0.71))
"""The light of the papers' pictures (RGB-camera paper, section 6)."""


@dataclass(frozen=True, kw_only=True)
class System:
    """The options of the three fits, and the pictures of a paper.

    Parameters
    ----------
    name
        As in :func:`get`.
    bands
        Required number of bands; None: any number.
    highlights
        ``"censored"``: clipped samples count as such; ``"reconstructed"``: clipped bands are first
        replaced (:func:`impasto.reconstruct_highlights`); ``"left-out"``: clipped samples are
        ignored (:func:`impasto.leave_out_highlights`).
    method, low, high, w1, w2, selection
        Of :func:`impasto.fit_normals`.
    albedo
        ``"least-squares"``: that of :func:`impasto.fit_normals`; ``"mean"``: the mean of the
        outputs that ``w1`` and ``w2`` keep, corrected for the slant of the surface (RGB paper,
        section 4.2 and eq. 8).
    model, pooling, lobes, extraction, peak, joint, index
        Of :func:`impasto.fit_sbrdf`.
    effort
        Of both.
    estimator, rank
        Of :func:`impasto.fit_reflectance`; ``estimator`` None: no spectra, the colours remain those
        of the bands.
    training
        ``"general"`` or ``"default"``: the set to learn from, see
        :func:`impasto.training.general_training`.
    pictures
        Options of :class:`impasto.Scene`, by the picture's name: the number of the figure in the
        paper. ``flat``: rendered without the normals.
    """

    name: Name
    bands: int | None = None
    highlights: Highlights = "censored"
    method: Method = "robust"
    low: float = 0.2
    high: float = 0.8
    w1: float = 1.2
    w2: float = 0.1
    selection: int | str | None = None
    albedo: Literal["least-squares", "mean"] = "least-squares"
    model: Literal["torrance-sparrow", "lafortune"] = "torrance-sparrow"
    pooling: Literal["painting", "pixel"] = "painting"
    lobes: int | None = None
    extraction: Extraction = "residual"
    peak: bool = False
    joint: bool = True
    index: float = 1.45
    effort: EffortLike = "standard"
    estimator: Estimator | None = "ensemble"
    rank: int | None = None
    training: Literal["default", "general"] = "default"
    pictures: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def options(self) -> dict[str, Any]:
        """The options of the three fits, by name."""
        other = {"name", "bands", "pictures"}
        names = [each.name for each in fields(self) if each.name not in other]
        return {name: getattr(self, name) for name in names}

    def measure(
        self,
        stack: Stack,
        camera: Camera | None = None,
        *,
        threads: int | None = None,
        progress: Progress = False,
    ) -> tuple[PooledSbrdf | LafortuneSbrdf, Reflectance | None]:
        """Normals, gloss and spectra of a painting.

        Parameters
        ----------
        stack
            Photographs with their lights.
        camera
            Sensitivities and the light of the photographs. ``"snel-lafortune"`` takes none.
        threads, progress
            As everywhere: None means every allowed core; a bool or a callable ``(done, total)``,
            which starts anew for each of the three fits.

        Returns
        -------
        tuple
            :class:`impasto.PooledSbrdf` and :class:`impasto.Reflectance`; of ``"snel-lafortune"``
            :class:`impasto.LafortuneSbrdf` and None.

        Raises
        ------
        ArgumentError
            No stack, no camera where spectra are estimated or one where they are not, another
            number of bands; and what the fits refuse.
        GeometryError
            Lights that cannot determine normals.
        """
        checked_stack(stack)
        if self.estimator is not None:
            matching_camera(camera, stack.bands)
        elif camera is not None:
            raise ArgumentError(
                f"camera: {self.name} estimates no spectra, its lobes have the colours of the "
                "bands; leave it out"
            )
        stack = self.prepared(stack)
        normals = self.fit_normals(stack, threads=threads, progress=progress)
        sbrdf = self.fit_sbrdf(stack, normals, threads=threads, progress=progress)
        if camera is None:
            return sbrdf, None
        return sbrdf, self.fit_reflectance(stack, sbrdf, camera, threads=threads, progress=progress)

    def prepared(self, stack: Stack) -> Stack:
        """The photographs as this system fits them.

        Raises
        ------
        ArgumentError
            Another number of bands than the system's.
        """
        checked_stack(stack)
        if self.bands is not None and stack.shape[1] != self.bands:
            raise ArgumentError(
                f"stack: {self.name} measures photographs of {self.bands} bands, "
                f"found {stack.shape[1]}"
            )
        if self.highlights == "censored":
            return stack
        reconstruct = self.highlights == "reconstructed"
        return reconstruct_highlights(stack) if reconstruct else leave_out_highlights(stack)

    def fit_normals(
        self, stack: Stack, *, threads: int | None = None, progress: Progress = False
    ) -> Normals:
        """:func:`impasto.fit_normals` with the options of this system."""
        normals = fit_normals(
            stack,
            method=self.method,
            low=self.low,
            high=self.high,
            w1=self.w1,
            w2=self.w2,
            selection=self.selection,
            effort=self.effort,
            threads=threads,
            progress=progress,
        )
        if self.albedo == "least-squares":
            return normals
        return with_mean_albedo(stack, normals, w1=self.w1, w2=self.w2, threads=threads)

    def fit_sbrdf(
        self,
        stack: Stack,
        normals: Normals,
        *,
        threads: int | None = None,
        progress: Progress = False,
    ) -> PooledSbrdf | LafortuneSbrdf:
        """:func:`impasto.fit_sbrdf` with the options of this system."""
        if self.model == "lafortune":
            return fit_sbrdf(
                stack,
                model="lafortune",
                lobes=self.lobes,
                normals=normals,
                effort=self.effort,
                threads=threads,
                progress=progress,
            )
        return fit_sbrdf(
            stack,
            pooling="painting",
            extraction=self.extraction,
            peak=self.peak,
            joint=self.joint,
            index=self.index,
            normals=normals,
            effort=self.effort,
            threads=threads,
            progress=progress,
        )

    def fit_reflectance(
        self,
        stack: Stack,
        sbrdf: PooledSbrdf | LafortuneSbrdf,
        camera: Camera,
        *,
        training: TrainingSpectra | None = None,
        threads: int | None = None,
        progress: Progress = False,
    ) -> Reflectance:
        """:func:`impasto.fit_reflectance` with the options of this system.

        ``training``: other spectra than the system's.

        Raises
        ------
        ArgumentError
            A system that estimates no spectra; and what that function refuses.
        """
        if self.estimator is None:
            raise ArgumentError(f"estimator: {self.name} estimates no spectra")
        if training is None and self.training == "general":
            training = general_training()
        return fit_reflectance(
            stack,
            sbrdf,
            camera,
            estimator=self.estimator,
            training=training,
            rank=self.rank,
            threads=threads,
            progress=progress,
        )

    def render(
        self,
        sbrdf: PooledSbrdf | LafortuneSbrdf,
        reflectance: Reflectance | None = None,
        *,
        threads: int | None = None,
    ) -> dict[str, Image]:
        """The paper's rendered pictures, by name; ``"impasto"`` has none."""
        images = {}
        for name, options in self.pictures.items():
            chosen = dict(options)
            shown: Any = sbrdf
            if chosen.pop("flat", False):
                surface = sbrdf.surface()
                flat = np.where(np.isnan(surface.normal), surface.normal, np.float32(0.0))
                flat[2] += 1.0
                shown = replace(surface, normal=flat)
            scene = Scene([ABOVE], **chosen)
            images[name] = render(shown, scene, reflectance=reflectance, threads=threads)
        return images


_LAMP: Mapping[str, Any] = {"illuminant": "A", "exposure": "maximum"}
_ADAPTED = {**_LAMP, "adaptation": 0.56}
_SLANTED = {"view": (0.64, 0.0, 0.77)}

SYSTEMS: Mapping[Name, System] = {
    system.name: system
    for system in (
        System(name="impasto"),
        # Normals from the green channel by the rule of section 3.2; the mean of the kept outputs
        # (section 4.2) in eq. 4 to 8 with three components; eq. 10 as printed on the brightest
        # samples, in the peak region (section 6), and nothing after it; figure 12.
        System(
            name="tominaga-rgb-camera",
            bands=3,
            method="threshold",
            selection=1,
            albedo="mean",
            extraction="printed",
            peak=True,
            joint=False,
            estimator="linear-model",
            rank=3,
            training="general",
            pictures={"figure-12": {"illuminant": "D65"}},
        ),
        # The paper only says "We devised a procedure to detect the diffuse reflection component".
        # Here: the darker half of the samples, without the darkest tenth. Eq. 5; eq. 6 as printed;
        # figures 8 and 9, from the front and slanted, with Y_W the largest Y of the picture.
        System(
            name="tominaga-six-band-adaptation",
            bands=6,
            method="rank",
            low=0.1,
            high=0.5,
            extraction="printed",
            joint=False,
            estimator="wiener",
            training="general",
            pictures={
                "figure-8-front": _LAMP,
                "figure-8-slanted": {**_LAMP, **_SLANTED},
                "figure-9-front": _ADAPTED,
                "figure-9-slanted": {**_ADAPTED, **_SLANTED},
            },
        ),
        # Section 4: highlights reconstructed; the normal by a cosine lobe, one to three lobes on
        # luminance, colours last; figure 12, without and with the normals.
        System(
            name="snel-lafortune",
            bands=3,
            highlights="reconstructed",
            model="lafortune",
            pooling="pixel",
            lobes=3,
            estimator=None,
            pictures={"figure-12-without-normals": {"flat": True}, "figure-12-with-normals": {}},
        ),
    )
}


def get(name: Name) -> System:
    """A system by name.

    ``"impasto"``
        The defaults of all functions.
    ``"tominaga-rgb-camera"``
        *Measuring and rendering art paintings using an RGB camera*, as written: normals from
        green without highlight (``w1`` = 1.2) and shadow (``w2`` = 0.1), three principal
        components of the mean of the kept outputs, one (beta, gamma) from the brightest sample of
        each pixel at the peak of the highlight, by eq. 10 as printed; shown under D65.
    ``"tominaga-six-band-adaptation"``
        *Image rendering of art paintings: total archives considering surface properties and
        chromatic adaptation*, as written: normals from the darker half of the samples (the paper
        leaves open which are diffuse), Wiener estimation, one (beta, gamma) from the brightest
        sample of each pixel, by eq. 6 as printed; shown under illuminant A, without adaptation
        and to an eye that has adapted by d = 0.56, from the front and from the right.
    ``"snel-lafortune"``
        *Acquisition and rendering of paintings*, section 4: overexposed highlights are
        reconstructed; one to three Lafortune lobes per pixel about a normal of its own, for
        photographs with a view each. It estimates no spectra.

    Raises
    ------
    ArgumentError
        Unknown name.
    """
    one_of(name, SYSTEMS, "name")
    return SYSTEMS[name]
