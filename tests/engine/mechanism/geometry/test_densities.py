"""Densities by number, by the name of a material, and for all parts of which the CAD file has none."""

import hashlib
from math import pi

import numpy as np
import pytest
import tomli_w

from engine import MechanismError, load_mechanism
from engine.mechanism.materials import DENSITIES, density_of
from tests.engine.cad.crane import ARM, BORE, COVER, FOOT, PIN, PLAY, WEIGHT, crane

pytestmark = pytest.mark.processes

FOOT_VOLUME = np.prod(FOOT) + pi * PIN**2 * (ARM[2] + 2 * PLAY) + pi * (PIN + 2) ** 2 * 1.5
COVER_VOLUME, WEIGHT_VOLUME = np.prod(COVER), np.prod(WEIGHT)
ARM_VOLUME = np.prod(ARM) - pi * BORE**2 * ARM[2]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Return the path of a crane whose cover has no material; all else is of steel."""
    return crane(material=None).write(tmp_path_factory.mktemp("crane") / "crane.step")


@pytest.fixture
def load(tmp_path, drawn):
    """Return a function that loads the crane with keys of its bodies and of `[cad]`."""

    def loaded(base, arm=None, cad=None, units="mm-g-ms"):
        path = tmp_path / "crane.toml"
        data = {
            "format": 1,
            "name": "crane",
            "units": units,
            "cad": {"file": str(drawn), "sha256": hashlib.sha256(drawn.read_bytes()).hexdigest(), **(cad or {})},
            "simulation": {"step": 0.1, "horizon": 20.0, "penetration": 1e-6, "rest": {"window": 2.0, "drift": 1e-5}},
            "bodies": {"base": base, "arm": {"parts": ["arm", "weight"], **(arm or {})}},
        }
        path.write_text(tomli_w.dumps(data))
        return load_mechanism(path)

    return loaded


BASE = {"parts": ["foot", "cover"]}
STEEL = 7.85e-3


def test_one_for_all_that_have_none(load):
    """The file's default is that of the cover; the foot keeps the density of the CAD file."""
    for density, number in ((2e-3, 2e-3), ("PA66-GF30", 1.37e-3)):
        mechanism = load(BASE, cad={"density": density})
        assert mechanism.bodies["base"].mass == pytest.approx(STEEL * FOOT_VOLUME + number * COVER_VOLUME, rel=1e-9)
        assert mechanism.bodies["arm"].mass == pytest.approx(STEEL * (ARM_VOLUME + WEIGHT_VOLUME), rel=1e-9)
    assert mechanism.geometry.bodies["bodies.base"].density_from == "the CAD file (steel) and [cad] (PA66-GF30)"


def test_in_si(load):
    """The name of a material has the same meaning in kg and m."""
    body = load(BASE, arm={"density": "brass"}, cad={"density": "POM"}, units="SI").bodies
    assert body["arm"].mass == pytest.approx(8.47e-6 * (ARM_VOLUME + WEIGHT_VOLUME), rel=1e-9)
    assert body["base"].mass == pytest.approx((STEEL * FOOT_VOLUME + 1.41e-3 * COVER_VOLUME) / 1000, rel=1e-9)


def test_of_a_body(load):
    """One for all solids, one for each, or those of some parts; they go before the CAD file."""
    weights = {
        "aluminium": 2.7e-3 * (ARM_VOLUME + WEIGHT_VOLUME),
        ("POM", 8.47e-3): 1.41e-3 * ARM_VOLUME + 8.47e-3 * WEIGHT_VOLUME,
        (("weight", "brass"),): STEEL * ARM_VOLUME + 8.47e-3 * WEIGHT_VOLUME,
    }
    for density, mass in weights.items():
        given = density if isinstance(density, str) else dict(density) if len(density) == 1 else list(density)
        body = load({"part": "foot"}, arm={"density": given}).bodies["arm"]
        assert body.mass == pytest.approx(mass, rel=1e-9)


@pytest.mark.parametrize(
    ("base", "cad", "key", "said"),
    [
        (BASE, {}, "bodies.base.density", "no density of cover; .* density to \\[cad\\]"),
        (BASE, {"density": "brss"}, "cad.density", "no material of this name; .*brass"),
        (BASE, {"density": 0.0}, "cad.density", "allowed: a number > 0"),
        ({**BASE, "density": "pom 2"}, {}, "bodies.base.density", "no material of this name"),
        ({**BASE, "density": {"lid": 1.0}}, {}, "bodies.base.density", "'lid' is no part of this body"),
        ({**BASE, "density": [1.0]}, {}, "bodies.base.density", "a list of 2"),
    ],
)
def test_what_is_wrong(load, base, cad, key, said):
    """Each fault names its key, and what may be written."""
    with pytest.raises(MechanismError, match=f"(?s){said}") as error:
        load(base, cad=cad)
    assert key in [fault.key for fault in error.value.faults]


def test_names_of_materials():
    """However they are spelled."""
    assert density_of("pa66 gf30") == DENSITIES["PA66-GF30"] == density_of("PA 66-GF 30")
    assert density_of("Aluminum") == DENSITIES["aluminium"]
    assert density_of("unobtainium") is None
