"""What must shrink, what may grow, and which set of tolerances is cheapest."""

import itertools
import json
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from typer.testing import CliRunner

from campaign.inputs.sampling import draw
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from clearcap.cli import app
from clearcap.questions.report import advice_of, analysis, report
from clearcap.questions.tolerances import cheapest_tolerances, read_costs
from clearcap.questions.whatif import changed_variables, what_if
from reporting import capability
from reporting.tolerance.advice import DecidingIndex
from tests.campaign import fake_engine
from tests.campaign.driving import computed


@pytest.fixture
def filled(campaign, tmp_path):
    """Return a store and a plan of 400 samples with rows of the fake engine."""
    plan = make_plan(replace(campaign, spec=campaign.spec.model_copy(update={"samples": 400})), 200)
    store = open_store(str(tmp_path / "runs"))
    store.create_plan(plan)
    for batch in range(len(plan.batches)):
        run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(batch))
    return store, plan


def test_the_cheapest_set_keeps_what_is_locked(filled, tmp_path):
    """A free variable moves, a locked one does not; the runs that confirm it are told."""
    store, plan = filled
    path = tmp_path / "costs.toml"
    path.write_text("[variables.J1]\ncost = 0.05\n[variables.preload]\ncost = 1.0\nlocked = true\n")
    found = cheapest_tolerances(store, plan, read_costs(path, plan))
    assert found.runs > 500
    if not found.refusal:
        assert found.factors["preload"] == pytest.approx(1.0)
        assert found.cost <= found.cost_now
        assert found.written["preload"] == ()
        new = changed_variables(plan.spec, found.written["J1"]).variables["J1"]
        assert new.moments()[1] == pytest.approx(found.tolerances["J1"], rel=0.02)


def test_every_cost_law_gets_a_proposal_from_the_command(campaign_file, tmp_path):
    """Power, exponential and processes in one file; the chosen process is named, with its standard deviation."""
    store, plan = computed(tmp_path / "s", load_campaign(str(campaign_file), samples=400), 200)
    path = tmp_path / "costs.toml"
    path.write_text(
        "[variables.J1]\n"
        "processes = [{std = 0.03, cost = 1, name = 'drilled'}, {std = 0.001, cost = 9, name = 'honed'}]\n"
        "[variables.preload]\ncost = 2.0\nscale = 0.1\n"
    )
    told = CliRunner().invoke(app, ["advise", plan.campaign_id, "--store", store.url, "--cost", str(path)])
    assert told.exit_code == 0, told.output
    assert "drilled" in told.stdout or "honed" in told.stdout
    assert "process" in told.stdout


@pytest.mark.slow
def test_a_response_that_is_below_does_not_hide_the_others(campaign_file, tmp_path):
    """What may grow is asked of the capable responses; what must shrink, of each that is not, to lift it to 1.33."""
    path = campaign_file.parent / "narrow.toml"
    path.write_text(campaign_file.read_text() + '\n[responses.FC-2]\nlsl = 16.99\nusl = 18.79\nindex = "cpk"\n')
    store, plan = computed(tmp_path / "s", load_campaign(str(path), samples=400), 200)
    table = store.table(plan.campaign_id)
    cpk = capability(table["FC-2"].to_numpy(), lsl=16.99, usl=18.79).cpk
    assert 1.0 < cpk < 1.33
    found = advice_of(store, plan)
    (j1, preload) = found.growth
    assert 1.0 < j1.interval[0] == j1.factor
    assert j1.below["FC-2"] < cpk
    assert (preload.factor, preload.ended_by) == (1.0, "bounds")  # a uniform variable fills its bounds
    (short,) = found.shortfalls
    json_of = CliRunner().invoke(app, ["advise", plan.campaign_id, "--store", store.url, "--json"]).stdout
    assert [a["factor"] for a in json.loads(json_of)["below"]["FC-2"]] == [a.factor for a in short.alone]
    assert (short.response, short.cpk) == ("FC-2", pytest.approx(cpk))
    helping = [each for each in (*short.alone, short.together) if each.factor is not None]
    assert helping
    assert all(each.factor < 1.0 and each.cpk == pytest.approx(1.33, abs=0.01) for each in helping)
    told = CliRunner().invoke(app, ["advise", plan.campaign_id, "--store", store.url])
    assert told.exit_code == 0
    assert "FC-2 is below Cpk 1.33" in told.stdout


@pytest.mark.parametrize("form", [[], ["--json"]])
def test_an_answer_that_is_missing_ends_with_status_1(campaign_file, tmp_path, form):
    """As of `whatif`: which variables have none, and why; the rest is printed all the same."""
    store, plan = computed(tmp_path / "s", load_campaign(str(campaign_file), samples=10), 10)
    told = CliRunner().invoke(app, ["advise", plan.campaign_id, "--store", store.url, *form])
    assert told.exit_code == 1
    assert "no answer for J1, preload (how much they may grow): the samples are worth 10 samples" in told.stderr
    assert "preload" in told.stdout


