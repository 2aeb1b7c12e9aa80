"""Jobs that end early: their exit codes, and the words that say how to go on."""

from __future__ import annotations

import errno
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from impasto._internal.memory import DEFAULT_MEMORY
from impasto.cli import console
from impasto.cli.codes import Exit
from impasto.errors import ArgumentError

if TYPE_CHECKING:
    from impasto.jobs import Finding

OF_A_NAME = {
    *(errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ELOOP, errno.ENAMETOOLONG),
    *(errno.EACCES, errno.EPERM),
    errno.EAGAIN,  # a lock that another process holds
}
"""Errors of files that were named wrongly, or are in use."""


def is_resumable(out: Path) -> bool:
    """Whether there is a job of this name that is not finished."""
    from impasto.errors import ImpastoError
    from impasto.jobs import status

    try:
        return status(out).state != "finished"
    except ImpastoError:
        return False


def has_kept(out: Path) -> bool:
    """Whether there is a job of this name, finished or not."""
    from impasto.jobs.folder import NOTES, RECORD, partial_of

    return any((folder / NOTES / RECORD).exists() for folder in (out, partial_of(out)))


def say_how_to_resume(out: Path, scheduler: str | None, again: Path | None = None) -> None:
    """The command that goes on, where there is something to go on with.

    ``again``: the store that is made once more, and compared.
    """
    if is_resumable(out):
        console.hint(f"go on with: {resume_words(out, None, scheduler, again)}")


def os_words(error: OSError) -> str:
    """What the system refused, and of which file."""
    if not error.strerror:
        return str(error)
    words = f"{error.strerror[0].lower()}{error.strerror[1:]}"
    return words if error.filename is None else f"{error.filename}: {words}"


def is_of_a_disk(error: ArgumentError, *, begun: bool) -> bool:
    """Whether a file cannot be read because its disk fails, or is gone since the job began."""
    cause = error.__cause__
    return isinstance(cause, OSError) and (begun or cause.errno not in OF_A_NAME)


def say_how_to_take_less(
    out: Path, memory: str | None, scheduler: str | None, again: Path | None = None
) -> int:
    """Half of the memory that was not there, and tiles of another size by a new job.

    ``memory``: what was asked for; None: what the job had.
    """
    from impasto.jobs import status

    if not is_resumable(out):
        console.complain(f"not enough memory: {less_than(memory or DEFAULT_MEMORY)}")
        return Exit.USER_ERROR
    had = memory or status(out).memory or DEFAULT_MEMORY
    console.complain(
        "not enough memory; the tiles of this job keep their size: if less for the rest does not "
        "do, begin anew with smaller tiles (impasto job run --no-resume --tile)"
    )
    console.hint(f"go on with: {resume_words(out, _half_of(had), scheduler, again)}")
    return Exit.PARTIAL


def less_than(memory: str) -> str:
    """What to do where the system does not have this much memory."""
    return f"give less than {memory}, such as --memory {_half_of(memory)}"


def _half_of(memory: str | int) -> str:
    from impasto.jobs.grid import bytes_of

    return f"{max(bytes_of(memory) >> 21, 1)}MiB"


def say_how_to_repair(out: Path, findings: Sequence[Finding]) -> None:
    """What to do about files of a job that are not as it wrote them.

    A job makes again what its journal has and the disk has not, of the same photographs; neither
    a photograph nor the notes of a job.
    """
    from impasto._internal.build import build_name
    from impasto.jobs.checksums import CHECKSUMS
    from impasto.jobs.folder import NOTES, RECORD, partial_of
    from impasto.jobs.lookup import folder_of
    from impasto.jobs.record import JobRecord

    if (out / CHECKSUMS).is_file():
        return
    if not has_kept(out):
        console.hint("a store of photographs is made again from these by impasto ingest")
        return
    folder, whole = folder_of(out)
    notes = folder / NOTES
    own = [Path(finding.file) for finding in findings if not finding.foreign]
    if any(file.is_relative_to(notes) for file in own):
        return  # where a job's notes are damaged, nobody knows what belongs to it
    if len(own) < len(findings):
        console.hint("what does not belong to the store was put there by others: move it away")
    if not own or not all(file.is_relative_to(folder) for file in own):
        return
    version = JobRecord.read(notes / RECORD).version
    if version != build_name():
        console.hint(f"impasto {version}, which made them, makes them again; this is another one")
        return
    rename = (
        f"mv {shlex.quote(str(folder))} {shlex.quote(str(partial_of(folder)))} && " if whole else ""
    )
    console.hint(f"made again, from the photographs, by: {rename}{resume_words(out)}")


def resume_words(
    out: Path,
    memory: str | None = None,
    scheduler: str | None = None,
    again: Path | None = None,
) -> str:
    """The command that goes on with a job, with the memory that it had where none is given.

    ``again``: of what store it is the second one, with which it is compared in the end.
    """
    words = ["impasto", "job", "resume", str(out)]
    if again is not None:
        words = ["impasto", "job", "rerun", str(again), "--into", str(out)]
    if memory is not None:
        words += ["--memory", memory]
    if scheduler is not None:
        words += ["--scheduler", scheduler]
    return shlex.join(words)


def files_words(count: int) -> str:
    """So many files."""
    return "1 file is" if count == 1 else f"{count} files are"
