"""Camera drives in the layouts of others, written here as their sources write them."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fuzz.targets import TARGETS
from saccade.datasets import load_drive
from saccade.io.video import video_writer

POINT = np.array([[0.4, -0.25, 4.0]])
"""Where a bright dot is in the left camera's frame, in metres."""


def dotted(xy, shape=(120, 160)):
    """An image with a dot (uint8) at a place between the pixels."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    apart = np.square(x - xy[0]) + np.square(y - xy[1])
    return np.rint(255 * np.exp(-apart / 8)).astype(np.uint8)


def dot(image):
    """Where it is."""
    image = image if image.ndim == 2 else image[..., 0]
    weight = np.where(image > 5, image, 0).astype(float)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


def seen(K, distortion, turn=(0.0, 0.0, 0.0), moved=(0.0, 0.0, 0.0)):
    """Where the point is in the image of a bent lens, by OpenCV."""
    xy, _ = cv2.projectPoints(POINT, np.array(turn), np.array(moved), K, np.array(distortion))
    return xy.ravel()


def save(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), image)


def turned_poses(n=6, step=0.5, turn=0.2):
    """Poses of a camera (x right, y down, z ahead) that drives a curve to the right:
    n places (n, 3), n quaternions x, y, z, w."""
    angle = turn * np.arange(n)
    place = np.cumsum(step * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1), 0)
    nothing = np.zeros(n)
    return place, np.stack([nothing, np.sin(angle / 2), nothing, np.cos(angle / 2)], 1)


class TestTum:
    def write(self, folder, rows=6):
        K = np.array([[517.3, 0, 318.6], [0, 516.5, 255.3], [0, 0, 1]])
        bent = (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
        image = cv2.cvtColor(dotted(seen(K, bent), (480, 640)), cv2.COLOR_GRAY2BGR)
        depth = np.zeros((480, 640), np.uint16)
        depth[200:260, 300:420] = 20000  # 4 m
        lines = {"rgb": [], "depth": []}
        for i in range(rows):
            save(folder / "rgb" / f"{i}.png", image)
            save(folder / "depth" / f"{i}.png", depth)
            lines["rgb"].append(f"{1305031102.175 + i / 30:.6f} rgb/{i}.png")
            lines["depth"].append(f"{1305031102.160 + i / 30:.6f} depth/{i}.png")
        del lines["depth"][2]
        for name, listed in lines.items():
            (folder / f"{name}.txt").write_text("# timestamp filename\n" + "\n".join(listed))
        place, turn = turned_poses(rows)
        time = 1305031102.175 + np.arange(rows) / 30
        np.savetxt(folder / "groundtruth.txt", np.column_stack([time, place, turn]), fmt="%.6f")
        return folder

    def test_images_are_straight_and_depth_is_beside_them(self, tmp_path):
        drive = load_drive("auto", self.write(tmp_path / "rgbd_dataset_freiburg1_xyz"))
        assert len(drive) == 6
        frame = drive.load(1)
        expected = [517.3 * 0.1 + 318.6, 516.5 * -0.0625 + 255.3]
        np.testing.assert_allclose(dot(frame.image), expected, atol=0.05)
        assert frame.depth[int(expected[1]), int(expected[0])] == pytest.approx(4.0)
        assert np.isnan(frame.depth[0, 0])
        assert drive.load(2).depth is None

    def test_truth_is_that_of_the_robot_under_the_camera(self, tmp_path):
        drive = load_drive("tum-rgbd", self.write(tmp_path / "fr1"))
        np.testing.assert_allclose(drive.truth.pose[:, 2], -0.2 * np.arange(6), atol=1e-5)
        steps = np.diff(drive.truth.pose[:, :2], axis=0)
        heading = drive.truth.pose[1:, 2]
        along = np.stack([np.cos(heading), np.sin(heading)], 1) * 0.5
        np.testing.assert_allclose(steps, along, atol=1e-5)

    def test_frames_out_of_order_or_twice_are_mended_and_told(self, tmp_path):
        folder = self.write(tmp_path / "fr1")
        lines = (folder / "rgb.txt").read_text().splitlines()
        shuffled = [lines[0], lines[2], lines[1], *lines[3:], lines[4]]
        (folder / "rgb.txt").write_text("\n".join(shuffled))
        drive = load_drive("tum-rgbd", folder)
        assert len(drive) == 6
        assert (np.diff(drive.time) > 0).all()
        assert "time goes back 2 times, first at frame 1" in drive.remarks[0]
        assert "duplicate times: 1, first at frame 6" in drive.remarks[1]


CAMERA = "width = 64\nheight = 48\nfx = 50\nfy = 50\ncx = 32\ncy = 24\nrate = 20\n"


class TestFolder:
    def write(self, folder, n=12):
        for i in range(n):
            save(folder / f"{i}.png", np.full((48, 64), 10 * i, np.uint8))
        (folder / "camera.toml").write_text(CAMERA)
        return folder

    def test_images_come_in_the_order_of_their_numbers(self, tmp_path):
        drive = load_drive("auto", self.write(tmp_path))
        assert [drive.load(i).image[0, 0] for i in range(12)] == [10 * i for i in range(12)]
        np.testing.assert_allclose(drive.time, np.arange(12) / 20)

    def test_odometry_and_truth_lie_beside_them(self, tmp_path):
        folder = self.write(tmp_path)
        (folder / "odometry.csv").write_text(
            "# wheels\ntime_s,ahead_mps,turn_radps\n"
            + "".join(f"{t / 10},2,0.5\n" for t in range(7))
        )
        (folder / "groundtruth.tum").write_text("0 3 4 0 0 0 0.6 0.8\n0.6 3 5 0 0 0 0.6 0.8\n")
        drive = load_drive("folder", folder)
        chord = 2 * 2 / 0.5 * np.sin(0.5 * 0.05 / 2)  # of an arc of radius v / w
        np.testing.assert_allclose(np.hypot(*drive.control[:, :2].T), chord)
        np.testing.assert_allclose(drive.control[:, 2], 0.025)
        np.testing.assert_allclose(drive.start, [3, 4, 2 * np.arctan2(0.6, 0.8)])

    def test_a_video_is_a_drive_even_if_it_is_cut(self, tmp_path):
        rng = np.random.default_rng(0)
        frames = [np.repeat(rng.integers(0, 255, (48, 64, 1), np.uint8), 3, 2) for _ in range(30)]
        with video_writer(tmp_path / "way.avi", 10) as write:
            for frame in frames:
                write(frame)
        (tmp_path / "camera.toml").write_text(CAMERA)
        drive = load_drive("auto", tmp_path / "way.avi")
        assert len(drive) == 30
        np.testing.assert_allclose(drive.time, np.arange(30) / 10)
        forth = [drive.load(i).image for i in range(30)]
        for i in (29, 3, 3, 17, 0):
            np.testing.assert_array_equal(drive.load(i).image, forth[i])
        data = (tmp_path / "way.avi").read_bytes()
        (tmp_path / "cut.avi").write_bytes(data[: len(data) // 2])
        cut = load_drive("auto", tmp_path / "cut.avi")
        assert 5 < len(cut) < 25
        np.testing.assert_array_equal(cut.load(4).image, forth[4])


def euroc_rig(folder, turned):
    """EuRoC's layout: a checkered wall at 4 m, from two cameras that converge by `turned` rad."""
    K = np.array([[60.0, 0, 40], [0, 60, 30], [0, 0, 1]])
    for side in (0, 1):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec((0, -turned * side, 0)).as_matrix()
        pose[0, 3] = 0.2 * side
        (folder / f"cam{side}" / "data").mkdir(parents=True)
        (folder / f"cam{side}" / "sensor.yaml").write_text(
            f"T_BS:\n  cols: 4\n  rows: 4\n  data: {pose.ravel().tolist()}\nrate_hz: 20\n"
            "resolution: [80, 60]\ncamera_model: pinhole\nintrinsics: [60, 60, 40, 30]\n"
            "distortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n"
        )
        x, y = np.meshgrid(np.arange(80), np.arange(60))
        rays = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(K).T @ pose[:3, :3].T
        wall = pose[0, 3] + 4 * rays[..., 0] / rays[..., 2], 4 * rays[..., 1] / rays[..., 2]
        pixels = 128 + 60 * np.sin(5 * wall[0]) + 60 * np.sin(6 * wall[1])
        for i in range(3):
            name = f"{1403636579763555584 + i * 50_000_000}.png"
            cv2.imwrite(str(folder / f"cam{side}" / "data" / name), pixels.astype(np.uint8))


