from __future__ import annotations

import cv2
import numpy as np
import PIL.Image
import pytest
import skimage.io
import tifffile

from matest.photographs.images import full_scale, read_image, read_mask, write_image
from tests.captures import put_image, refusal
from tests.photographs.image_files import write_exr, write_hdr

HEIGHT, WIDTH = 12, 17


def codes(dtype: type, *channels: int) -> np.ndarray:
    """Random full-range integers, seed fixed."""
    rng = np.random.default_rng(11)
    return rng.integers(0, np.iinfo(dtype).max, (HEIGHT, WIDTH, *channels), dtype=dtype, endpoint=True)


def floats(*channels: int) -> np.ndarray:
    return (10 ** np.random.default_rng(12).uniform(-4, 4, (HEIGHT, WIDTH, *channels))).astype(np.float32)


def with_last_axis(image: np.ndarray) -> np.ndarray:
    return image if image.ndim == 3 else image[..., None]


def assert_read(path, image: np.ndarray) -> None:
    read = read_image(path)
    assert read.dtype == image.dtype
    np.testing.assert_array_equal(read, with_last_axis(image))


@pytest.mark.parametrize("suffix", [".png", ".tif", ".tiff", ".TIFF"])
@pytest.mark.parametrize("channels", [(), (3,)], ids=["grey", "RGB"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integers_keep_their_bits_and_rgb_order(tmp_path, suffix, channels, dtype):
    image = codes(dtype, *channels)
    put_image(tmp_path / f"by_opencv{suffix}", image)
    assert_read(tmp_path / f"by_opencv{suffix}", image)


@pytest.mark.parametrize("channels", [(), (3,)], ids=["grey", "RGB"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_tiff_of_another_writer_is_read_alike(tmp_path, channels, dtype, byteorder, compression):
    image = codes(dtype, *channels)
    photometric = "rgb" if channels else "minisblack"
    path = tmp_path / "image.tif"
    tifffile.imwrite(path, image, byteorder=byteorder, compression=compression, photometric=photometric)
    assert_read(path, image)


@pytest.mark.parametrize("channels", [(), (3,)], ids=["grey", "RGB"])
def test_png_of_another_writer_is_read_alike(tmp_path, channels):
    path = tmp_path / "image.png"
    image = codes(np.uint8, *channels)
    PIL.Image.fromarray(image).save(path)
    assert_read(path, image)
    skimage.io.imsave(path, image, check_contrast=False)
    assert_read(path, image)


def test_sixteen_bit_grey_png_of_another_writer_is_read_alike(tmp_path):
    image = codes(np.uint16)
    PIL.Image.fromarray(image).save(tmp_path / "image.png")
    assert_read(tmp_path / "image.png", image)


def test_a_mask_of_one_bit_has_the_values_zero_and_full_scale(tmp_path):
    image = codes(np.uint8) > 127
    PIL.Image.fromarray(image).save(tmp_path / "mask.png")
    assert_read(tmp_path / "mask.png", np.where(image, 255, 0).astype(np.uint8))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_alpha_is_dropped(tmp_path, dtype):
    image = codes(dtype, 4)
    path = tmp_path / "image.png"
    assert cv2.imwrite(str(path), image[..., [2, 1, 0, 3]])
    assert_read(path, image[..., :3])


def test_grey_with_alpha_stays_grey(tmp_path):
    image = codes(np.uint8, 2)
    PIL.Image.fromarray(image, "LA").save(tmp_path / "image.png")
    assert_read(tmp_path / "image.png", image[..., 0])


@pytest.mark.parametrize("suffix", [".jpg", ".jpeg", ".JPG"])
def test_jpeg_keeps_rgb_order_and_grey(tmp_path, suffix):
    colours = np.zeros((16, 48, 3), np.uint8) + np.repeat(
        np.array([[250, 40, 30], [20, 240, 50], [40, 30, 230]], np.uint8), 16, axis=0
    )
    path = tmp_path / f"image{suffix}"
    PIL.Image.fromarray(colours).save(path, "JPEG", quality=95)
    np.testing.assert_allclose(read_image(path).astype(int)[:, 4::16], colours.astype(int)[:, 4::16], atol=6)
    PIL.Image.fromarray(colours[..., 0]).save(path, "JPEG", quality=95)
    assert read_image(path).shape == (16, 48, 1)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("names", ["RGB", "RGBA", "Y", "XYZ", "Z"])
def test_exr_channels_are_found_by_name(tmp_path, dtype, names):
    planes = {name: floats()[::-1].astype(dtype) * (k + 1) for k, name in enumerate(names)}
    if "A" in planes:
        planes["A"] = np.ones_like(planes["A"])
    write_exr(tmp_path / "image.exr", planes)
    expected = np.stack([planes[name] for name in names[:3]], axis=-1)
    assert_read(tmp_path / "image.exr", expected.astype(np.float32))


@pytest.mark.parametrize("channels", [(), (1,), (3,)])
def test_a_written_exr_is_read_back_exactly(tmp_path, channels):
    image = floats(*channels)
    write_image(tmp_path / "image.exr", image)
    assert_read(tmp_path / "image.exr", image)


@pytest.mark.parametrize("channels", [(), (1,), (3,)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_written_png_is_read_back_exactly(tmp_path, channels, dtype):
    image = codes(dtype, *channels)
    write_image(tmp_path / "image.png", image)
    assert_read(tmp_path / "image.png", image)
    if dtype == np.uint8:  # Pillow, which scikit-image reads with, knows no 16-bit colour
        np.testing.assert_array_equal(skimage.io.imread(tmp_path / "image.png"), image.squeeze())


def test_exr_without_colour_channels_is_refused(tmp_path):
    path = tmp_path / "image.exr"
    write_exr(path, {"depth": floats(), "id": floats()})
    message = refusal(lambda: read_image(path))
    assert str(path) in message
    assert "depth, id" in message


def test_radiance_files_hold_mantissa_times_power_of_two(tmp_path):
    rng = np.random.default_rng(5)
    mantissa = rng.integers(128, 256, (5, 7, 3), dtype=np.uint8)
    values = write_hdr(tmp_path / "image.hdr", mantissa, rng.integers(120, 140, (5, 7), dtype=np.uint8))
    read = read_image(tmp_path / "image.hdr")
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, values, rtol=1 / 128)  # readers differ by half a code of the mantissa


def test_radiance_files_of_opencv_keep_rgb_order(tmp_path):
    image = floats(3) + floats(3).max(axis=2, keepdims=True)
    put_image(tmp_path / "image.hdr", image)
    np.testing.assert_allclose(read_image(tmp_path / "image.hdr"), image, rtol=1 / 64)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64, np.float16])
@pytest.mark.parametrize("channels", [(), (1,), (3,), (4,)])
def test_npy_is_read_as_stored(tmp_path, dtype, channels):
    image = (200 * np.random.default_rng(6).random((HEIGHT, WIDTH, *channels))).astype(dtype)
    np.save(tmp_path / "image.npy", image)
    read = read_image(tmp_path / "image.npy")
    assert read.dtype == (dtype if np.dtype(dtype).kind == "u" else np.float32)
    np.testing.assert_array_equal(read, with_last_axis(image)[..., :3].astype(read.dtype))


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_npy_is_read_in_either_byte_order(tmp_path, dtype):
    image = (200 * np.random.default_rng(6).random((HEIGHT, WIDTH, 3))).astype(dtype)
    for order in "<>":
        np.save(tmp_path / "image.npy", image.astype(image.dtype.newbyteorder(order)))
        assert_read(tmp_path / "image.npy", image)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".exr", ".hdr", ".npy"])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.6, 0.97])
