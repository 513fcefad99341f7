"""From classes and zones in a STEP file to diameters, deviations and variables."""

import re
import tomllib

import pytest
from typer.testing import CliRunner

from campaign.inputs.sampling import draw
from campaign.spec.campaign_file import CampaignSpec, proposed_campaign
from clearcap.cli import app
from engine import load_mechanism
from engine.cad import read_step
from engine.cad_import.drawn_tolerances import all_diameters, all_zones, unused_tolerances
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_mechanism import proposed_mechanism
from engine.mechanism.keys.values import set_values
from tests.engine.cad.fits import lever

pytestmark = pytest.mark.processes


def proposed(folder, drawing):
    """Return the text of the mechanism, and what was found, with its file written and its questions answered."""
    drawing.write(folder / "lever.step")
    found = find_geometry(read_step(folder / "lever.step"))
    text = proposed_mechanism(found, "lever.step", "lever")
    (folder / "lever.toml").write_text(text.replace("# density", "density").replace("# fixed", "fixed"))
    return text, found


def campaign_of(found):
    """Return the proposed campaign."""
    text = proposed_campaign(all_diameters(found), all_zones(found), "lever.toml", "lever")
    return CampaignSpec.model_validate(tomllib.loads(text))


def test_a_fit_and_zones_become_variables(tmp_path):
    """Hole and pin drawn equal: H7 and g6 give the play that was asked for; position with (M), and a tilt."""
    text, found = proposed(tmp_path, lever(width=0.1, maximum_material=True))
    assert "radial_clearance; which" not in text
    mechanism = load_mechanism(tmp_path / "lever.toml")
    joint = mechanism.joints["base-lever"]
    assert joint.radial_clearance == pytest.approx((12.009 - 11.9885) / 2, abs=1e-12)
    spec = campaign_of(found)
    words = {name: variable.words() for name, variable in spec.variables.items()}
    assert re.search("12 H7, assumed Cpk 1.33", words["base_lever_hole"])
    assert re.search("12 g6, assumed Cpk 1.33", words["base_lever_pin"])
    assert spec.variables["base_lever_hole_share"].zone == 2.0
    assert spec.variables["base_lever_hole_tilt"].zone == pytest.approx(2 * 0.02 / 10.0)
    targets = spec.targets()
    assert targets["base_lever_hole_way"] == "joints.base-lever.bearing.deviation.way"
    assert targets["base_lever_hole_tilt_way"] == "joints.base-lever.bearing.deviation.tilt_way"
    assert unused_tolerances(found) == ["flatness, 0.03 mm of lever", "roundness, 0.01 mm of lever"]
    assert set_values(mechanism, {key: 0.001 for key in targets.values() if "deviation" in key})  # they are its keys
    # with (M) the axis may be off by half the zone and half of what the bore is wider than its smallest size
    at_edge = set_values(mechanism, {"parameters.base_lever_hole": 12.018, "parameters.base_lever_hole_share": 1.0})
    assert at_edge.joints["base-lever"].bearing.deviation.off == pytest.approx((0.1 + 0.018) / 2, abs=1e-12)


def test_a_zone_without_a_modifier(tmp_path):
    """The distance itself varies: no place is further off than half the zone."""
    _, found = proposed(tmp_path, lever(width=0.1))
    spec = campaign_of(found)
    assert spec.targets()["base_lever_hole_off"] == "joints.base-lever.bearing.deviation.off"
    off = draw(spec, 0, 200)["base_lever_hole_off"]
    assert 0.04 < off.max() <= 0.05


