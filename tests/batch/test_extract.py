"""Many images into one table, whatever happens meanwhile."""

import json
import os
import resource
import signal
import subprocess
import sys

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
import zarr

from saccade import __version__, attention_saliency, read_image, scanpath
from saccade.attention import AttentionConfig, ContrastConfig, contrast_saliency
from saccade.batch import Job, extract, open_source
from saccade.batch.engines import InProcess, Processes, Shard
from saccade.batch.sources import Item
from saccade.errors import ConfigError
from saccade.io.files import PARTIAL
from saccade.keypoints import SiftConfig, SymRoid, SymRoidConfig
from support import extraction
from support.extraction import SIFT, check_complete, check_whole, extract_here, photographs
from support.killed_process import deadly
from support.limits import TIMEOUT

IMAGES = 15
KILLS = 10
GONE = 7
"""Number of an image."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("many") / "photos"
    photographs(path, IMAGES)
    return path


def test_what_comes_out_is_what_the_detector_finds(folder, tmp_path):
    result = extract_here(folder, tmp_path)
    assert (result.done, result.unchanged, result.totals.images) == (IMAGES, 0, IMAGES)
    assert result.totals.shards == IMAGES / 3
    assert result.totals.rows > 5 * IMAGES
    check_complete(folder, tmp_path)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["complete"]
    assert manifest["configuration"]["settings"]["edge_ratio"] == 15
    assert (manifest["images"], manifest["rows"]) == (IMAGES, result.totals.rows)
    assert not (tmp_path / PARTIAL).exists()


def test_a_second_run_does_what_is_new_and_what_has_changed(tmp_path):
    source, out = tmp_path / "photos", tmp_path / "out"
    paths = photographs(source, 10)
    extract_here(source, out)
    before = {path: path.stat().st_mtime_ns for path in out.glob("*/part-*")}
    assert extract_here(source, out).done == 0
    assert before == {path: path.stat().st_mtime_ns for path in out.glob("*/part-*")}
    paths[4].write_bytes(paths[0].read_bytes())
    photographs(source, 12)[4].write_bytes(paths[0].read_bytes())
    paths[4].touch()
    result = extract_here(source, out)
    assert (result.done, result.unchanged) == (3, 9)
    check_complete(source, out)


def test_what_another_version_did_is_told_and_done_anew_on_request(run, tmp_path):
    photographs(tmp_path / "photos", 4)
    extract_here(tmp_path / "photos", tmp_path / "out", Job("sift", SiftConfig(), version="0.0.1"))
    words = ("extract", "photos", "--out", "out", "--workers", 1, "--json")
    photographs(tmp_path / "photos", 5)
    code, printed, err = run(*words)
    assert (code, json.loads(printed)["by_other_versions"]) == (0, 4)
    assert "4 images were processed by another version; --redo processes them again" in err
    code, printed, err = run(*words, "--redo")
    assert (code, err, json.loads(printed)["by_other_versions"]) == (0, "", 0)
    assert set(pq.read_table(tmp_path / "out/images")["version"].to_pylist()) == {__version__}


def test_other_settings_do_not_mix(folder, tmp_path):
    extract_here(folder, tmp_path)
    other = Job("sift", SiftConfig(max_keypoints=3))
    with pytest.raises(ConfigError, match=r"settings\.max_keypoints = None, now 3"):
        extract_here(folder, tmp_path, other)
    assert extract_here(folder, tmp_path, other, redo=True).done == IMAGES
    assert all(len(rows) <= 6 for rows in check_whole(tmp_path).values())


def test_descriptors_that_are_no_bytes_are_refused():
    with pytest.raises(ConfigError, match="descriptor_dtype: expected uint8"):
        Job("sift", SiftConfig(descriptor_dtype="float32"))


def test_what_cannot_be_read_is_told_and_the_rest_is_done(tmp_path):
    source, out = tmp_path / "photos", tmp_path / "out"
    paths = photographs(source, 10)
    paths[3].write_text("no image")
    paths[5].write_bytes(paths[5].read_bytes()[:200])
    images = open_source(str(source))
    paths[7].unlink()  # it was seen, and is gone when its turn comes
    result = extract(images, SIFT, str(out), InProcess(), shard_size=3)
    errors = pq.read_table(out / "errors.parquet").to_pandas().set_index("image").error
    assert list(errors.index) == ["003.png", "005.png", "007.png"]
    assert "expected an image" in errors["003.png"]
    assert "cut short" in errors["005.png"]
    assert "No such file" in errors["007.png"]
    assert (result.totals.images, result.totals.errors) == (7, 3)
    assert (result.done, result.failed) == (7, 3)
    photographs(source, 10)
    assert extract_here(source, out).totals.errors == 0
    assert not (out / "errors.parquet").exists()
    check_complete(source, out)


@pytest.fixture(scope="module")
def killed(folder, tmp_path_factory):
    """What runs left that kill -9 ended at random moments: `out`, and `changed`.

    In the source of the second some images have changed since `before`, one is new, one is gone.
    """
    root = tmp_path_factory.mktemp("killed")
    paths = photographs(root / "photos", IMAGES)
    extract_here(root / "photos", root / "before")
    for number in (1, 6, 8, 12):
        paths[number].write_bytes(paths[(number + 5) % IMAGES].read_bytes())
    paths[GONE].rename(root / "photos" / "new.png")
    words = [folder, root / "out", str(KILLS), root / "photos", root / "changed", root / "before"]
    subprocess.run([sys.executable, extraction.__file__, *words], check=True, timeout=TIMEOUT)
    return root


def test_killed_at_any_moment_nothing_is_lost_and_nothing_twice(folder, killed):
    """A second run ends what the one that was killed began."""
    unfinished = 0
    for number in range(1, KILLS + 1):
        out = killed / "out" / str(number)
        done = len(check_whole(out))
        unfinished += 0 < done < IMAGES
        result = extract_here(folder, out)
        assert (result.unchanged, result.done) == (done, IMAGES - done)
        assert len(check_whole(out)) == IMAGES
    assert unfinished > KILLS / 10
    check_complete(folder, out)


def test_killed_while_images_are_done_anew_no_points_are_another_images(killed):
    """The same where images have changed; the points of the one that is gone stay."""
    gone = check_whole(killed / "before")[f"{GONE:03d}.png"]
    two = 0
    for number in range(1, KILLS + 1):
        out = killed / "changed" / str(number)
        records = [path.name for path in (out / "images").iterdir()]
        two += len({name[:23] for name in records}) < len(records)
        extract_here(killed / "photos", out)
        kept = check_whole(out).pop(f"{GONE:03d}.png")
        assert kept.reset_index(drop=True).equals(gone.reset_index(drop=True))
        check_complete(killed / "photos", out, [f"{GONE:03d}.png"])
    assert two > 0


def test_a_full_disk_is_told(folder, tmp_path):
    """No file may be larger than 6 KB: some of the points are, those of the records are not."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (6 << 10, before[1]))
    try:
        result = extract_here(folder, tmp_path, size=8)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    errors = pq.read_table(tmp_path / "errors.parquet").to_pandas()
    assert result.totals.errors == len(errors) > 0
    assert errors.error.str.contains("cannot be written: File too large").all()
    assert len(check_whole(tmp_path)) == IMAGES - len(errors) > 0
    extract_here(folder, tmp_path)
    check_complete(folder, tmp_path)


