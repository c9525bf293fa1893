import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from saccade.attention import winner_take_all
from saccade.attention.maps import SaliencyMaps
from saccade.attention.scanpath import ScanpathConfig, scanpath
from saccade.attention.winner_take_all import Network, advance
from saccade.errors import ConfigError, ImageError
from support import oracles_attention as oracles

STEP = 1e-4


def cells(path):
    """Rows, columns and steps of a scanpath on an image of 16 px per cell."""
    columns, rows = (path.xy.T + 0.5) / 16 - 0.5
    return rows, columns, np.rint(path.time / STEP)


def as_published(saliency, sigma):
    """The reference's own map and disc."""
    return ScanpathConfig(peak=None, inhibition_sigma=sigma / max(saliency.shape))


@pytest.mark.shared
def test_the_slow_twin_has_the_fixations_of_the_reference(shared):
    data = np.load(shared / "reference" / "saliency" / "popout_orientation.iterative.npz")
    rows, columns, steps = oracles.scanpath(
        data["salmap"], 10, 0.3 * float(data["foaSize"].item()) / 32
    )
    np.testing.assert_array_equal(np.stack([rows, columns], 1) + 1, data["fix_disk_mapRC"])
    assert np.abs(steps - data["fix_disk_time_s"].ravel() / STEP).max() < 1.01


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("shape", "power", "sigma", "count"),
    [((7, 9), 1, 0.8, 6), ((1, 12), 1, 0.8, 6), ((9, 11), 3, 0.6, 8)],
)
def test_strides_end_where_steps_do(seed, shape, power, sigma, count, monkeypatch):
    """To a power, few peaks lie over a faint ground: most cells never win."""
    monkeypatch.setattr(winner_take_all, "STRONGEST", 2)
    saliency = 2 * np.random.default_rng(seed).random(shape) ** power
    image_shape = (16 * shape[0], 16 * shape[1])
    path = scanpath(
        SaliencyMaps(saliency, image_shape), as_published(saliency, sigma), fixations=count
    )
    rows, columns, steps = cells(path)
    slow_rows, slow_columns, slow_steps = oracles.scanpath(saliency, count, sigma)
    np.testing.assert_allclose(rows, slow_rows, atol=1e-9)
    np.testing.assert_allclose(columns, slow_columns, atol=1e-9)
    assert np.abs(steps - slow_steps).max() <= 1


def both_strides(V, W, g, current, steps, decay):
    net = Network(
        map_rate=2e-4,
        winner_rate=1e-3,
        decay_rate=decay,
        gain=5.0,
        threshold=1e-3,
        reset=-0.02,
        inhibition=200.0,
        surround=1e-4,
        sigma=1.0,
        last_step=100_000,
    )
    slow = oracles.advance_cell(V, W, g, current, 2e-4, 1e-3, decay, 5.0, steps)
    fast = advance(net, steps, *(np.array([each]) for each in (V, W, g, current)))
    return np.ravel(fast), slow


@given(
    V=st.floats(0, 0.02),
    W=st.floats(-0.02, 0.001),
    g=st.floats(-5e-4, 1.5),
    current=st.floats(1e-7, 1e-5),
    steps=st.integers(1, 100),
)
@example(V=0.004, W=-0.01, g=-2e-4, current=2e-6, steps=100)  # poles of the closed form
@example(V=0.004, W=-0.01, g=8e-4, current=2e-6, steps=100)
@example(V=0.004, W=-0.01, g=1 - 2e-4, current=2e-6, steps=100)
def test_a_stride_is_its_steps(V, W, g, current, steps):
    fast, slow = both_strides(V, W, g, current, steps, 0.0)
    np.testing.assert_allclose(fast, slow, rtol=1e-6, atol=1e-9)
    fast, slow = both_strides(V, W, g, current, steps, 1e-4)
    hundredth_of_the_threshold = 1e-5
    np.testing.assert_allclose(fast, slow, rtol=2e-3, atol=hundredth_of_the_threshold)


def test_an_empty_map_has_no_fixations():
    assert len(scanpath(SaliencyMaps(np.zeros((4, 5)), (40, 50)))) == 0


def test_ties_go_down_the_columns_first():
    saliency = np.zeros((9, 9))
    saliency[7, 1] = saliency[1, 7] = 1
    path = scanpath(SaliencyMaps(saliency, (9, 9)), fixations=2)
    np.testing.assert_allclose(path.xy, [[1, 7], [7, 1]])


def test_a_path_that_the_time_limit_cuts_short_is_told(caplog):
    saliency = np.random.default_rng(3).random((20, 30))
    maps, short = SaliencyMaps(saliency, (200, 300)), ScanpathConfig(time_limit=1.0)
    path = scanpath(maps, short, fixations=100)
    assert 0 < len(path) < 100
    assert f"{len(path)} of 100 fixations within the time limit of 1 s" in caplog.text
    caplog.clear()
    assert len(scanpath(maps, short, fixations=len(path)))
    assert not caplog.text


def test_the_first_fixation_takes_the_time_of_the_closed_form():
    """V and W of one cell without inhibition are sums of two exponentials."""
    s = 1.5
    t = np.arange(0, 0.3, 1e-6)
    V = 0.01 * s * (1 - np.exp(-2 * t))
    W = 5 * 0.01 * s * (1 - 10 / 8 * np.exp(-2 * t) + 2 / 8 * np.exp(-10 * t))
    W -= 0.02 * np.exp(-10 * t)
    assert V[0] == 0
    assert W[0] == pytest.approx(-0.02)
    path = scanpath(SaliencyMaps(np.array([[s]]), (1, 1)), ScanpathConfig(peak=None), fixations=1)
    assert path.time[0] == pytest.approx(t[np.argmax(W > 1e-3)], abs=3 * STEP)


@pytest.mark.parametrize(
    ("saliency", "words"),
    [
        (np.ones(4), "shape"),
        (np.ones((0, 4)), "shape"),
        (np.array([[1.0, np.nan]]), "finite"),
        (np.array([[1.0, -1.0]]), "at least 0"),
    ],
)
def test_a_broken_map_is_named(saliency, words):
    with pytest.raises(ImageError, match=rf"saliency: .*{words}"):
        scanpath(SaliencyMaps(saliency, (10, 10)))


def test_broken_arguments_are_named():
    with pytest.raises(ImageError, match="image_shape"):
        scanpath(SaliencyMaps(np.ones((2, 2)), (0, 4)))
    with pytest.raises(ImageError, match=r"\(600, 800\).*found \(800, 600\).*swapped"):
        scanpath(SaliencyMaps(np.ones((38, 50)), (800, 600)))
    assert len(scanpath(SaliencyMaps(np.ones((38, 50)), (600, 800, 3)), fixations=1)) == 1
    square = SaliencyMaps(np.ones((50, 50)), (600, 800))  # of any image
    assert len(scanpath(square, fixations=1)) == 1
    with pytest.raises(ConfigError, match="fixations"):
        scanpath(SaliencyMaps(np.ones((2, 2)), (4, 4)), fixations=-1)
    with pytest.raises(ConfigError, match="time_step"):
        ScanpathConfig(time_step=0.05)
    with pytest.raises(ConfigError, match="threshold"):
        ScanpathConfig(threshold=0)
