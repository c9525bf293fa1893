import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage
from scipy.interpolate import lagrange
from scipy.optimize import minimize
from scipy.spatial import cKDTree

from saccade.keypoints import SiftConfig, _extrema_kernels, extrema
from saccade.scale.workspace import WorkspacePool
from support import oracles_keypoints as oracles

seeds = st.integers(0, 2**32 - 1)


def smooth(seed, shape=(5, 24, 26)):
    noise = np.random.default_rng(seed).standard_normal(shape)
    return (ndimage.gaussian_filter(noise, (1, 1.8, 1.8)) * 20).astype(np.float32)


def as_lists(places):
    return [list(place) for place in places]


def bump(x, y, scale, shape=(5, 15, 17), sharpness=(0.11, 0.08, 0.1), twist=0.02):
    """A quadratic with its top at a known place."""
    p, r, c = np.indices(shape).astype(float)
    dx, dy, dp = c - x, r - y, p - scale
    a, b, d = sharpness
    top = 1 - a * dx**2 - b * dy**2 - d * dp**2 + twist * (dx * dy + dx * dp - dy * dp)
    return top.astype(np.float32)


def config(**changes):
    settings = {"border": 2, "candidate_fraction": 0.0, "neighbors": 26, "edge_ratio": 10.0}
    return SiftConfig(**(settings | {"fit": "quadratic"} | changes))


def find(dog, threshold=0.0, **changes):
    return extrema.find_extrema(dog, config(**changes), threshold)


def candidates(dog, threshold, neighbors=26):
    out = np.zeros((dog.size, 3), np.int64)
    rows = 2, dog.shape[1] - 2
    return out[: _extrema_kernels.find_local_extrema(dog, threshold, 2, neighbors, *rows, out)]


@pytest.mark.kernel
@given(seeds, st.sampled_from([0.0, 0.1, 0.5]), st.integers(2, 4), st.sampled_from([10, 26]))
@settings(max_examples=20)
def test_candidates_meet_their_twin(seed, threshold, border, neighbors):
    dog = smooth(seed, (4, 16, 18))
    out = np.zeros((500, 3), np.int64)
    rows = border, 16 - border
    count = _extrema_kernels.find_local_extrema(dog, threshold, border, neighbors, *rows, out)
    expected = oracles.extrema(dog, threshold, border, neighbors)
    assert sorted(out[:count].tolist()) == as_lists(expected)


@pytest.mark.kernel
@given(hnp.arrays(np.float32, (3, 6, 7), elements=st.sampled_from([-2, -1, 0, 1, 2])))
@settings(max_examples=60)
def test_of_equal_samples_the_first_is_the_extremum(dog):
    out = np.zeros((60, 3), np.int64)
    count = _extrema_kernels.find_local_extrema(dog, 0.0, 1, 26, 1, 5, out)
    assert sorted(out[:count].tolist()) == as_lists(oracles.extrema(dog, 0, 1))


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_extrema_are_found_in_all_rows_by_any_number_of_threads(rng, threads):
    dog = ndimage.gaussian_filter(rng.standard_normal((5, 200, 40)), (0, 1, 1)).astype(np.float32)
    with WorkspacePool(threads).workspace() as workspace:
        found = extrema.find_extrema(dog, config(edge_ratio=np.inf), 0.0, workspace)
    for values, expected in zip(found, find(dog, edge_ratio=np.inf), strict=True):
        np.testing.assert_array_equal(values, expected)
    assert len(np.unique(np.rint(found.xy[:, 1]))) > 150


@pytest.mark.kernel
@given(seeds, st.floats(0.05, 2))
@settings(max_examples=20)
def test_of_two_places_close_by_the_farther_is_marked(seed, radius):
    rng = np.random.default_rng(seed)
    places = rng.random((60, 3)) * [3, 12, 12]
    places = places[np.argsort(places[:, 1])]
    distance, marked = rng.random(60), np.zeros(60, bool)
    _extrema_kernels.mark_duplicates(places, distance, radius, marked)
    pairs = cKDTree(places).query_pairs(radius, p=np.inf)
    assert set(np.flatnonzero(marked)) == {max(p, key=lambda i: distance[i]) for p in pairs}


