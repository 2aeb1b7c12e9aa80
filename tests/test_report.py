"""report.json: complete, sorted, whole."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from impasto import ArgumentError, Status, report


def test_inputs_are_hashed(tmp_path: Path) -> None:
    file = tmp_path / "a b.txt"
    file.write_bytes(b"abc")
    entry = report.file_entry(file)
    # FIPS 180-4, appendix B.1: the digest of "abc".
    assert entry["sha256"] == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert entry["bytes"] == 3


def test_statuses_are_counted_by_name() -> None:
    status = np.array([[0, 0, Status.MASKED], [Status.DARK, 0, 0]], np.uint8)
    assert report.status_counts(status) == {"fitted": 4, "dark": 1, "masked": 1}


def test_a_report_is_sorted_and_names_its_versions(tmp_path: Path) -> None:
    timings = report.Timings()
    with timings.stage("normals"):
        pass
    content = report.report(
        "fit",
        options={"threads": None, "out": tmp_path, "size": (3, 4)},
        results={"beta": np.float32(0.5), "gamma": np.nan, "counts": np.arange(2)},
        timings=timings,
    )
    path = tmp_path / "report.json"
    report.write_report(path, content)
    text = path.read_text(encoding="utf-8")
    again = json.loads(text)
    assert list(again) == sorted(again)
    assert again["results"] == {"beta": 0.5, "gamma": None, "counts": [0, 1]}
    assert {"impasto", "numpy", "python", "simd"} <= set(again["versions"])
    assert again["timings_s"]["normals"] >= 0


def test_a_failed_write_leaves_the_old_report(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    path.write_text("old")
    with pytest.raises(ArgumentError, match="object"):
        report.write_report(path, {"x": object()})
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]


def test_sha256sum_agrees(tmp_path: Path) -> None:
    file = tmp_path / "f.bin"
    file.write_bytes(np.random.default_rng(0).bytes(100_001))
    try:
        tool = subprocess.run(["sha256sum", str(file)], capture_output=True, text=True, check=True)
    except FileNotFoundError:
        pytest.skip("no sha256sum here")
    assert report.file_entry(file)["sha256"] == tool.stdout.split()[0]


def test_a_file_whose_disk_fails_is_named() -> None:
    memory = Path("/proc/self/mem")  # nothing lies at its first address
    if not memory.exists():
        pytest.skip("only Linux has a file that cannot be read")
    with pytest.raises(OSError, match="Input/output error: '/proc/self/mem'"):
        report.file_entry(memory)


def test_what_was_made_is_hashed_by_its_name_in_the_folder(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "a.exr").write_bytes(b"abc")
    content = report.report("fit", folder=tmp_path, notes=[ValueError("a line was repaired")])
    assert content["outputs"] == [report.file_entry(tmp_path / "maps" / "a.exr", tmp_path)]
    assert content["outputs"][0]["file"] == "maps/a.exr"
    assert content["notes"] == ["a line was repaired"]
