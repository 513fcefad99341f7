"""A wheel with machine code: ``python deploy/compiled_wheel.py WHEEL [LEVEL ...]``, as `make wheel` does.

Beside a plain wheel of clearcap (``py3-none-any``) it writes one for this Python on x86-64 with the kernels compiled
for each level, by the packages of this environment: see `engine.jit.shipped`. The levels are those that this processor
has, because kernels are compiled by running them.
"""

import base64
import hashlib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import distribution
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

# in a process of the unpacked wheel, whose sources are those that are compiled
LEVELS = """
from llvmlite import binding
from engine.jit.shipped import LEVELS

features = binding.get_host_cpu_features()
print(*(level for level, needed in LEVELS.items() if all(features.get(name) for name in needed)))
"""
COMPILE = """
import sys
import engine
from engine.jit import CACHE_FOLDER
from engine.jit.shipped import ship

engine.warm_up()
for name in engine.library_names():
    mechanism = engine.load_mechanism(name)
    engine.check(mechanism)
    engine.simulate(mechanism, horizon=10 * mechanism.simulation.step, trajectory=f"{sys.argv[2]}/{name}.h5")
ship(CACHE_FOLDER, sys.argv[1])
"""


def main(arguments: Sequence[str]) -> None:
    """Write the wheel and print its name; none on a processor of another kind."""
    plain = Path(arguments[0])
    with tempfile.TemporaryDirectory(prefix="clearcap-wheel-") as unpacked:
        with ZipFile(plain) as wheel:
            wheel.extractall(unpacked)
            date = max(entry.date_time for entry in wheel.infolist())
        if add_layers(Path(unpacked), arguments[1:]):
            print(pack(Path(unpacked), plain.parent, date))
        else:
            print("no wheel with compiled kernels: this processor runs no level of x86-64 from v3 on")


def add_layers(packages: Path, levels: Sequence[str] = ()) -> Sequence[str]:
    """Compile the kernels of the packages in a folder for these levels, or all that this processor has, into them."""
    here = run(packages, LEVELS).split()
    if lacking := sorted(set(levels) - set(here)):
        raise SystemExit(f"this processor runs {', '.join(here) or 'no level'}, not {', '.join(lacking)}")
    for level in levels or here:
        print(f"compiling for {level}", flush=True)
        with tempfile.TemporaryDirectory(prefix="clearcap-cache-") as cache:
            processor = {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": cache}
            run(packages, COMPILE, level, cache, **processor)
    return levels or here


def run(packages: Path, code: str, *arguments: str, **environment: str) -> str:
    """Return what Python prints with the packages of a folder before all others."""
    given = {**os.environ, "PYTHONPATH": str(packages), "PYTHONDONTWRITEBYTECODE": "1", **environment}
    command = [sys.executable, "-P", "-c", code, *arguments]
    return subprocess.run(command, env=given, check=True, stdout=subprocess.PIPE, text=True).stdout


def pack(unpacked: Path, folder: Path, date: tuple[int, int, int, int, int, int]) -> Path:
    """Write the wheel of a folder, with the tags of Numba's: it runs where Numba does, and nowhere else."""
    [info] = unpacked.glob("*.dist-info")
    tags = re.findall(r"^Tag: (.*)$", distribution("numba").read_text("WHEEL") or "", re.M)
    head = re.sub(r"^Root-Is-Purelib:.*\n|^Tag:.*\n", "", (info / "WHEEL").read_text(), flags=re.M).strip()
    lines = [head, "Root-Is-Purelib: false", *(f"Tag: {tag}" for tag in tags)]
    (info / "WHEEL").write_text("\n".join(lines) + "\n")
    record = info / "RECORD"
    record.unlink()
    files = sorted(path for path in unpacked.rglob("*") if path.is_file())
    files.sort(key=lambda path: info in path.parents)  # last, as the standard recommends
    record.write_text("".join(f"{entry(unpacked, path)}\n" for path in files) + f"{info.name}/RECORD,,\n")
    parts = zip(*(tag.split("-") for tag in tags), strict=True)
    name = [info.name.removesuffix(".dist-info"), *(".".join(dict.fromkeys(part)) for part in parts)]
    target = folder / f"{'-'.join(name)}.whl"
    with ZipFile(target, "w", ZIP_DEFLATED) as wheel:
        for path in [*files, record]:
            place = ZipInfo(path.relative_to(unpacked).as_posix(), date)
            place.compress_type, place.external_attr = ZIP_DEFLATED, 0o100644 << 16
            wheel.writestr(place, path.read_bytes())
    return target


def entry(unpacked: Path, path: Path) -> str:
    """Return the line of RECORD for a file."""
    content = path.read_bytes()
    digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
    return f"{path.relative_to(unpacked).as_posix()},sha256={digest},{len(content)}"


if __name__ == "__main__":
    main(sys.argv[1:])
