"""Logs that are made of logs, and their scans one by one."""

from dataclasses import replace

import numpy as np

from saccade.slam.filter.robot_models import wrap


def without_names(log):
    """The log, whose landmarks nobody has named."""
    return replace(log, landmark=np.full_like(log.landmark, -1))


def with_observations(log, kept):
    """The log with some of its observations alone."""
    return replace(
        log,
        observation_pose=log.observation_pose[kept],
        observation=log.observation[kept],
        observation_covariance=log.observation_covariance[kept],
        landmark=log.landmark[kept],
    )


def between(log, first, last):
    """The log from one pose to another, with their observations."""
    kept = (log.observation_pose >= first) & (log.observation_pose <= last)
    observed = with_observations(log, kept)
    return replace(
        observed,
        time=log.time[first : last + 1],
        control=log.control[first:last],
        control_covariance=log.control_covariance[first:last],
        observation_pose=observed.observation_pose - first,
    )


def scan_of(log, step):
    """The arguments of `Slam.step`."""
    k = log.observation_pose == step
    moved = [log.control[step - 1], log.control_covariance[step - 1]] if step else [None, None]
    arrays = log.observation, log.observation_covariance, log.landmark
    return (log.time[step], *moved, *(each[k] for each in arrays))


def mounted(log, sensor, seed=0):
    """The log as a sensor elsewhere on the robot records it, by the true poses and landmarks."""
    rng = np.random.default_rng(seed)
    x, y, heading = log.truth.pose[log.observation_pose].T
    ahead, left, yaw = sensor
    at_x = x + ahead * np.cos(heading) - left * np.sin(heading)
    at_y = y + ahead * np.sin(heading) + left * np.cos(heading)
    dx, dy = (log.landmark_truth.xy[log.landmark] - np.stack([at_x, at_y], 1)).T
    sigma = np.sqrt(log.observation_covariance.diagonal(axis1=1, axis2=2))
    z = np.stack([np.hypot(dx, dy), wrap(np.arctan2(dy, dx) - heading - yaw)], 1)
    z += sigma * rng.standard_normal(z.shape)
    return replace(log, observation=np.abs(z) * [1, 0] + z * [0, 1])
