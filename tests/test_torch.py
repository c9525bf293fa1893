"""Contrast saliency on tensors: the NumPy model and finite differences are its peers."""

import time
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest

import saccade
from saccade.attention import ContrastConfig, contrast_saliency
from saccade.attention.contrast import ContrastMaps
from saccade.attention.maps import SaliencyMaps
from saccade.attention.normalize import NORMALIZATIONS, keep, names_supported
from saccade.errors import ConfigError, ImageError
from saccade.evaluation import fixations as metrics
from saccade.scale.pyramid import resize
from support.paths import ROOT
from support.saliency_images import noise

torch = pytest.importorskip("torch", reason="needs the group `torch`; .ci/run has the command")
import saccade.torch  # noqa: E402

pytestmark = pytest.mark.torch

MAPS = ("saliency", "intensity", "color", "orientation")
DEFAULT = ContrastConfig()
SETTINGS = {
    "default": DEFAULT,
    "quotient": replace(DEFAULT, color="quotient", gabor_size=11, orientations=(10.0, 75.0)),
    "1998": replace(DEFAULT, normalization="local-maxima-1998", maxima_radius=0.1),
    "gray": replace(DEFAULT, normalization="none", color_weight=0.0, sharpening=0.7),
    "center": replace(DEFAULT, normalize_at="center", smoothing=0.0),
}
PHOTOGRAPHS = sorted((ROOT / "src/saccade/data").glob("[a-g]*.jpg"))


def as_tensor(images, dtype=torch.float32):
    return torch.as_tensor(np.stack(images), dtype=dtype).permute(0, 3, 1, 2)


def assert_equal_maps(found, images, config, atol):
    for number, image in enumerate(images):
        expected = contrast_saliency(image, config)
        for name in MAPS:
            values = getattr(found, name)[number].detach().numpy()
            np.testing.assert_allclose(values, getattr(expected, name), atol=atol, err_msg=name)


@pytest.mark.parametrize("shape", [(240, 320), (167, 251), (480, 360)])
def test_photographs_have_the_maps_of_the_numpy_model(shape):
    images = [cv2.resize(saccade.read_image(path), shape[::-1]) for path in PHOTOGRAPHS]
    images = [np.float32(image) / np.float32(255) for image in images]
    found = saccade.torch.contrast_saliency(as_tensor(images))
    assert found.image_shape == shape
    assert_equal_maps(found, images, DEFAULT, 1e-5)


@pytest.mark.shared
@pytest.mark.parametrize("shape", [(480, 640), (333, 501), (600, 800)])
def test_recorded_photographs_have_the_maps_of_the_numpy_model(shared, shape):
    paths = sorted((shared / "data/eyes/osie/images").glob("*.jpg"))[:16]
    images = [cv2.resize(saccade.read_image(path), shape[::-1]) for path in paths]
    images = [np.float32(image) / np.float32(255) for image in images]
    assert_equal_maps(saccade.torch.contrast_saliency(as_tensor(images)), images, DEFAULT, 1e-5)


@pytest.mark.parametrize("name", SETTINGS)
def test_every_setting_has_the_maps_of_the_numpy_model(name):
    images = [noise(seed, (96, 131)) / np.float64(255) for seed in range(3)]
    tensors = as_tensor(images, torch.float64)
    found = saccade.torch.contrast_saliency(tensors, SETTINGS[name], keep_features=True)
    assert_equal_maps(found, images, SETTINGS[name], 2e-5)
    expected = contrast_saliency(images[1], SETTINGS[name], keep_features=True)
    for feature, of_image in zip(found.features, expected.features, strict=True):
        assert feature[:3] == of_image[:3]
        np.testing.assert_allclose(feature.values[1], of_image.values, atol=5e-6)


def test_a_batch_has_the_maps_of_its_images():
    images = torch.rand(5, 3, 97, 140, generator=torch.Generator().manual_seed(1))
    batch = saccade.torch.contrast_saliency(images)
    for number, image in enumerate(images):
        single = saccade.torch.contrast_saliency(image[None])
        for name in MAPS:
            expected = getattr(single, name)[0]
            torch.testing.assert_close(getattr(batch, name)[number], expected, atol=2e-6, rtol=0)


