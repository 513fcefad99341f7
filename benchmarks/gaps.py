"""Queries of gap, point and frame of a contact.

`measure` has every pair of primitives, at random poses; `measure_surfaces` has spheres and arcs on surfaces of patches,
compared with closed forms.
"""

from functools import partial
from statistics import median
from time import process_time, thread_time
from typing import Any

import numpy as np

from benchmarks.machine import quickest_us
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.mechanism.contacts import PAIRS, Contact
from tests.engine.kernels.shapes import compiled, drawn, scattered
from tests.engine.kernels.surface_shapes import wavy

CONTACTS = 10  # drawn for each pair
POSES = 500  # for each contact
TEETH = 50  # of a ratchet wheel, with two lines each
FAR, NEAR = 20.0, 0.7  # spread of the bodies; solids and arcs have a size of about 1
PLACES = 5000  # of a sphere on a surface
SHEETS = {24: (9, 7), 210: (18, 17), 2021: (50, 46)}  # control points along u and v, by number of patches
SPHERE = {"sphere": {"centre": [0, 0, 0], "radius": 0.1}}
CIRCLE = {"arc": {"centre": [0, 0, 0], "normal": [0.2, 0.1, 1], "radius": 0.3}}
CLOSED = {
    "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]},
    "cylinder": {"point": [0, 0, -50], "axis": [1, 0, 0], "radius": 50},
    "rectangle": {"centre": [5, 4, 0], "normal": [0, 0, 1], "along": [1, 0, 0], "half_lengths": [5, 4]},
}


def measure(unit_us: float) -> list[dict[str, Any]]:
    """Return a row for each pair of primitives; ``unit_us`` is the reference [us]."""
    rng = np.random.default_rng(1)
    rows = [_row(pair, [drawn(pair, rng) for _ in range(CONTACTS)], unit_us, rng) for pair in PAIRS]
    for first in ("point", "arc"):
        sides = [drawn(f"{first}-extruded", rng).sides[0] for _ in range(CONTACTS)]
        rows.append(_row(f"{first}-ratchet of {2 * TEETH} lines", [_on_ratchet(a) for a in sides], unit_us, rng))
    return rows


def _row(name: str, contacts: list[Contact], unit_us: float, rng: np.random.Generator) -> dict[str, Any]:
    near = [_query_us(contact, NEAR, rng) for contact in contacts]
    far = [_query_us(contact, FAR, rng) for contact in contacts]
    return {
        "pair": name,
        "near us": median(near),
        "in solves": median(near) / unit_us,
        "slowest us": max(near),
        "far us": median(far),
    }


def _query_us(contact: Contact, spread: float, rng: np.random.Generator) -> float:
    """Return the mean processor time of a query [us] at poses with this spread."""
    poses, arrays = scattered(POSES, rng, spread), compiled(contact, POSES)
    x, R = np.concatenate(poses.x), np.concatenate(poses.R)
    gap, point, frame = np.zeros(POSES), np.zeros((POSES, 3)), np.zeros((POSES, 3, 3))
    query = partial(find_contacts, arrays, x, R, gap, point, frame)
    return quickest_us(query, repeats=10, clock=process_time) / POSES


def _on_ratchet(a: Any) -> Contact:
    """Return a contact of side a with a ratchet wheel of radius 1."""
    angles = np.arange(2 * TEETH) * np.pi / TEETH
    radii = np.where(np.arange(2 * TEETH) % 2, 1.0, 0.95)
    start, *others = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1).tolist()
    wheel = {"point": [0, 0, 0], "axis": [0, 0, 1], "along": [1, 0, 0], "half_length": 0.2, "start": start}
    b = {"body": "b", "extruded": {**wheel, "profile": [{"to": p} for p in others]}}
    return Contact.model_validate({"a": a, "b": b, "friction": 0.1})


def measure_surfaces() -> list[dict[str, Any]]:
    """Return a row for each side b: times [us] of a sphere along a path and at random places, and of a circle."""
    sides = {kind: {kind: shape} for kind, shape in CLOSED.items()}
    sides |= {f"surface, {count} patches": {"surface": wavy(*size)} for count, size in SHEETS.items()}
    return [_surface_row(name, side) for name, side in sides.items()]


def _surface_row(name: str, side: dict[str, Any]) -> dict[str, Any]:
    t = np.linspace(0.1, 0.9, PLACES)
    path = np.stack([10 * t, 8 * t[::-1], np.full(PLACES, 0.8)], axis=-1)
    anywhere = np.random.default_rng(0).uniform([0.5, 0.5, 0.6], [9.5, 7.5, 1.2], (PLACES, 3))
    return {
        "side b": name,
        "sphere, path us": _place_us(SPHERE, side, path),
        "sphere, random us": _place_us(SPHERE, side, anywhere),
        "circle, random us": _place_us(CIRCLE, side, anywhere[:500]),
    }


def _place_us(first: dict[str, Any], second: dict[str, Any], q: np.ndarray) -> float:
    """Return the time of one contact [us], with body a at each place in turn."""
    n = len(q)
    contact = Contact.model_validate({"a": {"body": "a", **first}, "b": {"body": "b", **second}, "friction": 0.1})
    x, R = np.concatenate([q, np.zeros((n, 3))]), np.broadcast_to(np.eye(3), (2 * n, 3, 3)).copy()
    contacts, written = compiled(contact, n), (np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3)))
    return quickest_us(lambda: find_contacts(contacts, x, R, *written), repeats=5, clock=thread_time) / n