def test_a_truncated_file_is_refused(tmp_path, suffix, share):
    path = tmp_path / f"image{suffix}"
    image = np.random.default_rng(7).random((40, 50, 3))
    if suffix == ".exr":
        write_image(path, image)
    else:
        put_image(path, image.astype(np.float32) if suffix in (".hdr", ".npy") else (255 * image).astype(np.uint8))
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert str(path) in refusal(lambda: read_image(path))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".exr", ".hdr", ".npy"])
def test_a_file_of_another_format_is_refused(tmp_path, suffix):
    path = tmp_path / f"image{suffix}"
    path.write_bytes(b"This is a letter, no photograph. " * 40)
    assert str(path) in refusal(lambda: read_image(path))


def test_a_png_with_flipped_bits_is_refused(tmp_path):
    path = tmp_path / "image.png"
    put_image(path, codes(np.uint8, 3))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    assert str(path) in refusal(lambda: read_image(path))


def test_an_npy_file_whose_header_never_ends_is_refused(tmp_path):
    path = tmp_path / "image.npy"
    np.save(path, codes(np.uint8, 3))
    path.write_bytes(path.read_bytes().replace(b"}", b"("))
    assert str(path) in refusal(lambda: read_image(path))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("suffix", [".exr", ".npy"])
def test_values_that_are_not_finite_are_refused_and_counted(tmp_path, bad, suffix):
    path = tmp_path / f"image{suffix}"
    image = floats(3)
    image[2, 3, 1] = image[5, 6, 0] = image[5, 6, 2] = bad
    if suffix == ".exr":
        write_exr(path, {name: np.ascontiguousarray(image[..., k]) for k, name in enumerate("RGB")})
    else:
        np.save(path, image)
    message = refusal(lambda: read_image(path))
    assert str(path) in message
    assert "2 pixels" in message


