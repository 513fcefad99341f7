"""The recipes of docs/modelling.md run, and give the numbers that the page states."""

import re
import tomllib
from pathlib import Path

import pytest

from engine import simulate
from engine.errors import MechanismError
from engine.mechanism import mechanism_from
from engine.mechanism.closest import RECIPES as TITLES
from engine.mechanism.closest import recipe_for
from tests.engine.small import block_on_floor, made

PAGE = (Path(__file__).parents[2] / "docs" / "modelling.md").read_text(encoding="utf-8")
HEADER, *RECIPES = re.split(r"^## ", PAGE, flags=re.M)
FOUND = {text.split("\n", 1)[0]: text for text in RECIPES if "```toml" in text}


def toml(text: str) -> str:
    """Return the lines of a text's example."""
    return text.split("```toml\n")[1].split("```")[0]


@pytest.mark.parametrize("title", FOUND)
def test_a_recipe_gives_what_it_says(title):
    """To 0.1 %: the page rounds."""
    data = tomllib.loads(toml(HEADER)) | {"bodies": {}}
    recipe = tomllib.loads(toml(FOUND[title]))
    data = {**data, **recipe, "bodies": tomllib.loads(toml(HEADER))["bodies"] | recipe["bodies"]}
    run = simulate(mechanism_from(data, title))
    assert run.status == "ok", run.message
    stated = re.findall(r"`(\w+) = ([\d.]+)`", FOUND[title].split("```")[-1])
    assert stated
    assert {n: run.responses[n] for n, _ in stated} == {n: pytest.approx(float(v), rel=1e-3) for n, v in stated}


def test_an_unknown_key_or_type_names_its_recipe():
    """Each title is one of the page."""
    assert TITLES.keys() <= {text.split("\n", 1)[0] for text in PAGE.split("\n## ")}
    data = block_on_floor()
    data["contacts"]["corner_0"]["a"]["mesh"] = {"file": "a.stl"}
    data["joints"] = {"pair": {"type": "gear"}}
    data["solenoids"] = {}
    with pytest.raises(MechanismError) as caught:
        made(data)
    for title in ("What there is none of yet", "A pair of gears", "A solenoid or magnet"):
        assert f'see "{title}' in str(caught.value)


def test_a_word_within_another_asks_for_no_recipe():
    assert [word for word in ("bracket", "track_width", "pressure", "rebound") if recipe_for(word)] == []
    assert "A rack, a screw" in recipe_for("drive-rack")
