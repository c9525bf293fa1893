"""Build the documentation into site/: `uv run --group docs docs/making/build.py`."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile

from pictures import make_all

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Draw the figures if the code has changed, build, and add the font of the formulas."""
    make_all(ROOT / "docs" / "pictures")
    path = os.pathsep.join(sys.path)  # of the Markdown extension `generated`
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean"]
    built = subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": path}, check=False)
    if built.returncode != 0:
        sys.exit(built.returncode)
    (package,) = find_spec("ziamath").submodule_search_locations
    font = Path(package) / "fonts" / "STIXTwoMath-Regular.ttf"  # under the SIL license
    copyfile(font, ROOT / "site" / "assets" / "STIXTwoMath.ttf")


if __name__ == "__main__":
    main()
