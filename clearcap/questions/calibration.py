"""Calibration: constants of a mechanism from bench measurements, by the rows of a campaign that varies them.

The file of measurements is TOML: which variables of the campaign are the unknown constants, what the model lacks, and
the measured values with their uncertainties. The distributions of the constants in the campaign are the prior. Values
of several benches name the campaign on theirs, which draws the same variables.
"""

import csv
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator
from scipy.special import ndtr

from campaign.errors import CampaignError, SpecError
from campaign.inputs.distributions import Continuous
from campaign.inputs.distributions.base import DRAWN
from campaign.inputs.sampling.inverse_transform import correlated
from campaign.inputs.sampling.sampler import joint_variables, varied
from campaign.plan import Plan
from campaign.samples import SampleColumns, independent_samples
from campaign.spec.campaign_file import CampaignSpec, ShortName
from campaign.spec.faults import SpecFault, fault, structure_faults
from campaign.store import Store, open_store
from engine.faults.toml_positions import with_positions
from engine.mechanism.base import Number, PositiveNumber, TableModel
from engine.mechanism.faults import did_you_mean
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml
from reporting import ReportError
from reporting.arrays import Array
from reporting.emulation.calibration import Calibration, Discrepancy, Measured, Prior, calibrate
from reporting.emulation.gaussian_process import Emulator, fit_emulator

MOST_MEASUREMENTS = 200
MOST_CONSTANTS = 20
USUAL_DISCREPANCY = 0.1  # scale of its prior, in standard deviations of the response in the campaign


class Lacking(TableModel, strict=True):
    """What the model lacks in a response: the standard deviation of its error, given or estimated."""

    sigma: float | None = Field(
        None, ge=0.0, allow_inf_nan=False, description="The standard deviation, in the response's unit; 0 for none."
    )
    scale: PositiveNumber | None = Field(
        None,
        description="Instead: the scale of a half-normal prior from which it is estimated, in the response's unit.",
    )

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.sigma is None) == (self.scale is None):
            raise ValueError("give sigma, a known standard deviation, or scale, that of its prior")
        return self


class Measurement(TableModel, strict=True):
    """A measured value of a response."""

    response: ShortName = Field(description="The response of the mechanism.")
    value: Number = Field(description="What was measured, in the response's unit.")
    sigma: PositiveNumber = Field(description="Standard uncertainty of the value (k = 1), in the response's unit.")
    campaign: ShortName | None = Field(
        None, description="Id of the campaign on this value's bench, which has the same variables; if absent the first."
    )
    specimen: ShortName = Field("1", description="Which device was measured; all values are of one if absent.")
    at: dict[ShortName, Number] = Field(
        default={}, description="Variables of the campaign that are known there, as a set position or a measured size."
    )

    @property
    def key(self) -> str:
        """The response, with its campaign if that is not the first."""
        return self.response if self.campaign is None else f"{self.response} ({self.campaign})"


class MeasurementsFile(TableModel, strict=True):
    """Unknown constants, and what was measured."""

    format: Literal[1] = Field(1, description="Version of this file format: 1.")
    constants: list[ShortName] = Field(
        min_length=1, max_length=MOST_CONSTANTS, description="Variables of the campaign with one unknown value each."
    )
    discrepancy: dict[ShortName, Lacking] = Field(
        {},
        description="What the model lacks in each response; if absent, estimated with a half-normal prior of a tenth of"
        " the response's sigma in the campaign.",
    )
    measurements: list[Measurement] = Field(
        min_length=1, max_length=MOST_MEASUREMENTS, description="The measured values."
    )


def load_measurements(source: str | Path | Mapping[str, Any]) -> MeasurementsFile:
    """Return a checked file of measurements, or its tables; SpecError tells all faults."""
    heading, content = "measurements:", b""
    try:
        if isinstance(source, Mapping):
            return MeasurementsFile.model_validate(dict(source))
        heading = f"measurements {source}:"
        content = read_regular_file(source, LARGEST)
        return MeasurementsFile.model_validate(parse_toml(content))
    except OSError as error:
        raise SpecError(f"{heading} cannot be read ({error.strerror or error}); name a file") from error
    except UnfitToml as error:
        at = SpecFault((), str(error), line=error.line, column=error.column)
        raise SpecError(f"{heading} {error}", [at]) from error
    except ValidationError as error:
        faults = structure_faults(error, MeasurementsFile)
        message = "\n  ".join([heading, *map(str, faults)])
        raise SpecError(message, with_positions(faults, content) if content else faults) from error


