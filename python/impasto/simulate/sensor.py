"""From light to the samples of a file: exposure, shot and read noise, clipping, rounding."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.rig import Rig
from impasto.simulate.fields import Field
from impasto.stack import Stack

FAR = 6.0
"""Standard deviations within which all but one of 5e8 normal deviates lie."""


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

    def deviation(self, exposed: NDArray[np.floating], frames: int) -> Field:
        """Standard deviation of light of any shape, full scale 1, in the mean of some frames."""
        electrons = np.maximum(exposed, 0.0) * np.float32(self.full_well)
        deviation = np.sqrt((electrons + np.float32(self.read**2)) / np.float32(frames))
        return np.asarray(deviation / np.float32(self.full_well), dtype=np.float32)

    def added(self, exposed: Field, frames: int, rng: np.random.Generator) -> Field:
        """The light with noise."""
        # A Poisson count above about 50 electrons is normal to within a hundredth of its
        # deviation; below, the read noise dominates.
        deviation = self.deviation(exposed, frames)
        normal = rng.standard_normal(exposed.shape, dtype=np.float32)
        return np.asarray(exposed + deviation * normal)


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor with its exposure.

    Attributes
    ----------
    noise
        None for none.
    bits
        1 to 16; None for float32 samples.
    curve
        The tone curve of the files, full scale 1.0.
    exposure
        Share of full scale that a white board facing a light of intensity 1 reaches.
    share
        ``(band,)``: relative sensitivities.
    frames
        Exposures averaged before quantisation.
    seed
        Of the noise.
    quiet
        Whether noise is left out of the samples, which keep its pedestal.
    """

    noise: Noise | None
    bits: int | None
    curve: str
    exposure: float
    share: NDArray[np.float64]
    frames: int
    seed: int
    quiet: bool = False

    @property
    def linear(self) -> bool:
        """Whether samples are proportional to light."""
        return self.encoding.curve == "linear"

    @property
    def encoding(self) -> Encoding:
        """From light, full scale 1, to codes."""
        return Encoding(self.curve, self.full)

    @property
    def full(self) -> float:
        """The code of full scale; 1.0 of float samples."""
        return 1.0 if self.bits is None else float(2**self.bits - 1)

    @property
    def black(self) -> float:
        """The code of no light: a pedestal keeps the noise of dark samples from being clipped."""
        return float(round(self.full / 64)) if self.bits and self.noise and self.linear else 0.0

    @property
    def gain(self) -> NDArray[np.float32]:
        """``(band,)``: shares of full scale from light, white board 1."""
        return (self.exposure * self.share).astype(np.float32)

    @property
    def dtype(self) -> type[np.float32] | type[np.uint8] | type[np.uint16]:
        """Of the samples."""
        if self.bits is None or not self.linear:
            return np.float32
        return np.uint8 if self.bits <= 8 else np.uint16

    def steepness(self) -> tuple[float, float]:
        """Codes of the darkest light, and the most codes per share of full scale beyond it.

        A concave tone curve is nowhere steeper than in a step towards the place where that begins,
        that of sRGB, which begins straight, than there; the curve of a gamma below 1, which is
        convex, than at full scale.
        """
        if self.linear:
            return 0.0, self.full - self.black
        curve = self.encoding.curve
        if curve == "srgb":
            # Its two branches meet within 3e-8.
            return 3e-8 * self.full, 12.92 * self.full
        if float(curve) < 1.0:
            return 0.0, self.full / float(curve)
        dark = 2.0**-20
        at, before = self.encoding.encode(np.array([dark, dark / 2.0])).astype(np.float64)
        # Codes are single precision.
        return float(at), float((at - before) / (dark / 2.0)) * (1.0 + 1e-6)

    def scatter(self) -> float:
        """Codes within which noise moves all but one of 5e8 samples: six deviations at full scale.

        Of a brighter sample, which is clipped, less is seen.
        """
        if self.noise is None:
            return 0.0
        first, slope = self.steepness()
        deviation = float(self.noise.deviation(np.ones(1, np.float32), self.frames)[0])
        return first + slope * FAR * deviation

    def magnification(self) -> float:
        """Most that an error of light is larger in the samples: light scatters with its own noise.

        The deviation ``sqrt(s + r^2)`` of s electrons and read noise r changes by at most
        ``1 / (2 r)`` per electron.
        """
        if self.noise is None or self.quiet:
            return 1.0
        if self.noise.read == 0.0:
            return np.inf
        return 1.0 + 0.5 * FAR / (self.noise.read * float(np.sqrt(self.frames)))

    def samples(self, light: Field, observation: int) -> NDArray[Any]:
        """Samples of noiseless light ``(band, y, x)``, white board 1."""
        gain = self.gain[:, None, None]
        exposed = light * gain
        if self.noise is not None and not self.quiet:
            exposed = self.noise.added(exposed, self.frames, _stream(self.seed, observation))
        if not self.linear:
            coded = self.encoding.encode(exposed)
            return self.encoding.decode(coded if self.bits is None else np.rint(coded))
        if self.bits is None:
            return np.asarray(np.minimum(exposed, 1.0) / gain)
        codes = np.clip(exposed * (self.full - self.black) + self.black, 0.0, self.full)
        return np.asarray(np.rint(codes), dtype=self.dtype)

    def codes(self, samples: NDArray[Any]) -> NDArray[np.float64]:
        """Codes of samples, not rounded where the samples are not."""
        if self.linear:
            return samples.astype(np.float64)
        return self.encoding.encode(samples).astype(np.float64)

    def stack(
        self, samples: NDArray[Any], rig: Rig, bands: Sequence[str], *, shares: bool
    ) -> Stack:
        """Samples ``(obs, band, y, x)`` as a stack; ``shares``: whether bands differ."""
        if not self.linear:
            lit = [
                replace(light, intensity=light.intensity * self.exposure) for light in rig.lights
            ]
            scale: dict[str, Any] = {"scale": 1.0 / self.share} if shares else {}
            return Stack(
                samples, lights=rig.with_lights(lit), bands=bands, saturation=1.0,
                encoding=self.encoding, **scale,
            )  # fmt: skip
        if self.bits is None:
            return Stack(samples, lights=rig, bands=bands, saturation=np.float32(1.0) / self.gain)
        above = self.full - self.black
        return Stack(
            samples, lights=rig, bands=bands, saturation=self.full, black=self.black,
            scale=1.0 / (self.exposure * self.share * above),
            encoding=Encoding("linear", self.exposure * above),
        )  # fmt: skip


def _stream(seed: int, observation: int) -> np.random.Generator:
    key = (zlib.crc32(b"noise"), observation)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
