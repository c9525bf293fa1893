"""Fitting finds the weights of a simulated density, and never scores what it was fitted to."""

from dataclasses import astuple, fields

import numpy as np
import pytest

from saccade.attention import AttentionConfig
from saccade.attention.features import GEOMETRY
from saccade.evaluation.comparison import fixation_rows, paired_difference
from saccade.evaluation.fitted_scores import group_scores, learning_curve
from saccade.evaluation.fitting import (
    KINDS,
    Choice,
    FittingConfig,
    FittingData,
    as_model,
    cell_scores,
    choose,
    cross_validate_images,
    fit,
    log_density,
    split,
)
from saccade.evaluation.fixation_references import center_model, score_people, shuffled_model
from saccade.evaluation.fixations import FixationScores, auc, fixation_density, nss
from saccade.evaluation.prediction import PredictionScores, score_model, score_models
from saccade.types import FixationTable

SHAPE = (12, 16)
CONFIG = FittingConfig(folds=3, random_cells=192)
TRUE = {"symmetry": 0.9, "boolean": 0.4, "center x": -6.0}


def simulated(rng, images=24, per_viewer=12, viewers=4):
    """Fixations drawn from a density that is log-linear in three of the features."""
    names = ["symmetry", "boolean", "contrast", "color", "symmetry around 3", "symmetry * boolean"]
    names += ["symmetry * skin", *GEOMETRY]
    weights = np.array([TRUE.get(name, 0.0) for name in names])
    values, fixations, persons = [], [], []
    for _ in range(images):
        of_image = rng.normal(size=(len(names), *SHAPE)).astype(np.float32)
        of_image[names.index("center x")] = ((np.arange(16) + 0.5) / 16 - 0.5) ** 2
        p = np.exp(np.tensordot(weights, of_image, 1)).ravel()
        cells = rng.choice(p.size, per_viewer * viewers, p=p / p.sum())
        rows, columns = np.divmod(cells, SHAPE[1])
        fixations.append(np.stack([(columns + 0.5) / 16, (rows + 0.5) / 12], axis=1))
        values.append(of_image)
        persons.append(np.repeat(np.arange(viewers), per_viewer))
    labels = [f"{i}.png" for i in range(images)]
    return FittingData(labels, names, values, fixations, persons, AttentionConfig()), weights


def test_the_weights_of_a_simulated_density_are_found(rng):
    data, weights = simulated(rng, images=60)
    columns = np.array([data.names.index(name) for name in (*TRUE, "contrast")])
    found = fit(data, np.arange(60), Choice(columns, 1.0), CONFIG)
    for name, value in TRUE.items():
        assert found[data.names.index(name)] == pytest.approx(value, abs=0.12 * abs(value) + 0.05)
    assert abs(found[data.names.index("contrast")]) < 0.08
    assert not found[np.setdiff1d(np.arange(len(weights)), columns)].any()
    model = as_model(data, found)
    assert set(model.features) == {*TRUE, "contrast"}


def test_the_nested_choice_takes_what_it_may(rng):
    data, _ = simulated(rng)
    choice = choose(data, np.arange(24), CONFIG)
    assert set(data.columns(KINDS[0])) <= set(choice.columns)
    without = np.array([name not in TRUE for name in data.names])
    assert not np.isin(
        choose(data, np.arange(24), CONFIG, without).columns, np.flatnonzero(~without)
    ).any()
    assert set(data.columns(KINDS[0])) < set(data.columns(KINDS[1])) < set(data.columns(KINDS[2]))


def test_no_image_is_scored_by_weights_that_were_fitted_to_it(rng):
    """Whatever the fixations of an image become, its own weights stay."""
    data, _ = simulated(rng, images=9)
    before, _ = cross_validate_images(data, CONFIG)
    data.fixations[4][:] = 0.01
    vars(data).pop("cells")
    after, _ = cross_validate_images(data, CONFIG)
    np.testing.assert_array_equal(after[4], before[4])
    assert sum(np.array_equal(a, b) for a, b in zip(after, before, strict=True)) < 9


def test_viewers_that_are_left_out_do_not_count(rng):
    data, _ = simulated(rng, images=6)
    choice = Choice(data.columns(KINDS[0]), 0.1)
    first = fit(data, np.arange(6), choice, CONFIG, np.array([0, 1]))
    for xy, viewers in zip(data.fixations, data.viewers, strict=True):
        xy[viewers > 1] = 0.99
    vars(data).pop("cells")
    np.testing.assert_array_equal(fit(data, np.arange(6), choice, CONFIG, np.array([0, 1])), first)


