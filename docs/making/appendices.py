"""The walk of the page "Through the appendices": its pictures, and its steps as Markdown."""

from importlib.resources import as_file, files
from pathlib import Path

import saccade
from saccade.cli.textbook_source import Chapter
from saccade.cli.textbook_steps import made_of, small_world
from saccade.viewing.steps import Equation, equations_html, save_step, step_table

PHOTO = "coffee.jpg"


def draw(appendix: str, folder: Path) -> None:
    """Draw the pictures of the steps of an appendix."""
    with as_file(files("saccade") / "data" / PHOTO) as path:
        image = saccade.read_image(path)
    figures, _ = made_of(appendix, Chapter.of_textbook(appendix).offer, image, small_world())
    for name, figure in figures.items():
        save_step(figure, folder / f"appendix-{name}.webp")


def steps_markdown(appendix: str) -> str:
    """The steps of an appendix, with the code as it stands in the textbook now."""
    code = Chapter.of_textbook(appendix).code
    parts = []
    for step in (each for each in step_table() if each["appendix"] == appendix):
        equations = [
            Equation(number, tex, code.get(*function or [number]))
            for number, tex, *function in step["equations"]
        ]
        picture = f"![{step['alt']}](pictures/appendix-{step['name']}.webp){{ .wide }}"
        parts += [f"### {step['title']}", step["text"], equations_html(equations), picture]
        parts.append(f"*{step['caption']}*")
        if "print" in step:
            parts.append(f'!!! info "Where the default differs"\n    {step["print"]}')
    return "\n\n".join(parts)
