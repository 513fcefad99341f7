"""A campaign file proposed from the limits of size in a CAD file, with each limited diameter as a variable."""

from collections.abc import Iterable

from campaign.spec.campaign_text import campaign_text
from engine.cad_import.proposed_joints import Diameter

CPK = 1.33  # assumed for a dimension if only its limits are known, as in the docs
SAMPLES = 1000

_HEAD = """\
# Proposed by clearcap mechanism import from the limits of size in the CAD file: of each diameter the middle of its
# limits, and half of what lies between them. The Cpk with which it is made is an assumption.
#? variables: with which Cpk, or which distribution, is each of these diameters made?
#? responses: what are the limits of what is read off? Give lsl and usl in [responses.NAME]
"""


def proposed_campaign(diameters: Iterable[Diameter], mechanism: str, name: str) -> str:
    """Return the text of a campaign file that varies diameters of a mechanism file, whose path is relative to it."""
    variables = {
        diameter.parameter: {
            "target": f"parameters.{diameter.parameter}",
            "distribution": "normal",
            "nominal": round((diameter.lower + diameter.upper) / 2, 9),
            "tolerance": round((diameter.upper - diameter.lower) / 2, 9),
            "cpk": CPK,
        }
        for diameter in diameters
    }
    tables = {"format": 1, "name": name, "mechanism": mechanism, "samples": SAMPLES}
    return _HEAD + campaign_text(tables | ({"variables": variables} if variables else {}))
