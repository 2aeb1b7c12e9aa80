"""Result folders: written completely or not at all, without touching other files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from impasto._internal.damage import DAMAGE
from impasto._internal.umask import umask
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import as_problem_of, sync_folder
from impasto.io.folders import raise_by_name, sync_folders
from impasto.io.temporary import temporary_beside

REPORT = "report.json"
"""The file that marks a result folder; it is written last."""


@contextmanager
def result_folder(out: Path, *, inputs: Iterable[Path] = (), force: bool = False) -> Iterator[Path]:
    """A hidden folder beside ``out`` whose files become those of ``out`` if the block succeeds.

    After an error or Ctrl-C nothing has changed. In an existing folder, files of an earlier result
    are replaced, or removed if the new result has no such file and they are as that wrote them; all
    others stay. Links to folders are not followed. A killed run leaves a hidden folder, which the
    next one of this name removes.

    Parameters
    ----------
    out
        The folder to make.
    inputs
        Files and folders that are read.
    force
        Whether to write into a folder with other files.

    Raises
    ------
    ArgumentError
        ``out`` is a file, or a folder with files but without a report of impasto, or holds one of
        the inputs.
    """
    earlier = _earlier(out, force)
    _refuse_links(out, earlier)
    _spare(out, inputs)
    out.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as held:
        with as_problem_of(out):
            staging = held.enter_context(temporary_beside(out, folder=True))
        try:
            yield staging
            made = sorted(p.relative_to(staging) for p in staging.rglob("*") if p.is_file())
            if out.exists():
                _refuse_links(out, made)
                _move(staging, out, made)
                _remove(out, {name: earlier[name] for name in earlier.keys() - set(made)})
            else:
                staging.chmod(_folder_mode())
                with as_problem_of(out):
                    sync_folders(staging)
                    staging.rename(out)
                    sync_folder(out.parent)
        except OSError as error:
            if error.filename is not None:
                raise_by_name(error, staging, out)
            raise
        finally:
            shutil.rmtree(staging, ignore_errors=True)


def read_report(folder: Path) -> dict[str, Any]:
    """The report of a result folder.

    Raises
    ------
    ArgumentError
        There is no report.
    CorruptInputError
        The file is not a report of impasto.
    """
    path = folder / REPORT
    if not folder.exists():
        raise ArgumentError(
            f"{folder} does not exist: expected the --out folder of impasto fit or demo, or the "
            ".zarr of impasto job run or ingest"
        )
    if not path.is_file():
        raise ArgumentError(f"{folder} has no {REPORT}: it is not a result of impasto fit or demo")
    content = _report(path)
    if content is None:
        raise CorruptInputError(path, "is not a report written by impasto")
    return content


def check_listed(files: Iterable[Path]) -> None:
    """Refuse files beside a report that are not those which it lists.

    A run that is killed while it replaces an earlier result leaves files of two results.

    Raises
    ------
    CorruptInputError
        It names the file.
    """
    from impasto.report import file_entry

    for path in files:
        content = _report(path.with_name(REPORT))
        if content is None:
            continue
        listed = {entry["file"]: entry["sha256"] for entry in content.get("outputs", [])}
        if listed.get(path.name) != file_entry(path)["sha256"]:
            raise CorruptInputError(
                path,
                f"is not the file that {REPORT} beside it lists: a run was ended while it replaced "
                "an earlier result, or somebody changed the file; run impasto fit again, or move "
                f"{path.name} into a folder of its own",
            )


def _earlier(out: Path, force: bool) -> dict[Path, str]:
    """The files of an earlier result in ``out`` with their SHA-256."""
    if not out.exists():
        return {}
    if not out.is_dir():
        raise ArgumentError(f"--out: {out} is a file; give a folder")
    content = _report(out / REPORT)
    if content is not None:
        listed = {Path(entry["file"]): entry["sha256"] for entry in content.get("outputs", [])}
        return {
            name: digest
            for name, digest in listed.items()
            if not name.is_absolute() and ".." not in name.parts
        }
    if any(out.iterdir()) and not force:
        raise ArgumentError(
            f"--out: {out} contains files of other programs; give another folder, or use "
            "--force to write into it"
        )
    return {}


def _refuse_links(out: Path, names: Iterable[Path]) -> None:
    """No file of a result is written or removed through a link to another folder."""
    for folder in {out / parent for name in names for parent in name.parents if parent.parts}:
        if folder.is_symlink():
            raise ArgumentError(
                f"--out: {folder} is a link to another folder, into which no result is written; "
                "remove it, or give another folder"
            )


def _remove(out: Path, names: Mapping[Path, str]) -> None:
    """Remove files of an earlier result, as far as they are as that wrote them."""
    from impasto.report import file_entry

    for name, digest in names.items():
        path = out / name
        if path.is_file() and not path.is_symlink() and file_entry(path)["sha256"] == digest:
            path.unlink()


def _spare(out: Path, inputs: Iterable[Path]) -> None:
    """Refuse to replace inputs: the photographs of an earlier demo are outputs, too."""
    target = out.resolve()
    for path in inputs:
        if path.resolve().is_relative_to(target):
            raise ArgumentError(f"--out: {out} contains the input {path}; give another folder")


def _report(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_bytes())
    except (*DAMAGE, OSError):
        return None
    return content if _is_report(content) else None


def _is_report(content: Any) -> bool:
    """Whether all fields of a report have the types that impasto writes."""
    if not isinstance(content, dict) or not {"schema", "command", "versions"} <= content.keys():
        return False
    results, inputs, outputs = (
        content.get(name, empty)
        for name, empty in (("results", {}), ("inputs", []), ("outputs", []))
    )
    return (
        isinstance(content["command"], str)
        and isinstance(content["versions"], dict)
        and _entries(inputs)
        and _entries(outputs)
        and isinstance(content.get("notes", []), list)
        and _numbers(content.get("timings_s", {}))
        and isinstance(results, dict)
        and _shape(results.get("shape", [1, 1, 1, 1]))
        and _numbers(results.get("status", {}), least=1)
        and isinstance(results.get("truth", {}), dict)
    )


def _entries(value: Any) -> bool:
    """A list of files with their SHA-256."""
    return isinstance(value, list) and all(
        isinstance(entry, dict)
        and all(isinstance(entry.get(name), str) for name in ("file", "sha256"))
        and "\0" not in entry["file"]
        for entry in value
    )


def _numbers(value: Any, least: float = 0) -> bool:
    """A mapping from names to finite numbers."""
    return isinstance(value, dict) and all(
        isinstance(entry, int | float) and least <= entry < 1e15 for entry in value.values()
    )


def _shape(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 4 and all(isinstance(n, int) for n in value)


def _move(staging: Path, out: Path, made: list[Path]) -> None:
    # The report last: until then the folder still has the earlier result.
    for name in made:
        if name != Path(REPORT):
            _replace(staging / name, out / name)
    with as_problem_of(out):
        sync_folders(out)
        if Path(REPORT) in made:
            _replace(staging / REPORT, out / REPORT)
            sync_folder(out)


def _replace(source: Path, target: Path) -> None:
    with as_problem_of(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        source.replace(target)


def _folder_mode() -> int:
    """The mode that ``mkdir`` would set; ``mkdtemp`` makes private folders."""
    return 0o777 & ~umask()
