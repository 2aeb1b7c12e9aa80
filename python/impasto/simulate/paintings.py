"""Simulated paintings: surface and materials from a seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.viewing import Viewable
from impasto.colour import Illuminant, xyz_from_spectrum
from impasto.errors import ArgumentError
from impasto.simulate import surface
from impasto.simulate.brushwork import Painter
from impasto.simulate.canvas import primed, weave
from impasto.simulate.fields import Field, blur, check_seed, smoothstep, stream
from impasto.simulate.landscape import landscape
from impasto.simulate.pigments import (
    WAVELENGTHS,
    Palette,
    absorption,
    palette,
    reflectance,
)
from impasto.simulate.strokes import Layer, lay, level
from impasto.surface import Relightable, Surface

if TYPE_CHECKING:
    from impasto.bands import Camera

VarnishKind = Literal["matte", "satin", "gloss", "patches"]
RANK = 12
"""Number of basis functions, enough for 15 mixed paints under a glaze (largest error ~1e-3)."""


@dataclass(frozen=True, eq=False)
class Painting(Viewable, Relightable):
    """The true surface of a simulated painting.

    Attributes
    ----------
    height
        ``(y, x)`` float32, mm, towards the viewer.
    normal
        ``(3, y, x)`` float32 unit normals: central differences of ``height``
        (formulas in ``impasto.simulate.surface.normals``).
    coefficients, basis, wavelengths
        Diffuse reflectance S = coefficients . basis: ``(k, y, x)`` float32, ``(k, n)`` float64,
        ``(n,)`` nm. This product is exact by definition.
    beta, gamma
        ``(coat, y, x)`` float32: strength and half-width (rad) of each coat's interface
        reflection, the top coat first; beta is 0 where there is no varnish.
    varnish
        ``(y, x)`` uint8: 0 none, 1 matte, 2 satin, 3 gloss.
    pitch_mm
        Width of a pixel in mm.
    seed
        The seed of the simulation.
    """

    height: Field
    normal: Field
    coefficients: Field
    basis: NDArray[np.float64]
    wavelengths: NDArray[np.float64]
    beta: Field
    gamma: Field
    varnish: NDArray[np.uint8]
    pitch_mm: float
    seed: int

    def __repr__(self) -> str:
        rows, columns = self.size
        return f"<Painting {columns} x {rows} px, {self.pitch_mm:g} mm each, seed {self.seed}>"

    @property
    def size(self) -> tuple[int, int]:
        """``(y, x)`` in pixels."""
        return (self.height.shape[0], self.height.shape[1])

    def surface(self) -> Surface:
        """The painting with its varnish, ready to be lit; its colours are the coefficients."""
        return Surface.torrance_sparrow(
            self.normal,
            self.coefficients,
            self.beta,
            self.gamma,
            height=self.height,
            pitch_mm=self.pitch_mm,
        )

    def spectra(self) -> Painting:
        """The painting itself: it has coefficients, basis and wavelengths."""
        return self

    @property
    def masks(self) -> dict[str, NDArray[np.bool_]]:
        """``(y, x)`` masks by varnish: ``"none"``, ``"matte"``, ``"satin"``, ``"gloss"``."""
        names = ("none", "matte", "satin", "gloss")
        return {name: self.varnish == value for value, name in enumerate(names)}

    def spectrum(self, y: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Reflectance ``(..., n)`` at pixels (row ``y``, column ``x``)."""
        picked = self.coefficients[:, np.asarray(y), np.asarray(x)].astype(np.float64)
        return np.asarray(np.moveaxis(picked, 0, -1) @ self.basis)

    def reflectance_in(self, camera: Camera) -> Field:
        """Diffuse reflectance ``(band, y, x)`` in the bands of a camera, white 1 in each band."""
        weights = np.asarray(camera.response(self.basis, self.wavelengths), dtype=np.float64)
        return self._project(weights)

    def xyz(self, illuminant: Illuminant = "D65") -> Field:
        """Tristimulus values ``(3, y, x)`` of the diffuse colour, Y = 1 for a perfect white."""
        return self._project(self.basis @ xyz_from_spectrum(self.wavelengths, illuminant).T)

    def _project(self, weights: NDArray[np.float64]) -> Field:
        k = len(self.basis)
        flat = weights.T.astype(np.float32) @ self.coefficients.reshape(k, -1)
        return np.ascontiguousarray(flat.reshape(weights.shape[1], *self.size))


