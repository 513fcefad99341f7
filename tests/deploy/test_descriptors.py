"""Every descriptor in deploy/ uses verbs, options and settings that clearcap and dask know."""

import asyncio
import re
import shlex
from importlib import resources

import dask
import jsonschema
import yaml
from distributed import Scheduler, Security
from tornado.httpclient import AsyncHTTPClient
from typer.main import get_command

from clearcap.cli import app
from tests.deploy.descriptors import DEPLOY, ROLES, documents, pods


def clearcap_commands():
    """Return the words of every command of clearcap in the descriptors, by where it stands."""
    [compose] = documents(DEPLOY / "compose.yaml")
    unit = (DEPLOY / "systemd/clearcap-coordinator.service").read_text()
    web = (DEPLOY / "systemd/clearcap-web.service").read_text()
    script = (DEPLOY / "batch/allocation.sh").read_text()
    run = re.search(r"^(clearcap run (?:.*\\\n)*.*) &$", script, re.M)[1].replace("\\\n", " ")
    found = {
        "compose": compose["services"]["coordinator"]["command"],
        "systemd": shlex.split(re.search(r"^ExecStart=/opt/clearcap/bin/(.*)", unit, re.M)[1]),
        "compose web": compose["services"]["web"]["command"],
        "systemd web": shlex.split(re.search(r"^ExecStart=/opt/clearcap/bin/(.*)", web, re.M)[1]),
        "allocation": shlex.split(run),
    }
    return found | {name: pod["containers"][0]["args"] for name, pod in pods() if ROLES[name] in ("client", None)}


def test_clearcap_commands():
    """The command knows every verb and option that the descriptors use."""
    found = clearcap_commands()
    assert set(found) == {"compose", "systemd", "allocation", "coordinator", "job", "web", "compose web", "systemd web"}
    for words in found.values():
        assert words[0] == "clearcap"
        command = get_command(app).commands[words[1]]
        command.make_context(words[1], list(map(str, words[2:])))


def test_dask_settings():
    """deploy/dask.yaml is of dask's own schema, sets nothing dask does not know, and makes TLS the only way."""
    [settings] = documents(DEPLOY / "dask.yaml")
    schema = yaml.safe_load(resources.files("distributed").joinpath("distributed-schema.yaml").read_text())
    defaults = yaml.safe_load(resources.files("distributed").joinpath("distributed.yaml").read_text())
    jsonschema.validate(dask.config.merge(defaults, settings), schema)
    assert not list(unknown(settings, defaults))
    with dask.config.set(dask.config.merge(dask.config.config, settings)):
        security = Security()
        assert security.require_encryption
        assert security.tls_worker_key == "/etc/clearcap/tls/worker.key"


def test_http_says_no_more_than_health():
    """With deploy/dask.yaml a scheduler answers /health, and nothing else of what dask would show to anybody."""
    [settings] = documents(DEPLOY / "dask.yaml")
    assert settings["distributed"]["worker"]["http"] == settings["distributed"]["scheduler"]["http"]
    pages = ("health", "metrics", "info/main/workers.html", "json/identity.json", "json/counts.json")
    routes = settings["distributed"]["scheduler"]["http"]["routes"]
    assert asyncio.run(answers(routes, pages)) == dict.fromkeys(pages, 404) | {"health": 200}
    usual = dask.config.get("distributed.scheduler.http.routes")
    assert asyncio.run(answers(usual, pages))["json/identity.json"] == 200


async def answers(routes, pages):
    """Return the status with which a scheduler with these routes answers each page."""
    with dask.config.set({"distributed.scheduler.http.routes": routes}):
        async with Scheduler(host="127.0.0.1", port=0, dashboard_address="127.0.0.1:0", dashboard=False) as scheduler:
            root = f"http://127.0.0.1:{scheduler.http_server.port}"
            client = AsyncHTTPClient()
            return {page: (await client.fetch(f"{root}/{page}", raise_error=False)).code for page in pages}


def unknown(settings, defaults, path=()):
    """Yield the keys of a table that another has not."""
    for key, value in settings.items():
        if key not in defaults:
            if path[-1:] != ("pre-spawn-environ",):
                yield ".".join((*path, key))
        elif isinstance(value, dict):
            yield from unknown(value, defaults[key], (*path, key))
