"""Which results can be merged, and what the merged painting has for its gloss."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.fit.lafortune import LafortuneSbrdf
from impasto.fit.lobes import LobeSbrdf
from impasto.fit.pooled import PooledSbrdf
from impasto.fit.result import Sbrdf
from impasto.merge.frames import Frame
from impasto.status import Status

Floats = NDArray[np.float64]
DEVIATIONS = 3.0
"""Standard deviations by which the lobe of a frame may be off that of all."""
ORDER = ("too-few", "no-highlight", "fitted", "mixed", "at-bound")
"""Verdicts; that of the merged painting is the last that a frame has."""


@dataclass(frozen=True)
class Model:
    """What the merged painting is.

    Attributes
    ----------
    kind
        Its class.
    numbers
        Fields of it that are no maps.
    lobes
        Most lobes of a pixel; 0 where one lobe holds for the painting.
    words
        What it has for its gloss.
    """

    kind: type[Sbrdf]
    numbers: dict[str, Any]
    lobes: int
    words: str


def model_of(frames: Sequence[Frame], gains: Floats) -> Model:
    """The model of the merged painting.

    Parameters
    ----------
    frames
        At least two.
    gains
        ``(frame, band)``; the strength of a frame's lobe follows their mean.

    Raises
    ------
    ArgumentError
        Kinds, interfaces or varnishes that do not agree.
    """
    for frame in frames:
        if frame.kind not in {PooledSbrdf, LobeSbrdf, LafortuneSbrdf}:
            raise ArgumentError(
                f"frames: {frame.name} is a {frame.kind.__name__}, whose segments have no "
                'counterpart in other frames; fit it with pooling="painting" or "pixel"'
            )
    ones = [frame.window(slice(0, 1), slice(0, 1)) for frame in frames]
    if all(isinstance(one, LafortuneSbrdf) for one in ones):
        return _lafortune(ones)
    if any(isinstance(one, LafortuneSbrdf) for one in ones):
        named = ", ".join(f"{f.name}: {f.kind.__name__}" for f in frames)
        raise ArgumentError(
            f"frames: Lafortune lobes and Torrance-Sparrow lobes ({named}) cannot be blended; fit "
            "all frames with the same model"
        )
    for name in ("index", "coated"):
        values = [getattr(one, name) for one in ones]
        if len(set(values)) > 1:
            named = ", ".join(f"{f.name}: {v}" for f, v in zip(frames, values, strict=True))
            raise ArgumentError(
                f"frames: {name} differs ({named}), so that diffuse colours mean different things; "
                f"fit all frames with the same {name}="
            )
    pooled = [one for one in ones if isinstance(one, PooledSbrdf)]
    if len(pooled) == len(ones) and (numbers := _one_lobe(pooled, gains.mean(axis=1))):
        return numbers
    most = max(1 if isinstance(one, PooledSbrdf) else len(_lobed(one).specular) for one in ones)
    words = "lobes per pixel"
    if len(pooled) == len(ones):
        words = "one lobe per pixel, blended from the lobes of the frames, which differ"
    return Model(LobeSbrdf, _interface(ones[0]), most, words)


def as_maps(part: Sbrdf, model: Model) -> dict[str, NDArray[Any]]:
    """The maps of a part of a frame as the merged painting has them."""
    from impasto.fit.saved import maps_of

    arrays = {name: np.asarray(one) for name, one in part.arrays().items()}
    maps = {name: arrays[name] for name in maps_of(part) if name in arrays}
    maps = {name: one for name, one in maps.items() if not name.startswith(("residuals", "relief"))}
    if isinstance(part, PooledSbrdf) and model.kind is LobeSbrdf:
        del maps["misfit"]
        maps |= _lifted(part, model.lobes)
    elif model.lobes:
        short = model.lobes - len(_lobed(part).specular)
        for name in ("specular", "gamma", "gamma_sigma", "tinted", "cxy", "cz", "exponent",
                     "specular_sigma", "direction_sigma", "exponent_sigma"):  # fmt: skip
            if short and name in maps:
                maps[name] = _filled(maps[name], short, part.status >= Status.DARK)
    return maps


def _filled(plane: NDArray[Any], short: int, unknown: NDArray[np.bool_]) -> NDArray[Any]:
    """A map over more lobes, which no pixel has: no strength and no shape."""
    size = (short, *plane.shape[1:])
    if plane.dtype == np.bool_:
        more = np.zeros(size, np.bool_)
    elif plane.ndim == 4:
        more = np.where(unknown, np.float32(np.nan), np.zeros(size, np.float32))
    else:
        more = np.full(size, np.nan, np.float32)
    return np.concatenate([plane, more])


def _lifted(part: PooledSbrdf, lobes: int) -> dict[str, NDArray[Any]]:
    """The painting's one lobe as the lobe of every pixel."""
    bands, *size = part.diffuse.shape
    known = part.estimated
    has = known & (part.beta > 0.0)
    specular = np.zeros((lobes, bands, *size), np.float32)
    specular[0] = np.where(known, np.float32(part.beta), 0.0)
    specular[:, :, ~known] = np.nan
    gamma, sigma = (np.full((lobes, *size), np.nan, np.float32) for _ in range(2))
    gamma[0, has] = part.gamma
    deviation = math.sqrt(part.covariance[1, 1])
    sigma[0, has] = deviation if math.isfinite(deviation) else np.nan
    return {
        "specular": specular,
        "gamma": gamma,
        "gamma_sigma": sigma,
        "lobes": has.astype(np.uint8),
        "ambient": np.where(known, np.zeros_like(part.diffuse), np.float32(np.nan)),
        "tinted": np.zeros((lobes, *size), np.bool_),
        "converged": known & part.converged,
    }