def painting(
    seed: int = 0,
    size: tuple[int, int] = (512, 512),
    *,
    varnish: VarnishKind | None = "satin",
    layers: int = 1,
    yellowing: float = 0.0,
    glazes: bool = True,
    craquelure: bool = False,
    relief: float = 1.0,
    pitch_mm: float = 0.2,
    thread_mm: float = 0.95,
    pigments: tuple[ArrayLike, ArrayLike] | None = None,
) -> Painting:
    """Simulate a landscape in oil on canvas.

    Parameters
    ----------
    seed
        The same seed and options give the same bytes. An option changes only what it concerns.
    size
        ``(y, x)`` in pixels.
    varnish
        ``"matte"``, ``"satin"`` or ``"gloss"``: one (beta, gamma) everywhere; ``"patches"``: all
        three; None: no varnish, purely diffuse.
    layers
        Coats of varnish, 1 to 3. Each adds its own interface reflection and levels the relief.
    yellowing
        0: clear varnish; 1: varnish a century old.
    glazes
        Whether transparent dark paint covers the dark parts and collects in hollows.
    craquelure
        Whether the paint has cracked.
    relief
        Factor on all heights; 1 gives tilts of about 10 degrees (standard deviation).
    pitch_mm
        Width of a pixel in mm.
    thread_mm
        Distance of the canvas threads in mm.
    pigments
        ``(reflectance (count, n), wavelengths (n,) nm)`` to select the paints from; default: two
        charts of colour-science (``impasto.simulate.pigments.palette``).

    Raises
    ------
    ArgumentError
        An option is out of its range; the message names it.
    """
    check_seed(seed)
    size = _checked(size, varnish, layers, yellowing, relief, pitch_mm, thread_mm)
    paints = palette(pigments)
    rng = stream(seed, "canvas")
    ground = primed(rng, weave(rng, size, pitch_mm, thread_mm), pitch_mm, thread_mm)
    view = landscape(stream(seed, "vision"), size)
    strokes = Painter(view, size, pitch_mm, stream(seed, "hand")).plan()
    layer = _toned(ground, paints)
    first, second = paints.match(strokes.colour), paints.match(strokes.second)
    lay(layer, strokes, first, second, stream(seed, "bristles"), pitch_mm)
    level(layer, pitch_mm)
    height, darkness = layer.height, np.zeros(size, np.float32)
    if craquelure:
        fall, darkness = surface.cracks(stream(seed, "cracks"), size, pitch_mm)
        height = height + fall
    coats = surface.varnish(stream(seed, "varnish"), size, varnish, layers)
    if varnish is not None:
        height = surface.levelled(height, layers, pitch_mm)
    height = np.asarray(np.float32(relief) * height, dtype=np.float32)
    depth = np.zeros(size, np.float32)
    if glazes:
        tone = paints.lab[layer.first, 0]
        dark = smoothstep(52.0, 18.0, blur(tone.astype(np.float32), 0.6 / pitch_mm))
        depth = surface.glaze_depth(stream(seed, "glaze"), layer.height, dark, pitch_mm)
    coefficients, basis = _reflect(
        layer, paints, depth, coats.thickness, yellowing, darkness, stream(seed, "basis")
    )
    return Painting(
        height=height,
        normal=surface.normals(height, pitch_mm),
        coefficients=coefficients,
        basis=basis,
        wavelengths=WAVELENGTHS.copy(),
        beta=coats.beta,
        gamma=coats.gamma,
        varnish=coats.kind,
        pitch_mm=float(pitch_mm),
        seed=int(seed),
    )


