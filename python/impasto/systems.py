"""Systems by name: the procedures of two papers, and that of impasto.

>>> from impasto import simulate, systems
>>> capture = simulate.default_capture("tominaga-rgb-camera", size=(32, 32))
>>> system = systems.get("tominaga-rgb-camera")
>>> sbrdf, reflectance = system.measure(capture.stack, capture.truth.camera)
>>> pictures = system.render(sbrdf, reflectance)
>>> sorted(pictures)
['front']
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from impasto._internal.calls import ProgressCallback
from impasto._internal.checks import one_of
from impasto.bands import Camera
from impasto.effort import EffortLike
from impasto.errors import ArgumentError
from impasto.fit.normals import Method, Normals, fit_normals
from impasto.fit.pooled import Extraction, PooledSbrdf
from impasto.fit.reflectance import Estimator, Reflectance, fit_reflectance, matching_camera
from impasto.fit.sbrdf import fit_sbrdf
from impasto.render import Image, render
from impasto.rig import DistantLight
from impasto.scene import Scene
from impasto.stack import Stack, checked_stack

__all__ = ["SYSTEMS", "System", "get"]

Name = Literal["impasto", "tominaga-rgb-camera", "tominaga-six-band-adaptation"]

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
    method, low, high, w1, w2, selection
        Of :func:`impasto.fit_normals`.
    model, pooling, extraction, joint, index
        Of :func:`impasto.fit_sbrdf`.
    effort
        Of both.
    estimator, rank
        Of :func:`impasto.fit_reflectance`.
    pictures
        Options of :class:`impasto.Scene`, by the picture's name.
    """

    name: Name
    bands: int | None = None
    method: Method = "robust"
    low: float = 0.2
    high: float = 0.8
    w1: float = 1.2
    w2: float = 0.1
    selection: int | str | None = None
    model: Literal["torrance-sparrow"] = "torrance-sparrow"
    pooling: Literal["painting"] = "painting"
    extraction: Extraction = "residual"
    joint: bool = True
    index: float = 1.45
    effort: EffortLike = "standard"
    estimator: Estimator = "root-polynomial"
    rank: int | None = None
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
        camera: Camera,
        *,
        threads: int | None = None,
        progress: Progress = False,
    ) -> tuple[PooledSbrdf, Reflectance]:
        """Normals, gloss and spectra of a painting.

        Parameters
        ----------
        stack
            Photographs with their lights.
        camera
            Sensitivities and the light of the photographs.
        threads, progress
            As everywhere: None means every allowed core; a bool or a callable ``(done, total)``,
            which starts anew for each of the three fits.

        Raises
        ------
        ArgumentError
            No stack, no camera, or of another number of bands; and what the fits refuse.
        GeometryError
            Lights that cannot determine normals.
        """
        matching_camera(camera, checked_stack(stack).bands)
        normals = self.fit_normals(stack, threads=threads, progress=progress)
        sbrdf = self.fit_sbrdf(stack, normals, threads=threads, progress=progress)
        return sbrdf, self.fit_reflectance(stack, sbrdf, camera, threads=threads, progress=progress)

    def fit_normals(
        self, stack: Stack, *, threads: int | None = None, progress: Progress = False
    ) -> Normals:
        """:func:`impasto.fit_normals` with the options of this system."""
        checked_stack(stack)
        if self.bands is not None and stack.shape[1] != self.bands:
            raise ArgumentError(
                f"stack: {self.name} measures photographs of {self.bands} bands, "
                f"found {stack.shape[1]}"
            )
        return fit_normals(
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

    def fit_sbrdf(
        self,
        stack: Stack,
        normals: Normals,
        *,
        threads: int | None = None,
        progress: Progress = False,
    ) -> PooledSbrdf:
        """:func:`impasto.fit_sbrdf` with the options of this system."""
        return fit_sbrdf(
            stack,
            model=self.model,
            pooling=self.pooling,
            extraction=self.extraction,
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
        sbrdf: PooledSbrdf,
        camera: Camera,
        *,
        threads: int | None = None,
        progress: Progress = False,
    ) -> Reflectance:
        """:func:`impasto.fit_reflectance` with the options of this system."""
        return fit_reflectance(
            stack,
            sbrdf,
            camera,
            estimator=self.estimator,
            rank=self.rank,
            threads=threads,
            progress=progress,
        )

    def render(
        self, sbrdf: PooledSbrdf, reflectance: Reflectance, *, threads: int | None = None
    ) -> dict[str, Image]:
        """The paper's pictures, by name; ``"impasto"`` has none."""
        return {
            name: render(sbrdf, Scene([ABOVE], **options), reflectance=reflectance, threads=threads)
            for name, options in self.pictures.items()
        }


_LAMP = {"illuminant": "A", "adaptation": 0.56}

SYSTEMS: Mapping[Name, System] = {
    system.name: system
    for system in (
        System(name="impasto"),
        # Normals from the green channel by the rule of section 3.2; eq. 4 to 8 with three
        # components; eq. 10 on the brightest samples, and nothing after it; figure 12.
        System(
            name="tominaga-rgb-camera",
            bands=3,
            method="threshold",
            selection=1,
            extraction="papers",
            joint=False,
            estimator="linear-model",
            rank=3,
            pictures={"front": {"illuminant": "D65"}},
        ),
        # The paper only says "We devised a procedure to detect the diffuse reflection component".
        # Here: the darker half of the samples, without the darkest tenth. Eq. 5; eq. 6;
        # figure 9, from the front and slanted.
        System(
            name="tominaga-six-band-adaptation",
            method="rank",
            low=0.1,
            high=0.5,
            extraction="papers",
            joint=False,
            estimator="wiener",
            pictures={"front": _LAMP, "slanted": _LAMP | {"view": (0.64, 0.0, 0.77)}},
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
        components, one (beta, gamma) from the brightest sample of each pixel; shown under D65.
    ``"tominaga-six-band-adaptation"``
        *Image rendering of art paintings: total archives considering surface properties and
        chromatic adaptation*, as written: normals from the darker half of the samples (the paper
        leaves open which are diffuse), Wiener estimation, one (beta, gamma) from the brightest
        sample of each pixel; shown under illuminant A to an eye that has adapted by d = 0.56,
        from the front and from the right.

    Raises
    ------
    ArgumentError
        Unknown name.
    """
    one_of(name, SYSTEMS, "name")
    return SYSTEMS[name]
