"""Trajectory files: the numbers of the run, readable without us, complete or not there."""

import json
import re
import signal
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import engine.loop
from engine import Recording, TrajectoryError, load_mechanism, read_trajectory, simulate
from engine.loop import Cancel
from engine.trajectory import contact_forces
from engine.trajectory.write import TrajectoryWriter
from tests.each import each
from tests.until import until

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "trajectory.md").read_text("utf-8")
MASS, GRAVITY, INERTIA = 0.1, 9.81, np.array([3.4e-4, 1.0e-5, 3.4e-4])  # of the shipped pendulum


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Return the trajectory of the shipped pendulum's first 0.1 s, each step; its gap closes at 0.01 s."""
    path = tmp_path_factory.mktemp("trajectory") / "pendulum.h5"
    simulate(load_mechanism("clearance_pendulum"), horizon=0.1, trajectory=path)
    return path


@pytest.fixture(scope="module")
def recorded(file):
    """Return it as read."""
    return read_trajectory(file)


# --- the numbers


@pytest.mark.bits
@pytest.mark.parametrize("name", ["clearance_pendulum", "c60"])
def test_recording_changes_no_bit(name, tmp_path):
    """With and without a trajectory: the same responses and certificate, bit for bit; the mechanism is in the file."""
    horizon = 0.3 if name == "clearance_pendulum" else None
    mechanism = load_mechanism(name)
    plain = simulate(mechanism, horizon=horizon, full_horizon=horizon is not None)
    path = tmp_path / "run.h5"
    recorded = simulate(mechanism, horizon=horizon, full_horizon=horizon is not None, trajectory=path)
    assert recorded.measured == plain.measured
    read = read_trajectory(path)
    proofs = [asdict(run.certificate) | {"wall_s": 0} for run in (plain, recorded)]
    assert proofs[0] == proofs[1] == read.certificate | {"wall_s": 0}
    assert read.mechanism().digest() == read.digest
    assert list(read.responses) == list(mechanism.responses)
    for response, values in read.responses.items():
        if mechanism.responses[response].type == "position":
            assert values[-1] == plain.measured[response]


def test_every_step_is_there_once(recorded):
    """The first row is the start, each other a step later; 501 rows of 2e-4 s."""
    assert len(recorded.time) == 501
    assert recorded.time[0] == 0
    np.testing.assert_allclose(np.diff(recorded.time), recorded.step[1:], rtol=1e-9)
    assert recorded.time[-1] == pytest.approx(0.1)
    assert (recorded.status, recorded.settings["horizon"]) == ("not_at_rest", 0.1)
    assert "simulation.horizon" in recorded.message


def test_pose_energy_and_gap_of_each_row(recorded):
    """Origin, energies and gaps follow from position, quaternion and twists by hand."""
    link, angle = recorded.bodies["link"], 0.5
    turns = Rotation.from_quat(link.quaternion, scalar_first=True)
    np.testing.assert_allclose(link.position[0], [0.1 * np.sin(angle), -0.1 * np.cos(angle), 0], atol=1e-15)
    np.testing.assert_allclose(link.origin, link.position + turns.apply([0, 0.1, 0]), atol=1e-14)
    spin = 0.5 * (INERTIA * link.angular_velocity**2).sum(axis=1)
    np.testing.assert_allclose(recorded.kinetic, 0.5 * MASS * (link.velocity**2).sum(axis=1) + spin, rtol=1e-12)
    swing = turns.as_rotvec()[:, 2]
    stored = MASS * GRAVITY * link.position[:, 1] + 0.5 * 0.01 * swing**2
    np.testing.assert_allclose(recorded.potential, stored, rtol=1e-9)
    for i, station in enumerate((-0.01, 0.01)):
        ring = link.origin + turns.apply([0, 0, station])
        gap = recorded.contacts[f"J1.ring{i + 1}"].gap
        np.testing.assert_allclose(gap, 5e-4 - np.linalg.norm(ring[:, :2], axis=1), atol=1e-15)


def test_forces_are_what_the_bodies_feel(recorded):
    """The sum of the contact forces is m (dv/dt - g); a ring that presses is active, and one that is off has none."""
    rows = np.arange(len(recorded.time))
    points, forces = contact_forces(recorded, rows.tolist())
    link = recorded.bodies["link"]
    acceleration = np.diff(link.velocity, axis=0) / recorded.step[1:, None]
    wanted = MASS * (acceleration - [0, -GRAVITY, 0])
    total = forces[1:].sum(axis=1)
    np.testing.assert_allclose(total, wanted, atol=0.02 * np.abs(wanted).max())  # projected at the first touch
    np.testing.assert_allclose(total[100:], wanted[100:], atol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(points[:, :, :2], axis=-1), 0.01, rtol=1e-12)  # on the journal
    history = recorded.contacts["J1.ring1"]
    assert (recorded.force("J1.ring1")[~history.active] == 0).all()
    assert history.active[-1]
    assert not history.active[:40].any()


