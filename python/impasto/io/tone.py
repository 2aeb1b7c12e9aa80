"""Which tone curve a camera applied, told by the photographs themselves.

Under a moving light a pixel's linear value is a linear function of the light direction wherever
it is neither shadow nor highlight. A curve left in bends that relation. Each candidate curve is
judged on photographs that were held out: decode with it, fit the others robustly, predict, encode
with it again and compare codes with codes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError

CANDIDATES = ("linear", "srgb", "1.8", "2", "2.2", "2.4", "2.6")
"""Curves met in practice."""

_FEWEST = 6
"""Five lights to fit three numbers robustly, and one to hold out."""
_FOLDS = 6
_PIXELS = 3000
_KEPT = 0.6
"""Share of the held-out samples that is compared: the rest may be highlight or cast shadow."""
_DECIDES = 0.01
"""Relative margin below which nothing can be told ..."""
_SIGMAS = 3.0
"""... and the number of standard errors, over photographs, that the margin must exceed."""


@dataclass(frozen=True, slots=True)
class ToneEstimate:
    """Which tone curve explains held-out photographs best, and by how much.

    Parameters
    ----------
    curve
        The curve to use: the best one, or the more usual one where nothing can be told.
    decided
        Whether the runner-up is worse beyond doubt.
    margin
        Relative excess of the runner-up's error: 0.2 means 20 % worse.
    runner_up
        The second-best curve.
    errors
        ``(curve, error)`` of each candidate, best first: mean absolute difference between
        predicted and photographed codes, as a share of full scale.
    where
        The folder of the photographs.
    """

    curve: str
    decided: bool
    margin: float
    runner_up: str
    errors: tuple[tuple[str, float], ...]
    where: str = ""
    kind: str = "encoding"
    repair: bool = False

    @property
    def best(self) -> str:
        """The curve with the smallest error."""
        return self.errors[0][0]

    @property
    def message(self) -> str:
        """The finding in one sentence."""
        table = ", ".join(f"{curve} {100 * error:.2f} %" for curve, error in self.errors)
        if self.decided:
            verdict = (
                f"the photographs follow the curve {self.curve!r}; {self.runner_up!r} is "
                f"{100 * self.margin:.1f} % worse"
            )
        else:
            verdict = (
                f"cannot tell the curve from the photographs ({self.best!r} and "
                f"{self.runner_up!r} differ by {100 * self.margin:.1f} % only); {self.curve!r} "
                "is used, say encoding= if you know better"
            )
        return f"{verdict} (held-out error: {table})"

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" if self.where else self.message


def estimate_tone(
    codes: NDArray[np.generic],
    directions: ArrayLike,
    *,
    white: float,
    saturation: ArrayLike | None = None,
    mask: NDArray[np.bool_] | None = None,
    intensities: ArrayLike | None = None,
    candidates: tuple[str, ...] = CANDIDATES,
) -> ToneEstimate:
    """Estimate the tone curve of a stack by held-out error.

    Parameters
    ----------
    codes
        ``(obs, band, y, x)`` as stored in the files.
    directions
        ``(obs, 3)`` unit directions to the lights.
    white
        Code of full scale: 255, 65535, or 1.0.
    saturation
        Code(s) from which a sample is clipped, one or one per band; default ``white``.
    mask
        ``(y, x)``: pixels to look at.
    intensities
        ``(obs,)``, ``(obs, 1)`` or ``(obs, band)`` strengths of the lights.
    candidates
        The curves to compare, as :class:`~impasto.Encoding` names them.

    Raises
    ------
    ArgumentError
        Fewer than six photographs, or no pixel with usable samples.
    """
    lights = np.asarray(directions, dtype=np.float64)
    if len(lights) < _FEWEST:
        raise ArgumentError(
            f'encoding: "auto" needs at least {_FEWEST} photographs, found {len(lights)}; '
            'say "srgb" for JPEG or "linear" for developed RAW'
        )
    values, clipped = _columns(codes, saturation, white, mask)
    strengths = np.ones((len(lights), 1)) if intensities is None else np.asarray(intensities)
    strengths = np.asarray(strengths, dtype=np.float64).reshape(len(lights), -1)
    # One column per (band, pixel): the band of a column gives its light's strength.
    strength = np.repeat(
        np.broadcast_to(strengths, (len(lights), codes.shape[1])),
        values.shape[1] // codes.shape[1],
        axis=1,
    )
    per_photograph = {
        name: _held_out(values, clipped, lights, strength, Encoding(name, white), white)
        for name in candidates
    }
    errors = sorted(((n, float(e.mean())) for n, e in per_photograph.items()), key=lambda p: p[1])
    best, second = errors[0][0], errors[1][0]
    # Ratios, because a photograph with a low light has errors of another size than one from above.
    ratio = np.log((per_photograph[second] + 1e-9) / (per_photograph[best] + 1e-9))
    margin = errors[1][1] / max(errors[0][1], 1e-12) - 1.0
    doubt = ratio.std(ddof=1) / np.sqrt(len(ratio))
    decided = bool(margin > _DECIDES and ratio.mean() > _SIGMAS * doubt)
    curve = best
    if not decided and {best, second} == {"srgb", "2.2"}:
        # Both are in use; files say sRGB far more often, and the two differ in the shadows only.
        curve = "srgb"
    return ToneEstimate(curve, decided, margin, second, tuple(errors))


def _columns(
    codes: NDArray[np.generic],
    saturation: ArrayLike | None,
    white: float,
    mask: NDArray[np.bool_] | None,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Evenly spread pixels of every band as columns ``(obs, band * n)``, and which are clipped."""
    observations, bands, height, width = codes.shape
    inside = np.arange(height * width) if mask is None else np.flatnonzero(mask)
    step = max(1, len(inside) // max(1, _PIXELS // bands))
    # A fixed-seed draw: an even step would walk down single columns where it divides the width.
    draw = np.random.default_rng(0).choice(len(inside), len(range(0, len(inside), step)), False)
    picked = inside[np.sort(draw)]
    flat = codes.reshape(observations, bands, -1)[:, :, picked].astype(np.float32)
    level = np.broadcast_to(
        np.asarray(white if saturation is None else saturation, dtype=np.float32), (bands,)
    )
    clipped = ~(flat < level[:, None])
    flat = np.where(np.isfinite(flat), flat, np.float32(white))
    return flat.reshape(observations, -1), clipped.reshape(observations, -1)


def _held_out(
    codes: NDArray[np.float32],
    clipped: NDArray[np.bool_],
    lights: NDArray[np.float64],
    strength: NDArray[np.float64],
    encoding: Encoding,
    white: float,
) -> NDArray[np.float64]:
    """``(obs,)`` error of each photograph when it is predicted from the others."""
    linear = encoding.decode(codes).astype(np.float64) / strength
    count = len(lights)
    folds = min(_FOLDS, count)
    result = np.zeros(count)
    for fold in range(folds):
        out = np.arange(fold, count, folds)
        train = np.setdiff1d(np.arange(count), out)
        surface = robust_surface(linear[train], ~clipped[train], lights[train])
        predicted = encoding.encode(np.maximum(lights[out] @ surface, 0.0) * strength[out])
        for row, index in enumerate(out):
            # Codes near black are shadow, which no curve explains; clipped ones say nothing.
            usable = ~clipped[index] & (codes[index] > 0.02 * white)
            miss = np.abs(predicted[row] - codes[index])[usable]
            kept = np.sort(miss)[: max(1, int(_KEPT * len(miss)))]
            result[index] = kept.mean() / white if len(kept) else 0.0
    return result


def robust_surface(
    linear: NDArray[np.float64],
    usable: NDArray[np.bool_],
    lights: NDArray[np.float64],
    steps: int = 8,
) -> NDArray[np.float64]:
    """``(3, n)`` albedo times normal by least absolute deviations, columns reweighted together.

    Parameters
    ----------
    linear, usable
        ``(obs, n)`` linear samples and whether they count.
    lights
        ``(obs, 3)``.
    steps
        Reweighting steps.
    """
    outer = np.einsum("ki,kj->kij", lights, lights).reshape(len(lights), 9)
    weight = usable.astype(np.float64)
    surface = np.zeros((3, linear.shape[1]))
    for _ in range(steps):
        normal = (weight.T @ outer).reshape(-1, 3, 3)
        # A relative ridge keeps columns with fewer than three usable samples solvable.
        trace = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        normal = normal + (1e-9 * trace + 1e-30) * np.eye(3)
        right = (weight * linear).T @ lights
        surface = np.linalg.solve(normal, right[..., None])[..., 0].T
        miss = np.abs(linear - lights @ surface)
        scale = np.median(miss, axis=0)
        weight = usable / np.maximum(miss, 1e-3 * scale + 1e-12)
    return surface
