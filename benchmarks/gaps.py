"""Queries of gap, point and frame of a contact, for every pair of primitives, at random poses."""

from functools import partial
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from benchmarks.machine import quickest_us
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.mechanism.contacts import PAIRS, Contact
from tests.engine.kernels.shapes import compiled, drawn, scattered

CONTACTS = 10  # drawn for each pair
POSES = 500  # for each contact
TEETH = 50  # of a ratchet wheel, with two lines each
FAR, NEAR = 20.0, 0.7  # spread of the bodies; solids and arcs have a size of about 1


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
