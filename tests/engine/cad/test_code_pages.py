"""Names in the code page of a computer are read as they were written."""

import pytest

from engine.cad import read_step
from engine.cad.step_reader import as_utf8
from tests.engine.cad.step_files import Drawing, box

FILES = {
    "utf-8": ["Geh\u00e4use", "\u8ef8\u53d7\u3051"],
    "cp932": ["\u30d9\u30fc\u30b9", "\u6b6f\u8eca A", "\u30ab\u30d0\u30fc\uff08\u4e0a\uff09", "\u8868\u793a"],
    "cp850": ["Geh\u00e4use", "\u00d6se", "Deckel f\u00fcr Welle", "palanca peque\u00f1a"],
    "latin-1": ["Geh\u00e4use", "Gr\u00f6\u00dfe", "\u00e9crou", "Ma\u00df 5 \u00b0"],
    "cp1252": ["l\u2019\u00e9crou", "Bolzen \u2013 gro\u00df"],
}


def test_every_code_page():
    """Each file is in one; ASCII stays what it is."""
    for encoding, names in FILES.items():
        text = "".join(f"#{i} = PRODUCT('{name}','{name}','',(#8));\n" for i, name in enumerate(names, 1))
        assert as_utf8(text.encode(encoding)).decode() == text, encoding
    plain = b"#1 = PRODUCT('pin','pin','',(#8));\n"
    assert as_utf8(plain) is plain


@pytest.mark.processes
def test_a_file_from_japan(tmp_path):
    """The names of its parts, also those with bytes that STEP would take for something else."""
    made = Drawing()
    top = made.assembly("top")
    for name in ("AAA", "BBB"):
        made.add(top, made.product(name, box((0, 0, 0), (1, 1, 1))))
    path = made.write(tmp_path / "japan.step")
    names = {b"AAA": "\u8868\u793a", b"BBB": "\u30d9\u30fc\u30b9"}  # the first one has a backslash in it
    content = path.read_bytes()
    for old, new in names.items():
        content = content.replace(old, new.encode("cp932"))
    path.write_bytes(content)
    assert [part.name for part in read_step(path).parts] == list(names.values())
