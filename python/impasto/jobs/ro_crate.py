"""A finished job as an RO-Crate, for archives: what was made of what, by which program and how.

The profile is Process Run Crate 0.5 of RO-Crate 1.1: one ``CreateAction`` whose ``object`` are the
photographs and whose ``result`` is the store.
"""

from __future__ import annotations

import datetime
import json
import mimetypes
import os
import shutil
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.wording import counted
from impasto.errors import ArgumentError, CorruptInputError, ImpastoWarning
from impasto.io.files import atomic_bytes
from impasto.io.folders import new_folder
from impasto.jobs.folder import NOTES, RECORD, check_finished
from impasto.jobs.journal import JOURNAL, Entries
from impasto.jobs.lock import LOCK
from impasto.jobs.lookup import folder_of
from impasto.jobs.meter import Meter
from impasto.jobs.record import JobRecord
from impasto.jobs.verification import changed_files, known_files, others

METADATA = "ro-crate-metadata.json"
CRATE = "https://w3id.org/ro/crate/1.1"
PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
TERMS = "https://w3id.org/ro/terms/workflow-run/context"
SOFTWARE = "#impasto"
"""The program, within the crate."""


def export_ro_crate(
    out: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    name: str | None = None,
    description: str | None = None,
    license: str | None = None,
    published: datetime.date | None = None,
    progress: bool | ProgressCallback = False,
) -> Path:
    """Put a finished job into a new RO-Crate, with its provenance as linked data.

    The crate holds the store, as hard links where the file system has them (no space is taken) and
    as copies elsewhere. Photographs are named with their sizes and SHA-256, not copied.

    Parameters
    ----------
    out
        The ``out`` of :func:`impasto.run`.
    folder
        The crate to make, which does not exist yet.
    name, description
        Of the crate; default: the name of the store, and what it is.
    license
        Under which the result is published: an address, such as
        ``"https://creativecommons.org/licenses/by/4.0/"``. Default: a sentence that none is given.
    published
        The date of the crate; default: today. All else in it is the same whenever it is made.
    progress
        True: a bar on stderr; or a callable ``(done, total)`` in bytes of the store, which is
        compared with its journal first.

    Returns
    -------
    Path
        The crate.

    Raises
    ------
    ArgumentError
        No job of that name, one that is not finished, or a folder that exists.
    CorruptInputError
        A journal that is damaged, or a file of the store that is missing, has changed or does not
        belong to it.
    """
    store, whole = folder_of(out)
    if not whole:
        raise ArgumentError(f"out: {store} is not finished; impasto job resume goes on with it")
    record = JobRecord.read(store / NOTES / RECORD)
    entries = check_finished(store, record.grid)
    crate = Path(folder)
    if crate.exists():
        raise ArgumentError(f"folder: {crate} already exists; give another name")
    if not crate.absolute().parent.is_dir():
        raise ArgumentError(f"folder: the folder {crate.absolute().parent} does not exist")
    if crate.resolve().is_relative_to(store.resolve()):
        raise ArgumentError(f"folder: {crate} lies in the store itself; give another place")
    with reporting(progress, "comparing files", whole=True) as callback:
        own = _checked_files(store, entries, Meter(callback))
    gone = [] if record.source is None else _missing(record)
    if gone:
        more = f" and {len(gone) - 1} more" if gone[1:] else ""
        warnings.warn(
            f"{gone[0]}{more}: named in the crate as an input, but does not exist any more",
            ImpastoWarning,
            stacklevel=2,
        )
    with new_folder(crate) as folder_of_crate:
        _link_all(store, own, folder_of_crate / store.name)
        content = {
            "@context": [f"{CRATE}/context", TERMS],
            "@graph": list(
                _graph(
                    record,
                    store,
                    name or store.name,
                    description,
                    license,
                    published or datetime.date.today(),
                )
            ),
        }
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
        atomic_bytes(folder_of_crate / METADATA, (text + "\n").encode())
    return crate


def _missing(record: JobRecord) -> list[str]:
    """Photographs and other inputs that are not where they were."""
    return [one["file"] for one in record.inputs if not Path(one["file"]).exists()]


