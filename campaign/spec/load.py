"""Load a campaign from a file or a text: read it, check everything at once, and load its mechanism.

Of its variables is checked that they can set their targets: existing keys, one variable each, allowed values.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import TypeAdapter, ValidationError

from campaign.compiling import compile_engine
from campaign.errors import SpecError
from campaign.inputs.distributions import Distribution, Empirical, Variable
from campaign.inputs.sampling import SAMPLERS
from campaign.spec.campaign_file import MOST_VARIABLES, CampaignSpec
from campaign.spec.faults import SpecFault, fault, structure_faults
from campaign.spec.named_files import FolderFiles, GivenFiles, NamedFiles, campaign_names, read_data_files
from campaign.spec.result_columns import CERTIFICATE_COLUMNS
from engine import MechanismError, NotAssemblable, check, load_mechanism, missing_kernels, set_values
from engine.faults.file_kinds import content_kind, other_kind, unreadable_kind
from engine.faults.toml_positions import with_positions
from engine.mechanism import Mechanism, full_key, get_value, library_names, unit_of
from engine.mechanism.base import is_number
from engine.mechanism.faults import MOST_FAULTS, did_you_mean, listed
from engine.mechanism.keys.key_paths import PREFIX, SETTINGS, following
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml, text_bytes

_DISTRIBUTION: TypeAdapter[Distribution] = TypeAdapter(Variable)

Source = str | Path | Mapping[str, Any]  # a shipped campaign's name, a file, or the tables of a file


@dataclass(frozen=True)
class Campaign:
    """A checked campaign and its mechanism.

    Attributes
    ----------
    spec : CampaignSpec
        What the user wrote, with the overrides of the command line.
    mechanism : Mechanism
        The mechanism with its own values or those of the campaign's preset, on the campaign's bench if it names one.
    """

    spec: CampaignSpec
    mechanism: Mechanism

    def __repr__(self) -> str:
        """Return name and size in a line; a specification has hundreds of keys."""
        spec = self.spec
        what = f"{spec.samples} samples, {len(spec.variables)} variables, limits of {len(spec.responses)} responses"
        return f"<Campaign {spec.name}: {what}, mechanism {self.mechanism.name}>"


def load_campaign(source: Source, *, samples: int | None = None, seed: int | None = None) -> Campaign:
    """Read and check a campaign.

    Parameters
    ----------
    source : str, Path or mapping
        Name of a shipped campaign, path of a TOML file, or the tables of such a file as Python data. Paths in the
        tables are relative to the file, or to the current folder. ``mechanism`` of such tables may be a `Mechanism`, or
        its tables.
    samples, seed : int, optional
        Number of samples and seed, instead of those of the source.

    Returns
    -------
    Campaign
        The campaign; the mechanism accepts both ends of each variable.

    Raises
    ------
    SpecError
        With all faults of the source, one per line, each with its key, its value, what is allowed and the remedy.
    """
    overrides = {key: value for key, value in (("samples", samples), ("seed", seed)) if value is not None}
    if isinstance(source, Mapping):
        tables, mechanism = with_named_mechanism(source)
        return _checked({**tables, **overrides}, FolderFiles(Path(), mechanism), "campaign:", compiles=True)
    path = _locate(str(source))
    try:
        content = read_regular_file(path, LARGEST)
    except OSError as error:
        unreadable = f"cannot be read ({error.strerror or error}); name a campaign file"
        raise SpecError(f"campaign {path}: {unreadable_kind(path, 'campaign') or unreadable}") from error
    tables = _tables(content, path) | overrides
    return _checked(tables, FolderFiles(path.parent), f"campaign {path}:", content, compiles=True)


def with_named_mechanism(tables: Mapping[str, Any]) -> tuple[dict[str, Any], Mechanism | None]:
    """Return the tables of a campaign with a file name in place of a mechanism as an object, and that mechanism."""
    given = tables.get("mechanism")
    if not isinstance(given, Mechanism | Mapping):
        return dict(tables), None
    try:
        mechanism = given if isinstance(given, Mechanism) else load_mechanism(given)
    except MechanismError as error:
        found = fault(["mechanism"], None, str(error), error.faults)
        raise SpecError(f"campaign:\n  {found}", [found]) from error
    return {**tables, "mechanism": f"{mechanism.name}.toml"}, mechanism


def load_campaign_text(
    text: str | bytes,
    files: Mapping[str, bytes] = MappingProxyType({}),
    *,
    samples: int | None = None,
    seed: int | None = None,
) -> Campaign:
    """Check a campaign given as text, together with the files that it names.

    No files are opened except those of clearcap itself, so text from an untrusted user cannot read files of this
    machine.

    Parameters
    ----------
    text : str or bytes
        Content of a campaign file, at most a megabyte; bytes are UTF-8.
    files : mapping of str to bytes
        Content of each file that the campaign names, by that name: its mechanism, unless it is a shipped one, and its
        data files. At most 100 files, 200 MB in all.
    samples, seed : int, optional
        Number of samples and seed, instead of those of the text.

    Returns
    -------
    Campaign
        The same as `load_campaign` returns for a folder with these files.

    Raises
    ------
    SpecError
        With all faults, as in `load_campaign`; also if the campaign names a file that is not given.
    """
    overrides = {key: value for key, value in (("samples", samples), ("seed", seed)) if value is not None}
    content = text_bytes(text)
    return _checked(_tables(content, None) | overrides, GivenFiles(files), "campaign:", content)


def _checked(
    raw: dict[str, Any], files: NamedFiles, heading: str, content: bytes = b"", *, compiles: bool = False
) -> Campaign:
    """Return the campaign from the tables of a file; if its content is given, faults state their lines.

    With ``compiles`` the engine is compiled, where it is not yet, in a process of its own, if nothing else is at fault.
    """
    raw, faults = read_data_files(raw, files)
    spec = None
    try:
        spec = CampaignSpec.model_validate(raw)
    except ValidationError as error:
        faults += structure_faults(error, CampaignSpec)
    mechanism, key = None, "mechanism"
    try:
        name = raw.get("mechanism")
        mechanism = files.mechanism(name) if isinstance(name, str) and name else None
        key, preset = "preset", raw.get("preset")
        # read before the bench, on which a mechanism has no presets; set after it, as it may bring the keys
        values = mechanism.preset(preset) if mechanism and isinstance(preset, str) else {}
        key, bench = "bench", raw.get("bench")
        mechanism = mechanism.on_bench(bench) if mechanism and isinstance(bench, str) else mechanism
        key = "preset"
        mechanism = set_values(mechanism, values) if mechanism and values else mechanism
    except (MechanismError, SpecError) as error:
        faults.append(fault([key], raw[key], str(error), error.faults))
    if mechanism is not None:
        faults += _contradictions(raw, mechanism, compiles, at_fault=bool(faults))
    if faults or spec is None or mechanism is None:
        lines = map(str, listed(faults, len(faults)))
        first = faults[:MOST_FAULTS]
        raise SpecError("\n  ".join([heading, *lines]), with_positions(first, content) if content else first)
    return Campaign(spec, mechanism)


def _contradictions(raw: Mapping[str, Any], mechanism: Mechanism, compiles: bool, *, at_fault: bool) -> list[SpecFault]:
    """Return the first faults of `mechanism_faults`, of assembly too unless others are found before it ``compiles``."""
    if compiles and missing_kernels():
        # a misspelt name is told at once, and not after the minute that compiling takes
        found = list(islice(mechanism_faults(raw, mechanism, assembles=False), MOST_FAULTS))
        if at_fault or found:
            return found
        compile_engine()  # all of it, though checks need only a part: a campaign that is loaded is soon to run
    return list(islice(mechanism_faults(raw, mechanism), MOST_FAULTS))


def mechanism_faults(raw: Mapping[str, Any], mechanism: Mechanism, assembles: bool = True) -> Iterator[SpecFault]:
    """Yield the contradictions between a campaign, as read, and its mechanism, in tables that are valid themselves.

    With ``assembles``, the mechanism is assembled with the ends of each variable.
    """
    yield from _name_faults(raw, mechanism)
    yield from _stop_faults(raw, mechanism)
    yield from target_faults(raw, mechanism, assembles)
    yield from _step_faults(raw, mechanism)


def _locate(name_or_path: str) -> Path:
    names = campaign_names()
    if name_or_path in names:
        return Path(str(resources.files("campaign").joinpath("library", f"{name_or_path}.toml")))
    path = Path(name_or_path)
    if not os.path.exists(path) and name_or_path in library_names():
        raise SpecError(
            f"campaign {name_or_path}: is a shipped mechanism, not a campaign; one run of it: clearcap simulate"
            f" {name_or_path}; shipped campaigns: {', '.join(names)}"
        )
    if not os.path.exists(path):
        raise SpecError(
            f"campaign {name_or_path}: no such file, and no shipped campaign of that name;"
            f" shipped: {', '.join(names)}{did_you_mean(name_or_path, names)}"
        )
    return path


def _tables(content: bytes, path: Path | None) -> dict[str, Any]:
    """Return the tables in the content of a file, or in a text if there is no path."""
    heading = f"campaign {path}" if path else "campaign"
    try:
        tables = parse_toml(content)
    except UnfitToml as error:
        text = content_kind(content, "campaign") or str(error)
        at = SpecFault((), text, line=error.line, column=error.column)
        raise SpecError(f"{heading}: {text}", [at]) from error
    if other := other_kind(tables, path or "FILE", "campaign"):
        raise SpecError(f"{heading}: {other}", [SpecFault((), other)])
    return tables


def _name_faults(raw: Mapping[str, Any], mechanism: Mechanism) -> Iterator[SpecFault]:
    """Yield the faults of names: variables named like another column, and responses that the mechanism lacks."""
    responses = list(mechanism.responses)
    sampler = SAMPLERS.get(str(raw.get("sampler")))
    columns = {*CERTIFICATE_COLUMNS, *(sampler.columns if sampler else ())}
    for name in sorted(columns.intersection(responses)):
        yield fault(
            ["sampler"], raw.get("sampler"), f"has a column {name}, and {mechanism.name} a response of this name"
        )
    for table, taken in (("variables", {*columns, *responses}), ("responses", columns)):
        names = raw.get(table)
        for name in names if isinstance(names, dict) else ():
            if name in taken:
                text = "another column of the results has this name; rename it and give its key as target"
                yield fault([table, name], None, text)
            elif table == "responses" and name not in responses:
                yield fault([table, name], None, _no_response(name, mechanism))


def _step_faults(raw: Mapping[str, Any], mechanism: Mechanism) -> Iterator[SpecFault]:
    """Yield the faults of fixed steps that are longer than the simulated time."""
    failures = raw.get("failures")
    retries = failures.get("retry") if isinstance(failures, dict) else None
    tables = [(["simulation"], raw.get("simulation"))]
    tables += [(["failures", "retry", str(i)], t) for i, t in enumerate(retries if isinstance(retries, list) else ())]
    for keys, table in tables:
        given = table if isinstance(table, dict) else {}
        step, horizon = given.get("step"), given.get("horizon", mechanism.simulation.horizon)
        if is_number(step) and is_number(horizon) and step > horizon:
            unit = mechanism.unit("time")
            text = f"longer than the horizon of {horizon:g} {unit}; allowed: a small part of it; shorten the step"
            yield fault([*keys, "step"], step, text)


def _stop_faults(raw: Mapping[str, Any], mechanism: Mechanism) -> Iterator[SpecFault]:
    """Yield the faults of a stopping rule whose response does not exist or lacks the limits that it needs."""
    rule, responses = raw.get("stop"), raw.get("responses")
    name = rule.get("response") if isinstance(rule, dict) else None
    if not isinstance(rule, dict) or not isinstance(name, str):
        return
    statistic = rule.get("statistic")
    if name not in mechanism.responses:
        yield fault(["stop", "response"], name, _no_response(name, mechanism))
        return
    limits = responses.get(name) if isinstance(responses, dict) else None
    given = {"lsl", "usl", "nominal"} & set(limits if isinstance(limits, dict) else ())
    if statistic in ("cp", "cpk", "ppm") and (not given or (statistic == "cp" and given in ({"lsl"}, {"usl"}))):
        both = "both limits" if statistic == "cp" else "limits"
        yield fault(["stop", "statistic"], statistic, f"needs {both} of {name}; give them in [responses.{name}]")


def _no_response(name: str, mechanism: Mechanism) -> str:
    """Return the message that a mechanism has no response of a name, with the responses it has."""
    allowed = ", ".join(mechanism.responses)
    return f"{mechanism.name} has no response of this name; allowed: {allowed}{did_you_mean(name, mechanism.responses)}"


# -- variables and their targets ---------------------------------------------------------------------------------------


def target_faults(raw: Mapping[str, Any], mechanism: Mechanism, assembles: bool = True) -> Iterator[SpecFault]:
    """Yield the faults of a campaign's variables that are valid by themselves, and of their targets, one at a time."""
    # more variables are refused in any case: checking them too would only take time
    variables = dict(islice(_sound_variables(raw.get("variables")), MOST_VARIABLES))
    targets = {name: variable.target or name for name, variable in variables.items()}
    setters: dict[str, str] = {}  # full key -> name of the first variable that sets it
    for name, target in targets.items():
        setters.setdefault(full_key(mechanism, target), name)
    parameters = {key.removeprefix(PREFIX): name for key, name in setters.items() if key.startswith(PREFIX)}
    followers = following(mechanism.formulas, parameters)
    failures = raw.get("failures")
    # whether samples whose parts cannot be assembled are counted, and therefore allowed
    counted = isinstance(failures, dict) and is_number(failures.get("max_not_assemblable"))
    for name, variable in variables.items():
        target, keys = targets[name], ["variables", name]
        key = full_key(mechanism, target)
        origins = sorted(followers.get(key, set()))
        if setters[key] != name:
            yield fault(keys, None, f"{setters[key]} and {name} both set {target}; keep one of them")
        elif origins:
            first, text = origins[0], mechanism.formulas[key]
            yield fault(
                keys,
                None,
                f"{name} sets {target}, which follows from {PREFIX}{first} ({text}), and {parameters[first]} sets "
                f"{PREFIX}{first}; keep one of them, or add a parameter of its own to the expression",
            )
        else:
            ends = {*variable.tried(), *_extremes(raw, name)}
            found = list(_faults_of(name, target, ends, mechanism, counted, check if assembles else set_values))
            yield from found or _drawing_faults(name, target, variable, mechanism)


