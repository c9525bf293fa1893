"""`saccade fit`: a model of fixations from one's own photographs and people."""

from pathlib import Path
from typing import Annotated

from typer import Option

from saccade.cli.attention_models import Faces
from saccade.cli.options import (
    Columns,
    Config,
    DropFirst,
    Fixations,
    Json,
    Offset,
    OnlyPresent,
    PositionUnits,
    Preset,
    Report,
    Seed,
)


def fit(
    images: Annotated[Path, Option(help="Folder of the images.")],
    fixations: Fixations,
    out: Annotated[
        Path, Option("--out", "-o", metavar="FILE", help="The fitted model, TOML.")
    ] = Path("fitted.toml"),
    preset: Preset = None,
    config: Config = None,
    faces: Faces = None,
    sigma: Annotated[
        float,
        Option(
            min=0.1,
            max=1000,
            metavar="PX",
            help="Standard deviation of the fixation density: one degree of visual angle.",
        ),
    ] = 24.0,
    drop: DropFirst = 1,
    columns: Columns = None,
    xy: PositionUnits = None,
    offset: Offset = None,
    only_present: OnlyPresent = False,
    folds: Annotated[
        int, Option(min=2, max=100, metavar="N", help="Folds of the cross-validation.")
    ] = 5,
    seed: Seed = 2020,
    people: Annotated[
        bool,
        Option(help="Score people, each viewer against the others: the ceiling; some minutes."),
    ] = True,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Fit a saliency model to your own photographs and fixations.

    One convex fit over the cells of the map: contrast, symmetry and Boolean
    maps at several scales and their surroundings, color, the center, the
    border, faces with --faces, and functions of the saccade from earlier
    fixations. It is cross-validated by image and by viewer. --out is used by
    --model of look, evaluate fixations and extract.
    """
    from saccade.cli.fit_run import LEAD, run
    from saccade.cli.fixation_tables import fixation_format
    from saccade.cli.output import print_json, print_table, write_text
    from saccade.evaluation.fitting import FittingConfig
    from saccade.io.files import results_in
    from saccade.settings import as_toml, load_settings
    from saccade.viewing.report import write_tables

    found = run(
        images,
        fixations,
        load_settings("attention", preset, config),
        faces,
        FittingConfig(folds=folds, seed=seed),
        drop=drop,
        sigma=sigma,
        people=people,
        only_present=only_present,
        form=fixation_format(columns, xy, offset),
    )
    tables = found.tables()
    with results_in(out, is_file=True):
        write_text(out, as_toml(found.model))
        write_tables(report, "saccade fit", LEAD, tables)
    if as_json:
        print_json({"model": str(out), **found.as_json()})
        return
    for table in tables:
        print_table(table.title, table.columns, table.rows)
    print_table(
        "fitted model",
        ["", ""],
        [
            ["features", str(len(found.model.features))],
            ["fitted to", found.model.fitted_to],
            ["model", str(out)],
        ],
    )