def calibrate_campaign(
    measurements: str | Path | Mapping[str, Any],
    campaign_id: str | None = None,
    store: str | Path = "runs",
    *,
    seed: int = 0,
) -> Calibration:
    """Return the constants of a mechanism that bench measurements suggest.

    Parameters
    ----------
    measurements : str, Path or mapping
        The constants, what the model lacks, and the measured values: a TOML file, or its tables.
    campaign_id : str, optional
        Id of the campaign whose rows are emulated; not needed if the store holds only one. The distributions of the
        constants in it are the prior.
    store : str or Path
        Folder or URL of the store.
    seed : int
        Of the draws.

    Returns
    -------
    Calibration
        What the data tell, the constants with their 95 % intervals, and ``draws`` of the posterior by constant.

    Raises
    ------
    SpecError
        The measurements do not fit the campaign.
    CampaignError
        The rows do not predict the responses well enough; the message says how many more it takes.
    """
    opened = open_store(str(store))
    return calibrated(opened, opened.plan(opened.find(campaign_id)), load_measurements(measurements), seed=seed)


def calibrated(store: Store, plan: Plan, file: MeasurementsFile, *, seed: int = 0) -> Calibration:
    """Return what `calibrate_campaign` returns, of an open store."""
    named = dict.fromkeys([None, *(each.campaign for each in file.measurements)])
    plans = {name: plan if name is None else store.plan(store.find(name)) for name in named}
    if faults := list(_faults(plans, file)):
        raise SpecError("\n  ".join(["measurements:", *map(str, faults)]), faults)
    columns = {name: independent_samples(store, each) for name, each in plans.items()}
    names = [name for name in varied(plan.spec) if all(np.ptp(each.values[name]) > 0 for each in columns.values())]
    measured = _measured(file, columns, names)
    emulators = dict[str, Emulator]()
    for name, each in plans.items():
        keys = {m.key: m.response for m in file.measurements if m.campaign == name}
        try:
            emulators |= emulated(columns[name], names, keys)
        except ReportError as error:
            raise CampaignError(f"{each.campaign_id}: {error}") from error
    try:
        found = calibrate(emulators, measured, _prior(plan.spec, names, file), _lacking(file, columns), seed=seed)
    except ReportError as error:
        raise CampaignError(f"{plan.campaign_id}: {error}") from error
    units = {each.key: plans[each.campaign].mechanism.response_units()[each.response] for each in file.measurements}
    return replace(found, units=units)


def emulated(columns: SampleColumns, names: list[str], responses: Mapping[str, str]) -> dict[str, Emulator]:
    """Return by key an emulator of each response by the named variables; ReportError says for which there is none."""
    x = np.column_stack([columns.values[name] for name in names]) if names else np.empty((columns.number.size, 0))
    found = {}
    for name, response in responses.items():
        has = np.isfinite(columns.values[response])
        try:
            found[name] = fit_emulator(x[has], columns.values[response][has])
        except ReportError as error:
            raise ReportError(f"{name}: {error}") from error
    return found


