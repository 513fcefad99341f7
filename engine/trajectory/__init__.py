"""The motion of one run as an HDF5 file for any HDF5 library, written during the run by `engine.trajectory.write`.

Here are the settings of a recording, the reader of such a file, and the forces at its contacts in the world.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array
from engine.errors import TrajectoryError
from engine.mechanism import Mechanism, mechanism_from

__all__ = ["BodyMotion", "ContactHistory", "Recording", "Trajectory", "read_trajectory"]

FORMAT, VERSION = "clearcap trajectory", 1


class Recording(NamedTuple):
    """A trajectory file that need not contain every step.

    Attributes
    ----------
    path : str or Path
        The file; an existing one is replaced.
    every : int
        Write every ``every``-th step, and always the first and the last state.
    """

    path: str | Path
    every: int = 1

    @classmethod
    def of(cls, trajectory: "str | Path | Recording") -> "Recording":
        """Return a recording unchanged; a path alone means a recording of every step.

        Raises
        ------
        TrajectoryError
            If ``every`` is not allowed.
        """
        recording = trajectory if isinstance(trajectory, cls) else cls(trajectory)  # type: ignore[arg-type]
        if not isinstance(recording.every, Integral) or isinstance(recording.every, bool) or recording.every < 1:
            raise TrajectoryError(f"every = {recording.every!r}: allowed: a whole number >= 1; 1 writes each step")
        return recording


# -- reading ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BodyMotion:
    """The motion of one body, one row per recorded instant."""

    position: Array  # (n, 3) centre of mass, in the world
    origin: Array  # (n, 3) origin of its own frame, in the world
    quaternion: Array  # (n, 4) (w, x, y, z), from body axes to the world
    velocity: Array  # (n, 3) of the centre of mass, in the world
    angular_velocity: Array  # (n, 3) in body axes


@dataclass(frozen=True)
class ContactHistory:
    """The history of one contact, one row per recorded instant."""

    gap: Array  # (n,)
    impulse: Array  # (n, 3) during the step that ended here, (N, T1, T2)
    active: NDArray[np.bool_]  # (n,) whether in the index set of that step


@dataclass(frozen=True)
class Trajectory:
    """A recorded run: ``n`` instants, including the first and the last of the run.

    Attributes
    ----------
    description : dict
        The simulated mechanism as plain data.
    digest, engine : str
        Identities of the mechanism and of the engine's build.
    status, message : str
        How the run ended.
    settings, certificate : dict
        The settings of the run, and its certificate.
    units : dict
        Unit of each dataset, by its path in the file.
    time, step : (n,) arrays
        Instants, and lengths of the steps that ended there.
    kinetic, potential : (n,) arrays
        Energies.
    bodies, contacts, responses : dict
        Motion of each body, history of each contact and values of each response, by name.
    """

    description: dict[str, Any]
    digest: str
    engine: str
    status: str
    message: str
    settings: dict[str, Any]
    certificate: dict[str, Any]
    units: dict[str, str]
    time: Array
    step: Array
    kinetic: Array
    potential: Array
    bodies: dict[str, BodyMotion]
    contacts: dict[str, ContactHistory]
    responses: dict[str, Array]

    def __repr__(self) -> str:
        """Return what ran, how it ended and what is recorded, in a line; a motion has thousands of numbers."""
        what = f"{len(self.bodies)} bodies, {len(self.contacts)} contacts, {len(self.responses)} responses"
        end = f"{self.time[-1]:.6g} {self.units['time']}" if len(self.time) else "0"
        return (
            f"<Trajectory of {self.description.get('name')}, {self.status}: {len(self.time)} instants to {end}; {what}>"
        )

    def mechanism(self) -> Mechanism:
        """Return the simulated mechanism; raise MechanismError if this version does not know all its keys."""
        return mechanism_from(self.description, f"mechanism of the trajectory ({self.description.get('name')})")

    def force(self, contact: str) -> Array:
        """Return the mean force at a contact in each step, (N, T1, T2), shape (n, 3)."""
        return np.asarray(self.contacts[contact].impulse / self.step[:, None])


def read_trajectory(path: str | Path) -> Trajectory:
    """Read a whole trajectory file.

    Raises
    ------
    TrajectoryError
        If the file does not exist, is not a trajectory of clearcap, has a newer format, or is incomplete or damaged.
    """
    import h5py

    path = Path(path)
    if not path.is_file():
        raise TrajectoryError(f"trajectory {path}: no such file; write one with: clearcap simulate ... --trajectory")
    if not h5py.is_hdf5(path):
        raise TrajectoryError(f"trajectory {path}: not an HDF5 file; give one that clearcap simulate has written")
    try:
        with h5py.File(path, "r") as file:
            _check(path, file.attrs)
            return _read(file)
    except (OSError, KeyError, RuntimeError, TypeError, ValueError) as error:  # truncated, checksum, datasets missing
        raise TrajectoryError(f"trajectory {path}: damaged ({error}); simulate again") from error


def _check(path: Path, attributes: Any) -> None:
    """Refuse files of other programs, of newer versions, and of runs that were killed."""
    if attributes.get("format") != FORMAT:
        raise TrajectoryError(f"trajectory {path}: not a trajectory of clearcap; give one that it has written")
    if attributes["format_version"] != VERSION:
        raise TrajectoryError(
            f"trajectory {path}: format {attributes['format_version']}; this version reads {VERSION}; "
            "use the version of clearcap that wrote it"
        )
    if "status" not in attributes:
        raise TrajectoryError(f"trajectory {path}: incomplete: its run was killed; simulate again")


def _read(file: Any) -> Trajectory:
    """Return the content of an open file; raise ValueError if its datasets are inconsistent."""
    attributes, arrays, units = file.attrs, {}, {}
    for path in _datasets(file, ""):
        arrays[path], units[path] = file[path][:], str(file[path].attrs["unit"])
        if len(arrays[path]) != len(file["time"]):
            raise ValueError(f"{path} has {len(arrays[path])} rows, time {len(file['time'])}")
    return Trajectory(
        description=json.loads(file["mechanism"].asstr()[()]),
        **{name: str(attributes[name]) for name in ("digest", "engine", "status", "message")},
        settings=json.loads(attributes["settings"]),
        certificate={name: value.item() for name, value in file["certificate"].attrs.items()},
        units=units,
        time=arrays["time"],
        step=arrays["step"],
        kinetic=arrays["energy/kinetic"],
        potential=arrays["energy/potential"],
        bodies={name: BodyMotion(**_under(arrays, f"bodies/{name}/")) for name in file.get("bodies", ())},
        contacts={name: _contact(_under(arrays, f"contacts/{name}/")) for name in file.get("contacts", ())},
        responses=_under(arrays, "responses/"),
    )


def _datasets(group: Any, prefix: str) -> list[str]:
    """Return the paths of all series below a group, i.e. all datasets except the mechanism's text."""
    paths: list[str] = []
    for name, item in group.items():
        path = f"{prefix}{name}"
        paths += _datasets(item, f"{path}/") if hasattr(item, "items") else [path]
    return [path for path in paths if path != "mechanism"]