@pytest.mark.kernel
@given(seeds)
@settings(max_examples=40)
def test_quadratic_meets_its_twin(seed):
    cube = np.random.default_rng(seed).standard_normal((3, 3, 3)).astype(np.float32)
    expected = oracles.quadratic(cube)
    assume(np.abs(expected[0]).max() < 20)
    found = _extrema_kernels.fit_quadratic(cube, 1, 1, 1)
    np.testing.assert_allclose(np.hstack(found), np.hstack(expected), rtol=2e-3, atol=2e-4)


@pytest.mark.kernel
@given(st.floats(-1, 1))
@settings(max_examples=8)
def test_lagrange_weights_are_lagranges(t):
    nodes = np.arange(-4, 5)
    weights = np.zeros((3, 9))
    _extrema_kernels.lagrange_weights(t, weights)
    for i in range(9):
        polynomial = lagrange(nodes, nodes == nodes[i])
        expected = [polynomial(t), polynomial.deriv()(t), polynomial.deriv(2)(t)]
        np.testing.assert_allclose(weights[:, i], expected, atol=1e-6)


@pytest.mark.kernel
@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.4, 0.4))
@settings(max_examples=25)
def test_the_top_of_a_quartic_is_found(x, y, s):
    p, r, c = np.indices((3, 9, 9)) - np.array([1, 4, 4])[:, None, None, None]
    dx, dy = c - x, r - y
    top = 1 - 0.1 * dx**2 + 0.004 * dx**4 - 0.12 * dy**2 + 0.005 * dy**4 + 0.003 * dx**2 * dy**2
    dog = (top - 0.08 * (p - s) ** 2 + 0.02 * dx * (p - s)).astype(np.float32)
    start = _extrema_kernels.fit_quadratic(dog, 1, 4, 4)[0]
    found = _extrema_kernels.refine_position(dog, 1, 4, 4, *start)
    np.testing.assert_allclose(found, (x, y, s), atol=5e-4)


@pytest.mark.kernel
def test_without_all_samples_around_a_place_stays_as_it_is():
    rows, columns = np.indices((12, 14))
    start, top = (-0.25, -0.15, 0.0), (-0.3, -0.2, 0.0)
    for row, column, moves in [
        *((row, column, True) for row in (4, 7) for column in (4, 9)),
        *((row, 6, False) for row in (3, 8)),
        *((5, column, False) for column in (3, 10)),
    ]:
        hill = 100 - (rows - row - top[1]) ** 2 - (columns - column - top[0]) ** 2
        dog = np.stack([hill - 1, hill, hill - 1]).astype(np.float32)
        found = _extrema_kernels.refine_position(dog, 1, row, column, *start)
        assert found == (pytest.approx(top, abs=1e-3) if moves else start)


@pytest.mark.kernel
def test_a_step_that_leads_away_is_not_followed():
    rng = np.random.default_rng(0)
    strayed = 0
    for _ in range(20):
        dog = rng.standard_normal((3, 9, 9)).astype(np.float32)
        found = _extrema_kernels.refine_position(dog, 1, 4, 4, 0.1, -0.2, 0.3)
        assert (
            np.abs(np.subtract(found, (0.1, -0.2, 0.3))).max()
            < _extrema_kernels.MAX_PEAK_CORRECTION
        )
        strayed += found == (0.1, -0.2, 0.3)
    assert strayed > 0


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("fit", ["lagrange", "quadratic"])
@given(st.floats(5, 10), st.floats(5, 9), st.floats(1.6, 2.4))
@settings(max_examples=20)
def test_the_top_of_a_quadratic_is_found(sign, fit, x, y, scale):
    found = find(sign * bump(x, y, scale), fit=fit)
    np.testing.assert_allclose(found.xy, [[x, y]], atol=1e-4)
    np.testing.assert_allclose(found.scale, [scale], atol=1e-4)
    np.testing.assert_allclose(found.value, [sign], atol=1e-5)