def test_a_constant_has_no_tolerance(campaign_file, tmp_path):
    """Nothing is advised of a variable that does not vary."""
    path = campaign_file.parent / "constant.toml"
    path.write_text(campaign_file.read_text() + '\n[variables.J2]\ndistribution = "constant"\nvalue = 0.05\n')
    store, plan = computed(tmp_path / "s", load_campaign(str(path), samples=400), 200)
    assert "J2" in plan.spec.variables
    assert [each.variable for each in advice_of(store, plan).growth] == ["J1", "preload"]


LIFT = """\
format = 1
name = "lift"
mechanism = "c60"
samples = 400
seed = 3
correlations = [["J1", "J2", 0.6]]

[variables.J1]
mean = 0.07
std = 0.0175
lower = 0.01
upper = 0.13

[variables.J2]
distribution = "lognormal"
origin = 0.01
log_mean = -2.83
log_std = 0.2
upper = 0.2

[variables.J3]
distribution = "normal"
mean = 0.07
std = 0.006

[variables.preload]
target = "springs.A3.preload"
distribution = "uniform"
lower = 0.9
upper = 1.0

[responses.FC-1]
lsl = 9.70
usl = 10.30

[responses.FC-2]
lsl = 19.92

[responses.FC-3]
usl = 30.5

[responses.FC-4]
lsl = 3.0
usl = 3.55
"""


CENTRES = {"J1": 0.07, "J2": 0.07, "J3": 0.07, "preload": 0.95}
FORMULAS = {
    "FC-1": lambda j1, j2, j3, _: 10 + 3 * j1 + 2 * j2 + 0.5 * j3,
    "FC-2": lambda j1, j2, j3, _: 20 + 0.3 * j1 + 10 * j3**2 + 0.5 * j2,
    "FC-3": lambda _j1, j2, _j3, preload: 30 + 5 * preload + j2,
    "FC-4": lambda j1, _j2, j3, _: 3.5 + 2 * j3 + 0.3 * j1,
}


def lifts(broken_above, mechanism, values, **settings):
    """Return responses of a lift, linear and curved; the run fails where J3 is above a limit."""
    run = fake_engine.simulate(mechanism, values)
    at = [values["springs.A3.preload" if name == "preload" else name] - centre for name, centre in CENTRES.items()]
    found = {name: formula(*at) for name, formula in FORMULAS.items()}
    if values["J3"] > broken_above:
        return replace(run, status="not_converged", message="J3 is wide", responses={})
    return replace(run, responses=run.responses | found)


@pytest.fixture(scope="module")
def lift(tmp_path_factory):
    """Return a maker of a computed lift: a text that replaces another one in its file, and where runs fail."""
    folder, count = tmp_path_factory.mktemp("lift"), itertools.count()

    @cache
    def make(old="", new="", broken_above=1.0):
        path = folder / "lift.toml"
        path.write_text(LIFT.replace(old, new) if old else LIFT)
        return computed(folder / f"store{next(count)}", load_campaign(str(path)), 200, partial(lifts, broken_above))

    return make


@pytest.fixture(scope="module")
def advised(lift):
    """Return what is advised on the lift as it is."""
    return advice_of(*lift())


LOGNORMAL = 'distribution = "lognormal"\norigin = 0.01\nlog_mean = -2.83\nlog_std = 0.2'
BETA = 'distribution = "beta"\nlower = 0.01\nalpha = 6.0\nbeta = 13.0'
LOTS = "std = 0.006\nbatch = {size = 5, std = 0.004}"
EVERY = {"correlated": ("", ""), "lots": ("std = 0.006", LOTS), "beta": (LOGNORMAL, BETA)}


@pytest.mark.parametrize(
    "changed", [pytest.param(x, id=name, marks=pytest.mark.slow if x[0] else ()) for name, x in EVERY.items()]
)
def test_whatif_of_what_is_advised_gives_the_target(lift, changed):
    """Each factor, given to whatif as it is printed, gives the target; an emulator answers from other samples."""
    store, plan = lift(*changed)
    found = advice_of(store, plan)
    indices = analysis(store, plan).responses
    aims = {
        r.spec.name: DecidingIndex(r.capability.cpk, r.index, r.spec.requirement).target
        for r in indices
        if r.capability.cpk is not None
    }
    promised = [(each, list(found.kept)) for each in found.growth if each.settings]
    promised += [(a, [s.response]) for s in found.shortfalls for a in (*s.alone, s.together) if a.settings]
    asked = 0
    for advice, responses in promised:
        answers = what_if(store, plan, list(advice.settings))
        cpks = [answers[name].cpk for name in responses]
        asked += 1
        targets = aims | {short.response: short.target for short in found.shortfalls}
        least = min(cpk.value / targets[name] for name, cpk in zip(responses, cpks, strict=True))
        if advice.bounded:
            assert least == pytest.approx(1.0, abs=0.01 if advice.method == "reweighting" else 0.03)
        else:
            assert least >= 0.99
    assert asked >= 4


