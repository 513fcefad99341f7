"""Load the mechanism named in a command."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from engine import Mechanism


def named_mechanism(name: str) -> "Mechanism":
    """Load a shipped mechanism or a mechanism file; raise SpecError if the name is that of a shipped campaign.

    Raises MechanismError if it cannot be found or read, or, with one line for each fault, if the file has faults.
    """
    from campaign.errors import SpecError
    from campaign.spec.load import campaign_names
    from engine import library_names, load_mechanism

    if name in set(campaign_names()) - set(library_names()):
        raise SpecError(f"{name}: is a shipped campaign, not a mechanism; compute it with: clearcap run {name}")
    return load_mechanism(name)
