"""Measured parts against a campaign in a store: by the function and by the command."""

import json

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import clearcap
from campaign.errors import SpecError
from clearcap.cli import app
from tests.campaign.driving import computed


def test_parts_are_compared_with_the_samples_of_a_campaign(campaign, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    store, plan = computed(tmp_path / "runs", campaign, 10)
    simulated = store.table().to_pandas()
    rng = np.random.default_rng(1)
    rows = simulated[["FC-1", "FC-2"]].to_numpy()[rng.integers(0, len(simulated), 60)] + [0.5, 0.0]
    pd.DataFrame(rows, columns=["FC-1", "FC-2"]).to_csv("parts.csv", index=False)
    found = clearcap.validate_campaign("parts.csv", plan.campaign_id)
    force, other = found.predictions
    assert [each.comparison.response for each in found.predictions] == ["FC-1", "FC-2"]
    assert force.comparison.mean_difference == pytest.approx(rows[:, 0].mean() - simulated["FC-1"].mean())
    assert "above the predicted one" in force.verdict
    assert "no difference is seen" in other.verdict
    printed = CliRunner().invoke(app, ["validate", plan.campaign_id, "parts.csv"])
    assert printed.exit_code == 0, printed.output
    assert f"FC-1: {force.verdict}" in printed.stdout
    document = json.loads(CliRunner().invoke(app, ["validate", plan.campaign_id, "parts.csv", "--json"]).stdout)
    assert document["predictions"][0]["mean_within"] == pytest.approx(force.mean_within)
    limits = {"characteristics": {"FC-1": {"unit": "N", "column": "F"}}}
    named = pd.DataFrame({"F": rows[:, 0]})
    assert clearcap.validate_campaign(named, limits=limits).predictions == (force,)
    for table, given in ((named, None), (named, {"characteristics": {"FC-1": {"unit": "mm", "column": "F"}}})):
        with pytest.raises(SpecError, match="FC-1"):
            clearcap.validate_campaign(table, limits=given)
