"""The example of the documentation is a campaign."""

import re
from pathlib import Path

from campaign.load import load_campaign


def test_example_loads(tmp_path):
    """The file shown in docs/campaign.md is sound."""
    text = (Path(__file__).parents[2] / "docs" / "campaign.md").read_text()
    path = tmp_path / "example.toml"
    path.write_text(re.search(r"```toml\n(.*?)```", text, re.DOTALL)[1])
    spec = load_campaign(str(path)).spec
    assert spec.name == "breaker"
    assert spec.responses["FC-2"].limits() == (10.35, 10.85, 10.6)
    assert spec.simulation.horizon == 30.0
