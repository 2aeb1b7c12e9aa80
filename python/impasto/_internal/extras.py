"""Libraries that only some calls need, and that are installed with an extra of the package."""

from __future__ import annotations

from importlib import import_module

from impasto.errors import MissingExtraError


def need(module: str, extra: str, what: str) -> None:
    """Refuse ``what`` where a library is missing, before any work is done.

    Raises
    ------
    MissingExtraError
        It names the extra to install.
    """
    try:
        import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"{what} needs {module}, which is not installed: pip install 'impasto[{extra}]'"
        ) from error
