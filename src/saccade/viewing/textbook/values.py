"""The matrices of a filter's steps as tables, of which the reader chooses one."""

from collections.abc import Sequence
from typing import NamedTuple

from saccade.textbook.ekf_slam import Augmentation, Prediction
from saccade.types import FloatArray
from saccade.viewing.page import escape
from saccade.viewing.textbook.ekf import Transition

MAX_STATE = 13
"""Maximum number of state elements shown: the pose and five landmarks."""
ROUNDING = 1e-14
"""Maximum magnitude of a rounding error."""
REDUCED = "<p>Rows and columns of the other landmarks are left out; those of H are 0.</p>"
"""Remark on matrices of large maps."""
POSE = ("x", "y", "θ")
POSITION = ("x", "y")
CONTROL = ("d", "φ")
OBSERVATION = ("r", "b")
SINGLE = ("",)


class Matrix(NamedTuple):
    """A matrix with the names of its rows and columns, in meters and radians."""

    symbol: str
    """Symbol as HTML."""
    equation: str
    """Number of the equation."""
    values: FloatArray
    """(r, c)."""
    rows: Sequence[str]
    """Names of the r rows."""
    columns: Sequence[str]
    """Names of the c columns."""


def chooser_html(name: str, steps: Sequence[Transition], drawn: Transition) -> str:
    """A menu of steps with their matrices; without scripts all steps are shown.

    Args:
        name: "predict", "update" or "augment".
        steps: all steps of this kind.
        drawn: the step in the figure, which the menu selects first.
    """
    parts, options, count = [], [], dict[int, int]()
    for number, step in enumerate(steps):
        count[step.scan] = count.get(step.scan, 0) + 1
        what = f"motion {count[step.scan]}" if step.landmark is None else f"m{step.landmark + 1}"
        title, chosen = f"scan {step.scan}, {what}", step is drawn
        title += ", the step of the figure" if chosen else ""
        options.append(f'<option value="{number}"{" selected" * chosen}>{title}</option>')
        tables = "".join(_table_html(each) for each in _matrices(step))
        hidden = len(step.after.s) > MAX_STATE and name == "update"
        parts.append(
            f'<section class="values" tabindex="0" aria-label="{title}" data-step="{number}">'
            f"<h4>{title}</h4>{tables}{REDUCED if hidden else ''}</section>"
        )
    menu = f"<label hidden>Values of <select>{''.join(options)}</select></label>"
    return f'<div class="chooser" data-kind="{name}">{menu}\n{"".join(parts)}</div>'


def _matrices(step: Transition) -> list[Matrix]:
    """The intermediate results of a step, in the order of its equations."""
    result, symbol = step.result, "" if step.landmark is None else f"m{step.landmark + 1}"
    if isinstance(result, Prediction):
        return [
            Matrix("Q", "C.7", result.Q, POSE, POSE),
            Matrix("F<sub>x</sub>", "C.8", result.Fx, POSE, POSE),
            Matrix("F<sub>u</sub>", "C.9", result.Fu, POSE, CONTROL),
        ]
    if isinstance(result, Augmentation):
        return [
            Matrix(symbol, "C.15", result.landmark[:, None], POSITION, SINGLE),
            Matrix(f"covariance of {symbol}", "C.17", result.Pmm_new, POSITION, POSITION),
            Matrix("G<sub>x</sub>", "C.18", result.Gx, POSITION, POSE),
            Matrix("G<sub>z</sub>", "C.18", result.Gz, POSITION, OBSERVATION),
        ]
    shown = _shown(step)
    names = [POSE[i] if i < 3 else f"m{(i - 1) // 2} {POSITION[(i - 3) % 2]}" for i in shown]
    return [
        Matrix("z - h", "C.10", result.innovation[:, None], OBSERVATION, SINGLE),
        Matrix("S", "C.12", result.S, OBSERVATION, OBSERVATION),
        Matrix("W", "C.13", result.W[shown], names, OBSERVATION),
        Matrix("H", "C.14", result.H[:, shown], OBSERVATION, names),
    ]


def _shown(step: Transition) -> list[int]:
    """State elements to show: all of a small map, else the pose and the observed landmark."""
    size = len(step.after.s)
    if size <= MAX_STATE or step.landmark is None:
        return list(range(size))
    return [0, 1, 2, 3 + 2 * step.landmark, 4 + 2 * step.landmark]


def _table_html(matrix: Matrix) -> str:
    heads = "".join(f'<th scope="col">{escape(name)}</th>' for name in matrix.columns)
    rows = "".join(
        f'<tr><th scope="row">{escape(name)}</th>'
        + "".join(f"<td>{_number(each)}</td>" for each in row)
        + "</tr>"
        for name, row in zip(matrix.rows, matrix.values, strict=True)
    )
    head = f"<thead><tr><td></td>{heads}</tr></thead>" if any(matrix.columns) else ""
    caption = f"<caption>{matrix.symbol} <small>{matrix.equation}</small></caption>"
    return f'<table class="numbers">{caption}{head}<tbody>{rows}</tbody></table>'


def _number(value: float) -> str:
    """Four significant digits; rounding errors are 0."""
    return f"{value:.4g}" if abs(value) > ROUNDING else "0"
