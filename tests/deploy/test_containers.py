"""The image and compose.yaml are accepted by the tools that read them, and keep what is promised of them."""

import os
import re
import sys
import tomllib
from ipaddress import ip_address, ip_network
from pathlib import Path

import pytest
import yaml

from tests.deploy.descriptors import DEPLOY, ROLES, ROOT, check_dask, needs, output


@pytest.mark.processes
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


@pytest.mark.processes
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


def test_an_image_has_every_package():
    """What `pip install` installs is copied into the image, and is not hidden from the build."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    packages = {name.rstrip("*") for name in settings["tool"]["setuptools"]["packages"]["find"]["include"]}
    copied = set(re.findall(r"^COPY (\w+) \w+$", (DEPLOY / "Dockerfile").read_text(), re.M))
    shown = set(re.findall(r"^!(\w+)$", (DEPLOY / "Dockerfile.dockerignore").read_text(), re.M))
    assert packages == copied == shown - {"LICENSE"}


def test_one_file_for_nodes():
    """The environment of Apptainer is that of the image: the same files, the same locked packages."""
    definition, image = ((DEPLOY / name).read_text() for name in ("apptainer.def", "Dockerfile"))
    sections = re.findall(r"^%(\w+)$", definition, re.M)
    assert sections == ["help", "files", "post", "environment", "test"]
    copied = re.findall(r"^    (\S+) /src/(\S+)$", definition, re.M)
    assert all((ROOT / source).exists() and Path(source).name == target for source, target in copied)
    assert {source for source, _ in copied} >= set(re.findall(r"^COPY (\w+) \1$", image, re.M))
    installed = [re.findall(r"/opt/clearcap/bin/pip (.*?)(?: \\)?$", text, re.M) for text in (definition, image)]
    plain = [[re.sub(r"/src/|/src$|\.$", "", line) for line in lines] for lines in installed]
    assert plain[0] == plain[1]
