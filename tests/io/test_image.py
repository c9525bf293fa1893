"""Images of every accepted kind mean the same; everything else gets one clear line."""

import struct
import zlib
from io import BytesIO

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays
from PIL import Image as Pillow
from PIL import ImageOps

from saccade.errors import ImageError, ImageWarning
from saccade.io.image import as_gray, as_rgb, find_images, read_image, read_orientation
from support.error_checks import refuses
from support.extras import open_source

COLORS = np.arange(5 * 7 * 3, dtype=np.uint8).reshape(5, 7, 3)


def test_sixteen_bits_keep_their_depth(tmp_path):
    deep = np.array([[0, 1], [256, 65535]], np.uint16)
    path = tmp_path / "deep.png"
    cv2.imwrite(str(path), deep)
    np.testing.assert_allclose(read_image(path)[:, :, 1], deep / 65535, atol=1e-7)


def test_pictures_that_are_not_read_are_told(tmp_path):
    heic = tmp_path / "phone.heic"
    heic.write_bytes(bytes.fromhex("00000018") + b"ftypheic" + bytes(100))
    with pytest.raises(ImageError, match=r"HEIC or AVIF.; convert it to JPEG or PNG"):
        read_image(heic)
    cv2.imwrite(str(tmp_path / "a.png"), COLORS)
    for find in (find_images, lambda folder: open_source(str(folder))):
        with pytest.warns(ImageWarning, match=r"left out: 1 \.heic, not supported"):
            assert len(find(tmp_path)) == 1
    with pytest.warns(ImageWarning, match=r"left out: 1 \.heic"):
        assert len(open_source(f"{tmp_path}/*")) == 1


def test_a_folder_has_every_picture_that_can_be_read(tmp_path):
    """Files of the formats under each of their suffixes."""
    for suffix, kind in (
        *(
            (".jfif", ".jpg"),
            (".jpe", ".jpg"),
            (".JPG", ".jpg"),
            (".dib", ".bmp"),
            (".pnm", ".ppm"),
        ),
        *((each, each) for each in (".jp2", ".ppm", ".ras", ".sr", ".webp", ".tif", ".png")),
        *((each, each) for each in (".pgm", ".pbm")),
    ):
        shape = (128, 96) if kind in (".pgm", ".pbm") else (128, 96, 3)
        data = cv2.imencode(kind, np.zeros(shape, np.uint8))[1]
        (tmp_path / f"a{suffix}").write_bytes(data.tobytes())
    for other in ("a.cr2", "a.dng", "notes.txt"):
        (tmp_path / other).write_bytes(b"raw")
    for find in (find_images, lambda folder: open_source(str(folder))):
        with pytest.warns(ImageWarning, match=r"left out: 1 \.cr2, 1 \.dng, not"):
            assert len(find(tmp_path)) == 14
    for path in tmp_path.glob("a.*"):
        if path.suffix not in (".cr2", ".dng"):
            assert read_image(path).shape == (128, 96, 3)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("mode", ["RGBA", "LA"])
@pytest.mark.parametrize("kind", ["PNG", "WEBP", "TIFF"])
def test_transparent_files_are_composited_as_by_pillow(tmp_path, kind, mode, orientation):
    rgba = np.random.default_rng(3).integers(0, 256, (8, 12, 4), np.uint8)
    picture = Pillow.fromarray(rgba)
    if mode == "LA":
        picture = Pillow.merge("LA", picture.split()[2:])
    exif = picture.getexif()
    exif[0x0112] = orientation
    path = tmp_path / "clear"
    picture.save(
        path, kind, exif=exif, **{"lossless": True, "exact": True} if kind == "WEBP" else {}
    )
    turned = ImageOps.exif_transpose(picture).convert("RGBA")
    for background, options in ((255, {}), (51, {"background": (0.2, 0.2, 0.2)})):
        behind = Pillow.new("RGBA", turned.size, (background,) * 3)
        expected = np.asarray(Pillow.alpha_composite(behind, turned).convert("RGB"))
        np.testing.assert_allclose(read_image(path, **options) * 255, expected, atol=1.01)


