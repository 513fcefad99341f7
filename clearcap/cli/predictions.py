"""Verbs that answer from a campaign's samples, without new runs: ``whatif``, ``advise``, ``design``, ``calibrate``."""

import math
from dataclasses import asdict
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.errors import SpecError
from clearcap.cli.options import CampaignId, Id, StoreUrl, on_cluster, opened_campaign
from clearcap.cli.output import (
    Json,
    console,
    display,
    labelled,
    number,
    print_json,
    print_table,
    print_text,
    say,
)
from clearcap.output_files import check_output, replacing

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster
    from campaign.plan import Plan
    from campaign.store import Store
    from clearcap.questions.tolerances import Costs
    from reporting.emulation.calibration import Calibration
    from reporting.tolerance.advice import Advice, ToleranceAdvice
    from reporting.tolerance.allocation import Allocation
    from reporting.tolerance.whatif import Estimate, WhatIf


def whatif(
    campaign: Id = None,
    settings: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="VARIABLE.KEY=VALUE",
            help="Change a key of a distribution, for example J1.std=0.01; may be repeated.",
        ),
    ] = [],  # noqa: B006
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Estimate the capability under other distributions from the computed samples, without new runs.

    Exit status 1 if a response has no answer; a message then says which, why, and how many new runs it takes. The
    answers of the other responses are printed all the same.
    """
    from clearcap.questions.whatif import refusals, share_in_words, what_if, what_if_document

    if not settings:
        raise SpecError("no --set is given, so no distribution changes; write for example --set J1.std=0.01")
    opened, plan = opened_campaign(store, campaign)
    answers = what_if(opened, plan, settings)
    document = what_if_document(plan, opened.url, settings, answers)
    if json:
        print_json(document)
    else:
        units, rows = plan.mechanism.response_units(), []
        for name, answer in answers.items():
            cells = ["-"] * 3 if answer.refusal else map(_cell, (answer.mean, answer.std, answer.cpk))
            share = " ".join(filter(None, share_in_words(document["responses"][name]))) or "-"
            rows.append((labelled(name, units[name]), *cells, share, f"{answer.effective:.0f}"))
        heads = ("response", "mean", "sigma", "Cpk", "ppm out of limits", "worth samples")
        print_table("under the new distributions, 95 % intervals", heads, rows, texts=1)
    for assumption in document["assumed"]:
        say(assumption)
    for words in _failures(answers):
        say(words)
    for note in dict.fromkeys(note for answer in answers.values() for note in answer.notes):
        say(f"{', '.join(name for name, answer in answers.items() if note in answer.notes)}: {note}")
    for reason in dict.fromkeys(answer.emulated for answer in answers.values() if answer.emulated):
        names = [name for name, answer in answers.items() if answer.emulated == reason]
        runs = max(answers[name].runs for name in names)
        say(f"{', '.join(names)}: emulated, as {reason}; {runs} new runs with these distributions would confirm it")
    refused = refusals(answers)
    for each in refused:
        of = "any response" if len(each.responses) == len(answers) > 1 else ", ".join(each.responses)
        say(
            f"no answer for {of}: {each.reason}; run a campaign with these distributions:"
            f" {each.runs} samples give Cpk, or sigma where there are no limits, to within 5 %"
        )
    if refused:
        raise typer.Exit(1)


def _failures(answers: "dict[str, WhatIf]") -> list[str]:
    """Return how many runs would have no value, in one line for all responses with the same share."""
    by_words: dict[str, list[str]] = {}
    for name, answer in answers.items():
        if answer.missing is not None and answer.dropped:
            now = answer.dropped / (answer.n + answer.dropped)
            words = f"{100 * answer.missing:.3g} % of the runs would have no value (now {100 * now:.3g} %)"
            by_words.setdefault(words, []).append(name)
    return [f"{', '.join(names)}: {words}; the numbers describe the others" for words, names in by_words.items()]


def _cell(estimate: "Estimate | None") -> str:
    if estimate is None:
        return "-"
    low, high = estimate.interval
    if not high > low:
        return number(estimate.value)
    if not math.isfinite(high - low):
        return f"{number(estimate.value)} (no interval)"
    # enough digits to distinguish the ends of the interval
    digits = 2 + math.floor(math.log10(max(abs(low), abs(high))) - math.log10(high - low))
    places = min(max(digits + 1, 5), 17)
    return f"{number(estimate.value, places)} ({number(low, places)} to {number(high, places)})"


@on_cluster
def advise(
    where: "Cluster",
    campaign: Id = None,
    cost: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Cost file: propose the cheapest standard deviations.")
    ] = None,
    confirm: Annotated[
        bool, typer.Option("--confirm", help="Compute fresh runs that judge the cheapest set, and improve it by them.")
    ] = False,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Show which tolerances must shrink and which may grow, or with --cost which set of tolerances is cheapest.

    With --confirm a campaign with these tolerances is computed; its rows propose the next set if a response misses its
    target, or a tolerance may grow farther than the first rows reach. The same command, given again, continues.

    Exit status 1 if a variable has no answer, there is no set that reaches the targets, or fresh runs do not confirm
    it; a message then says which and why. The other answers are printed all the same.
    """
    if confirm and cost is None:
        raise SpecError("--confirm: judges the cheapest set of a cost file; give it with --cost FILE")
    if where.options() and not confirm:
        raise SpecError(f"{where.options()[0]}: only --confirm computes; leave it out, or give --confirm too")
    from clearcap.questions.tolerances import (
        advice_document,
        allocation_document,
        cheapest_tolerances,
        read_costs,
    )

    opened, plan = opened_campaign(store, campaign)
    if cost is None:
        from clearcap.questions.report import advice_of

        advised = advice_of(opened, plan)
        if json:
            print_json(advice_document(plan, opened.url, advised))
        else:
            _print_advice(advised)
        if advised.note:
            say(advised.note)
        if not _is_answered(advised):
            raise typer.Exit(1)
        return
    costs = read_costs(cost, plan)
    if confirm:
        again = opened.command("advise", plan.campaign_id, "--cost", str(cost), "--confirm", *where.options())
        _confirm(where, opened, plan, costs, again, json)
        return
    proposal = cheapest_tolerances(opened, plan, costs)
    if json:
        print_json(allocation_document(plan, opened.url, proposal))
    elif not proposal.refusal:
        _print_allocation(proposal)
    if proposal.refusal:
        say(f"no proposal: {proposal.refusal}")
        raise typer.Exit(1)


