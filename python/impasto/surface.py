"""What a painting is before anyone lights it: normals, diffuse colours and lobes."""

from __future__ import annotations

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.casts import quiet_cast
from impasto._internal.checks import length_mm, one_of, picked, refractive_index, truth
from impasto._internal.viewing import Viewable
from impasto._internal.waiting import floats
from impasto.errors import ArgumentError, ImpastoWarning
from impasto.rig import FRONTAL, PointView, Rig, Views

Map: TypeAlias = NDArray[np.float32]
LobeModel = Literal["torrance-sparrow", "lafortune"]

SHAPES: dict[LobeModel, tuple[str, ...]] = {
    "torrance-sparrow": ("gamma",),
    "lafortune": ("cxy", "cz", "exponent"),
}
"""The numbers that make the shape of a model's lobe, in the order of :attr:`Lobe.shape`."""


@dataclass(frozen=True, slots=True, eq=False)
class Lobe:
    """A lobe of every pixel; each entry is a number or a map ``(y, x)``.

    Attributes
    ----------
    strength
        With ``(band, y, x)`` the lobe has a colour of its own; any other lobe has the light's.
    shape
        The numbers of the model: ``(gamma,)``, or ``(cxy, cz, exponent)``.
    """

    strength: float | Map
    shape: tuple[float | Map, ...]


class Relightable(ABC):
    """Anything that has a :class:`Surface`: what :func:`impasto.render` takes."""

    @abstractmethod
    def surface(self) -> Surface:
        """Its maps, ready to be lit."""

    def unmodelled(self, rig: Rig) -> Map | None:
        """What photographs show besides the model under all lights of a rig, ``(band, y, x)``.

        Positions of the rig are those of the whole painting. Linear light; None if nothing is
        known of it.
        """
        return None

    def eye(self) -> tuple[float, float, float] | PointView:
        """From where pictures show it unless a scene says so."""
        return FRONTAL

    @property
    def known_pitch_mm(self) -> float | None:
        """Width of a pixel in mm; None where nobody has said it."""
        return self.surface().pitch_mm

    def eye_in_mm(self, pitch_mm: float | None) -> tuple[float, float, float] | PointView:
        """From where pictures show it, where the caller says how wide a pixel is.

        That is where :meth:`eye` says, but for a place that is counted in pixels as long as
        nobody knows how wide they are.
        """
        eye, own = self.eye(), self.surface().pitch_mm
        if pitch_mm is None or own is None or self.known_pitch_mm is not None:
            return eye
        if not isinstance(eye, PointView):
            return eye
        x, y, z = (value * pitch_mm / own for value in eye.position)
        return PointView((x, y, z))

    def spectra(self) -> Any:
        """What has its ``coefficients``, ``basis`` and ``wavelengths``; None if none are known."""
        return None


