"""Verbs for the documents of a campaign: ``report`` writes or fetches them, ``verify`` checks what was signed."""

from dataclasses import asdict, replace
from json import loads
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.errors import CampaignError, SpecError
from clearcap.cli.computing import fail_without_enough_ok
from clearcap.cli.options import CampaignId, Id, ServerUrl, StoreUrl, asked_server, opened_campaign
from clearcap.cli.output import Json, labelled, mean_number, number, print_json, print_table, print_text, say

if TYPE_CHECKING:
    from clearcap.questions.verification import VerifiedSignoff
    from reporting.gauge import Component


Summary = Annotated[
    bool, typer.Option("--summary", help="Also write summary.html, one page to sign; with --pdf summary.pdf too.")
]
Excel = Annotated[bool, typer.Option("--excel/--no-excel", help="Also write report.xlsx.")]
Parts = Annotated[
    Path, typer.Argument(metavar="PARTS", help="CSV, Parquet or Excel file, one row for each measured part.")
]


def report(
    context: typer.Context,
    campaign: Id = None,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    folder: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="With --server: where the files go; by default a folder with the id's name."),
    ] = None,
    against: Annotated[
        str | None, typer.Option(metavar="ID", help="Compare with another campaign, as a separate document.")
    ] = None,
    pool: Annotated[
        list[str],
        typer.Option(
            metavar="ID",
            help="Add the samples of a campaign that differs only in seed and number of samples; may be repeated.",
        ),
    ] = [],  # noqa: B006
    pdf: Annotated[
        bool, typer.Option("--pdf/--no-pdf", help="Also write report.pdf, which takes most of the time.")
    ] = False,
    summary: Summary = False,
    excel: Excel = True,
    json: Json = False,
) -> None:
    """Write the report of a campaign from the rows computed so far; the campaign may be running.

    The exit status is 1 if too few of its runs are ok for a verdict. With --server, the report that
    the server has written is downloaded.
    """
    if remote := asked_server(context, server):
        if against is not None or pool or pdf or summary:
            raise SpecError(
                "--server: downloads the report that the server has; leave out --against, --pool, --pdf and --summary"
            )
        with remote:
            campaign_id = remote.find(campaign)
            fetched = remote.download_report(campaign_id, folder or Path(campaign_id))
        from reporting.write import NAMES

        kinds = {name: kind for kind, name in NAMES.items()}
        files = {kinds.get(name, name): str(path) for name, path in fetched.items()}
        document: dict[str, Any] = {"campaign": campaign_id, "store": remote.address, "against": None, "pool": []}
    else:
        if folder is not None:
            raise SpecError("--folder: is for --server; a store has a folder for each report")
        if against is not None and pool:
            raise SpecError("--against, --pool: both are given; pool campaigns of one plan, or compare two plans")
        from clearcap.questions.pooling import pooled_report
        from clearcap.questions.report import report as write_report

        asked = _kinds(pdf=pdf, excel=excel, summary=summary)
        opened, plan = opened_campaign(store, campaign)
        others = [opened.plan(opened.find(each)) for each in pool]
        if others:
            files = pooled_report([(opened, each) for each in (plan, *others)], asked)
        else:
            files = write_report(opened, plan, kinds=asked, against=against)
        other = None if against is None else opened.find(against)
        document = {"campaign": plan.campaign_id, "store": opened.url, "against": other}
        document["pool"] = [each.campaign_id for each in others]
    if json:
        print_json({**document, "report": files})
    else:
        for path in files.values():
            kind = "comparison" if against is not None else "pooled report" if pool else "report"
            print_text(f"{kind}: {path}")
    if remote is None:
        from campaign.store.parts import total

        counts = [(each, opened.survey(each).statuses) for each in (plan, *others)]
        worst, _ = max(counts, key=lambda each: each[0].failed(each[1]))  # which has a run to show
        fail_without_enough_ok(opened, worst, total(statuses for _, statuses in counts))


