"""Every `curl` of docs/examples/api.sh is answered, one after the other, by a server in a process of its own."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from clearcap.web.access import Role
from clearcap.web.settings import Settings
from clearcap.web.web_service import open_service
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.clearcap.web.journeys.live_server import live_server
from tests.clearcap.web.routes import all_ways
from tests.clearcap.web.running import PATIENCE
from tests.engine.mechanism.geometry.latch_file import LATCH

pytestmark = [
    pytest.mark.slow,
    pytest.mark.processes,
    pytest.mark.skipif(shutil.which("curl") is None, reason="no curl on this machine"),
]
TEXT = (Path(__file__).parents[4] / "docs/examples/api.sh").read_text("utf-8")
LINES = [line for line in TEXT.splitlines() if re.match("curl |python3 ", line)]
WITHOUT_LINE = {  # only a browser may give access, and the last needs a host that answers
    *(
        "PUT /api/v1/account/password",
        "POST /api/v1/tokens",
        "POST /api/v1/users",
        "POST /api/v1/users/{name}/login-link",
    ),
    "POST /api/v1/webhooks",
}
CURL = "curl --silent --show-error --max-time 600 --write-out '\\n%{http_code}' "


def _finished(folder, seed):
    """Compute a campaign with a stand-in for the physics; return its id."""
    path = folder / f"seed-{seed}.toml"
    path.write_text(SPEC.replace("seed = 7", f"seed = {seed}"))
    store, plan = computed(folder / "runs", load_campaign(str(path)), 10)
    write_state(store, plan.campaign_id, "completed")
    return plan.campaign_id


@pytest.fixture(scope="module")
def words(tmp_path_factory):
    """Return the variables of the examples, while a server answers over two finished campaigns, and a folder."""
    folder = tmp_path_factory.mktemp("curl")
    known = {"ID": _finished(folder, 7), "OTHER": _finished(folder, 8)}
    service = open_service(Settings(str(folder / "runs"), folder / "data", processes=0))
    service.users.add("admin", Role.ADMIN)
    service.users.add("bob", Role.VIEWER)
    secrets = [service.tokens.add("admin", name, Role.ADMIN, 3600.0)[1] for name in ("to be revoked", "examples")]
    service.webhooks.add("admin", None, "https://quality.example/clearcap", service.events())
    service.close()
    shutil.copy(LATCH, folder / "latch.step")
    (folder / "parts.csv").write_text("\n".join(["d", *(f"{20 + row % 7 / 1000}" for row in range(30))]))
    (folder / "night.csv").write_text("\n".join(["J1", *(f"{0.04 + row / 1000}" for row in range(61))]))
    (folder / "limits.toml").write_text('[characteristics.d]\nunit = "mm"\nlsl = 19.9\nusl = 20.1\n')
    with live_server(folder, "--no-drive") as server:
        yield {**known, "AUTH": f"Authorization: Bearer {secrets[1]}", "URL": server.url}, folder


def _ask(line, known, folder):
    """Run a line in a shell, as its reader does; return the status and what it printed."""
    done = subprocess.run(
        ["bash", "-c", line.replace("curl ", CURL, 1)],
        cwd=folder,
        env={**os.environ, **known},
        capture_output=True,
        timeout=PATIENCE,
        check=False,
    )
    if not line.startswith("curl "):
        return (500 if done.returncode else 200), done.stderr.decode(errors="replace")
    body, _, status = done.stdout.decode(errors="replace").rpartition("\n")
    return int(status or 0), body or done.stderr.decode(errors="replace")


def test_every_example_is_answered(words):
    """None is refused; what later examples name comes from the answers of earlier ones."""
    known, folder = words
    _, text = _ask('curl -H "$AUTH" -X POST "$URL/api/v1/campaigns/$ID/report"', known, folder)
    assert "report.html" in text  # what is signed below
    refused = []
    for line in LINES:
        status, text = _ask(line, known, folder)
        if not 200 <= status < 400:
            refused.append((line, status, text[:300]))
        found = re.search(r'"content":\s*"([0-9a-f]{64})"', text)
        if found:
            known["CONTENT"] = found[1]
        if "limits=@" in line and status == 201:
            known["PARTS"] = json.loads(text)["id"]
        if "Idempotency-Key" in line and status == 201:
            known["NEW"] = json.loads(text)["campaign"]
    assert refused == []


def test_every_call_has_an_example():
    """A new call without a line fails here."""
    asked = [_method_and_path(line) for line in LINES if line.startswith("curl ")]
    missing = []
    for way in all_ways():
        pattern = re.sub(r"\\{[^}]+\\}", "[^/]+", re.escape(way.path))
        known = any(method == way.method and re.fullmatch(pattern, path) for method, path in asked)
        if way.route.include_in_schema and not known:
            missing.append(str(way))
    assert sorted(missing) == sorted(WITHOUT_LINE)


def _method_and_path(line):
    """Return what a line asks."""
    named = re.search(r"-X (\w+)", line)
    method = named[1] if named else "POST" if re.search(r"--json| -F ", line) else "GET"
    return method, re.search(r'"\$URL([^"?]*)', line)[1]
