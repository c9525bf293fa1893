"""Calibrations beside the images, as ROS, OpenCV, Kalibr and EuRoC write them."""

import cv2
import numpy as np
import pytest
from PIL import Image as Pillow

from saccade.datasets import load_camera, load_drive
from saccade.errors import DriveError
from support.error_checks import refuses

K = np.array([[70.0, 0, 39], [0, 71.0, 31], [0, 0, 1]])
D = np.array([-0.2, 0.05, 0.001, 0.002, 0.01])
PIXELS = cv2.GaussianBlur(np.random.default_rng(5).integers(0, 255, (60, 80), np.uint8), (0, 0), 2)


def rows(matrix):
    return f"  rows: {len(matrix)}\n  cols: {matrix.shape[1]}\n  data: {matrix.ravel().tolist()}\n"


def camera_info(model="plumb_bob", offset=0.0):
    """As camera_calibration writes it, with a projection of its own."""
    P = np.c_[K + np.diag([-5.0, -5.0, 0]), [offset, 0, 0]]
    return (
        "image_width: 80\nimage_height: 60\ncamera_name: narrow_stereo\n"
        f"camera_matrix:\n{rows(K)}distortion_model: {model}\n"
        f"distortion_coefficients:\n{rows(D[None])}"
        f"rectification_matrix:\n{rows(np.eye(3))}projection_matrix:\n{rows(P)}"
    )


def message():
    """As rostopic echo prints a CameraInfo."""
    return (
        'header:\n  seq: 4\n  frame_id: "cam"\nheight: 60\nwidth: 80\n'
        f'distortion_model: "plumb_bob"\nD: {D.tolist()}\nK: {K.ravel().tolist()}\n'
        "roi:\n  x_offset: 0\n  do_rectify: False\n---\n"
    )


def kalibr(model="radtan", camera="pinhole"):
    cameras = [
        f"cam{i}:\n  T_cam_imu:\n  - [1.0, 0.0]\n  - [0.0, 1.0]\n  cam_overlaps: [1]\n"
        f"  camera_model: {camera}\n  distortion_coeffs: {D[:4].tolist()}\n"
        f"  distortion_model: {model}\n  intrinsics: [70.0, 71.0, 39.0, 31.0]\n"
        f"  resolution: [80, 60]\n  rostopic: /cam{i}/image_raw\n"
        for i in range(2)
    ]
    return "".join(cameras)


def euroc(model="radial-tangential"):
    return (
        "# General sensor definitions.\nsensor_type: camera\ncomment: VI-Sensor cam0\n\n"
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: {np.eye(4).ravel().tolist()}\n\nrate_hz: 20\n"
        "resolution: [80, 60]\ncamera_model: pinhole\nintrinsics: [70.0, 71.0, 39.0, 31.0] #fu\n"
        f"distortion_model: {model}\ndistortion_coefficients: {D[:4].tolist()}\n"
    )


def opencv(**entries):
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in entries.items():
        storage.write(name, value)
    return storage.releaseAndGetString()


def as_xml(**entries):
    storage = cv2.FileStorage(".xml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in entries.items():
        storage.write(name, value)
    return storage.releaseAndGetString()


TOML = "width=80\nheight=60\nfx=70\nfy=71\ncx=39\ncy=31\n"
SAMPLE = {"image_width": 80, "image_height": 60, "camera_matrix": K, "distortion_coefficients": D}
CALIBRATIONS = {
    "ros": ("camera_info.yaml", camera_info()),
    "ros message": ("info.yaml", message()),
    "ros of windows": ("camera.yaml", camera_info().replace("\n", "\r\n")),
    "ros in utf-16": ("ost.yaml", camera_info()),
    "kalibr": ("camchain.yaml", kalibr()),
    "euroc": ("sensor.yaml", euroc()),
    "opencv yaml": ("out_camera_data.yml", opencv(**SAMPLE)),
    "opencv xml": ("out_camera_data.xml", as_xml(**SAMPLE)),
    "opencv stereo": ("intrinsics.yml", opencv(M1=K, D1=D[None], M2=K, D2=D[None])),
    "python": ("calibration.yaml", f"camera_matrix: {K.tolist()}\ndist_coeff: {[D.tolist()]}\n"),
}


@pytest.fixture
def write(tmp_path):
    """A function that writes the images of some folders and a text beside them."""

    def make(text, name="camera_info.yaml", folders=("images",)):
        for folder in folders:
            (tmp_path / folder).mkdir(exist_ok=True, parents=True)
            for i in range(3):
                Pillow.fromarray(PIXELS).save(tmp_path / folder / f"frame{i}.png")
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path

    return make


@pytest.mark.parametrize("where", ["", "images/"])
@pytest.mark.parametrize("kind", CALIBRATIONS)
def test_calibrations_of_other_programs_are_read(write, kind, where):
    name, text = CALIBRATIONS[kind]
    folder = write(text, where + name)
    if "utf-16" in kind:
        (folder / where / name).write_text(text, encoding="utf-16")
    drive = load_drive("auto", folder)
    camera = drive.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (70, 71, 39, 31)
    assert not any("guessed" in each for each in drive.assumptions)
    coefficients = D[:4] if kind in ("kalibr", "euroc") else D
    expected = cv2.undistort(PIXELS, K, coefficients)
    np.testing.assert_allclose(drive.load(1).image, expected, atol=2)
    assert np.abs(expected.astype(float) - PIXELS).max() > 20


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("any.yaml", kalibr("equidistant")),
        ("sensor.yaml", euroc("equidistant")),
        ("fish.yml", opencv(**SAMPLE | {"distortion_coefficients": D[:4]}, fisheye_model=1)),
        ("camera.toml", f"{TOML}lens = 'fisheye'\ndistortion = {D[:4].tolist()}\n"),
    ],
)
def test_images_of_a_fisheye_lens_are_undistorted(write, name, text):
    drive = load_drive("auto", write(text, name))
    assert not drive.camera.is_distorted
    expected = cv2.fisheye.undistortImage(PIXELS, K, D[:4], Knew=K)
    np.testing.assert_allclose(drive.load(1).image, expected, atol=2)


