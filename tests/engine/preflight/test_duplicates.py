"""A joint or a contact that is written twice."""

import pytest

from engine.preflight import cautions
from tests.engine.small import block_on_floor, made, shipped


@pytest.mark.parametrize(("table", "name"), [("joints", "J1"), ("contacts", "corner_0")])
def test_what_is_written_twice_is_named(table, name):
    """Under another name, with the same content."""
    data = shipped("four_bar") if table == "joints" else block_on_floor(origin=[0, 0, 0.1])
    data[table]["again"] = data[table][name]
    found = [caution for caution in cautions(made(data)) if caution.key == f"{table}.again"]
    assert len(found) == 1
    assert f"the same as {table}.{name}" in str(found[0])