@dataclass(frozen=True, eq=False, repr=False)
class Surface(Viewable, Relightable):
    """A painting's surface from arrays, for :meth:`predict` and :func:`impasto.render`.

    ``Surface(normal, diffuse)`` is matte. :meth:`torrance_sparrow` and :meth:`lafortune` add
    lobes. Every result of :func:`impasto.fit_sbrdf` has one: ``sbrdf.surface()``.

    Parameters
    ----------
    normal
        ``(3, y, x)`` unit vectors: x right, y up, z towards the viewer; NaN where unknown.
    diffuse
        ``(band, y, x)`` reflectance relative to the white board.
    lobes
        One :class:`Lobe` for each term of the model.
    model
        ``"torrance-sparrow"`` or ``"lafortune"``.
    index
        Index of refraction of a Torrance-Sparrow lobe's interface.
    ambient
        ``(band, y, x)`` light that comes whatever the lamp's direction; default: none.
    coated
        Whether diffuse light crosses a smooth interface of index ``index`` on its way in and out,
        as paint under varnish: ``N.L`` is then multiplied by ``t(N.L) t(N.V)``,
        ``t(c) = (1 - F(c)) / (1 - F(1))`` with Fresnel's reflectance F (Wolff 1994);
        default: False.
    height
        ``(y, x)`` mm, for shadows; default: the normals, integrated.
    pitch_mm
        Width of a pixel on the painting in mm; point lights need it.
    origin
        Where the middle of these maps lies, as in a :class:`~impasto.Rig`.

    Raises
    ------
    ArgumentError
        Shapes that disagree, an index outside 1 to 100, an unknown model.

    Warns
    -----
    ImpastoWarning
        Normals that are no unit vectors.
    """

    normal: Map
    diffuse: Map
    lobes: tuple[Lobe, ...] = ()
    model: LobeModel = "torrance-sparrow"
    index: float = 1.45
    ambient: Map | None = None
    coated: bool = False
    height: Map | None = None
    pitch_mm: float | None = None
    origin: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        normal, diffuse = _ground(self.normal, self.diffuse)
        one_of(self.model, get_args(LobeModel), "model")
        set_ = object.__setattr__
        _warn_of_lengths(normal)
        set_(self, "normal", normal)
        set_(self, "diffuse", diffuse)
        set_(self, "lobes", tuple(_lobe(lobe, self.model, diffuse.shape) for lobe in self.lobes))
        set_(self, "index", refractive_index(self.index))
        set_(self, "coated", truth(self.coated, "coated"))
        for name, expected in (("ambient", diffuse.shape), ("height", diffuse.shape[1:])):
            given = getattr(self, name)
            plane = None if given is None else floats(given)
            if plane is not None and plane.shape != expected:
                raise ArgumentError(f"{name}: expected shape {expected}, found {plane.shape}")
            set_(self, name, plane)
        if self.pitch_mm is not None:
            set_(self, "pitch_mm", length_mm(self.pitch_mm, "pitch_mm"))

    @classmethod
    def torrance_sparrow(
        cls,
        normal: ArrayLike,
        diffuse: ArrayLike,
        beta: ArrayLike,
        gamma: ArrayLike,
        **options: Any,
    ) -> Surface:
        """A surface with Torrance-Sparrow lobes (six-band paper eq. 1, RGB-camera paper eq. 9).

        Parameters
        ----------
        normal, diffuse
            As in the class.
        beta
            Strength relative to the white board: a number or ``(y, x)``, with several coats
            ``(coat,)`` or ``(coat, y, x)``. ``(coat, band, y, x)`` has a strength per band.
        gamma
            Half-width of the facets in radians: a number, ``(y, x)``, ``(coat,)`` or
            ``(coat, y, x)``.
        **options
            ``index``, ``ambient``, ``coated``, ``height``, ``pitch_mm``, ``origin`` of the class.

        Raises
        ------
        ArgumentError
            Shapes that disagree, a negative number.

        Warns
        -----
        ImpastoWarning
            A gamma that can only be meant in degrees; normals that are no unit vectors.
        """
        normal, diffuse = _ground(normal, diffuse)
        strengths = _coats(beta, diffuse.shape, "beta")
        widths = _coats(gamma, diffuse.shape, "gamma")
        _check_units(strengths, widths)
        if len(strengths) != len(widths):
            raise ArgumentError(f"beta: {len(strengths)} coats, but gamma has {len(widths)}")
        lobes = [Lobe(beta, (gamma,)) for beta, gamma in zip(strengths, widths, strict=True)]
        return cls(normal, diffuse, tuple(lobes), "torrance-sparrow", **options)

    @classmethod
    def lafortune(
        cls,
        normal: ArrayLike,
        diffuse: ArrayLike,
        specular: ArrayLike,
        cxy: ArrayLike,
        cz: ArrayLike,
        exponent: ArrayLike,
        **options: Any,
    ) -> Surface:
        """A surface with Lafortune lobes; see :class:`impasto.LafortuneSbrdf` for the equation.

        Parameters
        ----------
        normal, diffuse
            As in the class.
        specular
            ``(lobe, band, y, x)`` strength, 0 where a pixel has fewer lobes.
        cxy, cz, exponent
            ``(lobe, y, x)``; ``cxy**2 + cz**2`` about 2.
        **options
            ``ambient``, ``coated``, ``index``, ``height``, ``pitch_mm``, ``origin`` of the class.

        Raises
        ------
        ArgumentError
            Shapes that disagree.
        """
        normal, diffuse = _ground(normal, diffuse)
        shape = {"cxy": floats(cxy), "cz": floats(cz), "exponent": floats(exponent)}
        specular = floats(specular)
        count = specular.shape[:1] or (0,)
        for name, map_, expected in (
            ("specular", specular, (*count, *diffuse.shape)),
            *((name, map_, (*count, *diffuse.shape[1:])) for name, map_ in shape.items()),
        ):
            if map_.shape != expected:
                raise ArgumentError(f"{name}: expected shape {expected}, found {map_.shape}")
        lobes = tuple(
            Lobe(strength, tuple(planes))
            for strength, *planes in zip(specular, *shape.values(), strict=True)
        )
        return cls(normal, diffuse, lobes, "lafortune", **options)

    def surface(self) -> Surface:
        """The surface itself."""
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        _, height, width = self.diffuse.shape
        return height, width

    @property
    def tinted(self) -> bool:
        """Whether anything but the diffuse part has a colour per band."""
        return self.ambient is not None or any(np.ndim(lobe.strength) == 3 for lobe in self.lobes)

    def predict(
        self,
        lights: Any,
        views: Views | None = None,
        *,
        threads: int | None = None,
        progress: bool | ProgressCallback = False,
    ) -> NDArray[np.float32]:
        """Samples that the surface shows, white board 1.0.

        Parameters
        ----------
        lights
            ``(obs, 3)`` directions, a sequence of :class:`~impasto.DistantLight` and
            :class:`~impasto.PointLight`, or a :class:`~impasto.Rig`. Positions are those of the
            whole painting, whatever part of it this surface is.
        views
            ``(obs, 3)`` or ``(3,)`` directions to the eye, or :class:`~impasto.PointView`;
            default: those of the rig, else frontal.
        threads, progress
            None means every allowed core; a bool or a callable ``(done, total)``.

        Returns
        -------
        ndarray
            ``(obs, band, y, x)`` float32; NaN where the normal is. No sample is above the largest
            float32.
        """
        given = isinstance(lights, Rig)
        pitch = lights.pitch_mm if given and lights.pitch_mm is not None else self.pitch_mm
        rig = Rig(lights, views=views, pitch_mm=pitch, origin=self.origin)
        with reporting(progress, "predict") as callback:
            # numpy asks for large pages: touching small new ones takes longer than to predict.
            shown = np.empty((len(rig), *self.diffuse.shape), np.float32)
            _core.predict(
                self, RigArguments.of(rig), rig.intensities, shown, thread_count(threads), callback
            )
            return shown

    def with_diffuse(
        self,
        diffuse: ArrayLike,
        *,
        index: float | None = None,
        spectra: Callable[[Map], Map] | None = None,
    ) -> Surface:
        """The same lobes over other colours ``(k, y, x)``, such as coefficients of spectra.

        ``spectra`` makes coefficients of what has one number per band: strengths of coloured lobes
        and ambient light.
        """
        n = self.index if index is None else index
        ambient, lobes = self.ambient, self.lobes
        if spectra is not None:
            ambient = None if ambient is None else spectra(ambient)
            lobes = tuple(
                Lobe(spectra(np.asarray(lobe.strength)), lobe.shape)
                if np.ndim(lobe.strength) == 3
                else lobe
                for lobe in lobes
            )
        return replace(self, diffuse=floats(diffuse), index=n, ambient=ambient, lobes=lobes)

    def with_bands(self, chosen: Sequence[int]) -> Surface:
        """The surface in some of its bands, by number; negative ones count from the end.

        Raises
        ------
        ArgumentError
            No numbers of its bands, or none at all.
        """
        bands = picked(chosen, len(self.diffuse), "chosen", "band")

        def some(planes: Map) -> Map:
            return np.ascontiguousarray(planes[bands])

        return self.with_diffuse(some(self.diffuse), spectra=some)

    def __repr__(self) -> str:
        count, height, width = self.diffuse.shape
        lobes = f"{len(self.lobes)} {self.model} lobe{'s' * (len(self.lobes) != 1)}"
        return (
            f"<Surface {width} x {height} pixels, {count} band{'s' * (count != 1)}, "
            f"{lobes if self.lobes else 'matte'}{', coated' * self.coated}>"
        )


