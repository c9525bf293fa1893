"""The metrics are those of the field, and the readers say what is wrong."""

import importlib.metadata
import importlib.util
import re

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.io import savemat
from scipy.stats import mannwhitneyu, pearsonr

from saccade import evaluation
from saccade.cli.fixation_tables import degree_sizes
from saccade.datasets.fixations import read_fixations
from saccade.errors import ConfigError, ImageError
from saccade.evaluation import fixations as metrics
from saccade.evaluation.prediction import FixationData
from saccade.types import FixationTable
from support.paths import ROOT

MAPS = arrays(np.float64, (12, 16), elements=st.floats(0, 1, width=16))
PLACES = arrays(np.float64, (7, 2), elements=st.floats(0, 11))


def peer(file):
    """A module of pysaliency, loaded by itself: its package needs libraries that it never uses."""
    try:
        location = importlib.metadata.distribution("pysaliency").locate_file(
            f"pysaliency/{file}.py"
        )
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("pysaliency, the peer, is not installed")
    spec = importlib.util.spec_from_file_location(f"pysaliency_{file}", location)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def pysaliency_metrics():
    return peer("metrics")


@pytest.fixture(scope="module")
def pysaliency_auc():
    return peer("numba_utils").auc_for_one_positive


@pytest.fixture
def a_map_and_places(rng):
    return rng.random((60, 80)), rng.uniform(0, 59, (40, 2)), rng.uniform(0, 59, (300, 2))


@pytest.mark.peer
def test_nss_is_that_of_pysaliency(a_map_and_places, pysaliency_metrics):
    saliency, places, _ = a_map_and_places
    columns, rows = np.rint(places).astype(int).T
    expected = pysaliency_metrics.NSS(saliency, columns, rows).mean()
    assert metrics.nss(saliency, places) == pytest.approx(expected, abs=1e-6)


@pytest.mark.peer
@pytest.mark.parametrize(
    ("ours", "theirs"), [("correlation", "CC"), ("similarity", "SIM"), ("divergence", "MIT_KLDiv")]
)
def test_map_metrics_are_those_of_pysaliency(a_map_and_places, pysaliency_metrics, ours, theirs):
    saliency, places, _ = a_map_and_places
    density = metrics.fixation_density(places, saliency.shape, 6)
    expected = getattr(pysaliency_metrics, theirs)(saliency, density)
    assert getattr(metrics, ours)(saliency, density) == pytest.approx(expected, abs=1e-6)


@pytest.mark.peer
def test_auc_is_that_of_pysaliency(a_map_and_places, pysaliency_auc):
    saliency, places, others = a_map_and_places
    saliency = np.round(saliency, 1)
    fixated = metrics.values_at(saliency, places)
    against = [(metrics.auc(saliency, places), saliency.ravel())]
    shuffled = metrics.shuffled_auc(saliency, places, others)
    against.append((shuffled, metrics.values_at(saliency, others)))
    for ours, negatives in against:
        expected = np.mean([pysaliency_auc(value, negatives) for value in fixated])
        assert ours == pytest.approx(expected, abs=1e-6)


@given(arrays(np.float64, 9, elements=st.floats(0, 3).map(round)), arrays(np.float64, 14))
def test_the_area_is_the_u_statistic(positives, negatives):
    negatives = np.nan_to_num(negatives.clip(0, 3)).round()
    u = mannwhitneyu(positives, negatives, method="asymptotic", use_continuity=False).statistic
    assert metrics.roc_area(positives, negatives) == pytest.approx(u / (9 * 14))


@given(MAPS, PLACES, st.floats(0.5, 9), st.floats(-2, 2))
def test_ranks_and_standard_scores_ignore_scale_and_offset(saliency, places, scale, offset):
    moved = saliency * scale + offset
    if len(np.unique(np.round(moved, 9))) == len(np.unique(saliency)) > 1:
        assert metrics.auc(moved, places) == pytest.approx(metrics.auc(saliency, places), abs=1e-9)
        assert metrics.nss(moved, places) == pytest.approx(metrics.nss(saliency, places), abs=1e-6)


def test_a_flat_map_is_at_chance():
    flat, places = np.ones((20, 30)), np.array([[3.0, 4.0], [20.0, 10.0]])
    assert metrics.auc(flat, places) == 0.5
    assert metrics.shuffled_auc(flat, places, places + 1) == 0.5
    assert metrics.nss(flat, places) == 0
    assert metrics.correlation(flat, np.eye(20, 30)) == 0
    assert metrics.information_gain(flat, flat, places) == pytest.approx(0)


def test_correlation_is_pearson_s(rng):
    first, second = rng.random((9, 8)), rng.random((9, 8))
    expected = pearsonr(first.ravel(), second.ravel()).statistic
    assert metrics.correlation(first, second) == pytest.approx(expected)


def test_a_map_twice_as_sure_tells_one_bit():
    baseline, map_ = np.ones((10, 10)), np.ones((10, 10))
    map_[:, 5:] = 0
    assert metrics.information_gain(map_, baseline, np.array([[1.0, 1.0]])) == pytest.approx(1)


def test_a_density_is_scored_by_the_map_that_is_best_for_each_metric():
    """Blurred it is the fixation density; where others look, a uniform one is not surprised."""
    place, others = np.array([[30.0, 20.0]]), np.array([[60.0, 40.0]] * 5)
    exact, uniform = np.zeros((60, 80)), np.ones((60, 80))
    exact[20, 30] = 1
    scores = metrics.score(exact, place, others, sigma=4, density=True)
    assert (scores.cc, scores.sim) == pytest.approx((1, 1))
    assert metrics.score(uniform, place, others, sigma=4, density=True).shuffled_auc == 1
    assert metrics.score(uniform, place, others, sigma=4).shuffled_auc == 0.5


