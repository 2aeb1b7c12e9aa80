"""What every fitted painting holds and can do, whatever its model."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self, get_args

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import ProgressCallback
from impasto._internal.checks import one_of, picked
from impasto._internal.rotation import quarter_turns_of
from impasto._internal.viewing import Viewable
from impasto._internal.waiting import wait_for
from impasto._internal.windows import place
from impasto.fit.choice import Choice
from impasto.fit.gloss import Gloss, gloss_of_pixels
from impasto.fit.normals import Normals
from impasto.fit.pixel import Pixel, lobes_of
from impasto.fit.pixel_maps import PixelMaps
from impasto.fit.relief import Relief, relief_of
from impasto.fit.residuals import Residuals, residuals_of
from impasto.fit.saved import Reader, arrays_of, over
from impasto.height import integrate_normals
from impasto.image import Image
from impasto.io.results import SavedMaps, rig_from_arrays, write_maps
from impasto.level import Level
from impasto.lights import DistantLight, PointLight
from impasto.picture import Fidelity
from impasto.render import render
from impasto.rig import FRONTAL, PointView, Rig, Views
from impasto.scene import Scene
from impasto.stack import Stack
from impasto.status import Status
from impasto.surface import Relightable, Surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


@dataclass(frozen=True, eq=False, repr=False)
class Sbrdf(PixelMaps, Viewable, Relightable):
    """A painting's surface: the members of every result of :func:`impasto.fit_sbrdf`.

    Every map is NaN exactly where ``status`` is 16 or more, and where its class says so. A
    :attr:`~impasto.Status.DARK` pixel has no normal, but known colours: 0.

    Attributes
    ----------
    normal
        ``(3, y, x)`` float32 unit vectors: x right, y up, z towards the viewer.
    diffuse
        ``(band, y, x)`` float32, relative to the white board.
    residual
        ``(y, x)`` float32 root mean square of the residuals, linear light.
    sigma
        ``(y, x)`` float32 standard deviation of the normal along its worst axis, radians, from the
        residuals of the pixel. It contains what they show of errors of the model (see
        :doc:`numerics`), not what all photographs share: wrong lights, or several varnishes under
        one lobe that leave no residual.
    status
        ``(y, x)`` uint8, :class:`~impasto.Status`.
    normals
        The photometric stereo that the fit started from.
    rig
        Who lit and who looked.
    bands
        One name per band.
    chosen
        What ``pooling="auto"`` chose, and against what; None where the caller chose.
    residuals
        What the model leaves of the photographs, interpolated to new lights by :meth:`predict` and
        :func:`impasto.render`; None where that predicts no better, or was not wanted.
    relief
        The painting's cast shadows and interreflections, of which normals and colours are free and
        which :meth:`predict` shows; None where that predicts no better, or was not wanted.
    """

    normal: NDArray[np.float32] = field(metadata=over("axis", "y", "x"))
    diffuse: NDArray[np.float32] = field(metadata=over("band", "y", "x"))
    residual: NDArray[np.float32] = field(metadata=over("y", "x"))
    sigma: NDArray[np.float32] = field(metadata=over("y", "x", unit="rad"))
    status: NDArray[np.uint8] = field(metadata=over("y", "x", dtype=np.uint8))
    normals: Normals
    rig: Rig
    bands: tuple[str, ...] = field(metadata=over("band", dtype=np.str_))
    chosen: Choice | None = field(default=None, kw_only=True)
    residuals: Residuals | None = field(default=None, kw_only=True)
    relief: Relief | None = field(default=None, kw_only=True)

    @property
    @abstractmethod
    def gloss(self) -> Gloss:
        """One (beta, gamma) for the whole painting, with its spread."""

    @property
    def pitch_mm(self) -> float | None:
        """Width of a pixel in the unit of the rig: mm, or pixels as in ``known_pitch_mm``."""
        return self.rig.pitch_mm

    @property
    def known_pitch_mm(self) -> float | None:
        """Width of a pixel in mm; None where nobody has said it, also where the rig is refined."""
        return self.rig.known_pitch_mm

    def predict(
        self,
        lights: Any = None,
        views: Views | None = None,
        *,
        fidelity: Fidelity = "photographs",
        threads: int | None = None,
        progress: bool | ProgressCallback = False,
    ) -> NDArray[np.float32]:
        """Samples that the surface shows, white board 1.0.

        Parameters
        ----------
        lights
            ``(obs, 3)`` directions, a sequence of :class:`~impasto.DistantLight` and
            :class:`~impasto.PointLight`, or a :class:`~impasto.Rig`; default: the rig's own. If
            the rig was refined (:func:`impasto.refine_rig`), directions are lamps of this rig
            (:meth:`impasto.Rig.at`), and so is a rig of nothing but directions, as light files
            give it. A sequence of lights and any other rig are what they say.
        views
            ``(obs, 3)`` or ``(3,)`` directions to the eye, or :class:`~impasto.PointView`;
            default: those of the rig, frontal for lights without one.
        fidelity
            ``"photographs"``: the model and, where there are any, its interpolated ``residuals``,
            seen as the photographs were; ``"model"``: the model alone. Both have the shadows and
            interreflections of ``relief``, if there is one; :func:`impasto.render` shows them with
            ``"photographs"`` only.
        threads, progress
            None means every allowed core; a bool or a callable ``(done, total)``.

        Returns
        -------
        ndarray
            ``(obs, band, y, x)`` float32; NaN where the normal is. Ambient light is that of the
            photographs, times the light's intensity. No sample exceeds the largest float32.
        """
        one_of(fidelity, get_args(Fidelity), "fidelity")
        rig = self.lamps(self.rig if lights is None else lights)
        shown = self.modelled(rig, views, threads=threads, progress=progress)
        if self.residuals is not None and fidelity == "photographs":
            self.residuals.add_to(shown, self.rig, self._placed(rig, views))
        return shown

    def add_residuals(self, shown: NDArray[np.float32], residuals: Residuals, rig: Rig) -> None:
        """Add, in place, other residuals to what the model shows in :meth:`predict`."""
        residuals.add_to(shown, self.rig, self._placed(self.lamps(rig), None))

    def modelled(
        self,
        rig: Any,
        views: Views | None = None,
        *,
        threads: int | None = None,
        progress: bool | ProgressCallback = False,
    ) -> NDArray[np.float32]:
        """What :meth:`predict` shows without residuals, of lights that are what they say."""
        surface = self.surface()
        shown = surface.predict(rig, views, threads=threads, progress=progress)
        if self.relief is not None:
            placed = Rig(self._placed(rig, views), origin=self.rig.origin)
            self.relief.add_to(shown, surface.diffuse, surface.ambient, placed)
        return shown

    def lamps(self, rig: Any) -> Any:
        """The lights for which :meth:`predict` takes others.

        Lamps of the refined rig where there is one and nothing but directions is given; all others
        as they are.
        """
        if self.rig.refinement is not None and _directions_only(rig):
            return self.rig.at(rig)
        return rig

    def _placed(self, rig: Any, views: Views | None) -> Rig:
        pitch = getattr(rig, "pitch_mm", None) or self.pitch_mm
        return Rig(rig, views=views, pitch_mm=pitch)

    def eye(self) -> tuple[float, float, float] | PointView:
        """The near camera of all photographs; in front if there is none."""
        places = self.rig.view_positions
        if not self.rig.near_views.all() or not (places == places[0]).all():
            return FRONTAL
        x, y, z = places[0].tolist()
        return PointView((x, y, z))

    def unmodelled(self, rig: Rig) -> NDArray[np.float32] | None:
        """What photographs show besides the surface under all lights of a rig.

        That is what ``residuals`` and ``relief`` say.
        """
        if self.residuals is None and self.relief is None:
            return None
        surface = self.surface()
        total = np.zeros_like(surface.diffuse)
        for light in range(len(rig)):
            one = rig.take([light])
            shown = self.modelled(one)
            if self.residuals is not None:
                self.residuals.add_to(shown, self.rig, one)
            total += (shown - surface.predict(one))[0]
        return total

    def render(self, scene: Scene, **options: Any) -> Image:
        """Render the painting: :func:`impasto.render`, which has the same options."""
        return render(self, scene, **options)

    def height(
        self,
        pitch_mm: float | None = None,
        *,
        level: bool | Level = False,
        threads: int | None = None,
        progress: bool | ProgressCallback = False,
    ) -> NDArray[np.float32]:
        """Height of the painting: its normals, integrated by :func:`impasto.integrate_normals`.

        Parameters
        ----------
        pitch_mm
            Width of a pixel in mm; default: that of the result. Where neither is known, heights
            are in pixels.
        level
            True: heights about the plane of the panel, as :func:`impasto.find_level` finds it; or
            that plane, with its bending. Default: with the lean of the panel.
        threads, progress
            None means every allowed core; a bool or a callable ``(done, total)``.

        Returns
        -------
        ndarray
            ``(y, x)`` float32, mm, towards the viewer; mean 0. A number everywhere: what
            ``status`` calls unknown is bridged.

        Raises
        ------
        ArgumentError
            A wrong pitch, or a level that is none.
        """
        return integrate_normals(
            self.normal,
            (self.pitch_mm or 1.0) if pitch_mm is None else pitch_mm,
            level=level,
            threads=threads,
            progress=progress,
        )

    def pixel(self, y: int, x: int) -> Pixel:
        """All results of one pixel, for reading.

        Parameters
        ----------
        y, x
            Row and column; negative ones count from the end.

        Raises
        ------
        ArgumentError
            A pixel outside of the painting.
        """
        y, x = place(y, x, self.shape)
        one = self[y : y + 1, x : x + 1]
        lobes = lobes_of(one.surface(), self.bands) if one.estimated.all() else ()
        along_x, along_y, along_z = one.normal.ravel().tolist()
        return Pixel(
            y=y,
            x=x,
            normal=(along_x, along_y, along_z),
            diffuse=dict(zip(self.bands, one.diffuse.ravel().tolist(), strict=True)),
            lobes=lobes,
            status=Status(int(one.status[0, 0])),
            residual=float(one.residual[0, 0]),
            sigma=float(one.sigma[0, 0]),
        )

    def lobe_plot(self, y: int, x: int, stack: Stack | None = None) -> Figure:
        """Draw a pixel's lobes in the plane of incidence, with the photographs of ``stack``.

        There is one half disc for each of the three incidences of light with the most photographs.
        The normal of the pixel points up, and the light comes from the left. The radius is the
        reflectance, the mean over the bands: the sum of diffuse part and lobes (light line), and
        each lobe alone, with one standard deviation of its shape. Each half disc has its own scale.
        Dots are the photographs within 6 degrees of the plane, without ambient light, divided by
        ``(N.L)``.

        Parameters
        ----------
        y, x
            Row and column; negative ones count from the end.
        stack
            The photographs; None: no dots.

        Returns
        -------
        matplotlib.figure.Figure
            Show it, or save it with its ``savefig``.

        Raises
        ------
        ArgumentError
            A pixel outside of the painting or one that was not estimated, or a stack of another
            size.
        MissingExtraError
            matplotlib is not installed.
        """
        from impasto.pictures.plots import lobe_plot

        return lobe_plot(self, y, x, stack)

    @property
    def estimated(self) -> NDArray[np.bool_]:
        """``(y, x)``: whether the pixel's normal was estimated."""
        return np.asarray(self.status < Status.DARK)

    def lobe_words(self, lobe: int, y: int, x: int) -> str:
        """The shape of a pixel's lobe in a legend."""
        gamma = float(np.ravel(self[y : y + 1, x : x + 1].surface().lobes[lobe].shape[0])[0])
        return f"gamma = {np.degrees(gamma):.3g}°" + deviation(self._shape_sigma(lobe, y, x))

    def _shape_sigma(self, lobe: int, y: int, x: int) -> float:
        """Standard deviation of the logarithm of the lobe's width; NaN if unknown."""
        return float("nan")

    def with_bands(self, chosen: Sequence[int]) -> Self:
        """The surface in some of its bands, by number; negative ones count from the end.

        Raises
        ------
        ArgumentError
            No numbers of its bands, or none at all.
        """
        chosen = picked(chosen, len(self.bands), "chosen", "band")
        planes: dict[str, Any] = {
            one.name: np.take(getattr(self, one.name), chosen, axis=dims.index("band"))
            for one in fields(self)
            if "band" in (dims := one.metadata.get("dims", ())) and one.name != "bands"
        }
        normals = replace(self.normals, albedo=np.take(self.normals.albedo, chosen, axis=0))
        bands = tuple(self.bands[band] for band in chosen)
        residuals = self.residuals
        if residuals is not None:
            residuals = replace(residuals, maps=np.take(residuals.maps, chosen, axis=1))
        relief = None if self.relief is None else self.relief.with_bands(chosen)
        planes |= {"residuals": residuals, "relief": relief}
        return replace(self, bands=bands, normals=normals, **planes)

    def rotated(self, quarter_turns: int = 1) -> Self:  # noqa: D102
        found = super().rotated(quarter_turns)
        if self.relief is None:
            return found
        return replace(found, relief=self.relief.rotated(quarter_turns_of(quarter_turns)))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a file for :func:`impasto.load_sbrdf`; it appears complete or not at all.

        ``.npz`` is one file, ``.zarr`` a folder in Zarr v3 with an array for each map and a
        checksum for each chunk. An older result of that name is replaced.

        Raises
        ------
        ArgumentError
            Another suffix, or a ``.zarr`` folder that is no result or holds more than one.
        MissingExtraError
            ``.zarr``, and zarr is not installed.
        """
        write_maps(path, self.kind(), self.arrays())

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that the result is, as the named arrays of its file.

        Two results of one class are the same if these are, to the last bit. :meth:`save` writes
        them; a job splits them into maps, which it writes by tiles, and what is that of the whole
        painting.

        Returns
        -------
        dict
            Maps ``(..., y, x)`` under the names of their fields (``diffuse``), those of parts of
            the result after the name of the part (``normals.albedo``). The rig, bands, numbers and
            texts are arrays of other shapes, a single one ``()``. Maps share the memory of the
            result.
        """
        return self._arrays() | ({} if self.chosen is None else self.chosen.arrays())

    def to_xarray(self) -> Dataset:
        """Every map of the model over named dimensions, for xarray.

        Returns
        -------
        xarray.Dataset
            Maps under their own names over ``y``, ``x``, ``band``, ``axis`` and, where there are
            any, ``lobe``; NaN as in the maps. ``x`` and ``y`` have coordinates in mm (origin in the
            middle of the painting, y up) if the width of a pixel is known. ``light`` and ``view``
            are the rig's, ``(observation, axis)``: directions, or positions in mm where ``near``.
            Single numbers are attributes.

        Raises
        ------
        MissingExtraError
            xarray is not installed.
        """
        from impasto.fit.dataset import dataset_of

        return dataset_of(self)

    @abstractmethod
    def report(self) -> dict[str, Any]:
        """Numbers of the gloss for a report file."""

    def __repr__(self) -> str:
        height, width = self.shape
        share = 100 * float((self.status < Status.DARK).mean())
        size = f"{width} x {height} pixels, {len(self.bands)} bands"
        return f"<{type(self).__name__} {size}, {share:.1f} % estimated: {self._gloss()}>"

    def _repr_html_(self) -> str:
        """HTML for notebooks: size, gloss, diffuse colours and normals."""
        from impasto.notebook import sbrdf_view

        return sbrdf_view(self)

    @classmethod
    def kind(cls) -> str:
        """Says in a saved file what it holds."""
        return f"impasto.{cls.__name__}"

    @classmethod
    def from_maps(cls, maps: SavedMaps) -> Self:
        """What a file holds, or a refusal that names the file and the array."""
        reader = Reader(maps)
        normals = Normals(**reader.fields(Normals, "normals."))
        found = cls(**cls._read(reader, {"normals": normals, "rig": rig_from_arrays(maps)}))
        found._demand(maps)
        residuals = None
        if "residuals.maps" in maps.arrays:
            residuals = residuals_of(maps, reader.fields(Residuals, "residuals."))
        relief = None
        if "relief.height" in maps.arrays:
            relief = relief_of(maps, reader.fields(Relief, "relief."))
        return replace(found, chosen=Choice.of_maps(maps), residuals=residuals, relief=relief)

    @classmethod
    def _read(cls, reader: Reader, shared: dict[str, Any]) -> dict[str, Any]:
        """All fields; ``shared`` are those that every result has and no array is."""
        return shared | reader.fields(cls)

    def _arrays(self) -> dict[str, NDArray[Any]]:
        """Those of all fields but ``chosen``."""
        return arrays_of(self)

    @abstractmethod
    def _demand(self, maps: SavedMaps, prefix: str = "") -> None:
        """Refuse a file whose numbers lie outside of their range; names begin with ``prefix``."""

    @abstractmethod
    def surface(self) -> Surface:
        """The maps, ready to be lit by :meth:`predict` and :func:`impasto.render`."""

    def _place(self) -> dict[str, Any]:
        """Where the maps lie, as :class:`Surface` takes it."""
        return {"pitch_mm": self.pitch_mm, "origin": self.rig.origin}

    @abstractmethod
    def _gloss(self) -> str:
        """The gloss in a few words."""