@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16])
def test_a_transparent_gray_of_a_png_is_white(tmp_path, bits):
    """A file by the specification: a chunk tRNS with the gray value that is transparent."""

    def chunk(kind, content):
        body = kind + content
        return struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))

    values, top = np.arange(16) % 2**bits, 2**bits - 1
    spread = (values[:, None] >> np.arange(bits)[::-1]) & 1
    rows = b"".join(b"\0" + np.packbits(spread.ravel()).tobytes() for _ in range(3))
    clear = 0 if bits == 1 else 1
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 16, 3, bits, 0, 0, 0, 0))
    data += chunk(b"tRNS", struct.pack(">H", clear)) + chunk(b"IDAT", zlib.compress(rows))
    (tmp_path / "a.png").write_bytes(data + chunk(b"IEND", b""))
    expected = np.where(values == clear, 1, values / top)
    for channel in range(3):
        found = read_image(tmp_path / "a.png")[:, :, channel]
        np.testing.assert_allclose(found, np.tile(expected, (3, 1)), atol=1e-6)


def test_a_palette_with_a_transparent_entry_and_deep_transparency_are_composited(tmp_path):
    indexed, deep = tmp_path / "palette.png", tmp_path / "deep.png"
    palette = Pillow.fromarray(np.array([[0, 1]], np.uint8), "P")
    palette.putpalette([10, 20, 30, 40, 50, 60])
    palette.save(indexed, transparency=1)
    np.testing.assert_allclose(read_image(indexed)[0] * 255, [[10, 20, 30], [255, 255, 255]])
    cv2.imwrite(str(deep), np.full((2, 2, 4), (0, 0, 65535, 16384), np.uint16))
    np.testing.assert_allclose(read_image(deep)[0, 0], [1, 0.75, 0.75], atol=1e-4)


def test_a_tiff_of_floats_is_read_and_what_is_no_number_in_it_is_said(tmp_path):
    """Gray ones too, which OpenCV refuses to read as colors."""
    gray = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
    for values in (gray.copy(), np.stack([gray] * 3, 2)):
        exactly = [cv2.IMWRITE_TIFF_COMPRESSION, 1]
        cv2.imwrite(str(tmp_path / "a.tiff"), values, exactly)
        np.testing.assert_array_equal(read_image(tmp_path / "a.tiff")[:, :, 1], gray)
        values[2, 1] = np.nan
        cv2.imwrite(str(tmp_path / "a.tiff"), values, exactly)
        with refuses(ImageError, "a.tiff: expected finite", "found NaN", "in row 2, column 1"):
            read_image(tmp_path / "a.tiff")


def test_values_of_fewer_bits_are_remarked_on_or_scaled(tmp_path):
    deep = np.array([[0, 2000], [3000, 4095]], np.uint16)
    path = tmp_path / "twelve.tif"
    cv2.imwrite(str(path), deep)
    with pytest.warns(ImageWarning, match=r"twelve.tif: .* 12-bit .* white=4095"):
        assert read_image(path).max() < 0.07
    np.testing.assert_allclose(read_image(path, white=4095)[:, :, 0], deep / 4095, atol=1e-7)
    with pytest.raises(ImageError, match="up to white=1023, found 4095"):
        as_rgb(deep, white=1023)


def test_a_rotated_photograph_is_turned_upright(tmp_path):
    tall = np.zeros((40, 16, 3), np.uint8)
    tall[:20] = 255
    jpeg = cv2.imencode(".jpg", np.rot90(tall))[1].tobytes()
    turn_right = bytes.fromhex(
        "ffe1 0022 457869660000 4d4d002a00000008 0001 0112 0003 00000001 0006 0000 00000000"
    )
    path = tmp_path / "phone.jpg"
    path.write_bytes(jpeg[:2] + turn_right + jpeg[2:])
    image = read_image(path)
    assert image.shape == (40, 16, 3)
    assert image[5].mean() > 0.9
    assert image[35].mean() < 0.1


