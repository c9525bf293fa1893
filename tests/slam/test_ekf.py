"""The filters against their textbooks on dense matrices, exact geometry, and abuse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade.errors import LogError
from saccade.slam import (
    EkfSlam,
    observe,
)
from support.oracles_slam import (
    DenseEkf,
    DenseInvariantEkf,
)

R = np.diag([0.04, 0.001])
U = np.diag([0.01, 0.0004])
DENSE = {
    "standard": DenseEkf,
    "invariant": DenseInvariantEkf,
}
every = pytest.mark.parametrize("errors", DENSE)


def _wander(ekf, rng, steps=60, landmarks=12):
    """Drive in a wide curve among random landmarks; yields after every operation."""
    world = rng.uniform(-12, 12, (landmarks, 2))
    truth = ekf.pose
    known = {}
    for _ in range(steps):
        control = np.array([0.5, 0.06])
        ekf.predict(control, U)
        turn = truth[2] + 0.06
        truth = np.array([truth[0] + 0.5 * np.cos(turn), truth[1] + 0.5 * np.sin(turn), turn])
        yield "predict", (control, U)
        for name in rng.permutation(landmarks)[:3].tolist():
            z = observe(truth, world[name])[0] + rng.normal(size=2) * [0.2, 0.03]
            if name in known:
                ekf.update(z, R, known[name])
                yield "update", (z, R, known[name])
            else:
                known[name] = ekf.augment(z, R)
                yield "augment", (z, R)


@pytest.mark.kernel
@every
def test_agrees_with_the_textbook_on_dense_matrices(errors, rng):
    atol = 1e-9 if errors == "standard" else 1e-6  # the oracle's differences are that exact
    start, spread = np.array([1.0, -2.0, 0.4]), np.diag([0.1, 0.2, 0.01])
    ekf, dense = EkfSlam(start, spread, errors=errors), DENSE[errors](start, spread)
    for i, (name, arguments) in enumerate(_wander(ekf, rng, steps=35, landmarks=40)):
        getattr(dense, name)(*arguments)
        np.testing.assert_allclose(np.exp(1j * ekf.state), np.exp(1j * dense.s), atol=atol)
        np.testing.assert_allclose(ekf.state[3:], dense.s[3:], atol=atol)
        seen = np.arange(len(ekf))[::-2]
        rows = np.append([0, 1, 2], (3 + 2 * seen[:, None] + [0, 1]).ravel())
        np.testing.assert_allclose(ekf.marginal(seen), dense.P[np.ix_(rows, rows)], atol=atol)
        np.testing.assert_allclose(ekf.pose_covariance, dense.P[:3, :3], atol=atol)
        if i % 50 == 0:  # this adds up what is delayed
            np.testing.assert_allclose(ekf.covariance, dense.P, atol=atol)
    np.testing.assert_allclose(ekf.covariance, dense.P, atol=atol)
    assert len(ekf) > 32  # it has grown its buffer


@every
@settings(max_examples=60)
@given(data=st.data())
def test_covariance_stays_one_whatever_happens(errors, data):
    sigma = st.floats(0, 10)
    ekf = EkfSlam(np.zeros(3), np.diag(data.draw(st.tuples(*[sigma] * 3))) ** 2, errors=errors)
    largest, exact = 1.0, False
    deviation = st.one_of(st.just(0.0), st.floats(1e-3, 2))
    for _ in range(data.draw(st.integers(1, 25))):
        noise = np.diag(data.draw(st.tuples(deviation, deviation))) ** 2
        z = np.array(data.draw(st.tuples(st.floats(0, 50), st.floats(-10, 10))))
        what = data.draw(st.sampled_from(["predict", "update", "augment"]))
        if what == "predict":
            ekf.predict(np.array(data.draw(st.tuples(st.floats(-5, 5), st.floats(-7, 7)))), noise)
        elif what == "augment" or len(ekf) == 0:
            ekf.augment(z, noise)
        else:
            innovation = ekf.update(z, noise, data.draw(st.integers(0, len(ekf) - 1)))
            assert innovation.nis >= 0
        exact |= what != "predict" and noise.diagonal().min() == 0
        P = ekf.covariance
        assert np.isfinite(ekf.state).all()
        assert -np.pi < ekf.pose[2] <= np.pi
        np.testing.assert_array_equal(P, P.T)
        if not exact:  # after observations without noise only rounding is left of some variances
            largest = max(largest, np.trace(P))
            assert np.linalg.eigvalsh(P)[0] >= -1e-9 * largest


@pytest.mark.parametrize(
    ("act", "names"),
    [
        (lambda e: e.predict(np.array([np.nan, 0]), U), "control"),
        (lambda e: e.predict(np.array([1.0, 0]), np.diag([1.0, -1])), "negative eigenvalues"),
        (lambda e: e.predict(np.array([1.0, 0]), np.eye(3)), "shape"),
        (lambda e: e.update(np.array([1.0, np.inf]), R, 0), "observation"),
        (lambda e: e.update(np.array([1.0, 0]), np.array([[1.0, 0.5], [0, 1]]), 0), "symmetric"),
        (lambda e: e.update(np.array([1.0, 0]), R * np.nan, 0), "covariance of observation 0"),
        (lambda e: e.update(np.array([1.0, 0]), R, 2), "found 2"),
        (lambda e: e.update(np.ones((2, 2)), R, [0, 0]), "covariances"),
        (lambda e: e.augment(np.array([1.0, 0, 0]), R), "2 numbers"),
        (lambda e: e.augment(np.array([1e200, 0]), R), "within"),
    ],
)
def test_what_is_no_measurement_is_refused_and_changes_nothing(act, names):
    ekf = EkfSlam(np.zeros(3), np.eye(3))
    ekf.augment(np.array([2.0, 0.1]), R)
    state, covariance = ekf.state, ekf.covariance
    with pytest.raises(LogError, match=names) as caught:
        act(ekf)
    assert "\n" not in str(caught.value)
    np.testing.assert_array_equal(ekf.state, state)
    np.testing.assert_array_equal(ekf.covariance, covariance)


def test_what_is_read_cannot_change_the_filter():
    ekf = EkfSlam(np.zeros(3), np.eye(3))
    ekf.augment(np.array([2.0, 0.1]), R)
    before = ekf.state, ekf.covariance
    for name in ("pose", "pose_covariance", "landmarks", "landmark_covariances", "state"):
        getattr(ekf, name)[...] = 7
    ekf.covariance[...] = 7
    np.testing.assert_array_equal(ekf.state, before[0])
    np.testing.assert_array_equal(ekf.covariance, before[1])


def test_a_larger_metre_is_a_larger_map():
    """A drive of half the size that is rescaled ends as one of the whole size."""
    rng = np.random.default_rng(0)
    steps, z = rng.uniform(0.1, 1, (6, 2)), rng.uniform((2, -1), (9, 1), (6, 2))
    ends = []
    for size in (1.0, 0.5):
        ekf = EkfSlam(np.array([3.0, -2.0, 0.4]), np.zeros((3, 3)), errors="invariant")
        for i in range(6):
            if i == 4 and size < 1:
                ekf.rescale(2.0, np.array([3.0, -2.0]))
                size = 1.0
            length = np.array([size, 1.0])
            ekf.predict(steps[i] * length, np.diag([0.01, 0.001]) * length**2)
            R = np.diag([0.1, 0.01]) * length**2
            ekf.augment(z[i] * length, R)
            for seen in (i, 0, 2 if i > 2 else 0):
                ekf.update((z[i] + 0.05) * length, R, seen)
        ends.append(ekf)
    np.testing.assert_allclose(ends[1].state, ends[0].state, atol=1e-9)
    np.testing.assert_allclose(ends[1].covariance, ends[0].covariance, atol=1e-9)


@every
def test_an_outlier_has_a_covariance_that_is_as_many_times_larger(errors):
    start = np.zeros(3), np.diag([0.04, 0.04, 0.01]), errors
    for shift, factor in ((0.3, 1.0), (5.0, None)):
        robust, plain = EkfSlam(*start, huber=1.5), EkfSlam(*start)
        for ekf in (robust, plain):
            ekf.augment(np.array([4.0, 0.3]), R)
        z = np.array([4.0 + shift, 0.3])
        _, S, nis = plain.copy().update(z, R, 0)
        assert (nis > 1.5**2) == (factor is None)
        assert robust.update(z, R, 0).nis == pytest.approx(nis)
        scale = factor or np.sqrt(nis) / 1.5
        noise = S - plain.predict_observations().covariance[0]  # with second-order terms
        plain.update(z, R + (scale - 1) * noise[0], 0)
        np.testing.assert_allclose(robust.state, plain.state, atol=1e-12)
        np.testing.assert_allclose(robust.covariance, plain.covariance, atol=1e-12)
