"""What may be read off and when: the description of responses, and what it refuses."""

import json
from typing import Any

import pytest

from engine.assembly import assemble
from engine.errors import MechanismError
from engine.mechanism import load_mechanism, mechanism_from, mechanism_schema, set_values, unit_of
from tests.each import each
from tests.engine.mechanism.plain import pendulum, put

POINT = {"body": "link", "point": [0, -8, 0]}
ALONG = {"vector": [0, 1, 0]}
POSITION = {"type": "position", "from": {"body": "ground", "point": [0, 0, 0]}, "to": POINT, "direction": ALONG}
EVERY = {
    "p": POSITION,
    "v": {"type": "velocity", "to": POINT, "direction": ALONG, "at": "maximum"},
    "phi": {"type": "angle", "body": "link", "axis": [0, 0, 1], "offset": 0.5},
    "spin": {"type": "angular_velocity", "body": "link", "relative_to": "ground", "axis": [0, 0, 1]},
    "gap": {"type": "gap", "contact": "J1.ring1", "at": "minimum", "from_phase": "free"},
    "normal": {"type": "contact_force", "contact": "stop"},
    "rub": {"type": "contact_force", "contact": "J1.ring2", "component": "friction"},
    "joint": {"type": "joint_force", "joint": "J1", "direction": {"body": "link", "vector": [1, 0, 0]}},
    "spring": {"type": "spring_force", "spring": "pull"},
    "couple": {"type": "spring_torque", "spring": "turn"},
    "push": {"type": "motion_force", "motion": "lift", "at": "maximum", "averaged_over": 0.1},
    "twist": {"type": "motion_torque", "motion": "swing"},
    "spent": {"type": "motion_work", "motion": "lift", "from_phase": "free"},
    "stroke": {"type": "motion_travel", "motion": "lift"},
    "wound": {"type": "motion_travel", "motion": "swing"},
    "push_on": {"type": "impulse", "response": "normal", "window": [0.1, 0.2]},
    "mostly": {"type": "mean", "response": "phi", "from_phase": "free"},
    "bounces": {"type": "bounces", "contact": "stop", "opening": 0.01},
    "when": {"type": "time", "at": {"response": "phi", "above": 1.0}},
    "where": {**POSITION, "at": {"response": "normal", "peak": "maximum"}, "to_phase": "hold"},
    "least": {"type": "contact_force", "contact": "stop", "bound": "least"},
    "less": {"type": "difference", "of": ["p", "gap"]},
    "high": {"type": "condition", "condition": "p > 3"},
    "effort": {"type": "formula", "formula": "-spring / 2"},
    "work": {"type": "formula", "formula": "effort * abs(p - less)", "quantity": "energy"},
    "pace": {"type": "formula", "formula": "p / when"},
    "lost": {"type": "difference", "of": ["effort", "joint"]},
}
UNITS = {
    "p": "mm",
    "v": "mm/ms",
    "phi": "rad",
    "spin": "rad/ms",
    "gap": "mm",
    "normal": "N",
    "rub": "N",
    "joint": "N",
    "spring": "N",
    "couple": "N mm",
    "push": "N",
    "twist": "N mm",
    "spent": "mJ",
    "stroke": "mm",
    "wound": "rad",
    "push_on": "N ms",
    "mostly": "rad",
    "bounces": "1",
    "when": "ms",
    "where": "mm",
    "least": "N",
    "less": "mm",
    "high": "1",
    "effort": "N",
    "work": "mJ",
    "pace": "mm/ms",
    "lost": "N",
}


def described() -> dict[str, Any]:
    """Describe a pendulum that reads everything; fresh at each call."""
    return put(put(pendulum(), "validity", []), "responses", json.loads(json.dumps(EVERY)))


def lines(data: dict[str, Any]) -> list[str]:
    """Return the lines of the one error that the data cause."""
    with pytest.raises(MechanismError) as caught:
        mechanism_from(data, "FILE")
    return [line.strip() for line in str(caught.value).split("\n")[1:]]


def test_every_kind_has_its_unit_and_its_arrays():
    """In the order of the file, with the unit of its quantity."""
    mechanism = mechanism_from(described(), "FILE")
    assert mechanism.response_units() == UNITS
    assert assemble(mechanism).model.responses.kind.size == len(EVERY)


def test_written_and_read_again_it_is_the_same():
    """Moments as texts, events as tables."""
    mechanism = mechanism_from(described(), "FILE")
    again = mechanism_from(json.loads(mechanism.model_dump_json(by_alias=True, exclude_none=True)), "JSON")
    assert again == mechanism
    assert again.digest() == mechanism.digest()


def test_the_limit_of_an_event_is_set_in_the_unit_of_what_is_watched():
    """Also of one that measures something else itself."""
    mechanism = mechanism_from(described(), "FILE")
    assert unit_of(mechanism, "responses.when.at.above") == "rad"
    changed = set_values(mechanism, {"responses.when.at.above": 1.25})
    limits = dict(zip(changed.responses, assemble(changed).model.responses.limit.tolist(), strict=True))
    assert limits["when"] == [1.25, 1.0]


