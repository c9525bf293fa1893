"""Write the formulas of the steps as MathML: `python docs/making/formulas.py`.

`saccade textbook` shows them, and LaTeX is nothing that it could read.
"""

import json
from importlib.resources import files
from pathlib import Path

from latex2mathml.converter import convert

from saccade.viewing.steps import step_table

FORMULAS = Path(str(files("saccade.viewing") / "web" / "formulas.json"))


def formulas_json() -> str:
    """Every formula of the steps by its TeX."""
    formulas = [equation[1] for step in step_table() for equation in step["equations"]]
    table = {tex: convert(tex).replace(' display="inline"', "") for tex in formulas}
    return json.dumps(table, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    FORMULAS.write_text(formulas_json(), encoding="utf-8")
