"""Rooms with tags on their walls, rendered by homographies of OpenCV, independent of `simulation`.

A camera on a robot films a convex room. Surfaces and tags are warped at several samples per pixel,
distorted by OpenCV's model of a lens, averaged, blurred, and given noise.
"""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import cv2
import numpy as np

from saccade.frames import AHEAD, Camera, CameraTurn, Drive, Frame
from saccade.types import LandmarkMap, Trajectory

SAMPLES = 2
"""Samples per pixel, across and down."""
MARGIN = 1.25
"""Size of the undistorted image, as a multiple of the image."""
DICTIONARIES = {"tag36h11": cv2.aruco.DICT_APRILTAG_36h11, "tag16h5": cv2.aruco.DICT_APRILTAG_16h5}


@dataclass(frozen=True)
class Tag:
    """A printed tag, upright on a vertical surface."""

    id: int
    center: tuple[float, float, float]
    """Meters in the world; z is up."""
    normal: float
    """Direction in which the tag faces, radians from the x axis."""
    size: float = 0.165
    family: str = "tag36h11"

    @property
    def corners(self):
        """(4, 3) corners, clockwise from the top left as read by a person in front of it."""
        right = np.array([-np.sin(self.normal), np.cos(self.normal), 0.0])
        up = np.array([0.0, 0.0, 1.0])
        half = self.size / 2
        signs = ((-1, 1), (1, 1), (1, -1), (-1, -1))
        return np.array([self.center + half * (a * right + b * up) for a, b in signs])


@dataclass(frozen=True)
class Lens:
    """A camera: OpenCV's matrix and distortion, exposure and sensor."""

    size: tuple[int, int] = (640, 480)
    focal: float = 520.0
    distortion: tuple[float, ...] = ()
    blur: float = 0.7
    """Standard deviation of the optical blur in pixels."""
    noise: float = 3.0
    """Standard deviation of the sensor's noise in steps of 1/255."""

    @property
    def matrix(self):
        width, height = self.size
        center = (width - 1) / 2, (height - 1) / 2
        return np.array([[self.focal, 0, center[0]], [0, self.focal, center[1]], [0, 0, 1.0]])