def capability(
    context: typer.Context,
    parts: Parts,
    limits: Annotated[Path, typer.Option(metavar="FILE", help="TOML file with the characteristics and their limits.")],
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Where the report is written.")] = Path("capability"),
    pdf: Annotated[bool, typer.Option("--pdf/--no-pdf", help="Also write report.pdf.")] = False,
    summary: Summary = False,
    excel: Excel = True,
    # not from the environment: who does not ask for it keeps the parts to himself
    server: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Send parts and limits to this server, which keeps them and their report."),
    ] = None,
    json: Json = False,
) -> None:
    """Write the capability report of measured parts, and print a summary; with --server, download the server's."""
    from reporting.write import NAMES

    if remote := asked_server(context, server):
        if pdf:
            raise SpecError("--server: keeps no PDF of measured parts; leave out --pdf")
        kinds = {NAMES[kind]: kind for kind in _kinds(pdf=False, excel=excel, summary=summary)}
        with remote:
            fetched = remote.capability(parts, limits, folder, kinds)["report"]
        files = {kinds[name]: str(path) for name, path in fetched.items()}
    else:
        from clearcap.questions.measured import capability_report

        files = capability_report(parts, limits, folder, _kinds(pdf=pdf, excel=excel, summary=summary))
    document = loads((folder / NAMES["json"]).read_text("utf-8"))
    if json:
        verdicts = {r["spec"]["name"]: r["verdict"] for r in document["responses"]}
        headline = document["headline"]
        print_json({"parts": document["finished"], "headline": headline, "verdicts": verdicts, "report": files})
        return
    print_text(document["headline"])
    heads = ("characteristic", "verdict", "index", "n", "mean", "sigma", "LSL", "USL", "Cpk", "ppm out")
    print_table(document["title"], heads, map(_cells, document["responses"]), texts=2, bold="index")
    for check in document["trust"]:
        if check["level"] in ("bad", "attention"):
            print_text(f"{check['name']}: {check['text']}")
    print_text(f"report: {files['html']}")


def validate(
    campaign: CampaignId,
    parts: Parts,
    store: StoreUrl = "runs",
    limits: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Limits file of the parts, if columns have other names.")
    ] = None,
    json: Json = False,
) -> None:
    """Compare measured parts with the samples of a campaign, and say how closely it predicts them."""
    from clearcap.questions.measured import validated

    found = validated(*opened_campaign(store, campaign), parts, limits)
    if json:
        print_json(asdict(found))
        return
    for each in found.predictions:
        of = each.comparison
        print_text(f"{of.response}: {each.verdict}")
        rows = [
            ("values", str(of.n), str(of.n_other), ""),
            ("mean", number(of.capability.mean), number(of.capability_other.mean), _ends(of.mean_interval)),
            ("sigma", number(of.capability.std), number(of.capability_other.std), f"x {_ends(of.std_ratio_interval)}"),
            *((f"{100 * p:g} % quantile", number(x), number(y), "") for p, x, y in each.quantiles),
            ("beyond the simulated 99 %", f"{100 * each.beyond:.2g} %", "1 %", _ends(each.beyond_interval)),
        ]
        heads = (of.response, "measured", "simulated", "difference or ratio, 95 %")
        print_table("", heads, rows, texts=1)
    for pair in found.correlations:
        numbers = f"{pair.measured:.2f} measured, {pair.simulated:.2f} simulated, difference"
        print_text(f"correlation of {pair.first} and {pair.second}: {numbers} {_ends(pair.difference_interval)}")
    for note in found.notes:
        print_text(note)


def monitor(
    context: typer.Context,
    campaign: CampaignId,
    parts: Parts,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    limits: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Limits file of the parts: names of columns, lots.")
    ] = None,
    again: Annotated[
        bool, typer.Option("--rerun", help="Queue a campaign with the new distributions where the rows do not answer.")
    ] = False,
    json: Json = False,
) -> None:
    """Give a campaign's variables the distributions of measured parts, and say which index is then too small.

    Exit status 1 if an index is certainly below its requirement, or if a response has no answer.
    """
    if remote := asked_server(context, server):
        from campaign.store.monitored_library import Monitored

        with remote:
            document = remote.monitor(remote.find(campaign), parts, limits, rerun=again)
        found = Monitored.model_validate(document)
    else:
        from clearcap.questions.monitoring import monitored

        found = monitored(*opened_campaign(store, campaign), parts, limits, rerun=again)
    low = [each for each in found.responses if each.below]
    if json:
        print_json(found.model_dump())
    else:
        rows = [(v.variable, str(v.parts), v.family or "-", v.now or v.before) for v in found.variables]
        print_table("distributions of the measured parts", ("variable", "parts", "family", "now"), rows, texts=1)
        heads = ("response", "index", "95 % interval", "by", "required")
        answers = [
            (r.response, *(("-", "-", "-") if r.index is None else (number(r.index, 3), _ends(r.interval), r.by)),
             number(r.requirement, 3))
            for r in found.responses
        ]  # fmt: skip
        print_table("indices with them", heads, answers, texts=1)
    for variable in found.variables:
        if variable.note:
            say(f"{variable.variable}: {variable.note}")
    for reason in dict.fromkeys(r.emulated for r in found.responses if r.emulated):
        say(f"{', '.join(r.response for r in found.responses if r.emulated == reason)}: emulated, as {reason}")
    for reason in dict.fromkeys(r.refusal for r in found.responses if r.refusal):
        names = ", ".join(r.response for r in found.responses if r.refusal == reason)
        say(f"no answer for {names}: {reason}" + ("" if found.campaign else "; --rerun computes it"))
    if found.campaign:
        say(f"{found.campaign}: queued with these distributions, for the coordinator that serves the store")
    for each in low:
        say(f"{each.response}: index {number(each.index, 3)} is below {number(each.requirement, 3)} for certain")
    if low or any(each.refusal for each in found.responses):
        raise typer.Exit(1)


