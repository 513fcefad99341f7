"""Another user prepares the folder of compiled code, whose files run what he wrote when they are read."""

import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from engine import jit, warm_up

ROOT = Path(__file__).parents[2]
VICTIM, ATTACKER = 20001, 20002
# The interpreter may lie where only root can read, so the victim may read everything, and no more.
AS_VICTIM = (
    *("setpriv", f"--reuid={VICTIM}", f"--regid={VICTIM}", "--clear-groups"),
    *("--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search"),
)
TURN = (
    "import numpy as np; from engine.kernels.vectors import rotation_matrix;"
    " R = np.zeros((3, 3)); rotation_matrix(np.array([1.0, 0, 0, 0]), R); print(R.trace())"
)


def can_act() -> bool:
    """Tell whether this process can act as another user who reads everything."""
    if os.getuid() or not shutil.which("setpriv"):
        return False
    return subprocess.run([*AS_VICTIM, "true"], check=False, capture_output=True).returncode == 0


pytestmark = [
    pytest.mark.skipif(not can_act(), reason="needs root, setpriv, and the capability to read everything"),
    pytest.mark.processes,
]


class Prey:
    """Runs a command when it is unpickled."""

    def __init__(self, proof: Path) -> None:
        self.proof = proof

    def __reduce__(self):
        return os.system, (f"id -u > {self.proof}",)


@pytest.fixture(scope="module")
def compiled() -> Path:
    """Return the folder of this build's compiled code."""
    warm_up()
    return jit.CACHE_FOLDER


@pytest.fixture
def place(tmp_path):
    """Return a folder where everybody may write, sticky as /tmp is."""
    tmp_path.chmod(0o755)
    place = tmp_path / "shared"
    place.mkdir()
    place.chmod(0o1777)
    return place


@pytest.fixture
def proof(place):
    """Return the file that tells that the attacker's command ran."""
    return place / "proof"


@pytest.fixture
def poison(compiled, proof):
    """Return what fills a folder with indices that run the attacker's command, and gives it to someone."""

    def fill(folder: Path, owner: int) -> None:
        build = folder / compiled.name
        for index in compiled.rglob("*.nbi"):
            target = build / index.relative_to(compiled)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(pickle.dumps(numba.__version__) + pickle.dumps(Prey(proof)))
        assert len(list(build.rglob("*.nbi"))) > 5
        for entry in (folder, *folder.rglob("*")):
            os.chown(entry, owner, owner)
            entry.chmod(0o777)

    return fill


def run_as_victim(*words, **environment):
    """Run Python as the victim, whose home is empty unless another is given."""
    given = {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1", **environment}
    command = [*AS_VICTIM, sys.executable, *words]
    return subprocess.run(command, env=given, cwd="/", capture_output=True, text=True, check=False)


def simulate(**environment):
    """Run a simulation as the victim."""
    return run_as_victim("-m", "clearcap", "simulate", "incline", **environment)


def home(place, mode=0o700) -> Path:
    """Make the victim's home."""
    home = place / "home"
    home.mkdir()
    os.chown(home, VICTIM, VICTIM)
    home.chmod(mode)
    return home


def test_the_poison_works(place, poison, proof):
    """Numba runs what is in a folder's index: without a check the attacker's command runs as the victim."""
    poison(place / "cache", ATTACKER)
    index = next((place / "cache").rglob("*rotation_matrix*.nbi"))
    read = f"IndexDataCacheFile({str(index.parent)!r}, {index.stem!r}, 0).load(0)"
    run_as_victim("-c", f"from numba.core.caching import IndexDataCacheFile; {read}")
    assert proof.read_text() == f"{VICTIM}\n"


@pytest.mark.slow
@pytest.mark.parametrize("way", ["folder", "link", "parent", "content"])
def test_a_folder_that_the_victim_names(way, place, poison, proof):
    """It is refused in one message that says whose it is; nothing in it runs."""
    named = cache = place / "clearcap-victim"
    if way == "link":
        cache = place / "elsewhere"
        named.symlink_to(cache)
        os.lchown(named, ATTACKER, ATTACKER)
    elif way == "parent":
        named = cache / "mine"
    poison(cache, ATTACKER)
    if way == "parent":
        poison(named, VICTIM)
        assert named.stat().st_uid == VICTIM
    elif way == "content":
        for folder in (cache, *(entry for entry in cache.iterdir())):
            os.chown(folder, VICTIM, VICTIM)
            folder.chmod(0o755)
    done = simulate(HOME=str(home(place)), NUMBA_CACHE_DIR=str(named))
    assert not proof.exists()
    assert done.returncode == 2, done.stderr
    assert f"belongs to user {ATTACKER}" in done.stderr
    assert "NUMBA_CACHE_DIR" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_home_where_others_write(place, poison, proof):
    """Its folder is not used: a temporary one is, which is removed, and one message says so."""
    cache = home(place, 0o777) / ".cache"
    poison(cache / "clearcap/numba", ATTACKER)
    os.chown(cache, ATTACKER, ATTACKER)
    done = run_as_victim("-c", TURN, HOME=str(cache.parent), TMPDIR=str(place))
    assert not proof.exists()
    assert (done.returncode, done.stdout) == (0, "3.0\n"), done.stderr
    assert done.stderr.count("compiled code is not kept") == 1
    assert f"everybody can write in {cache.parent} (mode 0777)" in done.stderr
    assert [folder.name for folder in place.iterdir()] == ["home"]


def test_the_victims_own_folder(place):
    """A folder of his own below a shared one is used: made for him alone, found again, mode and all."""
    named, own = place / "clearcap-victim", home(place)
    for _ in range(2):
        done = run_as_victim("-c", TURN, HOME=str(own), NUMBA_CACHE_DIR=str(named))
        assert (done.returncode, done.stdout, done.stderr) == (0, "3.0\n", "")
    [build] = named.iterdir()
    assert {(each.stat().st_uid, each.stat().st_mode & 0o7777) for each in (named, build)} == {(VICTIM, 0o700)}
    assert list(build.rglob("*rotation_matrix*.nbc"))
