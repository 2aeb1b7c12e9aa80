"""Estimate the tone curve that a camera applied, by cross-validation [@stone1974].

Linear samples of a pixel are a linear function of the light direction, outside of shadows and
highlights. A tone curve makes this function nonlinear. Each candidate curve decodes the
photographs, predicts held-out ones from a robust fit of the others, and encodes the prediction;
codes are compared with codes.

Gloss also makes the function nonlinear, with the opposite sign: it makes coded photographs look
linear. An interface reflects all bands alike, so the difference of two bands contains no gloss (the
dichromatic model). Where the paint is coloured enough, differences of bands are predicted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.encoding import POINTS, Encoding
from impasto.errors import ArgumentError

CANDIDATES = ("linear", "srgb", "1.8", "2", "2.2", "2.4", "2.6")
"""Common curves."""
_USUAL = ("srgb", "2.2", "linear")
"""Preferred curves if the photographs do not decide: 8 bits are usually coded ..."""
_USUAL_DEEP = ("linear", "srgb", "2.2")
"""... and more bits are linear."""

_FEWEST = 6
"""Five lights to fit three numbers robustly, and one to hold out."""
_FOLDS = 6
_PIXELS = 2400
"""Pixels (times bands) that are predicted: the most coloured of a larger number."""
_SEEN = 20_000
_PHOTOGRAPHS = 128
"""Largest number of photographs that are used; more do not improve the estimate."""
_ENOUGH = 200
_COLOURED = 0.03
"""Smallest difference of two bands above noise, as a share of full scale."""
_KEPT = 0.6
"""Share of the held-out samples that is compared: the rest may be highlight or cast shadow."""
_DECIDES = 0.01
"""Relative margin below which the curves cannot be distinguished ..."""
_SIGMAS = 3.0
"""... and the number of standard errors, over photographs, that the margin must exceed."""

_SURE = 12
"""Photographs from which on an estimate may overrule the rule that 8-bit files are sRGB ..."""
_TIMES = 4.0
"""... and the error of sRGB that it needs, in units of its own. 3.2 is the largest of 240
selections of photographs of a gilded icon, which gloss misleads; 14 is that of linear paintings."""

_DARK = 0.02
"""Share of full scale below which codes are shadow, and variations are noise."""
_CONTENT = 0.01
"""Share of the samples that must vary with the light."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ToneEstimate:
    """The tone curve that predicts held-out photographs best, and by which margin.

    Parameters
    ----------
    curve
        The curve to use: the best one, or the most usual of the plausible ones.
    decided
        Whether the runner-up is worse beyond doubt.
    margin
        Relative excess of the runner-up's error: 0.2 means 20 % worse.
    runner_up
        The second-best curve.
    errors
        ``(curve, error)`` of each candidate, best first: mean absolute difference between
        predicted and photographed codes, as a share of full scale.
    plausible
        Every curve that is not worse than the best beyond doubt, best first; of grey photographs
        also every curve that is bent more, for gloss makes them look linear.
    coloured
        Whether differences of bands were predicted, which gloss does not disturb.
    where
        The folder of the photographs.
    """

    curve: str
    decided: bool
    margin: float
    runner_up: str
    errors: tuple[tuple[str, float], ...]
    plausible: tuple[str, ...]
    coloured: bool
    where: str = ""
    kind: str = "encoding"
    repair: bool = False
    how: str = "estimated"

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
                f"the photographs do not distinguish the curves "
                f"{', '.join(repr(curve) for curve in self.plausible)}; {self.curve!r} "
                "is used; give encoding= if you know the curve"
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
    strength = np.ones((len(lights), 1)) if intensities is None else np.asarray(intensities)
    strength = np.asarray(strength, dtype=np.float64).reshape(len(lights), -1)
    picked = few(len(lights))
    lights, strength = lights[picked], strength[picked]
    values, clipped = _seen(codes, picked, saturation, white, mask)
    strength = np.broadcast_to(strength, values.shape[:2])
    columns, coloured = _coloured(values, clipped, strength, white), True
    if columns is None:
        columns, coloured = _single(values, clipped, strength), False
    per_photograph = {
        name: _held_out(columns, lights, Encoding(name, white), white) for name in candidates
    }
    errors = sorted(((n, float(e.mean())) for n, e in per_photograph.items()), key=lambda p: p[1])
    best = errors[0][0]
    # Any curve predicts samples that no light changes (a lens cap, a grey card).
    varies = np.ptp(columns.codes, axis=0) > _DARK * white
    content = bool(varies.mean() > _CONTENT)
    plausible = tuple(
        name
        for name, error in errors
        if not content
        or not _worse(per_photograph[name], per_photograph[best], error / max(errors[0][1], 1e-12))
        # Coded grey photographs of glossy surfaces look linear.
        or (not coloured and _bend(name) > _bend(best))
    )
    usual = _USUAL if white == 255.0 else _USUAL_DEEP
    curve = next((name for name in usual if name in plausible), best)
    margin = errors[1][1] / max(errors[0][1], 1e-12) - 1.0 if len(errors) > 1 else np.inf
    return ToneEstimate(
        best if len(plausible) == 1 else curve,
        content and len(plausible) == 1,
        float(margin),
        errors[min(1, len(errors) - 1)][0],
        tuple(errors),
        plausible,
        coloured,
    )