def test_shipped_mechanisms_read_at_the_end():
    """What has no ``at`` is read when the run is over."""
    assert {response.at for response in load_mechanism("c60").responses.values()} == {"end"}


REFUSED = [
    ("p.type", "hight", "p.type = 'hight'", "position, velocity, angle"),
    ("p.at", "maximun", "p.at = 'maximun'", "did you mean 'maximum'?"),
    ("p.at", 3, "p.at = 3", "end, maximum, minimum, { response, above }"),
    ("p.at", {"response": "gap", "above": 1}, "p.at.response = 'gap'", "itself read at a peak or an event"),
    ("p.at", {"response": "p", "above": 1}, "p.at.response = 'p'", 'allowed: responses with at = "end"'),
    ("p.at", {"response": "phy", "above": 1}, "p.at.response = 'phy'", "did you mean 'phi'?"),
    ("p.at", {"response": "phi"}, "p.at: needs one limit", "exactly one of above, below"),
    ("p.at", {"response": "phi", "above": 1, "below": 2}, "p.at: needs one limit", "exactly one of above, below"),
    ("p.at", {"response": "phi", "above": "1"}, "p.at.above = '1'", "not a finite number"),
    ("p.at", {"response": "phi", "over": 1}, "p.at.over: unknown key", "response, above, below"),
    ("p.at", {"above": 1}, "p.at.response: missing", "the response that is watched"),
    ("p.from_phase", "free", "p.from_phase = 'free'", "maximum, minimum or an event"),
    ("v.from_phase", "fre", "v.from_phase = 'fre'", "did you mean 'free'?"),
    ("where.to_phase", "fre", "where.to_phase = 'fre'", "did you mean 'free'?"),
    ("where.at", {"response": "v", "peak": "maximum"}, "where.at.response = 'v'", "itself read at a peak"),
    ("where.at", {"response": "less", "peak": "maximum"}, "where.at.response = 'less'", "known only after the run"),
    ("where.at", {"response": "least", "peak": "maximum"}, "where.at.response = 'least'", "known only after the run"),
    ("where.at", {"response": "p", "peak": "top"}, "where.at.peak = 'top'", "'maximum' or 'minimum'"),
    ("least.bound", "most", "least.bound = 'most'", "'least' or 'largest'"),
    ("least.at", "maximum", "least.bound = 'least'", "component = normal and at = end"),
    ("less.of", ["p", "gp"], "less.of = 'gp'", "did you mean 'gap'?"),
    ("less.of", ["p", "normal"], "less.of = ['p', 'normal']", "responses of one quantity"),
    ("less.of", ["less", "p"], "less: follows from itself", "less -> less"),
    ("effort.formula", "-sprng", "effort.formula: sprng is no response and no parameter", "did you mean 'spring'?"),
    ("effort.formula", "-lost", "lost: follows from itself", "allowed: no circle"),
    ("effort.formula", "spring +", "effort.formula = 'spring +'", "the end comes where"),
    ("effort.formula", "spring + p", "effort.formula = 'spring + p'", "+ joins a force and a length"),
    ("effort.formula", "spring * p", "effort.formula = 'spring * p'", "may be: energy, torque"),
    (
        "effort.formula",
        "spring * spring * p",
        "effort.formula = 'spring * spring * p'",
        "of no quantity that has a unit",
    ),
    ("effort.formula", "sin(spring)", "effort.formula = 'sin(spring)'", "sin(...) of a force; allowed: a number"),
    ("work.quantity", "length", "work.formula = 'effort * abs(p - less)'", "not of the kind of length"),
    ("work.quantity", "wrk", "work.quantity = 'wrk'", "'energy'"),
    ("where.at", {"response": "pace", "peak": "maximum"}, "where.at.response = 'pace'", "known only after the run"),
    ("less.of", ["p"], "less.of.1: missing", "two responses of one quantity"),
    ("high.condition", "p >> 3", "high.condition = 'p >> 3'", "response > number"),
    ("high.condition", "q > 3", "high.condition = 'q > 3'", "no such response"),
    ("high.at", "end", "high.at: unknown key", "condition"),
    ("phi.relative_to", "link", "phi.relative_to = 'link'", "does not turn relative to itself"),
    ("phi.relative_to", "grund", "phi.relative_to = 'grund'", "did you mean 'ground'?"),
    ("phi.body", "lnk", "phi.body = 'lnk'", "did you mean 'link'?"),
    ("phi.axis", [0, 0, 0], "phi.axis = [0, 0, 0]", "has no direction"),
    ("v.to.body", "lnk", "v.to.body = 'lnk'", "did you mean 'link'?"),
    ("v.offset", 1.0, "v.offset: unknown key", "from_phase"),
    ("gap.contact", "J2.ring1", "gap.contact = 'J2'", "no such joint; defined here: J1"),
    ("gap.contact", "stp", "gap.contact = 'stp'", "did you mean 'stop'?"),
    ("gap.contact", "J1.ring 1", "gap.contact = 'J1.ring 1'", "such as J1.ring1"),
    ("rub.component", "tangent", "rub.component = 'tangent'", "'normal' or 'friction'"),
    ("joint.joint", "J2", "joint.joint = 'J2'", "no such joint"),
    ("joint.direction.body", "lnk", "joint.direction.body = 'lnk'", "did you mean 'link'?"),
    ("spring.spring", "pul", "spring.spring = 'pul'", "did you mean 'pull'?"),
    ("spring.spring", "turn", "spring.spring = 'turn'", "no such linear spring; defined here: pull"),
    ("couple.spring", "pull", "couple.spring = 'pull'", "no such torsion spring; defined here: turn"),
    ("push.motion", "lft", "push.motion = 'lft'", "no such translation; defined here: lift"),
    ("twist.motion", "lift", "twist.motion = 'lift'", "no such rotation; defined here: swing"),
    ("spent.motion", "lft", "spent.motion = 'lft'", "no such motion; defined here: lift, swing"),
    ("stroke.from_phase", "free", "stroke.from_phase = 'free'", "maximum, minimum or an event"),
    ("push_on.response", "phi", "push_on.response = 'phi'", "allowed: a force"),
    ("push_on.response", "nrmal", "push_on.response = 'nrmal'", "did you mean 'normal'?"),
    ("push_on.response", "push", "push_on.response = 'push'", "itself read at a peak"),
    ("push_on.window", [0.2, 0.1], "push_on.window = [0.2, 0.1]", "0 <= begin < end"),
    ("mostly.response", "push_on", "mostly.response = 'push_on'", "itself added up"),
    ("mostly.response", "less", "mostly.response = 'less'", "known only after the run"),
    ("bounces.opening", -1.0, "bounces.opening = -1.0 mm", "allowed: >= 0"),
    ("when.at", "maximum", "when.at = 'maximum'", "time has no peak"),
]


