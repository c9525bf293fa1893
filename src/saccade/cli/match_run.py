"""Keypoint matches of two images, written to files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from saccade.cli.match_frames import frames_figure
from saccade.cli.output import write_text
from saccade.io.image import read_image
from saccade.keypoints import Verification, match, verify
from saccade.keypoints.two_view_fit import Geometry
from saccade.types import Float32Array, Keypoints, Regions
from saccade.viewing import Picture, Section, match_figure, save_figures
from saccade.viewing.embedding import figure_uri
from saccade.viewing.report import ReportBuilder, match_part

LEAD = "Matching interest points of two photographs."
TEXT = (
    "Lines join matched points: the inliers of one geometry, and the others. Click near the end of "
    "a line to see one match alone."
)


def match_images(
    first: Path,
    second: Path,
    out: Path,
    detector: Any,
    builder: ReportBuilder,
    ratio: float = 0.8,
    mutual: bool = True,
    geometry: Geometry | None = "fundamental",
    tolerance: float = 2.0,
    figures: Sequence[str] = ("png",),
) -> dict[str, Any]:
    """Match two images: write matches.png, .csv and frames.png, return the row for --json."""
    images = (read_image(first), read_image(second))
    keypoints = (detected(detector, images[0]), detected(detector, images[1]))
    pairs = match(*keypoints, ratio=ratio, mutual=mutual)
    verified = None if geometry is None else verify(*keypoints, pairs, geometry, tolerance)
    inliers = None if verified is None else verified.inliers
    figure = match_figure(images, keypoints, pairs, inliers)
    picture = save_figures(figure, out / "matches", figures)
    xy = np.hstack([keypoints[0].xy[pairs[:, 0]], keypoints[1].xy[pairs[:, 1]]])
    lines = [
        f"{i},{j},{x1:.3f},{y1:.3f},{x2:.3f},{y2:.3f}"
        for (i, j), (x1, y1, x2, y2) in zip(pairs.tolist(), xy.tolist(), strict=True)
    ]
    header = "first,second,x1,y1,x2,y2"
    facts = {
        "interest points": " and ".join(f"{len(each):,}" for each in keypoints),
        "matches": f"{len(pairs):,}",
    }
    if inliers is not None:
        header += ",inlier"
        lines = [f"{line},{inlier:d}" for line, inlier in zip(lines, inliers, strict=True)]
        facts["inliers"] = f"{inliers.sum():,} ({inliers.mean() if len(pairs) else 0:.0%})"
    table = out / "matches.csv"
    write_text(table, "\n".join([header, *lines]) + "\n")
    verdicts = None if verified is None or verified.matrix is None else inliers
    frames = frames_figure(detector, images, keypoints, pairs, verdicts)
    pictures = [] if frames is None else [Picture(figure_uri(frames[0]), *frames[1:], wide=True)]
    section = Section(f"{first.name} and {second.name}", TEXT, pictures, facts)
    builder.add(lambda: match_part(section, images, keypoints, pairs, inliers))
    row: dict[str, Any] = {
        "first": str(first),
        "second": str(second),
        "first_points": len(keypoints[0]),
        "second_points": len(keypoints[1]),
        "matches": len(pairs),
        "picture": str(picture),
        "table": str(table),
    }
    if frames is not None:
        row["frames"] = str(save_figures(frames[0], out / "frames", figures))
    if verified is not None:
        sigma = corner_sigma(verified, images[0].shape)
        row |= {
            "inliers": int(verified.inliers.sum()),
            "geometry": verified.geometry,
            "matrix": None if verified.matrix is None else verified.matrix.tolist(),
            "corner_sigma_px": sigma,
        }
    return row


def corner_sigma(verified: Verification, shape: tuple[int, ...]) -> float | None:
    """Standard deviation in pixels of the corner that a homography projects worst, if known."""
    if verified.geometry != "homography" or verified.covariance is None:
        return None
    height, width = shape[:2]
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)
    return float(np.sqrt(np.linalg.eigvalsh(verified.projection_covariance(corners)).max()))


def detected(detector: Any, image: Float32Array) -> Keypoints:
    """The keypoints of an image, or those of its regions."""
    detections = detector(image)
    return detections.keypoints if isinstance(detections, Regions) else detections
