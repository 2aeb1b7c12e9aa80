"""A picture of a measured tone curve: the points, the curve with its interval, what is left."""

from __future__ import annotations

import numpy as np

from impasto.calibrate.linearity import ToneCurve, points_of
from impasto.encoding import Encoding
from impasto.pictures import FAINT, Picture, Series, contact_sheet, diagram_panel
from impasto.pictures.diagrams import AMBER, GREEN

INTERVAL = 1.96
"""Standard deviations of a 95 % interval."""
MOST = 400
"""Points that are drawn."""


def tone_picture(found: ToneCurve) -> Picture:
    """``(y, x, 3)``: light over code with a 95 % interval, the nearest known curve, residuals."""
    response = found.response
    points = points_of(found)
    some = np.linspace(0, len(points) - 1, min(MOST, len(points))).astype(int)
    grid = np.linspace(0.0, 1.0, 257)
    low, high = found.measured
    middle = float(response(np.array([high]))[0])
    known = Encoding(found.nearest).decode(grid).astype(np.float64)
    known *= middle / float(np.interp(high, grid, known))
    sigma = np.interp(grid, response.codes, response.sigma)
    curve = response(grid)
    inside = (grid >= low) & (grid <= high)
    lines = [
        Series(found.nearest_words, np.stack([grid, known], axis=1), FAINT),
        Series("95 %", np.stack([grid, curve + INTERVAL * sigma], axis=1), GREEN),
        Series("", np.stack([grid, curve - INTERVAL * sigma], axis=1), GREEN),
        Series("measured", np.stack([grid, curve], axis=1), AMBER),
        Series("", points[some], AMBER, dots=True),
    ]
    percent = 100.0 * found.response.residual
    reach = max(1.2 * float(np.abs(percent).max()), 0.5)
    left = [
        Series("", [(0.0, 0.0), (1.0, 0.0)], FAINT),
        Series("", np.stack([points[some, 0], percent[some]], axis=1), AMBER, dots=True),
    ]
    apart = 100.0 * (curve - known)[inside] / middle
    width = 100.0 * INTERVAL * sigma[inside] / middle
    span = max(1.2 * float((np.abs(apart) + width).max()), 0.1)
    against = [
        Series("", [(0.0, 0.0), (1.0, 0.0)], FAINT),
        Series("95 %", np.stack([grid[inside], apart + width], axis=1), GREEN),
        Series("", np.stack([grid[inside], apart - width], axis=1), GREEN),
        Series("", np.stack([grid[inside], apart], axis=1), AMBER),
    ]
    ends = ("code 0", "full scale")
    return contact_sheet(
        [
            diagram_panel(lines, "Light", x=(0.0, 1.0), y=(0.0, 1.0), axis=ends),
            diagram_panel(
                against, f"Less {found.nearest_words}", x=(0.0, 1.0), y=(-span, span), axis=ends,
                note="% of the light at the last point",
            ),
            diagram_panel(
                left, "Residuals", x=(0.0, 1.0), y=(-reach, reach), axis=ends, note="% of the light"
            ),
        ],
        title="Tone curve",
        subtitle=f"{len(points)} samples of {len(found.samples.items)} {found.samples.series}; "
        f"off {found.nearest_words} by {100 * found.deviation:.2g} %, off a line by "
        f"{100 * found.nonlinearity:.2g} %",
        columns=3,
    )  # fmt: skip
