"""The smoothed trajectory and map of a log by GTSAM, as a peer of ours."""

import gtsam
import numpy as np

MIN_SIGMA = 1e-4


def smooth_by_gtsam(log, filtered, config, start_covariance=0.0, survey=None):
    """Poses, landmarks, their marginal covariances, and robust weights, for a log of steps.

    Every pose moves, and every observation is used. A survey has the landmarks before the log.
    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    x, m = (lambda i: gtsam.symbol("x", int(i))), (lambda j: gtsam.symbol("l", int(j)))
    for i, pose in enumerate(filtered.trajectory.pose):
        values.insert(x(i), gtsam.Pose2(*pose))
    for j, xy in enumerate(filtered.map.xy):
        values.insert(m(j), xy)
    start = _noise(start_covariance * np.eye(3))
    graph.add(gtsam.PriorFactorPose2(x(0), gtsam.Pose2(*log.start), start))
    for j, xy in enumerate([] if survey is None else survey.xy):
        graph.add(gtsam.PriorFactorPoint2(m(j), xy, _noise(survey.covariance[j])))
    for i, (u, U) in enumerate(zip(log.control, log.control_covariance, strict=True)):
        graph.add(gtsam.CustomFactor(_noise(U), [x(i), x(i + 1)], _step_error(u)))
    first, huber = graph.size(), gtsam.noiseModel.mEstimator.Huber.Create(config.huber)
    for k, (z, R) in enumerate(zip(log.observation, log.observation_covariance, strict=True)):
        robust = gtsam.noiseModel.Robust.Create(huber, _noise(R[::-1, ::-1]))  # bearing first
        key = x(log.observation_pose[k]), m(filtered.association[k])
        graph.add(gtsam.BearingRangeFactor2D(*key, gtsam.Rot2(z[1]), z[0], robust))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-15)
    settings.setAbsoluteErrorTol(1e-15)
    best = gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    marginals = gtsam.Marginals(graph, best)
    pose, pose_covariance = [], []
    for i in range(len(log.time)):
        p = best.atPose2(x(i))
        c, s = np.cos(p.theta()), np.sin(p.theta())
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        pose.append([p.x(), p.y(), p.theta()])
        pose_covariance.append(turn @ marginals.marginalCovariance(x(i)) @ turn.T)
    landmarks = range(len(filtered.map))
    xy = np.array([best.atPoint2(m(j)) for j in landmarks])
    covariance = np.array([marginals.marginalCovariance(m(j)) for j in landmarks])
    loss = np.array([graph.at(k).error(best) for k in range(first, graph.size())])
    weight = 1 / np.maximum(loss / config.huber**2 + 0.5, 1)  # loss k |e| - k^2 / 2, weight k / |e|
    return np.array(pose), np.array(pose_covariance), xy, covariance, weight


def _step_error(u):
    """Error of a step: the later pose in the frame of the earlier one, minus the control (3,).

    GTSAM's own factor between poses has the logarithm of a rigid motion instead.
    """

    def error(factor, values, jacobians):
        keys = factor.keys()
        first, second = values.atPose2(keys[0]), values.atPose2(keys[1])
        between = first.between(second)
        v = np.array([between.x(), between.y()]) - u[:2]
        turn = np.angle(np.exp(1j * (between.theta() - u[2])))
        if jacobians is not None:  # by motions of each pose in its own frame
            c, s = np.cos(between.theta()), np.sin(between.theta())
            x, y = between.x(), between.y()
            jacobians[0] = np.array([[-1.0, 0, y], [0, -1, -x], [0, 0, -1]])
            jacobians[1] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        return np.array([*v, turn])

    return error


def _noise(covariance):
    return gtsam.noiseModel.Gaussian.Covariance(covariance + MIN_SIGMA**2 * np.eye(len(covariance)))
