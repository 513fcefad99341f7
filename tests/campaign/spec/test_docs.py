"""The examples in docs/campaign.md load, and it explains every distribution."""

import re
from pathlib import Path

import pytest

from campaign.inputs.distributions import DISTRIBUTIONS
from campaign.inputs.sampling import draw
from campaign.spec.load import load_campaign

TEXT = (Path(__file__).parents[3] / "docs" / "campaign.md").read_text()
EXAMPLES = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
HEAD = 'format = 1\nname = "example"\nmechanism = "c60"\n'


def test_example_loads(tmp_path):
    """The file shown at the top of docs/campaign.md loads."""
    path = tmp_path / "example.toml"
    path.write_text(EXAMPLES[0])
    spec = load_campaign(str(path)).spec
    assert spec.name == "breaker"
    assert spec.responses["FC-2"].limits() == (10.35, 10.85, 10.6)
    assert spec.simulation.horizon == 30.0


def test_policies_load(tmp_path):
    """The tables shown for failures and for the stopping rule load together with the first example."""
    path = tmp_path / "example.toml"
    path.write_text(EXAMPLES[0] + "".join(EXAMPLES[3:]))
    spec = load_campaign(str(path)).spec
    assert [settings.step for settings in spec.failures.retry] == [1e-3, 5e-4]
    assert (spec.execution.time_limit, spec.stop.half_width, spec.samples) == (60.0, 0.02, 500)


@pytest.mark.parametrize("text", EXAMPLES[1:3], ids=["variables", "samples"])
def test_fragments_load(tmp_path, text):
    """The variables and samplers shown load, and their samples can be drawn."""
    path = tmp_path / "example.toml"
    path.write_text(HEAD + text)
    spec = load_campaign(str(path)).spec
    assert all(len(x) == spec.samples for x in draw(spec, 0, spec.samples).values())


def test_every_distribution_and_key_is_explained():
    """The table of distributions names each of them and all its keys."""
    rows = dict(re.findall(r"^\| `(\w+)` \|(.*)\|$", TEXT[TEXT.index("## Variables") :], re.MULTILINE))
    common = {"target", "distribution", "lower", "upper", "batch", "within"}
    for name, model in DISTRIBUTIONS.items():
        keys = set(model.model_fields) - common
        assert all(f"`{key}`" in rows[name] for key in keys), name
