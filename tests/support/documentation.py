"""The pages of the documentation, as the tests read them."""

import re
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
