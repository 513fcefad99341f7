"""Distributions fitted once to the same values: that, and the intervals that follow, is most of what a report costs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from reporting import response


class Remembered:
    """A function that computes once for the same arguments: arrays go by their content, other objects by identity."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._known: dict[Any, Any] = {}

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Return what the function returned for these arguments before, or now."""
        key = tuple(map(_key, arguments)), tuple(sorted(options.items()))
        if key not in self._known:
            self._known[key] = arguments, self._function(*arguments, **options)  # an argument that is kept keeps its id
        return self._known[key][1]

    @contextmanager
    def forgotten(self) -> Iterator[None]:
        """Have everything computed anew in the block."""
        known, self._known = self._known, {}
        try:
            yield
        finally:
            self._known |= known


def _key(argument: Any) -> Any:
    """Return what an argument is known by."""
    if isinstance(argument, np.ndarray):
        return argument.dtype.str, argument.shape, argument.tobytes()
    return argument if isinstance(argument, float | int | str | None) else id(argument)


@pytest.fixture(scope="session", autouse=True)
def fitted_once() -> Iterator[tuple[Remembered, ...]]:
    """Have reports fit distributions to the same values once a session; return what remembers them."""
    with pytest.MonkeyPatch.context() as patch:
        remembered = {name: Remembered(getattr(response, name)) for name in ("fit_families", "supported_indices")}
        for name, function in remembered.items():
            patch.setattr(response, name, function)
        yield tuple(remembered.values())
