"""What is known of landmark names, and how they move from one landmark to another."""

from typing import NamedTuple

from saccade._jit import kernel
from saccade.slam.association._kernels import DROPPED, NEW
from saccade.slam.filter._state_kernels import LANDMARKS, FilterState
from saccade.types import BoolArray, FloatArray, IntArray

CLOCK, STREAK, BELIEVED, STALE, UNNAMED = 0, 1, 2, 3, 4
"""Indices into `NameTable.counts`."""
UNDECIDED = -3
"""Association of an observation for which geometry is still to be asked."""
ESTABLISHED = 3
"""Accepted observations after which a name may speak against the filter, along with others."""
TRUSTED = 10
"""Accepted observations after which a name alone is believed against the filter, and refused ones
at one position after which the name moves there, whatever was accepted."""
JOINT = 3
"""Names or observations, refused by the filter, that are believed if they agree against it."""
WINDOW = 10
"""Named observations for which a refused one is remembered."""
FAR = 100.0
"""Normalized innovation squared up to which a wrong filter is likelier than swapped names."""
LOOSE, LOOP, LONG_LOOP = 4.0, 100.0, 1000.0
"""Ratio of predicted variance to noise from which the names of a scan are checked in pairs, and
from which one observation of a landmark of few, or of any number, does not close a loop."""
PAIR_GATE = 10.83
"""Squared deviation, in standard deviations, of the distance of two landmarks: 99.9 %."""


class NameTable(NamedTuple):
    """What is known of n names, by their number in the order of first mention."""

    landmark: IntArray
    """(n,) number of the landmark in the map, -1 for none."""
    accepted: IntArray
    """(n,) observations of this name that were accepted for that landmark."""
    accepted_at: IntArray
    """(n,) of the last of them: the count of named observations before it."""
    xy: FloatArray
    """(n, 2) position in the map of the last refused observation."""
    covariance: FloatArray
    """(n, 2, 2) of its noise."""
    refused_at: IntArray
    """(n,) of that observation: the count of named observations before it."""
    votes: IntArray
    """(n,) refused observations, one after the other, at that position."""
    since: IntArray
    """(n,) of the first of them: the count of named observations before it."""
    target: IntArray
    """(n,) landmark to which they are near, `NEW` or `UNDECIDED`."""
    closings: IntArray
    """(n,) recent observations of this name that would close a loop by themselves."""
    closing_at: IntArray
    """(n,) of the last of them: the count of named observations before it."""
    stale: IntArray
    """(n,) landmark to be removed, which has lost this name; -1 for none."""
    counts: IntArray
    """(5,) named observations, refused ones since the last accepted one, the count up to which all
    are believed; landmarks to be removed, and observations or landmarks without a name so far."""


class NameGates(NamedTuple):
    """Parameters of association by name."""

    enabled: bool
    """Whether names are used at all."""
    gate: float
    """Squared Mahalanobis distance up to which an observation is of the landmark of its name."""


class NamedScan(NamedTuple):
    """The m observations of a scan, compared with the landmarks that their names say."""

    nis: FloatArray
    """(m,) normalized innovation squared; infinite without a landmark."""
    looseness: FloatArray
    """(m,) variance of the prediction over that of the observation, the larger of the two."""
    xy: FloatArray
    """(m, 2) position in the map."""
    covariance: FloatArray
    """(m, 2, 2) of its noise."""


@kernel()
def settle_names(
    f: FilterState,
    table: NameTable,
    rest: IntArray,
    near: IntArray,
    name: IntArray,
    association: IntArray,
    refused: BoolArray,
) -> None:
    """Associate the `UNDECIDED` observations `rest`, given the landmark that each is near to.

    A first observation of a name is of a new landmark, or of one without a name. A refused one is
    not used; after several at one position the name moves there.
    """
    free = f.counts[LANDMARKS]
    for n in range(len(rest)):
        i, j = rest[n], near[n]
        k = name[i]
        association[i] = DROPPED
        if k < 0:
            association[i] = j
        elif not refused[i]:
            if table.landmark[k] < 0:
                if j < 0 or _is_named(table, j):
                    j = free
                    free += 1
                table.landmark[k], table.accepted[k], table.votes[k] = j, 1, 0
                table.accepted_at[k] = table.counts[CLOCK]
                association[i] = j
        else:
            established = table.accepted[k] >= ESTABLISHED
            if not established and (j == DROPPED or (j >= 0 and _is_named(table, j))):
                j = NEW  # the only landmark that the observation may not be near is its own
            if j != DROPPED and table.target[k] not in (UNDECIDED, DROPPED, j):
                table.votes[k], table.since[k] = 1, table.counts[CLOCK]
            table.target[k] = j
            if j != DROPPED and _moves(table, k, j):
                if j < 0:
                    j = free
                    free += 1
                _move(table, k, j)
                association[i] = j


@kernel(inline=True)
def _moves(table: NameTable, k: int, j: int) -> bool:
    """Whether name k moves to landmark j, or to a new one for `NEW`."""
    if table.votes[k] < min(table.accepted[k] + 1, TRUSTED):
        return False
    for n in range(len(table.landmark) if j >= 0 else 0):
        if table.landmark[n] == j and table.accepted_at[n] >= table.since[k]:
            table.votes[k] = 0
            return False  # the landmark has a name that is accepted
    return True


@kernel(inline=True)
def _move(table: NameTable, k: int, j: int) -> None:
    """Give name k to landmark j; the one before is removed if few observations made it."""
    old = table.landmark[k]
    table.landmark[k] = j
    table.counts[UNNAMED] += 1
    if old >= 0 and table.accepted[k] < ESTABLISHED and not _is_named(table, old):
        table.stale[k] = old
        table.counts[STALE] += 1
    table.accepted[k], table.votes[k] = table.votes[k], 0
    table.accepted_at[k] = table.counts[CLOCK]


@kernel()
def _is_named(table: NameTable, j: int) -> bool:
    """Whether landmark j has a name."""
    named = False
    for n in range(len(table.landmark)):
        named = named or table.landmark[n] == j
    return bool(named)


@kernel(inline=True)
def may_cull(table: NameTable) -> bool:
    """Whether there may be a landmark without a name; the others are not culled.

    It is a name that tells a landmark that is gone from one that is not detected.
    """
    return bool(table.counts[UNNAMED] > 0)


@kernel(inline=True)
def keep_named(table: NameTable, culled: BoolArray) -> bool:
    """Take landmarks with a name out of the `culled` (n,); returns whether any is left."""
    for j in table.landmark:
        if 0 <= j < len(culled):
            culled[j] = False
    left = False
    for i in range(len(culled)):
        left = left or culled[i]
    return bool(left)
