"""Maps of other programs are scored as they are meant, or refused with the cause."""

import cv2
import numpy as np
import pytest
from scipy.io import savemat

from saccade.attention.models import AttentionModel
from saccade.attention.values import KINDS, as_saliency
from saccade.datasets.saliency_maps import SUFFIXES, MapFiles, read_map
from saccade.errors import ConfigError, ImageError
from saccade.evaluation.fixations import score
from saccade.evaluation.prediction import FixationData, saliency_from_files, score_models
from saccade.types import FixationTable

SHAPE = (60, 90)
y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
DENSITY = np.exp(-((x - 30) ** 2 + (y - 20) ** 2) / 200) + 1e-4
DENSITY /= DENSITY.sum()
LEVELS = np.rint(255 * DENSITY / DENSITY.max()).astype(np.uint8)
LOG = np.log(DENSITY)


@pytest.mark.parametrize("suffix", [".npy", ".mat", ".tiff", ".tif", ".jpg", ".bmp", ".png"])
def test_maps_of_every_suffix_are_found_and_read(tmp_path, suffix):
    assert suffix in SUFFIXES
    for name in (f"a{suffix}", f"sub/b{suffix.upper()}"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        if suffix == ".npy":
            with path.open("wb") as file:
                np.save(file, LEVELS)
        elif suffix == ".mat":
            savemat(path, {"map": LEVELS}, appendmat=False)
        else:
            path.write_bytes(cv2.imencode(suffix, LEVELS)[1].tobytes())
    files = MapFiles(tmp_path, ["a.png", "sub/b.png"])
    for image in ("a.png", "sub/b.png"):
        values = as_saliency(read_map(files.find(image)), image, SHAPE)
        assert np.corrcoef(values.ravel(), LEVELS.ravel())[0, 1] > 0.99


def test_log_densities_are_densities():
    for values in (LOG, LOG.astype(np.float32), np.where(DENSITY < 2e-6, -np.inf, LOG), LOG[None]):
        found = as_saliency(values, "m")
        np.testing.assert_allclose(found / found.sum(), DENSITY, atol=1e-4)
    shifted = as_saliency(LOG + 3, "m", kind="log-density")
    np.testing.assert_allclose(shifted / shifted.sum(), DENSITY, atol=1e-6)
    for plain in (LOG + 3, -DENSITY, LOG - 1):
        np.testing.assert_allclose(as_saliency(plain, "m"), plain, rtol=1e-6)
    with pytest.raises(ImageError, match="m: expected a density of numbers from 0"):
        as_saliency(-DENSITY, "m", kind="density")
    with pytest.raises(ConfigError, match="kind: expected one of saliency"):
        as_saliency(DENSITY, "m", kind="soup")
    with pytest.raises(ImageError, match="m: expected finite numbers"):
        as_saliency(np.where(DENSITY < 1e-6, np.nan, DENSITY), "m")


JET = cv2.applyColorMap(LEVELS, cv2.COLORMAP_JET)
GRAY = np.repeat(LEVELS[:, :, None], 3, 2)
OPAQUE = np.dstack([GRAY, np.full(SHAPE, 255, np.uint8)])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (JET, "picture in colors, probably with a color map"),
        (np.dstack([np.zeros_like(GRAY), LEVELS]), "transparent pixels"),
        (np.dstack([LEVELS, LEVELS]), "transparent pixels"),
        (DENSITY.T, "found a map of 60 x 90: height and width are exchanged; transpose it"),
        (np.pad(DENSITY, ((15, 15), (0, 0))), "letterbox .* rows 15 to 74 and columns 0 to 89"),
        (np.pad(LEVELS, ((0, 0), (30, 30))), "letterbox .* rows 0 to 59 and columns 30 to 119"),
        (cv2.resize(LEVELS, (64, 64)), "found a map of 64 x 64: resize it to the image"),
        (np.zeros((2, 60, 90, 3)), "of shape"),
    ],
    ids=["jet", "alpha", "gray-alpha", "transposed", "bars", "side-bars", "square", "many"],
)
def test_what_is_no_map_of_the_image_is_refused(values, words):
    with pytest.raises(ImageError, match=f"^m: expected .*{words}"):
        as_saliency(values, "m", SHAPE)


