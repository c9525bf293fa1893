"""Association by landmark names that may be wrong."""

from math import hypot, inf

import numpy as np

from saccade._jit import kernel
from saccade.slam.association._kernels import (
    DROPPED,
    Gates,
    _associate_nearest,
    predict_observations,
    squared_distance,
)
from saccade.slam.association._name_table_kernels import (
    BELIEVED,
    CLOCK,
    ESTABLISHED,
    FAR,
    JOINT,
    LONG_LOOP,
    LOOP,
    LOOSE,
    PAIR_GATE,
    STREAK,
    TRUSTED,
    UNDECIDED,
    UNNAMED,
    WINDOW,
    NamedScan,
    NameGates,
    NameTable,
    settle_names,
)
from saccade.slam.filter._kernels import wrapped
from saccade.slam.filter._range_bearing_kernels import inverse_observe
from saccade.slam.filter._state_kernels import (
    DOWNDATES,
    INVARIANT,
    UPDATES,
    FilterState,
    Scratch,
)
from saccade.types import BoolArray, FloatArray, IntArray


@kernel()
def associate_named(
    f: FilterState,
    w: Scratch,
    table: NameTable,
    name_gates: NameGates,
    gates: Gates,
    confirmed: BoolArray,
    z: FloatArray,
    R: FloatArray,
    name: IntArray,
    association: IntArray,
    refused: BoolArray,
) -> bool:
    """Associate a scan (m,) by names (m,), -1 where unknown, and else by geometry.

    Fills the landmark of each observation, or `NEW` or `DROPPED`, and whether its name was refused.
    Returns whether this was done; not where a name contradicts an uncertain prediction.
    """
    unnamed = 0
    for i in range(len(name)):
        unnamed += name[i] < 0
    if unnamed == len(name):
        table.counts[UNNAMED] += unnamed
        _associate_nearest(f, z, R, gates, association[:0], confirmed, association)
        return True
    seen = _compare_scan(f, w, table, z, R, name)
    if contradicts_uncertain(f, table, name_gates.gate, seen, name, refused):
        return False
    table.counts[UNNAMED] += unnamed
    judge_names(f, table, seen, name, association, refused)
    m = len(name)
    rest, taken, num_rest, num_taken = np.empty(m, np.int64), np.empty(m, np.int64), 0, 0
    rest_z, rest_R = np.empty((m, 2)), np.empty((m, 2, 2))
    for i in range(m):
        if association[i] >= 0:
            taken[num_taken] = association[i]
            num_taken += 1
        elif association[i] == UNDECIDED:
            for j in range(2):
                rest_z[num_rest, j] = z[i, j]
                for k in range(2):
                    rest_R[num_rest, j, k] = R[i, j, k]
            rest[num_rest] = i
            num_rest += 1
    if num_rest > 0:
        rest, near = rest[:num_rest], np.empty(num_rest, np.int64)
        z, R = rest_z[:num_rest], rest_R[:num_rest]
        _associate_nearest(f, z, R, gates, taken[:num_taken], confirmed, near)
        settle_names(f, table, rest, near, name, association, refused)
    return True


@kernel()
def _compare_scan(
    f: FilterState, w: Scratch, table: NameTable, z: FloatArray, R: FloatArray, name: IntArray
) -> NamedScan:
    """Compare a scan of ranges and bearings with the landmarks that its names say."""
    m = len(z)
    seen = NamedScan(np.full(m, inf), np.zeros(m), np.empty((m, 2)), np.empty((m, 2, 2)))
    landmark = np.zeros(1, np.int64)
    expected, S = np.empty((1, 2)), np.empty((1, 2, 2))
    for i in range(m):
        inverse_observe(f, w, z[i], R[i], seen.xy[i], seen.covariance[i])
        if name[i] >= 0 and table.landmark[name[i]] >= 0:
            landmark[0] = table.landmark[name[i]]
            predict_observations(f, landmark, expected, S)
            v, u = z[i, 0] - expected[0, 0], wrapped(z[i, 1] - expected[0, 1])
            H, N = S[0], R[i]
            a, c, d = H[0, 0] + N[0, 0], H[0, 1] + N[0, 1], H[1, 1] + N[1, 1]
            seen.nis[i] = squared_distance(v, u, a, c, d)
            seen.looseness[i] = max(H[0, 0] / N[0, 0], H[1, 1] / N[1, 1])
    return seen


