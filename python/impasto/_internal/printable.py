"""Names and messages without characters that command a terminal."""

from __future__ import annotations

_WORDS = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}
_COMMANDS = (
    *range(0x20),  # C0, with escape
    *range(0x7F, 0xA0),  # delete, C1
    *(0x2028, 0x2029),  # line and paragraph separator
    *(0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A)),  # directions of writing
)
_SHOWN = {
    code: _WORDS.get(chr(code), f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}")
    for code in _COMMANDS
}
_LINES = {code: text for code, text in _SHOWN.items() if code != 0x0A}


def printable(text: str, *, lines: bool = False) -> str:
    r"""``text`` with control characters as Python writes them in source code: ``\x1b``.

    A name of a file can hold any of them, and so move the cursor of a terminal, hide what follows
    or begin a line that looks like another message. With ``lines`` line feeds are kept.
    """
    return text.translate(_LINES if lines else _SHOWN)
