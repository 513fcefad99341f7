"""Templates of pages: what is inserted is escaped, what is missing is an error, and numbers are written one way."""

from jinja2 import Environment, PackageLoader, StrictUndefined

from reporting import format_numbers


def page_environment(package: str) -> Environment:
    """Return the environment of the templates in the folder ``templates`` of a package, with filters for numbers."""
    made = Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(
        plain=format_numbers.plain,
        index=format_numbers.index,
        ppm=format_numbers.ppm,
        percent=format_numbers.percent,
        significant=format_numbers.significant,
        grouped=format_numbers.grouped,
        duration=format_numbers.duration,
    )
    return made