def test_the_parts_are_a_partition():
    for count, folds in ((10, 3), (2, 5), (7, 7)):
        parts = split(count, folds, 1)
        assert sorted(np.concatenate(parts)) == list(range(count))
        assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_more_images_and_the_right_features_are_better(rng):
    data, weights = simulated(rng)
    curve = list(learning_curve(data, CONFIG))
    assert [size for size, _ in curve] == [5, 10, 16]
    assert curve[-1][1].information_gain > curve[0][1].information_gain
    choice = Choice(data.columns(KINDS[0]), 0.1)
    groups = {group.group: group for group, _ in group_scores(data, choice, CONFIG)}
    full = next(full for _, full in group_scores(data, choice, CONFIG))
    assert groups["symmetry"].without.nss < groups["boolean"].without.nss < full.nss
    assert groups["symmetry"].alone.information_gain > groups["contrast"].alone.information_gain
    geometry = np.where(weights < 0, weights, 0)
    true = cell_scores(data, range(24), [weights] * 24, geometry)
    assert true.information_gain > full.information_gain
    p = np.exp(log_density(data, 0, weights))
    assert p.sum() == pytest.approx(1)
    one = cell_scores(data, [0], [weights], weights)
    places = data.fixations[0] * (16, 12) - 0.5
    assert one.information_gain == 0
    assert one.nss == pytest.approx(nss(p.reshape(SHAPE), places), rel=1e-6)
    assert one.auc == pytest.approx(auc(p.reshape(SHAPE), places))


@pytest.fixture
def looked(rng):
    """Three viewers of three images, and two models."""
    sizes = {"a": (30, 40), "b": (60, 50), "c": (30, 40)}
    rows = [(i, v, n) for i in sizes for v in range(3) for n in range(6)]
    image, viewer, index = (np.array(column) for column in zip(*rows, strict=True))
    xy = rng.uniform(0, 29, (len(rows), 2))
    table = FixationTable(image, viewer, index, xy)
    points = {i: xy[(image == i) & (index >= 1)] for i in sizes}
    maps = {name: {i: rng.random(size) for i, size in sizes.items()} for name in "xy"}
    return table, points, sizes, maps


def test_models_side_by_side_have_the_scores_they_have_alone(looked):
    _, points, sizes, maps = looked
    models = {name: of_model.__getitem__ for name, of_model in maps.items()}
    together = dict(score_models(models, points, sizes, 3.0))
    for name, model in models.items():
        alone = dict(score_model(model, points, sizes, 3.0))
        assert alone == {image: together[image][name] for image in alone}


def test_differences_are_paired(looked):
    first = FixationScores(*np.linspace(0.1, 0.7, 7))
    shifted = [FixationScores(*(np.array(astuple(first)) + i)) for i in (0, 10, 20)]
    better = [FixationScores(*(np.array(astuple(s)) + 0.5)) for s in shifted]
    one, two = PredictionScores("abc", shifted), PredictionScores("abc", better)
    difference = paired_difference(one, two)
    for scores in difference:
        np.testing.assert_allclose(astuple(scores), 0.5)
    some = PredictionScores("cx", [better[2], better[0]])
    np.testing.assert_allclose(astuple(paired_difference(one, some).mean), 0.5)


def test_the_scores_of_the_fixations_average_to_those_of_the_image(looked):
    table, points, sizes, maps = looked
    scored = dict(score_models({"x": maps["x"].__getitem__}, points, sizes, 3.0))
    rows = list(fixation_rows("b", {"x": maps["x"]["b"]}, table, points, sizes, 1, 3.0))
    assert len(rows) == len(points["b"]) == 15
    for key in ("auc", "shuffled_auc", "nss", "information_gain"):
        mean = np.mean([getattr(row, key) for row in rows])
        assert mean == pytest.approx(getattr(scored["b"]["x"], key), rel=1e-9)
    assert {row.viewer for row in rows} == {0, 1, 2}


def test_people_are_each_against_the_others(looked):
    table, points, sizes, _ = looked
    found = dict(score_people(table, points, sizes, 1, 3.0))
    rows = []
    for viewer in range(3):
        here = (table.image == "a") & (table.index >= 1)
        own, rest = (
            table.xy[here & mask] for mask in (table.viewer == viewer, table.viewer != viewer)
        )
        density = fixation_density(rest, sizes["a"], 3.0)
        rows.append((auc(density, own), nss(density, own)))
    assert (found["a"].auc, found["a"].nss) == pytest.approx(tuple(np.mean(rows, axis=0)))


def test_the_references_know_nothing_of_the_image(looked):
    _, points, sizes, _ = looked
    models = {"center": center_model(sizes), "shuffled": shuffled_model(points, sizes, 3.0)}
    scored = dict(score_models(models, points, sizes, 3.0))
    assert all(
        of["shuffled"].information_gain == pytest.approx(0, abs=1e-4) for of in scored.values()
    )
    center = center_model(sizes)("b")
    assert center.shape == (60, 50)
    np.testing.assert_allclose(center, center[::-1, ::-1])
    assert len(fields(FixationScores)) == 7
