"""Floor plans of simulated worlds beside the ring: walls, and the course of the robot."""

from typing import NamedTuple

import numpy as np

from saccade.slam.models import wrap
from saccade.types import FloatArray

ARM, HALF_WIDTH, LANE = 3.2, 1.1, 0.5
"""Of the crossing: metres from its middle to the end of each arm, half the width of a corridor, and
from the middle of a corridor to the robot's lane on its right."""
ROOM, GAP, DOOR = (3.9, 4.0), 0.1, 0.5
"""Of the rooms: metres along and across each, half the thickness of the wall between them, and
half the width of its door."""
RADIUS = 0.45
"""Of the turns, in metres."""


def _crossing() -> FloatArray:
    a, w = ARM, HALF_WIDTH
    quarter = np.array([[-w, a], [w, a], [w, w]])
    turns = [np.array([[0, 1], [-1, 0]])] * 3
    corners = [quarter]
    for turn in turns:
        corners.append(corners[-1] @ turn.T)
    return np.concatenate([*corners, quarter[:1]])


def _rooms() -> FloatArray:
    (along, across), x, d = ROOM, GAP, DOOR
    left, right, y = -x - along, x + along, across / 2
    upper = [[left, y], [-x, y], [-x, d], [x, d], [x, y], [right, y]]
    lower = [[right, -y], [x, -y], [x, -d], [-x, -d], [-x, -y], [left, -y]]
    return np.array([*upper, *lower, [left, y]])


OUTLINES: dict[str, list[FloatArray]] = {"crossing": [_crossing()], "rooms": [_rooms()]}
"""Closed polylines (k, 2) of the walls in metres, visible from their right."""


def _lanes() -> FloatArray:
    o, end = LANE, ARM - 0.7
    west, north = [[-end, o], [-end, -o], [o, -o]], [[o, end], [-o, end]]
    south, east = [[-o, -end], [o, -end], [o, -o]], [[end, -o], [end, o]]
    return np.array([[0.0, o], *west, *north, *south, *east, [0.0, o]])


def _tour() -> FloatArray:
    near, far, y = 1.0, 3.1, 1.1
    a = [[-far, 0.0], [-far, -y], [-near, -y], [-near, 0], [near, 0], [near, -y], [far, -y]]
    return np.array([*a, [far, y], [near, y], [near, 0], [-near, 0], [-near, y], [-far, y], a[0]])


COURSES = {"crossing": _lanes(), "rooms": _tour()}
"""Closed polylines (k, 2) that the robot follows, with rounded corners. It drives into each arm of
the crossing and back; or around one room, through the door, around the other, and back."""


class Piece(NamedTuple):
    """A straight piece or an arc of a course."""

    pose: FloatArray
    """(3,) at its beginning."""
    length: float
    """Metres."""
    curvature: float
    """1 / metres, positive to the left."""


def planned_course(world: str, frames: int, frames_per_lap: int) -> FloatArray:
    """Poses (frames, 3) along the course of a world, at constant speed."""
    pieces = rounded(COURSES[world], RADIUS)
    end = np.cumsum([piece.length for piece in pieces])
    poses = []
    for s in np.arange(frames) * end[-1] / frames_per_lap % end[-1]:
        i = int(np.searchsorted(end, s, side="right"))
        piece = pieces[min(i, len(pieces) - 1)]
        length = s - (end[i] - piece.length)
        turn = piece.curvature * length
        chord, heading = length * np.sinc(turn / (2 * np.pi)), piece.pose[2]
        ahead = chord * np.array([np.cos(heading + turn / 2), np.sin(heading + turn / 2)])
        poses.append([*(piece.pose[:2] + ahead), wrap(heading + turn)])
    return np.array(poses)


def rounded(corners: FloatArray, radius: float) -> list[Piece]:
    """Pieces along a polyline (k, 2) whose inner corners are replaced by arcs."""
    steps = np.diff(corners, axis=0)
    length = np.hypot(*steps.T)
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    turn = wrap(np.diff(heading))
    cut = np.concatenate([[0.0], radius * np.tan(np.abs(turn) / 2), [0.0]])  # from each corner
    pieces = []
    for i, (start, direction) in enumerate(zip(corners, heading.tolist(), strict=False)):
        axis = np.array([np.cos(direction), np.sin(direction)])
        straight = float(length[i] - cut[i] - cut[i + 1])
        pieces.append(Piece(np.array([*(start + cut[i] * axis), direction]), straight, 0.0))
        if i < len(turn):
            begin = np.array([*(start + (length[i] - cut[i + 1]) * axis), direction])
            arc = float(abs(turn[i]))
            if arc > 0:
                pieces.append(Piece(begin, radius * arc, float(np.sign(turn[i])) / radius))
    return pieces
