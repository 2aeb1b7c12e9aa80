"""``impasto session``: ``session.toml`` from a folder of photographs, and whether it holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from impasto.cli import console
from impasto.cli.codes import Exit
from impasto.cli.doctor import show
from impasto.cli.options import Flag
from impasto.errors import ArgumentError


def application() -> App:
    """The commands below ``impasto session``."""
    app = App(name="session", help="Describe photographs in a session.toml, and check them by it.")
    app.command("impasto.cli.session:init", help="Write a session.toml from what lies in a folder.")
    app.command("impasto.cli.session:check", help="Say whether files are as it describes them.")
    return app


def init(folder: Annotated[Path, Parameter(name=["FOLDER"])], /) -> int:
    """Write FOLDER/session.toml from what lies in a folder; an existing one is never replaced.

    Prints what was found, what is missing, and what EXIF says of exposures, order and times. Edit
    the file afterwards: every key is explained in it.

    Exit code 4: written, but there are no lights for the photographs yet.

    Parameters
    ----------
    folder
        Photographs, or one folder of them; a light file; dark frames, white boards and a mask by
        their names.
    """
    from impasto.io.session_toml import SESSION_FILE, write_session
    from impasto.session import find_session

    path = folder / SESSION_FILE
    if path.exists():
        raise ArgumentError(f"path: {path} already exists and is not replaced; edit or move it")
    with console.stderr().status("reading the folder"):
        made = find_session(folder)
    write_session(path, made.session)
    page = console.stdout()
    page.out(f"written  {path}")
    for line in made.found:
        page.out(f"found    {line}")
    for finding in made.findings:
        if finding.code == "camera" and finding.severity == "ok":
            continue  # said above
        if finding.severity in {"warning", "error"}:
            page.out(f"{finding.severity:<8} {finding.code}: {finding.message}")
            page.out(f"         -> {finding.advice}")
        else:
            page.out(f"found    {finding.message}")
    for line in made.missing:
        page.out(f"missing  {line}")
    return Exit.OK if made.complete else Exit.PARTIAL


def check(session: Annotated[Path, Parameter(name=["SESSION"])], /, *, json: Flag = False) -> int:
    """Check a session: hashes, sizes, equal exposure, order and times of the photographs.

    Exit code 0: usable, possibly with warnings. 1: a wrong key, a missing file, or photographs that
    do not belong together. 3: a file has changed or is damaged.

    Parameters
    ----------
    session
        The session.toml, or its folder.
    json
        Print JSON for programs.
    """
    from impasto.session import DAMAGED, check_session

    with console.stderr().status("checking the session"):
        diagnosis = check_session(session)
    if json:
        console.print_json(diagnosis.to_dict())
    else:
        show(diagnosis, console.stdout())
    errors = {finding.code for finding in diagnosis.of("error")}
    if errors & DAMAGED:
        return Exit.CORRUPT_INPUT
    return Exit.USER_ERROR if errors else Exit.OK
