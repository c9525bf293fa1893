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


def table_of(page: str, *header: str) -> list[list[str]]:
    """The cells of the rows of a table, by the page's name and the first words of its header."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    lines = text[text.index(f"\n| {' | '.join(header)} |") :].lstrip().partition("\n\n")[0]
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines.splitlines()[2:]
    ]


def code_of(text: str) -> list[str]:
    """The Python of a page or a section, block by block."""
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def shell_of(text: str) -> list[str]:
    """The lines of the shell blocks of a page: fenced, in lists and notes too, or indented."""
    lines, language = [], None
    for line in text.replace("\\\n", " ").splitlines():
        if fence := re.match(r" *```(\w*)", line):
            language = fence[1] if language is None else None
        elif language in ("", "bash", "sh") or (
            language is None and re.match(r" {4}(saccade|uv|uvx|pip|python) ", line)
        ):
            lines.append(line.strip())
    return lines


def commands_of(text: str) -> list[list[str]]:
    """The words of each `saccade` command in the shell blocks of a page."""
    parts = (part.strip() for line in shell_of(text) for part in re.split(r"&&|[|>]", line))
    commands = (re.sub(r"^uv run (--no-dev )?", "", part) for part in parts)
    return [shlex.split(each) for each in commands if each.startswith("saccade ")]
