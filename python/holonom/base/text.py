"""Text that is safe to show: nothing in it moves a cursor, turns a line round or fills a screen."""

from __future__ import annotations

import html
import json
import unicodedata
from typing import Any

#: Longest line of a message or a summary; what is longer is cut in the middle.
LINE = 1000
#: Longest name within a message.
NAME = 100

#: What stands for bytes of a file name that are not UTF-8, `os.fsdecode`, where text must be valid.
_BYTES = range(0x10FF80, 0x110000)


def shown(text: str) -> str:
    """Return text with all that a terminal would obey written as escapes, long lines cut.

    Line ends and tabs stay; other control characters, directions of writing, lone surrogates and
    line separators are written by their numbers, so that a title cannot pretend to be a message.
    """
    text = _escaped(text)
    if len(text) > LINE:
        text = "\n".join(_cut(line, LINE) for line in text.split("\n"))
    return text


def preformatted(text: str) -> str:
    """Return text of some lines as a notebook shows it."""
    return f"<pre>{html.escape(shown(text))}</pre>"


def quoted(name: object) -> str:
    """Return a name that a user gave, in backticks: one line and short, whatever it holds."""
    text = _escaped(str(name)).replace("\n", "\\n").replace("\t", "\\t")
    return f"`{_cut(text, NAME)}`"


def one_line(text: object) -> str:
    """Return text as one line that is safe to show."""
    return shown(str(text).replace("\n", " "))


def as_json(data: Any) -> str:
    """Return plain data as indented JSON that is safe to show; it reads back the same.

    But for numbers that are not finite, of which JSON has none: they are null.
    """
    data = json.loads(json.dumps(data, default=str), parse_constant=lambda _: None)
    text = json.dumps(data, indent=2, ensure_ascii=False)
    safe = text.replace("\n", "").isprintable()
    return text if safe else json.dumps(data, indent=2)


def is_unicode(text: str) -> bool:
    """Return whether a text can be written in any file: it holds no half of a character."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def as_text(name: str) -> str:
    """Return a file name as valid text, from which `as_name` gets the name back."""
    return "".join(chr(ord(c) + 0x10FF80 - 0xDC80) if _is_byte(c) else c for c in name)


def as_name(text: str) -> str:
    """Return the file name that `as_text` made valid."""
    return "".join(chr(ord(c) - 0x10FF80 + 0xDC80) if ord(c) in _BYTES else c for c in text)


def _is_byte(character: str) -> bool:
    return "\udc80" <= character <= "\udcff"


def _escaped(text: str) -> str:
    plain = text.replace("\n", "").replace("\t", "").isprintable()
    return text if plain else "".join(map(_visible, text))


def _visible(character: str) -> str:
    if character.isprintable() or character in "\n\t" or unicodedata.category(character) == "Zs":
        return character
    number = ord(character)
    if _is_byte(character) or number in _BYTES:  # a byte of a file name
        number &= 0xFF
    if number < 0x100:
        return f"\\x{number:02x}"
    return f"\\u{number:04x}" if number < 0x10000 else f"\\U{number:08x}"


def _cut(line: str, most: int) -> str:
    if len(line) <= most:
        return line
    half = most // 2 - 15
    return f"{line[:half]} … {len(line) - 2 * half} characters … {line[-half:]}"


def escape(text: str) -> str:
    """Return text for a page; control characters are written by their numbers."""
    return html.escape(shown(text))
