"""The version of clearcap that is installed."""

from importlib.metadata import PackageNotFoundError, version


def clearcap_version() -> str:
    """Return the installed version, or say that the sources run without being installed."""
    try:
        return version("clearcap")
    except PackageNotFoundError:
        return "not installed"
