"""Campaigns of simulations: specs, sampling, the store, dask."""

TYPE_CHECKING = False  # not from typing: clearcap's entry imports this before the current folder is off the path

if TYPE_CHECKING:
    from campaign.spec.load import load_campaign, load_campaign_text
    from campaign.store import open_store

__all__ = ["load_campaign", "load_campaign_text", "open_store"]


def __getattr__(name: str) -> object:
    """Import a public function at its first use: ``clearcap --help`` imports this package and needs no tables."""
    if name in ("load_campaign", "load_campaign_text"):
        from campaign.spec import load

        return getattr(load, name)
    if name == "open_store":
        from campaign.store import open_store

        return open_store
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
