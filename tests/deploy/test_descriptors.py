"""Every descriptor in deploy/ is accepted by the parser of the tool it is for, and keeps what is promised of it."""

import asyncio
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from importlib import resources
from ipaddress import ip_address, ip_network
from pathlib import Path

import dask
import jsonschema
import kubernetes_validate
import pytest
import yaml
from distributed import Scheduler, Security
from distributed.cli.dask_scheduler import main as dask_scheduler
from distributed.cli.dask_worker import main as dask_worker
from tornado.httpclient import AsyncHTTPClient
from typer.main import get_command

from campaign.cli import app
from campaign.web.settings import LOOPBACK, PORT

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
ROLES = {"scheduler": "scheduler", "worker": "worker", "coordinator": "client", "job": "client", "web": None}


def documents(path):
    """Return the documents of a YAML file."""
    return list(yaml.safe_load_all(path.read_text()))


def output(*command, **more):
    """Return what a command prints; it must succeed and complain of nothing."""
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not done.stderr, done.stderr
    return done.stdout


def needs(command, package):
    """Return the mark of a test that needs a command."""
    return pytest.mark.skipif(not shutil.which(command), reason=f"needs {command}: apt-get install {package}")


def check_dask(words):
    """Have dask's own parser read a command, and see that it says what every one must."""
    words = list(map(str, words))
    if words[0] == "enter":
        words = words[1:]
    assert words[0] == "dask"
    main = {"scheduler": dask_scheduler, "worker": dask_worker}[words[1]]
    options = main.make_context(words[1], words[2:]).params
    assert options["protocol"] == "tls"
    assert not options["dashboard"]
    assert options["dashboard_address"].startswith("127.0.0.1:")
    if words[1] == "worker":
        assert options["nthreads"] == 1
        assert options["n_workers"]
        assert options["scheduler_file"] or options["scheduler"].startswith("tls://")


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


# ---- dask ------------------------------------------------------------------------------------------------------------


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


# ---- compose ---------------------------------------------------------------------------------------------------------


@needs("docker-compose", "docker-compose")
def test_compose():
    """docker-compose reads compose.yaml; nothing is published, and each role has its own certificate only."""
    command = ("docker-compose", "-f", DEPLOY / "compose.yaml", "--project-directory", ROOT, "config")
    settings = yaml.safe_load(output(*command, env=os.environ | {"CLEARCAP_MEMORY": "2g"}))
    services = settings["services"]
    assert set(services) == {"scheduler", "worker", "coordinator", "web"}
    assert settings["networks"]["inside"] == {"internal": True}
    proxy = services["web"]["command"][services["web"]["command"].index("--proxy") + 1]
    [subnet] = settings["networks"]["pages"]["ipam"]["config"]
    assert ip_address(proxy) == next(ip_network(subnet["subnet"]).hosts())
    for name, service in services.items():
        assert service["restart"] == "always"
        assert service["read_only"]
        assert [published.split(":")[0] for published in service.get("ports", [])] == ["127.0.0.1"] * (name == "web")
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert service["cap_drop"] == ["ALL"]
        assert service["mem_limit"]
        assert service["pids_limit"] <= 4096
        assert "cpus" in service
        assert list(service["networks"]) == ["pages" if name == "web" else "inside"]
        files = {volume.split(":")[1] for volume in service["volumes"] if "/tls/" in volume}
        expected = ("ca.pem", f"{ROLES[name]}.pem", f"{ROLES[name]}.key") if ROLES[name] else ()
        assert files == {f"/etc/clearcap/tls/{file}" for file in expected}
        if name in ("scheduler", "worker"):
            check_dask(service["command"])
    with pytest.raises(AssertionError, match="how much memory"):
        output(*command, env={k: v for k, v in os.environ.items() if k != "CLEARCAP_MEMORY"})


def test_dockerfile():
    """Hadolint has nothing to say, and what is copied is there."""
    hadolint = Path(sys.executable).with_name("hadolint")
    assert not output(hadolint, "--no-color", DEPLOY / "Dockerfile")
    text = (DEPLOY / "Dockerfile").read_text()
    sources = [word for line in re.findall(r"^COPY (?!--from)(.*)", text, re.M) for word in line.split()[:-1]]
    assert len(sources) >= 6
    assert all((ROOT / source).exists() for source in sources)
    assert "\nUSER 10001\n" in text
    assert set(re.findall(r"^FROM (\S+)", text, re.M)) == {"${BASE}"}
    assert 'RUN ./has_digest.sh "$BASE"' in text


