"""Names in files that lead elsewhere: nothing outside of a store is read for it, or written.

Fault 17 of ``docs/faults.md``. The checksums of these files are right: somebody made them so.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from failing_steps import OPTIONS, stack
from impasto import jobs
from impasto.io import json_lines
from impasto.io.results import zarr_store
from interrupted_jobs import interrupting
from killed_jobs import tree

pytest.importorskip("fcntl", reason="jobs need POSIX")

NAMES = ("../precious/a", "/etc/passwd", "x/../../precious", "..", "status\0", "C:\\x", "", "a/b")


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result, a store of photographs, and a job of which three tiles are done."""
    folder = tmp_path_factory.mktemp("stores")
    impasto.fit_sbrdf(stack(), pooling="painting", check=False).save(folder / "result.zarr")
    jobs.ingest(stack(), folder / "stack.zarr", tile=16)
    with interrupting(3) as stop:
        impasto.run(stack(), folder / "job.zarr", progress=stop, **OPTIONS)
    return folder


@pytest.fixture
def copy(stores: Path, tmp_path: Path) -> Path:
    shutil.copytree(stores, tmp_path / "stores")
    (tmp_path / "stores" / "precious").mkdir()
    (tmp_path / "stores" / "precious" / "a").write_text("1")
    return tmp_path / "stores"


def renamed(store: Path, new: str, *, more: bool) -> None:
    """An array of a store by another name, or one more, with the right checksum of the list."""
    listed = store / "zarr.json"
    content = json.loads(listed.read_text())
    own = content["attributes"]["impasto"]
    old = next(name for name in ("status", "samples") if name in own["arrays"])
    own["arrays"][new] = own["arrays"][old] if more else own["arrays"].pop(old)
    own.pop("crc32")
    own["crc32"] = zarr_store._checksum(own)
    listed.write_text(json.dumps(content))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("store", "read"),
    [
        ("result.zarr", impasto.load_sbrdf),
        ("result.zarr", impasto.open_sbrdf),
        ("stack.zarr", impasto.read_stack),
    ],
)
def test_an_array_of_a_store_lies_in_it(
    store: str, read: Callable[[Path], Any], name: str, copy: Path
) -> None:
    before = (copy / store / "zarr.json").read_bytes()
    for more in (False, True):
        (copy / store / "zarr.json").write_bytes(before)
        renamed(copy / store, name, more=more)
        with pytest.raises(impasto.CorruptInputError, match=r"zarr\.json: is damaged \(an array"):
            read(copy / store)


def refilled(notes: Path, name: str) -> None:
    """The numbers of a job with one more of a name, and a journal that knows this file."""
    numbers = notes / "numbers.npz"
    with np.load(numbers) as file:
        arrays = dict(file)
    arrays[name] = arrays["map:status"] if name.startswith("map:") else np.ones(3)
    made = BytesIO()
    np.savez(made, **arrays)
    numbers.write_bytes(made.getvalue())
    lines = (notes / "journal.jsonl").read_bytes().splitlines(keepends=True)
    crc = json_lines.crc_of(made.getvalue())
    changed = [
        json_lines.sealed_line({"numbers": crc}) if b'"numbers"' in line else line for line in lines
    ]
    assert changed != lines
    (notes / "journal.jsonl").write_bytes(b"".join(changed))


@pytest.mark.parametrize(
    "name", ["map:../precious/b", "../precious/b", "map:/tmp/b", "map:a/../../precious/b"]
)
def test_a_number_of_a_job_lies_in_it(name: str, copy: Path) -> None:
    before = tree(copy / "precious")
    refilled(copy / "job.zarr.partial" / "job", name)
    with pytest.raises(impasto.CorruptInputError, match="which no job writes"):
        jobs.resume(copy / "job.zarr", source=stack())
    assert tree(copy / "precious") == before


def test_a_file_of_a_journal_lies_in_the_store(copy: Path) -> None:
    file = copy / "job.zarr.partial" / "job" / "journal.jsonl"
    content = {"tile": [0, 1], "estimated": 1, "shards": {"../precious/a": "0"}}
    file.write_bytes(file.read_bytes() + json_lines.sealed_line(content))
    (found,) = jobs.verify(copy / "job.zarr")
    assert "journal.jsonl: is damaged in line" in str(found)


@pytest.mark.parametrize("inner", ["normal", "normal/c/0", "job", "job/lock", "job/journal.jsonl"])
def test_a_job_writes_through_no_link(inner: str, copy: Path) -> None:
    partial = copy / "job.zarr.partial"
    path = partial / inner
    elsewhere = copy / "precious" / "moved"
    path.rename(elsewhere)
    path.symlink_to(elsewhere)
    before = tree(copy / "precious")
    with pytest.raises(impasto.ArgumentError, match="is a link; a job writes only into its own"):
        jobs.resume(copy / "job.zarr", source=stack())
    assert tree(copy / "precious") == before
    if inner.startswith("normal"):
        assert any(one.file == str(path) for one in jobs.verify(copy / "job.zarr"))


def test_saving_over_a_store_leaves_what_its_links_lead_to(copy: Path) -> None:
    before = tree(copy / "precious")
    shutil.rmtree(copy / "result.zarr" / "normal")
    (copy / "result.zarr" / "normal").symlink_to(copy / "precious")
    impasto.fit_sbrdf(stack(), pooling="painting", check=False).save(copy / "result.zarr")
    assert tree(copy / "precious") == before
    assert not (copy / "result.zarr" / "normal").is_symlink()


def test_a_crate_names_its_store_as_an_address(copy: Path, tmp_path: Path) -> None:
    name, coded = "a b#ü%2e.zarr", "a%20b%23%C3%BC%252e.zarr/"
    jobs.resume(copy / "job.zarr", source=stack())
    (copy / "job.zarr").rename(copy / name)
    crate = jobs.export_ro_crate(copy / name, tmp_path / "crate")
    content = json.loads((crate / "ro-crate-metadata.json").read_text())
    assert coded in {entity["@id"] for entity in content["@graph"]}
