"""The JSON Schema of the campaign file, which editors show: every key is explained."""

import tomllib

import jsonschema

from campaign.inputs.sampling import SAMPLERS
from campaign.spec.campaign_file import campaign_schema
from tests.campaign.conftest import SPEC


def properties(node, path=""):
    """Yield the path and the schema of every key, at any depth."""
    if isinstance(node, dict):
        keys = node.get("properties")
        for key, schema in keys.items() if isinstance(keys, dict) else ():
            yield f"{path}.{key}", schema
        for key, child in node.items():
            yield from properties(child, f"{path}.{key}")


def test_every_key_is_described():
    """With a whole sentence."""
    described = dict(properties(campaign_schema()))
    assert len(described) > 140
    assert {path for path, schema in described.items() if not schema.get("description", "").endswith(".")} == set()


def test_the_samplers_are_those_of_the_registry():
    """Each is named, and its meaning said."""
    schema = campaign_schema()["properties"]["sampler"]
    assert schema["enum"] == list(SAMPLERS)
    assert all(f"{name}: {sampler.summary}" in schema["description"] for name, sampler in SAMPLERS.items())


def test_a_sound_campaign_keeps_the_schema():
    """And one with an unknown sampler does not."""
    validator = jsonschema.Draft202012Validator(campaign_schema())
    campaign = tomllib.loads(SPEC)
    validator.validate(campaign)
    assert not validator.is_valid({**campaign, "sampler": "sobl"})
