"""The stub of the extension says what the extension holds."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from impasto import Status, _core

ROOT = Path(__file__).resolve().parents[1]


def test_the_stub_matches_the_binary() -> None:
    tests = ROOT / "tests"
    command = [sys.executable, "-m", "mypy.stubtest", "impasto._core", "--concise"]
    command += ["--allowlist", str(tests / "stubtest-allow.txt")]
    # With the whole package read and checked a second time, this takes three times as long.
    command += ["--mypy-config-file", str(tests / "stubtest.ini")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_python_and_rust_agree_on_every_status() -> None:
    def words(name: str) -> str:
        return "".join("_" + c if c.isupper() else c.upper() for c in name).strip("_")

    assert {words(name): code for name, code in _core.STATUS} == {s.name: s.value for s in Status}