@pytest.mark.parametrize("name", SETTINGS)
def test_gradients_are_those_of_finite_differences(name):
    generator = torch.Generator().manual_seed(7)
    images = torch.rand(2, 3, 65, 90, generator=generator, dtype=torch.float64) * 0.9 + 0.05
    images.requires_grad_()
    compute = partial(saccade.torch.contrast_saliency, config=SETTINGS[name])
    weights = torch.rand(compute(images).saliency.shape, generator=generator, dtype=torch.float64)
    (weights * compute(images).saliency).sum().backward()
    for _ in range(4):
        step = torch.randn(images.shape, generator=generator, dtype=torch.float64) * 1e-7
        with torch.no_grad():
            ahead, behind = compute(images + step).saliency, compute(images - step).saliency
            slope = (weights * (ahead - behind)).sum() / 2
        expected = (images.grad * step).sum()
        assert abs(slope - expected) < 1e-6 * images.grad.norm() * step.norm()


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("level", [0.0, 0.4, 1.0])
def test_a_flat_image_has_no_saliency_and_no_gradient(name, level):
    images = torch.full((2, 3, 64, 80), level, requires_grad=True)
    saliency = saccade.torch.contrast_saliency(images, SETTINGS[name]).saliency
    saliency.sum().backward()
    assert not saliency.any()
    assert not images.grad.any()
    assert images.grad.isfinite().all()


def test_maps_of_inference_mode_do_not_spoil_later_gradients():
    images = torch.rand(1, 3, 71, 83, requires_grad=True)
    with torch.inference_mode():
        saccade.torch.contrast_saliency(images)
    saccade.torch.contrast_saliency(images).saliency.sum().backward()
    assert images.grad.any()


@pytest.mark.parametrize(
    ("images", "expected"),
    [
        (torch.zeros(3, 64, 64), r"\(B, 3, H, W\), found torch.float32 of shape \(3, 64, 64\)"),
        (torch.zeros(1, 1, 64, 64), "images: expected float32 or float64"),
        (torch.zeros(0, 3, 64, 64), "images: expected float32 or float64"),
        (torch.zeros(1, 3, 64, 64, dtype=torch.uint8), "float64 .* found torch.uint8"),
        (torch.full((1, 3, 64, 64), 255.0), r"images: expected values in \[0, 1\], found 255"),
        (torch.full((1, 3, 64, 64), torch.nan), "images: expected values"),
        (torch.zeros(1, 3, 3, 3), "image: expected more pixels"),
    ],
)
def test_other_images_are_refused(images, expected):
    with pytest.raises(ImageError, match=expected):
        saccade.torch.contrast_saliency(images)


@pytest.mark.parametrize(
    ("config", "expected"),
    [
        (ContrastConfig.kootstra2010(), 'variant: expected "mirrored"'),
        (ContrastConfig.saliencytoolbox2(), 'variant: expected "mirrored"'),
        (replace(DEFAULT, normalization=keep), "for the variant tensors, found 'keep'"),
        *(
            (replace(DEFAULT, normalization=name), f"for the variant tensors, found '{name}'")
            for name in NORMALIZATIONS.keys() - saccade.torch.NORMALIZATIONS.keys()
        ),
    ],
)
def test_other_steps_are_refused(config, expected):
    with pytest.raises(ConfigError, match=expected):
        saccade.torch.contrast_saliency(torch.zeros(1, 3, 64, 64), config)


def test_tensors_have_the_normalizations_that_name_them():
    assert [*saccade.torch.NORMALIZATIONS] == names_supported("tensors")


@pytest.fixture
def scored(rng):
    """Maps of a batch with a constant one, fixations of each image, and densities."""
    maps = rng.random((3, 15, 20))
    maps[1] = 0.5
    fixations = [rng.uniform(-0.5, (319.4, 239.4), (count, 2)) for count in (1, 5, 9)]
    return maps, fixations, rng.random((3, 30, 41)) ** 8