def _checked_files(store: Path, entries: Entries, meter: Meter) -> list[str]:
    """The files of the job, by their names in the store.

    Nothing that the journal has is missing or has changed, and nothing else is there: an archive
    gets no damaged tile, and no file that nobody vouches for.
    """
    own = {f"{NOTES}/{JOURNAL}", *(entries.files or {})}
    meter.begin(store / name for name in known_files(entries))
    found = [(finding, "") for finding in changed_files(store, entries.files or {}, meter)]
    for (row, column), entry in entries.tiles.items():
        own |= entry.shards.keys()
        place = f" (the tile in row {row} and column {column})"
        found += [(finding, place) for finding in changed_files(store, entry.shards, meter)]
    if found:
        first, place = found[0]
        more = _others(len(found) - 1, "so is", "so are")
        raise CorruptInputError(
            Path(first.file),
            f"is not whole{place}: {first.problem}{more}; impasto job verify {store} lists all "
            "and says how they are made again",
        )
    # The lock of a process that was killed in its last step is no part of the result.
    foreign = sorted(Path(finding.file) for finding in others(store, {*own, f"{NOTES}/{LOCK}"}))
    if foreign:
        more = _others(len(foreign) - 1, "nor does", "nor do")
        raise CorruptInputError(
            foreign[0],
            f"does not belong to the store{more}: a crate holds what the job has written; move it "
            f"to another folder (impasto job verify {store} lists all)",
        )
    return sorted(own)


def _others(count: int, one: str, many: str) -> str:
    return f"; {one if count == 1 else many} {counted(count, 'more file')}" if count else ""


def _link_all(store: Path, names: Iterable[str], target: Path) -> None:
    """Files of a store at another place; what cannot be linked is copied, and flushed."""
    for path, file in ((store / name, target / name) for name in names):
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(path, file)
        except OSError:
            shutil.copyfile(path, file)
            with file.open("rb+") as copied:
                os.fsync(copied.fileno())


def _graph(
    record: JobRecord,
    store: Path,
    name: str,
    description: str | None,
    license: str | None,
    published: datetime.date,
) -> Iterator[dict[str, Any]]:
    """The entities of the crate."""
    result = f"{quote(store.name)}/"
    observations, bands, rows, columns = record.shape
    what = (
        f"Normals, reflectance and gloss of a painting of {columns} x {rows} pixels from "
        f"{observations} photographs in {bands} bands"
    )
    yield {
        "@id": METADATA,
        "@type": "CreativeWork",
        "conformsTo": {"@id": CRATE},
        "about": {"@id": "./"},
    }
    yield {
        "@id": "./",
        "@type": "Dataset",
        "name": name,
        "description": description or f"{what}, estimated by impasto {record.version}",
        "datePublished": published.isoformat(),
        "license": {"@id": license} if license else "No licence is given.",
        "conformsTo": {"@id": PROFILE},
        "hasPart": [
            {"@id": result},
            *({"@id": _id(one)} for one in record.inputs if _is_file(one)),
        ],
        "mentions": {"@id": "#fit"},
    }
    if license:
        yield {"@id": license, "@type": "CreativeWork", "name": license}
    yield {"@id": PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"}
    yield {
        "@id": "#fit",
        "@type": "CreateAction",
        "name": "Fit of the photographs by impasto.run",
        "description": f"{what}; {NOTES}/{RECORD} in the store has every option",
        "instrument": {"@id": SOFTWARE},
        "object": [
            *({"@id": _id(one)} for one in record.inputs),
            *({"@id": f"#{key}"} for key, _ in _options(record)),
        ],
        "result": {"@id": result},
        "actionStatus": {"@id": "http://schema.org/CompletedActionStatus"},
    }
    yield {
        "@id": SOFTWARE,
        "@type": "SoftwareApplication",
        "name": "impasto",
        "softwareVersion": record.version,
    }
    yield {
        "@id": result,
        "@type": "Dataset",
        "name": store.name,
        "description": f"{what}: a group of Zarr v3 with an array for each map",
        "encodingFormat": "application/vnd.zarr",
    }
    for one in record.inputs:
        kind, _ = mimetypes.guess_type(one["file"])
        yield {
            "@id": _id(one),
            "@type": "File" if _is_file(one) else "CreativeWork",
            "name": Path(one["file"]).name,
            **_checksum(one),
            "contentSize": str(one["bytes"]),
            "encodingFormat": kind or "application/octet-stream",
        }
    for key, value in _options(record):
        yield {"@id": f"#{key}", "@type": "PropertyValue", "name": key, "value": value}


def _options(record: JobRecord) -> Iterator[tuple[str, Any]]:
    """Options that are set, as numbers and texts."""
    options = {**record.reading, **record.fit, "tile": record.tile, "sample": record.sample}
    for key, value in sorted(options.items()):
        if value is not None:
            plain = isinstance(value, bool | int | float | str)
            yield key, value if plain else json.dumps(value, sort_keys=True)


def _checksum(entry: Mapping[str, Any]) -> dict[str, str]:
    """How an input can be known again."""
    if "sha256" in entry:
        return {"sha256": entry["sha256"]}
    return {"identifier": f"crc32c:{entry['crc32c']}"}


def _is_file(entry: Mapping[str, Any]) -> bool:
    """Whether an input is a file; a stack in memory is none."""
    return Path(entry["file"]).is_absolute()


def _id(entry: Mapping[str, Any]) -> str:
    return Path(entry["file"]).as_uri() if _is_file(entry) else "#stack"
