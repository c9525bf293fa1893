"""The pages of the documentation, as the tests read them."""

import re
import shlex
from pathlib import Path

from support.paths import ROOT

PAGES = sorted((ROOT / "docs").rglob("*.md"))


def anchors_of(page: Path) -> set[str]:
    """What a link into the page may name: its headings, as MkDocs and GitHub spell them."""
    headings = re.findall(r"^#+ (.+)$", prose_of(page), re.MULTILINE)
    words = (re.sub(r"[^\w\s-]", "", heading.replace("`", "")) for heading in headings)
    return {re.sub(r"[\s-]+", "-", each.strip().lower()) for each in words}


def prose_of(page: Path) -> str:
    """The page without its code."""
    return re.sub(
        r"^( *)```.*?^\1```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.M
    )


def code_of(text: str) -> list[str]:
    """The Python of a page or a section, block by block."""
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def commands_of(text: str) -> list[list[str]]:
    """The words of each `saccade` command in the shell blocks of a page."""
    blocks = re.findall(r"^```(\w*).*?\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    shell = "".join(block for language, block in blocks if language in ("", "bash", "sh"))
    indented = "".join(re.findall(r"^ {4}.*\n", text, re.MULTILINE))
    lines = map(str.strip, (shell + indented).replace("\\\n", " ").splitlines())
    words = (shlex.split(line, comments=True) for line in lines if line.startswith("saccade "))
    return [each for each in words if not {"|", ">", "&&"} & set(each)]
