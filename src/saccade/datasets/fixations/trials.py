"""Trials of a subject on an image, and the choice of the eye in each trial."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from saccade.datasets.fixations.exports import RawFixations, rows_by
from saccade.types import BoolArray, FloatArray, IntArray

RUN = 3
"""Minimum mean length of uninterrupted runs for these runs to count as trials."""
BOTH_EYES = 0.5
"""Minimum ratio of the fixation counts of the two eyes for both eyes to be read."""
AVERAGED = "fixations are the mean of both eyes; --eye left or right reads one"
OTHER_EYE = "fixations of the other eye are left out"


def merge_eyes(
    raw: RawFixations, order: str, wanted: str | None, remarks: Counter[str]
) -> RawFixations:
    """The fixations of one eye in each trial, or the mean of both eyes.

    Args:
        raw: fixations with positions.
        order: index, time or row.
        wanted: L or R, the eye to read if it has fixations. None selects the eye with more
            fixations and averages its fixations with simultaneous fixations of the second eye, if
            that eye has at least half as many (without times: equally many).
        remarks: counters of averaged and omitted fixations.
    """
    kept, used, xy = (np.ones(len(raw), bool), np.zeros(len(raw), bool), raw.xy.copy())
    for rows in rows_by(raw.image, raw.subject, raw.trial):
        names, counts = np.unique(raw.eye[rows], return_counts=True)
        ranked = names[np.argsort(-counts, kind="stable")].tolist()
        eye = wanted if wanted in ranked else ranked[0]
        kept[rows] = raw.eye[rows] == eye
        if wanted is not None or {*ranked[:2]} != {"L", "R"}:
            continue
        one, other = (rows[raw.eye[rows] == each] for each in ranked[:2])
        fewest = BOTH_EYES * len(one) if order == "time" else len(one)  # indices may be shifted
        if len(other) >= fewest:
            partner = _simultaneous(raw[one], raw[other], order)
            paired = partner >= 0
            both = one[paired], other[partner[paired]]
            xy[both[0]] = (raw.xy[both[0]] + raw.xy[both[1]]) / 2
            used[both[0]] = used[both[1]] = True
    remarks[AVERAGED] += int((kept & used).sum())
    remarks[OTHER_EYE] += int((~kept & ~used).sum())
    return replace(raw, xy=xy)[kept]


def _simultaneous(one: RawFixations, other: RawFixations, order: str) -> IntArray:
    """(n,) fixation of the other eye that starts during each fixation, nearest in time; else -1."""
    spans = []
    for raw in (one, other):
        start = np.arange(float(len(raw))) if order == "row" else raw.order
        length = raw.milliseconds if order == "time" else np.full(len(raw), np.nan)
        spans.append((start, start + np.where(np.isfinite(length), length, 1.0)))
    (start, end), (other_start, other_end) = spans
    apart = np.abs(start[:, None] - other_start)
    apart[(start[:, None] >= other_end) | (end[:, None] <= other_start)] = np.inf
    return np.where(np.isfinite(apart.min(axis=1)), apart.argmin(axis=1), -1)


def number_trials(raw: RawFixations, order: str) -> IntArray:
    """(n,) number of the trial of each fixation, from 0 for each subject and image.

    Trials are named in the file, or start where the index or time restarts, or where a subject
    returns to an image. Repeated trials with equal content are merged.

    Args:
        raw: fixations with positions, in the order of the file.
        order: index, time or row.
    """
    block, trial = _blocks(raw), np.zeros(len(raw), np.int64)
    content = np.column_stack([raw.order, raw.xy])
    for rows in rows_by(raw.image, raw.subject):
        names = np.unique(raw.trial[rows], return_inverse=True)[1]
        if not names.any():
            names = _restarts(content[rows], order == "index")
        if not names.any():
            names = block[rows]
        seen: dict[frozenset[tuple[float, ...]], int] = {}
        for name in dict.fromkeys(names.tolist()):
            part = rows[names == name]
            same = frozenset(map(tuple, content[part].tolist()))
            trial[part] = seen.setdefault(same, len(seen))
    return trial


def _restarts(content: FloatArray, is_index: bool) -> IntArray:
    """(n,) run number of each fixation on an image; a run ends where index or time restarts."""
    order = content[:, 0]
    restarts: BoolArray = (np.diff(order) <= 0) & (np.diff(content, axis=0) != 0).any(axis=1)
    run = np.concatenate([[0], np.cumsum(restarts)])
    starts = order[np.unique(run, return_index=True)[1]]
    if is_index:
        most = Counter(order for order, _ in {*zip(order.tolist(), run.tolist(), strict=True)})
        valid = max(most.values()) == len(starts) and max(starts) <= min(starts) + 1
    else:
        valid = len(run) >= RUN * len(starts)
    return run if valid else np.zeros_like(run)


def _blocks(raw: RawFixations) -> IntArray:
    """(n,) number of the uninterrupted run of a subject on an image; 0 if runs are too short."""
    block = np.zeros(len(raw), np.int64)
    for rows in rows_by(raw.subject):
        own = rows[np.argsort(raw.order[rows], kind="stable")]
        runs: Sequence[list[int]] = [[*run] for _, run in groupby(own, lambda row: raw.image[row])]
        distinct = len(np.unique(raw.order[own])) == len(own)
        if distinct and len(own) >= RUN * len(runs):
            block[own] = np.repeat(np.arange(len(runs)), [len(run) for run in runs])
    return block
