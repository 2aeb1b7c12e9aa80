"""Jobs as RO-Crates: what was made of what is named, and the store in a crate is whole."""

from __future__ import annotations

import datetime
import hashlib
import json
import os
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import pytest

import impasto
from impasto import ArgumentError, jobs
from impasto._internal.build import build_name
from impasto.cli import main
from impasto.io import write_lights, write_tiff16
from job_photographs import photographs
from killed_jobs import stack, tree

pytest.importorskip("fcntl", reason="jobs need POSIX")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job of files, one of whose names has a blank."""
    folder = tmp_path_factory.mktemp("crate job")
    taken = stack((40, 50))
    names = [f"light {index}.tif" for index in range(len(taken.rig))]
    for name, codes in zip(names, taken.samples, strict=True):
        write_tiff16(folder / name, codes)
    write_lights(folder / "dirs.lp", taken.rig, names)
    reading = {"encoding": "linear"}
    return impasto.run(folder / "dirs.lp", folder / "a.zarr", pooling="none", reading=reading)


def entities(crate: Path) -> dict[str, dict[str, Any]]:
    content = json.loads((crate / "ro-crate-metadata.json").read_text("utf-8"))
    assert content["@context"][0] == "https://w3id.org/ro/crate/1.1/context"
    graph = content["@graph"]
    found = {one["@id"]: one for one in graph}
    assert len(found) == len(graph)
    return found


def references(value: Any) -> list[str]:
    if isinstance(value, dict):
        return [value["@id"]] if set(value) == {"@id"} else references(list(value.values()))
    return [one for each in value for one in references(each)] if isinstance(value, list) else []


def test_a_crate_says_what_was_made_of_what(job: Path, tmp_path: Path) -> None:
    day = datetime.date(2026, 1, 2)
    address = "https://creativecommons.org/licenses/by/4.0/"
    crate = jobs.export_ro_crate(
        job, tmp_path / "crate", name="Icon", license=address, published=day
    )
    found = entities(crate)
    # Nothing is named that is not described, but what RO-Crate and schema.org describe.
    own = {one for entity in found.values() for one in references(list(entity.values()))}
    outside = {"https://w3id.org/ro/crate/1.1", "http://schema.org/CompletedActionStatus"}
    assert own - outside <= found.keys()
    root = found["./"]
    assert (root["name"], root["datePublished"]) == ("Icon", "2026-01-02")
    assert root["license"] == {"@id": address}
    action = found["#fit"]
    assert action["@type"] == "CreateAction"
    assert found[action["instrument"]["@id"]]["softwareVersion"] == build_name()
    assert action["result"] == {"@id": "a.zarr/"}
    files = [found[one["@id"]] for one in action["object"] if one["@id"].startswith("file:")]
    assert len(files) == 13
    for one in files:
        data = Path(unquote(urlparse(one["@id"]).path)).read_bytes()
        assert one["sha256"] == hashlib.sha256(data).hexdigest()
        assert one["contentSize"] == str(len(data))
    assert found["#pooling"]["value"] == "none"
    # The store in the crate is the store.
    assert tree(crate / "a.zarr") == tree(job)
    assert jobs.verify(crate / "a.zarr") == ()
    again = jobs.export_ro_crate(
        job, tmp_path / "again", name="Icon", license=address, published=day
    )
    assert tree(again) == tree(crate)


def test_a_crate_warns_of_photographs_that_are_gone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = photographs(tmp_path)
    out = impasto.run(path, tmp_path / "a.zarr", pooling="none", tile=64)
    (tmp_path / "light3.tif").unlink()
    with pytest.warns(impasto.ImpastoWarning, match=r"light3\.tif: named in the crate as an input"):
        jobs.export_ro_crate(out, tmp_path / "one")
    assert main(["job", "export", str(out), "--ro-crate", str(tmp_path / "two")]) == 0
    assert "light3.tif: named in the crate" in " ".join(capsys.readouterr().err.split())


def test_files_are_copied_where_they_cannot_be_linked(
    job: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(*_: Any) -> None:
        raise OSError(18, "Invalid cross-device link")

    linked = jobs.export_ro_crate(job, tmp_path / "linked")
    monkeypatch.setattr(os, "link", refuses)
    copied = jobs.export_ro_crate(job, tmp_path / "copied")
    assert tree(copied) == tree(linked)
    inner = "a.zarr/normal/c/0/0/0"
    assert (linked / inner).samefile(job / inner.removeprefix("a.zarr/"))
    assert not (copied / inner).samefile(job / inner.removeprefix("a.zarr/"))


def test_an_export_that_fails_leaves_nothing(
    job: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("impasto.jobs.ro_crate.atomic_bytes", full)
    with pytest.raises(OSError, match="No space"):
        jobs.export_ro_crate(job, tmp_path / "crate")
    assert list(tmp_path.iterdir()) == []


def test_a_stack_in_memory_is_no_file(tmp_path: Path) -> None:
    out = impasto.run(stack((40, 50)), tmp_path / "a.zarr", pooling="none")
    found = entities(jobs.export_ro_crate(out, tmp_path / "crate"))
    assert found["#stack"]["@type"] == "CreativeWork"
    assert found["./"]["hasPart"] == [{"@id": "a.zarr/"}]
    assert {"@id": "#stack"} in found["#fit"]["object"]


def test_what_cannot_be_exported_is_refused(
    job: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["job", "export", str(job), "--ro-crate", str(tmp_path / "crate")]
    assert main(words) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "crate")
    assert main(words) == 1
    assert "already exists" in capsys.readouterr().err
    with pytest.raises(ArgumentError, match="does not exist"):
        jobs.export_ro_crate(job, tmp_path / "none" / "crate")
    (tmp_path / "b.zarr.partial" / "job").mkdir(parents=True)
    (tmp_path / "b.zarr.partial" / "job" / "job.json").write_bytes(
        (job / "job" / "job.json").read_bytes()
    )
    with pytest.raises(ArgumentError, match="is not finished; impasto job resume"):
        jobs.export_ro_crate(tmp_path / "b.zarr", tmp_path / "other")