def test_processes_find_the_same_as_one_and_change_no_setting_of_it(folder, tmp_path):
    before = dict(os.environ), cv2.getNumThreads()
    extract_here(folder, tmp_path / "1")
    extract(open_source(str(folder)), SIFT, str(tmp_path / "2"), Processes(2), shard_size=3)
    assert (dict(os.environ), cv2.getNumThreads()) == before
    two = check_whole(tmp_path / "2")
    assert all(two[name].equals(rows) for name, rows in check_whole(tmp_path / "1").items())


def test_a_shard_that_kills_its_process_costs_no_other():
    shards = [Shard(str(number), [Item(f"{number}.png", "")]) for number in range(8)]
    reports = list(Processes(2).run(deadly, iter(shards)))
    assert sorted(each.unchanged for each in reports if each.done) == [0, 1, 2, 4, 5, 6, 7]
    ((name, why),) = [lost for each in reports for lost in each.lost]
    assert name == "3.png"
    assert "died" in why


@pytest.mark.parametrize("what", ["saliency", "scanpath", "symroid"])
def test_every_kind_is_what_its_function_gives(what, tmp_path):
    (path,) = photographs(tmp_path / "photos", 1)
    image = read_image(path)
    kind = SymRoidConfig if what == "symroid" else AttentionConfig
    extract_here(path, tmp_path, Job(what, kind(), fixations=4))
    (found,) = check_whole(tmp_path, what).values()
    maps = attention_saliency(image)
    saliency = maps.saliency
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
        archive = zarr.storage.ZipStore(tmp_path / row["file"], mode="r")
        held = zarr.open_group(archive, mode="r")[row["array"]]
        assert held.dtype == np.float16
        np.testing.assert_allclose(held[...], saliency, atol=5e-4)
        assert saliency[cell_of(row, saliency.shape, image.shape)] == saliency.max()
        archive.close()


def cell_of(row, shape, image_shape):
    """The cell of a map at a place of the image."""
    y, x = ((row[each] + 0.5) * s / i for each, s, i in zip("yx", shape, image_shape, strict=False))
    return int(y), int(x)


@pytest.mark.parametrize("maps", ["png", "zarr"])
def test_maps_that_have_not_changed_are_kept(tmp_path, maps):
    paths = photographs(tmp_path / "photos", 3)
    job = Job("contrast", ContrastConfig(), maps=maps)
    extract_here(tmp_path / "photos", tmp_path / "out", job)
    paths[1].write_bytes(paths[0].read_bytes())
    assert extract_here(tmp_path / "photos", tmp_path / "out", job).done == 1
    rows = check_whole(tmp_path / "out", "contrast")
    for path in paths:
        file = tmp_path / "out" / rows[path.name].file.iloc[0]
        if maps == "png":
            found = cv2.imread(str(file), -1) / 65535
        else:
            group = zarr.open_group(zarr.storage.ZipStore(file, mode="r"), mode="r")
            found = group[path.name][...]
        expected = contrast_saliency(read_image(path)).saliency
        np.testing.assert_allclose(found, expected, atol=5e-4)


def test_ctrl_c_finishes_what_has_begun_and_says_how_to_go_on(folder, run, tmp_path, monkeypatch):
    from saccade.batch import extraction

    do = extraction.extract_shard

    def interrupted(job, place, shard, redo):
        signal.raise_signal(signal.SIGINT)
        return do(job, place, shard, redo)

    words = ("extract", folder, "--out", "out", "--workers", 1, "--shard", 3)
    with monkeypatch.context() as patched:
        patched.setattr(extraction, "extract_shard", interrupted)
        code, printed, err = run(*words, "--json")
    assert code == 130
    assert "stopped after 3 of 15 images; run it again to resume" in err
    assert json.loads(printed)["complete"] is False
    assert not json.loads((tmp_path / "out" / "manifest.json").read_text())["complete"]
    assert len(check_whole(tmp_path / "out")) == 3
    code, printed, err = run(*words, "--json")
    assert (code, err) == (0, "")
    assert json.loads(printed)["already_done"] == 3
    check_complete(folder, tmp_path / "out")
