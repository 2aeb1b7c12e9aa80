"""Libraries that only some calls need, and that are installed with an extra of the package."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

from impasto.errors import MissingExtraError

NO_MEMORY = ("failed to map segment", "annot allocate memory")
"""What the loader of shared libraries says where memory is short."""


def need(module: str, extra: str, what: str) -> None:
    """Refuse ``what`` where a library is missing, before any work is done.

    Raises
    ------
    MissingExtraError
        It names the extra to install, or says what is wrong with the library that is there.
    MemoryError
        It is there, and memory is too short for it.
    """
    try:
        import_module(module)
    except SystemError as error:  # Python had no memory left to say that it had none
        raise MemoryError(f"no memory to load {module}") from error
    except ImportError as error:
        if find_spec(module.partition(".")[0]) is not None:
            if any(words in str(error) for words in NO_MEMORY):
                raise MemoryError(f"no memory to load {module}") from error
            raise MissingExtraError(
                f"{what} needs {module}, which is installed and cannot be loaded ({error}): "
                f"pip install --force-reinstall 'impasto[{extra}]'"
            ) from error
        raise MissingExtraError(
            f"{what} needs {module}, which is not installed: pip install 'impasto[{extra}]'"
        ) from error
