"""Gaze policies that use the map: salient places, and expected information."""

from collections.abc import Callable

import numpy as np

from saccade.slam.models import wrap
from saccade.types import BoolArray, FloatArray
from saccade.visual.gaze import (
    Belief,
    Candidates,
    Gaze,
    GazeLimits,
    Policy,
    SalientPlaces,
    fixed,
    random_policy,
    sweep,
)

RECOVERY_TIME = 4.0
"""Seconds after which a place that was looked at attracts half as much as it did: inhibition of
return."""
MARGIN = 0.1
"""Fraction of the width of a view at each side that does not count."""
NEAR = 0.5
"""Metres of range from which a landmark is re-detected."""
MAX_VIEW_CHANGE, MAX_RANGE_RATIO = np.radians(40.0), 1.8
"""Change of the direction in which a landmark is seen, and of its range, from where it was first
seen, up to which its descriptor matches."""
POINTS_PER_PLACE, FEW_POINTS, MANY_POINTS = 25.0, 10.0, 150.0
"""Points that are tracked around a salient place; and numbers under and over which more of them do
not change the motion."""
SIDEWAYS, MIN_SPEED = 15.0, 0.05
"""Variance of the motion where the camera looks across it, over that where it looks along it, less
1; and the speed in meters per second from which there is a direction of motion."""
TURNING = 5.0
"""Variance of a step while the camera turns at its full rate, over that while it rests."""
SAMPLES = 5
"""Times within the horizon at which visibility is predicted."""
RANGE_SIGMA, BEARING_SIGMA = 0.03, 0.005
"""Standard deviations of an observation over the horizon: of the range as a fraction of it, and of
the bearing in radians."""
SHARED_SIGMA = 0.01, 0.004
"""The same of the error that all observations of a frame share."""
MAX_JOINT = 12
"""Landmarks of a view whose joint information is computed: the most informative ones."""


def salient(
    belief: Belief, places: SalientPlaces, candidates: Candidates, limits: GazeLimits
) -> Gaze:
    """To the most salient place in reach of a view, with inhibition of return over the map."""
    value = attraction(belief, places, candidates)
    value -= 1e-3 * np.abs(candidates.pan - belief.gaze.pan)  # of equal ones the nearest
    return _choose(belief, candidates, {"salient": value})


def attraction(belief: Belief, places: SalientPlaces, candidates: Candidates) -> FloatArray:
    """(n,) sum of the saliency of the places in each view, less where they were just seen."""
    fresh = 1 - 0.5 ** (places.unattended / RECOVERY_TIME)
    seen = visible(belief.pose, places.xy, candidates)[0]
    alike = looks_alike(belief.pose, places.xy, places.viewpoint)
    return np.asarray(seen @ (places.saliency * fresh * alike))


def visible(
    pose: FloatArray, points: FloatArray, candidates: Candidates
) -> tuple[FloatArray, FloatArray]:
    """Whether k points are in each of n views from a pose (3,): (n, k), 0 or 1; ranges (k,)."""
    offset = points - pose[:2]
    bearing = wrap(np.arctan2(offset[:, 1], offset[:, 0]) - pose[2])
    half = (0.5 - MARGIN) * candidates.field_of_view[0]
    inside = np.abs(wrap(bearing - candidates.pan[:, None])) < half
    return inside.astype(np.float64), np.hypot(*offset.T)


def looks_alike(pose: FloatArray, points: FloatArray, viewpoint: FloatArray) -> BoolArray:
    """(k,) whether points (k, 2) are seen as from where they were first seen, (k, 2).

    From a similar direction and range, so that descriptors match; then no wall is between either.
    """
    first, offset = points - viewpoint, points - pose[:2]
    cross = first[:, 0] * offset[:, 1] - first[:, 1] * offset[:, 0]
    change = np.abs(np.arctan2(cross, (first * offset).sum(1)))
    first_range = np.maximum(np.hypot(*first.T), 1e-6)
    r = np.maximum(np.hypot(*offset.T), 1e-6)
    ratio = np.maximum(r / first_range, first_range / r)
    return np.asarray((change < MAX_VIEW_CHANGE) & (ratio < MAX_RANGE_RATIO))


def redetections(belief: Belief, candidates: Candidates, limits: GazeLimits) -> FloatArray:
    """(n, m) expected share of the horizon in which each landmark corrects the pose, by view.

    It counts from the arrival of the camera, where the landmark is in view, in range, and seen
    from a direction and a range similar to those of its first observation.
    """
    turn = np.abs(candidates.pan - belief.gaze.pan)
    arrival = limits.latency + turn / limits.rate
    arrival[turn < 1e-6] = 0.0
    total = np.zeros((len(candidates), len(belief.landmarks)))
    for k in range(SAMPLES):
        time = limits.horizon * (k + 1) / SAMPLES
        pose = belief.after(time)
        inside, r = visible(pose, belief.landmarks, candidates)
        similar = looks_alike(pose, belief.landmarks, belief.viewpoint) | belief.tracked
        similar &= (r > NEAR) & (r < limits.max_range)
        total += inside * similar * (arrival <= time)[:, None]
    return np.asarray(total / SAMPLES * belief.redetection)