def _under(arrays: dict[str, Array], prefix: str) -> dict[str, Array]:
    return {path.removeprefix(prefix): array for path, array in arrays.items() if path.startswith(prefix)}


def _contact(arrays: dict[str, Array]) -> ContactHistory:
    return ContactHistory(arrays["gap"], arrays["impulse"], arrays["active"].astype(bool))


# -- forces ------------------------------------------------------------------------------------------------------------


def contact_forces(trajectory: Trajectory, instants: Sequence[int]) -> tuple[Array, Array]:
    """Return the contact points, and the mean forces over the recorded steps since the previous instant.

    The file stores impulses in each contact's own frame; here they are vectors in the world. A force is that on the
    contact's first body, or on the second if the first is fixed.

    `instants` are m rows of the trajectory, increasing; the first gets the force of its own step alone. Points and
    forces have shape (m, nc, 3).
    """
    # compiled code, which reading does not need
    from engine.assembly import assemble
    from engine.assembly.frames import order_bodies
    from engine.kernels.contact_geometry.gaps import find_contacts
    from engine.kernels.model import ROLLING
    from engine.kernels.motion import move

    mechanism = trajectory.mechanism()
    assembly, order = assemble(mechanism), order_bodies(mechanism)
    contacts, state, sites, step = assembly.model.contacts, assembly.state, assembly.work.sites, trajectory.step
    # in the plain scheme the frames are those at the end of a step
    within = (0.0 if trajectory.settings["scheme"] == "moreau_jean" else trajectory.settings["theta"]) * step
    sign = np.where(contacts.a < len(order), 1.0, -1.0)
    sign[contacts.kind >= ROLLING] = 0.0  # moments
    contacts.grain[:, 4:] = 1.0  # the file has impulses along unit tangents
    histories = [trajectory.contacts[name] for name in assembly.contact_names]
    points, forces = np.zeros((2, len(instants), len(sign), 3))
    since = instants[0]
    for i, row in enumerate(instants):
        for at in range(since, row + 1):
            # the contacts as in the step: at the pose of a row minus the last part of its displacement
            for body, motion in enumerate(trajectory.bodies[name] for name in order):
                state.x[body], state.p[body] = motion.position[at], motion.quaternion[at]
                state.v[body, :3], state.v[body, 3:] = motion.velocity[at], motion.angular_velocity[at]
            move(state, -float(within[at]))
            find_contacts(contacts, state.x, state.R, state.gap, sites.point, sites.frame)
            impulse = np.reshape([history.impulse[at] for history in histories], (-1, 3))
            forces[i] += np.einsum("c,ck,ckj->cj", sign, impulse, sites.frame)
        points[i] = sites.point
        forces[i] /= step[since : row + 1].sum()
        since = row + 1
    return points, forces