def _toned(ground: Field, paints: Palette) -> Layer:
    """The primed canvas under a thin warm wash."""
    shape = ground.shape
    warm = int(paints.match(np.array([[58.0, 18.0, 34.0]]))[0])
    pale = int(paints.match(np.array([[72.0, 8.0, 22.0]]))[0])
    high = smoothstep(-0.02, 0.05, ground)
    return Layer(
        height=ground.copy(),
        first=np.full(shape, warm, np.int32),
        second=np.full(shape, pale, np.int32),
        share=np.asarray(0.6 * high, np.float32),
        paint=np.zeros(shape, np.float32),
    )


def _reflect(
    layer: Layer,
    paints: Palette,
    glaze: Field,
    resin: Field,
    yellowing: float,
    darkness: Field,
    rng: np.random.Generator,
) -> tuple[Field, NDArray[np.float64]]:
    """Coefficients ``(k, y, x)`` and basis ``(k, n)`` of the reflectance.

    Mixtures after Kubelka and Munk; light passes glaze and varnish twice (Beer's law):
    S = R exp(-2 a d).
    """
    solid = absorption(paints.reflectance).astype(np.float32)
    lake = absorption(_glaze_paint(paints))
    filters = np.stack([lake / lake.max(), surface.yellow(yellowing)]).astype(np.float32)
    first, second = layer.first.ravel(), layer.second.ravel()
    share = layer.share.ravel()[:, None]
    depths = np.stack([1.1 * glaze.ravel(), resin.ravel()], axis=1).astype(np.float32)
    dirt = darkness.ravel()[:, None]
    table = paints.recipes @ solid

    def spectra(at: NDArray[np.integer] | slice) -> Field:
        mixed = table[first[at]]
        mixed += share[at] * (table[second[at]] - mixed)
        body = reflectance(mixed)
        body *= np.exp(-2.0 * (depths[at] @ filters))
        body *= 1.0 - np.float32(0.75) * dirt[at]
        return np.asarray(body, dtype=np.float32)

    count = first.size
    sample = spectra(rng.choice(count, min(count, 12000), replace=False)).astype(np.float64)
    _, vectors = np.linalg.eigh(sample.T @ sample)
    basis = vectors[:, ::-1][:, :RANK].T
    basis = basis * np.where(basis.sum(axis=1) < 0, -1.0, 1.0)[:, None]
    project = basis.T.astype(np.float32)
    coefficients = np.empty((RANK, count), dtype=np.float32)
    block = 16384
    for start in range(0, count, block):
        part = slice(start, min(start + block, count))
        coefficients[:, part] = (spectra(part) @ project).T
    return coefficients.reshape(RANK, *layer.share.shape), np.ascontiguousarray(basis)


def _glaze_paint(paints: Palette) -> NDArray[np.float64]:
    """A brown lake: red earth, a little blue."""
    share = np.zeros(len(paints.names))
    for name, part in (("earth", 0.6), ("violet", 0.25), ("black", 0.15)):
        share[paints.names.index(name)] = part
    return np.asarray(reflectance(share @ absorption(paints.reflectance)))


def _checked(
    size: tuple[int, int],
    varnish: str | None,
    layers: int,
    yellowing: float,
    relief: float,
    pitch_mm: float,
    thread_mm: float,
) -> tuple[int, int]:
    try:
        rows, columns = (int(n) for n in size)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"size: expected (y, x) in pixels, found {size!r}") from error
    if rows < 1 or columns < 1:
        raise ArgumentError(f"size: expected at least one pixel in each direction, found {size!r}")
    if varnish is not None and varnish not in get_args(VarnishKind):
        raise ArgumentError(
            f'varnish: expected "matte", "satin", "gloss", "patches" or None, found {varnish!r}'
        )
    if layers not in (1, 2, 3):
        raise ArgumentError(f"layers: expected 1, 2 or 3 coats, found {layers!r}")
    for name, value, low in (
        ("yellowing", yellowing, 0.0),
        ("relief", relief, 0.0),
        ("pitch_mm", pitch_mm, 1e-6),
        ("thread_mm", thread_mm, 1e-6),
    ):
        if not (np.isfinite(value) and value >= low):
            raise ArgumentError(f"{name}: expected a number from {low:g} on, found {value!r}")
    return rows, columns
