"""Photographs of a simulated painting: light, a lens, and a noisy sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import with_parameters_of
from impasto._internal.checks import instance, is_whole, number, numbers, one_of, truth
from impasto.bands import Camera
from impasto.effects import checked_tolerance
from impasto.encoding import Encoding
from impasto.errors import ArgumentError, GeometryError
from impasto.lights import PointLight
from impasto.rig import Rig
from impasto.simulate.cameras import CAMERA_OPTIONS, CAMERAS
from impasto.simulate.cameras import camera as camera_named
from impasto.simulate.fields import check_seed
from impasto.simulate.lobes import lobes
from impasto.simulate.optics import Optics
from impasto.simulate.paintings import Painting, painting
from impasto.simulate.photographs import Forward, OtherPhotographs, Photographs
from impasto.simulate.planning import Capture, CapturePlan, formed, planned
from impasto.simulate.rigs import RIGS
from impasto.simulate.rigs import rig as rig_named
from impasto.simulate.sensor import Noise, Sensor

Model = Literal["torrance-sparrow", "lafortune"]
MODELS: tuple[Model, ...] = get_args(Model)


def plan(
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
    optics: Optics | None = None,
    tolerance: str | float = 0,
    forward: Forward | None = None,
) -> CapturePlan:
    """Decide what photographs call for, effect by effect: lobes, shadows, lens and sensor.

    Light is planned as that of pictures is (:func:`impasto.plan`), photograph by photograph and
    tile by tile. A lens effect is left out where all it can change stays below the tolerance; noise
    where six of its deviations do. With a lens effect that might be left out, all photographs are
    made once to find the brightest.

    Parameters
    ----------
    painting, rig, camera, model, noise, bits, exposure, sensitivity, clip, falloff, shadows
        As in :func:`capture`.
    encoding, frames, seed, optics, tolerance, forward
        As in :func:`capture`.

    Returns
    -------
    CapturePlan
        With ``explain()``, ``capture()``, ``forced()``, ``verify()`` and ``to_json()``.

    Raises
    ------
    ArgumentError, GeometryError
        What :func:`capture` refuses.
    """
    if model is None:
        model = "lafortune" if isinstance(rig, str) and rig == "snel-lafortune" else MODELS[0]
    rig, camera = _resolved(painting, rig, camera, falloff)
    _check(bits, exposure, frames, model, {"clip": clip, "shadows": shadows})
    limit = _limit(tolerance, bits)
    optics = Optics() if optics is None else optics
    instance(optics, Optics, "optics", "an impasto.simulate.Optics")
    seed = painting.seed if seed is None else seed
    check_seed(seed)
    share, curve = _shares(sensitivity, camera), Encoding(encoding).curve
    sensor = Sensor(_noise(noise), bits, curve, exposure, share, frames, seed)
    diffuse = painting.reflectance_in(camera)
    gloss = lobes(painting, diffuse) if model == "lafortune" else None
    light: Photographs | OtherPhotographs
    if forward is not None and model != "torrance-sparrow":
        raise ArgumentError(
            'forward: it is another Torrance-Sparrow model, found model="lafortune"; leave one out'
        )
    if forward is None:
        light = Photographs(painting, rig, diffuse, gloss, shadows)
    else:
        light = OtherPhotographs(painting, rig, diffuse, shadows, forward)
    if not clip:
        whole = (formed(light.light(i, "forced"), optics, frozenset()) for i in range(len(rig)))
        brightest = max(float(np.nanmax(one, initial=0.0)) for one in whole)
        sensor = replace(sensor, exposure=min(exposure, 0.95 / max(brightest, 1e-6)))
    return planned(
        light, optics, sensor, camera,
        tolerance=tolerance, limit=limit, shares=sensitivity is not None,
    )  # fmt: skip


@with_parameters_of(plan)
def capture(*arguments: Any, **options: Any) -> Capture:
    """Photograph a painting under every light of a rig, from every view.

    Photographs are made one at a time: memory holds the stack (770 of 512 x 512 pixels in three
    bands of 12 bits take 1.2 GB) and one photograph. Effects are simulated where they change a
    sample (:func:`plan`). Lamps with a radius are discs.

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
    optics
        A lens with faults; default: none.
    tolerance
        What may be left out: 0, nothing that changes a sample; ``"code:0.5"``, so many codes of the
        samples before rounding, for samples of ``bits``.
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
    return plan(*arguments, **options).capture()


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


def _noise(noise: bool | Noise | None) -> Noise | None:
    if noise is True:
        return Noise()
    if noise is not False and noise is not None:
        instance(noise, Noise, "noise", "True, False or an impasto.simulate.Noise")
    return noise or None


def _limit(tolerance: str | float, bits: int | None) -> float:
    """Codes that may be left out."""
    kind, limit = checked_tolerance(tolerance)
    if kind == "dE":
        raise ArgumentError(
            f'tolerance: photographs have codes; expected 0 or "code:0.5", found {tolerance!r}'
        )
    if kind and bits is None:
        raise ArgumentError(
            f"tolerance: float samples have no codes; give bits=, or 0, found {tolerance!r}"
        )
    return limit


def _check(
    bits: int | None, exposure: float, frames: int, model: str, switches: dict[str, bool]
) -> None:
    for name, value in switches.items():
        truth(value, name)
    one_of(model, MODELS, "model")
    if bits is not None and not (is_whole(bits) and 1 <= bits <= 16):
        raise ArgumentError(f"bits: expected 1 to 16 or None, found {bits!r}")
    share = "a share of full scale above 0 and up to 1"
    if not 0.0 < number(exposure, "exposure", share) <= 1.0:
        raise ArgumentError(f"exposure: expected {share}, found {exposure!r}")
    if not (is_whole(frames) and frames >= 1):
        raise ArgumentError(f"frames: expected at least one, found {frames!r}")
