"""What photographs call for: effects of light, lens and sensor, each simulated or left out."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impasto.bands import Camera
from impasto.effects import Decision, PlannedEffect, names, records, table
from impasto.rig import Rig
from impasto.simulate.fields import Field
from impasto.simulate.lobes import Lobes
from impasto.simulate.optics import OVERSHOOT, Optics
from impasto.simulate.paintings import Painting
from impasto.simulate.photographs import SIDE, Mode, OtherPhotographs, Photographs
from impasto.simulate.sensor import FAR, Sensor
from impasto.stack import Stack

_ELSEWHERE = frozenset(
    {
        "slanted view",
        "parallax",
        "environment",
        "sky occlusion",
        "one bounce",
        "ambient",
        "gamut clipping",
    }
)
"""Effects of pictures that no photograph of a simulated painting has: it is rectified, and no light
of a band is below 0."""

_NOISE = ("shot noise", "read noise")
_STRENGTH: tuple[Decision, ...] = ("absent", "no-op", "bounded", "on")


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
        ``(3, y, x)`` float32. What a lens distorts does not lie on these pixels.
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


@dataclass(frozen=True, slots=True)
class CaptureCheck:
    """Photographs as planned, compared with those that have every effect.

    Attributes
    ----------
    equal
        Whether all samples are the same.
    codes
        The largest difference in codes of the samples, rounded as they are.
    """

    equal: bool
    codes: float


@dataclass(frozen=True, eq=False, repr=False)
class CapturePlan:
    """What the photographs of a rig call for, and the photographs: :func:`impasto.simulate.plan`.

    Attributes
    ----------
    effects
        A row per effect; tiles are counted over all photographs.
    tolerance
        As given.
    error
        The largest sum of what a sample does without, in codes.
    tiles
        Tiles of all photographs.
    """

    effects: tuple[PlannedEffect, ...]
    tolerance: str | float
    error: float
    tiles: int
    _light: Photographs | OtherPhotographs
    _optics: Optics
    _dropped: frozenset[str]
    _sensor: Sensor
    _camera: Camera
    _shares: bool
    _mode: Mode = "planned"

    def capture(self) -> Capture:
        """The photographs, made one at a time, with their true values."""
        light, sensor = self._light, self._sensor
        samples = np.empty((len(light), *light.diffuse.shape), dtype=sensor.dtype)
        for observation in range(len(light)):
            samples[observation] = self._photograph(observation)
        stack = sensor.stack(samples, light.rig, self._camera.bands, shares=self._shares)
        p = light.painting
        truth = Truth(
            p, light.rig, self._camera, p.normal, light.diffuse, p.beta, p.gamma,
            getattr(light, "lobes", None), sensor.exposure,
        )  # fmt: skip
        return Capture(stack, truth)

    def forced(self) -> CapturePlan:
        """The plan that simulates every effect that is there, everywhere."""
        effects = tuple(
            effect
            if effect.decision == "absent"
            else replace(effect, decision="on", tiles=self.tiles, reason="forced", error=0.0)
            for effect in self.effects
        )
        sensor = replace(self._sensor, quiet=False)
        return replace(
            self, effects=effects, tolerance=0, error=0.0, _dropped=frozenset(), _sensor=sensor,
            _mode="forced",
        )  # fmt: skip

    def verify(self) -> CaptureCheck:
        """Make every photograph both as planned and forced, and compare all samples."""
        forced, equal, farthest = self.forced(), True, 0.0
        for observation in range(len(self._light)):
            one, other = self._photograph(observation), forced._photograph(observation)
            if one.tobytes() != other.tobytes():
                equal = False
                codes = [self._sensor.codes(samples) for samples in (one, other)]
                farthest = max(farthest, float(np.nanmax(np.abs(codes[0] - codes[1]), initial=0.0)))
        return CaptureCheck(equal, farthest)

    def explain(self) -> str:
        """The decisions as a table."""
        lines = table(self.effects, self.tiles, "codes")
        total = f"{self.error:.2g} codes" if self.error else "0"
        lines.append(f"tolerance {self.tolerance}; left out of any sample: at most {total}")
        return "\n".join(lines)

    def to_json(self) -> str:
        """Decisions, numbers and tolerance as JSON, for an archive."""
        numbers = {"tolerance": self.tolerance, "error": self.error, "unit": "codes"}
        found = {**numbers, "tiles": self.tiles, "effects": records(self.effects)}
        return json.dumps(found, indent=2)

    def __repr__(self) -> str:
        return f"<CapturePlan {names(self.effects)}, tolerance {self.tolerance}>"

    def _photograph(self, observation: int) -> NDArray[np.generic]:
        light = self._light.light(observation, self._mode)
        through = formed(light, self._optics, self._dropped)
        return self._sensor.samples(through, observation)


def formed(light: Field, optics: Optics, dropped: frozenset[str]) -> Field:
    """Light ``(band, y, x)`` through a lens without some of its effects."""
    if "lens distortion" not in dropped:
        light = optics.distorted(light)
    if "blur" not in dropped:
        light = optics.blurred(light)
    if optics.vignetting > 0.0 and "vignetting" not in dropped:
        light = light * optics.flat((light.shape[1], light.shape[2]))
    return light


def planned(
    light: Photographs | OtherPhotographs,
    optics: Optics,
    sensor: Sensor,
    camera: Camera,
    *,
    tolerance: str | float,
    limit: float,
    shares: bool,
) -> CapturePlan:
    """Decide what is left out: noise first, which takes longest, then the lens, then light.

    ``limit``: the tolerance in codes. What a lens or a sensor does to light it does to an error of
    light, too: light has what is left of the limit, over the most that they magnify it.
    """
    noise = _noise(sensor, limit)
    sensor = replace(sensor, quiet=noise[0].decision == "bounded")
    left = limit - sum(row.error for row in noise)
    lens = _lens(light, optics, sensor, left)
    dropped = frozenset(row.name for row in lens if row.decision == "bounded")
    left -= sum(row.error for row in lens)
    larger = sensor.magnification()
    if optics.distorts and "lens distortion" not in dropped:
        larger *= OVERSHOOT
    if isinstance(light, Photographs):
        first, slope = sensor.steepness()
        brightest = sensor.gain * np.float64(OVERSHOOT if optics.distorts else 1.0)
        limits = _Limit((left - first) / larger, slope, sensor.gain)
        light = replace(light, limit=limits, gain=brightest)
    lit, tiles, error = _light(light)
    full = _saturation(lit, tiles, noise[0])
    lit = [row for row in lit if row.name != "clipping"]
    after = [
        replace(row, tiles=tiles) if row.decision == "on" else row
        for row in (*lens, *noise, _rounding(sensor))
    ]
    after.insert(-1, full)
    left_out = error * larger + sensor.steepness()[0] if error > 0.0 else 0.0
    error = left_out + sum(row.error for row in after)
    return CapturePlan(
        (*lit, *after), tolerance, error, tiles, light, optics, dropped, sensor, camera, shares
    )


@dataclass(frozen=True, slots=True)
class _Limit:
    """A tolerance for the light of some bands, as the core takes it."""

    codes: float
    slope: float
    gain: NDArray[np.float32]

    def __call__(self, bands: list[int]) -> tuple[float, list[list[float]], list[float]] | None:
        if not self.codes > 0.0:
            return None
        display = np.zeros((3, 3))
        display[range(len(bands)), range(len(bands))] = self.gain[bands]
        return self.codes, display.tolist(), [self.slope] * 3


def _light(
    light: Photographs | OtherPhotographs,
) -> tuple[list[PlannedEffect], int, float]:
    """Rows of all photographs together, the number of tiles, the largest sum of errors."""
    rows, columns = light.painting.size
    tiles = len(light) * -(-rows // SIDE) * -(-columns // SIDE)
    if isinstance(light, OtherPhotographs):
        reason = "a forward model of the caller"
        return [PlannedEffect("light", "on", tiles, reason, 0.0)], tiles, 0.0
    found: dict[str, list[PlannedEffect]] = defaultdict(list)
    error = 0.0
    for observation in range(len(light)):
        plans = light.plans(observation, "planned")
        error = max(error, *(plan.error for plan in plans))
        for same in zip(*(plan.rows for plan in plans), strict=True):
            effects = [
                PlannedEffect(
                    row["effect"], row["decision"], row["tiles"], row["reason"], row["error"]
                )
                for row in same
            ]
            one = _together(effects, max(row.tiles for row in effects))
            named = f"photograph {observation + 1}: {one.reason}" if len(light) > 1 else one.reason
            found[one.name].append(replace(one, reason=named))
    merged = [
        _together(effects, sum(row.tiles for row in effects))
        for name, effects in found.items()
        if name not in _ELSEWHERE
    ]
    return merged, tiles, error


def _together(effects: list[PlannedEffect], tiles: int) -> PlannedEffect:
    """One row for several: the reason is that of the one that needs most."""
    most = max(effects, key=lambda row: (_STRENGTH.index(row.decision), row.tiles))
    return replace(most, tiles=tiles, error=max(row.error for row in effects))


def _noise(sensor: Sensor, left: float) -> list[PlannedEffect]:
    """Shot and read noise, which one random number makes: left out together or not at all."""
    noise = sensor.noise
    if noise is None:
        return [PlannedEffect(name, "absent", 0, "no noise", 0.0) for name in _NOISE]
    codes = sensor.scatter()
    what = f"{FAR:g} deviations at full scale are {codes:.3g} codes"
    if 0.0 < codes <= left:
        reason = f"{what}, which one of 5e8 samples exceeds"
        shot = PlannedEffect("shot noise", "bounded", 0, reason, codes)
        read = PlannedEffect("read noise", "bounded", 0, "within shot noise", 0.0)
    else:
        shot = PlannedEffect("shot noise", "on", 0, what, 0.0)
        electrons = f"{noise.read:g} electrons of {noise.full_well:g}"
        read = PlannedEffect("read noise", "on", 0, electrons, 0.0)
    if noise.read == 0.0:
        read = PlannedEffect("read noise", "absent", 0, "no electrons", 0.0)
    return [shot, read]


def _saturation(lit: list[PlannedEffect], tiles: int, noise: PlannedEffect) -> PlannedEffect:
    """What is clipped at full scale: light has a bound, also through the lens; noise has none."""
    bounds = [row for row in lit if row.name == "clipping"]
    if not bounds:
        return PlannedEffect("saturation", "on", tiles, "light without a bound", 0.0)
    (bound,) = bounds
    if bound.decision == "no-op" and noise.decision == "on":
        reason = f"noise without a bound; before it, {bound.reason}"
        return PlannedEffect("saturation", "on", tiles, reason, 0.0)
    return replace(bound, name="saturation")


def _lens(
    light: Photographs | OtherPhotographs, optics: Optics, sensor: Sensor, left: float
) -> list[PlannedEffect]:
    """What a lens changes at most, relative to the brightest light."""
    size = light.painting.size
    x, y = optics.displacement(size)
    shares = {
        "lens distortion": (optics.moved(size), f"it moves pixels by up to {max(x, y):.3g}"),
        "blur": (optics.spread(), f"a pixel loses {optics.spread():.3g} of its light"),
        "vignetting": (optics.vignetting, f"corners lose {optics.vignetting:.3g} of their light"),
    }
    first, slope = sensor.steepness()
    slope *= sensor.magnification()
    # Light that reaches full scale decides whether the brightest light is looked for.
    some = any(share > 0.0 and first + share * slope <= left for share, _ in shares.values())
    brightest = _brightest(light, sensor) * OVERSHOOT if some else np.inf
    rows = []
    for name, (share, what) in shares.items():
        codes = first + share * slope * brightest if share > 0.0 else 0.0
        if share == 0.0:
            rows.append(PlannedEffect(name, "absent", 0, "not there", 0.0))
        elif codes <= left:
            left -= codes
            reason = f"{what}, where the brightest is {brightest / OVERSHOOT:.3g} of full scale"
            rows.append(PlannedEffect(name, "bounded", 0, reason, codes))
        else:
            rows.append(PlannedEffect(name, "on", 0, what, 0.0))
    return rows


def _brightest(light: Photographs | OtherPhotographs, sensor: Sensor) -> float:
    """The brightest light of all photographs, as a share of full scale."""
    gain = sensor.gain[:, None, None]
    most = (np.nanmax(light.light(i, "forced") * gain, initial=0.0) for i in range(len(light)))
    return float(max(most))


def _rounding(sensor: Sensor) -> PlannedEffect:
    if sensor.bits is None:
        return PlannedEffect("rounding", "absent", 0, "float samples", 0.0)
    return PlannedEffect("rounding", "on", 0, f"integers of {sensor.bits} bits", 0.0)