def _drawing_faults(name: str, target: str, variable: Distribution, mechanism: Mechanism) -> Iterator[SpecFault]:
    """Yield the fault of a variable whose drawing is in millimetres, but whose target is not."""
    drawn = next((key for key in ("dimension", "fit") if getattr(variable, key, None)), None)
    if drawn is None or (unit := unit_of(mechanism, target)) in ("mm", "1"):  # a parameter may show no unit
        return
    text = f"is in mm, as drawings are, but {target} is in {unit}; give mean and std in {unit}"
    yield fault(["variables", name, drawn], getattr(variable, drawn), text)


def _sound_variables(table: Any) -> Iterator[tuple[str, Distribution]]:
    for name, entry in table.items() if isinstance(table, dict) else ():
        try:
            variable = _DISTRIBUTION.validate_python(entry)
        except ValidationError:
            continue
        if not isinstance(variable, Empirical) or variable.values:  # an unreadable file is already a fault
            yield name, variable


def _extremes(raw: Mapping[str, Any], name: str) -> list[float]:
    """Return the smallest and the largest value that the user lists for a variable, if any is listed."""
    grid, table = raw.get("grid"), raw.get("table")
    columns = table.get("columns") if isinstance(table, dict) else None
    listed = [entry.get(name) for entry in (grid, columns) if isinstance(entry, dict)]
    numbers = [x for values in listed if isinstance(values, list) for x in values if is_number(x)]
    return [min(numbers), max(numbers)] if numbers else []


