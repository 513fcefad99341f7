"""What the tests of the descriptors in deploy/ share: reading them, and the tools that check them."""

import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from distributed.cli.dask_scheduler import main as dask_scheduler
from distributed.cli.dask_worker import main as dask_worker

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
MANIFESTS = [p for p in sorted((DEPLOY / "kubernetes").rglob("*.yaml")) if p.name != "kustomization.yaml"]
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


def pods():
    """Yield name and specification of every pod in the manifests."""
    for path in MANIFESTS:
        for manifest in documents(path):
            yield from pods_in(manifest)


def pods_in(tree):
    """Yield the pods anywhere in a manifest."""
    if isinstance(tree, dict):
        if "containers" in tree:
            yield tree["containers"][0]["name"], tree
        for value in tree.values():
            yield from pods_in(value)