def _confirm(where: "Cluster", store: "Store", plan: "Plan", costs: "Costs", again: str, json: bool) -> None:
    """Compute the fresh runs that judge the cheapest set, and print the last set with what they say."""
    from campaign.cluster.workers import PrestartedWorkers
    from campaign.coordinator.coordinate import coordinate
    from clearcap.cli.computing import continued_by
    from clearcap.questions.confirmation import confirm, confirmation_document

    def compute(fresh: "Plan") -> None:
        say(f"{fresh.campaign_id}: {fresh.spec.samples} fresh runs judge the proposal")
        with display(console(stderr=True)) as show:
            coordinate(store, fresh, where, show, connect=workers.connect)

    with continued_by(store, again), PrestartedWorkers(where) as workers:
        found = confirm(store, plan, costs, compute)
    if json:
        print_json(confirmation_document(plan, store.url, found))
    elif found.rounds:
        _print_allocation(found.proposal)
        rows = [
            (
                str(number_of),
                each.campaign,
                number(each.proposal.cost),
                r.response,
                number(r.promised, 4),
                "-" if r.cpk is None or r.cpk_interval is None else f"{number(r.cpk, 4)} ({_ends(r.cpk_interval)})",
                r.verdict,
            )
            for number_of, each in enumerate(found.rounds, 1)
            for r in each.responses
        ]
        heads = ("round", "fresh runs", "cost", "response", "promised", "Cpk of fresh runs", "target")
        print_table("proposals judged by fresh runs", heads, rows, texts=2)
        print_text(found.text)
    if found.outcome != "confirmed":
        say(found.text)
        raise typer.Exit(1)


def _is_answered(advised: "ToleranceAdvice") -> bool:
    """Return whether every variable has an answer; print which variables have none."""
    if not advised.shortfalls and not advised.growth:
        return False
    asked = [(f"what lifts {s.response}", (*s.alone, s.together)) for s in advised.shortfalls]
    unanswered: dict[tuple[str, str], list[str]] = {}
    for question, found in (*asked, ("how much they may grow", advised.growth)):
        for each in found:
            if each is not None and each.refusal:
                unanswered.setdefault((question, each.refusal), []).append(each.variable)
    for (question, reason), names in unanswered.items():
        say(f"no answer for {', '.join(names)} ({question}): {reason}")
    return not unanswered


