"""Where journals lie in their bearings at the end of runs, and with what force."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from campaign.inputs.sampling import draw
from campaign.pictures.play import plays
from campaign.pictures.poses import poses
from campaign.pictures.view import Array, choose_view
from campaign.spec.load import Campaign
from engine import Mechanism, Trajectory, read_trajectory, simulate, warm_up

ENDS = 10**9  # of a trajectory only the first row and the last are kept


@dataclass(frozen=True)
class Seat:
    """A ring of a joint, or the socket of a ball, at the end of ``n`` runs.

    Attributes
    ----------
    joint, ring : name, and number from 1
    ways : (n, 2) eccentricity of the journal in its bearing, divided by the clearance: 1 is contact
    loads : (n, 2) force of the journal on the bearing
    """

    joint: str
    ring: int
    ways: Array
    loads: Array


def seats_of(trajectory: Trajectory) -> list[Seat]:
    """Return the seats of one run, each with one row: that of its end."""
    from engine.trajectory.forces import contact_forces

    mechanism, last = trajectory.mechanism(), np.array([len(trajectory.time) - 1])
    _, forces = contact_forces(trajectory, last.tolist())
    force = dict(zip(trajectory.contacts, forces[0], strict=True))
    seats = []
    for play in plays(mechanism, poses(trajectory, mechanism, last), choose_view(mechanism)):
        on_bearing = -1.0 if mechanism.bodies[mechanism.joints[play.joint].sides[0].body].fixed else 1.0
        faces = [name for name in force if name.startswith((f"{play.joint}.ring", f"{play.joint}.ball"))]
        for ring, face in enumerate(faces):
            load = on_bearing * (play.across[0] @ force[face])
            seats.append(Seat(play.joint, ring + 1, play.way[:, ring], load[None]))
    return seats


def seats_of_campaign(campaign: Campaign, processes: int) -> list[Seat]:
    """Simulate a campaign, of few samples; return the seats at the ends of those runs that succeed, none if none does.

    Parameters
    ----------
    campaign : with the number of its samples; with fewer they are the first
    processes : that share the work
    """
    spec = campaign.spec
    drawn, targets = draw(spec, 0, spec.samples), spec.targets()
    values = [{targets[name]: float(x[i]) for name, x in drawn.items()} for i in range(spec.samples)]
    end = partial(_end_of, campaign.mechanism, spec.simulation.step, spec.simulation.horizon)
    warm_up()  # compiled once, for all processes
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        return together([seats for seats in pool.map(end, values, chunksize=4) if seats])


def together(runs: list[list[Seat]]) -> list[Seat]:
    """Return the seats of several runs of one mechanism as those of all."""
    return [
        Seat(same[0].joint, same[0].ring, *(np.vstack([getattr(s, what) for s in same]) for what in ("ways", "loads")))
        for same in zip(*runs, strict=True)
    ]


def _end_of(mechanism: Mechanism, step: float | None, horizon: float | None, values: dict[str, float]) -> list[Seat]:
    """Simulate once; return the seats at the end, none if the run failed."""
    with TemporaryDirectory(prefix="clearcap-") as folder:
        path = Path(folder) / "end.h5"
        run = simulate(mechanism, values, step=step, horizon=horizon, trajectory=path, every=ENDS)
        return seats_of(read_trajectory(path)) if run.status == "ok" else []
