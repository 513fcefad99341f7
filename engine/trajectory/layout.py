"""The datasets of a trajectory file, and the position of their numbers in a row of `kernels.record`."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from engine.arrays import Array
from engine.assembly import Assembly
from engine.assembly.frames import order_bodies, rotate
from engine.kernels.record import BODY, CONTACT, HEAD
from engine.mechanism import Mechanism


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
    length, centre = mechanism.unit("length"), np.array(mechanism.bodies[name].center_of_mass)
    group = f"bodies/{name}"
    origin = partial(_origin, at=at, centre=centre)
    yield _vector(f"{group}/position", at, length, "centre of mass, in the world")
    yield Series(f"{group}/origin", 3, length, "origin of the body's own frame, in the world", origin)
    yield _vector(f"{group}/quaternion", at + 3, "1", "(w, x, y, z) of the rotation from body axes to the world", 4)
    yield _vector(f"{group}/velocity", at + 7, mechanism.unit("speed"), "of the centre of mass, in the world")
    yield _vector(f"{group}/angular_velocity", at + 10, mechanism.unit("angular speed"), "in body axes")


def _of_contact(mechanism: Mechanism, name: str, at: int) -> Iterator[Series]:
    group = f"contacts/{name}"
    about = "impulse of the step that led here, along (N, T1, T2); divided by /step: the force"
    yield _number(f"{group}/gap", at, mechanism.unit("length"), "signed gap")
    yield _vector(f"{group}/impulse", at + 1, mechanism.unit("impulse"), about)
    yield _number(f"{group}/active", at + 4, "1", "1 if the contact was in the index set of the step", "u1")


def _number(path: str, at: int, unit: str, about: str, dtype: str = "f8") -> Series:
    return Series(path, 1, unit, about, lambda rows: rows[:, at], dtype)


def _vector(path: str, at: int, unit: str, about: str, width: int = 3) -> Series:
    return Series(path, width, unit, about, lambda rows: rows[:, at : at + width])


def _origin(rows: Array, at: int, centre: Array) -> Array:
    """Return x - Phi(p) centre, shape (n, 3), for a body whose numbers begin at column ``at``."""
    return rows[:, at : at + 3] - rotate(rows[:, at + 3 : at + 7], centre)
