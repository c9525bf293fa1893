"""Draw the figures of the documentation: of the examples, the pages and the appendices.

`python docs/making/pictures.py` makes the film of the README.
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
from figures import PAGES
from gaze_film import write_film
from saccade.viewing import save_figure

ROOT = Path(__file__).parents[2]
WITHOUT_PICTURE = "tensors"
"""Example that needs PyTorch, and that no page shows."""


def make_all(folder: Path) -> None:
    """Draw all figures, unless no code has changed since they were drawn."""
    folder.mkdir(exist_ok=True)
    hash_file = folder / "source-hash.txt"
    digest = _source_hash()
    if not hash_file.exists() or hash_file.read_text() != digest:
        examples = sorted(
            each for each in (ROOT / "examples").glob("*.py") if each.stem != WITHOUT_PICTURE
        )
        with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
            drawn = [pool.submit(run_example, example, folder) for example in examples]
            drawn += [pool.submit(draw_page, name, folder) for name in PAGES]
            drawn += [pool.submit(draw_appendix, each, folder) for each in "ABC"]
        for each in drawn:
            each.result()
        hash_file.write_text(digest)


def run_example(example: Path, folder: Path) -> None:
    """Run an example in the folder, and save its output next to its figure."""
    previous, output = Path.cwd(), StringIO()
    os.chdir(folder)
    try:
        with redirect_stdout(output):
            runpy.run_path(str(example), run_name="__main__")
    finally:
        os.chdir(previous)
    (folder / f"{example.stem}.txt").write_text(output.getvalue(), encoding="utf-8")


def draw_page(name: str, folder: Path) -> None:
    """Draw a figure of a page."""
    save_figure(PAGES[name](), folder / f"{name}.png")


def _source_hash() -> str:
    digest = hashlib.sha256(sys.version.encode())
    for folder in ("src", "examples", "docs/making"):
        for source in sorted((ROOT / folder).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


if __name__ == "__main__":
    write_film(ROOT / "docs" / "gaze.webp")
