"""The page of what was found: what a browser may do with it, what it holds, and that names are only text."""

import base64
import hashlib
import json
import re
from collections import Counter
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest

from clearcap.import_page import MOST_TRIANGLES
from engine.cad_import.found_features import found_features
from engine.cad_import.proposed_mechanism import proposed_mechanism
from engine.cad_import.proposed_text import open_questions
from tests.clearcap.import_page.conftest import HOSTILE, written
from tests.engine.cad.occt.test_triangulation import volume_of

pytestmark = pytest.mark.processes


class Page(HTMLParser):
    """The elements of a page, its text, and the content of scripts and styles."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.inside, self.text, self.sources = [], [], "", []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        """Keep an element."""
        self.elements.append((tag, dict(attributes)))
        self.inside.append(tag)
        if tag in ("script", "style"):
            self.sources.append([tag, dict(attributes), ""])

    def handle_endtag(self, tag):
        """Leave it."""
        while self.inside and self.inside.pop() != tag:
            pass

    def handle_data(self, data):
        """Keep a text, of a script or of the page."""
        if self.inside and self.inside[-1] in ("script", "style"):
            self.sources[-1][2] += data
        else:
            self.text += data

    @property
    def data(self):
        """What the script draws."""
        [text] = [source for _, attributes, source in self.sources if attributes.get("id") == "data"]
        return json.loads(text)


@pytest.fixture(scope="module")
def page(latch, tmp_path_factory):
    return Page(written(latch, tmp_path_factory.mktemp("page")).read_text())


@pytest.fixture(scope="module")
def hostile_page(hostile, tmp_path_factory):
    return Page(written(hostile, tmp_path_factory.mktemp("page"), step=HOSTILE).read_text())


def test_policy(page):
    """Only what the page brings is run, each by its hash; nothing is loaded or sent."""
    [policy] = [a["content"] for tag, a in page.elements if a.get("http-equiv") == "Content-Security-Policy"]
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert rules["img-src"] == "data:"

    def hashes(kind):
        run = [text for tag, attributes, text in page.sources if tag == kind and not attributes]
        digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in run]
        return " ".join(f"'sha256-{digest}'" for digest in digests)

    assert rules["script-src"] == hashes("script")
    assert rules["style-src"] == hashes("style")
    assert rules.keys() == {"default-src", "script-src", "style-src", "img-src", "base-uri", "form-action"}


def test_nothing_comes_from_elsewhere(page):
    """Every address is a place of the page or lies in it."""
    addresses = [value for _, a in page.elements for key, value in a.items() if key in ("src", "href")]
    assert len(addresses) == 3
    assert all(address.startswith(("#", "data:")) for address in addresses)


def test_numbers_are_those_of_the_file(page, latch):
    """Joints and candidates are named, and questions numbered by their lines, as in the mechanism file."""
    text = proposed_mechanism(latch, "latch.step", "latch")
    tables = re.findall(r"^(?:# )?\[(?:joints|contacts)\.([\w-]+)\]", text, re.M)
    assert [place["name"] for place in page.data["places"]] == tables
    assert all(name in page.text for name in tables)
    lines = text.splitlines()
    for question in open_questions(text):
        assert f"line {question.line}" in page.text
        assert question.text in page.text
        assert lines[question.line - 1] == f"#? {question.text}"


def test_triangles_are_the_parts(page, latch):
    """The volume of each part is that of its solid, up to the deflection; faces of joints are as large as drawn."""
    areas = {face.number: face.area for face in latch.assembly.faces}
    for part, drawn, mesh in zip(latch.assembly.parts, page.data["parts"], latch.assembly.meshes, strict=True):
        vertices = np.frombuffer(base64.b64decode(drawn["vertices"]), "<f4").reshape(-1, 3).astype(float)
        triangles = np.frombuffer(base64.b64decode(drawn["triangles"]), "<u4").reshape(-1, 3)
        shape = SimpleNamespace(vertices=vertices, triangles=triangles)
        surface = sum(face.area for face in latch.assembly.faces_of(part.name))
        assert abs(volume_of(shape) - part.solids[0].volume) <= mesh.deflection * surface
        assert drawn["name"] == latch.bodies[part.name]
        for number, (first, count) in zip(drawn["numbers"], drawn["faces"], strict=True):
            a, b, c = np.moveaxis(vertices[triangles[first : first + count]], 1, 0)
            area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
            assert area == pytest.approx(areas[number], rel=0.01)
    numbers = {number for part in page.data["parts"] for number in part["numbers"]}
    assert numbers == {number for place in found_features(latch) for number in place.faces}


def test_names_are_only_text(page, hostile_page, hostile):
    """What a CAD file calls its parts and materials makes no element, and is there in full."""
    tags, hostile_tags = (Counter(tag for tag, _ in each.elements) for each in (page, hostile_page))
    assert hostile_tags - tags == Counter(["section", "h2", "ul", "li"])  # of what was left out
    assert not tags - hostile_tags
    assert hostile_page.text.count(HOSTILE) >= 4
    assert hostile.bodies[HOSTILE] in {part["name"] for part in hostile_page.data["parts"]}


def test_size_is_bounded(latch, tmp_path, monkeypatch):
    """More triangles than a browser turns with ease are drawn coarser, and the page says how coarse."""
    whole = written(latch, tmp_path).read_text()
    assert "by triangles, about 0.0500 mm" in whole
    monkeypatch.setattr("clearcap.import_page.MOST_TRIANGLES", 300)
    small = written(latch, tmp_path).read_text()
    data = Page(small).data
    count = sum(len(base64.b64decode(part["triangles"])) // 12 for part in data["parts"])
    assert 80 < count <= 300 < MOST_TRIANGLES
    assert "by triangles, about 0.0500 mm" not in small
    assert len(small) < len(whole) < 800_000
