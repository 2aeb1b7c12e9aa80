"""Effort of a fit: accuracy against time."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from impasto._internal.checks import suggestion
from impasto.errors import ArgumentError

Preset = Literal["draft", "standard", "reference"]
Origin = Literal["multistart", "neighbours", "neighbours-only"]
Precision = Literal["single", "polished", "double"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """Accuracy of a fit against time; the defaults are those of ``"standard"``.

    These settings change how well a model is fitted, not the model: larger numbers take more time,
    and the unknowns of a pixel stay the same. :doc:`accuracy-and-time` shows the effect of each.

    Parameters
    ----------
    stereo
        Steps of reweighting in photometric stereo (``method="robust"``), 0 to 1000.
    pixels
        Approximate largest number of pixels from which the one lobe of the painting is estimated
        (``pooling="painting"``). Its error falls with their square root. Searches of fewer pixels
        come first; a sixteenth is enough where beta and gamma are then known to 0.3 %.
    rounds
        Rounds of reweighting. In each, all bands are fitted together and samples are reweighted by
        their residuals (``pooling="pixel"``), or a Lafortune fit is repeated without outliers. 0:
        only the mean of the bands is fitted, and no sample is reweighted.
    iterations
        Largest number of steps of each search of a pixel on the mean of its bands
        (``pooling="pixel"``), at least 1.
    colour_iterations
        The same of each search on all bands, in each round; default: as many. Few are enough to
        predict photographs: parameters that the samples hardly determine are better left near their
        start. Normals gain from more steps. With ten of both, all but one pixel in a thousand of a
        gilded icon converge, with the four of ``"draft"`` all but two in a hundred. With 1, a round
        is one Gauss-Newton step in the pass that renews the weights. After three such rounds errors
        of a simulated painting are up to a twentieth larger than those of ``"standard"``. A pixel
        then counts as converged where its last step was shorter than half a standard deviation.
    start
        Where the searches for a pixel's lobes start (``pooling="pixel"``). ``"multistart"``: from
        several fixed widths, one search each; the best is kept. ``"neighbours"``: only every 16th
        pixel of every 16th row uses multistart. Every fourth pixel of every fourth row starts from
        the best of these around it, and all others from the best of those; a pixel uses multistart
        only where its own fit is much worse than theirs. Where a second lobe like theirs is not
        accepted, one more search starts from the best of the fixed widths. If less than 5 % of the
        pixels of the finer grid, or less than 20, have a second lobe of determined width, as many
        as by chance, a second lobe is searched for only beside pixels of the finer grid that have
        one, or by that multistart. ``"neighbours-only"``: it is so in any painting. The choice of
        rows and columns depends on the position of a picture in the painting, so the fit of a part
        may find other lobes than the fit of the whole. Pictures with fewer than 20 pixels of the
        finer grid use multistart everywhere.
    precision
        Precision of the searches for a pixel's normal and lobes (``pooling="pixel"``).
        ``"single"`` ends where the next step would be shorter than a tenth of a standard deviation.
        ``"polished"``: the last round continues in double precision with up to as many steps again;
        it takes 1.4 times as long. ``"double"``: every search is in double precision; it takes 2.0
        times as long. With enough steps these two end within 1e-11 of the least cost. All three
        predict held-out photographs equally well.
        Samples, weights and results are always in single precision; ``converged`` is stricter in
        double. Other fits ignore this setting: the one lobe of a painting or a segment is always
        fitted in double precision, from sums over pixels in single precision; Lafortune lobes are
        fitted in double where the equations are singular in single.

    Raises
    ------
    ArgumentError
        A number outside its range, an unknown start or an unknown precision.
    """

    stereo: int = 5
    pixels: int = 1 << 16
    rounds: int = 2
    iterations: int = 6
    colour_iterations: int | None = None
    start: Origin = "neighbours"
    precision: Precision = "single"

    def __post_init__(self) -> None:
        least = {"stereo": 0, "pixels": 1, "rounds": 0, "iterations": 1}
        if self.colour_iterations is not None:
            least["colour_iterations"] = 1
        for name, low in least.items():
            value = getattr(self, name)
            whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
            high = 1000 if name == "stereo" else np.iinfo(np.int32).max
            if not (whole and low <= value <= high):
                kind = "" if whole else ", a whole number"
                raise ArgumentError(f"{name}: expected {low} to {high}{kind}, found {value!r}")
            object.__setattr__(self, name, int(value))
        for name, words in {"start": get_args(Origin), "precision": get_args(Precision)}.items():
            word = getattr(self, name)
            if not (isinstance(word, str) and word in words):
                names = " or ".join(map(repr, words))
                hint = suggestion(word, words)
                raise ArgumentError(f"{name}: expected {names}, found {word!r}{hint}")

    def to_dict(self) -> dict[str, Any]:
        """The fields by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


EffortLike: TypeAlias = Effort | Preset

PRESETS: dict[str, Effort] = {
    "draft": Effort(pixels=1 << 12, rounds=1, iterations=4),
    "standard": Effort(),
    "reference": Effort(pixels=1 << 18, rounds=3, colour_iterations=3),
}
"""From the recorded study (``python benches/study --presets``), whose rule calls for fewer steps.
All three take more of them: with one or two many searches end before they converge."""


def resolved(effort: EffortLike) -> Effort:
    """The :class:`Effort` of a preset's name."""
    if isinstance(effort, Effort):
        return effort
    if not (isinstance(effort, str) and effort in get_args(Preset)):
        names = ", ".join(map(repr, get_args(Preset)))
        hint = suggestion(effort, get_args(Preset))
        raise ArgumentError(f"effort: expected {names} or an Effort, found {effort!r}{hint}")
    return PRESETS[effort]