@kernel()
def contradicts_uncertain(
    f: FilterState,
    table: NameTable,
    gate: float,
    seen: NamedScan,
    name: IntArray,
    refused: BoolArray,
) -> bool:
    """Fill which names (m,) contradict the filter; whether any does that is predicted loosely."""
    uncertain = False
    for i in range(len(name)):
        known = name[i] >= 0 and table.landmark[name[i]] >= 0
        refused[i] = known and not seen.nis[i] <= gate
    _refuse_inconsistent(f, table, seen, name, refused)
    for i in range(len(name)):
        uncertain = uncertain or (refused[i] and seen.looseness[i] > LOOP)
    return uncertain


@kernel()
def judge_names(
    f: FilterState,
    table: NameTable,
    seen: NamedScan,
    name: IntArray,
    association: IntArray,
    refused: BoolArray,
) -> None:
    """Accept the observations that agree with the landmarks that their names say.

    Fills the association of these, and `UNDECIDED` for all others, given which names are `refused`
    as they contradict the filter. Where several of these agree with one another, it is the filter
    that is wrong: they are accepted.
    """
    m = len(name)
    for i in range(m):
        association[i] = UNDECIDED
    corroborated = _num_closing(table, seen, name, refused) > 1
    num_accepted, start = 0, table.counts[CLOCK]
    for i in range(m):
        k = name[i]
        if k < 0 or table.landmark[k] < 0:
            continue
        table.counts[CLOCK] += 1
        few = table.accepted[k] < ESTABLISHED
        table.counts[STREAK] += refused[i] and not few
        loose = seen.looseness[i] > (LOOP if few else LONG_LOOP)
        alone = loose and not corroborated and not refused[i]
        refused[i] = refused[i] or (alone and few and _is_duplicate(f, table, seen, i, k))
        if refused[i]:
            _remember(table, seen, i, k)
        elif alone and not _is_repeated(table, k):
            association[i] = DROPPED
        else:
            num_accepted += 1
            table.counts[STREAK] = 0
    believed, any_believed = np.zeros(m, np.bool_), False
    for i in range(m):
        believed[i] = refused[i] and _is_believed(
            f, table, name[i], seen.nis[i], num_accepted, start
        )
        any_believed = any_believed or believed[i]
    if any_believed:
        table.counts[BELIEVED] = table.counts[CLOCK] + WINDOW
    elif num_accepted > 0:
        table.counts[BELIEVED] = -1
    for i in range(m):
        k = name[i]
        refused[i] = refused[i] and not believed[i]
        known = k >= 0 and table.landmark[k] >= 0
        if known and not refused[i] and association[i] != DROPPED:
            association[i] = table.landmark[k]
            table.accepted[k] += 1
            table.accepted_at[k] = table.counts[CLOCK]
            table.votes[k] = 0


@kernel(inline=True)
def _num_closing(table: NameTable, seen: NamedScan, name: IntArray, refused: BoolArray) -> int:
    """Number of observations of a scan that close a loop if their names are right."""
    count = 0
    for i in range(len(name)):
        k = name[i]
        known = k >= 0 and table.landmark[k] >= 0
        count += known and not refused[i] and seen.looseness[i] > LOOP
    return count


