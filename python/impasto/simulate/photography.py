"""Photographs of a simulated painting: light, ideal optics, and a noisy sensor."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import instance, is_whole, number, numbers, one_of, truth
from impasto.bands import Camera
from impasto.encoding import Encoding
from impasto.errors import ArgumentError, GeometryError
from impasto.rig import Light, PointLight, Rig
from impasto.simulate.cameras import CAMERA_OPTIONS, CAMERAS
from impasto.simulate.cameras import camera as camera_named
from impasto.simulate.fields import Field, check_seed
from impasto.simulate.lobes import Lobes, lobes
from impasto.simulate.paintings import Painting, painting
from impasto.simulate.rigs import RIGS
from impasto.simulate.rigs import rig as rig_named
from impasto.stack import Stack
from impasto.surface import Surface

Forward: TypeAlias = Callable[[Field, Field, Field, Field, Rig], NDArray[np.floating]]
"""Radiance ``(obs, band, y, x)`` from normal ``(3, y, x)``, diffuse ``(band, y, x)``, beta and
gamma ``(coat, y, x)``, and a rig; white board 1.0."""

Model = Literal["torrance-sparrow", "lafortune"]
MODELS: tuple[Model, ...] = get_args(Model)


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of a sensor.

    Parameters
    ----------
    full_well
        Electrons at full scale: shot noise has the variance of the signal in electrons.
    read
        Standard deviation of the read noise in electrons.
    """

    full_well: float = 30000.0
    read: float = 3.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.full_well) and self.full_well > 0):
            raise ArgumentError(f"full_well: expected electrons above 0, found {self.full_well!r}")
        if not (np.isfinite(self.read) and self.read >= 0):
            raise ArgumentError(f"read: expected electrons from 0 on, found {self.read!r}")


@dataclass(frozen=True, eq=False)
class Truth:
    """The true values for a fit of a capture.

    Attributes
    ----------
    painting
        The painting.
    rig, camera
        Rig and camera, without exposure.
    normal
        ``(3, y, x)`` float32.
    diffuse
        ``(band, y, x)`` float32, white 1.
    beta, gamma
        ``(coat, y, x)`` float32.
    lobes
        The Lafortune lobes that replace beta and gamma in the photographs; else None.
    exposure
        Share of full scale that a white board facing a light of intensity 1 reaches.
    """

    painting: Painting
    rig: Rig
    camera: Camera
    normal: Field
    diffuse: Field
    beta: Field
    gamma: Field
    lobes: Lobes | None
    exposure: float


@dataclass(frozen=True, eq=False)
class Capture:
    """Photographs with their true values."""

    stack: Stack
    truth: Truth

    def __repr__(self) -> str:
        observations, bands = self.stack.shape[:2]
        return f"<Capture of {self.truth.painting!r}: {observations} lights, {bands} bands>"