@pytest.mark.filterwarnings("ignore:.*appear dark")
@given(arrays(np.uint8, (4, 6, 3)))
def test_every_dtype_means_the_same_picture(pixels):
    expected = as_rgb(pixels)
    np.testing.assert_allclose(as_rgb(pixels / 255), expected, atol=1e-7)
    np.testing.assert_allclose(as_rgb(pixels.astype(np.uint16) * 257), expected, atol=1e-7)
    opaque = np.full(pixels.shape[:2], 255, np.uint8)
    np.testing.assert_array_equal(as_rgb(np.dstack([pixels, opaque])), expected)
    np.testing.assert_array_equal(as_rgb(pixels[:, ::-1])[:, ::-1], expected)


@pytest.mark.parametrize("predictor", [1, 2])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("orientation", [1, 6])
def test_a_gray_tiff_of_16_bits_lies_on_white(tmp_path, rng, order, predictor, orientation):
    """A file by the specification: samples of gray and opacity in turn, deflated."""
    gray, alpha = rng.integers(0, 1 << 16, (2, 5, 7)).astype(np.uint16)
    alpha[:3, 2] = (0, 65535, 32768)
    rows = np.dstack([gray, alpha])
    if predictor == 2:
        rows = np.diff(rows, axis=1, prepend=np.uint16(0))
    strip = zlib.compress(rows.astype(f"{order}u2").tobytes())
    tags = [
        *((256, "H", 7), (257, "H", 5), (258, "HH", 16, 16), (259, "H", 8), (262, "H", 1)),
        *((273, "I", 8), (274, "H", orientation), (277, "H", 2), (278, "H", 5)),
        *((279, "I", len(strip)), (284, "H", 1), (317, "H", predictor), (338, "H", 2)),
    ]
    strip += bytes(len(strip) % 2)
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", 8 + len(strip))
    entries = [
        struct.pack(f"{order}HHI", tag, 4 if kind == "I" else 3, len(values))
        + struct.pack(order + kind, *values).ljust(4, b"\0")
        for tag, kind, *values in tags
    ]
    path = tmp_path / "a.tif"
    path.write_bytes(
        head + strip + struct.pack(f"{order}H", len(tags)) + b"".join(entries) + bytes(4)
    )
    opacity = alpha / 65535
    expected = gray / 65535 * opacity + 1 - opacity
    expected = np.rot90(expected, -1) if orientation == 6 else expected
    found = read_image(path)
    np.testing.assert_allclose(found, np.repeat(expected[:, :, None], 3, axis=2), atol=1e-5)
    assert read_orientation(path) == orientation


def test_transparency_lies_on_white_and_a_trace_over_one_is_cut_off(rng):
    pixels = rng.integers(0, 256, (5, 6, 3)).astype(np.uint8)
    alpha = rng.choice(np.array([0, 255], np.uint8), (5, 6))
    expected = np.where(alpha[:, :, None] == 0, 255, pixels) / 255
    np.testing.assert_allclose(as_rgb(np.dstack([pixels, alpha])), expected, atol=1e-7)
    np.testing.assert_array_equal(as_rgb(alpha > 0)[:, :, 1], alpha > 0)
    np.testing.assert_array_equal(as_rgb(np.array([[1.0005, -0.0005]]))[0, :, 0], [1, 0])


@given(arrays(np.uint8, (5, 4, 3)))
def test_gray_is_that_of_opencv(pixels):
    expected = cv2.cvtColor((pixels / 255).astype(np.float32), cv2.COLOR_RGB2GRAY)
    np.testing.assert_allclose(as_gray(pixels), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((0, 5)), "at least one pixel"),
        (np.zeros(5), r"shape .*found \(5,\)"),
        (np.zeros((4, 4, 2)), r"found \(4, 4, 2\)"),
        (np.full((4, 4), np.nan), "NaN"),
        (np.full((4, 4), np.inf), "infinity"),
        (np.full((4, 4), 255.0), r"\[0, 1\], found 255 to 255"),
        (np.zeros((4, 4), np.int32), "found int32"),
        (np.zeros((4, 4), complex), "found complex128"),
    ],
)
def test_what_is_no_image_is_refused_in_one_line(image, words):
    with pytest.raises(ImageError, match=words) as caught:
        as_rgb(image)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("share", [0.3, 0.7, 0.98])
