"""Figures and Markdown of the page "Appendices A to C"."""

from importlib.resources import as_file, files
from pathlib import Path

import saccade
from saccade.viewing.textbook.ekf import simulated_log
from saccade.viewing.textbook.walkthrough import Walkthrough, equations_html, load_steps, save_webp

PHOTO = "coffee.jpg"


def draw(appendix: str, folder: Path) -> None:
    """Draw the figures of an appendix."""
    with as_file(files("saccade") / "data" / PHOTO) as path:
        image = saccade.read_image(path)
    figures, _ = Walkthrough(simulated_log(), image, _default_saliency).run(appendix)
    for name, figure in figures.items():
        save_webp(figure, folder / f"appendix-{name}.webp")


def steps_markdown(appendix: str) -> str:
    """The steps of an appendix as Markdown, with the current code of the textbook."""
    code = Walkthrough(simulated_log()).code(appendix)
    parts = []
    for step in load_steps(appendix):
        parts += [f"### {step['title']}", step["text"]]
        if step["equations"]:
            parts.append(equations_html(step["equations"], code))
        if "alt" in step:
            picture = f"![{step['alt']}](pictures/appendix-{step['name']}.webp){{ .wide }}"
            parts += [picture, f"*{step['caption']}*"]
        if "default" in step:
            parts.append(f'!!! info "Where the default differs"\n    {step["default"]}')
    return "\n\n".join(parts)


def _default_saliency(image: saccade.types.Image) -> saccade.types.Float32Array:
    return saccade.contrast_saliency(image).saliency