@pytest.mark.parametrize("turned", [0.0, 0.05])
def test_a_pair_in_the_layout_of_euroc_is_rectified(tmp_path, turned):
    euroc_rig(tmp_path / "V1" / "mav0", turned)
    truth = tmp_path / "V1" / "mav0" / "state_groundtruth_estimate0"
    truth.mkdir()
    rows = [f"{1403636579763555584 + i * 50_000_000},0,0,{i},1,0,0,0,0" for i in range(3)]
    (truth / "data.csv").write_text("\n".join(["#timestamp,x,y,z,qw,qx,qy,qz,v", *rows]))
    drive = load_drive("auto", tmp_path / "V1")
    assert drive.name == "V1"
    assert (drive.camera.fx, drive.camera.cy) == (60, 30)
    assert drive.camera.baseline == pytest.approx(0.2)
    np.testing.assert_allclose(np.diff(drive.time), 0.05, atol=1e-6)
    np.testing.assert_allclose(drive.truth.pose[:, 0], (0, 1, 2), atol=0.01)
    frame = drive.load(1)
    disparity = 60 * 0.2 / 4
    left, right = (each[15:45].astype(float) for each in (frame.image, frame.right))
    errors = [np.abs(left[:, 30:60] - right[:, 30 - d : 60 - d]).mean() for d in range(8)]
    assert np.argmin(errors) == round(disparity)
    assert min(errors) < 4


@pytest.mark.parametrize("text", ["focal_length: 60\npp: 40 30\n", "focal_length = 60, pp = 40 30"])
def test_calib_may_name_focal_length_and_principal_point(tmp_path, text):
    (tmp_path / "image_0").mkdir()
    cv2.imwrite(str(tmp_path / "image_0" / "000000.png"), np.zeros((60, 80), np.uint8))
    (tmp_path / "calib.txt").write_text(text.replace(", ", "\n"))
    camera = load_drive("auto", tmp_path).camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (60, 60, 40, 30)


def test_the_camera_of_tum_is_in_the_header_of_its_list(tmp_path):
    TARGETS["tum-list"].make(tmp_path)
    (tmp_path / "camera.toml").unlink()
    rows = (tmp_path / "rgb.txt").read_text()
    (tmp_path / "rgb.txt").write_text(f"# file: 'rgbd_dataset_freiburg2_desk.bag'\n{rows}")
    assert load_drive("auto", tmp_path).camera.fx == 520.9


def test_colors_and_depth_may_lie_side_by_side(tmp_path):
    for name, value in (("rgb", 90), ("depth", 2000)):
        (tmp_path / name).mkdir()
        pixels = np.full((60, 80), value, np.uint16 if name == "depth" else np.uint8)
        cv2.imwrite(str(tmp_path / name / "0.png"), pixels)
    frame = load_drive("auto", tmp_path).load(0)
    assert frame.image[0, 0] == 90
    assert frame.depth[0, 0] == 2.0
