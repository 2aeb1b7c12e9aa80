"""What the doctor says of a result: each fault is put into the maps of a sound one."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate
from impasto.cli import main
from impasto.doctor import examine_result

SIDE, TILE = 160, 64


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    return simulate.default_capture(size=(SIDE, SIDE)).stack


@pytest.fixture(scope="module")
def store(stack: impasto.Stack, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("store") / "painting.zarr"
    return impasto.run(stack, out, tile=TILE, pooling="none", refine=False)


@pytest.fixture(scope="module")
def whole(store: Path) -> Any:
    return impasto.load_sbrdf(store)


def test_a_sound_result_has_no_fault_in_memory_and_in_a_store(store: Path, whole: Any) -> None:
    stored, loaded = examine_result(impasto.open_sbrdf(store)), examine_result(whole)
    assert stored.verdict == loaded.verdict == "no fault found"
    # 160 = 64 + 64 + 32: two lines along each axis, each of three borders.
    assert stored["seams"].numbers["borders"] == 12
    for finding in loaded.findings:
        assert stored[finding.code] == finding
    assert stored.title.startswith(f"a fit of {len(whole.rig)} photographs, ")


def part(maps: np.ndarray, value: Any) -> np.ndarray:
    """The maps with another value in two percent of the pixels."""
    changed = maps.copy()
    changed[..., :16, :32] = value
    return changed


FAULTS: dict[str, tuple[Callable[[Any], dict[str, Any]], str]] = {
    "gaps": (lambda r: {"diffuse": part(r.diffuse, np.nan)}, "error"),
    "gaps, of a guess": (lambda r: {"status": part(r.status, impasto.Status.SATURATED)}, "error"),
    "gaps, of infinity": (lambda r: {"diffuse": part(r.diffuse, np.inf)}, "error"),
    "unit-normals": (lambda r: {"normal": part(r.normal, 0.7)}, "error"),
    "facing": (lambda r: {"normal": part(r.normal, -r.normal[..., :16, :32])}, "warning"),
    "colours": (lambda r: {"diffuse": part(r.diffuse, 1.5)}, "warning"),
    "colours, negative": (lambda r: {"diffuse": part(r.diffuse, -0.1)}, "warning"),
    "residuals": (lambda r: {"residual": r.diffuse.mean(axis=0)}, "warning"),
    "statuses": (lambda r: {"status": part(r.status, 77)}, "error"),
    "statuses, not computed": (
        lambda r: {
            "status": part(r.status, impasto.Status.NOT_COMPUTED),
            "normal": part(r.normal, np.nan),
            "diffuse": part(r.diffuse, np.nan),
        },
        "warning",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named(fault: str, whole: Any) -> None:
    change, severity = FAULTS[fault]
    found = examine_result(replace(whole, **change(whole)))
    finding = found[fault.partition(",")[0]]
    assert finding.severity == severity
    assert finding.advice


SIZE, HALF = 1024, 512


class Painted:
    """A store of four tiles, as the doctor reads it: broad colours and slopes, and noise."""

    tile, shape, bands = HALF, (SIZE, SIZE), ("red", "green", "blue")
    rig = simulate.default_capture(size=(8, 8)).stack.rig

    def __init__(self) -> None:
        rng = np.random.default_rng(3)
        y, x = np.mgrid[:SIZE, :SIZE] / 40.0
        waves = np.stack([np.sin(x + 0.3 * y), np.cos(y - 0.2 * x), np.sin(0.5 * (x + y))])
        normal = 0.1 * waves + rng.normal(0.0, 0.01, waves.shape)
        normal[2] = 1.0
        self.maps = {
            "normal": (normal / np.linalg.norm(normal, axis=0)).astype(np.float32),
            "diffuse": (0.4 + 0.05 * waves + rng.normal(0.0, 0.01, waves.shape)).astype(np.float32),
            "residual": np.full((SIZE, SIZE), 0.01, np.float32),
            "status": np.zeros((SIZE, SIZE), np.uint8),
        }

    def map(self, name: str, rows: slice, columns: slice) -> np.ndarray:
        return self.maps[name][..., rows, columns]


OF_THE_FIRST_TILE = {"row 512 from 0", "column 512 from 0"}


def test_a_tile_of_another_fit_shows_at_its_borders() -> None:
    """Noise of a hundredth hides neither five percent of light nor two hundredths of a slope.

    Means of 16 pixels have a quarter of the noise: steps of six of their deviations and more, which
    are the largest of three in nearly all places; five standard errors of 128 places are 0.4.
    """
    painted = Painted()
    assert examine_result(painted)["seams"].severity == "ok"
    painted.maps["diffuse"][:, :HALF, :HALF] *= 1.05
    found = examine_result(painted)["seams"]
    assert (found.severity, set(found.numbers["seams"])) == ("error", OF_THE_FIRST_TILE)
    painted = Painted()
    tilted = painted.maps["normal"][:, :HALF, :HALF]
    tilted[0] += 0.02 * tilted[2]
    tilted /= np.linalg.norm(tilted, axis=0)
    found = examine_result(painted)["seams"]
    assert set(found.numbers["seams"]) <= OF_THE_FIRST_TILE
    assert found.severity == "error"


@pytest.mark.parametrize("beyond", [1, 3, 7, 8, 20])
def test_a_painting_that_ends_beside_a_border_is_examined(beyond: int) -> None:
    painted = Painted()
    side = HALF + beyond
    painted.maps = {name: maps[..., :side, :side] for name, maps in painted.maps.items()}
    painted.shape = side, side
    assert examine_result(painted).verdict == "no fault found"


def test_of_jpeg_blocks_no_seam_is_made() -> None:
    """Every border of tiles is one of blocks, which have small steps of their own."""
    painted = Painted()
    steps = np.random.default_rng(4).normal(0.0, 0.02, (3, SIZE // 8, SIZE // 8))
    painted.maps["diffuse"] += np.kron(steps, np.ones((8, 8))).astype(np.float32)
    assert examine_result(painted)["seams"].severity == "ok"


def test_results_on_the_command_line(
    store: Path, stack: impasto.Stack, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["doctor", str(store)]) == 0
    assert "no fault found" in capsys.readouterr().out
    damaged = tmp_path / "damaged.zarr"
    shutil.copytree(store, damaged)
    # A tile of 32 x 32 pixels has missing numbers where this one needs some.
    shutil.copy(damaged / "normal/c/0/2/2", damaged / "normal/c/0/0/0")
    assert main(["doctor", str(damaged), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["worst"] == "error"
    assert main(["doctor", str(store), "--write", str(tmp_path / "new.lp")]) == 1
    assert "is a result, which has no light file" in capsys.readouterr().err
    shard = bytearray((damaged / "normal/c/0/0/0").read_bytes())
    shard[100] ^= 1
    (damaged / "normal/c/0/0/0").write_bytes(shard)
    assert main(["doctor", str(damaged)]) == 3
    assert "damaged" in capsys.readouterr().err
    # A single file of maps is a result; one of samples is not.
    file = tmp_path / "sbrdf.npz"
    impasto.fit_sbrdf(stack, pooling="pixel", refine=False, threads=1).save(file)
    assert main(["doctor", str(file), "--json"]) == 0
    codes = {finding["code"] for finding in json.loads(capsys.readouterr().out)["findings"]}
    assert "statuses" in codes
    # A store of photographs is examined as such.
    photographs = impasto.jobs.ingest(stack, tmp_path / "photographs.zarr")
    main(["doctor", str(photographs), "--json"])
    codes = {finding["code"] for finding in json.loads(capsys.readouterr().out)["findings"]}
    assert "conditioning" in codes


def test_what_is_no_result_is_refused() -> None:
    with pytest.raises(impasto.ArgumentError, match="expected a result of fit_sbrdf"):
        examine_result(np.zeros(3))  # type: ignore[arg-type]