DIGEST = f"sha256:{'0123456789abcdef' * 4}"


def test_an_image_has_every_package():
    """What `pip install` installs is copied into the image, and is not hidden from the build."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    packages = {name.rstrip("*") for name in settings["tool"]["setuptools"]["packages"]["find"]["include"]}
    copied = set(re.findall(r"^COPY (\w+) \w+$", (DEPLOY / "Dockerfile").read_text(), re.M))
    shown = set(re.findall(r"^!(\w+)$", (DEPLOY / "Dockerfile.dockerignore").read_text(), re.M))
    assert packages == copied == shown - {"LICENSE"}


@pytest.mark.parametrize("image", [f"clearcap@{DIGEST}", f"registry.example:5000/a/clear-cap_1@{DIGEST}"])
def test_an_image_by_digest(image):
    """It is put into every manifest that has an image."""
    manifests = [path for path in sorted((DEPLOY / "kubernetes").glob("*.yaml")) if "image:" in path.read_text()]
    assert len(manifests) == 4
    printed = output(DEPLOY / "kubernetes/with_image.sh", image, *manifests)
    assert "DIGEST" not in printed
    found = [pod["containers"][0]["image"] for document in yaml.safe_load_all(printed) for _, pod in pods_in(document)]
    assert found == [image] * len(list(pods()))


@pytest.mark.parametrize(
    "image",
    ["", "clearcap", "clearcap:1.0", "clearcap@sha256:12", f"a|b@{DIGEST}", f"x@{DIGEST}\ny", f"y\nx@{DIGEST}"],
)
def test_an_image_without_digest(image):
    """It is refused, by its name, for the image's base and for manifests; so is what could change the command."""
    for command in ([DEPLOY / "has_digest.sh", image], [DEPLOY / "kubernetes/with_image.sh", image]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == f"{image}: not an image with its digest, such as registry.example/name@sha256:...\n"


# ---- Kubernetes ------------------------------------------------------------------------------------------------------


def custom_schema(kind):
    """Return the schema of a resource of the operator, as its Helm chart installs it; unknown fields are refused."""
    folder = resources.files("dask_kubernetes").joinpath("operator/deployment/helm/dask-kubernetes-operator/crds")
    definition = yaml.safe_load(folder.joinpath(f"{kind.lower()}.yaml").read_text())
    schema = definition["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    return closed({**schema, "properties": {**schema["properties"], "apiVersion": {}, "kind": {}, "metadata": {}}})


def closed(schema):
    """Return a schema that refuses fields it does not name, as ``kubectl apply`` does."""
    if not isinstance(schema, dict):
        return schema
    schema = {key: closed(value) if key != "properties" else value for key, value in schema.items()}
    if "properties" in schema:
        schema["properties"] = {key: closed(value) for key, value in schema["properties"].items()}
        if not schema.get("x-kubernetes-preserve-unknown-fields"):
            schema.setdefault("additionalProperties", False)
    return schema


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted((DEPLOY / "kubernetes").glob("*.yaml")), ids=lambda path: path.name)
def test_kubernetes(path):
    """Each manifest is of Kubernetes' or the operator's own schema."""
    for manifest in documents(path):
        if manifest["apiVersion"].startswith("kubernetes.dask.org"):
            jsonschema.validate(manifest, custom_schema(manifest["kind"]))
        else:
            kubernetes_validate.validate(manifest, "1.31", strict=True)


def pods():
    """Yield name and specification of every pod in the manifests."""
    for path in sorted((DEPLOY / "kubernetes").glob("*.yaml")):
        for manifest in documents(path):
            yield from pods_in(manifest)


def pods_in(tree):
    """Yield the pods anywhere in a manifest."""
    if isinstance(tree, dict):
        if "containers" in tree:
            yield tree["containers"][0]["name"], tree
        for value in tree.values():
            yield from pods_in(value)


def test_pods():
    """Every pod is unprivileged, writes to nothing of the image, and has the certificates of its role only."""
    seen = set()
    for name, pod in pods():
        seen.add(name)
        assert pod["securityContext"]["runAsNonRoot"]
        assert pod["automountServiceAccountToken"] is False
        for container in pod["containers"]:
            assert container["securityContext"]["readOnlyRootFilesystem"]
            assert not container["securityContext"]["allowPrivilegeEscalation"]
            assert container["securityContext"]["capabilities"]["drop"] == ["ALL"]
            assert container["image"] == "clearcap@DIGEST"
            assert container["resources"]["limits"]["memory"]
            assert {m["name"] for m in container["volumeMounts"]} == {v["name"] for v in pod["volumes"]}
        secrets = [volume["secret"]["secretName"] for volume in pod["volumes"] if "secret" in volume]
        assert secrets == ([f"clearcap-tls-{ROLES[name]}"] if ROLES[name] else [])
        if name in ("scheduler", "worker"):
            assert pod["restartPolicy"] == "Always"
            check_dask(pod["containers"][0]["args"])
    assert seen == set(ROLES)


def test_pages_are_behind_a_proxy_that_ends_tls():
    """The ingress has TLS for the server's name, and its probes ask by a name that the server has."""
    parts = {each["kind"]: each for each in documents(DEPLOY / "kubernetes/web.yaml")}
    [container] = parts["Deployment"]["spec"]["template"]["spec"]["containers"]
    words = container["args"]
    name = words[words.index("--name") + 1]
    assert "--behind-proxy" in words
    assert parts["Ingress"]["spec"]["tls"][0]["hosts"] == [name]
    assert [rule["host"] for rule in parts["Ingress"]["spec"]["rules"]] == [name]
    assert (parts["Deployment"]["spec"]["replicas"], parts["Deployment"]["spec"]["strategy"]["type"]) == (1, "Recreate")
    probes = {container[probe]["httpGet"]["path"] for probe in ("readinessProbe", "livenessProbe")}
    assert probes == {"/readyz", "/healthz"}
    for probe in ("readinessProbe", "livenessProbe"):
        assert container[probe]["httpGet"]["httpHeaders"] == [{"name": "Host", "value": LOOPBACK[2]}]
    [port] = container["ports"]
    assert port["containerPort"] == PORT == parts["Service"]["spec"]["ports"][0]["port"]


def test_kubernetes_has_the_same_dask_settings():
    """The ConfigMap is deploy/dask.yaml."""
    [manifest] = documents(DEPLOY / "kubernetes/dask.yaml")
    assert manifest["data"]["dask.yaml"] == (DEPLOY / "dask.yaml").read_text()


def test_secrets_are_a_pattern():
    """No key is in the repository."""
    for manifest in documents(DEPLOY / "kubernetes/secrets.yaml"):
        role = manifest["metadata"]["name"].removeprefix("clearcap-tls-")
        assert manifest["stringData"] == dict.fromkeys(("ca.pem", f"{role}.pem", f"{role}.key"), "")


# ---- systemd ---------------------------------------------------------------------------------------------------------


@needs("systemd-analyze", "systemd")
def test_systemd(tmp_path):
    """systemd-analyze finds nothing wrong with the units, the commands being there."""
    for path in (DEPLOY / "systemd").glob("*.service"):
        (tmp_path / path.name).write_text(
            path.read_text().replace("/opt/clearcap/bin", str(Path(sys.executable).parent))
        )
    units = sorted(tmp_path.glob("*.service"))
    assert len(units) == 4
    output("systemd-analyze", "verify", "--man=no", *units)
    scores = re.findall(r"exposure level for (\S+): ([\d.]+)", output(*security(units)))
    assert [name for name, score in scores if float(score) < 2.5] == [unit.name.replace("@", "@i") for unit in units]
    units[0].write_text(units[0].read_text().replace("Restart=always", "Restart=forever"))
    with pytest.raises(AssertionError, match="restart specifier"):
        output("systemd-analyze", "verify", "--man=no", units[0])


def security(units):
    """Return the command that says how much of the machine units can reach, from 0 to 10."""
    return ("systemd-analyze", "security", "--offline=true", "--no-pager", *units)


@pytest.mark.parametrize("name", ["clearcap-scheduler", "clearcap-worker@", "clearcap-coordinator", "clearcap-web"])
def test_units(name):
    """Each is started again whatever its exit status, and the commands of dask are right."""
    text = (DEPLOY / f"systemd/{name}.service").read_text()
    assert "\nRestart=always\n" in text
    assert re.search(r"^MemoryMax=\d+[G%]$", text, re.M)
    assert re.search(r"^TasksMax=\d+$", text, re.M)
    assert ("NUMBA_CACHE_DIR=" in text) == ("\nCacheDirectory=clearcap\nCacheDirectoryMode=0700\n" in text)
    words = shlex.split(re.search(r"^ExecStart=/opt/clearcap/bin/(.*)", text, re.M)[1])
    assert ("\nSuccessExitStatus=143\nRestart=" in text) == (words[:2] == ["clearcap", "serve"])
    if words[0] == "dask":
        check_dask(words)


# ---- batch systems ---------------------------------------------------------------------------------------------------

SCRIPTS = [*sorted((DEPLOY / "batch").iterdir()), *sorted(DEPLOY.glob("*.sh")), *sorted(DEPLOY.glob("kubernetes/*.sh"))]
OAR_OPTIONS = {
    "-n": str,
    "-l": str,
    "-t": str,
    "-O": str,
    "-E": str,
    "--checkpoint": int,
    "--signal": int,
    "--array": int,
}
PBS_OPTIONS = {"-N": str, "-l": str, "-j": str}


@needs("shellcheck", "shellcheck")
@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_scripts(path):
    """Shellcheck finds nothing, and the file can be run."""
    assert not output("shellcheck", path)
    assert path.stat().st_mode & 0o111


@pytest.mark.parametrize(
    ("name", "mark", "options"),
    [
        ("campaign.oar", "#OAR", OAR_OPTIONS),
        ("workers.oar", "#OAR", OAR_OPTIONS),
        ("campaign.pbs", "#PBS", PBS_OPTIONS),
    ],
)
def test_directives(name, mark, options):
    """Directives stand at line's start before the first command, and have options oarsub or qsub knows."""
    lines = (DEPLOY / "batch" / name).read_text().splitlines()
    first_command = next(number for number, line in enumerate(lines) if line and not line.startswith("#"))
    found = [number for number, line in enumerate(lines) if mark in line and line.startswith(mark)]
    assert len(found) >= 4
    assert max(found) < first_command
    for number in found:
        option, value = lines[number].removeprefix(mark).split(maxsplit=1)
        options[option](value)
        if option == "-l" and "walltime" in value:
            assert re.search(r"walltime=\d\d:\d\d:\d\d$", value)


@pytest.mark.parametrize("name", ["workers.slurm", "workers.oar"])
def test_worker_commands(name):
    """The workers' commands are right for dask."""
    text = (DEPLOY / "batch" / name).read_text()
    command = re.search(r"^exec .*/on_node.sh\" \\\n +(dask worker (?:.*\\\n)*.*)", text, re.M)[1].replace("\\\n", " ")
    for variable, value in {r"\$\{LIFETIME:-230m\}": "230m", r"\$\{SLURM_CPUS\w+:-1\}": "16"}.items():
        command = re.sub(variable, value, command)
    files = ("--tls-ca-file=", "--tls-cert=", "--tls-key=")
    words = [word for word in shlex.split(command) if not word.startswith(files)]
    check_dask(words)


def node_folder(commands, temporary):
    """Run what prepares a worker's folder on its node; return the folder of compiled code, and the other."""
    show = 'echo "$NUMBA_CACHE_DIR"'
    if commands == "on_node.sh":
        words = [DEPLOY / "batch/on_node.sh", "sh", "-c", f'{show}; echo "$2"', "worker"]
    else:
        [settings] = documents(DEPLOY / "jobqueue.yaml")
        prologue = "\n".join(settings["jobqueue"][commands]["job-script-prologue"])
        words = ["bash", "-euc", f"{prologue}\n{show}; echo {settings['jobqueue'][commands]['local-directory']}"]
    printed = output(*words, env={"PATH": "/usr/bin:/bin", "TMPDIR": str(temporary)})
    return [Path(line) for line in printed.splitlines()]


@pytest.mark.parametrize("commands", ["on_node.sh", "slurm", "oar", "pbs"])
def test_node_folder(tmp_path, commands):
    """Workers' folder on a node is their user's alone, has no name that can be foreseen, and is found again."""
    open_to_all, link = tmp_path / "clearcap.open", tmp_path / "clearcap.link"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    link.symlink_to(tmp_path)
    if os.getuid() == 0:
        theirs = tmp_path / "clearcap.theirs"
        theirs.mkdir(mode=0o700)
        os.chown(theirs, 20002, 20002)
    compiled, folder = node_folder(commands, tmp_path)
    assert compiled.parent == folder
    assert folder.parent == tmp_path
    assert re.fullmatch(r"clearcap\.\w{6}", folder.name)
    assert (folder.stat().st_uid, folder.stat().st_mode & 0o7777) == (os.getuid(), 0o700)
    assert node_folder(commands, tmp_path) == [compiled, folder]
    shutil.rmtree(folder)
    assert node_folder(commands, tmp_path)[1].name != folder.name


@pytest.mark.parametrize("path", sorted(DEPLOY.rglob("*.*")), ids=lambda path: path.name)
def test_no_name_can_be_foreseen(path):
    """No descriptor names a file in a folder that users of a machine share, unless mktemp makes the name."""
    for line in path.read_text().splitlines():
        for name in re.findall(r"(?:TMPDIR|/tmp|local)\}?\"?/([^\s\"']+)", line):
            assert name.endswith(".XXXXXX"), line


def allocation(tmp_path, system, **environment):
    """Run allocation.sh with recorders in place of all commands; return what each was called with."""
    binaries = tmp_path / "bin"
    binaries.mkdir()
    for name in ("dask", "clearcap", "srun", "oarsh", "pbs_tmrsh"):
        recorder = binaries / name
        record = f"printf '%s\\n' \"{name} $*\" >> '{tmp_path}/calls'"
        recorder.write_text(f"#!/bin/sh\n{record}\n" + ("sleep 1\n" if name == "clearcap" else ""))
        recorder.chmod(0o755)
    nodes = tmp_path / "nodes"
    nodes.write_text("b\na\nb\na\n")
    files = {"OAR_NODEFILE": str(nodes), "PBS_NODEFILE": str(nodes), "HOME": str(tmp_path), "USER": "me"}
    given = {"PATH": f"{binaries}:/usr/bin:/bin", "CAMPAIGN": "c60", "STORE": "/runs", **files, **environment}
    output("bash", DEPLOY / "batch/allocation.sh", system, env=given)
    assert not list(tmp_path.glob(".clearcap-job*"))
    return sorted((tmp_path / "calls").read_text().splitlines())


@pytest.mark.parametrize(
    ("system", "launchers"), [("slurm", ["srun"]), ("oar", ["oarsh"] * 2), ("pbs", ["pbs_tmrsh"] * 2)]
)
def test_allocation(tmp_path, system, launchers):
    """One scheduler, one campaign, and workers launched once on each node, all with certificates."""
    calls = allocation(tmp_path, system, CLEARCAP_INTERFACE="ib0")
    assert sorted(call.split()[0] for call in calls) == sorted(["clearcap", "dask", *launchers])
    for call in calls:
        if call.startswith("clearcap"):
            assert call.startswith("clearcap run c60 --store /runs --scheduler ")
            assert f"--tls-key {tmp_path}/.clearcap/tls/client.key" in call
            continue
        role = "scheduler" if call.startswith("dask") else "worker"
        assert f"--tls-key={tmp_path}/.clearcap/tls/{role}.key" in call
        assert (f" {DEPLOY}/batch/on_node.sh dask worker " in call) == (role == "worker")
        assert "--protocol tls --interface ib0" in call
        assert "--no-dashboard --dashboard-address 127.0.0.1:0 --preload campaign.cluster.closed_http" in call
    if system != "slurm":
        assert [call.split()[1] for call in calls if call.split()[0] in launchers] == ["a", "b"]