def _one_lobe(ones: Sequence[PooledSbrdf], gain: Floats) -> Model | None:
    """One lobe for the painting where those of the frames agree within their errors, else None."""
    shared = {
        "verdict": max((one.verdict for one in ones), key=ORDER.index),
        "curve": np.concatenate(
            [one.curve * (1.0, g, 1.0) for one, g in zip(ones, gain.tolist(), strict=True)]
        ),
        "describes": _mean([one.describes for one in ones]),
        "converged": all(one.converged for one in ones),
        **_interface(ones[0]),
    }
    if all(one.beta == 0.0 for one in ones):
        lobe = {"beta": 0.0, "gamma": ones[0].gamma, "covariance": np.diag([np.inf, np.inf])}
        return Model(PooledSbrdf, shared | lobe | {"path": np.zeros((0, 2))}, 0, "no gloss")
    if any(one.beta == 0.0 for one in ones):
        return None
    logs = np.array(
        [
            (math.log(one.beta * g), math.log(one.gamma))
            for one, g in zip(ones, gain.tolist(), strict=True)
        ]
    )
    variances = np.array([np.diag(one.covariance) for one in ones])
    if not (np.isfinite(variances).all() and (variances > 0.0).all()):
        return None
    evidence = 1.0 / variances
    mean = (evidence * logs).sum(axis=0) / evidence.sum(axis=0)
    if (np.abs(logs - mean) > DEVIATIONS * np.sqrt(variances)).any():
        return None
    beta, gamma = np.exp(mean).tolist()
    lobe = {
        "beta": beta,
        "gamma": gamma,
        "covariance": np.diag(1.0 / evidence.sum(axis=0)),
        "path": np.array([(beta, gamma)]),
    }
    words = "one lobe for the painting, in which those of the frames agree"
    return Model(PooledSbrdf, shared | lobe, 0, words)


def _lafortune(ones: Sequence[Sbrdf]) -> Model:
    verdicts = {one.verdict for one in ones if isinstance(one, LafortuneSbrdf)}
    verdict = "one-view" if "one-view" in verdicts else "fitted"
    most = max(len(_lobed(one).specular) for one in ones)
    return Model(LafortuneSbrdf, {"verdict": verdict}, most, "Lafortune lobes per pixel")


def _interface(one: Sbrdf) -> dict[str, Any]:
    assert isinstance(one, PooledSbrdf | LobeSbrdf)
    return {"index": one.index, "coated": one.coated}


def _lobed(one: Sbrdf) -> LobeSbrdf | LafortuneSbrdf:
    assert isinstance(one, LobeSbrdf | LafortuneSbrdf)
    return one


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return sum(known) / len(known) if known else math.nan
