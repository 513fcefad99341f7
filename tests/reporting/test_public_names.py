"""`reporting.capability` is a package and `from reporting import capability` a function, in both orders of imports."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.processes

FUNCTION = "from reporting import capability; assert capability([1.0, 2.0], 0.0, 3.0).cpk is not None"
MODULE = "from reporting.capability.intervals import cp_interval; assert cp_interval(1.0, 9, 0.95)"


@pytest.mark.parametrize("imports", [(FUNCTION, MODULE), (MODULE, FUNCTION)])
def test_the_function_and_its_package_share_a_name(imports: tuple[str, str]) -> None:
    subprocess.run([sys.executable, "-c", "\n".join(imports)], check=True)
