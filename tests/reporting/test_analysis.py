"""The analysis of synthetic campaigns: who counts, who does not, and what the trust card says."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from reporting import ReportError
from reporting.analysis import OtherSpreads
from reporting.distributions.families import FAMILIES
from reporting.key_findings import key_findings
from reporting.samples import STATUSES
from reporting.tolerance.reweighting import Change
from tests.each import each
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def column(table: pa.Table, name: str, values) -> pa.Table:
    """Return the table with a column replaced, its metadata kept."""
    at = table.schema.get_field_index(name)
    array = pa.array(values)
    return table.set_column(at, table.field(at).with_type(array.type), array)


def check(analysis, name: str):
    return next(check for check in analysis.trust if check.name == name)


def test_counts_add_up(campaign) -> None:
    a = analysis_of(*campaign(60, 5, requested=80))
    assert (a.finished, a.ok, a.failed) == (60, 55, 5)
    assert [s.status for s in a.statuses] == list(STATUSES)
    assert sum(s.count for s in a.statuses) == 60
    assert {s.status: s.count for s in a.statuses}["crashed"] == 0
    assert check(a, "Complete").level == "attention"


def test_a_failed_run_is_in_no_statistic_but_in_the_yield(campaign) -> None:
    table, spec = campaign(60, 6)
    poisoned = table.column("FC-1").to_pylist()
    poisoned[-1] = 1e6
    a = analysis_of(column(table, "FC-1", poisoned), spec)
    fc1 = a.responses[0]
    assert fc1.capability.n == 54
    assert fc1.capability.max < 20
    assert fc1.yield_.finished == 60
    assert fc1.yield_.conforming == 54
    assert fc1.yield_.share == 0.9
    assert fc1.yield_.lower < 0.9
    assert fc1.yield_.cpk < fc1.capability.cpk


def test_without_failures_the_yields_cpk_is_cpk(campaign) -> None:
    a = analysis_of(*campaign(60))
    assert a.responses[0].yield_.cpk == a.responses[0].capability.cpk


def test_yields_cpk_is_the_quantile_of_the_failed_share(campaign) -> None:
    """FC-1 is so capable that only the failures count: Phi^-1(0.9) / 3."""
    a = analysis_of(*campaign(60, 6))
    assert a.responses[0].yield_.cpk == pytest.approx(1.2815515655446004 / 3, abs=1e-4)


def test_certain_only_if_the_interval_keeps_the_verdict(campaign) -> None:
    a = analysis_of(*campaign(500))
    for r in a.responses:
        if r.capability.cpk_interval is None:
            assert r.verdict.certain is None
        else:
            low, high = r.capability.cpk_interval
            if any(low < bar <= high for bar in (1.0, 1.33)):
                assert r.verdict.certain is False
            elif not r.verdict.certain:  # few values do not exclude heavier tails, nor a second population
                why = "Cpk assumes", "second population", "does not rule out"
                assert any(words in r.verdict.reasons[-1] for words in why)
    assert {r.verdict.certain for r in a.responses} == {True, False, None}
    unsure = ["FC-5"]
    assert check(a, "Enough samples").level == "attention"
    assert unsure[0] in check(a, "Enough samples").text
    assert check(a, "Verdicts").level == "attention"
    assert f"{unsure[0]} (" in check(a, "Verdicts").text


def test_limits_of_an_assumption_are_marked(campaign) -> None:
    a = analysis_of(*campaign())
    assert [r.assumed for r in a.responses] == [False, True, True, True, True, True, False]


@pytest.mark.parametrize(
    ("name", "value", "line"), [("max_residual", 2e-6, "Friction residual"), ("max_penetration", 2e-6, "Penetration")]
)
def test_one_bad_certificate_turns_the_card(campaign, name, value, line) -> None:
    table, spec = campaign(60, 4)
    assert check(analysis_of(table, spec), line).level == "good"
    numbers = table.column(name).to_pylist()
    numbers[17] = value
    found = check(analysis_of(column(table, name, numbers), spec), line)
    assert found.level == "bad"
    assert found.value == value
    assert "sample 17" in found.text
    numbers[17] = None
    assert check(analysis_of(column(table, name, numbers), spec), line).level == "bad"


def test_penetration_without_unit_has_no_bar(campaign) -> None:
    table, spec = campaign()
    at = table.schema.get_field_index("max_penetration")
    bare = table.set_column(at, "max_penetration", table.column(at))
    assert check(analysis_of(bare, spec), "Penetration").level == "info"


def test_unsettled_samples_are_told(campaign) -> None:
    table, spec = campaign()
    settled = [True] * 60
    settled[3] = False
    found = check(analysis_of(column(table, "settled", settled), spec), "Settled")
    assert (found.level, found.value) == ("attention", 1.0)


def with_remarks(table, at_impact, ambiguous=None):
    return table.append_column("at_impact", [at_impact]).append_column("ambiguous", [ambiguous or [False] * 60])


def test_forces_at_impacts_get_no_verdict(campaign) -> None:
    table, spec = campaign()
    name = spec.responses[0].name
    a = analysis_of(with_remarks(table, [name, f"other,{name}"] + [""] * 58), spec)
    assert a.responses[0].verdict.word == "no verdict"
    assert "2 of 60 values are forces in the step of an impact" in a.responses[0].verdict.reasons[0]
    assert a.responses[1].verdict.word != "no verdict"
    found = check(a, "Forces at impacts")
    assert (found.level, found.value) == ("attention", 2.0)


def test_samples_that_rest_by_their_history_are_told(campaign) -> None:
    table, spec = campaign()
    a = analysis_of(with_remarks(table, [""] * 60, [True] * 3 + [None] * 57), spec)
    found = check(a, "Self-locking")
    assert (found.level, found.value) == ("attention", 3.0)
    assert not any(line.name == "Forces at impacts" for line in a.trust)


def test_tables_without_remarks_say_nothing(campaign) -> None:
    for table, spec in (campaign(), (with_remarks(campaign()[0], [""] * 60), campaign()[1])):
        assert not {"Forces at impacts", "Self-locking"} & {line.name for line in analysis_of(table, spec).trust}


def test_inputs_that_are_not_what_was_asked_are_told(campaign) -> None:
    table, spec = campaign(200)
    assert check(analysis_of(table, spec), "Inputs as requested").level == "good"
    shifted = table.column("J3").to_numpy() + 0.1
    found = check(analysis_of(column(table, "J3", shifted), spec), "Inputs as requested")
    assert (found.level, "J3" in found.text) == ("bad", False)
    shifted = np.clip(table.column("J3").to_numpy() * 0.9, 0.01, 0.13)
    found = check(analysis_of(column(table, "J3", shifted), spec), "Inputs as requested")
    assert (found.level, "J3" in found.text) == ("attention", True)


def test_a_skewed_response_is_told(campaign) -> None:
    found = check(analysis_of(*campaign(500)), "Shape")
    assert found.level == "attention"
    assert "FC-6" in found.text


def test_every_family_is_tried_for_every_response(campaign) -> None:
    """Before, the search ended at the first of eight families that was close, and never tried Johnson's."""
    for response in analysis_of(*campaign(400)).responses:
        tried = {fit.family for fit in response.fits.fits} | set(response.fits.refused)
        assert tried == set(FAMILIES)
        assert response.fits.of("johnson_su") is not None
        assert all(fit.passes for fit in response.fits.fits if fit.family in response.fits.candidates)


