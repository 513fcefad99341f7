"""Pictures of a mechanism and of a run, in Python."""

import pytest

import clearcap
from clearcap.questions.samples import ReplayedSample
from tests.engine.small import block_on_floor, made


def test_a_mechanism_and_a_run_are_drawn(tmp_path):
    """What is asked for is there, of the kind that the ending names, and names what was drawn."""
    mechanism = made(block_on_floor(origin=[0, 0, 0.1]))
    motion = tmp_path / "motion.h5"
    clearcap.simulate(mechanism, trajectory=motion)
    clearcap.draw(mechanism, tmp_path / "start.svg")
    assert b"what is measured" in (tmp_path / "start.svg").read_bytes()
    clearcap.draw(motion, str(tmp_path / "run.svg"))
    assert b"active contacts" in (tmp_path / "run.svg").read_bytes()
    clearcap.draw(clearcap.read_trajectory(motion), tmp_path / "run.html")
    assert b"<script" in (tmp_path / "run.html").read_bytes()


def test_an_ending_that_cannot_be_drawn_is_refused(tmp_path):
    """A mechanism does not move; the message has the path and what is allowed."""
    mechanism = made(block_on_floor(origin=[0, 0, 0.1]))
    for name in ("start.html", "start.jpg"):
        with pytest.raises(clearcap.SpecError, match=rf"{name}: unknown ending; allowed: .png, .svg, .pdf;"):
            clearcap.draw(mechanism, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_motion_and_a_campaign_are_shown_in_a_line(tmp_path):
    """Their names and sizes, not their numbers."""
    mechanism = made(block_on_floor(origin=[0, 0, 0.1]))
    clearcap.simulate(mechanism, trajectory=tmp_path / "motion.h5")
    motion = clearcap.read_trajectory(tmp_path / "motion.h5")
    assert repr(motion).startswith(f"<Trajectory of {mechanism.name}, ok: {len(motion.time)} instants to ")
    assert len(repr(motion)) < 200
    campaign = clearcap.load_campaign("c60", samples=12)
    shown = "<Campaign c60: 12 samples, 7 variables, limits of 6 responses, mechanism c60>"
    assert repr(campaign) == shown
    replayed = ReplayedSample(campaign="c60-1", sample=3, row={"status": "ok"}, stored={}, same=True, differences="")
    assert repr(replayed) == "<Sample 3 of c60-1, ok: same bits>"