def sure_tone(
    codes: NDArray[np.generic], directions: ArrayLike, *, white: float, **options: Any
) -> ToneEstimate | None:
    """The estimate of :func:`estimate_tone`, if sRGB is wrong beyond doubt; None otherwise.

    That is: coloured photographs under twelve lights or more, whose best curve alone is plausible
    and predicts held-out photographs four times better than sRGB.
    """
    if len(np.asarray(directions)) < _SURE:
        return None
    # Two curves first: nearly all stacks of eight bits end here.
    for candidates in (("srgb", "linear"), CANDIDATES):
        try:
            found = estimate_tone(codes, directions, white=white, candidates=candidates, **options)
        except ArgumentError:
            return None
        errors = dict(found.errors)
        times = errors["srgb"] / max(errors[found.best], 1e-12)
        if not (found.decided and found.coloured and times >= _TIMES):
            return None
    return found


def few(count: int) -> NDArray[np.int64]:
    """The photographs of a stack that are used, in their order."""
    if count <= _PHOTOGRAPHS:
        return np.arange(count)
    return np.sort(np.random.default_rng(2).choice(count, _PHOTOGRAPHS, replace=False))


def _worse(error: Floats, least: Floats, ratio: float) -> bool:
    """Whether a curve predicts significantly worse than the best one."""
    # Ratios, because errors under low lights differ in size from those under high ones; clipped,
    # because the single light above a ring is far off under any wrong curve.
    logs = np.log((error + 1e-9) / (least + 1e-9))
    reach = 3.0 * np.median(np.abs(logs))
    logs = np.clip(logs, -reach, reach)
    doubt = logs.std(ddof=1) / np.sqrt(len(logs))
    return bool(ratio - 1.0 > _DECIDES and logs.mean() > _SIGMAS * doubt)


def _bend(curve: str) -> float:
    """The nonlinearity of a curve, as a gamma."""
    if curve.startswith(POINTS):
        return float(np.log(Encoding(curve).decode(0.5)) / np.log(0.5))
    return {"linear": 1.0, "srgb": 2.2}.get(curve) or float(curve)


@dataclass(frozen=True, eq=False)
class _Columns:
    """The predicted values: codes ``(obs, n)``, minus the light of a second band if there is one.

    Attributes
    ----------
    codes, strength
        Of the samples and of their lights.
    usable
        Neither they nor their companions are clipped.
    companion, companion_strength
        The other band's, or None.
    """

    codes: NDArray[np.float32]
    strength: Floats
    usable: NDArray[np.bool_]
    companion: NDArray[np.float32] | None = None
    companion_strength: Floats | None = None


