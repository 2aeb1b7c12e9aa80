"""The commands, and an exit code for every error; no tracebacks for mistakes of the user."""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

from cyclopts import App, Token
from cyclopts.exceptions import (
    CycloptsError,
    MissingArgumentError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from impasto._internal.printable import printable
from impasto.cli import (
    calibrate,
    capture,
    console,
    edit,
    experiment,
    export,
    job,
    rti,
    session,
)
from impasto.cli.codes import Exit
from impasto.cli.resuming import os_words
from impasto.colour._science import alone
from impasto.errors import CorruptInputError, GeometryError, ImpastoError, InternalError

ARGUMENTS = (
    "adapt_seconds|adaptation|after|again|align|alpha|ball|bands|before|camera|cells|card|circles|confidence|corners|dark|darks|data|degrees|diameter_mm|display|encoding|environment|"
    "estimator|exposure|exposure_sigma|focal_mm|illuminant|images|index|intensities|into|lights|lobes|log|logs|markers|mask|memory|method|observer|"
    "out|patches|pattern|pitch_mm|points|port|precision|quality|references|reflectance|region|repeats|sample|saturation|seed|"
    "sensor_mm|series|shots|size|stage|strict|target|threads|tile|tilt|times|to|tolerance|trials|url|view|watch|white"
)
"""Arguments of the Python API that are options here; ``pitch_mm`` is ``--pitch``, and so on."""


def application() -> App:
    """The commands; each one's module is imported when it runs."""
    app = App(
        name="impasto",
        help="Photographs of a painting in; a relightable, colour-true surface out.",
        version=_version,
        help_format="markdown",
        console=console.stdout(),
        error_console=console.stderr(),
        suppress_keyboard_interrupt=False,
    )
    app.command("impasto.cli.demo:demo", help="Measure and relight a simulated painting.")
    app.command("impasto.cli.fit:fit", help="Measure a painting from its photographs.")
    app.command("impasto.cli.render:render", help="Render a fitted painting and save the picture.")
    app.command(
        "impasto.cli.animate:animate",
        help="Render a fitted painting as a film. "
        "One of --raking, --turntable and --adaptation is needed.",
    )
    app.command(session.application())
    app.command(calibrate.application())
    app.command(capture.application())
    app.command("impasto.cli.align:align", help="Rectify photographs to the frontal view.")
    app.command(edit.application())
    app.command(experiment.application())
    app.command("impasto.cli.rehearse:rehearse", help="Rehearse a session on a simulation.")
    app.command("impasto.cli.ingest:ingest", help="Write photographs into one store, by tiles.")
    app.command(job.application())
    app.command("impasto.cli.height:height", help="Integrate the normals to a map of the height.")
    app.command(export.application())
    app.command(rti.application())
    app.command("impasto.cli.compare:compare", help="Show what changed between two states.")
    app.command(
        "impasto.cli.view:view", help="Show a fitted painting in the browser, in any light."
    )
    app.command("impasto.cli.doctor:doctor", help="Check photographs before a fit.")
    app.command("impasto.cli.study:study", help="Measure what accuracy costs in time.")
    app.command("impasto.cli.info:info", help="Show what is installed, or what a result contains.")
    return app


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command after all imports; see :func:`impasto.cli.main`."""
    console.make_output_safe()
    if arguments is None:
        alone()
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        commands = application()
        _tell_more(commands, words)
        result = commands(
            words, exit_on_error=False, print_error=False, result_action="return_value"
        )
        sys.stdout.flush()
        return result if isinstance(result, int) else Exit.OK
    except CycloptsError as error:
        console.complain(_one_line(error))
        console.hint("impasto --help lists the commands, impasto COMMAND --help their options")
        return Exit.USAGE_ERROR
    except CorruptInputError as error:
        console.complain(str(error))
        return Exit.CORRUPT_INPUT
    except InternalError as error:
        console.complain(printable(f"a defect in impasto, please report it: {error}"))
        return Exit.DEFECT
    except BrokenPipeError:
        # The reader of stdout has ended (impasto info | head): write nothing more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return Exit.OK
    except ImpastoError as error:
        # Lights that do not determine a surface are not an error of the option --lights.
        by_nature = isinstance(error, GeometryError) and str(error).startswith("lights:")
        console.complain(str(error) if by_nature else _in_options(str(error)))
        return Exit.USER_ERROR
    except OSError as error:
        console.complain(printable(os_words(error)))
        return Exit.USER_ERROR
    except MemoryError:
        console.complain(
            "not enough memory: fit a part (--region), fewer photographs, or use a larger machine"
        )
        return Exit.USER_ERROR
    except KeyboardInterrupt:
        console.complain("interrupted")
        return Exit.INTERRUPTED
    except Exception as error:  # no error of any library ends in a traceback
        console.complain(printable(_defect_words(error)))
        return Exit.DEFECT


def _tell_more(commands: App, words: Sequence[str]) -> None:
    """For the help of one command its docstring, not the line that lists it."""
    if not {"--help", "-h"} & set(words):
        return
    named = [word for word in words if not word.startswith("-")]
    command = commands.parse_commands(named)[1][-1]
    if command.default_command is not None:
        command.help = None


def _version() -> str:
    import impasto

    return impasto.__version__


def _one_line(error: CycloptsError) -> str:
    if isinstance(error, MissingArgumentError) and error.argument and not error.tokens_so_far:
        command = " ".join(error.command_chain or ())
        missing = f"{command}: {error.argument.name} is missing or has no value"
        unknown = _unknown_option(error)
        if unknown.endswith(f" {error.argument.name}?"):  # the same mistake
            return unknown
        return f"{unknown} {missing}".strip()
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        words = ", ".join(map(repr, error.unused_tokens))
        command = " ".join(error.command_chain or ())
        return f"{command}: {words} belongs to no option and is not expected here"
    return " ".join(str(error).split())


def _unknown_option(error: MissingArgumentError) -> str:
    """That an option of a command that lacks one is unknown, as Cyclopts says it otherwise."""
    if error.app is None:
        return ""
    options = error.app.assemble_argument_collection()
    known = {name for option in options for name in option.names}
    for word in error.unused_tokens or ():
        name = word.split("=")[0]
        if re.match("--?[A-Za-z]", name) and name not in known:
            token = Token(keyword=name, source="cli")
            return str(UnknownOptionError(token=token, argument_collection=options, verbose=False))
    return ""


def _in_options(message: str) -> str:
    """A message of the Python API with options for arguments: ``images=`` becomes ``--images``."""
    message = re.sub(rf"^({ARGUMENTS}):", r"--\1:", message.removeprefix("path: "))
    message = re.sub(",? or None, found", ", found", message)  # an option that is not given
    message = re.sub(rf"\b({ARGUMENTS})=(?!\w)", r"--\1", message)
    return re.sub(r"--(pitch|diameter|focal|sensor)_mm\b", r"--\1", message)


def _defect_words(error: Exception) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(last.filename).name}, line {last.lineno}, {last.name}"
    words = f"{type(error).__name__}: {error}"
    return f"a defect in impasto, please report it: {words} ({place})"
