"""Exports of eye trackers as their manuals describe them hold the fixations that were written."""

import cv2
import numpy as np
import pytest

from saccade.datasets.fixations import read_fixations
from saccade.datasets.fixations.formats import FORMATS

XY = np.random.default_rng(0).uniform((20, 20), (780, 580), (2, 6, 2)).round(1)
NAMES = ("a.png", "b.png")


def fixations():
    return [(m, n, k, *XY[m, k]) for m, n in enumerate(NAMES) for k in range(6)]


def gazepoint():
    """All samples; the last of each fixation is invalid."""
    yield "MEDIA_ID,MEDIA_NAME,CNT,FPOGX,FPOGY,FPOGS,FPOGD,FPOGID,FPOGV"
    for m, n, k, x, y in fixations():
        for s in range(4):
            at = f"{(x + 0.5) / 800:.6f},{(y + 0.5) / 600:.6f},{k}"
            yield f"{m},{n},{s},{at},{0.06 * s + 0.08:.3f},{6 * m + k},{int(s < 3)}"


def begaze():
    yield (
        "Trial\tStimulus\tParticipant\tCategory\tEye L/R\tIndex\tEvent Start Trial Time [ms]\t"
        "Event Duration [ms]\tFixation Position X [px]\tFixation Position Y [px]"
    )
    for m, n, k, x, y in fixations():
        row = f"{m}\t{n}\tP1\t{{}}\tRight\t{k + 1}\t{300 * k}\t200\t{{}}\t{{}}"
        yield row.format("Visual Intake", x, y)
        yield row.format("Saccade", "-", "-")


def events():
    """The headers of all tables come before the events."""
    yield "[iView]"
    yield "Subject:\tP1"
    for name, columns in (("Fixations", "Location X\tLocation Y"), ("Saccades", "Start Loc.X")):
        yield f"Table Header for {name}:"
        yield f"Event Type\tTrial\tNumber\tStart\tEnd\tDuration\t{columns}"
    for m, n, k, x, y in fixations():
        start = 9_000_000 * m + 300_000 * k
        if k == 0:
            yield f"UserEvent\t{m}\t1\t{start}\t# Message: {n}"
        yield f"Fixation R\t{m}\t{k}\t{start}\t{start + 200_000}\t200000\t{x}\t{y}"
        yield f"Saccade R\t{m}\t{k}\t{start}\t{start + 9}\t9\t{x}"


@pytest.mark.parametrize("export", [gazepoint, begaze, events], ids=lambda each: each.__name__)
def test_an_export_has_its_fixations(export, tmp_path):
    for name in NAMES:
        cv2.imwrite(str(tmp_path / name), np.zeros((600, 800), np.uint8))
    path = tmp_path / "P1.txt"
    path.write_text("\n".join(export()) + "\n")
    found = read_fixations(path, tmp_path, say=str)
    np.testing.assert_allclose(found.xy, XY.reshape(-1, 2), atol=1e-3)
    np.testing.assert_allclose(found.duration, 0.2, atol=1e-6)
    assert {*found.name.tolist()} == {"P1"}
    assert found.index.tolist() == [*range(6)] * 2


def test_the_help_has_every_format(run):
    _, out, _ = run("evaluate", "fixations", "--help")
    shown = " ".join(out.replace("\u2502", " ").split())
    assert all(row.summary in shown for row in FORMATS.values())
