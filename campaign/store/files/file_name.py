"""The names that files of a store may have."""

from campaign.errors import StoreError

LONGEST_NAME = 500  # characters of a name relative to the root


def check_name(store: str, name: str) -> None:
    """Raise StoreError for a name relative to the root that leads out of it, or that no file can have."""
    if (
        len(name) > LONGEST_NAME
        or not name.isprintable()
        or name.startswith(("/", "~"))
        or "\\" in name
        or ".." in name.split("/")
    ):
        shown = name if len(name) <= 60 else name[:57] + "..."
        raise StoreError(
            f"store {store}: {shown!r} is not a valid file name; names are relative, without .."
            f" and of at most {LONGEST_NAME} characters"
        )