@pytest.mark.parametrize("values", [GRAY, OPAQUE, LEVELS[..., None], LEVELS[None, None]])
def test_pictures_in_gray_are_maps(values):
    np.testing.assert_array_equal(as_saliency(values, "m", SHAPE), LEVELS)


@pytest.mark.parametrize("shape", [(12, 17), (12, 18), (4, 6), (600, 905), (1, 2)])
def test_maps_of_fewer_cells_have_the_aspect_to_a_cell(shape):
    as_saliency(np.ones(shape), "m", SHAPE)


class PysaliencyModel:
    """Stands in for pysaliency's `Model`, which gets pixels from 0 to 255."""

    def log_density(self, stimulus):
        assert stimulus.dtype == np.uint8
        assert stimulus.shape == (*SHAPE, 3)
        return LOG


def declared(image):
    return LOG + 2


declared.kind = "log-density"


@pytest.mark.parametrize("model", [PysaliencyModel(), declared, lambda image: LOG])
def test_models_that_give_log_densities_are_scored_as_densities(model):
    found = AttentionModel(model).maps(np.zeros(SHAPE, np.float32)).saliency
    np.testing.assert_allclose(found / found.sum(), DENSITY, atol=1e-6)


@pytest.fixture
def images(tmp_path):
    for name in ("Action/001.png", "Art/001.png", "Art/2.png", "Art/2.jpg"):
        (tmp_path / "im" / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(tmp_path / "im" / name), GRAY)
    return tmp_path / "im"


@pytest.mark.parametrize(
    ("files", "image", "found"),
    [
        (["Action/001.npy", "Art/001.npy"], "Art/001.png", "Art/001.npy"),
        (["maps/Action/001.png", "maps/Art/001.png"], "Art/001.png", "maps/Art/001.png"),
        (["Art/001.png.npy"], "Art/001.png", "Art/001.png.npy"),
        (["Art/2.jpg.npy", "Art/2.png.npy"], "Art/2.png", "Art/2.png.npy"),
        (["Art/001.png", "Art/001.npy"], "Art/001.png", "Art/001.npy"),
        (["001.npy"], "Art/001.png", "001.npy could be the map of Art/001.png or of Action/001"),
        (["a/001.npy", "b/001.npy"], "Art/001.png", "expected a map for Art/001.png"),
        (["a/Art/001.npy", "b/Art/001.npy"], "Art/001.png", "a/Art/001.npy or b/Art/001.npy"),
        (["Art/2.npy"], "Art/2.png", "could be the map of Art/2.png or of Art/2.jpg"),
        ([], "Art/2.png", "expected a map for Art/2.png"),
    ],
)
def test_a_map_has_the_path_of_its_image(images, tmp_path, files, image, found):
    folder = tmp_path / "maps"
    folder.mkdir()
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    names = [each.relative_to(images).as_posix() for each in images.rglob("*.[jp][pn]g")]
    if found in files:
        assert MapFiles(folder, names).find(image) == folder / found
        return
    with pytest.raises(ImageError, match=found):
        MapFiles(folder, names).find(image)


def test_one_image_has_the_scores_that_it_can_have(images, tmp_path):
    table = FixationTable(
        np.array(["Art/001.png"] * 9),
        np.arange(9) % 3,
        np.arange(9) // 3,
        np.column_stack([np.full(9, 31.0), np.full(9, 19.0)]),
    )
    data = FixationData.of(table, images, 0)
    (tmp_path / "maps").mkdir()
    np.save(tmp_path / "maps" / "001.npy", DENSITY)
    (tmp_path / "im" / "Action" / "001.png").unlink()
    model = saliency_from_files(images, tmp_path / "maps")
    ((_, scores),) = score_models({"m": model}, data)
    expected = score(DENSITY.astype(np.float32), table.xy, np.empty((0, 2)))
    assert scores["m"] == expected or np.isnan(scores["m"].shuffled_auc)
    assert scores["m"].auc > 0.9
    assert scores["m"].nss > 1
    assert np.isnan([scores["m"].shuffled_auc, scores["m"].information_gain]).all()
    assert [*KINDS] == ["saliency", "density", "log-density"]