@kernel(inline=True)
def _is_repeated(table: NameTable, k: int) -> bool:
    """Count an observation of name k that closes a loop by itself; whether there are enough."""
    clock = table.counts[CLOCK]
    if clock - table.closing_at[k] > WINDOW:
        table.closings[k] = 0
    table.closings[k] += 1
    table.closing_at[k] = clock
    return bool(table.closings[k] >= JOINT)


@kernel(inline=True)
def _is_duplicate(f: FilterState, table: NameTable, seen: NamedScan, i: int, k: int) -> bool:
    """Whether a landmark with a better known name is where the one named k is.

    The first observation of k had the wrong name then, and i is of another landmark.
    """
    r, s, xy, C = f.robot_size, f.state, seen.xy[i], seen.covariance[i]
    a = table.landmark[k]
    for j in range(len(table.landmark)):
        b = table.landmark[j]
        if b < 0 or b == a or table.accepted[j] < ESTABLISHED:
            continue
        dx, dy = s[r + 2 * a] - s[r + 2 * b], s[r + 2 * a + 1] - s[r + 2 * b + 1]
        near = dx * dx + dy * dy < LOOSE * PAIR_GATE * (C[0, 0] + C[1, 1])
        if near and _distances_agree(f, a, b, xy, C, xy, C):
            return True
    return False


@kernel(inline=True)
def _remember(table: NameTable, seen: NamedScan, i: int, k: int) -> None:
    """Note the refused observation i of name k."""
    v, w = seen.xy[i, 0] - table.xy[k, 0], seen.xy[i, 1] - table.xy[k, 1]
    C, D = seen.covariance[i], table.covariance[k]
    a, c, d = C[0, 0] + D[0, 0], C[0, 1] + D[0, 1], C[1, 1] + D[1, 1]
    if table.votes[k] > 0 and squared_distance(v, w, a, c, d) <= PAIR_GATE:
        table.votes[k] += 1
    else:
        table.votes[k], table.since[k], table.target[k] = 1, table.counts[CLOCK], UNDECIDED
    for j in range(2):
        table.xy[k, j] = seen.xy[i, j]
        for n in range(2):
            table.covariance[k, j, n] = C[j, n]
    table.refused_at[k] = table.counts[CLOCK]


@kernel(inline=True)
def _is_believed(
    f: FilterState, table: NameTable, k: int, nis: float, num_accepted: int, scan_start: int
) -> bool:
    """Whether the refused name k and others that agree with it are believed, not the filter.

    Either there are more of them than of names that were accepted or that contradict k, or none
    was accepted since, and none contradicts k. Once names are believed, one is enough until one is
    accepted: the filter is corrected step by step.
    """
    if table.accepted[k] < ESTABLISHED:
        return False
    clock = table.counts[CLOCK]
    recovering = clock <= table.counts[BELIEVED]
    first = scan_start if recovering else clock - WINDOW
    supporting, contradicting = 1, 0
    for j in range(len(table.landmark)):
        recent = table.votes[j] > 0 and table.refused_at[j] > first and table.landmark[j] >= 0
        if j == k or not recent or table.accepted[j] < ESTABLISHED:
            continue
        if _distances_agree(
            f,
            table.landmark[k],
            table.landmark[j],
            table.xy[k],
            table.covariance[k],
            table.xy[j],
            table.covariance[j],
        ):
            supporting += 1
        else:
            contradicting += 1
    if (recovering or supporting >= JOINT) and supporting > max(num_accepted, contradicting):
        return True
    if supporting == 1:
        swapped = table.votes[k] > 1 and table.target[k] >= 0 and nis > FAR
        if swapped or table.accepted[k] < TRUSTED:
            return False
    enough = JOINT if nis > FAR else JOINT - 1
    return bool(table.counts[STREAK] >= enough and contradicting == 0)