def capture(
    painting: Painting,
    rig: Rig | str = "tominaga-six-band-adaptation",
    camera: Camera | str | None = None,
    *,
    model: Model | None = None,
    noise: bool | Noise = True,
    bits: int | None = 12,
    exposure: float = 0.6,
    sensitivity: Sequence[float] | None = None,
    clip: bool = True,
    falloff: bool | None = None,
    shadows: bool = False,
    encoding: str = "linear",
    frames: int = 1,
    seed: int | None = None,
    forward: Forward | None = None,
) -> Capture:
    """Photograph a painting under every light of a rig, from every view.

    Photographs are made one at a time: memory holds the stack (770 of 512 x 512 pixels in three
    bands of 12 bits take 1.2 GB) and one photograph.

    Parameters
    ----------
    painting
        From :func:`impasto.simulate.painting`.
    rig
        A :class:`~impasto.Rig` or a name of :func:`impasto.simulate.rig`.
    camera
        A camera or a name; default: the camera of the named rig, else ``"rgb"``.
    model
        Model of the gloss: ``"torrance-sparrow"`` or ``"lafortune"``
        (:class:`impasto.simulate.Lobes`); default: that of the named rig's paper, else the former.
    noise
        Shot and read noise (True: 30,000 electrons full well, 3 electrons read noise).
    bits
        Quantisation to integers, 1 to 16 bits; None: float32 samples.
    exposure
        Share of full scale that a white board facing a light of intensity 1 reaches.
    sensitivity
        Relative sensitivity of each band: the share of ``exposure`` that the white board reaches in
        it, above 0 up to 1; default: 1 in every band. A less sensitive band clips later. Samples
        are relative to the white board in any case.
    clip
        Whether light beyond full scale is clipped. False lowers ``exposure`` until the brightest
        highlight stays below 95 % of full scale.
    falloff
        Whether near lights weaken with 1 / r^2; default: their own ``falloff``.
    shadows
        Whether the relief casts shadows.
    encoding
        ``"linear"``, ``"srgb"`` or a gamma such as ``"2.2"``. Coded photographs are decoded again,
        so the samples keep the coarse quantisation of bright values; full scale is 1.0 and the
        exposure is part of the intensities of the stack's lights.
    frames
        Exposures averaged before quantisation.
    seed
        Of the noise; default: the painting's.
    forward
        Another Torrance-Sparrow model (for independent tests); default: that of impasto.

    Returns
    -------
    Capture
        ``.stack`` and ``.truth``.

    Raises
    ------
    ArgumentError, GeometryError
        An option is out of range or the rig has another pixel width than the painting.
    """
    if model is None:
        model = "lafortune" if isinstance(rig, str) and rig == "snel-lafortune" else MODELS[0]
    rig, camera = _resolved(painting, rig, camera, falloff)
    _check(bits, exposure, frames, model, {"clip": clip, "shadows": shadows})
    sensor = _sensor(noise)
    diffuse = painting.reflectance_in(camera)
    gloss = lobes(painting, diffuse) if model == "lafortune" else None
    scene = _Scene(painting, rig, diffuse, gloss, shadows, forward or _default_forward)
    share = _shares(sensitivity, camera)
    if not clip:
        brightest = max(float(scene.photograph(i).max()) for i in range(len(rig)))
        exposure = min(exposure, 0.95 / max(brightest, 1e-6))
    seed = painting.seed if seed is None else seed
    check_seed(seed)
    gain = (exposure * share).astype(np.float32)[:, None, None]
    full = 1.0 if bits is None else float(2**bits - 1)
    linear = Encoding(encoding).curve == "linear"
    # A pedestal keeps the noise of dark samples from being clipped at 0.
    black = float(round(full / 64)) if bits is not None and sensor and linear else 0.0
    dtype = np.float32 if bits is None or not linear else np.uint8 if bits <= 8 else np.uint16
    samples = np.empty((len(rig), *diffuse.shape), dtype=dtype)
    curve = Encoding(encoding, full)
    for i in range(len(rig)):
        exposed = scene.photograph(i) * gain
        if sensor:
            exposed = _noisy(exposed, sensor, frames, _noise_stream(seed, i))
        if not linear:
            coded = curve.encode(exposed)
            samples[i] = curve.decode(coded if bits is None else np.rint(coded))
        elif bits is None:
            samples[i] = np.minimum(exposed, 1.0) / gain
        else:
            samples[i] = np.rint(np.clip(exposed * (full - black) + black, 0.0, full))
    common: dict[str, Any] = {"bands": camera.bands}
    if not linear:
        lit = [replace(light, intensity=light.intensity * exposure) for light in rig.lights]
        exposed_rig = rig.with_lights(lit)
        if sensitivity is not None:
            common["scale"] = 1.0 / share
        stack = Stack(samples, lights=exposed_rig, saturation=1.0, encoding=curve, **common)
    elif bits is None:
        stack = Stack(samples, lights=rig, saturation=(np.float32(1.0) / gain).ravel(), **common)
    else:
        stack = Stack(
            samples, lights=rig, saturation=full, black=black,
            scale=1.0 / (exposure * share * (full - black)),
            encoding=Encoding("linear", exposure * (full - black)), **common,
        )  # fmt: skip
    truth = Truth(
        painting, rig, camera, painting.normal, diffuse, painting.beta, painting.gamma, gloss,
        exposure,
    )  # fmt: skip
    return Capture(stack, truth)


def default_capture(
    system: str = "tominaga-six-band-adaptation",
    *,
    seed: int = 0,
    size: tuple[int, int] = (512, 512),
    **options: Any,
) -> Capture:
    """The default simulation: a satin-varnished landscape, photographed with the rig of a paper.

    ``options`` go to :func:`capture`. The camera of ``"snel-lafortune"`` is half as sensitive to
    blue as to red and a third as sensitive as to green, and its exposure is 1.0: highlights are
    overexposed in green first (section 4 of the paper).
    """
    return capture(
        painting(seed, size), system, system, **{**CAMERA_OPTIONS.get(system, {}), **options}
    )


