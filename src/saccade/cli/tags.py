"""`saccade tags`: tags to print."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeAlias

from cyclopts import Parameter

from saccade.cli.options import JsonOptions
from saccade.cli.output import Result, facts_table
from saccade.errors import require
from saccade.tags import TagConfig, parse_ids, tag_cells


@dataclass(frozen=True, kw_only=True)
class TagsOptions(JsonOptions):
    """Options of `saccade tags`."""

    family: Annotated[str, Parameter(metavar="NAME")] = "tag36h11"
    """Family of the tags."""
    ids: Annotated[str, Parameter(metavar="IDS")] = "0-9"
    """Ids of the tags, such as 0-13 or 3,5,8-10."""
    size: Annotated[float, Parameter(metavar="METERS")] = 0.165
    """Side of the black square in meters."""


Sheet: TypeAlias = Annotated[Path, Parameter(help="PDF to write.")]


def tags(file: Sheet, /, options: TagsOptions = TagsOptions()) -> Result:
    """Write tags to print: one on each page of A4, with its label and its size.

    Print at 100 %, without fitting to the page, and measure the line below the
    tag. The white border belongs to the tag.

    Example: saccade tags --ids 0-13 --size 0.165 tags.pdf
    """
    from saccade.viewing.tag_sheet import MAX_TAG_SIZE, write_tag_sheets

    size = options.size
    require(file.suffix.lower() == ".pdf", "file", "a name that ends in .pdf", file.name)
    config = TagConfig(options.family, size)
    require(
        size <= MAX_TAG_SIZE, "size", f"at most {MAX_TAG_SIZE:g} m, so that it fits on A4", size
    )
    ids = parse_ids(options.ids)
    cells = [(f"{config.family}:{each}", tag_cells(config.family, each)) for each in ids]
    write_tag_sheets(file, cells, size)
    row = {"file": str(file), "family": config.family, "tags": len(ids), "size_m": size}
    return Result(row, [facts_table(f"tags -> {file}", row)])