def test_a_truncated_file_is_refused(tmp_path, capfd, suffix, share):
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    data = cv2.imencode(suffix, noise)[1].tobytes()
    path = tmp_path / f"cut{suffix}"
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(ImageError, match=f"cut{suffix}: .*cut short"):
        read_image(path)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "No such file"), (b"", "empty file"), (b"a letter", "another format")],
)
def test_a_file_that_is_no_image_is_named(tmp_path, capfd, content, words):
    path = tmp_path / "letter.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ImageError, match=f"letter.png: .*{words}"):
        read_image(path)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("source", "words"),
    [("", "empty name"), ("**x.png", "expected (a pattern|images)"), ("x" * 300, "cannot"),
     ("no*.png", "found none")],
)  # fmt: skip
def test_what_names_no_image_is_refused(tmp_path, monkeypatch, source, words):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("here.png", COLORS)
    with pytest.raises(ImageError, match=words):
        [read_image(each) for each in find_images(source)]


def test_a_folder_whose_name_ends_like_an_image_is_left_out(tmp_path):
    (tmp_path / "folder.png").mkdir()
    cv2.imwrite(str(tmp_path / "[a].png"), COLORS)
    expected = [tmp_path / "[a].png"]
    assert find_images(tmp_path) == find_images(tmp_path / "*.png") == expected
    assert find_images(expected[0]) == expected


def test_a_cut_photograph_is_not_taken_for_whole_by_its_thumbnail(tmp_path, rng):
    def jpeg(shape):
        return cv2.imencode(".jpg", rng.integers(0, 256, shape, np.uint8))[1].tobytes()

    photograph, thumbnail = jpeg((64, 64, 3)), jpeg((8, 8, 3))
    note = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    whole = photograph[:2] + note + photograph[2:]
    path = tmp_path / "photograph.jpg"
    path.write_bytes(whole)
    assert read_image(path).shape == (64, 64, 3)
    path.write_bytes(whole[: len(whole) * 3 // 4])
    with pytest.raises(ImageError, match="cut short"):
        read_image(path)


TRAILERS = {
    "video": b"\0\0\0\x18ftypmp42" + b"\xff\xda\0\x03\0" + bytes(range(256)),
    "zeros": bytes(1000),
    "end-and-scan": b"\xff\xd9\xff\xda\0\x0c",
    "cut-photograph": b"\xff\xd8\xff\xe0\0\x10JFIF\0",
    "samsung": b"SEFH" + bytes(20) + b"SEFT",
}


@pytest.mark.parametrize("name", TRAILERS)
@pytest.mark.parametrize(
    "options",
    [{}, {"progressive": True}, {"restart_marker_rows": 1}, {"comment": b"\xff\xd9 \xff\xda"}],
    ids=["baseline", "progressive", "restarts", "comment"],
)
def test_a_whole_photograph_is_read_whatever_follows_it(tmp_path, rng, options, name):
    pixels, content = rng.integers(0, 256, (40, 60, 3), np.uint8), BytesIO()
    Pillow.fromarray(pixels).save(content, "JPEG", **options)
    (tmp_path / "a.jpg").write_bytes(content.getvalue())
    (tmp_path / "b.jpg").write_bytes(content.getvalue() + TRAILERS[name])
    np.testing.assert_array_equal(read_image(tmp_path / "a.jpg"), read_image(tmp_path / "b.jpg"))
    (tmp_path / "c.jpg").write_bytes(content.getvalue()[:-60])
    with pytest.raises(ImageError, match=r"c\.jpg: the image is cut short"):
        read_image(tmp_path / "c.jpg")
