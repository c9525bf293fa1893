"""Tags in rendered images, compared with the renderer's truth and with OpenCV."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.backends.backend_pdf import PdfPages

from saccade import TagConfig, Tags, slam, visual
from saccade.diagnostics.tag_calibration import check_tags
from saccade.errors import ConfigError, DriveError, LogError
from saccade.frames import Camera
from saccade.simulation import DriveConfig, simulate_drive, tag_layout
from saccade.simulation.wall_tags import place_tags
from saccade.tags import FAMILIES, observe_tags, parse_ids, parse_sizes, tag_cells
from support.nightly import nightly
from support.tag_rooms import (
    Lens,
    Room,
    Tag,
    camera_of,
    camera_pose,
    carried,
    drive_of,
    film_tag,
    paint_tag,
    painter_of,
)

POSITION = np.array([0.1, 0.0, 0.35])
EXACT = TagConfig(size=0.165, size_sigma=0.0, focal_sigma=0.0, tilt_sigma_deg=0.0)


def views(lens, count=60):
    """Images of single tags at random distances and angles, and the tags."""
    painter, rng = painter_of(lens), np.random.default_rng(1)
    R, center = camera_pose(np.zeros(3), POSITION)
    for number in range(count):
        distance = rng.uniform(0.5, 4.0)
        left, up = rng.uniform(-0.3, 0.3, 2) * distance
        angle = np.pi + np.arctan2(left, distance) + rng.uniform(-1, 1) * np.deg2rad(60)
        tag = Tag(int(rng.integers(500)), (0.1 + distance, left, 0.35 + 0.6 * up), angle)
        canvas = painter.canvas()
        paint_tag(painter, canvas, tag, R, center)
        yield painter.expose(canvas, np.random.default_rng(number)), tag


def pinhole(lens):
    return Camera.from_matrix(
        lens.matrix, lens.size, distortion=lens.distortion, position=POSITION.copy()
    )


def true_observation(tag):
    x, y, _ = tag.center
    return np.array([np.hypot(x, y), np.arctan2(y, x)])


@pytest.mark.parametrize(
    "lens",
    [
        Lens(blur=1.0, noise=6.0, distortion=(-0.2, 0.05, 0.001, -0.001, 0.0)),
        *nightly(Lens(blur=0.3, noise=2.0)),
    ],
)
def test_ranges_and_bearings_have_their_covariance(lens):
    detector, camera, squared, relative = Tags(EXACT), pinhole(lens), [], []
    for image, tag in views(lens):
        seen = detector(image, camera)
        assert set(seen.id.tolist()) <= {tag.id}
        for z, R in zip(seen.z, seen.R, strict=True):
            error = z - true_observation(tag)
            squared.append(error @ np.linalg.solve(R, error))
            relative.append(error[0] / z[0])
    assert len(squared) > 45
    assert 0.2 < np.median(squared) < 2.8  # 1.39 for two degrees of freedom
    assert 0.7 < np.mean(np.minimum(squared, 30)) < 4.0  # 2
    assert np.median(np.abs(relative)) < 0.003


def test_corners_are_nearer_to_the_truth_than_those_of_opencv():
    lens = Lens()
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    peer, detector = cv2.aruco.ArucoDetector(dictionary, settings), Tags()
    R, center = camera_pose(np.zeros(3), POSITION)
    ours, theirs = [], []
    for image, tag in views(lens, 30):
        true = (tag.corners - center) @ R @ lens.matrix.T
        true = true[:, :2] / true[:, 2:]
        found, seen = peer.detectMarkers(image)[0], detector(image)
        for errors, corners in ((ours, seen.corners), (theirs, np.reshape(found, (-1, 4, 2)))):
            errors += [
                min(np.abs(np.roll(each, k, 0) - true).max() for k in range(4)) for each in corners
            ]
    assert np.median(ours) < 0.1
    assert np.median(ours) < 0.5 * np.median(theirs)


def test_the_center_is_that_of_solve_pnp():
    lens = Lens(blur=0.3, noise=0.0)
    tag = Tag(7, (2.0, 0.3, 0.5), np.pi + 0.4)
    image = film_tag(tag, lens, np.zeros(3), POSITION)
    camera = pinhole(lens)
    seen = Tags(EXACT)(image, camera)
    half = 0.165 / 2
    square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    _, _, t = cv2.solvePnP(square, seen.corners[0], lens.matrix, None, flags=cv2.SOLVEPNP_IPPE)
    x, y, height = POSITION + camera.rotation @ t.ravel()
    assert seen.z[0] == pytest.approx([np.hypot(x, y), np.arctan2(y, x)], abs=2e-3)
    assert seen.height[0] == pytest.approx(height, abs=2e-3)
    assert seen.labels == ["tag36h11:7"]
    assert seen.xy[0] == pytest.approx(camera.project(t.T)[0], abs=0.1)


def test_the_mounting_and_the_pan_apply():
    lens, tag = Lens(), Tag(3, (1.0, 2.0, 0.5), -np.pi / 2)
    c, s = np.cos(1.0), np.sin(1.0)
    turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    camera = pinhole(lens)
    camera = replace(camera, rotation=turned @ camera.rotation)
    image = film_tag(tag, lens, np.zeros(3), POSITION, camera.rotation)
    assert Tags(EXACT)(image, camera).z[0] == pytest.approx(true_observation(tag), abs=0.01)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_is_detected(family):
    cells = np.kron(np.pad(tag_cells(family, 3), 1, constant_values=True), np.ones((9, 9)))
    image = np.pad((255 * cells).astype(np.uint8), 40, constant_values=255)
    assert Tags(TagConfig(family))(image).labels == [f"{family}:3"]


@pytest.mark.parametrize("family", ["tag36h11", "aruco_mip_36h12"])
def test_three_wrong_cells_are_corrected_and_six_are_not(family):
    """Codes of a least distance of 11 or 12 correct 5 cells, of which OpenCV tries .6."""
    for wrong, labels in ((3, [f"{family}:3"]), (6, [])):
        cells = tag_cells(family, 3).copy()
        cells[[1, 2, 3, 4, 5, 6][:wrong], [2, 5, 1, 6, 3, 4][:wrong]] ^= True
        scene = np.kron(np.pad(cells, 2, constant_values=True), np.ones((9, 9)))
        assert Tags(TagConfig(family))(scene.astype(np.float32)).labels == labels


def test_images_of_any_kind_and_without_tags():
    image = film_tag(Tag(5, (1.0, 0.0, 0.4), np.pi), Lens(), np.zeros(3), POSITION)
    for each in (image, np.repeat(image[:, :, None], 3, 2), image.astype(np.float32) / 255):
        assert Tags()(each).labels == ["tag36h11:5"]
    nothing = Tags(TagConfig(size=0.1))(np.full((480, 640), 128, np.uint8), pinhole(Lens()))
    assert len(nothing) == 0
    assert nothing.z.shape == (0, 2)


def test_sizes_by_id():
    image = film_tag(Tag(5, (1.0, 0.0, 0.4), np.pi), Lens(), np.zeros(3), POSITION)
    camera = pinhole(Lens())
    assert Tags(TagConfig(size={5: 0.33}))(image, camera).z[0, 0] == pytest.approx(1.9, abs=0.02)
    assert len(Tags(TagConfig(size={6: 0.33}))(image, camera)) == 0
    assert parse_sizes("0-2=0.1,7=0.3") == {0: 0.1, 1: 0.1, 2: 0.1, 7: 0.3}
    assert parse_ids("3,5-6") == [3, 5, 6]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"family": "tag99"}, "family: expected one of tag16h5, .*found 'tag99'"),
        ({"size": 0}, "size: expected the side of the black square in meters, above 0, found 0"),
        ({"size": 165}, r"not millimeters \(165 mm are 0.165 m\)"),
        ({"size": {"a": 0.1}}, "size: expected a table by ids of tags, found 'a'"),
        ({"size": float("nan")}, "size: expected the side"),
    ],
)
def test_invalid_settings_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        TagConfig(**settings)


@pytest.fixture(scope="module")
def room():
    return Room(seed=5, frames=60, laps=0.9)


@pytest.fixture(scope="module")
def seen(room):
    return observe_tags(drive_of(room), TagConfig(size=0.165))


def rmse(result, log):
    error = result.trajectory.pose[:, :2] - log.truth.pose[:, :2]
    return np.sqrt(np.square(error).sum(1).mean())


def test_tags_of_a_drive_are_mapped_and_locate_a_robot(room, seen):
    made = slam.run(seen.log)
    assert rmse(made, seen.log) <= 0.08
    assert sorted(made.map.names) == sorted(set(seen.log.names))
    located = slam.run(seen.log, initial=slam.Slam(map=room.survey, mode="localize"))
    assert rmse(located, seen.log) <= 0.025
    moved = carried(seen.log, 27, 40)
    found = slam.run(moved, initial=slam.Slam(map=room.survey, mode="localize"))
    assert rmse(found, moved) <= 0.2


def test_a_wrong_size_is_named(room, seen):
    assert check_tags(seen.log, seen.axis, 0.165, room.survey) == ()
    wrong = observe_tags(drive_of(room), TagConfig(size=0.165 * 1.03))
    found = check_tags(wrong.log, wrong.axis, 0.165 * 1.03, room.survey)
    assert found[0].check == "tag size"
    assert found[0].value == pytest.approx(-100 * (1 - 1 / 1.03), abs=0.5)


def test_a_wrong_mounting_is_named(room):
    camera = camera_of(room)
    turn = np.deg2rad(3)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ camera.rotation
    wrong = observe_tags(drive_of(room, replace(camera, rotation=rotation)), TagConfig(size=0.165))
    found = check_tags(wrong.log, wrong.axis, 0.165, room.survey)
    assert "camera yaw" in [each.check for each in found]
    yaw = next(each.value for each in found if each.check == "camera yaw")
    assert yaw == pytest.approx(-3, abs=0.5)


def test_a_second_camera_adds_its_tags(room):
    first = replace(room, frames=5)
    behind = np.diag([-1.0, -1.0, 1.0]) @ room.rotation
    second = drive_of(replace(first, rotation=behind))
    second = replace(
        second,
        time=second.time[:-1] + 0.05,
        control=second.control[:-1],
        control_covariance=second.control_covariance[:-1],
    )
    one = observe_tags(drive_of(first), TagConfig(size=0.165)).log
    both = observe_tags(drive_of(first), TagConfig(size=0.165), others=[second]).log
    assert len(both.time) == 9
    assert len(both.observation) > len(one.observation)
    assert both.control[:2, 2].sum() == pytest.approx(one.control[0, 2])


def test_drives_without_odometry_or_tags_are_refused(room):
    drive = drive_of(replace(room, frames=5))
    with pytest.raises(LogError, match=r"tag25h9.*none in 5 frames"):
        observe_tags(drive, TagConfig("tag25h9", 0.165))
    none = replace(drive, has_odometry=False)
    with pytest.raises(DriveError, match="expected odometry"):
        observe_tags(none, TagConfig(size=0.165))
    with pytest.raises(ConfigError, match="size"):
        observe_tags(drive, TagConfig())


def test_tags_join_the_landmarks_of_images():
    config = replace(DriveConfig.hall(), tags=6, frames=16)
    drive = simulate_drive(config, 3)
    result = visual.run(drive, tags=TagConfig(size=config.tag_size))
    assert set(result.tags.values()) <= set(result.map.names.tolist())
    assert len(result.tags) >= 2
    assert len(result.map) > len(result.tags)
    place = dict(zip(*(getattr(tag_layout(config, 3), e) for e in ("names", "xy")), strict=True))
    for name, xy in zip(result.map.names, result.map.xy, strict=True):
        assert name not in place or np.hypot(*(xy - place[name])) < 0.4
    with pytest.raises(DriveError, match="scale is unknown"):
        visual.run(replace(drive, scale="held"), tags=TagConfig(size=0.4))


def test_simulated_tags_are_where_the_layout_has_them():
    config = replace(DriveConfig.hall(), tags=6, frames=60)
    drive, layout = simulate_drive(config, 3).until(36), tag_layout(config, 3)
    log = observe_tags(drive, TagConfig(size=config.tag_size)).log
    place = dict(zip(layout.names.tolist(), layout.xy, strict=True))
    pose = drive.truth.pose[log.observation_pose]
    offset = np.array([place[name] for name in log.names.tolist()]) - pose[:, :2]
    ranges = np.hypot(*offset.T)
    assert np.median(np.abs(log.observation[:, 0] / ranges - 1)) < 0.01
    with pytest.raises(ConfigError, match="tags"):
        tag_layout(DriveConfig.hall())


@pytest.mark.parametrize("count", [30, 80])
def test_tags_of_a_simulated_drive_do_not_hang_over_each_other(count):
    config = replace(DriveConfig.hall(), tags=count)
    corners = np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 6.0), (0.0, 6.0), (0.0, 0.0)])
    tags = place_tags(config, corners, [], np.random.default_rng(count))
    along = np.array([tag.along for tag in tags])
    assert len(tags) > count / 3
    assert np.diff(np.sort(along)).min() > 1.25 * config.tag_size  # the tag and its white border


def test_printed_tags_have_their_size(run, monkeypatch):
    """OpenCV finds the tags on the pages, as they are drawn at 100 pixels per inch."""
    pages, write = [], PdfPages.savefig
    monkeypatch.setattr(
        PdfPages, "savefig", lambda self, page: (pages.append(page), write(self, page))
    )
    assert run("tags", "--ids", "3,5", "--size", "0.08", "tags.pdf")[0] == 0
    assert Path("tags.pdf").read_bytes().startswith(b"%PDF")
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for page, expected in zip(pages, (3, 5), strict=True):
        drawing = BytesIO()
        page.savefig(drawing, format="png", dpi=100)
        image = cv2.imdecode(np.frombuffer(drawing.getvalue(), np.uint8), cv2.IMREAD_GRAYSCALE)
        (corners,), ids, _ = cv2.aruco.ArucoDetector(family).detectMarkers(image)
        assert ids.item() == expected
        sides = np.hypot(*(corners[0] - np.roll(corners[0], 1, axis=0)).T)
        np.testing.assert_allclose(sides, 80 / 25.4 * 100, atol=2)