def test_every_extremum_lies_where_the_quadratic_at_its_nearest_sample_is_flat():
    moved = 0
    for seed in range(4):
        dog = smooth(seed, (5, 60, 60))
        found = find(dog, edge_ratio=np.inf)
        samples = oracles.extrema(dog, 0, 2)
        assert 10 < len(found.xy) <= len(samples)
        for xy, scale, value in zip(*found, strict=True):
            column, row = np.rint(xy).astype(int)
            plane = round(scale)
            cube = dog[plane - 1 : plane + 2, row - 1 : row + 2, column - 1 : column + 2]
            (x, y, s), expected = oracles.quadratic(cube)[:2]
            np.testing.assert_allclose(xy, [column + x, row + y], atol=1e-3)
            np.testing.assert_allclose([scale, value], [plane + s, expected], atol=1e-3)
            moved += (plane, row, column) not in samples
    assert moved > 0


def test_contrast_is_tested_at_the_extremum():
    dog = 0.03 * bump(8.4, 7.4, 2.0)  # samples reach 0.9 of it
    assert dog.max() < 0.0295
    assert len(find(dog, threshold=0.0299).xy) == 1
    assert len(find(dog, threshold=0.0301).xy) == 0


@pytest.mark.parametrize(("ratio", "kept"), [(9.5, 1), (10.5, 0)])
def test_edges_are_left_out(ratio, kept):
    """Curvatures 1 to `ratio`; the threshold is 10."""
    sharp = 0.2
    dog = bump(8.1, 7.1, 2.0, sharpness=(sharp, sharp / ratio, 0.1), twist=0)
    assert len(find(dog).xy) == kept
    assert len(find(dog, edge_ratio=np.inf).xy) == 1


def test_saddles_are_left_out():
    """A sample can be higher than all its neighbors and the surface a saddle (det < 0)."""
    dog = np.zeros((3, 9, 9), np.float32)
    dog[1, 3:6, 3:6] = [[0.9, 0.95, -0.9], [0.95, 1, 0.95], [-0.9, 0.95, 0.9]]
    assert oracles.extrema(dog, 0.95, 2) == [(1, 4, 4)]
    _, value, _, determinant, _ = oracles.quadratic(dog[:, 3:6, 3:6])
    assert value > 0.95
    assert determinant < 0
    for edge_ratio in (10.0, 1e6, np.inf):
        assert len(find(dog, 0.95, candidate_fraction=1.0, edge_ratio=edge_ratio).xy) == 0


def two_hills(p, r, c):
    """A hill and, in the next plane, a higher one beside it."""
    low = np.exp(-((c - 8) ** 2) - (r - 7) ** 2 - (p - 2) ** 2)
    return low + 1.2 * np.exp(-((c - 9.3) ** 2) - (r - 8.3) ** 2 - (p - 3) ** 2)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_hill_diagonally_under_a_higher_one_is_found_with_fewer_neighbors(sign):
    dog = (sign * two_hills(*np.indices((6, 15, 17)))).astype(np.float32)
    tops = [minimize(lambda v: -two_hills(*v), near).x for near in ([2, 7, 8], [3, 8, 9])]
    assert len(find(dog, fit="lagrange").xy) == 1
    found = find(dog, fit="lagrange", neighbors=10)
    np.testing.assert_allclose(found.xy, [top[:0:-1] for top in tops], atol=0.08)
    np.testing.assert_allclose(found.scale, [top[0] for top in tops], atol=0.08)


def test_a_saddle_across_the_planes_is_left_out():
    p, r, c = np.indices((5, 15, 17))
    dog = (1 - 0.2 * (c - 8.3 - p + 2.3) ** 2 - 0.1 * (r - 7) ** 2 + 0.02 * (p - 2.3) ** 2).astype(
        np.float32
    )
    assert len(candidates(dog, 0.5, neighbors=10)) > 0
    assert len(find(dog, neighbors=10, edge_ratio=np.inf).xy) == 0


def test_a_point_between_two_samples_is_found_once():
    """At half a sample the quadratics of a sharp peak each point to the other sample."""
    p, r, c = np.indices((5, 15, 17))
    for x in (8.5, 8.499, 8.49):
        dog = np.exp(-((c - x) ** 2 + (r - 7.5) ** 2 + (p - 2.2) ** 2) / 4).astype(np.float32)
        found = find(dog, fit="lagrange")
        np.testing.assert_allclose(found.xy, [[x, 7.5]], atol=0.02)