def gauge(
    table: Annotated[
        Path,
        typer.Argument(metavar="TABLE", help="CSV, Parquet or Excel file, one row for each measurement of a part."),
    ],
    value: Annotated[str, typer.Option(metavar="COLUMN", help="Column of the measurements.")] = "value",
    part: Annotated[str, typer.Option(metavar="COLUMN", help="Column of the parts.")] = "part",
    operator: Annotated[str, typer.Option(metavar="COLUMN", help="Column of who measured.")] = "operator",
    reference: Annotated[str, typer.Option(metavar="COLUMN", help="Column of the reference values.")] = "reference",
    nested: Annotated[bool, typer.Option("--nested", help="Each operator has parts of their own.")] = False,
    tolerance: Annotated[
        float | None, typer.Option(metavar="T", help="Distance between the limits, to compare with.")
    ] = None,
    json: Json = False,
) -> None:
    """Judge a gauge: repeatability and reproducibility, and bias where reference values are known."""
    from clearcap.questions.measured import gauge_study

    found = gauge_study(table, value, part, operator, reference, nested=nested, tolerance=tolerance)
    if json:
        print_json(asdict(found))
        return
    if (study := found.repeatability) is not None:
        print_text(study.verdict)
        heads = ("source", "sigma", "95 % interval", "% contribution", "% study", "% tolerance")
        title = f"{study.parts} parts, operators: {study.operators}, trials: {study.trials}, {study.design}"
        print_table(title, heads, (_source(each) for each in study.components), texts=1)
        rows = [
            (a.source, str(a.freedom), *map(number, (a.squares, a.mean_square, a.f)), number(a.p, 3))
            for a in study.anova
        ]
        print_table("analysis of variance", ("source", "freedom", "squares", "mean square", "F", "p"), rows, texts=1)
        ends = f"{study.ndc_interval[0]} to {study.ndc_interval[1]}"
        print_text(f"distinct categories: {study.ndc} ({ends}); for limits files: gauge_sigma = "
                   f"{study.components[0].std:.4g}, gauge_freedom = {study.freedom:.3g}")  # fmt: skip
        for note in study.notes:
            print_text(note)
    if (bias := found.bias) is not None:
        rows = [(number(b.reference), str(b.n), number(b.bias), _ends(b.interval), number(b.p, 3)) for b in bias.values]
        print_table("bias", ("reference", "n", "bias", "95 % interval", "p"), rows, texts=0)
        if (line := bias.linearity) is not None:
            print_text(
                f"linearity: bias = {number(line.intercept)} + {number(line.slope)} reference; slope "
                f"{_ends(line.slope_interval)}, p = {number(line.slope_p, 3)}"
            )
        for note in bias.notes:
            print_text(note)


def _source(each: "Component") -> tuple[str, ...]:
    parts = (each.contribution, each.study, each.tolerance)
    shares = ("-" if part is None else f"{100 * part:.1f}" for part in parts)
    return (each.name, number(each.std), _ends(each.std_interval), *shares)


def _ends(interval: tuple[float, float] | None) -> str:
    return "-" if interval is None else f"{number(interval[0], 4)} to {number(interval[1], 4)}"


