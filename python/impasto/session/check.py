"""Whether a session still is what was photographed, and what its photographs say of themselves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from impasto._internal.wording import counted
from impasto.doctor import Diagnosis, Finding
from impasto.doctor.diagnosis import named
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.images import ImageHeader, natural_key, read_header
from impasto.io.images.exif import Exif, read_exif
from impasto.io.notes import Notebook, few
from impasto.io.session.from_session import SessionPhotographs
from impasto.io.session_toml import Session, read_session
from impasto.io.session_toml.hashes import problems, unlisted
from impasto.session.sequence import sequence

DAMAGED = frozenset({"changed", "damaged"})
"""Codes of findings about files that are not as they were: exit code 3."""
_ALIKE = 0.1
"""Relative difference of two focal lengths: EXIF rounds them to mm."""


def check_session(path: str | Path) -> Diagnosis:
    """Check a session: hashes, sizes, exposures, order and times; every finding says what to do.

    Every file is read once; one pixel of each photograph is decoded.

    Parameters
    ----------
    path
        The session file, or its folder.

    Returns
    -------
    Diagnosis
        Codes ``missing``, ``changed``, ``unlisted``, ``photographs``, ``damaged``, ``size``,
        ``exif``, ``camera``, ``exposure``, ``order``, ``clock``, ``focal-length``,
        ``painting-size`` and ``stack``.

    Raises
    ------
    CorruptInputError
        The session file is no TOML.
    ArgumentError
        An unknown key or a wrong value in it, or files outside of its folder.
    """
    session = read_session(path)
    found = _hashes(session)
    try:
        photographs = SessionPhotographs(session, {}, Notebook())
        grouped = photographs.files()
    except ArgumentError as error:
        found.append(_refused("photographs", error))
        return Diagnosis(tuple(found), (), (0, 0, 0, 0))
    files = [path for group in grouped for path in group]
    if not session.sha256:
        found.append(
            Finding(
                "unlisted",
                "note",
                "the session states no hash: a changed file is not noticed",
                "write name = SHA-256 into [files]; impasto session init does, for a new session",
            )
        )
    elif others := unlisted(session, files):
        found.append(
            Finding(
                "unlisted",
                "warning",
                f"{counted(len(others), 'photograph')} without a hash: {few(others)}",
                "write their SHA-256 into [files]",
            )
        )
    headers, broken = _headers(files)
    found += broken
    names = tuple(path.name for path in files)
    if headers and not broken and session.alignment is None:
        found += _sizes(headers)
    exif = _exif(files)
    equalised = session.intensities is not None or _boards(session)
    for band in range(len(grouped[0])):  # filters have exposures of their own
        found += _in_order(range(band, len(files), len(grouped[0])), names, exif, equalised)
    shape = (len(grouped), 0, 0, 0)
    first = headers[0] if headers else None
    if first is not None:
        found += _camera(session, first, exif)
        if photographs.geometry is not None and photographs.geometry.moves:
            grid = photographs.geometry.grid
            first = replace(first, width=grid.columns, height=grid.rows)
        found += _extent(session, photographs, first)
        shape = (len(grouped), first.channels * len(grouped[0]), first.height, first.width)
    if not any(one.severity == "error" and one.code != "exposure" for one in found):
        try:
            stack = photographs.read(region=(0, 0, 1, 1), mask=None)
        except CorruptInputError as error:
            found.append(_refused("damaged", error))
        except ArgumentError as error:
            found.append(_refused("stack", error))
        else:
            shape = (*stack.shape[:2], *shape[2:])
            found += [
                Finding("stack", "warning" if note.repair else "note", str(note))
                for note in stack.notes
                if getattr(note, "repair", False) or note.kind in {"horizon", "duplicate"}
            ]
            if first is not None:
                found += _mask(photographs, first)
    return Diagnosis(tuple(found), names, shape)


def _refused(code: str, error: Exception) -> Finding:
    return Finding(code, "error", str(error), "correct the session file or that file")


def _hashes(session: Session) -> list[Finding]:
    found = []
    lost = list(problems(session))
    listed = {digest: name for name, digest in session.sha256.items()}
    for problem in lost:
        line = f" (line {problem.line})" if problem.line else ""
        if not problem.found:
            found.append(
                Finding(
                    "missing",
                    "error",
                    f"{problem.name}{line} does not exist",
                    "put it back, or remove its line if the session goes without it",
                )
            )
        elif problem.found in listed:
            found.append(
                Finding(
                    "changed",
                    "error",
                    f"{problem.name}{line} holds what was {listed[problem.found]} when the session "
                    "was written: files were exchanged, or one was copied over the other",
                    "give both their names again, or copy them again",
                )
            )
        else:
            found.append(
                Finding(
                    "changed",
                    "error",
                    f"{problem.name}{line} is another file than when the session was written",
                    f'copy it again; if the change is meant, write "{problem.found}" in that line',
                )
            )
    if session.sha256 and not lost:
        found.append(
            Finding(
                "changed", "ok", f"{counted(len(session.sha256), 'file')} as listed, by SHA-256"
            )
        )
    return found


def _headers(files: Sequence[Path]) -> tuple[list[ImageHeader], list[Finding]]:
    """Of each photograph, checked to the end of its file."""
    headers, broken = [], []
    for path in files:
        try:
            headers.append(read_header(path))
        except CorruptInputError as error:
            broken.append(Finding("damaged", "error", str(error), "copy it again from the camera"))
        except ArgumentError as error:
            broken.append(_refused("photographs", error))
    return headers, broken


def _sizes(headers: Sequence[ImageHeader]) -> list[Finding]:
    kinds = [(one.width, one.height, one.channels, str(one.dtype)) for one in headers]
    usual = max(kinds, key=kinds.count)
    odd = tuple(i for i, kind in enumerate(kinds) if kind[:2] != usual[:2] or kind[3] != usual[3])
    width, height, _, dtype = usual
    if not odd:
        return [Finding("size", "ok", f"all of {width} x {height} pixels, {dtype}")]
    names = [one.path.name for one in headers]
    other = kinds[odd[0]]
    return [
        Finding(
            "size",
            "error",
            f"{named(names, odd)} with {other[0]} x {other[1]} pixels, {other[3]}; the others with "
            f"{width} x {height}, {dtype}",
            "export all photographs alike, uncropped and not turned",
            odd,
        )
    ]


def _exif(files: Sequence[Path]) -> list[Exif]:
    found = []
    for path in files:
        try:
            found.append(read_exif(path))
        except ArgumentError:  # named among the headers
            found.append(Exif())
    return found


def _in_order(
    places: Iterable[int], names: Sequence[str], exif: Sequence[Exif], equalised: bool
) -> list[Finding]:
    """The findings on some files in the order of their names, by their places in the session."""
    order = sorted(places, key=lambda i: natural_key(names[i]))
    found = sequence([names[i] for i in order], [exif[i] for i in order], equalised=equalised)
    return [
        replace(one, observations=tuple(sorted(order[i] for i in one.observations)))
        for one in found
    ]


def _boards(session: Session) -> bool:
    """Whether there is a white board for each light."""
    if session.white is None or isinstance(session.white, tuple):
        return session.white is not None and len(session.white) > 1
    assert session.path is not None
    return (session.path.parent / session.white).is_dir()


def _camera(session: Session, header: ImageHeader, exif: Sequence[Exif]) -> list[Finding]:
    """Name and focal length of the camera against those of the photographs."""
    found = []
    camera = next((one.camera for one in exif if one.camera), None)
    if session.camera and camera and session.camera.casefold() != camera.casefold():
        message = f"camera.name is {session.camera!r}, EXIF says {camera!r}"
        found.append(Finding("camera", "note", message))
    stated = next((f for one in exif if (f := one.focal_length_px(header.width, header.height))), 0)
    own = session.focal_length_px
    if own and stated and abs(own / stated - 1.0) > _ALIKE:
        found.append(
            Finding(
                "focal-length",
                "warning",
                f"camera.focal_length_px is {own:.0f}, EXIF says {stated:.0f} pixels for a whole "
                "frame",
                "see whether the photographs are reduced or cropped, and correct it",
            )
        )
    return found


def _extent(
    session: Session, photographs: SessionPhotographs, header: ImageHeader
) -> list[Finding]:
    """Size of the painting against what the photographs show."""
    pitch = session.pitch_mm
    if photographs.geometry is not None and photographs.geometry.pitch_mm is not None:
        pitch = photographs.geometry.pitch_mm
    if session.size_mm is None or pitch is None:
        return []
    seen = (header.width * pitch, header.height * pitch)
    # The pixels of an alignment are a whole number.
    if all(size <= side + pitch / 2 for size, side in zip(session.size_mm, seen, strict=True)):
        return []
    return [
        Finding(
            "painting-size",
            "warning",
            f"painting.size_mm is {session.size_mm[0]:g} x {session.size_mm[1]:g} mm, the "
            f"photographs show {seen[0]:.4g} x {seen[1]:.4g} mm at {pitch:g} mm for a pixel",
            "correct size or pitch, if the photographs show the whole painting",
        )
    ]


def _mask(photographs: SessionPhotographs, header: ImageHeader) -> list[Finding]:
    path = photographs.arguments.get("mask")
    if path is None:
        return []
    try:
        mask = read_header(path)
    except CorruptInputError as error:
        return [_refused("damaged", error)]
    except ArgumentError as error:
        return [_refused("stack", error)]
    if (mask.width, mask.height) == (header.width, header.height):
        return []
    return [
        Finding(
            "size",
            "error",
            f"the mask {mask.path.name} has {mask.width} x {mask.height} pixels, the photographs "
            f"{header.width} x {header.height}",
            "make the mask on one of the photographs",
        )
    ]