def _seen(
    codes: NDArray[np.generic],
    photographs: NDArray[np.int64],
    saturation: ArrayLike | None,
    white: float,
    mask: NDArray[np.bool_] | None,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A sample of the pixels ``(obs, band, n)``, and which samples are clipped."""
    bands, height, width = codes.shape[1:]
    inside = np.arange(height * width) if mask is None else np.flatnonzero(mask)
    if len(inside) == 0:
        raise ArgumentError("mask: is empty, no pixel belongs to the painting")
    # Random with a fixed seed: an even step that divides the width would select single columns.
    count = min(len(inside), _SEEN)
    picked = np.sort(np.random.default_rng(0).choice(inside, count, replace=False))
    rows, columns = np.divmod(picked, width)
    values = np.empty((len(photographs), bands, count), dtype=np.float32)
    for row, index in enumerate(photographs.tolist()):
        values[row] = codes[index][:, rows, columns]
    level = np.broadcast_to(
        np.asarray(white if saturation is None else saturation, dtype=np.float32), (bands,)
    )
    clipped = ~(values < level[:, None])
    return np.where(np.isfinite(values), values, np.float32(white)), clipped


def _coloured(
    values: NDArray[np.float32], clipped: NDArray[np.bool_], strength: Floats, white: float
) -> _Columns | None:
    """The strongest and the weakest band of the most coloured pixels; None if all are grey."""
    middle = np.median(values, axis=0)
    colour = (middle.max(axis=0) - middle.min(axis=0)) / white
    strong, weak = middle.argmax(axis=0), middle.argmin(axis=0)
    pixels = np.arange(values.shape[2])
    usable = ~(clipped[:, strong, pixels] | clipped[:, weak, pixels])
    # Pixels that never clip are paint, not gilding, whose gloss is coloured.
    whole = usable.mean(axis=0) == 1.0
    if (whole & (colour > _COLOURED)).sum() < _ENOUGH:
        whole = usable.mean(axis=0) > 0.7
    colour = np.where(whole, colour, 0.0)
    count = max(min(_PIXELS // 2, len(colour) // 4), min(50, len(colour)))
    picked = np.sort(np.argsort(-colour, kind="stable")[:count])
    picked = picked[colour[picked] > _COLOURED]
    if len(picked) < 30:
        return None
    strong, weak = strong[picked], weak[picked]
    return _Columns(
        values[:, strong, picked],
        strength[:, strong],
        usable[:, picked],
        values[:, weak, picked],
        strength[:, weak],
    )


def _single(values: NDArray[np.float32], clipped: NDArray[np.bool_], strength: Floats) -> _Columns:
    """Every band separately, of the first pixels of a second random sample."""
    observations, bands, count = values.shape
    few = min(count, max(1, _PIXELS // bands))
    picked = np.sort(np.random.default_rng(1).choice(count, few, replace=False))
    return _Columns(
        values[:, :, picked].reshape(observations, -1),
        np.repeat(strength, few, axis=1),
        ~clipped[:, :, picked].reshape(observations, -1),
    )


def _held_out(columns: _Columns, lights: Floats, encoding: Encoding, white: float) -> Floats:
    """``(obs,)`` error of each photograph when it is predicted from the others."""
    linear = encoding.decode(columns.codes).astype(np.float64) / columns.strength
    other: Floats | float = 0.0
    if columns.companion is not None:
        other = encoding.decode(columns.companion).astype(np.float64)
        other = other / np.asarray(columns.companion_strength)
    difference = linear - other
    count = len(lights)
    folds = min(_FOLDS, count)
    result = np.zeros(count)
    for fold in range(folds):
        out = np.arange(fold, count, folds)
        train = np.setdiff1d(np.arange(count), out)
        surface = robust_surface(difference[train], columns.usable[train], lights[train])
        predicted = lights[out] @ surface
        if isinstance(other, float):
            predicted = np.maximum(predicted, 0.0)
        else:
            predicted = np.maximum(predicted + other[out], 0.0)
        coded = encoding.encode(predicted * columns.strength[out])
        for row, index in enumerate(out):
            # Codes near black are shadow, which no curve predicts; clipped ones are ignored.
            usable = columns.usable[index] & (columns.codes[index] > _DARK * white)
            miss = np.abs(coded[row] - columns.codes[index])[usable]
            kept = np.sort(miss)[: max(1, int(_KEPT * len(miss)))]
            result[index] = kept.mean() / white if len(kept) else 0.0
    return result


def robust_surface(
    linear: NDArray[np.float64],
    usable: NDArray[np.bool_],
    lights: NDArray[np.float64],
    steps: int = 8,
) -> NDArray[np.float64]:
    """``(3, n)`` albedo times normal by least absolute deviations, by IRLS [@holland1977robust].

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
