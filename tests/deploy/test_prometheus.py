"""Alerts and dashboard ask only for what the server tells, with labels and values that it has."""

import json
import re

import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families

from campaign.waits import SENTENCES
from clearcap.web.index import LISTED_STATES
from tests.deploy.descriptors import DEPLOY, documents

FOLDER = DEPLOY / "prometheus"
[ALERTS] = documents(FOLDER / "alerts.yaml")
RULES = [rule for group in ALERTS["groups"] for rule in group["rules"]]
DASHBOARD = json.loads((FOLDER / "dashboard.json").read_text())
EXPRESSIONS = [rule["expr"] for rule in RULES] + [t["expr"] for p in DASHBOARD["panels"] for t in p["targets"]]


@pytest.fixture
def told(tmp_path):
    """Return the names of all samples that a server tells, with their labels."""
    from starlette.testclient import TestClient

    from clearcap.web.access import Role
    from clearcap.web.server import make_app
    from clearcap.web.settings import Settings
    from clearcap.web.web_service import open_service

    (tmp_path / "runs").mkdir()
    service = open_service(Settings(str(tmp_path / "runs"), tmp_path / "data", processes=0))
    service.users.add("prometheus", Role.VIEWER)
    secret = service.tokens.add("prometheus", "scrape", Role.VIEWER, 60.0)[1]
    with TestClient(make_app(service), base_url="https://localhost") as client:
        client.get("/login")
        text = client.get("/metrics", headers={"Authorization": f"Bearer {secret}"}).text
    return {sample.name: set(sample.labels) for each in text_string_to_metric_families(text) for sample in each.samples}


def test_each_metric_is_told(told):
    """And each that is told, but those of the process, is in an alert or on the dashboard."""
    asked = {name for text in EXPRESSIONS for name in re.findall(r"\b(?:clearcap|process)_\w+", text)}
    assert asked <= set(told)
    assert {n for n in told if n.startswith("clearcap") and not n.endswith(("_created", "_sum", "_count"))} <= asked


def test_labels_have_these_values():
    """A state or a wait that no longer exists would never raise an alarm."""
    known = {"state": {*LISTED_STATES, "running", "waiting"}, "what": set(SENTENCES)}
    for text in EXPRESSIONS:
        for label, operator, value in re.findall(r'(\w+)(=~?)"([^"]*)"', text):
            if label in known:
                assert set(value.split("|") if operator == "=~" else [value]) <= known[label], text


def test_each_alert_has_a_remedy():
    for rule in RULES:
        assert set(rule["annotations"]) == {"summary", "remedy"}
        assert rule["labels"]["severity"] in ("critical", "warning")


def test_only_a_token_scrapes():
    [scrape] = yaml.safe_load((FOLDER / "scrape.yaml").read_text())["scrape_configs"]
    assert "credentials_file" in scrape["authorization"]
    assert scrape["scheme"] == "https"