def numbered(fixations):
    rows = [(number, *xy) for number, each in enumerate(fixations) for xy in each]
    return torch.tensor(rows, dtype=torch.float64).reshape(-1, 3)


def test_losses_are_the_metrics_of_the_evaluation(scored):
    maps, fixations, density = scored
    tensors = SaliencyMaps(torch.as_tensor(maps), (240, 320))
    nss = saccade.torch.nss(tensors, numbered(fixations))
    kl = saccade.torch.kl(tensors, torch.as_tensor(density))
    for number, values in enumerate(maps):
        expected = metrics.nss(resize(values, (240, 320)), fixations[number])
        assert float(nss[number]) == pytest.approx(expected, abs=1e-9)
        expected = metrics.divergence(resize(values, (30, 41)), density[number])
        assert float(kl[number]) == pytest.approx(expected, abs=1e-6)


def test_losses_of_constant_maps_have_gradients_without_nan():
    saliency = torch.zeros(2, 12, 16, requires_grad=True)
    maps = SaliencyMaps(saliency, (96, 128))
    loss = saccade.torch.kl(maps, torch.rand(2, 12, 16)).sum()
    loss -= saccade.torch.nss(maps, numbered([[(40.0, 40.0)]] * 2)).sum()
    loss.backward()
    assert saliency.grad.isfinite().all()


@pytest.mark.parametrize(
    "fixations", [[], [[(5, 5)]], [[(1, 1)], [(128, 0)]], [[(1, 1)], [(0, -1)]], 3 * [[(1, 1)]]]
)
def test_fixations_outside_or_missing_are_refused(fixations):
    maps = SaliencyMaps(torch.rand(2, 12, 16), (96, 128))
    expected = "fixations: expected one or more inside each of 2 images of 128 x 96 px"
    with pytest.raises(ImageError, match=expected):
        saccade.torch.nss(maps, numbered(fixations))


def test_gradient_descent_on_an_image_moves_the_saliency():
    """The loss falls as the image is changed, so that a target becomes the most salient."""
    images = torch.full((1, 3, 96, 128), 0.5) + 0.02 * torch.rand(1, 3, 96, 128)
    images = images.requires_grad_()
    target = torch.tensor([[0, 30, 60]])
    config = replace(DEFAULT, viewing_size=None, map_level=3)
    optimizer, losses = torch.optim.Adam([images], lr=0.01), []
    for _ in range(12):
        maps: ContrastMaps = saccade.torch.contrast_saliency(images.clamp(0, 1), config)
        loss = -saccade.torch.nss(maps, target).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < losses[0] - 1


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_gpu_computes_fifteen_thousand_maps_a_second():
    """Batches of 64 images of 640 x 480 px that are on the GPU already, as a CUDA graph."""
    card = torch.cuda.get_device_name()
    if not any(name in card for name in ("H100", "H200")):
        pytest.skip(f"the bar is that of an H100 or H200, found {card}")
    images = torch.rand(64, 3, 480, 640, device="cuda")
    expected = saccade.torch.contrast_saliency(images[:4].cpu()).saliency
    stream = torch.cuda.Stream()
    with torch.no_grad(), torch.cuda.stream(stream):
        for _ in range(3):
            saccade.torch.contrast_saliency(images)
    torch.cuda.synchronize()
    graph = torch.cuda.CUDAGraph()
    with torch.no_grad(), torch.cuda.graph(graph):
        found = saccade.torch.contrast_saliency(images).saliency
    graph.replay()
    torch.cuda.synchronize()
    np.testing.assert_allclose(found[:4].cpu(), expected, atol=1e-5)
    start = time.perf_counter()
    for _ in range(50):
        graph.replay()
    torch.cuda.synchronize()
    assert 50 * 64 / (time.perf_counter() - start) > 15_000
