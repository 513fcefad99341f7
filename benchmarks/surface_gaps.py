"""Processor time of gaps of spheres and arcs on surfaces of patches, compared with closed forms."""

from time import thread_time
from typing import Any

import numpy as np

from benchmarks.machine import quickest_us
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.mechanism.contacts import Contact
from tests.engine.kernels.shapes import compiled
from tests.engine.kernels.surface_shapes import wavy

POSES = 5000
SHEETS = {24: (9, 7), 210: (18, 17), 2021: (50, 46)}  # control points along u and v, by number of patches
SPHERE = {"sphere": {"centre": [0, 0, 0], "radius": 0.1}}
CIRCLE = {"arc": {"centre": [0, 0, 0], "normal": [0.2, 0.1, 1], "radius": 0.3}}
CLOSED = {
    "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]},
    "cylinder": {"point": [0, 0, -50], "axis": [1, 0, 0], "radius": 50},
    "rectangle": {"centre": [5, 4, 0], "normal": [0, 0, 1], "along": [1, 0, 0], "half_lengths": [5, 4]},
}


def measure() -> list[dict[str, Any]]:
    """Return a row for each side b: times [us] of a sphere along a path and at random places, and of a circle."""
    sides = {kind: {kind: shape} for kind, shape in CLOSED.items()}
    sides |= {f"surface, {count} patches": {"surface": wavy(*size)} for count, size in SHEETS.items()}
    return [_row(name, side) for name, side in sides.items()]


def _row(name: str, side: dict[str, Any]) -> dict[str, Any]:
    t = np.linspace(0.1, 0.9, POSES)
    path = np.stack([10 * t, 8 * t[::-1], np.full(POSES, 0.8)], axis=-1)
    anywhere = np.random.default_rng(0).uniform([0.5, 0.5, 0.6], [9.5, 7.5, 1.2], (POSES, 3))
    return {
        "side b": name,
        "sphere, path us": _us(SPHERE, side, path),
        "sphere, random us": _us(SPHERE, side, anywhere),
        "circle, random us": _us(CIRCLE, side, anywhere[:500]),
    }


def _us(first: dict[str, Any], second: dict[str, Any], q: np.ndarray) -> float:
    """Return the time of one contact [us], with body a at each place in turn."""
    n = len(q)
    contact = Contact.model_validate({"a": {"body": "a", **first}, "b": {"body": "b", **second}, "friction": 0.1})
    x, R = np.concatenate([q, np.zeros((n, 3))]), np.broadcast_to(np.eye(3), (2 * n, 3, 3)).copy()
    contacts, written = compiled(contact, n), (np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3)))
    return quickest_us(lambda: find_contacts(contacts, x, R, *written), repeats=5, clock=thread_time) / n
