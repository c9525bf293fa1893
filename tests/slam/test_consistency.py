"""NIS and NEES against SciPy's distributions and sampled errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.distance import mahalanobis
from scipy.stats import chi2

from saccade.errors import ConfigError, LogError
from saccade.slam.consistency import (
    chi_square_band,
    chi_square_gate,
    normalized_squared,
    pose_nees,
    summarize,
)
from saccade.types import Trajectory


@given(st.integers(1, 10), st.integers(1, 500), st.floats(0.5, 0.999))
def test_band_holds_the_mean_with_its_probability(dof, count, confidence):
    low, high = chi_square_band(dof, count, confidence)
    below, above = chi2.cdf(np.array([low, high]) * count, dof * count)
    assert above - below == pytest.approx(confidence, abs=1e-9)
    assert below == pytest.approx(1 - above, abs=1e-9)


def test_band_of_fifty_runs_in_three_dimensions_is_the_published_one():
    np.testing.assert_allclose(chi_square_band(3, 50), [2.36, 3.72], atol=0.005)


@pytest.mark.parametrize("confidence", [0, 1, -0.1, float("nan")])
def test_no_gate_without_a_probability(confidence):
    with pytest.raises(ConfigError, match="confidence"):
        chi_square_gate(2, confidence)


def test_normalized_square_is_the_mahalanobis_distance(rng):
    error = rng.normal(size=(20, 3))
    root = rng.normal(size=(20, 3, 3))
    covariance = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3)
    ours = normalized_squared(error, covariance)
    for e, C, value in zip(error, covariance, ours, strict=True):
        assert value == pytest.approx(mahalanobis(e, np.zeros(3), np.linalg.inv(C)) ** 2)


def test_errors_of_the_stated_size_are_consistent(rng):
    C = np.array([[2.0, 0.6], [0.6, 0.5]])
    errors = rng.multivariate_normal([0, 0], C, 4000)
    right = summarize(normalized_squared(errors, np.broadcast_to(C, (4000, 2, 2))))
    proud = summarize(normalized_squared(errors, np.broadcast_to(C / 2, (4000, 2, 2))))
    assert right.band[0] < right.mean < right.band[1]
    assert right.inside == pytest.approx(0.95, abs=0.015)
    assert proud.mean > proud.band[1]
    assert proud.inside < 0.9


def test_what_corrected_nothing_does_not_count():
    nis = np.array([1.0, np.nan, 3.0])
    assert summarize(nis).mean == 2
    assert np.isnan(summarize(np.array([np.nan])).mean)
    assert np.isnan(summarize(np.empty(0)).inside)


def test_a_model_that_is_too_sure_is_warned_of_and_a_cautious_one_is_remarked_on(rng):
    right = chi2.ppf((np.arange(1000) + 0.5) / 1000, 2)
    said = summarize(right)
    assert (said.warning, said.remark) == ("", "")
    assert said.verdict.startswith("consistent: innovations ")
    assert "are 3.0 times as large" in summarize(right * 9).warning
    cautious = summarize(right / 4)
    assert cautious.warning == ""
    assert "conservative: the innovations are 0.50 times" in cautious.remark
    assert cautious.verdict == "conservative: innovations 0.50 times as large as predicted"
    outliers = np.where(rng.random(1000) < 0.2, 100.0, right)
    assert "% of the observations are impossible" in summarize(outliers).warning
    few = np.where(np.arange(1000) % 300 == 0, 1000.0, right)
    assert summarize(few).warning == ""
    assert "4 of 1000 observations are impossible" in summarize(few).remark
    assert "others is 2.0" in summarize(few).remark
    few_in_all = summarize(right[:5] * 100)
    assert (few_in_all.warning, few_in_all.remark) == ("", "")


def test_rejected_labels_are_warned_of(rng):
    right = chi2.ppf((np.arange(1000) + 0.5) / 1000, 2)
    many, few = summarize(right, rejected=0.31), summarize(right, rejected=0.002)
    assert "31.0% of the labels contradict the map" in many.warning
    assert (few.warning, "0.20% of the labels" in few.remark) == ("", True)
    assert "contradict the map" in summarize(right[:5], rejected=0.5).warning


def _as_matrix(x, y, theta):
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s, x], [s, c, y], [0, 0, 1]])


@pytest.mark.parametrize("turn", [0.0, 1e-9, 0.3, -2.5])
def test_error_of_the_invariant_filter_is_what_its_exponential_does(rng, turn):
    """At the origin, where its coordinates are those of the Lie algebra, and anywhere."""
    for place in (np.zeros(2), rng.normal(size=2) * 9):
        xi, pose = rng.normal(size=2), np.array([*place, 0.7])
        generator = np.array([[0, -turn, xi[0]], [turn, 0, xi[1]], [0, 0, 0]])
        there = expm(generator) @ _as_matrix(*pose)
        truth = np.array([there[0, 2], there[1, 2], pose[2] + turn])
        root = rng.normal(size=(3, 3))
        C = root @ root.T + np.eye(3)
        # e = (xi + theta J x, theta): the position's part is turned about the place.
        e = np.array([xi[0] - turn * pose[1], xi[1] + turn * pose[0], turn])
        estimate = Trajectory(np.zeros(1), pose[None], C[None])
        found = pose_nees(estimate, Trajectory(np.zeros(1), truth[None]), "invariant")
        assert found[0] == pytest.approx(mahalanobis(e, np.zeros(3), np.linalg.inv(C)) ** 2)


def test_error_of_the_standard_filter_is_the_difference(rng):
    pose, truth = np.array([1.0, 2.0, 3.1]), np.array([1.5, 1.0, -3.1])
    e = [0.5, -1.0, 2 * np.pi - 6.2]
    root = rng.normal(size=(3, 3))
    C = np.stack([root @ root.T + np.eye(3), np.zeros((3, 3))])
    both = Trajectory(np.arange(2.0), np.stack([pose, pose]), C)
    found = pose_nees(both, Trajectory(np.arange(2.0), np.stack([truth, truth])), "standard")
    assert found[0] == pytest.approx(mahalanobis(e, np.zeros(3), np.linalg.inv(C[0])) ** 2)
    assert np.isnan(found[1])
    with pytest.raises(LogError, match="with covariance, found one without"):
        pose_nees(Trajectory(np.zeros(1), pose[None]), both, "standard")
