"""Fitting finds the weights of a simulated density, and never scores what it was fitted to."""

from dataclasses import astuple, fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from saccade.attention import AttentionConfig
from saccade.attention._fitting_kernels import add_likelihood
from saccade.attention._scanpath_model_kernels import fill_logits
from saccade.attention.fitted import (
    FUNCTIONS,
    GEOMETRY,
    LAGS,
    feature_maps,
    path_terms,
    saccade_tables,
)
from saccade.evaluation.fitting import (
    FittingConfig,
    FittingData,
    as_model,
    cross_validate,
    fit,
    folds_by_image,
    folds_by_subject,
    score_held_out,
)
from saccade.evaluation.fixations import FixationScores, auc, fixation_density, nss
from saccade.evaluation.prediction import (
    FixationData,
    PredictionScores,
    fixation_rows,
    score_models,
    score_people,
)
from saccade.types import FixationTable
from support.nightly import nightly

SHAPE, SIZE = (12, 16), (120, 160)
CONFIG = FittingConfig(folds=3)
TRUE = {"symmetry": 0.9, "boolean": 0.4, "center x": -6.0}


def simulated(rng, images=24, subjects=4, per_subject=12, near=0.0):
    """Paths by three of the features, and by nearness to the last fixation."""
    names = ["symmetry", "boolean", "contrast", "color", *GEOMETRY]
    features = np.array([TRUE.get(name, 0.0) for name in names])
    saccade = np.zeros(FUNCTIONS)
    saccade[3] = near
    values = rng.normal(size=(images, len(names), *SHAPE)).astype(np.float32)
    values[:, names.index("center x")] = ((np.arange(16) + 0.5) / 16 - 0.5) ** 2
    tables = saccade_tables(SHAPE, SIZE)[0] @ saccade
    fixations = []
    for of_image in values:
        static = np.tensordot(features, of_image, 1)
        paths = []
        for _ in range(subjects):
            row, column = 6, 8
            for _ in range(per_subject):
                logits = static + tables[11 - row : 23 - row, 15 - column : 31 - column]
                p = np.exp(logits).ravel()
                row, column = divmod(int(rng.choice(p.size, p=p / p.sum())), 16)
                paths.append((column * 10 + 4.5, row * 10 + 4.5))
        fixations.append(np.array(paths))
    labels = [f"{i:02}.png" for i in range(images)]
    table = FixationTable(
        np.repeat(labels, subjects * per_subject),
        np.tile(np.repeat(np.arange(subjects), per_subject), images),
        np.tile(np.arange(per_subject), images * subjects),
        np.concatenate(fixations),
    )
    people = FixationData(Path(), table, dict.fromkeys(labels, SIZE), 10.0)
    return FittingData(people, names, values, AttentionConfig())


def test_the_weights_of_a_simulated_density_are_found(rng):
    data = simulated(rng, images=60)
    found = fit(data, replace(CONFIG, penalty=1e-5), ordered=False)
    k = len(data.names)
    for name, value in TRUE.items():
        at = found[data.names.index(name)]
        assert at == pytest.approx(value, abs=0.12 * abs(value) + 0.05)
    assert abs(found[data.names.index("contrast")]) < 0.08
    assert not found[k:].any()
    assert as_model(data, found).features == tuple(data.names)


@pytest.mark.parametrize("near", [3.0, *nightly(0.0)])
def test_the_order_is_found_where_there_is_one(rng, near):
    """Nearness to the last fixation has the weight by which the paths were drawn."""
    data = simulated(rng, near=near)
    found = fit(data, replace(CONFIG, penalty=1e-5))[len(data.names) + len(data.early) :]
    basis = saccade_tables(SHAPE, SIZE)[0]
    ours, true = basis @ found, near * basis[..., 3]
    seen = (slice(8, 15), slice(12, 19))  # saccades that are often made
    gap = ours[seen] - true[seen]
    assert (gap - gap.mean()).std() < 0.25


def test_the_gradient_is_that_of_differences(rng):
    shape, count = (4, 5), len(LAGS)
    fields, tables = rng.normal(size=(2, *shape)), rng.normal(size=(count, 7, 9))
    anchors = rng.integers(0, shape, (3, count, 2))
    factors, cells = rng.normal(size=(3, count)), rng.integers(0, shape, (3, 2))
    slopes = np.zeros_like(fields), np.zeros_like(tables)
    add_likelihood(fields, tables, anchors, factors, cells, *slopes)

    def value(x):
        split_at = fields.size
        given = x[:split_at].reshape(fields.shape), x[split_at:].reshape(tables.shape)
        rest = np.zeros_like(fields), np.zeros_like(tables)
        return add_likelihood(*given, anchors, factors, cells, *rest)

    numeric = approx_fprime(np.concatenate([fields.ravel(), tables.ravel()]), value, 1e-6)
    np.testing.assert_allclose(np.concatenate([s.ravel() for s in slopes]), numeric, atol=1e-5)


