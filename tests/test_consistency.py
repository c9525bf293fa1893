"""NIS and NEES against SciPy's distributions and sampled errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import mahalanobis
from scipy.stats import chi2

from saccade.errors import ConfigError
from saccade.slam.consistency import (
    chi_square_band,
    chi_square_gate,
    normalized_squared,
    summarize,
)


@given(st.integers(1, 10), st.integers(1, 500), st.floats(0.5, 0.999))
def test_band_holds_the_mean_with_its_probability(dof, count, confidence):
    low, high = chi_square_band(dof, count, confidence)
    below, above = chi2.cdf(np.array([low, high]) * count, dof * count)
    assert above - below == pytest.approx(confidence, abs=1e-9)
    assert below == pytest.approx(1 - above, abs=1e-9)


def test_band_of_fifty_runs_in_three_dimensions_is_the_published_one():
    np.testing.assert_allclose(chi_square_band(3, 50), [2.36, 3.72], atol=0.005)


def test_gate_of_two_degrees_is_the_exponential():
    for confidence in (0.5, 0.99, 0.9999):
        gate = chi_square_gate(2, confidence)
        assert gate == pytest.approx(-2 * np.log(1 - confidence), rel=1e-12)


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
    assert "are 3.0 times as large" in summarize(right * 9).warning
    cautious = summarize(right / 4)
    assert cautious.warning == ""
    assert "cautious, the innovations are 0.50 of" in cautious.remark
    outliers = np.where(rng.random(1000) < 0.05, 100.0, right)
    assert "% of the observations are impossible" in summarize(outliers).warning
    few = np.where(np.arange(1000) % 300 == 0, 1000.0, right)
    assert summarize(few).warning == ""
    assert "4 of 1000 observations are impossible" in summarize(few).remark
    assert "others is 2.0" in summarize(few).remark
    few_in_all = summarize(right[:5] * 100)
    assert (few_in_all.warning, few_in_all.remark) == ("", "")
