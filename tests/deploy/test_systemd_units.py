"""The units are accepted by systemd, and keep what is promised of them."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from tests.deploy.descriptors import DEPLOY, check_dask, needs, output


@pytest.mark.processes
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
