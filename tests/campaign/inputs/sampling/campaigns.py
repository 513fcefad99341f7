"""Campaigns that the tests of the samplers draw from."""

from campaign.spec.campaign_file import CampaignSpec

J = {"mean": 0.07, "std": 0.0175, "lower": 0.01, "upper": 0.13}


UNIT = {"distribution": "uniform", "lower": 0.0, "upper": 1.0}


BOLT = {"distribution": "normal", "mean": 8.0, "std": 0.1, "batch": {"size": 17, "std": 0.2}}


DRAWING = ("random", "lhs", "sobol", "halton")


EVEN = ("lhs", "sobol", "halton")


MIXED = {
    "J1": J,
    "J2": J,
    "count": {"distribution": "poisson", "rate": 4.0},
    "life": {"distribution": "weibull", "shape": 1.5, "scale": 2.0},
    "fixed": {"distribution": "constant", "value": 3.0},
    "bolt": BOLT,
}


INDEPENDENT = {name: table for name, table in MIXED.items() if name != "bolt"}


CORRELATED = [["J1", "J2", 0.6], ["J2", "count", -0.4], ["life", "J1", 0.3]]


def spec(variables, samples=400, **keys):
    """Return a campaign of these variables."""
    tables = {"name": "demo", "mechanism": "c60", "seed": 2018, "format": 1}
    return CampaignSpec.model_validate({**tables, "samples": samples, "variables": variables, **keys})


def seven(**keys):
    """Return a campaign of the C-60's seven clearances."""
    return spec({f"J{i}": J for i in range(1, 8)}, **keys)
