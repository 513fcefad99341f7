"""Cost files."""

import pytest

from campaign.errors import SpecError
from campaign.reports.cost_file import read_costs


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "variables"),
        ("[variables.J1]\ncost = -1", "variables.J1.cost"),
        ("[variables.J9]\ncost = 1", "variables.J9: the campaign has no such variable"),
        ("target = [", "not TOML"),
    ],
)
def test_a_cost_file_with_a_fault_is_one_message(plan, tmp_path, text, said):
    """It names file and key."""
    path = tmp_path / "costs.toml"
    path.write_text(text)
    with pytest.raises(SpecError, match=r"costs\.toml") as error:
        read_costs(path, plan)
    assert said in str(error.value)
    with pytest.raises(SpecError, match="No such file"):
        read_costs(tmp_path / "none.toml", plan)
