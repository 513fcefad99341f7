"""What is kept of a CAD file comes back with the same bits, or not at all."""

from dataclasses import replace

import numpy as np
import pytest

from engine.cad.archive import packed, unpacked
from engine.cad.cad_model import CadAssembly, Placement
from tests.engine.cad.assemblies import differences, full_assembly


def test_every_bit_comes_back():
    """Of each field of each class."""
    assembly = full_assembly(np.random.default_rng(1))
    back = unpacked(CadAssembly, packed(assembly))
    assert differences(assembly, back) == []
    changed = replace(back, faces=(replace(back.faces[0], radius=3.0), *back.faces[1:]))
    assert differences(assembly, changed) == [".faces.0.radius: 3.05, 3.0"]


@pytest.mark.parametrize("cut", [0, 1, 200, -1])
def test_a_damaged_file_is_refused(cut):
    """A file that was cut off, or holds something else, is no assembly."""
    content = packed(full_assembly(np.random.default_rng(1)))
    with pytest.raises(ValueError, match="not a CadAssembly"):
        unpacked(CadAssembly, content[:cut])
    with pytest.raises(ValueError, match="not a Placement"):
        unpacked(Placement, content)