def test_values_whose_squares_overflow_are_refused(tmp_path):
    image = floats(3)
    image[2, 3, 1] = 1e38
    np.save(tmp_path / "image.npy", image)
    assert "1 pixel holds" in refusal(lambda: read_image(tmp_path / "image.npy"))


def test_a_signalling_nan_of_double_precision_is_refused_without_a_warning(tmp_path):
    image = floats(3).astype(np.float64)
    image.view(np.uint64)[2, 3, 1] = 0x7FF4 << 48
    np.save(tmp_path / "image.npy", image)
    assert "1 pixel holds" in refusal(lambda: read_image(tmp_path / "image.npy"))


def test_an_array_larger_than_memory_is_refused(tmp_path):
    path = tmp_path / "image.npy"
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(
            file, {"descr": "<f4", "fortran_order": False, "shape": (1 << 20, 1 << 20, 1 << 10)}
        )
        file.write(bytes(64))
    message = refusal(lambda: read_image(path))
    assert message.startswith(f"{path}: ")


def test_a_missing_file_is_refused(tmp_path):
    path = tmp_path / "none.png"
    message = refusal(lambda: read_image(path))
    assert str(path) in message
    assert "no such image" in message


@pytest.mark.parametrize("name", ["image.xcf", "image.txt", "image"])
def test_an_unknown_suffix_is_refused_with_the_known_ones(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"x")
    message = refusal(lambda: read_image(path))
    assert str(path) in message
    assert ".exr" in message


@pytest.mark.parametrize(
    "array",
    [np.zeros(5), np.zeros((4, 4, 7)), np.zeros((2, 3, 4, 3)), np.zeros((0, 4)), np.zeros((4, 4), np.int32)],
    ids=["line", "7 channels", "film", "empty", "int32"],
)
def test_arrays_that_are_no_image_are_refused(tmp_path, array):
    path = tmp_path / "array.npy"
    np.save(path, array)
    assert str(path) in refusal(lambda: read_image(path))


def test_a_mask_is_the_brightest_channel_as_a_share_of_its_maximum(tmp_path):
    mask = np.zeros((4, 5, 3), np.uint8)
    mask[1, 2] = (0, 100, 20)
    mask[1, 3] = (50, 0, 0)
    put_image(tmp_path / "mask.png", mask)
    level = read_mask(tmp_path / "mask.png")
    assert level.shape == (4, 5)
    assert level[1, 2] == 1
    assert level[1, 3] == 0.5
    assert np.count_nonzero(level) == 2


def test_an_alpha_that_differs_between_pixels_is_the_mask(tmp_path):
    image = np.full((4, 5, 4), 200, np.uint8)
    image[..., 3] = 0
    image[1, 2, 3], image[1, 3, 3] = 255, 51
    PIL.Image.fromarray(image).save(tmp_path / "cut_out.png")
    level = read_mask(tmp_path / "cut_out.png")
    assert level[1, 2] == 1
    assert level[1, 3] == 0.2
    assert np.count_nonzero(level) == 2


def test_an_alpha_that_is_the_same_everywhere_is_no_mask(tmp_path):
    image = np.full((4, 5, 4), 255, np.uint8)
    image[..., :3] = 0
    image[1, 2, :3] = 9
    PIL.Image.fromarray(image).save(tmp_path / "mask.png")
    assert np.count_nonzero(read_mask(tmp_path / "mask.png")) == 1


def test_a_mask_that_is_zero_everywhere_is_refused(tmp_path):
    path = tmp_path / "mask.png"
    put_image(path, np.zeros((4, 5), np.uint8))
    message = refusal(lambda: read_mask(path))
    assert str(path) in message
    assert "zero everywhere" in message


def test_full_scale_is_the_largest_code_and_one_for_floats():
    assert [full_scale(np.dtype(kind)) for kind in (np.uint8, np.uint16, np.float32)] == [255, 65535, 1]


def test_an_exr_image_that_does_not_fit_the_disk_is_an_error_of_the_file(tmp_path):
    resource = pytest.importorskip("resource", reason="this system has no limit of the size of files")
    image = np.random.default_rng(1).random((64, 64, 3))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 12, hard))
    try:
        with pytest.raises(OSError, match="cannot be written") as caught:
            write_image(tmp_path / "00.exr", image)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.filename == str(tmp_path / "00.exr")
