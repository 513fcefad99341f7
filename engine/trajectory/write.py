"""Write the trajectory of a run in blocks during the run; the file gets its name once it is complete.

Each dataset takes its numbers from their position in a row of `kernels.record`.
"""

import json
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from engine.arrays import Array
from engine.assembly import Assembly
from engine.assembly.frames import order_bodies, rotate
from engine.errors import TrajectoryError
from engine.kernels.record import BODY, CONTACT, HEAD
from engine.mechanism import Mechanism
from engine.platform.build import build_id
from engine.run import Run
from engine.trajectory import FORMAT, VERSION, Recording

CHUNK = 1024  # rows compressed together


@dataclass(frozen=True)
class Series:
    """One dataset of the file."""

    path: str  # name of the dataset in the file
    width: int  # numbers per row; 1 gives a one-dimensional dataset
    unit: str
    about: str  # meaning of the numbers
    # maps rows, shape (n, row length), to those of the dataset, shape (n,) or (n, width)
    take: Callable[[Array], Array]
    dtype: str = "f8"  # in which the numbers are stored


def series_of(mechanism: Mechanism, assembly: Assembly) -> Iterator[Series]:
    """Yield all datasets of a mechanism's trajectory, in the order of a row."""
    time, energy = mechanism.unit("time"), mechanism.unit("energy")
    yield _number("time", 0, time, "time since the start of the run")
    yield _number("step", 1, time, "length of the step that led here")
    yield _number("energy/kinetic", 2, energy, "kinetic energy of all bodies")
    yield _number("energy/potential", 3, energy, "energy stored in gravity and springs")
    at = HEAD
    for name in order_bodies(mechanism):
        yield from _of_body(mechanism, name, at)
        at += BODY
    for name in assembly.contact_names:
        yield from _of_contact(mechanism, name, at)
        at += CONTACT
    units = mechanism.response_units()
    for i, (name, response) in enumerate(mechanism.responses.items()):
        yield _number(f"responses/{name}", at + i, units[name], response.title or name)


def _of_body(mechanism: Mechanism, name: str, at: int) -> Iterator[Series]:
    length = mechanism.unit("length")
    centre = mechanism.stretch(name) * np.array(mechanism.bodies[name].center_of_mass)
    group = f"bodies/{name}"
    origin = partial(_origin, at=at, centre=centre)
    yield _vector(f"{group}/position", at, length, "centre of mass, in the world")
    yield Series(f"{group}/origin", 3, length, "origin of the body's own frame, in the world", origin)
    yield _vector(f"{group}/quaternion", at + 3, "1", "(w, x, y, z) of the rotation from body axes to the world", 4)
    yield _vector(f"{group}/velocity", at + 7, mechanism.unit("speed"), "of the centre of mass, in the world")
    yield _vector(f"{group}/angular_velocity", at + 10, mechanism.unit("angular speed"), "in body axes")


def _of_contact(mechanism: Mechanism, name: str, at: int) -> Iterator[Series]:
    group, unit = f"contacts/{name}", mechanism.unit("impulse")
    about = "impulse of the step that led here, along (N, T1, T2); divided by /step: the force"
    if "~" in name:  # what resists rolling or spinning, see `engine.kernels.rolling`
        unit = f"{mechanism.unit('torque')} {mechanism.unit('time')}"
        about = "the largest moment, then those about (T1, T2) or (N, nothing), times /step"
    yield _number(f"{group}/gap", at, mechanism.unit("length"), "signed gap")
    yield _vector(f"{group}/impulse", at + 1, unit, about)
    yield _number(f"{group}/active", at + 4, "1", "1 if the contact was in the index set of the step", "u1")


def _number(path: str, at: int, unit: str, about: str, dtype: str = "f8") -> Series:
    return Series(path, 1, unit, about, lambda rows: rows[:, at], dtype)


def _vector(path: str, at: int, unit: str, about: str, width: int = 3) -> Series:
    return Series(path, width, unit, about, lambda rows: rows[:, at : at + width])


def _origin(rows: Array, at: int, centre: Array) -> Array:
    """Return x - Phi(p) centre, shape (n, 3), for a body whose numbers begin at column ``at``."""
    return rows[:, at : at + 3] - rotate(rows[:, at + 3 : at + 7], centre)


class TrajectoryWriter:
    """A trajectory file that is being written; created by `trajectory_file`."""

    def __init__(self, file: Any, mechanism: Mechanism, assembly: Assembly) -> None:
        self._file = file
        for group in ("bodies", "contacts", "responses"):
            file.create_group(group, track_order=True)  # listed in the order of the run, not alphabetically
        self._series = [(series, _dataset(file, series)) for series in series_of(mechanism, assembly)]

    def append(self, rows: Array) -> None:
        """Add rows of `kernels.record`, shape (n, row length)."""
        for series, dataset in self._series:
            n = len(dataset)
            dataset.resize(n + len(rows), axis=0)
            dataset[n:] = series.take(rows)

    def finish(self, run: Run) -> None:
        """Write how the run ended; without this a file counts as incomplete."""
        self._file.create_group("certificate").attrs.update(asdict(run.certificate))
        self._file.attrs["message"] = run.message
        self._file.attrs["status"] = run.status


@contextmanager
def trajectory_file(
    recording: Recording, mechanism: Mechanism, assembly: Assembly, *, full_horizon: bool
) -> Iterator[TrajectoryWriter]:
    """Open a trajectory file under a temporary name, and give it its own name at the end of the block.

    Raises TrajectoryError if the file cannot be written.
    """
    path = Path(recording.path)
    temporary = path.with_name(f"{path.name}.{os.getpid()}-{secrets.token_hex(4)}.tmp")
    settings = {**mechanism.simulation.model_dump(mode="json"), "every": recording.every, "full_horizon": full_horizon}
    try:
        # the format of HDF5 1.10: half the size of the oldest one if there are many datasets
        with h5py.File(temporary, "x", libver=("v110", "v110")) as file:
            _describe(file, mechanism, settings)
            yield TrajectoryWriter(file, mechanism, assembly)
        # the content must be on the disk before the name is, or a loss of power could leave the name without it
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise TrajectoryError(
            f"trajectory {path}: cannot be written ({error.strerror or error}); "
            "name a file in a folder you may write to, on a disk with room"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def _describe(file: Any, mechanism: Mechanism, settings: dict[str, Any]) -> None:
    """Write the mechanism, the settings and the build of the engine."""
    file.attrs["format"] = FORMAT
    file.attrs["format_version"] = VERSION
    file.attrs["mechanism"] = mechanism.name
    file.attrs["digest"] = mechanism.digest()
    file.attrs["engine"] = build_id()
    file.attrs["units"] = mechanism.units
    file.attrs["settings"] = json.dumps(settings)
    description = mechanism.model_dump(mode="json", by_alias=True, exclude_none=True)
    file["mechanism"] = json.dumps(description, ensure_ascii=False)  # may exceed the size limit of an attribute


def _dataset(file: Any, series: Series) -> Any:
    """Create an empty, extendable dataset for a series."""
    more = () if series.width == 1 else (series.width,)
    dataset = file.create_dataset(
        series.path,
        shape=(0, *more),
        maxshape=(None, *more),
        chunks=(CHUNK, *more),
        dtype=series.dtype,
        compression="gzip",
        shuffle=True,
        fletcher32=True,
    )
    dataset.attrs["unit"] = series.unit
    dataset.attrs["description"] = series.about
    return dataset
