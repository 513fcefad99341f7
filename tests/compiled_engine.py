"""The engine, compiled before a server of the tests starts: while it compiles, its server answers no jobs."""

from functools import cache

from engine import missing_kernels, warm_up


@cache
def compile_engine() -> None:
    """Compile the engine, unless it is compiled."""
    if missing_kernels():
        warm_up()
