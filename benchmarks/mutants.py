"""Which faults the tests see: `python -m benchmarks.mutants choose | judge`.

A mutant is the code with one expression changed: a comparison turned, a sign, a constant, a condition. `choose` draws
them at random, `judge` runs for each one the tests that reach it, in a copy of the tree, until the first one fails. Who
makes the tests cheaper judges the same mutants before and after: what was killed stays killed.
"""

import argparse
import ast
import copy
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from benchmarks import ROOT

AREAS = "reporting", "campaign/store", "campaign/coordinator", "engine"
LEFT_OUT = ".git", ".venv", "build", "runs", "node_modules", ".*cache"
SECONDS = 900.0  # of the tests of one mutant; one that makes them hang is seen
TURNED = {
    **{ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq},
    **{ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In},
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult},
    **{ast.And: ast.Or, ast.Or: ast.And},
}


def choose(each: int, seed: int) -> list[dict[str, Any]]:
    """Draw so many mutants of each area: file, line and columns, the text there and what replaces it."""
    draw = random.Random(seed)
    chosen = []
    for area in AREAS:
        all_of_it = [mutant for path in sorted((ROOT / area).rglob("*.py")) for mutant in _mutants(path)]
        chosen += draw.sample(all_of_it, each)
    return chosen


def _mutants(path: Path) -> Iterator[dict[str, Any]]:
    """Yield every mutant of a file that this module can make."""
    source = path.read_text("utf-8")
    for node in _expressions(ast.parse(source)):
        mutated = _mutated(node)
        text = ast.get_source_segment(source, node)
        if mutated is not None and text is not None and node.lineno == node.end_lineno:
            line = source.splitlines()[node.lineno - 1]
            yield {
                "path": path.relative_to(ROOT).as_posix(),
                "line": node.lineno,
                "column": len(line.encode()[: node.col_offset].decode()),
                "text": line,
                "before": text,
                "after": f"({ast.unparse(mutated)})",
            }


def _expressions(tree: ast.AST) -> Iterator[ast.expr]:
    """Yield the expressions that are computed in functions: no annotations, decorators, docstrings, defaults."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            for statement in node.body:
                yield from _computed(statement)


def _computed(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the expressions of a statement, without those of functions within it, which come by themselves."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.JoinedStr | ast.Raise):
        return
    if isinstance(node, ast.expr):
        yield node
    for name, value in ast.iter_fields(node):
        if name != "annotation":
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _computed(child)


def _mutated(node: ast.expr) -> ast.expr | None:
    """Return an expression with its fault, or None where this module knows none."""
    changed: Any = copy.deepcopy(node)
    if isinstance(node, ast.Compare) and type(node.ops[0]) in TURNED:
        changed.ops[0] = TURNED[type(node.ops[0])]()
    elif isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in TURNED:
        changed.op = TURNED[type(node.op)]()
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        changed = changed.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        changed.value = not node.value
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        changed.value = node.value + 1 if isinstance(node.value, int) else 2 * node.value or 1.0
    else:
        return None
    return changed


def judge(mutants: list[dict[str, Any]], jobs: int, out: Path) -> None:
    """Judge mutants, several at once, and write what became of each."""
    verdicts: list[dict[str, Any]] = []

    def one(mutant: dict[str, Any]) -> None:
        verdicts.append({**mutant, **_verdict(mutant)})
        out.write_text(json.dumps(verdicts, indent=1))
        print(len(verdicts), mutant["path"], mutant["line"], verdicts[-1]["killed_by"], flush=True)

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(one, mutants))


def _verdict(mutant: dict[str, Any]) -> dict[str, Any]:
    """Return by which test a mutant was killed (None: by no one), and the seconds that it took."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(*LEFT_OUT))
        apply(mutant, tree)
        # no compiled kernel of another mutant
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/numba", "OPENBLAS_NUM_THREADS": "1"}
        killed = next(filter(None, (_killer(tests, tree, environment) for tests in tests_of(mutant))), None)
    return {"killed_by": killed, "seconds": round(time.monotonic() - began)}


def _killer(tests: list[str], tree: Path, environment: dict[str, str]) -> str | None:
    """Return the first test that fails, or how the tests end otherwise; None if all pass."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=no", *tests]
    try:
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, timeout=SECONDS)
    except subprocess.TimeoutExpired:
        return "hangs"
    failed = re.search(r"^(?:FAILED|ERROR) (.*?)(?: - |$)", done.stdout, re.M)
    is_gone = done.returncode == pytest.ExitCode.USAGE_ERROR  # the test that killed it before is a part of another now
    return failed[1] if failed else None if done.returncode == 0 or is_gone else f"exit status {done.returncode}"


def tests_of(mutant: dict[str, Any]) -> Iterator[list[str]]:
    """Yield the tests of a mutant: the one that killed it before, those of its module, of its folder."""
    path = Path(mutant["path"])
    area = next(area for area in AREAS if path.is_relative_to(area))
    known = mutant.get("killed_by")
    if known and (ROOT / known.split("::")[0]).exists():
        yield [known]
    if own := sorted((ROOT / "tests" / area).rglob(f"test_{path.stem}.py")):
        yield [file.relative_to(ROOT).as_posix() for file in own]
    folder = next(
        each for each in [Path("tests", path.parent), *Path("tests", path.parent).parents] if (ROOT / each).is_dir()
    )
    yield [folder.as_posix()]


def apply(mutant: dict[str, Any], tree: Path) -> None:
    """Put the fault into a tree, where the line stands now: it may have moved."""
    path = tree / mutant["path"]
    lines = path.read_text("utf-8").splitlines(keepends=True)
    at = min(
        (number for number, line in enumerate(lines) if line.rstrip("\n") == mutant["text"]),
        key=lambda number: abs(number + 1 - mutant["line"]),
    )
    start, end = mutant["column"], mutant["column"] + len(mutant["before"])
    assert lines[at][start:end] == mutant["before"]
    lines[at] = lines[at][:start] + mutant["after"] + lines[at][end:]
    path.write_text("".join(lines), "utf-8")


def main() -> None:
    """Choose mutants, or judge them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("do", choices=["choose", "judge"])
    parser.add_argument("file", type=Path, help="the mutants; what `judge` wrote can be judged again")
    parser.add_argument("--each", type=int, default=20, help="mutants of each area (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=20261127)
    parser.add_argument("--jobs", type=int, default=2, help="mutants judged at once (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("build/mutants.json"), help="default: %(default)s")
    asked = parser.parse_args()
    if asked.do == "choose":
        asked.file.write_text(json.dumps(choose(asked.each, asked.seed), indent=1))
    else:
        asked.out.parent.mkdir(parents=True, exist_ok=True)
        judge(json.loads(asked.file.read_text()), asked.jobs, asked.out)


if __name__ == "__main__":
    main()
