"""What ``impasto view`` and ``impasto export web`` share: a painting, and what is beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cyclopts import CycloptsError
from rich.markup import escape

from impasto._internal.printable import printable
from impasto.cli.console import Stages
from impasto.cli.fit import camera_of
from impasto.cli.maps import load_result, name_of
from impasto.errors import ArgumentError
from impasto.io.results import result_file
from impasto.io.session_toml.read import SESSION_FILE

PHOTOGRAPHS = {
    ".lp", ".dome", ".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr", ".dng", ".nef", ".cr2",
}  # fmt: skip
"""Ends of names by which a folder is taken for one of photographs."""
WHOLE = 1 << 23
"""Most pixels of a painting whose photographs are read at once: 72 in three bands of 16 bits take
3.6 GB then."""
HELD = 1 << 26
"""Bytes of rows that are kept of larger ones: files are decoded by whole rows."""


def shown_result(folder: Path) -> tuple[Any, Any]:
    """A painting for the page and its reflectance, or None.

    As :func:`~impasto.cli.maps.load_result` has it; a store is opened and not loaded, and a
    ``.ptm``, an ``.rti`` or a folder of relight is read as it is.

    Raises
    ------
    ArgumentError
        There is no result.
    CorruptInputError
        The result is damaged, or of two runs.
    """
    import impasto
    from impasto.io.rti import is_relightable, read_relightable

    path = result_file(folder)
    if is_relightable(folder) and (path == folder or not path.exists()):
        return read_relightable(folder), None
    if not path.exists() and (words := _instead(folder)):
        raise ArgumentError(f"{printable(str(folder))} {words}")
    return (impasto.open_sbrdf(path), None) if path.is_dir() else load_result(folder)


def say_notes(painting: Any, stages: Stages) -> None:
    """What is odd about a relightable image of another program."""
    for note in getattr(painting, "notes", ()):
        stages.say(f"  {'':14}[dim]{escape(note)}[/]")


LACKING = {
    "width": "no lengths in mm: --pitch says how wide a pixel is",
    "spectra": "no colour of the light and no varnish: --camera makes spectra",
}
"""Which option brings what a page lacks."""


def say_lacking(lacks: Sequence[str], stages: Stages) -> None:
    """What a page does not have, and which option would bring it."""
    for name in lacks:
        stages.say(f"  {'':14}[dim]{LACKING[name]}[/]")


def camera_for_page(camera: str | None, illuminant: str | None) -> Any:
    """The camera of a page's spectra, or None.

    Raises
    ------
    CycloptsError
        A light without a camera.
    """
    if camera is not None:
        return camera_of(camera, illuminant)
    if illuminant is not None:
        raise CycloptsError(
            msg="--illuminant is the light for the sensitivities of a camera: it needs --camera"
        )
    return None


def own_environments(paths: Sequence[Path]) -> list[Any]:
    """Environments of a page from files, besides those that every page has.

    Raises
    ------
    ArgumentError
        One of those by its name.
    """
    from impasto.environment import Environment
    from impasto.rooms import LABELS

    if contained := [LABELS[str(path)] for path in paths if str(path) in LABELS]:
        raise ArgumentError(
            f"--environment: every page has {', '.join(contained)}: choose it there under Light; "
            "this option adds .exr or .hdr files"
        )
    return [Environment.read(path) for path in paths]


def say_empty(contents: Any, result: Path, stages: Stages) -> None:
    """That a page shows nothing, and who knows why."""
    if contents.empty:
        stages.say(
            f"  {'':14}[bold]no pixel of it has an estimate[/]: the page is empty; impasto info "
            f"{escape(printable(str(result)))} says why"
        )


def painting_beside(path: Path | None, stages: Stages) -> dict[str, Any]:
    """Another painting to compare with in the viewer, as options of its contents."""
    from impasto.io.rti import RelightableImage

    if path is None:
        return {}
    with stages.warned(), stages.stage("against") as stage:
        painting, reflectance = shown_result(path)
        rows, columns = painting.shape
        title = stage.note = name_of(path)
        if isinstance(painting, RelightableImage):
            title = f"{title} ({painting.format})"
            stage.note = f"{painting.format}, {columns} x {rows} pixels"
            say_notes(painting, stages)
    return {"against": painting, "against_reflectance": reflectance, "against_title": title}


def _instead(folder: Path) -> str:
    """What a folder that is no result is, and what to do with it."""
    if not folder.is_dir():
        return ""
    if (folder / "document.js").is_file():
        page = printable(str(folder / "index.html"))
        return f"is a page already: open {page} in a browser"
    names = [Path(one.name) for one in folder.iterdir()]
    if any(one.name == SESSION_FILE or one.suffix.lower() in PHOTOGRAPHS for one in names):
        own = printable(str(folder))
        return f"holds photographs: impasto fit {own} --out RESULT makes a result of them"
    return ""


def photographs_beside(
    path: Path | None, encoding: str | None, stages: Stages, pixels: int = 0
) -> Any:
    """Photographs to compare with a result in the viewer, or None.

    Those of a painting of more than :data:`WHOLE` pixels are opened, and read where a pixel is
    looked at.
    """
    import impasto
    from impasto.jobs.photographs import open_photographs

    if path is None:
        return None
    options: dict[str, Any] = {} if encoding is None else {"encoding": encoding}
    with stages.warned(), stages.stage("photographs") as stage:
        if pixels > WHOLE:
            opened = open_photographs(path, options, HELD, None)
            stage.note = f"{opened.shape[0]}, read pixel by pixel"
            return opened
        stack = impasto.read_stack(path, **options)
        stage.note = f"{len(stack.rig)}"
    return stack