def camera_pose(pose, position, rotation=AHEAD):
    """Rotation (3, 3) world from camera and center (3,) of a camera on a robot at a pose (3,)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    return turn @ rotation, np.array([pose[0], pose[1], 0.0]) + turn @ position


class Painter:
    """Renders quadrilaterals of a scene into images of one lens."""

    def __init__(self, lens):
        self.lens = lens
        width, height = (round(MARGIN * side) * SAMPLES for side in lens.size)
        self.size = width, height
        x, y = (
            (np.arange(side * SAMPLES) + 0.5) / SAMPLES - 0.5 for side in lens.size
        )  # of the samples, in pixels
        grid = np.stack(np.meshgrid(x, y), -1).reshape(-1, 1, 2)
        K, ideal = lens.matrix, grid.reshape(-1, 2)
        if lens.distortion:
            D = np.array(lens.distortion)
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
            undistort = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # OpenCV 4 and 5
            ideal = undistort(grid, K, D, R=None, P=K, criteria=criteria).reshape(-1, 2)
        offset = (np.array(self.size) / SAMPLES - lens.size) / 2
        samples = ((ideal + offset + 0.5) * SAMPLES - 0.5).astype(np.float32)
        samples = samples.reshape(len(y), len(x), 2)
        self.maps = samples[..., 0].copy(), samples[..., 1].copy()
        self.matrix = K.copy()
        self.matrix[:2, 2] += offset
        self.matrix[:2] *= SAMPLES
        self.matrix[:2, 2] += (SAMPLES - 1) / 2

    def paint(self, canvas, texture, corners, R, center):
        """Paint a texture (h, w) onto the quadrilateral (4, 3): top left, top right, and so on."""
        points = (corners - center) @ R
        polygon = _clipped(points)
        if len(polygon) < 3:
            return
        pixels = polygon @ self.matrix.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        low = np.floor(pixels.min(0)).clip(0).astype(int)
        high = np.ceil(pixels.max(0) + 1).clip(max=self.size).astype(int)
        if (high <= low).any():
            return
        h, w = texture.shape[:2]
        # texel centers: u in [0, 1] is column u * w - .5
        to_plane = np.stack(
            [(points[1] - points[0]) / w, (points[3] - points[0]) / h, points[0]], 1
        )
        to_plane = to_plane @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
        shift = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1.0]])
        H = shift @ self.matrix @ to_plane
        size = tuple((high - low).tolist())
        patch = cv2.warpPerspective(
            texture, H, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        mask = np.zeros(size[::-1], np.uint8)
        cv2.fillPoly(mask, [np.rint((pixels - low) * 16).astype(np.int32)], 1, shift=4)
        view = canvas[low[1] : high[1], low[0] : high[0]]
        np.copyto(view, patch, where=mask.astype(bool))

    def expose(self, canvas, rng):
        """The image of the sensor."""
        lens = self.lens
        samples = cv2.remap(canvas, *self.maps, cv2.INTER_LINEAR)
        image = cv2.resize(samples, lens.size, interpolation=cv2.INTER_AREA).astype(np.float32)
        if lens.blur > 0:
            image = cv2.GaussianBlur(image, (0, 0), lens.blur)
        image += lens.noise * rng.standard_normal(image.shape, np.float32)
        return np.rint(image.clip(0, 255)).astype(np.uint8)

    def canvas(self, level=128):
        return np.full(self.size[::-1], level, np.uint8)


@cache
def painter_of(lens):
    """The painter of a lens, whose map of samples is made once."""
    return Painter(lens)


def _clipped(points, near=0.05):
    """The part of a quadrilateral (4, 3) in front of a camera."""
    kept = []
    for a, b in zip(points, np.roll(points, -1, 0), strict=True):
        if a[2] > near:
            kept.append(a)
        if (a[2] > near) != (b[2] > near):
            kept.append(a + (near - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(kept)


def marker(tag, pixels):
    """The tag with a white border of one cell, at least `pixels` wide; texture and its corners."""
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[tag.family])
    cells = dictionary.markerSize + 2
    one = cv2.aruco.generateImageMarker(dictionary, tag.id, cells)
    one = cv2.copyMakeBorder(one, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=255)
    times = int(np.clip(np.ceil(pixels / cells), 3, 120))
    texture = np.repeat(np.repeat(one, times, 0), times, 1)
    texture = (30 + texture.astype(np.float32) * (215 / 255)).astype(np.uint8)
    corners, center = tag.corners, np.array(tag.center)
    return texture, center + (corners - center) * (cells + 2) / cells


def paint_tag(painter, canvas, tag, R, center):
    """Paint a tag that faces the camera."""
    forward = np.array([np.cos(tag.normal), np.sin(tag.normal), 0.0])
    to_camera = center - np.array(tag.center)
    if to_camera @ forward <= 0.02 * np.linalg.norm(to_camera):
        return
    pixels = painter.matrix[0, 0] * tag.size / np.linalg.norm(to_camera)
    painter.paint(canvas, *marker(tag, pixels), R, center)


def film_tag(tag, lens, pose, position, rotation=AHEAD, seed=0):
    """Image of a tag before a gray wall, from a camera on a robot at a pose (3,)."""
    painter = painter_of(lens)
    canvas = painter.canvas()
    paint_tag(painter, canvas, tag, *camera_pose(pose, position, rotation))
    return painter.expose(canvas, np.random.default_rng(seed))


def _plaster(rng, width, height, level):
    """Texture (h, w) of a surface in meters: stains, and darker pictures with sharp corners."""
    texels = 60
    shape = round(height * texels), round(width * texels)
    texture = np.full(shape, level, np.float32)
    for grain, amplitude in ((3, 5), (10, 8), (40, 10)):
        size = max(2, shape[1] // grain), max(2, shape[0] // grain)
        noise = rng.standard_normal(size[::-1]).astype(np.float32)
        texture += amplitude * cv2.resize(noise, shape[::-1], interpolation=cv2.INTER_CUBIC)
    return texture.clip(0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Room:
    """A rectangular room with tags on its walls, and a robot that laps in it."""

    seed: int = 0
    width: float = 9.0
    depth: float = 7.0
    height: float = 2.6
    tags: int = 14
    size: float = 0.165
    frames: int = 351
    lens: Lens = Lens(distortion=(-0.08, 0.03, 0.0005, -0.0004, 0.0))
    position: tuple[float, float, float] = (0.08, 0.02, 0.35)
    rotation: np.ndarray = field(default_factory=lambda: AHEAD.copy())
    laps: float = 1.5
    scale_error: float = 0.01
    turn_drift: float = np.deg2rad(0.8)
    """Radians per meter."""
    pan: tuple[float, ...] = ()
    """Pan of the camera in each frame, radians; empty for a fixed one."""

    @cached_property
    def layout(self):
        """The tags, at random positions around the walls."""
        rng = np.random.default_rng([self.seed, 1])
        around = 2 * (self.width + self.depth)
        found = []
        for k in range(self.tags):
            s = (k + rng.uniform(0.2, 0.8)) / self.tags * around
            z = rng.uniform(0.3, 1.3)
            found.append(Tag(k, *self._on_wall(s, z), self.size))
        return found

    def _on_wall(self, s, z):
        w, d = self.width, self.depth
        for length, start, along, normal in (
            (w, (-w / 2, -d / 2), (1, 0), np.pi / 2),
            (d, (w / 2, -d / 2), (0, 1), np.pi),
            (w, (w / 2, d / 2), (-1, 0), -np.pi / 2),
            (d, (-w / 2, d / 2), (0, -1), 0.0),
        ):
            if s <= length:
                t = np.clip(s, 0.2, length - 0.2)
                x, y = start[0] + t * along[0], start[1] + t * along[1]
                inset = 0.002
                return (x + inset * np.cos(normal), y + inset * np.sin(normal), z), normal
            s -= length
        raise ValueError(s)

    @cached_property
    def poses(self):
        """(frames, 3) true poses, on a rounded and wavy loop."""
        rng = np.random.default_rng([self.seed, 2])
        a, b = self.width / 2 - 2.0, self.depth / 2 - 1.7
        phase, wave = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.3)
        t = phase + np.linspace(0, 2 * np.pi * self.laps, 20 * self.frames)
        r = 1 + wave * np.sin(3 * t)
        x, y = a * r * np.cos(t), b * r * np.sin(t)
        length = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        at = np.interp(np.linspace(0, length[-1], self.frames), length, np.arange(len(t)))
        x, y = (np.interp(at, np.arange(len(t)), each) for each in (x, y))
        heading = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
        return np.stack([x, y, np.angle(np.exp(1j * heading))], 1)

    @cached_property
    def surfaces(self):
        """Textures and corners of walls, floor and ceiling."""
        rng = np.random.default_rng([self.seed, 3])
        w, d, h = self.width / 2, self.depth / 2, self.height
        walls = [(-w, -d), (w, -d), (w, d), (-w, d)]
        found = []
        for i in range(4):
            (x0, y0), (x1, y1) = walls[i], walls[(i + 1) % 4]
            corners = np.array([(x0, y0, h), (x1, y1, h), (x1, y1, 0), (x0, y0, 0)], float)
            # seen from inside, the next corner counterclockwise is on the left
            corners = corners[[1, 0, 3, 2]]
            length = np.hypot(x1 - x0, y1 - y0)
            found.append((_plaster(rng, length, h, 165), corners))
        floor = np.array([(-w, d, 0), (w, d, 0), (w, -d, 0), (-w, -d, 0)], float)
        found.append((_plaster(rng, 2 * w, 2 * d, 90), floor))
        ceiling = floor + np.array([0, 0, h])
        found.append((_plaster(rng, 2 * w, 2 * d, 200), ceiling))
        return found

    @cached_property
    def painter(self):
        return painter_of(self.lens)

    @cached_property
    def images(self):
        """Rendered images by number."""
        return {}

    def image(self, number):
        """Image of a frame, rendered once."""
        if number not in self.images:
            self.images[number] = self._rendered(number)
        return self.images[number]

    def _rendered(self, number):
        turn = self.pan[number] if self.pan else 0.0
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ self.rotation
        R, center = camera_pose(self.poses[number], np.array(self.position), rotation)
        canvas = self.painter.canvas()
        for texture, corners in self.surfaces:
            self.painter.paint(canvas, texture, corners, R, center)
        for tag in self.layout:
            paint_tag(self.painter, canvas, tag, R, center)
        return self.painter.expose(canvas, np.random.default_rng([self.seed, 4, number]))

    @cached_property
    def odometry(self):
        """Controls (frames - 1, 3) with systematic and random errors, and covariances."""
        rng = np.random.default_rng([self.seed, 5])
        p = self.poses
        dx, dy = np.diff(p[:, 0]), np.diff(p[:, 1])
        c, s = np.cos(p[:-1, 2]), np.sin(p[:-1, 2])
        turn = np.angle(np.exp(1j * np.diff(p[:, 2])))
        control = np.stack([c * dx + s * dy, c * dy - s * dx, turn], 1)
        distance = np.hypot(dx, dy)
        signs = rng.choice([-1, 1], 2)
        control[:, :2] *= 1 + signs[0] * self.scale_error
        control[:, 2] += signs[1] * self.turn_drift * distance
        sigma = np.stack(
            [0.02 * distance, 0.005 * distance, np.deg2rad(0.5) * np.sqrt(distance)], 1
        )
        control += sigma * rng.standard_normal(sigma.shape)
        return control, sigma[:, :, None] ** 2 * np.eye(3)

    @property
    def truth(self):
        return Trajectory(np.arange(self.frames) / 10.0, self.poses)

    @property
    def survey(self):
        """True positions of the tags on the plane."""
        text = tuple(f"{tag.family}:{tag.id}" for tag in self.layout)
        xy = np.array([tag.center[:2] for tag in self.layout])
        return LandmarkMap(10**18 + np.arange(len(text)), xy, text_names=text)


def save_room(room, folder, frames=None, odometry=True):
    """Write the recording of a room as a folder with camera.toml."""
    (folder / "images").mkdir(parents=True)
    width, height = room.lens.size
    K = room.lens.matrix
    lines = [f"width = {width}", f"height = {height}"]
    lines += [f"fx = {K[0, 0]}", f"fy = {K[1, 1]}", f"cx = {K[0, 2]}", f"cy = {K[1, 2]}"]
    lines += [f"distortion = {list(room.lens.distortion)}"] if room.lens.distortion else []
    lines += [f"position = {list(map(float, room.position))}"]
    lines += [f"rotation = {np.asarray(room.rotation).tolist()}"]
    (folder / "camera.toml").write_text("\n".join(lines) + "\n")
    n = frames or room.frames
    np.savetxt(folder / "times.txt", room.truth.time[:n], fmt="%.3f")
    control, covariance = room.odometry
    upper = covariance[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    names = ["ahead", "left", "turn"]
    pairs = [f"cov_{a}_{b}" for i, a in enumerate(names) for b in names[i:]]
    header = ",".join(["ahead_m", "left_m", "turn_rad", *pairs])
    if odometry:
        rows = np.hstack([control, upper])[: n - 1]
        np.savetxt(folder / "odometry.csv", rows, "%.17g", ",", header=header, comments="")
    pose = room.poses[:n]
    zero = np.zeros(n)
    half = pose[:, 2] / 2
    columns = [room.truth.time[:n], *pose[:, :2].T, zero, zero, zero, np.sin(half), np.cos(half)]
    np.savetxt(folder / "groundtruth.tum", np.stack(columns, 1), "%.9f")
    if room.pan:
        turns = np.stack([room.pan[:n], zero, zero], 1)
        header = "pan_rad,tilt_rad,sigma_rad"
        np.savetxt(folder / "gaze.csv", turns, "%.9f", ",", header=header, comments="")
    for i in range(n):
        cv2.imwrite(str(folder / "images" / f"{i:06d}.png"), room.image(i))


def camera_of(room):
    """The camera of a room, with its lens."""
    return Camera.from_matrix(
        room.lens.matrix,
        room.lens.size,
        distortion=room.lens.distortion,
        position=np.array(room.position),
        rotation=np.asarray(room.rotation),
    )


def drive_of(room, camera=None):
    """The drive of a room for `observe_tags`, with images as recorded, rendered when loaded."""
    control, covariance = room.odometry

    def load(number):
        turn = CameraTurn(room.pan[number]) if room.pan else None
        return Frame(room.truth.time[number], image=room.image(number), turn=turn)

    return Drive(
        name=f"room {room.seed}",
        camera=camera or camera_of(room),
        time=room.truth.time,
        control=control,
        control_covariance=covariance,
        load=load,
        start=room.poses[0],
        truth=room.truth,
    )


def carried(log, last, first):
    """A log whose robot is carried from pose `last` to pose `first`, unknown to its odometry."""
    kept = np.r_[0 : last + 1, first : len(log.time)]
    seen = np.isin(log.observation_pose, kept)
    steps = np.r_[0:last, last, first : len(log.control)]
    time = log.time[: len(kept)]
    return replace(
        log,
        time=time,
        control=log.control[steps],
        control_covariance=log.control_covariance[steps],
        observation_pose=np.searchsorted(kept, log.observation_pose[seen]),
        observation=log.observation[seen],
        observation_covariance=log.observation_covariance[seen],
        landmark=log.landmark[seen],
        truth=Trajectory(time, log.truth.pose[kept]),
    )
