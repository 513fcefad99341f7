"""The version of clearcap that is installed."""

from importlib.metadata import PackageNotFoundError, version


def clearcap_version() -> str:
    """Return the installed version, or ``not installed`` if the sources run without installation."""
    try:
        return version("clearcap")
    except PackageNotFoundError:
        return "not installed"
