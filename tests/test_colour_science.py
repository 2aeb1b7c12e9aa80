"""Colour-science without its optional packages, as the command line imports it: same numbers."""

from __future__ import annotations

import json
import subprocess
import sys

NUMBERS = """
import numpy as np
from impasto import training
from impasto.calibrate.chart import chart_reflectances
from impasto.colour import difference, illuminants, observers, primaries
from impasto.simulate import cameras

def numbers():
    grid = np.arange(400.0, 701.0, 5.0)
    labs = np.array([[50.0, 50.0], [2.7, 0.0], [-79.8, -82.7]])
    found = [difference.delta_e(labs[:, :1], labs[:, 1:]), chart_reflectances()]
    found += [difference.lab_from_xyz(np.array([[0.3], [0.4], [0.5]]))]
    for name in ("D65", "A", "FL2", "3000K", "6500K"):
        found += [illuminants.spectrum(name, grid), observers.white_point(name)]
    found += [primaries.primary_transmittances(grid), cameras.camera("rgb").sensitivities]
    found += [training.ces99().reflectance, training.ampas190().reflectance]
    return [one.hex() for part in found for one in np.ravel(np.asarray(part, float)).tolist()]
"""


def test_the_command_line_has_the_same_numbers() -> None:
    """And what it did not import can be imported afterwards."""
    code = NUMBERS + (
        "import json, sys\n"
        "from impasto.colour._science import OPTIONAL, alone\n"
        "alone()\n"
        "found = numbers()\n"
        "imported = [name for name in OPTIONAL if name in sys.modules]\n"
        "import matplotlib, scipy\n"
        "print(json.dumps([found, imported]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    found, imported = json.loads(done.stdout)
    assert imported == []
    space: dict[str, object] = {}
    exec(NUMBERS, space)  # colour-science with all that is installed
    whole = space["numbers"]
    assert callable(whole)
    expected = whole()
    assert len(expected) > 10_000
    assert found == expected
