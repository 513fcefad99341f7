"""Hides each private name of Numba from the engine, in turn, and prints what the engine does without it, as JSON.

Numba itself goes on to use the name: it stands for a name that a release has changed everywhere.
"""

import importlib
import json
import logging
import os
import sys
from contextlib import contextmanager
from functools import reduce
from types import ModuleType
from typing import NamedTuple

os.environ["NUMBA_CACHE_DIR"] = sys.argv[1]
HIDDEN = set()  # pairs of an object's id and a name


def asked_by_engine():
    """Return whether the function that called this one is called by the engine."""
    return sys._getframe(2).f_globals["__name__"].startswith("engine")


class Veiled(ModuleType):
    """A module with names that the engine cannot see."""

    def __getattribute__(self, name):
        if (id(self), name) in HIDDEN and asked_by_engine():
            raise AttributeError(name)
        return super().__getattribute__(name)


class Veil:
    """A member of a class, or of its objects, that the engine cannot see."""

    def __init__(self, name, member):
        self.name, self.member = name, member

    def __get__(self, instance, owner):
        if asked_by_engine():
            raise AttributeError(f"no {self.name}", name=self.name)
        if instance is not None and self.name in getattr(instance, "__dict__", ()):
            return instance.__dict__[self.name]
        if self.member is None:
            raise AttributeError(self.name)
        return self.member.__get__(instance, owner) if hasattr(self.member, "__get__") else self.member

    def __set__(self, instance, value):
        if hasattr(self.member, "__set__"):
            self.member.__set__(instance, value)
        else:
            instance.__dict__[self.name] = value


@contextmanager
def hidden(owner, name):
    """Hide a name of a module, or of a class or an object of it, from the engine."""
    if isinstance(owner, ModuleType):
        owner.__class__ = Veiled
        HIDDEN.add((id(owner), name))
        yield
        HIDDEN.clear()
        return
    kind = owner if isinstance(owner, type) else type(owner)
    kind = next((base for base in kind.__mro__ if name in vars(base)), kind)
    had, member = name in vars(kind), vars(kind).get(name)
    setattr(kind, name, Veil(name, member))
    yield
    if had:
        setattr(kind, name, member)
    else:
        delattr(kind, name)


class Lines(logging.Handler):
    """The lines that the engine logs."""

    def __init__(self):
        super().__init__()
        self.said = []

    def emit(self, record):
        """Keep a line."""
        self.said.append(record.getMessage())


def outcome():
    """Import the layer of the engine that compiles anew, compile a kernel that calls others, and call it."""
    for name in ("engine.jit", "engine.jit.decorators", "engine.jit.kept_code", "engine.jit.numba_internals"):
        sys.modules.pop(name, None)
    lines = Lines()
    log = logging.getLogger("engine.jit")
    log.addHandler(lines)
    try:
        try:
            jit = importlib.import_module("engine.jit")
        except ImportError as error:
            return {"error": [kind.__name__ for kind in type(error).__mro__[:3]], "message": str(error)}
        result, missing = computed(jit)
        return {"logged": lines.said, "result": result, "missing": missing}
    finally:
        log.removeHandler(lines)


def computed(jit):
    """Return what a kernel computes, which passes a tuple of an array to an inner one, and whether it was missing."""
    import numpy as np

    from engine.jit.kept_code import index_file
    from engine.jit.numba_internals import by_address

    @by_address
    class Given(NamedTuple):
        numbers: np.ndarray
        scale: float

    @jit.not_inlined
    def shifted(x):
        return x + 7.0

    @jit.inner
    def scaled(given):
        return given.numbers[0] * given.scale + given.numbers[1]

    @jit.kernel
    def whole(given):
        return shifted(scaled(given))

    index = index_file(whole.compiled)
    return whole(Given(np.array([2.0, 3.0]), 0.5)).hex(), index is None or not index[1]


def main():
    """Print the outcome with every name, and without each."""
    import engine.jit.numba_internals as internals

    found = {"": outcome()}
    names = [*internals.ESSENTIAL, *(name for names in internals.SAVINGS.values() for name in names)]
    for name in names:
        owner, _, path = name.partition(":")
        *way, last = path.split(".")
        if last in ("reset", "link_in"):  # of what has a private name
            last = way.pop()
        with hidden(reduce(getattr, way, internals._object(owner)), last):
            found[name] = outcome()
    for name, owner in kernels_owners():
        with hidden(owner, name):
            found[name] = outcome()
    from numba.core.datamodel.models import StructModel

    place = StructModel.get_field_position
    StructModel.get_field_position = lambda model, field: place(model, field) + asked_by_engine()
    found["order"] = outcome()
    print(json.dumps(found))


def kernels_owners():
    """Return the names on the way to a kernel's index file, each with the class that has it."""
    from numba.core.caching import FunctionCache, IndexDataCacheFile
    from numba.core.dispatcher import Dispatcher

    return [
        ("_cache", Dispatcher),
        ("_cache_file", FunctionCache),
        ("_index_path", IndexDataCacheFile),
        ("_load_index", IndexDataCacheFile),
    ]


if __name__ == "__main__":
    main()
