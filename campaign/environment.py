"""Environment variables: those of the command, and those on which the last digits of its numbers depend."""

import os
import re
from collections.abc import Mapping

STORE = "CLEARCAP_STORE"  # the store, if no option names one; unlike options, other users cannot read it
SERVER = "CLEARCAP_SERVER"  # the address of a server to use in place of a store
TOKEN = "CLEARCAP_TOKEN"  # the access token for the server; unlike options, other users cannot read it

# They choose the processor for which OpenBLAS, MKL, BLIS, NumPy, Numba and the C library compute. Numbers of threads
# are left out: they belong to a machine, and change no digit of a row.
_NUMERICAL = re.compile(r"(?!.*_NUM_THREADS$)((OPENBLAS|OMP|MKL|BLIS|NPY)_.*|NUMBA_(CPU_.*|OPT)|GLIBC_TUNABLES)")


def numerical(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the variables on which the last digits of a number depend; who starts a process passes them on."""
    return {name: value for name, value in environment.items() if _NUMERICAL.fullmatch(name)}
