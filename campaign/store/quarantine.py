"""Quarantine bad files: each is renamed, so that its rows are computed again and a person can inspect it."""

import logging
from collections.abc import Iterable

from campaign.plan_header import PlanHeader
from campaign.store.files.files import Files
from campaign.store.parts import BadPart, folder
from campaign.store.rows import files_by_batch
from campaign.store.survey import check_file

logger = logging.getLogger(__name__)


def quarantine(files: Files, plan: PlanHeader, bad: Iterable[int]) -> list[str]:
    """Rename the bad files of some batches; see `Store.quarantine`."""
    by_batch, moved = files_by_batch(files, plan), []
    suspects = dict.fromkeys(name for batch in bad for name in by_batch.get(batch, []))
    taken = set(files.names(folder(plan))) if suspects else set()
    for name in suspects:
        try:
            check_file(files, plan, name)
        except FileNotFoundError:
            continue
        except BadPart as error:
            new = _free_name(f"{name}.bad", taken)
            taken.add(new)
            files.move(f"{folder(plan)}/{name}", f"{folder(plan)}/{new}")
            moved.append(new)
            logger.warning("%s/%s %s: quarantined as %s and computed again", folder(plan), name, error, new)
    return moved


def _free_name(name: str, taken: set[str]) -> str:
    """Return the name, or the first of ``name-2``, ``name-3``, ... that is not taken."""
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}-{number}"
    return free
