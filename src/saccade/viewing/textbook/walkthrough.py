"""Runs an implementation of an appendix on data: figures and results of its steps."""

from collections.abc import Mapping
from dataclasses import dataclass

from matplotlib.figure import Figure

from saccade.types import Image, LandmarkLog
from saccade.viewing.textbook.contrast import contrast_figures, contrast_results
from saccade.viewing.textbook.ekf import filter_figures, filter_results
from saccade.viewing.textbook.ekf_trace import trace_filter
from saccade.viewing.textbook.implementation import Implementation, errors_located_in
from saccade.viewing.textbook.sift import sift_figures, sift_results

Figures = dict[str, Figure]
"""By step."""
Results = dict[str, dict[str, str]]
"""By step and name."""


@dataclass(frozen=True)
class Walkthrough:
    """One appendix, run on data."""

    implementation: Implementation
    text: str
    """Which file computed it."""
    diff: str
    """How that file differs from the textbook's; empty for the textbook's own."""
    figures: Mapping[str, Figure]
    """By step."""
    results: Results


def walk_through(
    implementation: Implementation, image: Image | None, log: LandmarkLog
) -> Walkthrough:
    """Run an implementation, and compare its results with the textbook's.

    Args:
        implementation: of one appendix.
        image: (H, W, 3) in [0, 1]; not needed for appendix C.
        log: for appendix C.

    Raises:
        ConfigError: a file of the user failed.
        LogError: the log has no landmark identities, or another motion model.
    """
    textbook, path = Implementation.of_textbook(implementation.appendix), implementation.path
    if path == textbook.path:
        figures, results = run_appendix(implementation, image, log)
        text = (
            f"Computed by `{path}`. To try an equation of your own, copy this file, change it, "
            f"and give the copy with `--module`: its `{implementation.name}` takes the place of "
            "this."
        )
        diff = ""
    else:
        with errors_located_in(path):
            figures, results = run_appendix(implementation, image, log)
        _, expected = run_appendix(textbook, image, log, draw=False)
        results = {step: _compared(each, expected.get(step, {})) for step, each in results.items()}
        text = f"Computed by `{path}` in place of the textbook. Its lines that differ:"
        diff = implementation.diff(textbook) or "none"
    if implementation.appendix == "C" and log.motion == "compose":
        text += (
            " The controls of this log translate before they turn: each becomes two, (d, φ) of the "
            "translation and of the remaining turn, without the lateral uncertainty."
        )
    return Walkthrough(implementation, text, diff, figures, results)


def run_appendix(
    implementation: Implementation, image: Image | None, log: LandmarkLog, *, draw: bool = True
) -> tuple[Figures, Results]:
    """The figures and the results of the steps of an appendix.

    Args:
        implementation: of one appendix.
        image: (H, W, 3) in [0, 1]; not needed for appendix C.
        log: for appendix C.
        draw: whether to make the figures.
    """
    if implementation.appendix == "C":
        trace = trace_filter(log, implementation.entry_point)
        return filter_figures(trace) if draw else {}, filter_results(trace)
    assert image is not None
    result = implementation.entry_point(image)
    if implementation.appendix == "A":
        return contrast_figures(image, result) if draw else {}, contrast_results(result)
    return sift_figures(image, result) if draw else {}, sift_results(result)


def _compared(results: dict[str, str], expected: Mapping[str, str]) -> dict[str, str]:
    """Results of a file, with those of the textbook where the two differ."""
    return {
        name: value if value == expected.get(name) else f"{value} (textbook: {expected.get(name)})"
        for name, value in results.items()
    }
