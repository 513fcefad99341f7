"""The latch of the docs, as `mechanism import` finds it, and with other names."""

from dataclasses import replace

import pytest

from engine.cad import read_step
from engine.cad_import.found_features import found_features
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_mechanism import proposed_mechanism
from tests.engine.mechanism.geometry.latch_file import LATCH

HOSTILE = "</script><script>document.title = 'run'</script>]]><img src=x onerror='document.title=1'><!-- {{ 7*7 }}"


@pytest.fixture(scope="session")
def latch(tmp_path_factory):
    """Return what is found in the latch."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        return find_geometry(read_step(LATCH))


@pytest.fixture(scope="session")
def hostile(latch):
    """Return the latch with a crank and a material that are called like a script."""

    def called(entry):
        return replace(entry, part=HOSTILE) if entry.part == "crank" else entry

    parts = tuple(
        replace(p, name=HOSTILE, path=(HOSTILE,), material=replace(p.material, name=HOSTILE))
        if p.name == "crank"
        else p
        for p in latch.assembly.parts
    )
    faces, meshes = (tuple(map(called, each)) for each in (latch.assembly.faces, latch.assembly.meshes))
    return find_geometry(replace(latch.assembly, parts=parts, faces=faces, meshes=meshes, cautions=(HOSTILE,)))


def written(found, folder, step="latch.step"):
    """Write drawing and page as the command does; return the page's path."""
    from clearcap.import_page import ImportFiles, import_page, sketch_found
    from clearcap.pictures.sketch import plot_sketch

    places = found_features(found)
    drawing, page = folder / "latch.svg", folder / "latch.html"
    plot_sketch(sketch_found(found, places), f"{step}: what was found", "latch", drawing)
    text = proposed_mechanism(found, step, "latch")
    page.write_text(import_page(found, places, text, ImportFiles(step, "latch.toml", drawing.read_bytes())))
    return page