@pytest.mark.slow
def test_what_lies_off_centre_is_told_to_move(advised):
    """FC-4 has room in its limits, but not where its mean lies: centred, it needs no smaller tolerance."""
    short = next(s for s in advised.shortfalls if s.response == "FC-4")
    assert short.centred > 1.33 > short.cpk
    assert "off centre: moving the mean by -0.22" in short.text


@pytest.mark.slow
def test_runs_that_fail_limit_a_growth_or_end_the_advice(lift):
    """Where wide J3 fails, J3 may grow until 1 % of the runs do; with more failures now, nothing is advised."""
    text = ("lsl = 9.70\nusl = 10.30", "lsl = 9.50\nusl = 10.50")
    store, plan = lift(*text)
    free = next(each for each in advice_of(store, plan).growth if each.variable == "J3")
    store, plan = lift(*text, broken_above=0.0865)  # 2.75 sigma
    held = next(each for each in advice_of(store, plan).growth if each.variable == "J3")
    assert held.binding == "runs without a value"
    assert 1.0 < held.factor < 1.25
    assert held.factor < free.factor
    store, plan = lift(*text, broken_above=0.08)  # 4.8 % fail
    found = advice_of(store, plan)
    assert (found.growth, found.shortfalls) == ((), ())
    assert "% of the runs have no value" in found.note


@pytest.mark.slow
def test_the_page_and_the_command_say_what_must_shrink(lift, advised):
    """The same factors in both; the growth names whom it keeps, and what it costs those below."""
    (store, plan), found = lift(), advised
    files = report(store, plan, kinds=("html", "json", "xlsx"))
    page, content = (Path(files[kind]).read_text(encoding="utf-8") for kind in ("html", "json"))
    assert "What must shrink?" in page
    assert f"while {', '.join(found.kept)} keep" in page
    assert "every response" not in page[page.index('id="shrink"') :][:20_000].split("</table>")[0]
    shown = json.loads(content)
    assert [s["response"] for s in shown["shortfalls"]] == [s.response for s in found.shortfalls]
    alone = next(a for a in found.shortfalls[0].alone if a.factor)
    assert alone.written[0] in page
    for short in found.shortfalls:
        page_s = next(s for s in shown["shortfalls"] if s["response"] == short.response)
        assert [a["factor"] for a in page_s["alone"]] == [a.factor for a in short.alone]
    sheet = openpyxl.load_workbook(files["xlsx"])["Advice"]
    in_sheet = {(row[0], row[1]): row[2] for row in sheet.iter_rows(min_row=2, values_only=True)}
    assert in_sheet[f"bring {found.shortfalls[0].response} to Cpk 1.33", alone.variable] == pytest.approx(alone.factor)
    words = CliRunner().invoke(app, ["advise", plan.campaign_id, "--store", store.url], env={"COLUMNS": "250"}).stdout
    assert f"that keeps {', '.join(found.kept)} at Cpk 1.33" in words
    assert "its bounds allow no more" in words


@pytest.mark.slow
@pytest.mark.parametrize("rank", [0.6, -0.6])
def test_fresh_samples_keep_what_is_promised(lift, rank):
    """100,000 samples drawn anew with what is written: Cpk is that of 400 samples within three standard errors.

    With the shares of the variance, which overlap where variables are correlated, Cpk fell short by 14 %.
    """
    store, plan = lift('[["J1", "J2", 0.6]]', f'[["J1", "J2", {rank}]]')
    found = advice_of(store, plan)
    promised = [(a, s.response) for s in found.shortfalls for a in (*s.alone, s.together)]
    promised += [(each, each.binding) for each in found.growth]
    checked = 0
    for advice, response in promised:
        if not advice.settings or not advice.bounded or response not in FORMULAS:
            continue
        new = changed_variables(plan.spec, advice.settings).variables
        spec = plan.spec.model_copy(update={"variables": {**plan.spec.variables, **new}, "samples": 100_000})
        y = FORMULAS[response](*(draw(spec, 0, 100_000)[name] - c for name, c in CENTRES.items()))
        cpk = capability(y, *plan.spec.responses[response].limits()[:2]).cpk
        assert cpk == pytest.approx(1.33, abs=3 * 1.33 / np.sqrt(2 * 400))
        checked += 1
    assert checked >= 3