@kernel(inline=True)
def _refuse_inconsistent(
    f: FilterState, table: NameTable, seen: NamedScan, name: IntArray, refused: BoolArray
) -> None:
    """Refuse names of a scan whose landmarks are not as far from one another as the observations.

    An uncertain prediction, as before a loop is closed, accepts many landmarks; the distances
    between landmarks are certain all the same.
    """
    m = len(name)
    loose = False
    for i in range(m):
        loose = loose or (seen.looseness[i] > LOOSE and not refused[i])
    if not loose:
        return
    conflicts = np.zeros((m, m), np.bool_)
    for i in range(m):
        for j in range(i):
            a, b = name[i], name[j]
            if a < 0 or b < 0 or a == b or refused[i] or refused[j]:
                continue
            a, b = table.landmark[a], table.landmark[b]
            if a >= 0 and b >= 0 and a != b:
                conflicts[i, j] = conflicts[j, i] = not _distances_agree(
                    f,
                    a,
                    b,
                    seen.xy[i],
                    seen.covariance[i],
                    seen.xy[j],
                    seen.covariance[j],
                )
    count = np.empty(m, np.int64)
    while True:
        most = 0
        for i in range(m):
            count[i] = 0
            for j in range(m):
                count[i] += conflicts[i, j]
            most = max(most, count[i])
        if most == 0:
            return
        for i in range(m):
            if count[i] == most:
                refused[i] = True
                for j in range(m):
                    conflicts[i, j] = conflicts[j, i] = False


@kernel()
def _distances_agree(
    f: FilterState,
    a: int,
    b: int,
    xy: FloatArray,
    C: FloatArray,
    other_xy: FloatArray,
    other_C: FloatArray,
) -> bool:
    """Whether two observed points are as far from each other as landmarks a and b of the map."""
    r, s = f.robot_size, f.state
    p, q = r + 2 * a, r + 2 * b
    dx, dy = s[p] - s[q], s[p + 1] - s[q + 1]
    vx, vy = xy[0] - other_xy[0], xy[1] - other_xy[1]
    mapped, observed = hypot(dx, dy), hypot(vx, vy)
    variance = 0.0
    if observed > 0:
        vx, vy = vx / observed, vy / observed
        variance += vx * vx * (C[0, 0] + other_C[0, 0]) + vy * vy * (C[1, 1] + other_C[1, 1])
        variance += 2 * vx * vy * (C[0, 1] + other_C[0, 1])
    if mapped > 0:
        variance += _relative_variance(f, a, b, dx / mapped, dy / mapped)
    return bool((observed - mapped) ** 2 <= PAIR_GATE * variance)


@kernel(inline=True)
def _relative_variance(f: FilterState, a: int, b: int, ux: float, uy: float) -> float:
    """Variance of the difference of two landmarks of the map along a direction."""
    r, P = f.robot_size, f.P
    p, q = r + 2 * a, r + 2 * b
    i, j = min(p, q), max(p, q)
    U, V = f.blocks[a], f.blocks[b]
    xx, xy = U[0] + V[0] - 2 * P[i, j], U[1] + V[1] - P[i, j + 1] - P[i + 1, j]
    yy = U[2] + V[2] - 2 * P[i + 1, j + 1]
    for rows, count, sign in (
        (f.downdates, f.counts[DOWNDATES], -1.0),
        (f.updates, f.counts[UPDATES], 1.0),
    ):
        for k in range(count):
            x, y = rows[k, i], rows[k, i + 1]
            v, w = rows[k, j], rows[k, j + 1]
            xx -= 2 * sign * x * v
            xy -= sign * (x * w + y * v)
            yy -= 2 * sign * y * w
    variance = ux * ux * xx + 2 * ux * uy * xy + uy * uy * yy
    if f.error_state == INVARIANT:  # of e = eta + a e_theta
        h = f.heading_lever
        lever = ux * (h[p] - h[q]) + uy * (h[p + 1] - h[q + 1])
        with_heading = ux * (P[2, p] - P[2, q]) + uy * (P[2, p + 1] - P[2, q + 1])
        variance += lever * (2 * with_heading + lever * P[2, 2])
    return max(float(variance), 0.0)
