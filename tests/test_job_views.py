"""Jobs and ingest of hundreds of photographs, each from a view of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate
from impasto.io import write_lights, write_tiff16
from job_photographs import same

resource = pytest.importorskip("resource", reason="jobs need POSIX")

LAFORTUNE: dict[str, Any] = {"model": "lafortune", "lobes": 1}
HANDLES = 100
"""Files that may be opened at a time beside those that are: fewer than there are photographs."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every fifth photograph of the rig, 154, of a painting of 40 x 48 pixels."""
    place = tmp_path_factory.mktemp("views")
    rig = simulate.rig("snel-lafortune")
    painting = simulate.painting(0, (40, 48), varnish="patches")
    some = rig.take(np.arange(0, len(rig), 5))
    taken = simulate.capture(painting, some, "rgb", model="lafortune").stack
    names = [f"view{number:03}.tif" for number in range(len(some))]
    for number, name in enumerate(names):
        codes = np.clip(np.rint(40000.0 * taken.linear(number)), 0, 65535)
        write_tiff16(place / name, codes.astype(np.uint16))
    write_lights(place / "views.csv", some, names)
    return place


@pytest.mark.slow
@pytest.mark.parametrize("source", ["files", "store"])
def test_hundreds_of_views_are_fitted_as_sixteen_lights_are(
    source: str, folder: Path, tmp_path: Path
) -> None:
    path = folder / "views.csv"
    stack = impasto.read_stack(path)
    assert stack.shape[0] == 154
    assert stack.rig.views is not None
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    opened = max(int(handle.name) for handle in Path("/proc/self/fd").iterdir())
    resource.setrlimit(resource.RLIMIT_NOFILE, (opened + HANDLES, hard))
    try:
        if source == "store":
            path = impasto.ingest(path, tmp_path / "views.stack.zarr", tile=64)
        # No more than a window of all photographs fits.
        out = impasto.run(path, tmp_path / "fit.zarr", memory="8MB", tile=32, **LAFORTUNE)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    same(impasto.load_sbrdf(out), impasto.fit_sbrdf(stack, **LAFORTUNE))
    assert impasto.jobs.verify(out) == ()