def _kinds(*, pdf: bool, excel: bool, summary: bool) -> list[str]:
    """Return the kinds of files that the options ask for; CampaignError if what writes the PDF is not installed."""
    from reporting.write import lacks_package

    if pdf and lacks_package("pdf"):
        raise CampaignError(
            "--pdf: WeasyPrint is not installed; nothing was written. pip install 'clearcap[pdf]', or leave --pdf out"
        )
    asked = {"pdf": pdf, "xlsx": excel, "summary": summary, "summary_pdf": summary and pdf}
    return ["html", "json", "parquet", *(kind for kind, is_asked in asked.items() if is_asked)]


def _cells(response: dict[str, Any]) -> tuple[str, ...]:
    from reporting.format_numbers import deciding_index, index

    spec, found = response["spec"], response["capability"]
    verdict = response["verdict"] + (", not certain" if response["certain"] is False else "")
    decides = deciding_index(response["index"], response["index_low"])
    ppm = "-" if found["ppm_observed"] is None else f"{found['ppm_observed']:.0f}"
    mean = mean_number(found["mean"], found["std"])
    numbers = mean, number(found["std"], 3), number(spec["lsl"]), number(spec["usl"])
    return (labelled(spec["name"], spec["unit"]), verdict, decides, str(found["n"]), *numbers, index(found["cpk"]), ppm)


def verify(
    export: Annotated[Path, typer.Argument(metavar="FILE.zip|FOLDER", help="Export of a server, zipped or unpacked.")],
    key: Annotated[
        str | None, typer.Option(metavar="FINGERPRINT", help="Fingerprint of the server's key, as the server shows it.")
    ] = None,
    recompute: Annotated[
        bool, typer.Option("--recompute", help="Make the numbers of the report again from the rows, and compare.")
    ] = False,
    json: Json = False,
) -> None:
    """Verify who signed an exported campaign, and that plan, rows and report are the ones that were signed.

    Exit status 1 says that they are not, or that the export cannot be trusted.
    """
    from clearcap.questions.signing import open_archive
    from clearcap.questions.verification import recomputed, verify_export

    archive = open_archive(export)
    proof = verify_export(archive, key)
    if recompute and not proof.faults:
        proof = replace(proof, faults=[f"report: {words}" for words in recomputed(archive)])
    if json:
        signoffs = [
            {"number": each.number, "differences": each.differences, **each.signoff.model_dump(exclude={"files"})}
            for each in proof.signoffs
        ]
        head = proof.head and proof.head.model_dump()
        found = {"campaign": proof.campaign, "key": proof.key, "signoffs": signoffs, "head": head}
        print_json({**found, "faults": proof.faults})
    else:
        print_text(f"{proof.campaign}, signed with the key {proof.key}")
        for signed in proof.signoffs:
            _print_signoff(signed)
        if not proof.faults:
            # a report of version 0.1 does not state of which rows it is
            is_tied = recompute or proof.signoffs[-1].signoff.format > 1
            of_rows = "the report is that of these rows" if is_tied else "--recompute tells of which rows the report is"
            print_text(f"intact: all files are those of the last sign-off; {of_rows}")
            if recompute:
                print_text("recomputed: the rows give every number of the report")
        if proof.head:
            print_text(f"exported {proof.head.time}, when the server had signed {proof.head.documents} documents")
    if key is None:
        say("the key is the export's own; give --key FINGERPRINT, from the server or the approver, to know whose it is")
    for fault in proof.faults:
        say(fault)
    if proof.faults:
        raise typer.Exit(1)


def _print_signoff(signed: "VerifiedSignoff") -> None:
    from clearcap.questions.signing import Withdrawal

    signoff = signed.signoff
    if isinstance(signoff, Withdrawal):
        print_text(f"  {signed.number}. {signoff.time}: {signoff.signer} ({signoff.role}) withdrew the sign-off")
        print_text(f"     {signoff.comment}")
        return
    submitter = f"submitted by {signoff.submitted_by or 'an unknown user'}"
    eyes = "who also submitted it" if signoff.is_submitter else submitter
    covered = "another version" if signed.differences else "plan, rows and report"
    print_text(f"  {signed.number}. {signoff.time}: {signoff.signer} ({signoff.role}) signed {covered}; {eyes}")
    if signoff.comment:
        print_text(f"     {signoff.comment}")
