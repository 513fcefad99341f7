"""Unique names of parts."""

from collections import Counter

_UNNAMED = "part"


def unique_names(products: list[str]) -> list[str]:
    """Return a unique name for each part: the name of its product, with a number if several parts share it.

    A part whose product has no name is called ``part``.
    """
    called = [product or _UNNAMED for product in products]
    several = {name for name, count in Counter(called).items() if count > 1}
    taken = set(called) - several
    found, counts = [], Counter[str]()
    for name in called:
        unique = name
        while name in several and (unique == name or unique in taken):
            counts[name] += 1
            unique = f"{name}-{counts[name]}"
        taken.add(unique)
        found.append(unique)
    return found