def _print_advice(advised: "ToleranceAdvice") -> None:
    """Print what must shrink for each response below its target, then how far each variable may grow for the others."""
    heads = ("variable", "factor", "95 % interval", "limited by", "Cpk then", "write, or try in whatif --set", "method")
    for short in advised.shortfalls:
        title = (
            f"{short.response} is below {short.aim}: factor on the present sigma of one variable alone that reaches it"
        )
        together = () if short.together is None else (short.together,)
        print_table(title, heads, [_advice_row(each) for each in (*short.alone, *together)])
        print_text(short.text)
    if not advised.growth:
        return
    title = f"factor on the sigma of one variable alone that keeps {', '.join(advised.kept)} at {advised.kept_at}"
    print_table(title, heads, [_advice_row(each) for each in advised.growth])
    print_text("Each factor holds only while all other variables stay as they are.")
    for each in advised.growth:
        for response, cpk in each.below.items():
            print_text(f"{each.variable} at {each.factor:.3g}: {response}, already too low, falls to Cpk {cpk:.4g}")


def _advice_row(advice: "Advice") -> tuple[str, ...]:
    if advice.refusal:
        return advice.variable, "no answer", "-", advice.refusal, "-", "-", "-"
    ends = number(advice.cpk, 4), " ".join(advice.written or advice.settings) or "-", advice.method
    if advice.factor is None:
        return advice.variable, f"not reachable (checked down to {advice.reach:.3g})", "-", advice.binding or "-", *ends
    low, high = advice.interval
    words = {"samples": "the samples, which reach no farther", "search": "nothing that was tried so far"}
    end = "" if advice.bounded else advice.limit or words[advice.ended_by]  # no response limits it
    if not advice.bounded and advice.factor == 1:
        return advice.variable, "1", "-", end, *ends
    if not advice.bounded:
        return advice.variable, f"at least {advice.factor:.3g}", "-", end, *ends
    interval = f"{number(low, 3)} {'or more' if high is None else f'to {high:.3g}'}"
    return advice.variable, f"{advice.factor:.3g}", interval, advice.binding or "-", *ends


def _print_allocation(proposal: "Allocation") -> None:
    """Print the proposal: sigmas, cost, Cpk of each response, and the campaign to confirm it."""
    from reporting.format_numbers import ppm

    heads: tuple[str, ...] = ("variable", "sigma", "factor on the present sigma", "write")
    rows: list[tuple[str, ...]] = [
        (name, number(sigma, 4), f"{proposal.factors[name]:.3g}", " ".join(proposal.written.get(name, ())) or "-")
        for name, sigma in proposal.tolerances.items()
    ]
    if proposal.processes:
        heads, rows = (*heads, "process"), [(*row, proposal.processes.get(row[0], "-")) for row in rows]
    now = "not known" if proposal.cost_now is None else number(proposal.cost_now)
    print_table(f"cheapest standard deviations: cost {number(proposal.cost)}, now {now}", heads, rows)
    for r in proposal.responses:
        bound = ", which limits the tolerances" if r.binding else ""
        price = f"; 0.01 more Cpk costs {number(r.price, 3)}" if r.binding and r.price is not None else ""
        ends = "" if r.cpk_interval is None else "{:.4g} to {:.4g}, ".format(*r.cpk_interval)
        share = "" if r.ppm_interval is None else "; {} to {} ppm out of limits".format(*map(ppm, r.ppm_interval))
        print_text(f"{r.response}: Cpk {r.cpk:.4g} ({ends}target {r.target:g}){bound}{price}{share}")
    for note in proposal.notes:
        say(note)
    print_text(f"computed by {proposal.method}; confirm it with a campaign of {proposal.runs} samples and these sigmas")


