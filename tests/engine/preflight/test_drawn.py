"""Cautions about what is drawn and set: time that is too short, springs pressed far."""

from tests.engine.preflight.examples import guided, lever, warned


def test_a_horizon_before_the_end_of_the_phases():
    """0.6 s in two phases cannot end within 0.5 s; a phase with an event may end sooner, and does not count."""
    data = guided(simulation={"horizon": 0.5}, phases=[{"name": "a", "duration": 0.4}, {"name": "b", "duration": 0.2}])
    (text,) = warned(data)
    assert text == (
        "simulation.horizon = 0.5 s: the phases of a given duration last 0.6 s together, so that no run comes to its"
        " end; customary: more than 0.6 s; raise it"
    )
    data["phases"][1]["until"] = {"response": "x", "above": 1.0}
    assert warned(data) == []


def test_a_longest_step_below_the_shortest():
    """Somebody has raised the step alone."""
    data = lever()
    data["simulation"] |= {"step": 0.1, "adaptive": {"longest": 0.02, "travel": 0.01}}
    assert any(
        text.startswith("simulation.adaptive.longest = 0.02 ms: shorter than simulation.step = 0.1")
        for text in warned(data)
    )


def test_a_pad_beyond_its_plane():
    """The normal of an elastic stop that points into the material: 0.9 m of rubber are pressed as drawn."""
    plane = {"body": "ground", "plane": {"point": [0.9, 0, 0], "normal": [1, 0, 0]}}
    pad = {"a": {"body": "ball", "point": [0, 0, 0]}, "b": plane, "stiffness": 100.0, "friction": 0.0}
    data = guided(contacts={"pad": pad}, phases=[{"name": "run", "duration": 0.5}])
    (text,) = warned(data)
    assert text.startswith("contacts.pad: its parts overlap by 0.9 m as drawn, where it presses with 90 N; move a part")
    plane["plane"]["normal"] = [-1, 0, 0]
    assert warned(data) == []
    plane["plane"] = {"point": [-0.9, 0, 0], "normal": [-1, 0, 0]}
    pad["offset"] = 0.9
    assert len(warned(data)) == 1, "an offset adds to the overlap"