def information(belief: Belief, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Expected decrease of the entropy of the pose, and of the map given the pose: (n,) nats each.

    Mutual information of the observations in each of n views and the pose,
    (log|S + R| - log|G + R|) / 2, and the map, (log|G + R| - log|R|) / 2: S is the covariance of
    the predictions, G that given the pose, and R has the noise of each landmark divided by its
    share (n, m) of the horizon, and the error that all share.
    """
    of_pose, of_map = np.zeros((2, len(share)))
    if share.shape[1] == 0:
        return of_pose, of_map
    r = np.hypot(*(belief.landmarks - belief.pose[:2]).T)
    S, G = belief.joint_innovation, belief.innovation_given_pose
    noise = np.stack([np.square(RANGE_SIGMA * r), np.full(len(r), BEARING_SIGMA**2)], 1)
    alone = 0.5 * np.log1p(share[:, :, None] * np.diag(S).reshape(-1, 2) / noise).sum(2)
    for i, each in enumerate(share):
        best = np.argsort(-alone[i], kind="stable")[:MAX_JOINT]
        best = best[each[best] > 0]
        if len(best) == 0:
            continue
        columns = (2 * best[:, None] + (0, 1)).ravel()
        R = np.diag((noise[best] / each[best, None]).ravel())
        shared = np.zeros((2, 2 * len(best)))
        shared[0, ::2], shared[1, 1::2] = SHARED_SIGMA[0] * r[best], SHARED_SIGMA[1]
        R += shared.T @ shared
        block = np.ix_(columns, columns)
        total, given, noise_only = (np.linalg.slogdet(M + R)[1] for M in (S[block], G[block], 0))
        of_pose[i], of_map[i] = (total - given) / 2, (given - noise_only) / 2
    return of_pose, of_map


def informative(
    belief: Belief, places: SalientPlaces, candidates: Candidates, limits: GazeLimits
) -> Gaze:
    """To the gaze with the greatest expected decrease of the entropy of the pose.

    Greedy over the candidates: by re-observed landmarks, and where the camera measures the motion
    by what the view tells of it, less the cost of the turn.
    """
    gain, _ = information(belief, redetections(belief, candidates, limits))
    terms = {"re-detect": gain}
    if belief.egomotion == "camera":
        terms["track"] = motion(belief, places, candidates, limits)
    return _choose(belief, candidates, terms)


def motion(
    belief: Belief, places: SalientPlaces, candidates: Candidates, limits: GazeLimits
) -> FloatArray:
    """(n,) expected information about the robot's motion over the horizon, in nats, at most 0.

    Of two dimensions: less the logarithm of the variance of a step, which falls with the number of
    points in view, of which salient places have `POINTS_PER_PLACE` each; is 1 + `SIDEWAYS` times as
    large in a view to the side, where an advance is hardly told from a turn; and `TURNING` times
    while the camera turns at its full rate.
    """
    pose = belief.after(limits.horizon / 2)
    seen, r = visible(pose, places.xy, candidates)
    in_sight = (r > NEAR) & looks_alike(pose, places.xy, places.viewpoint)
    points = POINTS_PER_PLACE * seen @ in_sight.astype(np.float64)
    turn, width = np.abs(candidates.pan - belief.gaze.pan), candidates.field_of_view[0]
    points = np.maximum(points, belief.points * (1 - turn / width))
    few = MANY_POINTS / points.clip(FEW_POINTS, MANY_POINTS)
    ahead, left, _ = belief.velocity
    across = np.sin(candidates.pan - np.arctan2(left, ahead)) * (np.hypot(ahead, left) > MIN_SPEED)
    turning = 1 + (TURNING - 1) * turn / limits.rate / limits.horizon
    return np.asarray(-np.log(few * (1 + SIDEWAYS * across**4) * turning))


def _choose(belief: Belief, candidates: Candidates, terms: dict[str, FloatArray]) -> Gaze:
    """The candidate with the greatest sum, and the term by which it exceeds the present gaze most.

    If it is the present gaze, by which it exceeds the mean of all.
    """
    i = int(np.argmax(np.sum(list(terms.values()), axis=0)))
    present = int(np.argmin(np.abs(candidates.pan - belief.gaze.pan)))
    lead = {
        name: float(value[i] - (value[present] if i != present else value.mean()))
        for name, value in terms.items()
    }
    chosen = {name: float(value[i]) for name, value in terms.items()}
    pan, tilt = float(candidates.pan[i]), float(candidates.tilt[i])
    return Gaze(pan, tilt, max(lead, key=lambda name: lead[name]), chosen)


POLICIES: dict[str, Callable[[int], Policy]] = {
    "fixed": lambda seed: fixed,
    "random": random_policy,
    "sweep": lambda seed: sweep,
    "salient": lambda seed: salient,
    "informative": lambda seed: informative,
}
"""Policies by name; each takes the seed of what it draws."""
