import numpy as np

from out_and_back import OutAndBackConfig, out_and_back
from saccade.frames import Camera, Drive, Frame
from saccade.plane import steps_between
from saccade.types import Trajectory

EXACT = OutAndBackConfig(20, 0, 0, 0, 0)


def winding(n=20):
    time = np.arange(n) / 10.0
    pose = np.stack([time * 2, np.sin(time), np.sin(3 * time)], 1)
    return Drive(
        name="winding",
        camera=Camera(64, 48, 50, 50, 32, 24),
        time=time,
        control=np.zeros((n - 1, 3)),
        control_covariance=np.zeros((n - 1, 3, 3)),
        load=lambda i: Frame(time[i], image=np.full((48, 64), i, np.uint8)),
        truth=Trajectory(time, pose),
    )


def test_no_frame_comes_twice_and_the_way_back_is_in_reverse():
    drive = winding()
    there = out_and_back(drive, EXACT)
    seen = [int(there.load(i).image[0, 0]) for i in range(len(there))]
    assert sorted(seen) == list(range(20))
    assert seen[:3] == [0, 2, 4]
    assert seen[-2:] == [3, 1]
    np.testing.assert_allclose(there.truth.pose, drive.truth.pose[seen])
    np.testing.assert_allclose([there.load(i).time for i in range(20)], there.time)
    assert (there.control[11:, 0] < 0).all()


def test_covariances_are_those_of_the_errors_that_are_drawn():
    config = OutAndBackConfig(20, scale_percent=0)
    drives = [out_and_back(winding(), config, seed) for seed in range(400)]
    exact = steps_between(drives[0].truth.pose)
    errors = np.array([drive.control - exact for drive in drives])
    expected = np.mean([drive.control_covariance for drive in drives], 0)
    np.testing.assert_allclose(errors[..., 0].std(0), np.sqrt(expected[:, 0, 0]), rtol=0.15)
    heading = errors[..., 2].sum(1)
    reached = np.sqrt(np.square(heading).mean())
    np.testing.assert_allclose(reached, np.sqrt(expected[:, 2, 2].sum()), rtol=0.15)