def test_what_is_not_used_is_said(tmp_path):
    """A press fit leaves no play, one class alone leaves it open; then (M) has no bonus; a zone of another unit."""
    for drawing, unused in (
        (lever("H7", "p6"), ["diameter 12 H7 of lever", "diameter 12 p6 of base"]),
        (lever("H7", ""), ["diameter 12 H7 of lever"]),
        (
            lever("", "g6", width=0.1, maximum_material=True),
            ["diameter 12 g6 of base", "position, a cylinder of 0.1 mm (M), to A, B of lever"],
        ),
        # OCCT declares them as metres in a file without dimensions
        (lever("", "", width=0.1), ["position, a cylinder of 100 mm, to A, B of lever"]),
    ):
        drawing.write(tmp_path / "lever.step")
        found = find_geometry(read_step(tmp_path / "lever.step"))
        assert unused_tolerances(found)[: len(unused)] == unused
    text, _ = proposed(tmp_path, lever("H7", "p6"))
    assert "The CAD file has hole 12 H7 and pin 12 p6." in text


def imported(*words):
    """Return what the import prints."""
    done = CliRunner().invoke(app, ["mechanism", "import", *map(str, words)])
    assert done.exit_code == 0, done.exception
    return done.stdout


def test_a_new_revision(tmp_path):
    """Classes and zones follow it where they are as proposed; what a person wrote stays, and what changed is said."""
    path, campaign = tmp_path / "lever.toml", tmp_path / "lever-campaign.toml"
    position = {"width": 0.1, "maximum_material": True}
    imported(lever(**position).write(tmp_path / "a.step"), "-o", path, "--no-pictures")
    text = campaign.read_text().replace('"12 H7"\ncpk = 1.33', '"12 H7"\ncpk = 1.67').replace('"12 g6"', '"12 h6"')
    campaign.write_text(text.replace("zone = 0.004", "zone = 0.003") + "\n[responses.z]\nusl = 1.0\n")
    path.write_text(path.read_text().replace("friction = 0.0", "friction = 0.15"))
    position["width"] = 0.2
    said = imported(lever("H8", "f7", **position).write(tmp_path / "b.step"), "--update", path)
    for line in (
        '-dimension = "12 H7"',
        '+dimension = "12 H8"',
        "-base_lever_hole = 12.009 ",
        "-base_lever_pin = 11.9885 ",
    ):
        assert f"\n{line}" in said
    assert 'variables.base_lever_pin.dimension: proposed is now "12 f7", and was "12 g6"' in said
    variables = tomllib.loads(campaign.read_text())["variables"]
    assert (variables["base_lever_hole"]["dimension"], variables["base_lever_hole"]["cpk"]) == ("12 H8", 1.67)
    assert variables["base_lever_pin"]["dimension"] == "12 h6"
    assert variables["base_lever_hole_tilt"]["zone"] == 0.003
    assert tomllib.loads(campaign.read_text())["responses"] == {"z": {"usl": 1.0}}
    tables = tomllib.loads(path.read_text())
    assert tables["parameters"]["base_lever_hole"] == pytest.approx(12.0135)
    assert tables["materials"]["contact"]["friction"] == 0.15
    off = tables["joints"]["base-lever"]["bearing"]["deviation"]["off"]
    assert off == "base_lever_hole_share * (0.2 + base_lever_hole - 12) / 2"
    # without (M) the share is gone; then there is a distance to vary, and without the zones nothing of them
    said = imported(lever("H8", "f7", width=0.2).write(tmp_path / "c.step"), "--update", path)
    assert "no longer in the STEP file: [variables.base_lever_hole_share]; remove it" in said
    assert tomllib.loads(campaign.read_text())["variables"]["base_lever_hole_off"]["zone"] == 0.2
    said = imported(lever("H8", "f7").write(tmp_path / "d.step"), "--update", path)
    gone = ("off", "way", "tilt", "tilt_way")
    assert all(f"no longer in the STEP file: [variables.base_lever_hole_{each}]" in said for each in gone)
    assert "deviation" not in tomllib.loads(path.read_text())["joints"]["base-lever"]["bearing"]
    assert tomllib.loads(campaign.read_text())["variables"]["base_lever_hole_tilt"]["zone"] == 0.003
