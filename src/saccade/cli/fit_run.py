"""The tables of `saccade fit`."""

from collections.abc import Iterable
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

from saccade.attention.combined import AttentionConfig
from saccade.cli.attention_models import face_detector
from saccade.cli.fixation_tables import load_fixations
from saccade.cli.output import print_message, tracked
from saccade.datasets.fixations import FixationFormat
from saccade.evaluation.fit_study import FITTED, FitStudy, study
from saccade.evaluation.fitted_scores import differences
from saccade.evaluation.fitting import CellScores, FittingConfig
from saccade.viewing.report import Table

LEAD = "A model of fixations, fitted to photographs and people, and its cross-validated scores."
COLUMNS = ["", "sAUC", "AUC", "NSS", "CC", "IG (bit)"]
KEYS = ("shuffled_auc", "auc", "nss", "cc", "information_gain")
CELLS = ["AUC", "NSS", "IG (bit)"]
MEANING = (
    "By image: on images that the model was not fitted to; by viewer: on viewers that it was not "
    "fitted to. IG: information gain over the center, the density of all other images' fixations, "
    "in bits per fixation. People: each viewer against the fixations of the others. With few "
    "viewers at a time, as by viewer and of people, CC is lower: their density is coarser."
)
CURVE = "On images left out, on the cells of the map; IG is over the geometry of the image alone."


@dataclass(frozen=True)
class Fitted:
    """A study, for printing."""

    study: FitStudy

    @property
    def model(self) -> Any:
        """The fitted model."""
        return self.study.model

    def tables(self) -> list[Table]:
        """Scores, differences, learning curve and groups."""
        results = self.study.results
        scores = [
            [name, *_cells(result.mean(), *result.interval())] for name, result in results.items()
        ]
        paired = [
            [f"{FITTED} - {name}", *_cells(*difference)]
            for name, difference in differences(results, FITTED).items()
        ]
        curve = [[str(count), *_plain(cell)] for count, cell in self.study.curve]
        full = _plain(self.study.full)
        without = [["all features", *full]]
        without += [[f"without {each.group}", *_plain(each.without)] for each in self.study.groups]
        alone = [[each.group, *_plain(each.alone)] for each in self.study.groups]
        images = len(results[FITTED].name)
        return [
            Table(f"{images} images: mean, half of the 95 % interval", COLUMNS, scores, MEANING),
            Table("paired differences", COLUMNS, paired, first="models"),
            Table("learning curve", ["images fitted to", *CELLS], curve, CURVE),
            Table("features left out", ["", *CELLS], without, CURVE, "features"),
            Table("features with center and border alone", ["", *CELLS], alone, CURVE, "features"),
        ]

    def as_json(self) -> dict[str, Any]:
        """All figures."""
        results = self.study.results
        return {
            "scores": {n: _ends(r.mean(), *r.interval()) for n, r in results.items()},
            "differences": {n: _ends(*d) for n, d in differences(results, FITTED).items()},
            "learning_curve": [{"images": n, **asdict(cell)} for n, cell in self.study.curve],
            "all_features": asdict(self.study.full),
            "groups": [asdict(each) for each in self.study.groups],
        }


def run(
    images: Path,
    fixations: Path,
    attention: AttentionConfig,
    faces: str | None,
    config: FittingConfig,
    *,
    drop: int,
    sigma: float,
    people: bool,
    form: FixationFormat,
    only_present: bool = False,
) -> Fitted:
    """Fit a model, with progress bars."""
    table = load_fixations(fixations, images, form, only_present)
    found = study(
        table,
        images,
        attention,
        config,
        face_detector(faces),
        skip=drop,
        sigma=sigma,
        people=people,
        progress=_tracked,
    )
    if found.outside:
        print_message(f"{found.outside} fixations outside their images are left out")
    return Fitted(found)


def _tracked(items: Iterable[Any], description: str, count: int) -> Iterable[Any]:
    return tracked(items, description, count)


def _cells(mean: Any, low: Any, high: Any) -> list[str]:
    return [
        f"{getattr(mean, key):.3f} ±{(getattr(high, key) - getattr(low, key)) / 2:.3f}"
        for key in KEYS
    ]


def _plain(cell: CellScores) -> list[str]:
    return [f"{value:.3f}" for value in astuple(cell)]


def _ends(mean: Any, low: Any, high: Any) -> dict[str, Any]:
    return {"mean": asdict(mean), "low": asdict(low), "high": asdict(high)}
