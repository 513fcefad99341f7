"""Read a TOML file that anybody may have written, in time proportional to its size.

The parser of the standard library takes minutes for a key with many parts, and nested arrays exhaust its stack. The
text is therefore scanned first, token by token, and refused if it exceeds limits that no file of this project needs.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

from engine.platform.regular_file import read_regular_file

LARGEST = 1_000_000  # bytes
MOST_PARTS = 16  # parts of a dotted key
MOST_NESTED = 16  # levels of nested arrays and inline tables
MOST_TABLES = 20_000  # applies to the keys, and to the tables, arrays and inline tables together
LONGEST_WORD = 400  # characters of a bare key or number

# No possessive quantifiers: with a negative lookahead they match too much in Python before 3.11.5
# (https://github.com/python/cpython/issues/100061). Nor are they needed: what follows each repetition always matches.
TOKEN = re.compile(
    r'''(?P<skipped>[ \t\r]+|\#[^\n]*)
    |(?P<string>"""(?:[^\\"]+|\\(?:.|\Z)|"(?!""))*(?:"""|\Z)|\'\'\'.*?(?:\'\'\'|\Z)|"(?:[^"\\\n]+|\\[^\n])*"?|'[^'\n]*'?)
    |(?P<word>[^\s\#"'\[\]{}=,.]+)|(?P<dot>\.)|(?P<key>=)|(?P<comma>,)|(?P<open>[\[{])|(?P<close>[\]}])|(?P<end>\n)|(?P<other>.)''',
    re.VERBOSE | re.DOTALL,
)


class UnfitToml(ValueError):
    """A text is not TOML, or exceeds a limit; the message says where (line and column from 1), what, and what to do."""

    def __init__(self, message: str, line: int | None = None, column: int | None = None) -> None:
        super().__init__(message)
        self.line, self.column = line, column


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file; raise OSError if it is no regular file or too large, else as `parse_toml`."""
    return parse_toml(read_regular_file(path, LARGEST))


def parse_toml(content: bytes) -> dict[str, Any]:
    """Return the tables in the content of a TOML file; raise UnfitToml if it is not UTF-8 TOML or exceeds a limit."""
    if len(content) > LARGEST:
        raise UnfitToml(f"has {len(content)} bytes; allowed: up to {LARGEST}; shorten it")
    try:
        text = content.decode("utf-8-sig")  # some editors write a byte order mark before the first character
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise UnfitToml(f"line {line}: not UTF-8 text; save the file as UTF-8", line) from None
    _check_limits(text)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        what = f"not TOML: {str(error).replace(chr(10), ' '):.200}; correct the file there"
        raise UnfitToml(what, *_place(str(error), text)) from None
    except (ValueError, RecursionError) as error:
        raise UnfitToml(f"not TOML: {error}; correct the file") from None


def _place(message: str, text: str) -> tuple[int, int]:
    """Return the line and column that the parser's message refers to."""
    if place := re.search(r"\(at line (\d+), column (\d+)\)$", message):
        return int(place[1]), int(place[2])
    return text.count("\n") + 1, len(text) - text.rfind("\n")  # the end of the text


def text_bytes(text: str | bytes) -> bytes:
    """Return a text encoded as the content of a file; `parse_toml` refuses characters that are not valid Unicode."""
    return text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text


def _check_limits(text: str) -> None:
    """Refuse a text that would take the parser too long, or that nests too deeply."""
    parts, depth, keys, tables, line = 1, 0, 0, 0, 1
    for token in TOKEN.finditer(text):
        match token.lastgroup:
            case "skipped" | "string":
                line += token[0].count("\n")
                continue
            case "dot":
                parts += 1
                _check(parts, MOST_PARTS, "a key of more than {} parts; shorten it", line)
                continue
            case "word":
                _check(len(token[0]), LONGEST_WORD, "a key or number of more than {} characters; shorten it", line)
                continue
            case "open":
                depth, tables = depth + 1, tables + 1
                _check(depth, MOST_NESTED, "more than {} lists or tables in each other; write fewer", line)
                _check(tables, MOST_TABLES, "the file has more than {} tables and lists; write fewer", line)
            case "close":
                depth = max(depth - 1, 0)
            case "key":
                keys += 1
                _check(keys, MOST_TABLES, "the file has more than {} keys; write fewer", line)
            case "end":
                line += 1
        parts = 1


def _check(count: int, most: int, text: str, line: int) -> None:
    if count > most:
        raise UnfitToml(f"line {line}: {text.format(most)}", line)
