"""`saccade textbook`: the equations of the source beside their code, run on one's own data."""

from pathlib import Path
from typing import Annotated

import typer

from saccade import datasets
from saccade.cli.options import Json, Out
from saccade.cli.output import Table, emit, print_message, write_text
from saccade.errors import ConfigError
from saccade.io.files import IMAGE_SUFFIXES
from saccade.io.image import read_image
from saccade.viewing.page import shrunk
from saccade.viewing.textbook import (
    Implementation,
    load_implementations,
    simulated_log,
    walk_through,
    walkthrough_page,
)

LEAD = (
    "Each step with its equations, the lines of code that compute them, and their results for "
    "{source}. The numbers are those of G. W. Kootstra, Visual attention and active vision: from "
    "natural to artificial systems (2010)."
)


def textbook(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IMAGE|LOG", help="A photograph, or a log with landmark identities."
        ),
    ],
    out: Out = Path("saccade-textbook"),
    modules: Annotated[
        list[Path] | None,
        typer.Option(
            "--module",
            metavar="FILE",
            help="A Python file whose contrast_saliency, sift or EkfSlam replaces the "
            "textbook's; may be given several times.",
        ),
    ] = None,
    max_side: Annotated[
        int, typer.Option(min=32, help="Pixels of the longer side: a larger image is reduced.")
    ] = 480,
    as_json: Json = False,
) -> None:
    """Walk through the equations of the source with a photograph or a log.

    In --out appears a page (report.html) that shows each step of appendix A,
    B and C: the equation, the code that computes it, and a figure. With a
    photograph these are the contrast-saliency model and SIFT, and EKF-SLAM
    in a small simulated world; with a log EKF-SLAM alone.

    To try an equation of your own, copy a file of saccade.textbook, change
    it, and name the copy with --module.
    """
    replacements = {
        each.appendix: each for path in modules or [] for each in load_implementations(path)
    }
    image, log, appendices = None, simulated_log(), "ABC"
    if source.suffix.lower() in IMAGE_SUFFIXES:
        photo = read_image(source)
        image = shrunk(photo, max_side / max(photo.shape))
    else:
        log, appendices = datasets.load("auto", source), "C"
    for appendix, each in replacements.items():
        if appendix not in appendices:
            raise ConfigError(f"{each.path}: {each.name} needs an image, found the log {source}")
        print_message(f"{each.name} is that of {each.path}")
    walkthroughs = [
        walk_through(replacements.get(each) or Implementation.of_textbook(each), image, log)
        for each in appendices
    ]
    page, lead = out / "report.html", LEAD.format(source=source.name)
    write_text(page, walkthrough_page(f"saccade textbook: {source.name}", lead, walkthroughs))
    row = {
        "source": str(source),
        "report": str(page),
        "implementations": {
            each.implementation.name: str(each.implementation.path)
            if each.implementation.appendix in replacements
            else "saccade.textbook"
            for each in walkthroughs
        },
        "results": {each.implementation.appendix: each.results for each in walkthroughs},
    }
    rows = [row for each in walkthroughs for step in each.results.values() for row in step.items()]
    emit(row, as_json, Table(f"{source.name} -> {page}", ["", ""], rows))