def test_failures_name_the_most_frequent_status_and_its_message(campaign) -> None:
    a = analysis_of(*campaign(60, 4))
    found = check(a, "Failures")
    assert found.level == "bad"
    assert "Most frequent: timeout, first in sample 56" in found.text
    assert "residual 3e-06 at contact C7" in found.text


def test_failed_samples_come_with_the_command_that_repeats_them(campaign) -> None:
    table, spec = campaign(60, 25)
    a = analysis_of(table, spec)
    assert len(a.failures) == 20
    assert [f.sample for f in a.failures] == list(range(35, 55))
    j1 = table.column("J1").to_pylist()[35]
    assert a.failures[0].command.startswith(f"clearcap simulate c60 --set J1={j1!r} --set J2=")
    assert a.failures[0].command.count("--set") == 7


def test_command_uses_keys_and_quotes_them(campaign) -> None:
    table, spec = campaign(10, 1)
    first = replace(spec.variables[0], key="springs.A 3.preload")
    spec = replace(
        spec, variables=(first, *spec.variables[1:]), simulate="clearcap simulate 'my file.toml' --step 0.005"
    )
    command = analysis_of(table, spec).failures[0].command
    assert command.startswith("clearcap simulate 'my file.toml' --step 0.005 --set 'springs.A 3.preload=0.")


