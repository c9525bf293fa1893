"""Walkthrough of the textbook: each equation beside its code, with figures of one's own data."""

from saccade.viewing.textbook.ekf import simulated_log
from saccade.viewing.textbook.walkthrough import (
    ENTRY_POINTS,
    Implementation,
    equations_html,
    load_implementations,
    load_steps,
    run_appendix,
    save_webp,
    walk_through,
    walkthrough_page,
)

__all__ = [
    "ENTRY_POINTS",
    "Implementation",
    "equations_html",
    "load_implementations",
    "load_steps",
    "run_appendix",
    "save_webp",
    "simulated_log",
    "walk_through",
    "walkthrough_page",
]
