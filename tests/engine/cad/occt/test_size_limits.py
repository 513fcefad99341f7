"""The faces of a dimension, where its parts occur several times."""

from engine.cad.occt.size_limits import faces_of_instances


def test_faces_of_instances():
    """The first instance of one side belongs to the first of the other; different numbers of them are unclear."""
    assert faces_of_instances([[(1,), (11,)]]) == [(1,), (11,)]
    assert faces_of_instances([[(1,), (11,)], [(2, 3), (12, 13)]]) == [(1, 2, 3), (11, 12, 13)]
    assert faces_of_instances([[(1,), (11,)], [(2,)]]) is None
    assert faces_of_instances([[(1,)], []]) == faces_of_instances([]) == []
