"""Templates of pages: inserted text is escaped, a missing name is an error, and numbers have one format."""

import base64
import hashlib

from jinja2 import Environment, PackageLoader, StrictUndefined

from reporting import format_numbers


def page_environment(package: str) -> Environment:
    """Return the environment of the templates in the folder ``templates`` of a package, with filters for numbers."""
    made = Environment(
        loader=PackageLoader(package), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    made.filters.update(
        plain=format_numbers.plain,
        index=format_numbers.index,
        index_interval=format_numbers.index_interval,
        ppm=format_numbers.ppm,
        percent=format_numbers.percent,
        significant=format_numbers.significant,
        grouped=format_numbers.grouped,
        duration=format_numbers.duration,
        # by which a content security policy names an element
        source_hash=lambda text: f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}",
    )
    return made