def design(
    campaign: Id = None,
    response: Annotated[
        list[str], typer.Option(metavar="NAME", help="Aim at the limits of this response only; may be repeated.")
    ] = [],  # noqa: B006
    samples: Annotated[int, typer.Option(min=1, help="Number of samples of the new campaign.")] = 20_000,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Campaign file to write; NAME-rare.toml by default.")
    ] = None,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Write a campaign file with importance sampling, which draws samples where rejects of a campaign are likely."""
    import tomli_w

    from clearcap.questions.decision import aimed_campaign

    opened, plan = opened_campaign(store, campaign)
    aimed = aimed_campaign(opened, plan, samples, response)
    path = output or Path(f"{aimed.tables['name']}.toml")
    check_output("--output", path, (".toml",))
    with replacing(path) as temporary:
        temporary.write_text(
            f"# Aims at the rejects that {plan.campaign_id} shows or predicts.\n{tomli_w.dumps(aimed.tables)}"
        )
    if json:
        found = {"targets": list(map(asdict, aimed.targets)), "components": aimed.tables["importance"]["components"]}
        print_json({"campaign": plan.campaign_id, "store": opened.url, "file": str(path), **found})
    else:
        rows = [(t.name, f"{t.ppm:.3g}", t.by, "yes" if t.centres else "no need") for t in aimed.targets]
        print_table("rejects expected beyond each limit", ("limit", "ppm, roughly", "by", "aimed at"), rows, texts=1)
        rows = [
            (f"{100 * aim.share:.1f} %", f"{aim.scale:g}", _centre(aim.centre, aimed.variables), aim.source)
            for aim in aimed.aims
        ]
        rest = 1.0 - sum(aim.share for aim in aimed.aims)
        rows.append((f"{100 * rest:.1f} %", "1", _centre((), ()), "nothing: production itself"))
        print_table("components, in standard scores", ("share", "scale", "centre", "aims at"), rows)
        print_text(f"wrote {path}; compute it with: {opened.command('run', str(path))}")
    if not any(target.centres for target in aimed.targets):
        say("no limit needs a separate component: one wide component bounds what no run has shown")


def _centre(centre: tuple[float, ...], names: tuple[str, ...]) -> str:
    return ", ".join(f"{name} {z:+.2f}" for name, z in zip(names, centre, strict=True) if z) or "that of production"


def calibrate(
    campaign: CampaignId,
    measurements: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="TOML file: the constants, and what was measured with its uncertainty."),
    ],
    output: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Write draws of the constants, for a campaign to draw from.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the draws.")] = 0,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Estimate unknown constants, such as friction or preload, from bench measurements, if these determine them.

    The campaign varies the constants. Its distributions are their priors, and an emulator of its rows stands in for
    further runs.
    """
    from clearcap.questions.calibration import calibrated, load_measurements, write_draws

    if output is not None:
        check_output("--output", output, (".csv",))
    file = load_measurements(measurements)
    opened, plan = opened_campaign(store, campaign)
    found = calibrated(opened, plan, file, seed=seed)
    if output is not None:
        with replacing(output) as temporary:
            write_draws(temporary, found)
    if json:
        document = asdict(found)
        del document["draws"]
        print_json({"campaign": plan.campaign_id, "store": opened.url, **document, "file": output and str(output)})
        return
    _print_calibration(found)
    if output is not None:
        print_text(f"wrote {output}; a campaign draws from it with, for each constant:")
        targets = plan.spec.targets()
        for name in found.draws:
            keys = {"target": targets[name], "distribution": "empirical", "file": output.name, "column": name}
            pairs = ", ".join(f"{key} = {dumps(value)}" for key, value in ({**keys, "joint": output.stem}).items())
            print_text(f"variables.{dumps(name)} = {{ {pairs} }}")


def _print_calibration(found: "Calibration") -> None:
    """Print which combinations of constants the data determine, then the constants, then each measurement explained."""
    units = found.units
    for words in found.told:
        print_text(words)
    rows: list[tuple[str, ...]] = [
        (c.name, number(c.prior_mean), number(c.prior_std, 3), number(c.mean), number(c.std, 3), _ends(c.interval))
        for c in found.constants
    ]
    of_constants = ("constant", "before", "sigma", "after", "sigma", "95 % interval")
    print_table("constants before and after the measurements", of_constants, rows, texts=1)
    for a, b, correlation in found.correlations:
        print_text(f"correlation of {a} and {b}: {correlation:.2f}")
    for name, (mean, ends) in found.discrepancies.items():
        print_text(f"{labelled(name, units[name])}: the model itself errs by {number(mean, 3)} ({_ends(ends)})")
    measured: list[tuple[str, ...]] = [
        (labelled(f.response, units[f.response]), f.specimen, *map(number, (f.value, f.predicted)), number(f.std, 3))
        for f in found.fitted
    ]
    heads = ("response", "specimen", "measured", "explained", "sigma")
    print_table("measurements", heads, measured, texts=2)
    for name, quality in found.quality.items():
        print_text(
            f"emulator of {name}: {quality.rows} rows, explains {100 * quality.q2:.2f} % of others; its 95 % intervals"
            f" hold {100 * quality.coverage:.0f} %"
        )
    for note in found.notes:
        print_text(note)


def _ends(interval: tuple[float, float]) -> str:
    return f"{number(interval[0], 4)} to {number(interval[1], 4)}"
