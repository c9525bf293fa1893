"""Write the formulas of the appendices as MathML: `python docs/making/formulas.py`.

`saccade textbook` shows them and cannot convert TeX itself.
"""

import json
from importlib.resources import files
from pathlib import Path

from latex2mathml.converter import convert

from saccade.viewing.textbook.walkthrough import (
    load_steps,
)

FORMULAS = Path(str(files("saccade.viewing") / "web" / "formulas.json"))


def formulas_json() -> str:
    """MathML of every formula, by its TeX."""
    formulas = [
        equation[1] for each in "ABC" for step in load_steps(each) for equation in step["equations"]
    ]
    table = {tex: mathml_of(tex) for tex in formulas}
    return json.dumps(table, indent=1, ensure_ascii=False) + "\n"


def mathml_of(tex: str) -> str:
    """MathML with fractions at full size, and matrix brackets drawn by the style sheet.

    Without a mathematical font, browsers do not stretch brackets.
    """
    mathml = convert(tex).replace(' display="inline"', ' displaystyle="true"')
    mathml = mathml.replace("<mo>&#x00028;</mo><mtable>", '<mtable class="matrix">')
    return mathml.replace("</mtable><mo>&#x00029;</mo>", "</mtable>")


if __name__ == "__main__":
    FORMULAS.write_text(formulas_json(), encoding="utf-8")