@dataclass(frozen=True)
class _Scene:
    painting: Painting
    rig: Rig
    diffuse: Field
    lobes: Lobes | None
    shadows: bool
    forward: Forward

    def photograph(self, index: int) -> Field:
        """Noiseless radiance ``(band, y, x)`` of one observation, white board 1.0."""
        p = self.painting
        one = self.rig.take([index])
        if self.lobes is None:
            image = self.forward(p.normal, self.diffuse, p.beta, p.gamma, one)[0]
        else:
            surface = Surface.lafortune(
                p.normal, self.diffuse, **vars(self.lobes), origin=one.origin
            )
            image = surface.predict(one)[0]
        if self.shadows:
            image = image * self.visibility(one.lights[0])
        return np.asarray(image, dtype=np.float32)

    def visibility(self, light: Light) -> Field:
        """``(y, x)``: 1 where the light reaches the surface, 0 in cast shadow."""
        from impasto import _core

        near = isinstance(light, PointLight)
        towards = light.position if isinstance(light, PointLight) else light.direction
        return _core.cast_shadows(self.painting.height, self.painting.pitch_mm, towards, near)


def _default_forward(
    normal: Field, diffuse: Field, beta: Field, gamma: Field, rig: Rig
) -> NDArray[np.floating]:
    surface = Surface.torrance_sparrow(normal, diffuse, beta, gamma, origin=rig.origin)
    return surface.predict(rig)


def _noisy(exposed: Field, sensor: Noise, frames: int, rng: np.random.Generator) -> Field:
    # A Poisson count above about 50 electrons is normal to within a hundredth of its deviation;
    # below, the read noise dominates.
    electrons = np.maximum(exposed, 0.0) * np.float32(sensor.full_well)
    deviation = np.sqrt((electrons + np.float32(sensor.read**2)) / np.float32(frames))
    deviation /= np.float32(sensor.full_well)
    return np.asarray(exposed + deviation * rng.standard_normal(exposed.shape, dtype=np.float32))


def _noise_stream(seed: int, observation: int) -> np.random.Generator:
    key = (zlib.crc32(b"noise"), observation)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def _resolved(
    painting: Painting, rig: Rig | str, camera: Camera | str | None, falloff: bool | None
) -> tuple[Rig, Camera]:
    instance(painting, Painting, "painting", "an impasto.simulate.Painting")
    if camera is None:
        camera = rig if isinstance(rig, str) and rig in CAMERAS else "rgb"
    if isinstance(rig, str):
        one_of(rig, RIGS, "rig")
        rig = rig_named(rig, pitch_mm=painting.pitch_mm)
    if isinstance(camera, str):
        one_of(camera, CAMERAS, "camera")
        camera = camera_named(camera)
    instance(rig, Rig, "rig", f"an impasto.Rig or a name ({', '.join(RIGS)})")
    instance(camera, Camera, "camera", f"an impasto.Camera or a name ({', '.join(CAMERAS)})")
    if rig.pitch_mm is None:
        rig = Rig(rig, pitch_mm=painting.pitch_mm)
    if abs(rig.pitch_mm / painting.pitch_mm - 1.0) > 1e-9:  # type: ignore[operator]
        raise GeometryError(
            f"rig: its pixels are {rig.pitch_mm} mm wide, the painting's {painting.pitch_mm} mm; "
            "build the rig with the painting's pitch_mm"
        )
    if falloff is not None:
        falloff = truth(falloff, "falloff")
        lights = [
            replace(light, falloff=falloff) if isinstance(light, PointLight) else light
            for light in rig.lights
        ]
        rig = rig.with_lights(lights)
    return rig, camera


def _shares(sensitivity: Sequence[float] | None, camera: Camera) -> NDArray[np.float64]:
    """``(band,)``, from above 0 to 1."""
    count, what = len(camera.bands), "one share above 0 up to 1 for each band"
    if sensitivity is None:
        return np.ones(count)
    share = numbers(sensitivity, "sensitivity", what)
    if share.shape != (count,) or not ((share > 0.0) & (share <= 1.0)).all():
        raise ArgumentError(f"sensitivity: expected {what} ({count}), found {sensitivity!r}")
    return share


def _sensor(noise: bool | Noise | None) -> Noise | None:
    if noise is True:
        return Noise()
    if noise is not False and noise is not None:
        instance(noise, Noise, "noise", "True, False or an impasto.simulate.Noise")
    return noise or None


def _check(
    bits: int | None, exposure: float, frames: int, model: str, switches: dict[str, bool]
) -> None:
    for name, value in switches.items():
        truth(value, name)
    one_of(model, MODELS, "model")
    if bits is not None and not (is_whole(bits) and 1 <= bits <= 16):
        raise ArgumentError(f"bits: expected 1 to 16 or None, found {bits!r}")
    share = "a share of full scale above 0"
    if not 0.0 < number(exposure, "exposure", share) <= 1.0:
        raise ArgumentError(f"exposure: expected {share}, found {exposure!r}")
    if not (is_whole(frames) and frames >= 1):
        raise ArgumentError(f"frames: expected at least one, found {frames!r}")
