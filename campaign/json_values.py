"""Values that JSON can hold: a number that is not finite becomes null."""

import math
from typing import Any


def json_values(document: Any) -> Any:
    """Return a document with None in place of NaN and infinities, and lists in place of tuples."""
    if isinstance(document, float):
        return document if math.isfinite(document) else None
    if isinstance(document, dict):
        return {key: json_values(value) for key, value in document.items()}
    if isinstance(document, list | tuple):
        return [json_values(value) for value in document]
    return document
