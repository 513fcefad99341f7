"""The recipes of docs/modelling.md run, and give the numbers that the page states."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from engine import simulate
from engine.errors import MechanismError
from engine.mechanism import mechanism_from
from engine.mechanism.closest import RECIPES as TITLES
from engine.mechanism.closest import recipe_for
from tests.engine.small import block_on_floor, made

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "modelling.md").read_text(encoding="utf-8")
FOUND = {text.split("\n", 1)[0]: text for text in re.split(r"^## ", PAGE, flags=re.M)[1:] if "```toml" in text}


def recipe(title: str) -> dict[str, Any]:
    """Return the tables of the complete file that a section links."""
    (name,) = re.findall(r"\]\((examples/recipes/\w+\.toml)\)", FOUND[title])
    return tomllib.loads((DOCS / name).read_text("utf-8"))


def is_part(shown: object, whole: object) -> bool:
    """Whether each table and key shown is in the whole with the same value; what is no table must be equal."""
    if isinstance(shown, dict) and isinstance(whole, dict):
        return all(key in whole and is_part(value, whole[key]) for key, value in shown.items())
    return shown == whole


@pytest.mark.parametrize("title", FOUND)
def test_a_recipe_gives_what_it_says(title):
    """To 0.1 %: the page rounds. What it shows of the file is in the file."""
    data = recipe(title)
    assert is_part(tomllib.loads(FOUND[title].split("```toml\n")[1].split("```")[0]), data)
    run = simulate(mechanism_from(data, title))
    assert run.status == "ok", run.message
    stated = re.findall(r"`(\w+) = ([\d.]+)`", FOUND[title].split("```")[-1])
    assert stated
    assert {n: run.responses[n] for n, _ in stated} == {n: pytest.approx(float(v), rel=1e-3) for n, v in stated}


def test_every_file_is_of_a_recipe():
    """No file is left over, and each is called what the page calls it."""
    files = {path.stem for path in (DOCS / "examples" / "recipes").glob("*.toml")}
    assert files == {recipe(title)["name"] for title in FOUND}
    assert [recipe(title)["title"] for title in FOUND] == list(FOUND)


def test_an_unknown_key_or_type_names_its_recipe():
    """Each title is one of the page."""
    assert TITLES.keys() <= {text.split("\n", 1)[0] for text in PAGE.split("\n## ")}
    data = block_on_floor()
    data["contacts"]["corner_0"]["a"]["snap"] = {}
    data["joints"] = {"pair": {"type": "gear"}}
    data["contacts"]["corner_1"]["anisotropic_friction"] = [0.2, 0.5]
    data["solenoids"] = {}
    with pytest.raises(MechanismError) as caught:
        made(data)
    for title in ("What there is none of yet", "A pair of gears", "A solenoid or magnet", "Friction along"):
        assert f'see "{title}' in str(caught.value)


def test_a_word_within_another_asks_for_no_recipe():
    assert [word for word in ("bracket", "track_width", "pressure", "rebound") if recipe_for(word)] == []
    assert "A rack, a screw" in recipe_for("drive-rack")
