"""The command: `python -m studies.c60_cad FOLDER` compares the authors' CAD files with `c60.toml`.

FOLDER is the folder of the model Trip_Magnetic of siconos-tutorials, which contains the folder CAD.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from engine import load_mechanism
from studies.c60_cad.bodies import count_listed, listed_files, posed_assembly
from studies.c60_cad.comparison import compared_contacts, compared_joints

JOINTS = (
    "| joint | journal radius, mm | c60.toml | clearance as drawn, mm | bearing axis off, mm | journal axis off, mm "
    "| rings inside | start gap, mm | c60.toml |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |"
)
CONTACTS = "| contact | start gap, mm | c60.toml |\n| --- | --- | --- |"


def lines(files: Mapping[str, Sequence[Path]]) -> Iterator[str]:
    """Yield the lines of the tables for some files, given by body."""
    mechanism = load_mechanism("c60")
    there = {body: paths for body, paths in files.items() if paths}
    yield f"{sum(map(len, there.values()))} of {count_listed()} listed files: {', '.join(there) or 'none'}"
    if not there:
        return
    assembly = posed_assembly(there, mechanism)
    joints, others = compared_joints(assembly, mechanism)
    yield JOINTS
    for name in mechanism.loose_joints():
        if (joint := joints.get(name)) is None:
            yield f"| {name} | not found | | | | | | | |"
            continue
        radii = [", ".join(f"{radius:g}" for radius in each) for each in (joint.drawn_radii, joint.given_radii)]
        numbers = joint.clearance, joint.bearing_off, joint.journal_off
        yield (
            f"| {name} | {radii[0]} | {radii[1]} | {' | '.join(f'{x:.4f}' for x in numbers)} "
            f"| {'yes' if joint.rings_inside else 'no'} | {joint.drawn_gap:.4f} | {joint.given_gap:.4f} |"
        )
    for pin in others:
        yield f"no joint of c60.toml: a pin of {pin.journal} in {pin.bearing}, radius {pin.seats[0].pin_radius:g} mm"
    yield CONTACTS
    for name, given, drawn in compared_contacts(assembly, mechanism):
        yield f"| {name} | {'not in the files' if drawn is None else f'{drawn:.4f}'} | {given:.4f} |"


def main() -> None:
    """Print the tables of a folder."""
    parser = argparse.ArgumentParser(prog="python -m studies.c60_cad", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--file", action="append", default=[], metavar="BODY=FILE", help="one more file of a body")
    asked = parser.parse_args()
    files = defaultdict(list, listed_files(asked.folder))
    for body, _, name in (entry.partition("=") for entry in asked.file):
        files[body].append(Path(name))
    for line in lines(files):
        print(line)


if __name__ == "__main__":
    main()
