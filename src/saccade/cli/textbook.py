"""`saccade textbook`: the equations of the source beside their code, run on your own data."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

from cyclopts import Parameter

from saccade.cli.options import JsonOptions, OutputFolder
from saccade.cli.output import Result, Table, write_text
from saccade.errors import setting
from saccade.io.files import IMAGE_SUFFIXES

if TYPE_CHECKING:
    from saccade.types import Float32Array, Image

LEAD = (
    "Each step with its equations, the code that computes them, and the results for "
    "{source}. Equation numbers follow G. W. Kootstra, Visual attention and active vision: from "
    "natural to artificial systems (2010)."
)


@dataclass(frozen=True, kw_only=True)
class TextbookOptions(JsonOptions):
    """Options of `saccade textbook`."""

    out: OutputFolder = Path("saccade-textbook")
    scan: int | None = setting(None, 1)
    """Last of the eight scans of the log whose steps are shown, by default the eighth."""
    changes: Annotated[list[str] | None, Parameter("--set", metavar="NAME=VALUE")] = None
    """Change a parameter of the equations, such as contrast.delta=2,3 or sift.tau_c=0.01; any other
    text lists them all."""
    max_side: Annotated[int, Parameter(metavar="PX")] = setting(480, 32)
    """Maximum longer side, at least 32; larger images are reduced."""


Source: TypeAlias = Annotated[Path, Parameter(help="A photograph, or a log with landmark labels.")]


def textbook(source: Source, /, options: TextbookOptions = TextbookOptions()) -> Result:
    """Walk through the equations of the source with a photograph or a log.

    Writes a page (report.html) that shows each step of appendices A, B and C:
    the equation, the code that computes it, and a figure. A photograph gives the
    contrast-saliency model, SIFT, and EKF-SLAM in a small simulated world; a log
    gives EKF-SLAM alone. A menu on the page chooses the step of the filter whose
    matrices are shown.

    Example: saccade textbook photo.jpg
    """
    from saccade import datasets
    from saccade.io.image import read_image
    from saccade.viewing.page import shrunk
    from saccade.viewing.textbook.ekf import simulated_log
    from saccade.viewing.textbook.walkthrough import Walkthrough, walkthrough_page

    image, log, appendices = None, simulated_log(), "ABC"
    if source.suffix.lower() in IMAGE_SUFFIXES:
        photo = read_image(source)
        image = shrunk(photo, options.max_side / max(photo.shape))
    else:
        log, appendices = datasets.load("auto", source), "C"
    walkthrough = Walkthrough(log, image, _default_saliency, options.scan, options.changes or ())
    sections, results = {}, {}
    for appendix in appendices:
        sections[appendix], results[appendix] = walkthrough.section(appendix)
    page, lead = options.out / "report.html", LEAD.format(source=source.name)
    write_text(page, walkthrough_page(f"saccade textbook: {source.name}", lead, sections))
    row = {"source": str(source), "report": str(page), "results": results}
    rows = [row for steps in results.values() for step in steps.values() for row in step.items()]
    return Result(row, [Table(f"{source.name} -> {page}", ["", ""], rows)])


def _default_saliency(image: "Image") -> "Float32Array":
    from saccade.attention.contrast import contrast_saliency

    return contrast_saliency(image).saliency
