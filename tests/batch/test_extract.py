"""Many images into one table, whatever happens meanwhile."""

import json
import os
import signal
import subprocess
import sys
import time

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from saccade import Sift, attention_saliency, exchange, read_image, scanpath
from saccade.attention import AttentionConfig
from saccade.batch import Job, extract, extraction, open_source, read_points
from saccade.errors import ConfigError
from saccade.keypoints import SiftConfig, SymRoid, SymRoidConfig
from saccade.workers import run_blocks
from support.extraction import SIFT, check_complete, check_whole, extract_here, photographs
from support.keypoint_files import assert_same
from support.killed_process import deadly
from support.limits import TIMEOUT

IMAGES = 15
KILLS = 6
GONE = 7
"""Number of an image."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("many") / "photos"
    photographs(path, IMAGES)
    return path


def files_of(out):
    return {path.name: path.read_bytes() for path in (out / "sift").iterdir()}


def test_extraction_is_what_the_detector_finds(folder, tmp_path):
    progress = []
    result = extract_here(folder, tmp_path, on_progress=lambda *counts: progress.append(counts))
    assert (result.done, result.unchanged, result.images) == (IMAGES, 0, IMAGES)
    assert progress == [(done, 0, IMAGES) for done in (3, 6, 9, 12, 15)]
    assert result.rows > 5 * IMAGES
    assert result.complete
    check_complete(folder, tmp_path)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["settings"]["edge_ratio"] == 15
    assert len(files_of(tmp_path)) == IMAGES / 3


def test_resume_processes_new_and_changed_images(tmp_path):
    source, out = tmp_path / "photos", tmp_path / "out"
    paths = photographs(source, 10)
    extract_here(source, out)
    before = {path: path.stat().st_mtime_ns for path in out.glob("sift/*")}
    for path in paths:
        path.touch()  # another time, but the same content
    assert extract_here(source, out).done == 0
    assert before == {path: path.stat().st_mtime_ns for path in out.glob("sift/*")}
    photographs(source, 12)
    paths[4].write_bytes(paths[0].read_bytes())
    result = extract_here(source, out)
    assert (result.done, result.unchanged) == (3, 9)
    check_complete(source, out)


def test_other_settings_do_not_mix(folder, tmp_path):
    extract_here(folder, tmp_path)
    other = Job("sift", SiftConfig(max_keypoints=3))
    with pytest.raises(ConfigError, match="max_keypoints = None, now 3"):
        extract_here(folder, tmp_path, other)


def test_images_that_fail_do_not_stop_the_others(tmp_path):
    source, out = tmp_path / "photos", tmp_path / "out"
    paths = photographs(source, 10)
    paths[3].write_text("no image")
    paths[5].write_bytes(paths[5].read_bytes()[:200])
    images = open_source(str(source))
    paths[7].unlink()  # after it was listed
    result = extract(images, SIFT, str(out), block_size=3)
    summary = pq.read_table(out / "images.parquet").to_pandas().set_index("image")
    errors = summary.error.dropna()
    assert list(errors.index) == ["003.png", "005.png", "007.png"]
    assert errors.to_dict() == dict(result.failed)
    assert "expected an image" in errors["003.png"]
    assert "cut short" in errors["005.png"]
    assert "No such file" in errors["007.png"]
    assert (result.images, result.done, result.complete) == (7, 7, True)
    photographs(source, 10)
    assert extract_here(source, out).done == 3
    check_complete(source, out)


@pytest.fixture(scope="module")
def killed(folder, tmp_path_factory):
    """What runs left that kill -9 ended at random moments: `out`, and `changed`.

    In the source of the second some images have changed since `before`, one is new, one is gone.
    """
    from support import extraction

    root = tmp_path_factory.mktemp("killed")
    paths = photographs(root / "photos", IMAGES)
    extract_here(root / "photos", root / "before")
    for number in (1, 6, 8, 12):
        paths[number].write_bytes(paths[(number + 5) % IMAGES].read_bytes())
    paths[GONE].rename(root / "photos" / "new.png")
    words = [folder, root / "out", str(KILLS), root / "photos", root / "changed", root / "before"]
    subprocess.run([sys.executable, extraction.__file__, *words], check=True, timeout=TIMEOUT)
    return root


def test_killed_at_any_moment_every_image_is_there_once(folder, killed, tmp_path):
    """The same command resumes, and makes the files of a run that was not killed."""
    extract_here(folder, tmp_path)
    unfinished = 0
    for number in range(1, KILLS + 1):
        out = killed / "out" / str(number)
        done = len(check_whole(out))
        unfinished += 0 < done < IMAGES
        result = extract_here(folder, out)
        assert (result.unchanged, result.done) == (done, IMAGES - done)
        assert files_of(out).keys() == files_of(tmp_path).keys()
    assert unfinished > KILLS / 10
    check_complete(folder, out)


def test_killed_while_images_are_done_anew_no_points_are_of_another_image(killed):
    """The points of the image that is gone stay."""
    gone = check_whole(killed / "before")[f"{GONE:03d}.png"]
    for number in range(1, KILLS + 1):
        out = killed / "changed" / str(number)
        check_whole(out)
        extract_here(killed / "photos", out)
        kept = check_whole(out).pop(f"{GONE:03d}.png")
        assert kept.reset_index(drop=True).equals(gone.reset_index(drop=True))
        check_complete(killed / "photos", out, [f"{GONE:03d}.png"])


def test_an_image_in_two_files_is_kept_once(folder, tmp_path):
    """As two runs into one bucket leave it."""
    extract_here(folder, tmp_path, size=3)
    for path in (tmp_path / "sift").iterdir():
        path.rename(path.with_stem(f"{path.stem}-other"))
    (tmp_path / "sift").rename(tmp_path / "first")
    extract_here(folder, tmp_path, size=5)
    for path in (tmp_path / "first").iterdir():
        path.rename(tmp_path / "sift" / path.name)
    (tmp_path / "first").rmdir()
    assert extract_here(folder, tmp_path).done == 0
    check_complete(folder, tmp_path)


def test_the_number_of_workers_changes_nothing(folder, tmp_path):
    threads = cv2.getNumThreads()
    extract_here(folder, tmp_path / "one")
    extract_here(folder, tmp_path / "two", workers=2)
    assert cv2.getNumThreads() == threads
    one, two = check_whole(tmp_path / "one"), check_whole(tmp_path / "two")
    assert one.keys() == two.keys()
    assert all(one[name].equals(two[name]) for name in one)
    assert files_of(tmp_path / "one").keys() == files_of(tmp_path / "two").keys()


def test_a_block_that_kills_its_process_fails_alone():
    reports = dict(run_blocks(deadly, range(8), workers=2))
    assert reports == {number: None if number == 3 else 10 * number for number in range(8)}


def test_workers_end_with_the_command(folder, tmp_path):
    command = "from support.extraction import *; import sys; " + (
        "extract(open_source(sys.argv[1]), SIFT, sys.argv[2], block_size=1, workers=2)"
    )
    words = [sys.executable, "-c", command, str(folder), str(tmp_path / "out")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(words, env=environment) as process:
        while not list(tmp_path.glob("out/sift/[!.]*.parquet")):
            assert process.poll() is None
            time.sleep(0.01)
        listed = f"/proc/{process.pid}/task/{process.pid}/children"
        with open(listed) as file:  # noqa: PTH123
            children = [int(number) for number in file.read().split()]
        process.send_signal(signal.SIGKILL)
    assert children
    end = time.monotonic() + TIMEOUT
    while any(is_running(number) for number in children):
        assert time.monotonic() < end
        time.sleep(0.05)


def is_running(number):
    try:
        with open(f"/proc/{number}/stat") as file:  # noqa: PTH123
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.parametrize("what", ["saliency", "scanpath", "symroid"])
def test_every_kind_is_what_its_function_gives(what, tmp_path):
    (path,) = photographs(tmp_path / "photos", 1)
    image = read_image(path)
    kind = SymRoidConfig if what == "symroid" else AttentionConfig
    extract_here(path, tmp_path, Job(what, kind(), fixations=4))
    (found,) = check_whole(tmp_path, what).values()
    maps = attention_saliency(image)
    if what == "symroid":
        regions = SymRoid()(image)
        np.testing.assert_allclose(found[["x", "y"]], regions.xy, atol=1 / 512)
        np.testing.assert_allclose(
            found[["left", "top", "right", "bottom"]], regions.boxes, rtol=2**-12
        )
    elif what == "scanpath":
        expected = scanpath(maps, fixations=4)
        np.testing.assert_allclose(found[["x", "y"]], expected.xy)
        np.testing.assert_allclose(found.time, expected.time)
        assert list(found.fixation) == [1, 2, 3, 4][: len(expected)]
    else:
        (row,) = found.to_dict("records")
        saliency = maps.saliency
        stored = cv2.imread(str(tmp_path / "maps" / f"{row['image']}.png"), -1)
        assert stored.dtype == np.uint16
        np.testing.assert_allclose(stored / 65535, saliency, atol=1e-5)
        assert saliency[cell_of(row, saliency.shape, image.shape)] == saliency.max()


def cell_of(row, shape, image_shape):
    """The cell of a map at a position in the image."""
    y, x = ((row[each] + 0.5) * s / i for each, s, i in zip("yx", shape, image_shape, strict=False))
    return int(y), int(x)


def test_ctrl_c_finishes_the_block_in_progress(folder, run, tmp_path, monkeypatch):
    process = extraction.extract_block

    def interrupted(job, location, block):
        signal.raise_signal(signal.SIGINT)
        return process(job, location, block)

    words = ("extract", folder, "--out", "out", "--workers", 1)
    with monkeypatch.context() as patched:
        patched.setattr(extraction, "extract_block", interrupted)
        code, printed, err = run(*words, "--json")
    assert code == 130
    assert "stopped after 4 of 15 images; run it again to resume" in err
    assert json.loads(printed)["complete"] is False
    assert len(check_whole(tmp_path / "out")) == 4
    code, printed, err = run(*words, "--json")
    assert (code, err) == (0, "")
    assert json.loads(printed)["already_done"] == 4
    check_complete(folder, tmp_path / "out")


def test_points_come_back_and_are_exported(folder, run, tmp_path):
    extract_here(folder, tmp_path / "out")
    expected = {path.name: Sift()(read_image(path)) for path in sorted(folder.iterdir())}
    found = {each.image: each for each in read_points(str(tmp_path / "out"))}
    assert found.keys() == expected.keys()
    assert run("convert", "out", "x.h5")[0] == 0
    other = exchange.read_hdf5(tmp_path / "x.h5")
    for name, points in expected.items():
        assert found[name].shape == (64, 96)
        for each in (found[name].points, other[name]):
            assert_same(each, points)
    code, _, err = run("convert", "out", "x.g2o")
    assert code == 2
    assert "--to: expected colmap or hdf5 for keypoints, found 'x.g2o'" in err