def _faults(plans: Mapping[str | None, Plan], file: MeasurementsFile) -> Iterator[SpecFault]:
    """Yield what in the file does not fit the campaigns."""
    plan, variables = plans[None], varied(plans[None].spec)
    for name, each in plans.items():
        if differing := _differing(plan.spec, each.spec):
            keys = ["measurements", str(next(i for i, m in enumerate(file.measurements) if m.campaign == name))]
            text = f"{differing} differ from those of {plan.campaign_id}; give both campaigns the same variables"
            yield fault([*keys, "campaign"], name, text)
    every = [name for each in plans.values() for name in each.mechanism.responses]
    asked = [(["discrepancy", name], name, every) for name in file.discrepancy]
    for i, m in enumerate(file.measurements):
        asked.append((["measurements", str(i), "response"], m.response, list(plans[m.campaign].mechanism.responses)))
    for keys, name, responses in asked:
        if name not in responses:
            known = f"{', '.join(responses)}{did_you_mean(name, responses)}"
            yield fault(keys, name, f"the mechanism has no such response; allowed: {known}")
    named = [(["constants", str(i)], name) for i, name in enumerate(file.constants)]
    named += [
        (["measurements", str(i), "at", name], name) for i, each in enumerate(file.measurements) for name in each.at
    ]
    for keys, name in named:
        if name not in variables:
            known = f"{', '.join(variables)}{did_you_mean(name, variables)}"
            yield fault(keys, None, f"{name}: no variable of this name varies in the campaign; allowed: {known}")
        elif keys[0] == "measurements" and name in file.constants:
            yield fault(keys, None, f"{name} is one of the constants; remove it here, or there")
    for i, name in enumerate(file.constants):
        law = plan.spec.variables.get(name)
        if name in file.constants[:i]:
            yield fault(["constants"], None, f"{name} is named twice; name it once")
        elif law is not None and (not isinstance(law, Continuous) or law.batch):
            text = f"{name} needs a distribution with a density and without batch as prior; give it one in the campaign"
            yield fault(["constants"], None, text)
    for a, b, _ in plan.spec.correlations or ():
        if not {a, b} <= set(file.constants):
            text = f"the campaign correlates {a} and {b}; allowed: correlations of constants; run one without"
            yield fault(["constants"], None, text)
    for names in joint_variables(plan.spec.variables).values():
        text = f"{', '.join(names)}: drawn from the rows of a table, which is no prior; run a campaign without joint"
        yield fault(["constants"], None, text)


def _differing(spec: CampaignSpec, other: CampaignSpec) -> str:
    """Return which variables of another bench's campaign are not those of the first; empty if all are."""
    names = [name for name in {**spec.variables, **other.variables} if _drawn(spec, name) != _drawn(other, name)]
    return ", ".join(names) or ("correlations" if spec.correlations != other.correlations else "")


def _drawn(spec: CampaignSpec, name: str) -> tuple[object, object]:
    return spec.variables.get(name), spec.targets().get(name)


def _measured(file: MeasurementsFile, columns: Mapping[str | None, SampleColumns], names: list[str]) -> Measured:
    """Return the measurements as arrays; SpecError: a known value lies where the campaign has no rows."""
    known = np.full((len(file.measurements), len(names)), np.nan)
    for i, each in enumerate(file.measurements):
        for name, value in each.at.items():
            if name not in names:
                continue
            column = columns[each.campaign].values[name]
            if not column.min() <= value <= column.max():
                raise SpecError(
                    f"measurements.{i}.at.{name}: {value:g} lies beyond the rows of the campaign, {column.min():.4g} to"
                    f" {column.max():.4g}: nothing tells what happens there; run a campaign that reaches it"
                )
            known[i, names.index(name)] = value
    return Measured(
        response=tuple(each.key for each in file.measurements),
        value=np.array([each.value for each in file.measurements]),
        sigma=np.array([each.sigma for each in file.measurements]),
        specimen=tuple(each.specimen for each in file.measurements),
        known=known,
    )


def _prior(spec: CampaignSpec, names: list[str], file: MeasurementsFile) -> Prior:
    laws = {name: spec.variables[name] for name in file.constants}
    pairs = tuple(pair for pair in spec.correlations or () if pair[0] in laws and pair[1] in laws)
    # in the order of the campaign, in which scores are mixed
    ordered = [name for name in spec.variables if name in laws]

    def values(scores: Array) -> Array:
        u = {name: np.clip(ndtr(scores[:, file.constants.index(name)]), *DRAWN) for name in ordered}
        if pairs:
            u |= correlated(u, pairs)
        return np.column_stack([laws[name].ppf(u[name]) for name in file.constants])

    moments = np.array([spec.variables[name].moments() for name in names])
    return Prior(tuple(names), tuple(file.constants), values, moments[:, 0], moments[:, 1])


def _lacking(file: MeasurementsFile, columns: Mapping[str | None, SampleColumns]) -> dict[str, Discrepancy]:
    found = {}
    for each in file.measurements:
        given = file.discrepancy.get(each.response)
        if given is None:
            spread = float(np.nanstd(columns[each.campaign].values[each.response]))
            found[each.key] = Discrepancy(USUAL_DISCREPANCY * spread, True)
        else:
            found[each.key] = Discrepancy(given.scale or given.sigma or 0.0, given.scale is not None)
    return found


def write_draws(path: Path, found: Calibration) -> None:
    """Write the draws as CSV, a column for each constant, every digit of each."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(found.draws)
        writer.writerows(zip(*(column.tolist() for column in found.draws.values()), strict=True))
