"""Trials of a subject on an image: each is a scanpath of its own."""

from collections import Counter
from collections.abc import Sequence
from itertools import groupby, pairwise

import numpy as np

from saccade.datasets.fixation_tables import RawFixation
from saccade.types import IntArray

RUN = 3
"""Minimum mean number of fixations in a row for runs in the order of a file to be trials."""


def number_trials(fixations: Sequence[RawFixation], order: str) -> IntArray:
    """(n,) number of the trial of each fixation, from 0 for each subject and image.

    Trials are named by the file, or begin where the index or time restarts, or where a subject
    returns to an image after another. A trial that repeats another is the same.

    Args:
        fixations: with positions, in the order of the file.
        order: index, time or row.
    """
    block = _blocks(fixations)
    views: dict[tuple[str, str], list[int]] = {}
    for number, each in enumerate(fixations):
        views.setdefault((each.image, each.subject), []).append(number)
    trial = np.zeros(len(fixations), np.int64)
    for rows in views.values():
        named: Sequence[object] = [fixations[row].trial for row in rows]
        if len({*named}) == 1:
            named = _restarts([fixations[row] for row in rows], order == "index")
        if len({*named}) == 1:
            named = [block[row] for row in rows]
        parts: dict[object, list[int]] = {}
        for row, name in zip(rows, named, strict=True):
            parts.setdefault(name, []).append(row)
        seen: dict[frozenset[tuple[float, ...]], int] = {}
        for part in parts.values():
            content = frozenset((*fixations[row][2:5],) for row in part)
            trial[part] = seen.setdefault(content, len(seen))
    return trial


def _restarts(view: Sequence[RawFixation], is_index: bool) -> list[int]:
    """The run of each fixation on an image, where index or time restart; else 0 for all."""
    run = [0]
    for before, after in pairwise(view):
        restarts = after.order <= before.order and after[2:5] != before[2:5]
        run.append(run[-1] + restarts)
    starts = [view[run.index(number)].order for number in range(run[-1] + 1)]
    if is_index:
        most = max(
            Counter(
                order for order, _ in {(e.order, r) for e, r in zip(view, run, strict=True)}
            ).values()
        )
        valid = most == len(starts) and max(starts) <= min(starts) + 1
    else:
        valid = len(view) >= RUN * len(starts)
    return run if valid else [0] * len(view)


def _blocks(fixations: Sequence[RawFixation]) -> list[int]:
    """The number of each uninterrupted run of a subject on one image; 0 if these are too short."""
    block = [0] * len(fixations)
    rows = sorted(
        range(len(fixations)), key=lambda row: (fixations[row].subject, fixations[row].order)
    )
    for _, group in groupby(rows, key=lambda row: fixations[row].subject):
        own = [*group]
        runs = [[*run] for _, run in groupby(own, key=lambda row: fixations[row].image)]
        distinct = len({fixations[row].order for row in own}) == len(own)
        if distinct and len(own) >= RUN * len(runs):
            for number, run in enumerate(runs):
                for row in run:
                    block[row] = number
    return block
