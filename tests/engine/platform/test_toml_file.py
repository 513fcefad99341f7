"""TOML files that anybody may have written: what a parser would take minutes for is refused before it is parsed."""

import tomllib
from importlib.resources import files

import pytest

from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml, read_toml
from tests.each import each

PARTS = 100_000
BOMBS = {
    "dotted key": ("a" + ".a" * PARTS + " = 1", "line 1: a key of more than 16 parts"),
    "quoted parts": ('"a,"' + ' . "b,"' * PARTS + " = 1", "line 1: a key of more than 16 parts"),
    "header": ("x = 1\n[" + "a." * PARTS + "a]", "line 2: a key of more than 16 parts"),
    "key in an inline table": ("x = {" + "a." * PARTS + "a = 1}", "a key of more than 16 parts"),
    "nested lists": ("x = " + "[" * 900 + "]" * 900, "more than 16 lists or tables in each other"),
    "nested over lines": ("x = " + "[\n" * 100_000, "line 17: more than 16 lists or tables in each other"),
    "nested tables": ("x = " + "{a = " * 100_000, "more than 16 lists or tables in each other"),
    "digits": ("x = " + "1" * 4301, "a key or number of more than 400 characters"),
    "hexadecimal digits": ("x = 0x" + "f" * 4000, "a key or number of more than 400 characters"),
    "keys": ("".join(f"k{i} = 1\n" for i in range(30_000)), "line 20001: the file has more than 20000 keys"),
    "tables": ("".join(f"[t{i}]\n" for i in range(30_000)), "the file has more than 20000 tables and lists"),
    "lists of tables": ("[[a]]\n" * 30_000, "the file has more than 20000 tables and lists"),
    "NUL": ("x = 1\0", "not TOML"),
    "carriage returns": ("x = 1\ry = 2\r", "not TOML"),
    "an open string": ('x = "' + "\\" * 100_000, "not TOML"),
    "an open text": ('x = """' + '\\"' * 400_000 + "\\", "not TOML"),
    "quotes": ("'" * 100_000, "not TOML"),
    "surrogate": ('x = "\\ud800"', "not TOML"),
}


@each("text", [BOMBS[name][0] for name in BOMBS])
def test_bombs_are_refused(text):
    """In one message, which says where, what is allowed and what to do; the parser would take up to a minute."""
    said = next(said for bomb, said in BOMBS.values() if bomb == text)
    with pytest.raises(UnfitToml) as error:
        parse_toml(text.encode())
    assert said in str(error.value)
    assert len(str(error.value).splitlines()) == 1
    assert len(str(error.value)) < 400


@each(
    "text",
    [
        "\ufeffx = 1",
        "a = 1\r\nb = 2\r\n",
        'x = "' + ".[{=" * 10_000 + '"',
        "x = '''\n" + "[.\n" * 10_000 + "'''",
        'x = """\n' + '[."" \\" \\\\\n' * 10_000 + '"""""',
        "# " + "." * 100_000,
        "x = [" + "1.5, # .[\n" * 10_000 + "]",
        'x.\'a.b.c\'."d.\\".e" = 1979-05-27T07:32:00.999999-07:00',
        "x = {a = [{b = [[1.0, 2.0], [3.0]]}]}",
    ],
)
def test_what_is_within_the_limits_is_parsed(text):
    """The scan knows strings, comments and lists: what looks like a bomb inside them is none."""
    assert parse_toml(text.encode()) == tomllib.loads(text.removeprefix("\ufeff"))


@pytest.mark.parametrize("package", ["engine.mechanism", "campaign"])
def test_all_that_is_shipped_is_within_the_limits(package):
    """And read as by the parser alone."""
    shipped = [file for file in files(package).joinpath("library").iterdir() if file.name.endswith(".toml")]
    assert shipped
    for file in shipped:
        assert read_toml(file) == tomllib.loads(file.read_text("utf-8"))


def test_text_in_another_encoding():
    """The line is named."""
    with pytest.raises(UnfitToml, match=r"line 2\b.*UTF-8"):
        parse_toml("x = 1\ny = 'é'".encode("latin-1"))
    with pytest.raises(UnfitToml, match="not UTF-8"):
        parse_toml("x = 1".encode("utf-16"))


def test_a_file_is_not_read_beyond_its_limit(tmp_path):
    """Nor what is no regular file."""
    (tmp_path / "long.toml").write_bytes(b"#" * (LARGEST + 1))
    for name in ("long.toml", "."):
        with pytest.raises(OSError, match=r"allowed: up to 1000000|is a folder"):
            read_toml(tmp_path / name)
