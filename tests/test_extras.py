"""Where an extra of the package is not installed its name is told, before any work is done."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

import impasto
import processes
from impasto._internal.extras import need
from impasto.cli import main
from impasto.pictures.plots import lobe_plot


def test_an_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    need("sys", "none", "everything")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    words = r"a figure needs matplotlib, which is not installed: pip install 'impasto\[plot\]'"
    with pytest.raises(impasto.MissingExtraError, match=words) as refusal:
        need("matplotlib", "plot", "a figure")
    assert isinstance(refusal.value, ImportError)


def test_a_plot_without_matplotlib_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    surface: Any = None
    with pytest.raises(impasto.MissingExtraError, match="lobe_plot needs matplotlib"):
        lobe_plot(surface, 0, 0)


def test_a_study_without_matplotlib_ends_before_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    out = tmp_path / "study"
    assert main(["study", "nowhere.lp", "--out", str(out)]) == 1
    captured = capsys.readouterr()
    assert captured.err.startswith("impasto: the figure of a study")
    assert "--no-figure" in captured.err
    assert "pip install 'impasto[plot]'" in " ".join(captured.err.split())
    assert captured.out == ""
    assert not out.exists()


WITHOUT = """
import json, sys, tempfile
from pathlib import Path

OPTIONAL = ("matplotlib", "PIL", "imageio_ffmpeg", "zarr", "xarray", "h5netcdf", "h5py", "dask",
            "distributed", "scipy", "rawpy", "pandas", "gphoto2", "serial", "anywidget")
for name in OPTIONAL:
    sys.modules[name] = None

import numpy as np
import impasto
import processes
from impasto import jobs
from impasto.cli import main

lights = [(0.5, 0, 0.9), (0, 0.5, 0.9), (-0.5, 0, 0.9), (0, -0.5, 0.9), (0, 0, 1)]
samples = np.random.default_rng(1).uniform(0.2, 0.9, (5, 3, 24, 26)).astype(np.float32)
stack = impasto.Stack(samples, lights=lights)
result = impasto.fit_sbrdf(stack, pooling="painting", check=False)
told = {}

def need(name, call):
    try:
        call()
    except impasto.MissingExtraError as error:
        told[name] = str(error)
    else:
        told[name] = "nothing"

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    result.save(folder / "a.npz")
    impasto.load_sbrdf(folder / "a.npz")
    impasto.io.write_stack(folder / "stack.npz", stack)
    words = [str(folder / "stack.npz"), "--out", str(folder / "out"), "--pooling", "painting"]
    told["fit"] = main(["fit", *words])
    told["render"] = main(
        ["render", str(folder / "out"), "--light", "45,45", "--out", str(folder / "a.png")]
    )
    told["info"] = main(["info"])
    need("save", lambda: result.save(folder / "a.zarr"))
    need("run", lambda: impasto.run(stack, folder / "b.zarr"))
    need("ingest", lambda: jobs.ingest(stack, folder / "c.zarr"))
    need("to_xarray", result.to_xarray)
    need("lobe_plot", lambda: result.lobe_plot(3, 4))
    need("view", result.view)
    told["left"] = sorted(path.name for path in folder.iterdir())
sys.stdout.write("\\n" + json.dumps(told))
"""


@pytest.mark.slow
def test_without_any_extra_all_else_works() -> None:
    """Fault 22 of ``docs/faults.md``: no optional library can be imported."""
    told = json.loads(processes.run(WITHOUT).splitlines()[-1])
    assert [told[name] for name in ("fit", "render", "info")] == [0, 0, 0]
    for name, extra in {
        "save": "scale", "run": "scale", "ingest": "scale", "to_xarray": "scale",
        "lobe_plot": "plot", "view": "viewer",
    }.items():  # fmt: skip
        assert f"pip install 'impasto[{extra}]'" in told[name], name
    assert told["left"] == ["a.npz", "a.png", "out", "stack.npz"]