def test_rows_may_come_in_any_order(campaign) -> None:
    table, spec = campaign(60, 4)
    shuffled = table.take(np.random.default_rng(1).permutation(60))
    assert analysis_of(shuffled, spec) == analysis_of(table, spec)


def test_nan_in_ok_rows_is_left_out_counted_and_told(campaign) -> None:
    table, spec = campaign(60)
    holed = table.column("FC-1").to_pylist()
    holed[0], holed[1] = float("nan"), None
    a = analysis_of(column(table, "FC-1", holed), spec)
    assert a.responses[0].missing == 2
    assert a.responses[0].yield_.conforming == 58
    assert check(a, "Values").level == "bad"
    assert "FC-1 2" in check(a, "Values").text


def test_an_unknown_status_is_counted_too(campaign) -> None:
    table, spec = campaign(10)
    a = analysis_of(column(table, "status", ["ok"] * 9 + ["melted"]), spec)
    assert (a.statuses[-1].status, a.statuses[-1].count) == ("melted", 1)


def change(table: pa.Table, what: str) -> pa.Table:
    """Return a table that no longer fits its spec."""
    changes = {
        "missing response": lambda: table.drop_columns(["FC-3"]),
        "missing certificate": lambda: table.drop_columns(["settled"]),
        "text response": lambda: column(table, "FC-3", ["x"] * len(table)),
        "numbers as status": lambda: column(table, "status", [1] * len(table)),
        "empty status": lambda: column(table, "status", [None] * len(table)),
        "repeated sample": lambda: pa.concat_tables([table.slice(0, 5), table.slice(4, 1)]),
        "no number": lambda: column(table, "sample", [None, *range(1, len(table))]),
        "double column": lambda: table.append_column("FC-3", table.column("FC-3")),
    }
    return changes[what]()


@each(
    ("what", "said"),
    [
        ("missing response", "column 'FC-3' is missing"),
        ("missing certificate", "column 'settled' is missing"),
        ("text response", "column 'FC-3' holds string; it must hold numbers"),
        ("numbers as status", "column 'status' holds int64; it must hold text"),
        ("empty status", "sample 0 has no status"),
        ("repeated sample", "sample 4 appears more than once"),
        ("no number", "column 'sample' has 1 empty rows"),
        ("double column", "column 'FC-3' appears 2 times"),
    ],
)
def test_a_table_that_does_not_fit_is_one_clear_error(campaign, what, said) -> None:
    table, spec = campaign(10)
    with pytest.raises(ReportError, match=said):
        analysis_of(change(table, what), spec)


def test_a_spec_that_makes_no_sense_is_one_clear_error(campaign) -> None:
    table, spec = campaign(10)
    crossed = replace(spec, responses=(replace(spec.responses[0], lsl=16.0, usl=9.0),))
    with pytest.raises(ReportError, match=r"FC-1: lsl = 16 .*usl = 9\b"):
        analysis_of(table, crossed)
    with pytest.raises(ReportError, match="'J1' names more than one"):
        analysis_of(table, replace(spec, variables=(*spec.variables, spec.variables[0])))
    with pytest.raises(ReportError, match=r"\b10 rows.*\b9 samples"):
        analysis_of(table, replace(spec, requested=9))
    with pytest.raises(ReportError, match="requested = 0"):
        analysis_of(table.slice(0, 0), replace(spec, requested=0))


