"""The lock files have all that pyproject.toml asks for: with hashes what machines install, without them the tools."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
LOCK = (ROOT / "deploy/requirements.lock").read_text("utf-8")
DEVELOPMENT = (ROOT / "deploy/development.lock").read_text("utf-8")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
EXTRAS = re.search(r"^EXTRAS := (.*)$", (ROOT / "Makefile").read_text(), re.M)[1].split()
PYTHONS = ("3.11", "3.12", "3.13", "3.14")


def locked(python, lock=LOCK):
    """Return the versions of a lock file for a Python on Linux."""
    environment = {**default_environment(), "python_version": python, "python_full_version": f"{python}.0"}
    found = {}
    for line in re.findall(r"^([a-z0-9].*?) *\\?$", lock, re.M):
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate(environment | {"extra": ""}):
            [version] = requirement.specifier
            assert version.operator == "=="
            assert requirement.name not in found, f"two versions of {requirement.name} for Python {python}"
            found[canonicalize_name(requirement.name)] = version.version
    return found


@pytest.mark.parametrize("python", PYTHONS)
def test_what_pyproject_asks_for(python):
    """Each dependency, also of the extras that machines of a cluster need, is there in a version it allows."""
    versions, project = locked(python), PYPROJECT["project"]
    asked = list(project["dependencies"]) + PYPROJECT["build-system"]["requires"]
    for extra in EXTRAS:
        asked += project["optional-dependencies"].get(extra, [])
    for requirement in map(Requirement, asked):
        version = versions.get(canonicalize_name(requirement.name))
        assert version, f"{requirement} is not locked: make lock"
        assert requirement.specifier.contains(version), f"{requirement.name} {version} is locked: make lock"


def test_extras():
    """All that are not for tests, development and the site of the docs."""
    assert set(EXTRAS) >= set(PYPROJECT["project"]["optional-dependencies"]) - {"test", "dev", "docs"}


def test_oldest_and_newest_name_what_they_install():
    """`deploy/smoke.py` prints the versions of these packages, and ends where one is missing."""
    smoke = runpy.run_path(str(ROOT / "deploy" / "smoke.py"))
    project = PYPROJECT["project"]
    asked = [*project["dependencies"], *(each for name in EXTRAS for each in project["optional-dependencies"][name])]
    assert smoke["asked_for"]() == sorted({Requirement(each).name for each in asked})


def test_every_package_has_hashes():
    """And comes from PyPI by its name: no address and no other index."""
    entries = re.split(r"^(?=[a-z0-9])", LOCK, flags=re.M)[1:]
    assert len(entries) > 60
    for entry in entries:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), entry
    assert not re.search(r"://|^-", LOCK, re.M)


def test_the_image_reads_no_cad_files():
    """What only reads CAD files is installed with its hashes, as all that is locked, and taken out again."""
    locked_for_cad = set(re.findall(r"^(cadquery-ocp[a-z-]*)==", LOCK, re.M))
    [removed] = re.findall(r"pip uninstall --yes (.*)$", (ROOT / "deploy/Dockerfile").read_text(), re.M)
    assert set(removed.split()) == locked_for_cad
    assert locked_for_cad >= {Requirement(text).name for text in PYPROJECT["project"]["optional-dependencies"]["cad"]}


def test_what_installs_from_it():
    """The image takes nothing else; the verbs of the Makefile that install take its versions."""
    image = (ROOT / "deploy/Dockerfile").read_text()
    installs = re.findall(r"pip install (.*?)(?: \\)?$", image, re.M)
    assert installs == [
        "--no-cache-dir --require-hashes -r requirements.lock",
        "--no-cache-dir --no-deps --no-build-isolation .",
    ]
    verbs = re.findall(r"\$\(BIN\)/pip install (.*)$", (ROOT / "Makefile").read_text(), re.M)
    assert len(verbs) == 3
    assert all("--constraint $(DEV)" in verb for verb in verbs)


@pytest.mark.parametrize("python", PYTHONS)
def test_tools_are_locked_beside_what_they_test(python):
    """The lock without hashes has every version of the one with them, and one of each tool."""
    tools, installed = locked(python, DEVELOPMENT), locked(python)
    assert installed.items() - tools.items() <= {("setuptools", installed["setuptools"]), ("wheel", installed["wheel"])}
    for extra in ("test", "dev", "docs"):
        for requirement in map(Requirement, PYPROJECT["project"]["optional-dependencies"][extra]):
            if requirement.name != "clearcap":
                assert requirement.specifier.contains(tools[canonicalize_name(requirement.name)]), requirement