def test_mean_forces_between_instants(recorded):
    """Between two instants: the mean of the forces of the steps."""
    first, last = 400, 420
    _, each = contact_forces(recorded, range(first + 1, last + 1))
    _, mean = contact_forces(recorded, [first, last])
    np.testing.assert_allclose(mean[1], each.mean(axis=0), atol=1e-12)


def test_every_keeps_start_and_end(recorded, tmp_path):
    """``every = 7``: rows 0, 7, 14, ... of the whole one, and the last."""
    path = tmp_path / "thin.h5"
    simulate(load_mechanism("clearance_pendulum"), horizon=0.1, trajectory=Recording(path, every=7))
    thin = read_trajectory(path)
    rows = [*range(0, 500, 7), 500]
    np.testing.assert_array_equal(thin.time, recorded.time[rows])
    np.testing.assert_array_equal(thin.bodies["link"].position, recorded.bodies["link"].position[rows])
    np.testing.assert_array_equal(thin.contacts["J1.ring2"].impulse, recorded.contacts["J1.ring2"].impulse[rows])


def test_blocks_do_not_matter(recorded, tmp_path, monkeypatch):
    """Written in blocks of 16 rows: the same numbers."""
    monkeypatch.setattr(engine.loop, "ROOM", 1)
    path = tmp_path / "blocks.h5"
    simulate(load_mechanism("clearance_pendulum"), horizon=0.1, trajectory=path)
    blocks = read_trajectory(path)
    np.testing.assert_array_equal(blocks.time, recorded.time)
    np.testing.assert_array_equal(blocks.bodies["link"].quaternion, recorded.bodies["link"].quaternion)
    np.testing.assert_array_equal(blocks.responses["tip"], recorded.responses["tip"])


# --- the file


def test_every_dataset_has_its_unit(file):
    """Units and descriptions as attributes, compression and checksums: what the page promises."""
    units = {}
    with h5py.File(file) as opened:
        opened.visititems(lambda name, item: units.update({name: item}) if isinstance(item, h5py.Dataset) else None)
        description = json.loads(units.pop("mechanism").asstr()[()])
        for item in units.values():
            assert item.attrs["description"]
            assert (item.compression, item.shuffle, item.fletcher32) == ("gzip", True, True)
        units = {name: item.attrs["unit"] for name, item in units.items()}
    assert description["joints"]["J1"]["radial_clearance"] == 5e-4
    body = {"position": "m", "origin": "m", "quaternion": "1", "velocity": "m/s", "angular_velocity": "rad/s"}
    contact = {"gap": "m", "impulse": "N s", "active": "1"}
    assert units == {
        "time": "s",
        "step": "s",
        "energy/kinetic": "J",
        "energy/potential": "J",
        **{f"bodies/link/{name}": unit for name, unit in body.items()},
        **{f"contacts/J1.ring{i}/{name}": unit for i in (1, 2) for name, unit in contact.items()},
        "responses/drop": "m",
        "responses/tip": "m",
    }


def test_the_page_names_every_dataset_and_attribute(file):
    """docs/trajectory.md describes all there is."""
    said = set(re.findall(r"[\w/]+", " ".join(re.findall(r"`([^`\n]+)`", PAGE))))
    with h5py.File(file) as opened:
        names = {*opened, *opened.attrs, *opened["bodies/link"], *opened["contacts/J1.ring1"], *opened["energy"]}
        assert names <= {word for name in said for word in (name, *name.split("/"))}


def test_the_example_of_the_page(file, monkeypatch, capsys):
    """It prints what its last comment says, with h5py and numpy alone."""
    code = re.search(r"```python\n(.*?)```", PAGE, re.S)[1]
    monkeypatch.chdir(file.parent)
    exec(compile(code, "example", "exec"), {})
    assert capsys.readouterr().out.strip() == re.search(r"# prints (.*)$", code, re.M)[1]
    assert "engine" not in code


def test_order_of_the_run(tmp_path):
    """Bodies, contacts and responses are read in the order of the run, not of the alphabet."""
    path = tmp_path / "c60.h5"
    simulate(load_mechanism("c60"), horizon=0.05, trajectory=path)
    names = list(read_trajectory(path).contacts)
    assert names[0] == "J1.ring1"
    assert names != sorted(names)


# --- runs that fail, writers that are killed


