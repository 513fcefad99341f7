"""The layout of the house: what ARCHITECTURE.md says of it holds, and what must not grow does not."""

import ast
import re
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter

from tests.house import ROOT, functions, imports, modules, parameters, syntax_tree

MOST_PARAMETERS, MOST_OF_A_KERNEL = 8, 12
PAGE = (ROOT / "ARCHITECTURE.md").read_text("utf-8")


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Return a circle of a graph, first and last the same; empty if it has none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_a_circle_is_seen():
    """The test below can fail."""
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}})) == {"a", "b", "c"}
    assert circle({"a": {"b"}, "b": {"c"}}) == []


def test_no_import_circle():
    """No module imports itself through others, neither at run time nor for types."""
    assert circle({module: imports(module) for module in modules()}) == []


def packages_around(module: str) -> list[str]:
    """Return the packages that a module is in, from its room inwards; a package is in itself."""
    parts = module.split(".")
    outwards = (".".join(parts[:length]) for length in range(1, len(parts) + 1))
    return [name for name in outwards if name in modules() and modules()[name].name == "__init__.py"]


def package_imports(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return which package imports which, of any two that lie side by side: what is deep in them counts for both."""
    needs = defaultdict(set)
    for module, imported in graph.items():
        for other in imported:
            sides = zip(packages_around(module), packages_around(other), strict=False)
            apart = next(((one, two) for one, two in sides if one != two), None)
            if apart is not None:
                needs[apart[0]].add(apart[1])
    return needs


def test_no_package_circle():
    """Of two packages side by side one builds on the other: nobody must read both to understand one."""
    assert circle(package_imports({module: imports(module) for module in modules()})) == []


def test_a_package_circle_is_seen():
    """Modules deep in two packages make a circle of the packages, though the modules themselves are in none."""
    deep = {"engine.mechanism.joints": {"engine.cad.findings"}, "engine.cad.geometry": {"engine.mechanism.load"}}
    assert circle(deep) == []
    assert set(circle(package_imports(deep))) == {"engine.mechanism", "engine.cad"}


def compiled_in(module: str) -> set[str]:
    """Return the names of a module's functions under the compiler's decorators."""
    marks = {"kernel", "inner"}
    return {f.name for f in functions(module) if marks & {getattr(mark, "id", None) for mark in f.decorator_list}}


def is_leaf_kernel(module: str, function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Return whether a function is compiled and calls no kernel of another module: one formula on numbers and rows."""
    kernels = set().union(*(compiled_in(other) for other in modules() if other != module))
    called = {n.func.id for n in ast.walk(function) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    return function.name in compiled_in(module) and not called & (kernels - compiled_in(module))


def test_functions_take_few_parameters():
    """What belongs together travels together; the options of a command are not parameters of a function."""
    assert "step" in compiled_in("engine.kernels.step")
    too_many = {}
    for module in modules():
        for function in functions(module):
            a_verb = module.startswith("clearcap.cli.") and not function.name.startswith("_")
            if len(parameters(function)) <= MOST_PARAMETERS or a_verb:
                continue
            if len(parameters(function)) > MOST_OF_A_KERNEL or not is_leaf_kernel(module, function):
                too_many[f"{module}.{function.name}"] = len(parameters(function))
    assert too_many == {}


def test_an_array_is_declared_once_a_room():
    """The type of an array of numbers stands in one module of each room that needs it."""
    declared = defaultdict(list)
    for module in modules():
        for node in ast.walk(syntax_tree(module)):
            if isinstance(node, ast.Assign) and "Array" in [getattr(target, "id", None) for target in node.targets]:
                declared[module.partition(".")[0]].append(module)
    assert {room: homes for room, homes in declared.items() if len(homes) > 1} == {}


# -- what ARCHITECTURE.md says ---------------------------------------------------------------------------------------


def rows(heading: str) -> list[list[str]]:
    """Return the cells of the table under a heading, without its head."""
    section = re.split(r"^## ", PAGE, flags=re.M)
    text = next(part for part in section if part.startswith(heading))
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_it_is_one_page():
    """It can be read in one go."""
    assert len(PAGE.splitlines()) <= 180


def test_cells_are_short():
    """A table is for looking up; no cell of it is a paragraph."""
    cells = [cell for line in PAGE.splitlines() if line.startswith("|") for cell in line.strip("|").split("|")]
    assert len(cells) > 50
    assert [cell for cell in cells if len(cell.strip()) > 120] == []


def test_paths_exist():
    """Every file and folder that it names is there."""
    paths = set(re.findall(r"`((?:engine|campaign|reporting|tests|docs|deploy|benchmarks|studies)/[\w/.-]*)`", PAGE))
    paths |= {target for target in re.findall(r"\]\(([^)#]+)[^)]*\)", PAGE) if "://" not in target}
    assert len(paths) > 40
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []


def test_the_tree_names_every_package():
    """The tree has a line for each package, and for no other."""
    named, folders = set(), []
    for line in filter(str.strip, PAGE.split("```")[1].splitlines()):
        depth = (len(line) - len(line.lstrip())) // 2
        folders = [*folders[:depth], line.split()[0].rstrip("/")]
        named.add("/".join(folders))
    assert named == {p.parent.relative_to(ROOT).as_posix() for p in modules().values() if p.name == "__init__.py"}


def test_functions_on_the_way_of_a_row_exist():
    """Each stage's function is where the table says."""
    for _, package, function, _ in rows("The way of a row"):
        name = function.strip("`").rstrip("()")
        inside = [m for m in modules() if modules()[m].is_relative_to(ROOT / package.strip("`"))]
        assert any(name.split(".")[-1] in {f.name for f in functions(m)} for m in inside), function


def test_stages_of_the_step_are_called_by_it():
    """Every function that the table of the step names is one of the kernels, or the friction solver."""
    named = {name.rpartition(".")[2] for row in rows("A step") for name in re.findall(r"`([\w.]+)`", row[1])}
    kernels = [m for m in modules() if m.startswith(("engine.kernels.", "engine.friction."))]
    known = {m.rpartition(".")[2] for m in kernels}.union(*(compiled_in(m) for m in kernels))
    assert len(named) > 8
    assert named <= known


def test_the_glossary_is_short():
    """A newcomer learns fifteen words at most."""
    assert 8 <= len(rows("Words")) <= 15


PRIVATE_WORDS = re.compile(r"\b(agenda|how manieth|set aside|rows_apart|settle_\w+)\b", re.I)


def test_private_words_are_gone():
    """Code and docs say it in the field's own words."""
    files = [*modules().values(), ROOT / "README.md", ROOT / "ARCHITECTURE.md", *(ROOT / "docs").glob("*.md")]
    assert [path.relative_to(ROOT).as_posix() for path in files if PRIVATE_WORDS.search(path.read_text("utf-8"))] == []