def _faults_of(
    name: str,
    target: str,
    values: set[float],
    mechanism: Mechanism,
    counted: bool,
    accept: Callable[[Mechanism, Mapping[str, float]], object],
) -> Iterator[SpecFault]:
    """Yield the faults of a target, or of values that ``accept`` refuses, unless misfits are ``counted``."""
    keys = ["variables", name]
    try:
        get_value(mechanism, target)
    except MechanismError as error:
        yield fault(keys, None, f"does not set a number of {mechanism.name}: {_reason(error)}")
        return
    if target.startswith(SETTINGS):
        setting = target.removeprefix(SETTINGS)
        text = f"{target} says how a run is computed, and is the same for all; allowed: numbers of the mechanism; "
        yield fault(keys, None, f"{text}give {setting} in [simulation] of the campaign, or in the mechanism file")
        return
    formulas = {**mechanism.formulas, **mechanism.response_formulas()}
    if target.startswith(PREFIX) and not following(formulas, [target.removeprefix(PREFIX)]):
        on_bench = f" on bench {mechanism.bench}" if mechanism.bench else ""
        yield fault(keys, None, f"nothing of {mechanism.name}{on_bench} follows from {target}; remove the variable")
        return
    for value in sorted(values):
        try:
            accept(mechanism, {target: value})
        except NotAssemblable as error:
            if not counted:
                text = f"reaches {target} = {value:g}, which {mechanism.name} refuses: {_reason(error, target)}"
                count = "or count such samples (failures.max_not_assemblable)"
                yield fault(keys, None, f"{text}; or {_remedy(value, values)}, {count}")
        except MechanismError as error:
            text = f"reaches {target} = {value:g}, which {mechanism.name} refuses: {_reason(error, target)}"
            yield fault(keys, None, f"{text}; or {_remedy(value, values)}")


def _remedy(value: float, values: set[float]) -> str:
    """Return how to keep a variable away from one of its ends, if it has two."""
    if min(values) == max(values):
        return "give the variable another value"
    return "raise its lower end" if value == min(values) else "lower its upper end"


def _reason(error: MechanismError, told: str = "") -> str:
    """Return the faults of an engine error in one line, without its heading; without the key if it is ``told``."""
    if told and error.faults:
        return "; ".join(fault.text if fault.key == told else str(fault) for fault in error.faults)
    heading, *lines = str(error).splitlines()
    return "; ".join(line.strip() for line in lines) or heading