def test_the_saved_model_predicts_as_the_fit_does(rng):
    """Both come to the same distribution over the cells; the weights are rounded."""
    names = ("attention", "contrast", *GEOMETRY)
    image = rng.random((120, 160, 3)).astype(np.float32)
    values = feature_maps(image, names)
    path = np.array([[79.5, 59.5], [20.0, 30.0], [100.0, 90.0], [21.0, 33.0]])
    table = FixationTable(np.full(3, "a"), np.zeros(3, np.int64), np.arange(3), path[1:])
    data = FittingData(FixationData(Path(), table, {"a": SIZE}), names, [values], AttentionConfig())
    k, e = len(names), len(data.early)
    weights = rng.normal(size=k + e + FUNCTIONS)
    weights[k + e :] *= 0.1
    model = as_model(data, weights, weights)
    shape = values.shape[1:]
    early = np.tensordot(weights[k : k + e], values[data.early], 1)
    fields = np.stack([np.tensordot(weights[:k], values, 1), early])
    (tables,) = data.tables.values()
    for n in range(1, 4):
        expected = np.empty(shape)
        terms = (data.steps[0].anchors[n - 1], data.steps[0].factors[n - 1])
        fill_logits(fields, tables @ weights[k + e :], *terms, expected)
        found = model.next_fixation_density(image, path[:n])
        np.testing.assert_allclose(found, np.exp(expected) / np.exp(expected).sum(), rtol=1e-3)
        assert found.sum() == pytest.approx(1)
    anchors, factors = path_terms(path[:1], SHAPE, SIZE)
    assert set(map(tuple, anchors)) == {(5, 7)} or set(map(tuple, anchors)) == {(6, 8)}
    np.testing.assert_array_equal(factors[8:], 0)


@pytest.mark.parametrize("folds_of", [folds_by_image, folds_by_subject])
def test_nothing_is_scored_by_weights_that_were_fitted_to_it(rng, folds_of):
    """Whatever the fixations of a fold become, the weights by which they are scored stay."""
    data = simulated(rng, images=9, per_subject=4)
    folds = folds_of(data, CONFIG)
    before = [*cross_validate(data, folds, CONFIG)]
    data.people.table.xy[np.concatenate(folds) == 1] = 150.0, 110.0
    changed = FittingData(data.people, data.names, data.values, data.attention)
    after = [*cross_validate(changed, folds, CONFIG)]
    same = [np.array_equal(a, b) for a, b in zip(after, before, strict=True)]
    assert same == [False, True, False]
    assert len([*score_held_out(data, folds, after)]) == 9


@pytest.fixture
def looked(rng):
    """Three subjects of three images, and two models."""
    sizes = {"a": (30, 40), "b": (60, 50), "c": (30, 40)}
    rows = [(i, v, n) for i in sizes for v in range(3) for n in range(6)]
    image, subject, index = (np.array(column) for column in zip(*rows, strict=True))
    xy = rng.uniform(0, 29, (len(rows), 2))
    table = FixationTable(image, subject, index, xy)
    maps = {name: {i: rng.random(size) for i, size in sizes.items()} for name in "xy"}
    return FixationData(Path(), table, sizes, 3.0), maps


def test_differences_are_paired(looked):
    first = FixationScores(*np.linspace(0.1, 0.7, 7))
    shifted = [FixationScores(*(np.array(astuple(first)) + i)) for i in (0, 10, 20)]
    better = [FixationScores(*(np.array(astuple(s)) + 0.5)) for s in shifted]
    one, two = PredictionScores("abc", shifted), PredictionScores("abc", better)
    difference = two.minus(one)
    for scores in difference:
        np.testing.assert_allclose(astuple(scores), 0.5)
    some = PredictionScores("cx", [better[2], better[0]])
    np.testing.assert_allclose(astuple(some.minus(one).mean), 0.5)


def test_the_scores_of_the_fixations_average_to_those_of_the_image(looked):
    data, maps = looked
    scored = dict(score_models({"x": maps["x"].__getitem__}, data))
    rows = list(fixation_rows("b", {"x": maps["x"]["b"]}, data))
    assert len(rows) == len(data.on("b")) == 18
    for key in ("auc", "shuffled_auc", "nss", "information_gain"):
        mean = np.mean([getattr(row, key) for row in rows])
        assert mean == pytest.approx(getattr(scored["b"]["x"], key), rel=1e-9)
    assert {row.subject for row in rows} == {0, 1, 2}


def test_people_are_each_against_the_others(looked):
    data, _ = looked
    table = data.table
    found = dict(score_people(data))
    rows = []
    for subject in range(3):
        here = table.image == "a"
        own, rest = (
            table.xy[here & mask] for mask in (table.subject == subject, table.subject != subject)
        )
        density = fixation_density(rest, data.sizes["a"], 3.0)
        rows.append((auc(density, own), nss(density, own)))
    assert (found["a"].auc, found["a"].nss) == pytest.approx(tuple(np.mean(rows, axis=0)))


def test_the_references_know_nothing_of_the_image(looked):
    data, _ = looked
    models = {"center": data.center, "shuffled": data.shuffled}
    scored = dict(score_models(models, data))
    assert all(
        of["shuffled"].information_gain == pytest.approx(0, abs=1e-4) for of in scored.values()
    )
    center = data.center("b")
    assert center.shape == (60, 50)
    np.testing.assert_allclose(center, center[::-1, ::-1])
    assert len(fields(FixationScores)) == 7
