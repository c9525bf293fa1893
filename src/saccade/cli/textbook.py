"""`saccade textbook`: the equations of the source, their code, and what they make of one's data."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from saccade.cli.options import Json, Out

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from saccade.cli.textbook_source import Chapter
    from saccade.types import Float32Array, LandmarkLog
    from saccade.viewing.steps import Group, Step

TITLES = {
    "A": "A. The contrast-saliency model",
    "B": "B. The Scale-Invariant Feature Transform",
    "C": "C. EKF-SLAM",
}
LEAD = (
    "Each step with its equations, the lines of code that compute them, and what they make of "
    "{source}. The numbers are those of G. W. Kootstra, Visual attention and active vision: from "
    "natural to artificial systems (2010)."
)
Facts = dict[str, dict[str, str]]
"""What came of each step, by name."""


def textbook(
    source: Annotated[
        Path,
        typer.Argument(metavar="IMAGE|LOG", help="A photograph, or a log that names landmarks."),
    ],
    out: Out = Path("saccade-textbook"),
    modules: Annotated[
        list[Path] | None,
        typer.Option(
            "--module",
            metavar="FILE",
            help="A Python file whose contrast_saliency, sift or EkfSlam takes the place of the "
            "textbook's; may be given several times.",
        ),
    ] = None,
    longest: Annotated[
        int, typer.Option(min=32, help="Pixels of the longer side: a larger image is reduced.")
    ] = 480,
    as_json: Json = False,
) -> None:
    """Walk through the equations of the source with a photograph or a log.

    In --out appears a page (report.html) that shows each step of appendix A,
    B and C: the equation, the code that computes it, and the picture. Of a
    photograph these are the contrast-saliency model and SIFT, and EKF-SLAM
    in a small made world; of a log EKF-SLAM alone.

    To try an equation of your own, copy a file of saccade.textbook, change
    it, and name the copy with --module.
    """
    from saccade import datasets
    from saccade.cli.output import print_json, print_message, print_table, write_text
    from saccade.cli.textbook_source import OFFERS, Chapter, chapters_of
    from saccade.cli.textbook_steps import small_world
    from saccade.errors import ConfigError
    from saccade.files import IMAGE_SUFFIXES
    from saccade.viewing.steps import steps_page

    own = {each.appendix: each for path in modules or [] for each in chapters_of(path)}
    image, log, appendices = None, small_world(), "ABC"
    if source.suffix.lower() in IMAGE_SUFFIXES:
        image = read_reduced(source, longest)
    else:
        log, appendices = datasets.load("auto", source), "C"
    for appendix in own.keys() - {*appendices}:
        path, name = own[appendix].path, OFFERS[appendix][1]
        raise ConfigError(f"{path}: {name} needs an image, found the log {source}")
    groups: list[Group] = []
    facts: dict[str, Facts] = {}
    for appendix in appendices:
        chapter = own.get(appendix) or Chapter.of_textbook(appendix)
        if appendix in own:
            print_message(f"{OFFERS[appendix][1]} is that of {chapter.path}")
        group, facts[appendix] = walk(chapter, image, log)
        groups.append(group)
    page, lead = out / "report.html", LEAD.format(source=source.name)
    write_text(page, steps_page(f"saccade textbook: {source.name}", lead, groups))
    taken = {
        OFFERS[each][1]: str(own[each].path) if each in own else "saccade.textbook"
        for each in appendices
    }
    if as_json:
        print_json({"source": str(source), "report": str(page), "taken": taken, "facts": facts})
        return
    rows = [row for each in facts.values() for step in each.values() for row in step.items()]
    print_table(f"{source.name} -> {page}", ["", ""], rows)


def read_reduced(path: Path, longest: int) -> "Float32Array":
    """A photograph (H, W, 3) in [0, 1] whose longer side has at most so many pixels."""
    import cv2
    import numpy as np

    from saccade.image import read_image

    image = read_image(path)
    height, width = image.shape[:2]
    scale = longest / max(height, width)
    if scale >= 1:
        return image
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)


def walk(
    chapter: "Chapter", image: "Float32Array | None", log: "LandmarkLog"
) -> "tuple[Group, Facts]":
    """The steps of one appendix with their pictures, and what came of them.

    Args:
        chapter: the file that computes them.
        image: (H, W, 3) in [0, 1]; None does for appendix C.
        log: for appendix C.
    """
    from saccade.cli.textbook_source import OFFERS, Chapter, blamed_on
    from saccade.cli.textbook_steps import made_of
    from saccade.viewing.steps import Group, step_table

    appendix, name = chapter.appendix, OFFERS[chapter.appendix][1]
    textbook = Chapter.of_textbook(appendix)
    if chapter.path == textbook.path:
        figures, facts = made_of(appendix, chapter.offer, image, log)
        text = (
            f"Computed by `{textbook.path}`. To try an equation of your own, copy this file, "
            f"change it, and give the copy with `--module`: its `{name}` takes the place of this."
        )
        changes = ""
    else:
        with blamed_on(chapter.path):
            figures, facts = made_of(appendix, chapter.offer, image, log)
        _, usual = made_of(appendix, textbook.offer, image, log, draw=False)
        facts = {step: _beside(each, usual.get(step, {})) for step, each in facts.items()}
        text = f"Computed by `{chapter.path}` in place of the textbook. Its lines that differ:"
        changes = chapter.changes(textbook) or "none"
    if appendix == "C" and log.motion == "compose":
        text += (
            " The controls of this log drive before they turn: each is taken as two, (d, φ) of the "
            "way and of the rest of the turn, and what is uncertain sideways is left out."
        )
    steps = [
        _step(table, chapter, textbook, figures.get(table["name"]), facts.get(table["name"], {}))
        for table in step_table()
        if table["appendix"] == appendix
    ]
    return Group(TITLES[appendix], text, changes, steps), facts


def _beside(facts: dict[str, str], usual: dict[str, str]) -> dict[str, str]:
    """What came of a file, with that of the textbook where the two differ."""
    return {
        name: value if value == usual.get(name) else f"{value} (textbook: {usual.get(name)})"
        for name, value in facts.items()
    }


def _step(
    table: dict[str, Any],
    chapter: "Chapter",
    textbook: "Chapter",
    figure: "Figure | None",
    facts: dict[str, str],
) -> "Step":
    """A step of the page: its equations with their code, its picture, its facts."""
    from dataclasses import replace

    from saccade.viewing import Picture
    from saccade.viewing.steps import Equation, Step, figure_source

    equations = []
    for number, tex, *function in table["equations"]:
        code, usual = (each.code.get(*function or [number]) for each in (chapter, textbook))
        if code is not None and (usual is None or code.text != usual.text):
            code = replace(code, changed=True)
        equations.append(Equation(number, tex, code))
    picture = None
    if figure is not None:
        picture = Picture(figure_source(figure), table["alt"], table["caption"], wide=True)
    return Step(table["title"], table["text"], equations, picture, table.get("print", ""), facts)