@dataclass(frozen=True, eq=False, repr=False)
class PerPixelSbrdf(Sbrdf):
    """A painting whose pixels have lobes of their own, of any model.

    A lobe that a pixel does not have (``lobes``) has a ``specular`` of 0 and no shape (NaN).

    Attributes
    ----------
    specular
        ``(lobe, band, y, x)`` float32 strength of each lobe in each band, from 0 on.
    lobes
        ``(y, x)`` uint8: how many lobes the photographs support.
    """

    SHAPE: ClassVar[tuple[str, ...]]
    """The maps ``(lobe, y, x)`` that make a lobe's shape."""

    specular: NDArray[np.float32] = field(metadata=over("lobe", "band", "y", "x"))
    lobes: NDArray[np.uint8] = field(metadata=over("y", "x", dtype=np.uint8))

    @property
    @abstractmethod
    def width(self) -> NDArray[np.float32]:
        """``(lobe, y, x)`` tilt of the facets at which their number has halved, radians."""

    @cached_property
    def gloss(self) -> Gloss:  # noqa: D102
        strength = self._beta(self.specular.mean(axis=1))
        return wait_for(gloss_of_pixels, strength, self.width, self.estimated)

    def _beta(self, strength: NDArray[np.float32]) -> NDArray[np.float32]:
        """Strengths of lobes as the beta of Torrance-Sparrow lobes."""
        return strength

    def report(self) -> dict[str, Any]:  # noqa: D102
        fine = self.lobes[self.status < Status.DARK]
        return {
            "lobes": np.bincount(fine, minlength=len(self.specular) + 1).tolist(),
            "lobes_per_pixel": float(fine.mean()) if fine.size else float("nan"),
            "width_degrees_median": [median(np.degrees(plane)) for plane in self.width],
        }

    def _gloss(self) -> str:
        fine = self.lobes[self.status < Status.DARK]
        shares = [
            f"{100 * count / fine.size:.0f} % with {lobes or 'no'} lobe{'s' * (lobes != 1)}"
            for lobes, count in enumerate(np.bincount(fine))
            if count
        ]
        return ", ".join(shares) or "none"