def test_advice_asks_more_cpk_of_values_that_need_it(campaign) -> None:
    """Heavy tails: Cpk 1.4, but a worse verdict; the advice names what must shrink, for a larger Cpk."""
    table, spec = campaign(1500)
    spec = replace(spec, responses=spec.responses[1:2], variables=spec.variables[:1])
    heavy = np.random.default_rng(3).standard_t(3, 1500)
    table = column(table, "FC-2", 10.6 + heavy * 0.25 / (3 * 1.4 * heavy.std()))

    def flat(factors, columns) -> Change:
        return Change(0.0 * columns["J1"], 0.0, factors["J1"])

    analysis = analysis_of(table, spec, OtherSpreads(flat))
    fc2 = next(r for r in analysis.responses if r.spec.name == "FC-2")
    assert fc2.capability.cpk > 1.33 > fc2.index
    assert fc2.verdict.word in ("marginal", "not capable")
    assert (analysis.kept, analysis.advice) == ((), ())
    (short,) = analysis.shortfalls
    assert (short.response, short.index, short.target) == ("FC-2", fc2.index, 1.33 * short.cpk / fc2.index)
    assert f"to Cpk {short.target:.2f} (index 1.33)" in key_findings(analysis)[-2].text


def test_what_chance_makes_look_not_normal_keeps_the_verdict_of_cpk() -> None:
    """A response with p = 0.02 is not proven not to be normal, alone or as one of six."""
    x = np.random.default_rng(4).gumbel(size=100)
    table, spec = c60_table(100), c60_spec(100)
    table = column(table, "FC-1", 12.5 + (x - x.mean()) / x.std(ddof=1) * 3.5 / 4.5)
    alone = replace(spec, responses=spec.responses[:1])
    one, among_six = (analysis_of(table, s).responses[0] for s in (alone, spec))
    assert 0.01 < one.normality.p < 0.04
    assert (one.verdict.by, one.expected.by) == ("index", "normal")
    assert (among_six.verdict.by, among_six.expected.by) == ("index", "normal")
    assert not among_six.verdict.certain


def test_a_boundary_has_no_index_and_no_share_beyond_it_unless_a_value_passes_it(campaign) -> None:
    """An ovality: the lower limit 0 is what no part can pass, and not what production must keep."""
    table, spec = campaign(200, 0)
    x = np.abs(np.random.default_rng(3).normal(1.0, 0.8, size=200))
    first = replace(spec.responses[0], lsl=0.0, usl=9.0, target=None)
    cpks = {}
    for boundary, moved in (("", 0.0), ("lower", 0.0), ("lower", -2.0)):
        ovality = replace(spec, responses=(replace(first, boundary=boundary), *spec.responses[1:]))
        c = analysis_of(column(table, "FC-1", x + moved), ovality).responses[0].capability
        cpks[boundary, moved] = (c.cpl is None, c.cpk > 1.33)
    assert cpks == {("", 0.0): (False, False), ("lower", 0.0): (True, True), ("lower", -2.0): (False, False)}


def test_samples_without_a_value_count_as_failed_ones_do(campaign) -> None:
    """Of 400 values the 5 % largest are missing: nobody knows where they lie."""
    table, spec = campaign(400, 0)
    x = np.sort(np.random.default_rng(5).normal(size=400))
    wide = replace(spec, responses=(replace(spec.responses[0], lsl=-6.5, usl=6.5, target=None), *spec.responses[1:]))
    missing = np.where(np.arange(400) < 380, x, np.nan)
    found = analysis_of(column(table, "FC-1", missing), wide).responses[0].verdict
    assert (found.word, "20 of 400 samples have no value" in found.reasons[0]) == ("no verdict", True)
    few = np.where(np.arange(400) < 398, x, np.nan)
    assert analysis_of(column(table, "FC-1", few), wide).responses[0].verdict.word == "capable"
