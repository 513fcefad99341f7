"""The text of a STEP file as UTF-8: some programs write names in the code page of their computer, and do not say so."""

import re

_WITH_HIGH = re.compile(rb"[ -~\x80-\xff]*[\x80-\xff][ -~\x80-\xff]*")
_DOS_LETTERS = frozenset(range(0x80, 0xA6)) - {0x91, 0x92, 0x93, 0x96, 0x97}  # without the quotes and dashes of Windows
_LATIN_LETTERS = frozenset(range(0xC0, 0x100))
_MOSTLY = 0.75  # share of Japanese letters that are next to another one
_PRIVATE = range(0xE000, 0xF900)


def as_utf8(content: bytes) -> bytes:
    """Return a file in UTF-8; one that is neither is taken for Shift-JIS, DOS or Latin-1, by what is usual in names."""
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        texts = _WITH_HIGH.findall(content)
        return content.decode("cp932" if _is_japanese(texts) else _western(texts), "replace").encode()
    return content


def _is_japanese(texts: list[bytes]) -> bool:
    """Return whether texts are Shift-JIS: as such, letters beyond ASCII come in words, not alone between others."""
    beyond, together = 0, 0
    for text in texts:
        try:
            letters = text.decode("cp932")
        except UnicodeDecodeError:
            return False
        if any(ord(letter) in _PRIVATE for letter in letters):
            return False
        words = re.findall(r"[^\x00-\x7f]+", letters)
        beyond += sum(map(len, words))
        together += sum(len(word) for word in words if len(word) > 1)
    return together >= _MOSTLY * beyond


def _western(texts: list[bytes]) -> str:
    """Return the code page of texts of Western Europe, from where their letters with accents are in it."""
    values = b"".join(texts)
    dos, latin = (sum(value in letters for value in values) for letters in (_DOS_LETTERS, _LATIN_LETTERS))
    return "cp850" if dos > latin else "cp1252" if _fits(values, "cp1252") else "latin-1"


def _fits(values: bytes, encoding: str) -> bool:
    try:
        values.decode(encoding)
    except UnicodeDecodeError:
        return False
    return True
