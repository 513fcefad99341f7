"""Cost files."""

import re
import tomllib
from pathlib import Path

import pytest

from campaign.errors import SpecError
from clearcap.questions.tolerances import Costs, read_costs
from reporting.tolerance.allocation import CostedVariable, Requirement, allocate
from reporting.tolerance.cost_laws import ExponentialLaw, PowerLaw, ProcessTable
from tests.each import each

PAGE = Path(__file__).parents[3] / "docs" / "report.md"


@each(
    ("text", "said"),
    [
        ("", "variables"),
        ("[variables.J1]\ncost = -1", "variables.J1.cost"),
        ("[variables.J9]\ncost = 1", "variables.J9: the campaign has no such variable"),
        ("target = [", "not TOML"),
        ("[variables.J1]", "variables.J1: has no cost; add cost, or processes"),
        ("[variables.J1]\ncost = 1\npower = 2\nscale = 1", "variables.J1: has power and scale"),
        ("[variables.J1]\ncost = 1\npower = 0", "variables.J1.power"),
        ("[variables.J1]\ncost = 1\nprocesses = [{std = 0.1, cost = 1.0}]", "variables.J1: has cost beside processes"),
        ("[variables.J1]\nprocesses = []", "variables.J1.processes"),
        ("[variables.J1]\nprocesses = [{std = 0.0, cost = 1.0}]", "variables.J1.processes.0.std"),
        ("[variables.J1]\nprocesses = [{cost = 1.0}]", "variables.J1.processes.0.std: missing"),
        ("[variables.J1]\ncost = 1\nlower = 2.0\nupper = 1.0", "variables.J1: lower = 2 is above upper = 1"),
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


def test_the_example_of_the_page_has_a_cheapest_set():
    """Each of its variables has another law, and the proposal keeps the target."""
    (text,) = [t for t in re.findall(r"^```toml\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S) if "cost" in t]
    costs = Costs.model_validate(tomllib.loads(text))
    laws = {name: cost.law() for name, cost in costs.variables.items()}
    assert [type(law) for law in laws.values()] == [PowerLaw, PowerLaw, ExponentialLaw, PowerLaw, ProcessTable]
    variables = [
        CostedVariable(name, 0.0174, law, cost.lower or 0.00174, cost.upper or 0.174, cost.locked)
        for (name, law), cost in zip(laws.items(), costs.variables.values(), strict=True)
    ]
    wanted = Requirement("gap", 10.0, 0.04, 9.85, 10.15, costs.target, dict.fromkeys(laws, 0.2))
    found = allocate(variables, [wanted])
    assert found.responses[0].cpk >= costs.target
    assert found.tolerances["J4"] == 0.0174
    assert found.processes["J5"] in ("drilled", "reamed", "honed")