def shared_fields(found: Mapping[str, Any], stack: Stack, stereo: Normals) -> dict[str, Any]:
    """The fields of :class:`Sbrdf` from what the numerics found."""
    maps = {name: found[name] for name in ("normal", "diffuse", "residual", "sigma", "status")}
    return {**maps, "normals": stereo, "rig": stack.rig, "bands": stack.bands}


def _directions_only(lights: Any) -> bool:
    """Whether lights are plain directions, without strengths, distances and views."""
    if isinstance(lights, Rig):
        near = lights.near.any() or lights.near_views.any()
        even = bool((lights.intensities == 1.0).all() and (lights.views == FRONTAL).all())
        return even and not near and lights.refinement is None
    listed = isinstance(lights, Sequence)
    return not (listed and any(isinstance(one, DistantLight | PointLight) for one in lights))


def deviation(sigma: float) -> str:
    """A standard deviation of a logarithm in a legend: `` ± 3 %``, or nothing."""
    return f" ± {100 * sigma:.2g} %" if np.isfinite(sigma) else ""


def median(plane: NDArray[Any]) -> float:
    """The median of the numbers of a map; NaN where there is none."""

    def of_known() -> float:
        known = plane[np.isfinite(plane)]
        return float(np.median(known)) if known.size else float("nan")

    return wait_for(of_known)
