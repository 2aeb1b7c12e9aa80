"""Photographs and lights that no job can come of are refused before any tile, and nothing is left.

Faults 6 and 9 of ``docs/faults.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

import impasto
from failing_steps import OPTIONS, stack
from impasto.colour import icc_profile
from impasto.io import write_lights

CODES = [np.rint(60000.0 * photograph[0]).astype(np.uint16) for photograph in stack().samples]
SCENE = impasto.Scene(lights=[impasto.DistantLight((0, 0, 1))])
LIGHTS = stack().rig.directions.tolist()


def photographs(folder: Path) -> Path:
    for number, codes in enumerate(CODES):
        tifffile.imwrite(folder / f"{number}.tif", codes)
    write_lights(folder / "d.lp", stack().rig.directions, [f"{n}.tif" for n in range(5)])
    return folder / "d.lp"


def left(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if "zarr" in path.name]


def rgb(path: Path) -> None:
    tifffile.imwrite(path, np.stack([CODES[3]] * 3, -1), photometric="rgb")


ODD: dict[str, tuple[Callable[[Path], Any], str]] = {
    "a column less": (lambda p: tifffile.imwrite(p, CODES[3][:, :-1]), "differ in size"),
    "turned": (lambda p: tifffile.imwrite(p, CODES[3].T), "differ in size"),
    "8 bits": (lambda p: tifffile.imwrite(p, (CODES[3] >> 8).astype(np.uint8)), "sample type"),
    "floats": (lambda p: tifffile.imwrite(p, np.float32(CODES[3])), "sample type"),
    "three bands": (rgb, "number of bands"),
    "white is zero": (
        lambda p: tifffile.imwrite(p, CODES[3], photometric="miniswhite"),
        "white-is-zero",
    ),
    "empty": (lambda p: p.write_bytes(b""), "is empty"),
}


@pytest.mark.parametrize(("odd", "number"), [*((odd, 3) for odd in ODD), ("turned", 0)])
def test_one_photograph_of_another_kind_ends_a_job_before_it_begins(
    odd: str, number: int, tmp_path: Path
) -> None:
    write, words = ODD[odd]
    path = photographs(tmp_path)
    write(tmp_path / f"{number}.tif")
    with pytest.raises(impasto.ImpastoError, match=words) as caught:
        impasto.run(path, tmp_path / "a.zarr", **OPTIONS)
    assert f"{number}.tif" in str(caught.value)
    assert left(tmp_path) == []


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({"extratags": [(274, 3, 1, 6, True)]}, "orientation"),
        (
            {
                "iccprofile": icc_profile(
                    impasto.Scene(lights=[impasto.DistantLight((0, 0, 1))]).display
                )
            },
            "tone curve",
        ),
    ],
)
def test_one_photograph_that_says_else_of_itself_is_told(
    options: dict[str, Any], kind: str, tmp_path: Path
) -> None:
    """Its samples may be those of the others: people have to look."""
    path = photographs(tmp_path)
    tifffile.imwrite(tmp_path / "3.tif", CODES[3], **options)
    out = impasto.run(path, tmp_path / "a.zarr", **OPTIONS)
    (told,) = (text for _, text in impasto.jobs.status(out).notes if "3.tif" in text)
    assert kind in told
    # Neither is applied.
    samples = impasto.read_stack(path).samples
    assert samples[3, 0].tobytes() == CODES[3].tobytes()


ARC = [[np.cos(turn), 0.5 * np.sin(turn), np.sin(turn)] for turn in np.linspace(0.3, 2.8, 5)]
"""In one plane."""
REFUSED: dict[str, tuple[list[Any], str]] = {
    "none": ([], "holds no lights"),
    "one": (LIGHTS[:1], "at least three lights, found 1"),
    "two": (LIGHTS[:2], "at least three lights, found 2"),
    "one five times": ([LIGHTS[0]] * 5, "lie in one plane"),
    "two repeated": ([*LIGHTS[:2], *LIGHTS[:2], LIGHTS[0]], "lie in one plane"),
    "in one plane": (ARC, "lie in one plane"),
    "nearly one": ([[1e-6 * n, 1e-7 * n * n, 1.0] for n in range(5)], "lie in one plane"),
    "behind": ([[x, y, -z] for x, y, z in LIGHTS], "lie behind the painting"),
    "no direction": ([*LIGHTS[:4], [0, 0, 0]], r"line 6 \(4\.tif\).* has no length"),
    "a subnormal direction": ([*LIGHTS[:4], [1e-300, 0, 1e-300]], "has no length"),
    "too long": ([*LIGHTS[:4], [1e300, 0, 1e300]], "is too long"),
    "no number": ([*LIGHTS[:4], ["nan", 0, 1]], "line 6: expected FILE X Y Z"),
}


@pytest.mark.parametrize("lights", REFUSED)
def test_lights_that_determine_no_normal_end_a_job_before_it_begins(
    lights: str, tmp_path: Path
) -> None:
    rows, words = REFUSED[lights]
    path = photographs(tmp_path)
    lines = [f"{n}.tif {x} {y} {z}\n" for n, (x, y, z) in enumerate(rows)]
    path.write_text(f"{len(rows)}\n{''.join(lines)}")
    with pytest.raises(impasto.ImpastoError, match=words):
        impasto.run(path, tmp_path / "a.zarr", **OPTIONS)
    assert left(tmp_path) == []
    if lights == "two":  # with others the same call begins a job of this name
        photographs(tmp_path)
        impasto.run(path, tmp_path / "a.zarr", **OPTIONS)
        assert left(tmp_path) == ["a.zarr"]


def test_a_black_photograph_of_a_light_from_behind_counts_for_nothing() -> None:
    """The default method takes its samples for shadow; least squares would take them for light."""
    rng = np.random.default_rng(2)
    normal = np.concatenate([rng.uniform(-0.3, 0.3, (2, 24, 26)), np.ones((1, 24, 26))])
    normal /= np.linalg.norm(normal, axis=0)
    lights = np.array([*LIGHTS, [0.46, 0.46, -0.76]])
    samples = 0.6 * np.maximum(np.tensordot(lights, normal, 1), 0.0)[:, None].astype(np.float32)
    assert (samples[-1] == 0.0).all()
    found = impasto.fit_normals(impasto.Stack(samples, lights=lights))
    assert (found.status < 16).all()
    # The iteration ends 5e-5 from the truth; least squares, which believes the samples, 0.6.
    np.testing.assert_allclose(found.normal, normal, atol=1e-3)
