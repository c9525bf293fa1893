"""Compiling the filter in two halves, so that two processes can share the work."""

from collections.abc import Callable
from typing import Any

from saccade._jit import compile_for
from saccade.slam._recovery_kernels import leaves_out
from saccade.slam._step_kernels import bind_steps, known_landmarks
from saccade.slam.association._name_kernels import associate_named
from saccade.slam.filter._range_bearing_kernels import (
    predict_by_control,
    update_scan,
    write_pose,
)
from saccade.slam.map_management._kernels import check_visibility
from saccade.slam.online import Slam
from saccade.slam.scan_memory import new_steps
from saccade.slam.strides import new_results, new_stride


def compile_half(half: int) -> None:
    """Compile the larger parts of a step with the models of this package: half 0, or half 1.

    What is in the cache is left alone. `slam.run` compiles the rest: what calls the parts.
    """
    for part, arguments in _parts()[half]:
        compile_for(part, *arguments)


def _parts() -> tuple[list[tuple[Callable[..., Any], tuple[Any, ...]]], ...]:
    """The kernels of each half, with arguments as `_take_step` has them."""
    slam, s, out = Slam(), new_steps(1, 1, 2, 0), new_results(1, 1)
    f, w, names = slam.ekf.filter_state, slam.ekf.scratch, slam.names
    stride = new_stride(
        slam.associate, slam.culling.rule, slam.recovery.rule, adds=True, submaps=False
    )
    rules, visibility, evidence = stride.rules, slam.culling.counts, slam.recovery.evidence
    gates, confirmed, z, R = rules.gates, visibility.confirmed, s.z, s.R
    by_name = f, w, names, rules.names, gates, confirmed, z, R, s.name, s.landmark, s.refused
    return [
        (associate_named, by_name),
        (predict_by_control, (f, w, s.control[0], s.U[0], s.bias_jacobian[0])),
        (known_landmarks, (s, rules, names, 0, 1)),
        (check_visibility, (visibility, rules.culling, True, 0, 1, s.landmark)),
        (write_pose, (f, w, out.pose[0], out.covariance[0])),
    ], [
        (update_scan, (f, w, z, R, s.landmark, 0, 1, out.innovations)),
        (leaves_out, (f, evidence, rules.lost, z, R, confirmed, s.landmark)),
        (bind_steps, (f, w, s, rules, names, visibility, evidence, out)),
    ]