def test_a_camera_is_read_from_its_file(tmp_path):
    """As `verify` takes it, for images that are in no drive."""
    path = tmp_path / "left.yml"
    path.write_text(opencv(camera_matrix=K, distortion_coefficients=D))
    camera = load_camera(path, (80, 60))
    np.testing.assert_allclose(camera.matrix, K)
    xyz = np.array([[0.1, -0.2, 1], [0.3, 0.1, 2]])
    theirs = cv2.projectPoints(xyz, np.zeros(3), np.zeros(3), K, D)[0][:, 0]
    np.testing.assert_allclose(camera.project(xyz), theirs, atol=1e-9)
    with pytest.raises(DriveError, match=r"left\.yml: width: expected"):
        load_camera(path)
    (tmp_path / "camera.toml").write_text(f"{TOML}distortion = {D.tolist()}\n")
    assert load_camera(tmp_path / "camera.toml").distortion == tuple(D)


def test_the_rational_model_has_eight_coefficients(write):
    wide = np.array([-0.2, 0.05, 0.001, 0.002, 0.01, 0.02, 0.01, 0.003])
    text = opencv(**SAMPLE | {"distortion_coefficients": wide})
    drive = load_drive("auto", write(text, "wide.yml"))
    np.testing.assert_allclose(drive.load(1).image, cv2.undistort(PIXELS, K, wide), atol=2)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("camera_info.yaml", camera_info("equidistant")),  # with five coefficients
        ("any.yaml", kalibr("fov")),
        ("wide.yml", opencv(**SAMPLE | {"distortion_coefficients": np.full(7, 0.1)})),
        ("any.yaml", kalibr("radtan", "omni")),
        ("fish.yml", opencv(**SAMPLE, fisheye_model=1)),
        ("calib.txt", "EquiDistant 70 71 39 31 0.1 0 0 0\n80 60\ncrop\n80 60\n"),
        ("calib.txt", "KannalaBrandt8: 70 71 39 31\n"),
        ("calib.txt", "Pinhole 70 71 39 31 0\n80 60\ncrop\n80 60\n"),
        ("camera.toml", "width=80\nheight=60\nfx=70\nfy=71\ncx=39\ncy=31\nmodel='fisheye'\n"),
        ("camera_info.yaml", "camera_matrix: [1, 2\nb: {\n"),
        ("calib.xml", "<opencv_storage>"),
        ("calib.yaml", "- a\n- b\n"),
    ],
)
def test_other_lens_models_and_broken_files_are_refused(write, name, text):
    with refuses(DriveError, name, "expected"):
        load_drive("auto", write(text, name))


@pytest.mark.parametrize("text", ["", "a: [1, 2\n", "- 1\n- 2\n", "gain: 4\n", "\0\1\2"])
def test_other_files_are_no_calibration(write, text):
    (guessed, *_) = load_drive("auto", write(text, "notes.yaml")).assumptions
    assert "guessed a focal length" in guessed


def test_rectified_images_have_the_projection(write):
    """The images of a pair need no undistortion by their folders, and have a baseline."""
    folder = write(camera_info(), "left.yaml", ("left/rect", "right/rect"))
    (folder / "right.yaml").write_text(camera_info(offset=-65.0 * 0.3))
    for side in ("left", "right"):
        (folder / side / "rect").rename(folder / f"{side}_rect")
        (folder / side).rmdir()
    (folder / "left_rect").rename(folder / "image_rect")
    drive = load_drive("auto", folder / "image_rect")
    assert "guessed" in drive.assumptions[0]  # nothing lies beside these
    (folder / "left.yaml").rename(folder / "image_rect" / "left.yaml")
    drive = load_drive("auto", folder / "image_rect")
    assert drive.camera.fx == 65
    np.testing.assert_array_equal(drive.load(1).image, PIXELS)


def test_a_pair_has_the_baseline_of_its_projections(write):
    text = camera_info().replace(str(D.tolist()), str([0.0] * 5))
    folder = write(text, "left.yaml", ("left", "right"))
    right = camera_info(offset=-65.0 * 0.3).replace(str(D.tolist()), str([0.0] * 5))
    (folder / "right.yaml").write_text(right)
    drive = load_drive("auto", folder)
    assert drive.camera.baseline == pytest.approx(0.3)
    assert drive.camera.fx == 65
    np.testing.assert_array_equal(drive.load(1).right, PIXELS)
    folder.joinpath("right.yaml").write_text(camera_info(offset=-65.0 * 0.3))
    folder.joinpath("left.yaml").write_text(camera_info())
    raw = load_drive("auto", folder)
    assert raw.load(1).right is None
    assert raw.camera.fx == 70
