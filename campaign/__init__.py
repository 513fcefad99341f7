"""Campaigns of simulations: specs, sampling, the store, dask, the command line."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from campaign.spec.load import load_campaign
    from campaign.store import open_store

__all__ = ["load_campaign", "open_store"]


def __getattr__(name: str) -> Any:
    """Import the public face when it is asked for: the command's help needs neither tables nor dask."""
    if name == "load_campaign":
        from campaign.spec.load import load_campaign

        return load_campaign
    if name == "open_store":
        from campaign.store import open_store

        return open_store
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
