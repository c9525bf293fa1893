"""Association of observations without a range or without a bearing."""

import numpy as np

from saccade.slam.association.nearest_neighbor import Gates, associate_by_geometry, compare
from saccade.slam.association.outcomes import UNUSED
from saccade.slam.config import EkfConfig
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.landmarks import LandmarkTable
from saccade.slam.scans import Scan
from saccade.types import BoolArray, IntArray


def associate_partial(
    config: EkfConfig, ekf: EkfSlam, table: LandmarkTable, scan: Scan, taken: IntArray
) -> tuple[IntArray, BoolArray]:
    """Associates the partial observations of a scan with landmarks of the map.

    An observation is of the landmark of its label, if it is inside the gate of that landmark;
    without a label, of the landmark that the rule pairs it with. Gates have one degree of freedom.

    Args:
        config: the gates.
        ekf: the filter, predicted to the pose of the scan.
        table: its landmarks.
        scan: with k partial observations and no others.
        taken: (n,) ids of the landmarks of the other observations.

    Returns:
        (k,) the id of the landmark or `UNUSED`, and (k,) whether a label was rejected.
    """
    matches = table.landmarks_of(scan.labels)
    known = matches >= 0
    rejected = np.zeros(len(known), np.bool_)
    if not config.rule.accepts_all:
        nis, _ = compare(ekf, scan.z, scan.R, matches)
        rejected = known & ~(nis <= chi_square_gate(1, config.label_gate))
        gate, new_gate = (chi_square_gate(1, p) for p in (config.gate, config.new_gate))
        gates = Gates(gate, new_gate, config.rule.pairing)
        rest = np.array([label is None for label in scan.labels])
        confirmed = table.counts.confirmed[table.rows(ekf.active_ids)]
        used = np.append(taken, matches[known & ~rejected])
        matches[rest] = associate_by_geometry(
            ekf, scan.z[rest], scan.R[rest], gates, used, confirmed
        )
    return np.where((matches < 0) | rejected, UNUSED, matches), rejected