@each(("path", "value", "where", "allowed"), REFUSED)
def test_a_fault_has_a_line_that_names_key_and_remedy(path, value, where, allowed):
    """One line, which begins with the key."""
    (line,) = lines(put(described(), f"responses.{path}", value))
    assert line.startswith(f"responses.{where}")
    assert allowed in line


def test_a_contact_that_a_joint_does_not_have_is_refused_with_those_it_has():
    """Only the arrays know a joint's contacts: `mechanism check` says it, and every run."""
    with pytest.raises(MechanismError) as caught:
        assemble(mechanism_from(put(described(), "responses.gap.contact", "J1.rng2"), "FILE"))
    first, line = str(caught.value).split("\n")
    assert first == "pendulum: responses that cannot be read"
    assert line.startswith("  responses.gap.contact = 'J1.rng2': no such contact of the joint")
    assert "J1.ring1, J1.ring2; did you mean 'J1.ring2'?" in line


def test_schema_offers_moments_and_events():
    """An editor can complete both forms of ``at``."""
    at = mechanism_schema()["$defs"]["Gap"]["properties"]["at"]
    assert {"enum": ["end", "maximum", "minimum"], "type": "string"} in at["oneOf"]
    assert {"$ref": "#/$defs/Event"} in at["oneOf"]


@each(
    ("formula", "unit"),
    [
        ("2 * p - 0.5", "mm"),
        ("hypot(normal, rub)", "N"),
        ("phi / 2 + 1", "rad"),
        ("atan2(p, gap)", "rad"),
        ("normal / gap", "N/mm"),
        ("sqrt(p * gap)", "mm"),
        ("p ** 2 / gap", "mm"),
        ("p / gap", "1"),
        ("normal * when", "N ms"),
        ("max(couple, 0)", "N mm"),
        ("normal * arm / 8 * p ** -1 * gap", "N"),
        ("normal / joint * couple", "N mm"),
    ],
)
def test_the_unit_of_a_formula_follows_from_its_names(formula, unit):
    """Sums keep it, factors without a unit too, and products have that of their dimensions; arm is a pure number."""
    data = put(described(), "responses.effort.formula", formula)
    data["parameters"] = {"arm": 8.0} if "arm" in formula else {}
    data["responses"]["lost"]["of"] = ["p", "gap"]
    del data["responses"]["work"]
    assert mechanism_from(data, "FILE").response_units()["effort"] == unit


def test_a_name_with_a_hyphen_is_written_with_an_underscore():
    """Because - is minus; a parameter of the same name is refused."""
    data = put(described(), "responses.FC-1", {"type": "formula", "formula": "2 * p"})
    data = put(data, "responses.twice", {"type": "formula", "formula": "FC_1 - p"})
    assert mechanism_from(data, "FILE").response_units()["twice"] == "mm"
    (line,) = lines(put(data, "parameters", {"p": 1.0}))[:1]
    assert "p is both a response and a parameter" in line


@each(("y", "drawn"), [("effort", False), ("less", False), ("least", False), ("v", True), ("push", True)])
def test_a_plot_is_of_what_is_measured_in_each_step(y, drawn):
    """A formula is known only after the run, so there is no curve of it; a peak is one of a curve."""
    data = put(described(), "plot", {"x": "p", "y": y})
    if drawn:
        mechanism_from(data, "FILE")
    else:
        (line,) = lines(data)
        assert line.startswith(f"plot.y = '{y}': responses.{y} is known only after the run")