@pytest.mark.parametrize("places", [np.zeros((0, 2)), np.array([[80.0, 3.0]])])
def test_places_outside_are_refused(places):
    with pytest.raises(ImageError, match="fixations: expected"):
        metrics.auc(np.ones((60, 80)), places)


def test_a_map_with_nan_is_refused():
    with pytest.raises(ImageError, match="finite"):
        metrics.score(np.full((4, 4), np.nan), np.ones((1, 2)), np.ones((1, 2)))


def test_the_mat_file_of_osie_reads_like_the_table(tmp_path):
    (tmp_path / "table.csv").write_text(
        "image,subject,index,x,y,duration_ms\n"
        "a.jpg,0,0,1.5,2,100\na.jpg,0,1,3,4,100\na.jpg,1,0,5,6,100\nb.jpg,0,0,7,8,1\n"
    )
    eye = [
        {"fix_x": np.array([1.5, 3.0]), "fix_y": np.array([2.0, 4.0])},
        {"fix_x": np.array([5.0]), "fix_y": np.array([6.0])},
        {"fix_x": np.array([7.0]), "fix_y": np.array([8.0])},
    ]
    cells = np.empty(2, object)
    for place, (name, eyes) in enumerate([("a.jpg", eye[:2]), ("b.jpg", eye[2:])]):
        subjects = np.empty(len(eyes), object)
        subjects[:] = eyes
        cells[place] = {"img": name, "subjects": subjects}
    savemat(tmp_path / "fixations.mat", {"fixations": cells})
    table, mat = read_fixations(tmp_path / "table.csv"), read_fixations(tmp_path / "fixations.mat")
    for field in ("image", "subject", "index", "xy"):
        np.testing.assert_array_equal(getattr(mat, field), getattr(table, field))


@pytest.mark.shared
def test_the_osie_table(shared):
    table = read_fixations(shared / "data/eyes/osie/fixations.csv")
    assert repr(table) == f"FixationTable({len(table)} fixations on 140 images)"
    assert (table.index > 0).sum() == 17752


def test_every_metric_is_found_where_the_documentation_says(rng):
    saliency, fixations = rng.random((30, 40)), rng.uniform(0, 29, (20, 2))
    assert evaluation.auc(saliency, fixations) == metrics.auc(saliency, fixations)
    assert evaluation.nss is metrics.nss
    for page, title in (("evaluation", "## Fixations"), ("scanpaths", "## Metrics")):
        text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
        part = text.split(title)[1].split("\n## ")[0]
        rows = [line for line in part.splitlines() if line.count("|") == 4]
        named = re.findall(r"`(\w+)` \|$", "\n".join(rows), re.MULTILINE)
        assert named
        assert all(callable(getattr(evaluation, name)) for name in named)
    assert {"auc", "scanmatch", "score_drive"} <= set(evaluation.__all__)


@pytest.mark.parametrize(
    ("text", "sigmas"),
    [
        ("25", (25, 25)),
        ("5%", (20, 40)),
        ("400x300=12,800x600=24.5", (12, 24.5)),
    ],
)
def test_fixations_are_blurred_by_a_degree_of_each_image(tmp_path, text, sigmas):
    """An image that is shown twice as large has the same density, twice as large."""
    shapes = {"a.png": (300, 400), "b.png": (600, 800)}
    for name, shape in shapes.items():
        cv2.imwrite(str(tmp_path / name), np.zeros(shape, np.uint8))
    xy = np.array([[100, 50], [300, 200], [201, 101], [601, 401]], float)
    image, zero = np.repeat(["a.png", "b.png"], 2), np.zeros(4, np.int64)
    table = FixationTable(image, zero, np.array([0, 1, 0, 1]), xy)
    data = FixationData.of(table, tmp_path, 0, degree_sizes(text))
    for name, sigma in zip(shapes, sigmas, strict=True):
        expected = metrics.fixation_density(data.on(name).xy, shapes[name], sigma)
        np.testing.assert_array_equal(data.density(name, data.on(name).xy), expected)


@pytest.mark.parametrize("text", ["much", "-3", "400x300=5", "0%"])
def test_a_degree_that_no_image_can_have_is_named(text):
    with pytest.raises(ConfigError, match="--pixels-per-degree: expected N, WIDTHxHEIGHT=N"):
        degree_sizes(text)((600, 800))


def test_a_blur_in_pixels_on_images_of_several_sizes_is_remarked_on(run, tmp_path):
    for name, shape in {"a.png": (60, 80), "b.png": (120, 160)}.items():
        cv2.imwrite(str(tmp_path / name), np.arange(shape[0] * shape[1]).reshape(shape) % 251)
    (tmp_path / "f.csv").write_text(
        "image,subject,index,x,y\na.png,1,0,9,9\na.png,1,1,20,9\nb.png,1,0,9,9\nb.png,1,1,40,30\n"
    )
    words = ("evaluate", "fixations", "--images", tmp_path, "--fixations", tmp_path / "f.csv")
    words += ("--model", "boolean", "--drop", 0)
    code, _, err = run(*words)
    assert code == 0
    assert "blurred by 24 pixels on images of 2 sizes; --pixels-per-degree" in err
    code, _, err = run(*words, "--pixels-per-degree", "30%")
    assert code == 0
    assert "sizes" not in err
