"""Small assemblies made by hand, with something in every field."""

import numpy as np

from engine.cad.cad_model import (
    CadAssembly,
    CadEdge,
    CadFace,
    CadMaterial,
    CadPart,
    Placement,
    SizeLimits,
    Solid,
    SplineSurface,
    TriangleMesh,
)


def full_assembly(random):
    """Return an assembly of random numbers that has at least one of everything."""
    steel = CadMaterial(name="steel", density=7.85e-3)
    solid = Solid(name="", volume=8.0, centre=random.normal(size=3), inertia=np.eye(3), material=steel)
    placement = Placement(rotation=np.eye(3), translation=random.normal(size=3), mirrored=True)
    part = CadPart(
        name="crank-2",
        product="crank",
        path=("latch", "left", "Kurbel \N{GREEK SMALL LETTER ALPHA}"),
        placement=placement,
        material=None,
        solids=(solid, solid),
        bounds=random.normal(size=(2, 3)),
    )
    spline = SplineSurface(
        degrees=(1, 2),
        knots=(np.array([0.0, 0.0, 1.0, 1.0]), np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])),
        points=random.normal(size=(2, 3, 3)),
        weights=np.ones((2, 3)),
    )
    where = {"point": random.normal(size=3), "area": 2.5, "on": random.normal(size=3)}
    bore = CadFace(number=0, part="crank-2", solid=0, kind="cylinder", radius=3.05, hollow=True, **where)
    cam = CadFace(number=1, part="crank-2", solid=0, kind="surface", splines=(spline,), **where)
    edge = CadEdge(part="crank-2", faces=(0, 1), centre=random.normal(size=3), radius=3.05, span=1.5)
    limits = SizeLimits(kind="diameter", nominal=6.1, lower=6.09, upper=6.12, faces=(0,))
    mesh = TriangleMesh(
        part="crank-2", vertices=random.normal(size=(3, 3)), triangles=np.array([[0, 1, 2]]), faces=np.array([0])
    )
    return CadAssembly(
        sha256="0" * 64,
        unit="inch",
        schema="AP242",
        recognition=1e-4,
        parts=(part,),
        faces=(bore, cam),
        edges=(edge,),
        limits=(limits,),
        meshes=(mesh,),
        cautions=("left out",),
        unreadable=3,
        damaged=("crank-2",),
    )


def differences(a, b, path="") -> list[str]:
    """Return the paths of all numbers, texts and arrays in which two dataclasses differ."""
    if type(a) is not type(b):
        return [f"{path}: {type(a).__name__}, {type(b).__name__}"]
    if isinstance(a, np.ndarray):
        same = a.dtype == b.dtype and np.array_equal(a, b)
        return [] if same else [path]
    if isinstance(a, tuple):
        found = [] if len(a) == len(b) else [f"{path}: {len(a)}, {len(b)}"]
        return found + [d for i, (x, y) in enumerate(zip(a, b, strict=False)) for d in differences(x, y, f"{path}.{i}")]
    if hasattr(a, "__dataclass_fields__"):
        return [
            d
            for name in a.__dataclass_fields__
            for d in differences(getattr(a, name), getattr(b, name), f"{path}.{name}")
        ]
    return [] if a == b else [f"{path}: {a!r}, {b!r}"]