def _ground(normal: ArrayLike, diffuse: ArrayLike) -> tuple[Map, Map]:
    normals, colours = floats(normal), floats(diffuse)
    if colours.ndim != 3 or 0 in colours.shape:
        raise ArgumentError(f"diffuse: expected (band, y, x), found shape {colours.shape}")
    expected = (3, *colours.shape[1:])
    if normals.shape != expected:
        raise ArgumentError(f"normal: expected shape {expected}, found {normals.shape}")
    return normals, colours


_SAMPLE = 4096
"""Pixels that tell whether maps are in other units: a surface is made for every tile."""


def _warn_of_lengths(normals: Map) -> None:
    """Point out vectors that are no unit vectors: light is multiplied by their length."""
    flat = normals.reshape(3, -1)
    with quiet_cast():
        some = flat[:, :: max(1, flat.shape[1] // _SAMPLE)].astype(np.float64)
    squares = (some * some).sum(axis=0)
    known = squares[np.isfinite(squares) & (squares > 0.0)]
    # Codes of 8 bits, (n + 1) / 2, are off by 1 % at most.
    shortest, longest = 0.9, 1.1
    if not known.size or (known.min() > shortest**2 and known.max() < longest**2):
        return
    length = float(np.sqrt(np.median(known)))
    if not shortest < length < longest:
        warnings.warn(
            f"normal: expected unit vectors (3, y, x), found lengths of about {length:.3g}, by "
            "which light is multiplied; a picture of normals holds (n + 1) / 2",
            ImpastoWarning,
            stacklevel=4,
        )


def _check_units(strengths: Sequence[float | Map], widths: Sequence[float | Map]) -> None:
    """Refuse single numbers below 0, and point out a width in degrees."""
    for name, values in (("beta", strengths), ("gamma", widths)):
        for value in values:
            if isinstance(value, float) and value < 0.0:
                raise ArgumentError(f"{name}: expected a number from 0 on, found {value:g}")
    for value in widths:
        flat = np.ravel(value)
        some = flat[:: max(1, len(flat) // _SAMPLE)]
        known = some[np.isfinite(some)]
        widest = float(known.max()) if known.size else 0.0
        # No facet tilts by more than a right angle; far wider is a lobe without any width.
        if 0.5 * math.pi < widest <= 90.0:
            warnings.warn(
                f"gamma: {widest:.3g} is wider than a right angle; gamma is in radians, "
                f"{widest:.3g} degrees are {math.radians(widest):.3g}",
                ImpastoWarning,
                stacklevel=3,
            )
            return


def _lobe(lobe: Any, model: LobeModel, size: tuple[int, ...]) -> Lobe:
    """The lobe with numbers or C-contiguous maps of this size."""
    if not isinstance(lobe, Lobe):
        raise ArgumentError(f"lobes: expected impasto.surface.Lobe, found {type(lobe).__name__}")
    names = SHAPES[model]
    if not isinstance(lobe.shape, Sequence) or len(lobe.shape) != len(names):
        raise ArgumentError(
            f"lobes: the shape of a lobe of {model} is ({', '.join(names)}), found "
            f"{len(lobe.shape)} entries"
        )
    plane = size[1:]
    return Lobe(
        _entry(lobe.strength, (plane, size), "strength"),
        tuple(_entry(one, (plane,), name) for name, one in zip(names, lobe.shape, strict=True)),
    )


def _entry(value: Any, sizes: tuple[tuple[int, ...], ...], name: str) -> float | Map:
    if np.ndim(value) == 0:
        return float(value)
    plane = floats(value)
    if plane.shape not in sizes:
        expected = " or ".join(map(str, sizes))
        raise ArgumentError(f"{name}: expected a number or {expected}, found {plane.shape}")
    return plane


def _coats(values: ArrayLike, size: tuple[int, ...], name: str) -> list[float | Map]:
    array = floats(values) if np.ndim(values) else np.asarray(values, dtype=np.float32)
    if array.ndim < 2:
        return [float(value) for value in array.reshape(-1)]
    if array.ndim == 4 and array.shape[1:] == size and name == "beta":
        return list(array)
    plane = size[1:]
    coats = array.reshape(-1, *array.shape[-2:])
    if array.ndim > 3 or coats.shape[1:] != plane:
        raise ArgumentError(
            f"{name}: expected a number, (coat,), {plane} or (coat, *{plane}), found {array.shape}"
        )
    return list(coats)


def with_each_map(surface: Surface, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Surface:
    """A surface whose maps ``(..., y, x)`` are all changed alike; single numbers stay."""

    def of(value: Any) -> Any:
        return value if value is None or np.ndim(value) == 0 else change(value)

    return replace(
        surface,
        normal=of(surface.normal),
        diffuse=of(surface.diffuse),
        ambient=of(surface.ambient),
        height=of(surface.height),
        lobes=tuple(Lobe(of(one.strength), tuple(map(of, one.shape))) for one in surface.lobes),
    )
