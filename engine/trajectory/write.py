"""Write the trajectory of a run in blocks during the run; the file gets its name once it is complete."""

import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py

from engine.arrays import Array
from engine.assembly import Assembly
from engine.errors import TrajectoryError
from engine.mechanism import Mechanism
from engine.platform.build import build_id
from engine.run import Run
from engine.trajectory.layout import Series, series_of
from engine.trajectory.read import FORMAT, VERSION
from engine.trajectory.recording import Recording

CHUNK = 1024  # rows compressed together


class TrajectoryWriter:
    """A trajectory file that is being written; created by `trajectory_file`."""

    def __init__(self, file: Any, mechanism: Mechanism, assembly: Assembly) -> None:
        self._file = file
        for group in ("bodies", "contacts", "responses"):
            file.create_group(group, track_order=True)  # listed in the order of the run, not alphabetically
        self._series = [(series, _dataset(file, series)) for series in series_of(mechanism, assembly)]

    def append(self, rows: Array) -> None:
        """Add rows of `kernels.record`, shape (n, row length)."""
        for series, dataset in self._series:
            n = len(dataset)
            dataset.resize(n + len(rows), axis=0)
            dataset[n:] = series.take(rows)

    def finish(self, run: Run) -> None:
        """Write how the run ended; without this a file counts as incomplete."""
        self._file.create_group("certificate").attrs.update(asdict(run.certificate))
        self._file.attrs["message"] = run.message
        self._file.attrs["status"] = run.status


@contextmanager
def trajectory_file(
    recording: Recording, mechanism: Mechanism, assembly: Assembly, *, full_horizon: bool
) -> Iterator[TrajectoryWriter]:
    """Open a trajectory file under a temporary name, and give it its own name at the end of the block.

    Raises TrajectoryError if the file cannot be written.
    """
    path = Path(recording.path)
    temporary = path.with_name(f"{path.name}.{os.getpid()}-{secrets.token_hex(4)}.tmp")
    settings = {**mechanism.simulation.model_dump(mode="json"), "every": recording.every, "full_horizon": full_horizon}
    try:
        # the format of HDF5 1.10: half the size of the oldest one if there are many datasets
        with h5py.File(temporary, "x", libver=("v110", "v110")) as file:
            _describe(file, mechanism, settings)
            yield TrajectoryWriter(file, mechanism, assembly)
        # the content must be on the disk before the name is, or a loss of power could leave the name without it
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise TrajectoryError(
            f"trajectory {path}: cannot be written ({error.strerror or error}); "
            "name a file in a folder you may write to, on a disk with room"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def _describe(file: Any, mechanism: Mechanism, settings: dict[str, Any]) -> None:
    """Write the mechanism, the settings and the build of the engine."""
    file.attrs["format"] = FORMAT
    file.attrs["format_version"] = VERSION
    file.attrs["mechanism"] = mechanism.name
    file.attrs["digest"] = mechanism.digest()
    file.attrs["engine"] = build_id()
    file.attrs["units"] = mechanism.units
    file.attrs["settings"] = json.dumps(settings)
    description = mechanism.model_dump(mode="json", by_alias=True, exclude_none=True)
    file["mechanism"] = json.dumps(description, ensure_ascii=False)  # may exceed the size limit of an attribute


def _dataset(file: Any, series: Series) -> Any:
    """Create an empty, extendable dataset for a series."""
    more = () if series.width == 1 else (series.width,)
    dataset = file.create_dataset(
        series.path,
        shape=(0, *more),
        maxshape=(None, *more),
        chunks=(CHUNK, *more),
        dtype=series.dtype,
        compression="gzip",
        shuffle=True,
        fletcher32=True,
    )
    dataset.attrs["unit"] = series.unit
    dataset.attrs["description"] = series.about
    return dataset
