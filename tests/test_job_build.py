"""A job is of one build: its version, and a digest of its code."""

from __future__ import annotations

from pathlib import Path

import pytest

import impasto
from impasto import ResumeMismatchError, _core
from impasto._internal.build import build_name
from job_photographs import interrupted
from killed_jobs import OPTIONS, stack

pytest.importorskip("fcntl", reason="jobs need POSIX")


def test_a_job_does_not_go_on_with_another_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "painting.zarr"
    interrupted(out, 2)
    # As after an update between two releases: the same version, other code.
    monkeypatch.setattr("impasto.jobs.job.build_name", lambda: f"{impasto.__version__}+0")
    with pytest.raises(
        ResumeMismatchError, match=rf"version: the job has '{impasto.__version__}\+"
    ):
        impasto.run(stack(), out, **OPTIONS)


def test_builds_are_told_apart_by_their_code(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [build_name.__wrapped__()]
    info = _core.build_info()
    monkeypatch.setattr(_core, "build_info", lambda: info | {"sources": "other"})
    names.append(build_name.__wrapped__())
    read = Path.read_bytes
    monkeypatch.setattr(
        Path, "read_bytes", lambda self: read(self) + b"# more" * (self.name == "stack.py")
    )
    names.append(build_name.__wrapped__())
    assert len(set(names)) == 3
    assert all(name.startswith(f"{impasto.__version__}+") for name in names)