def test_run_that_is_stopped_leaves_a_whole_file(tmp_path):
    """Timeout and cancelling: a readable file with its status and message, and the last state."""
    cancel = Cancel()
    cancel.set()
    path = tmp_path / "stopped.h5"
    run = simulate(load_mechanism("clearance_pendulum"), cancel=cancel, trajectory=path)
    read = read_trajectory(path)
    assert (run.status, read.status, read.message) == ("cancelled", "cancelled", run.message)
    assert read.time.tolist() == [0.0, run.certificate.time]
    run = simulate(load_mechanism("clearance_pendulum"), {"simulation.wall_limit": 0.2}, step=1e-6, trajectory=path)
    read = read_trajectory(path)
    assert (run.status, read.status) == ("timeout", "timeout")
    assert len(read.time) == run.certificate.steps + 1
    assert [item.name for item in tmp_path.iterdir()] == ["stopped.h5"]


@pytest.mark.processes
def test_killed_writer_leaves_no_file_under_the_name(tmp_path):
    """SIGKILL in the middle: nothing under the name, and what is left is refused."""
    code = (
        "from engine import load_mechanism, simulate; import engine.loop; engine.loop.ROOM = 40_000\n"
        "simulate(load_mechanism('clearance_pendulum'), step=1e-6, horizon=100.0, trajectory='killed.h5')"
    )
    writer = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, env=_environment())
    try:
        until(lambda: any(item.stat().st_size > 20_000 for item in tmp_path.iterdir()), "nothing is written")
    finally:
        writer.send_signal(signal.SIGKILL)
        writer.wait()
    (left,) = tmp_path.iterdir()
    assert left.name.startswith("killed.h5.")
    with pytest.raises(TrajectoryError, match=r"damaged|incomplete"):
        read_trajectory(left)


def test_failed_write_keeps_the_old_file(file, tmp_path, monkeypatch):
    """A full disk: one message, the file that was there as it was, nothing beside it."""
    path = tmp_path / "run.h5"
    path.write_bytes(b"old")

    def full(self, rows):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(TrajectoryWriter, "append", full)
    with pytest.raises(TrajectoryError, match=r"run\.h5.*No space left on device"):
        simulate(load_mechanism("incline"), horizon=0.05, trajectory=path)
    assert [(item.name, item.read_bytes()) for item in tmp_path.iterdir()] == [("run.h5", b"old")]


# --- errors


def _cut(path):
    path.write_bytes(path.read_bytes()[:-2000])


def _flip(path):
    content = bytearray(path.read_bytes())
    with h5py.File(path) as opened:
        chunk = opened["time"].id.get_chunk_info(0)
    content[chunk.byte_offset + chunk.size // 2] ^= 0xFF
    path.write_bytes(content)


def _newer(path):
    with h5py.File(path, "r+") as opened:
        opened.attrs["format_version"] = 2


def _unfinished(path):
    with h5py.File(path, "r+") as opened:
        del opened.attrs["status"]


def _shortened(path):
    with h5py.File(path, "r+") as opened:
        opened["contacts/J1.ring1/gap"].resize(3, axis=0)


def _without(path):
    with h5py.File(path, "r+") as opened:
        del opened["bodies/link/origin"]


def _foreign(path):
    with h5py.File(path, "w") as opened:
        opened["time"] = [0.0]


BAD_FILES = {
    "none": (Path.unlink, "no such file"),
    "text": (lambda path: path.write_text("time,step"), "not an HDF5 file"),
    "of others": (_foreign, "not a trajectory of clearcap"),
    "newer": (_newer, "format 2; this version reads 1"),
    "killed": (_unfinished, "incomplete"),
    "cut short": (_cut, "damaged"),
    "a bit flipped": (_flip, "damaged"),
    "rows missing": (_shortened, "contacts/J1.ring1/gap has 3 rows, time 501"),
    "dataset missing": (_without, "damaged"),
}


@each(("spoil", "said"), BAD_FILES.values())
def test_bad_file_is_refused(file, tmp_path, spoil, said):
    """Files that are none of ours, or not whole: one message with the path, and what to do."""
    path = tmp_path / "bad.h5"
    path.write_bytes(file.read_bytes())
    spoil(path)
    with pytest.raises(TrajectoryError, match=re.escape(said)) as caught:
        read_trajectory(path)
    assert str(path) in str(caught.value)
    assert ";" in str(caught.value)  # and the remedy


def test_bad_request_is_refused(tmp_path):
    """``every`` below 1, a folder that is not there: an error before the run, nothing written."""
    with pytest.raises(TrajectoryError, match=r"every = 0\b"):
        simulate(load_mechanism("incline"), trajectory=Recording(tmp_path / "a.h5", every=0))
    with pytest.raises(TrajectoryError, match="cannot be written"):
        simulate(load_mechanism("incline"), trajectory=tmp_path / "none" / "a.h5")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.processes
def test_h5py_waits_until_it_is_needed():
    """The engine without trajectories does not load h5py."""
    code = "import sys, engine; engine.load_mechanism('incline'); print('h5py' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], env=_environment(), capture_output=True, text=True)
    assert done.stdout == "False\n"


def _environment():
    import os

    return {**os.environ, "PYTHONPATH": str(ROOT)}
