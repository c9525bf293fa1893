"""Make the pictures of the site: those of the examples, and those of the pages.

`python docs/making/pictures.py` makes the one that the README shows.
"""

import hashlib
import os
import runpy
import sys
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from io import StringIO
from multiprocessing import get_context
from pathlib import Path

from appendices import draw as draw_appendix
from figures import PAGES, story
from saccade.viewing import save_figure

ROOT = Path(__file__).parents[2]


def make_all(folder: Path) -> None:
    """Make what is not there, or all of it if code has changed since."""
    folder.mkdir(exist_ok=True)
    stamp = folder / "made-of.txt"
    state = _state()
    if not stamp.exists() or stamp.read_text() != state:
        examples = sorted((ROOT / "examples").glob("*.py"))
        with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
            made = [pool.submit(run_example, example, folder) for example in examples]
            made += [pool.submit(draw_page, name, folder) for name in PAGES]
            made += [pool.submit(draw_appendix, each, folder) for each in "ABC"]
        for each in made:
            each.result()
        stamp.write_text(state)


def run_example(example: Path, folder: Path) -> None:
    """Run it in the folder, and keep what it prints beside its picture."""
    here, said = Path.cwd(), StringIO()
    os.chdir(folder)
    try:
        with redirect_stdout(said):
            runpy.run_path(str(example), run_name="__main__")
    finally:
        os.chdir(here)
    (folder / f"{example.stem}.txt").write_text(said.getvalue(), encoding="utf-8")


def draw_page(name: str, folder: Path) -> None:
    """Draw a picture of the pages."""
    save_figure(PAGES[name](), folder / f"{name}.png")


def _state() -> str:
    made_of = hashlib.sha256(sys.version.encode())
    for place in ("src", "examples", "docs/making"):
        for source in sorted((ROOT / place).rglob("*.py")):
            made_of.update(source.read_bytes())
    return made_of.hexdigest()


if __name__ == "__main__":
    save_figure(story(), ROOT / "docs" / "story.jpg")
