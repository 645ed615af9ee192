from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest
import tifffile

from matest.photographs.images import full_scale, read_image, read_image_file
from matest.photographs.readers.tiff import read_tiff
from tests.captures import refusal

HEIGHT, WIDTH = 21, 34


def content(dtype: type, *channels: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    if np.dtype(dtype).kind == "f":
        return rng.uniform(-2, 9, (HEIGHT, WIDTH, *channels)).astype(dtype)
    return rng.integers(0, np.iinfo(dtype).max, (HEIGHT, WIDTH, *channels), dtype=dtype, endpoint=True)


def write(path: Path, image: np.ndarray, **options: object) -> Path:
    """By tifffile; `image` is H×W or H×W×3 also where planes are stored."""
    planar = options.get("planarconfig") == "separate"
    photometric = options.pop("photometric", "rgb" if image.ndim == 3 else "minisblack")
    stored = np.moveaxis(image, -1, 0) if planar else image
    tifffile.imwrite(path, stored, photometric=photometric, metadata=None, **options)
    return path


@pytest.mark.parametrize("options", [{}, {"tile": (16, 16)}, {"rowsperstrip": 5}], ids=["one", "tiles", "strips"])
@pytest.mark.parametrize("compression", [None, "zlib", "lzw", "packbits", "zstd", "lzma"])
@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32])
def test_colours_are_exact_however_they_are_stored(tmp_path, dtype, planar, compression, options):
    image = content(dtype, 3)
    path = write(tmp_path / "a.tif", image, planarconfig=planar, compression=compression, **options)
    read = read_image(path)
    assert read.dtype == (np.float32 if dtype == np.float16 else dtype)
    np.testing.assert_array_equal(read, image)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("predictor", [False, True])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_grey_is_exact_in_both_byte_orders_with_and_without_differences(tmp_path, dtype, predictor, byteorder, big):
    image = content(dtype)
    write(tmp_path / "a.tif", image, byteorder=byteorder, predictor=predictor, compression="zlib", bigtiff=big)
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif")[..., 0], image)


@pytest.mark.parametrize("channels", [(), (3,)], ids=["grey", "RGB"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_files_of_opencv_and_of_this_reader_agree(tmp_path, dtype, channels):
    image = content(dtype, *channels)
    assert cv2.imwrite(str(tmp_path / "a.tif"), image)
    decoded = cv2.imread(str(tmp_path / "a.tif"), cv2.IMREAD_UNCHANGED)
    expected = decoded[..., ::-1] if channels else decoded[..., None]
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), expected)


@pytest.mark.parametrize("mode", ["1", "L", "I;16", "RGB", "RGBA", "LA", "F"])
def test_files_of_pillow_have_the_values_that_pillow_reads(tmp_path, mode):
    kinds = {"1": (bool, ()), "I;16": (np.uint16, ()), "F": (np.float32, ()), "LA": (np.uint8, (2,))}
    dtype, channels = kinds.get(mode, (np.uint8, () if mode == "L" else (len(mode),)))
    image = content(np.uint8) > 127 if dtype is bool else content(dtype, *channels)
    PIL.Image.fromarray(image).save(tmp_path / "a.tif", compression="raw")
    expected = np.asarray(PIL.Image.open(tmp_path / "a.tif"))
    expected = 255 * expected.astype(np.uint8) if dtype is bool else expected
    expected = expected if expected.ndim == 3 else expected[..., None]
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), expected[..., : 1 if expected.shape[2] < 3 else 3])


def test_a_mask_of_one_bit_is_black_and_white_with_fax_compression(tmp_path):
    image = content(np.uint8) > 127
    PIL.Image.fromarray(image).save(tmp_path / "mask.tif", compression="group4")
    np.testing.assert_array_equal(read_image(tmp_path / "mask.tif")[..., 0], np.where(image, 255, 0))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_where_white_is_zero_codes_are_turned_round(tmp_path, dtype):
    image = content(dtype)
    write(tmp_path / "a.tif", image, photometric="miniswhite")
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif")[..., 0], np.iinfo(dtype).max - image)


def test_floats_whose_white_is_zero_are_refused(tmp_path):
    write(tmp_path / "a.tif", content(np.float32), photometric="miniswhite")
    assert "white is zero" in refusal(lambda: read_image(tmp_path / "a.tif"))


def test_stretched_32_bit_codes_are_16_bit_codes(tmp_path):
    image = content(np.uint16, 3)
    write(tmp_path / "a.tif", image.astype(np.uint32) * 65537)
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), image)


def packed(codes: np.ndarray, bits: int) -> bytes:
    """A TIFF of grey codes of any number of bits, byte by byte."""
    digits = np.unpackbits(codes.astype(">u2")[..., None].view(np.uint8), axis=-1)[..., 16 - bits :]
    rows = np.packbits(digits.reshape(HEIGHT, -1), axis=1).tobytes()
    rows += bytes(len(rows) % 2)
    # Width, height, bits, no compression, black is zero, offset, channels, rows of a strip, bytes.
    shorts = {258: bits, 259: 1, 262: 1, 277: 1}
    longs = {256: WIDTH, 257: HEIGHT, 273: 8, 278: HEIGHT, 279: len(rows)}
    entries = [struct.pack(">HHIHH", tag, 3, 1, value, 0) for tag, value in shorts.items()]
    entries += [struct.pack(">HHII", tag, 4, 1, value) for tag, value in longs.items()]
    directory = struct.pack(">H", len(entries)) + b"".join(sorted(entries)) + bytes(4)
    return b"MM\0*" + struct.pack(">I", 8 + len(rows)) + rows + directory


@pytest.mark.parametrize("shape", [(1, 5), (5, 1), (1, 1), (1, 5, 3), (5, 1, 3), (1, 1, 3)])
@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_images_of_one_row_or_column_keep_their_shape(tmp_path, planar, shape):
    image = np.random.default_rng(5).integers(0, 255, shape, dtype=np.uint8)
    write(tmp_path / "a.tif", image, **({"planarconfig": planar} if len(shape) == 3 else {}))
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), image.reshape(*shape[:2], -1))


@pytest.mark.parametrize("bits", range(1, 17))
def test_codes_of_any_bits_are_fractions_of_the_largest(tmp_path, bits):
    codes = content(np.uint16) >> (16 - bits)
    (tmp_path / "a.tif").write_bytes(packed(codes, bits))
    file = read_image_file(tmp_path / "a.tif")
    fractions = file.pixels[..., 0] / full_scale(file.pixels.dtype)
    np.testing.assert_allclose(fractions, codes / (2**bits - 1), rtol=1e-7)
    assert bool(file.notes) == (bits not in (1, 2, 4, 8, 16))


def test_alpha_beside_the_colours_is_set_apart(tmp_path):
    image = content(np.uint16, 4)
    write(tmp_path / "a.tif", image, extrasamples=["unassalpha"])
    file = read_image_file(tmp_path / "a.tif")
    np.testing.assert_array_equal(file.pixels, image[..., :3])
    np.testing.assert_array_equal(file.coverage, image[..., 3])


def test_a_further_channel_that_is_no_alpha_is_dropped(tmp_path):
    image = content(np.uint16, 5)
    write(tmp_path / "a.tif", image, extrasamples=["unspecified", "unspecified"])
    file = read_image_file(tmp_path / "a.tif")
    np.testing.assert_array_equal(file.pixels, image[..., :3])
    assert file.coverage is None


def test_alpha_multiplied_into_floats_is_divided_out_and_said_to_be(tmp_path):
    colours, alpha = np.abs(content(np.float32, 3)), np.full((HEIGHT, WIDTH, 1), 0.25, np.float32)
    alpha[:3] = 0
    write(tmp_path / "a.tif", np.concatenate([colours * alpha, alpha], axis=2), extrasamples=["assocalpha"])
    file = read_image_file(tmp_path / "a.tif")
    np.testing.assert_array_equal(file.pixels[3:], colours[3:])
    assert not file.pixels[:3].any()
    assert "alpha" in file.notes[0]


def test_alpha_multiplied_into_integers_is_refused_unless_it_is_full(tmp_path):
    image = content(np.uint8, 4)
    write(tmp_path / "a.tif", image, extrasamples=["assocalpha"])
    assert "not exact" in refusal(lambda: read_image(tmp_path / "a.tif"))
    image[..., 3] = 255
    write(tmp_path / "a.tif", image, extrasamples=["assocalpha"])
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), image[..., :3])


@pytest.mark.parametrize(
    ("name", "channels", "options"),
    [
        ("PALETTE", (), {"photometric": "palette", "colormap": np.zeros((3, 256), np.uint16)}),
        ("SEPARATED", (4,), {"photometric": "separated"}),
        ("YCBCR", (3,), {"photometric": "ycbcr"}),
        ("CIELAB", (3,), {"photometric": "cielab"}),
    ],
)
def test_colours_that_are_not_rgb_are_refused_by_name(tmp_path, name, channels, options):
    write(tmp_path / "a.tif", content(np.uint8, *channels), **options)
    message = refusal(lambda: read_image(tmp_path / "a.tif"))
    assert str(tmp_path / "a.tif") in message
    assert name in message


def test_lossy_compression_is_refused(tmp_path):
    PIL.Image.fromarray(content(np.uint8)).save(tmp_path / "a.tif", compression="jpeg")
    assert "JPEG compression" in refusal(lambda: read_image(tmp_path / "a.tif"))


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.uint64, np.complex64])
def test_other_numbers_are_refused(tmp_path, dtype):
    write(tmp_path / "a.tif", np.ones((HEIGHT, WIDTH), dtype))
    assert "unsigned integers" in refusal(lambda: read_image(tmp_path / "a.tif"))


def test_only_the_first_page_is_read_and_that_is_said(tmp_path):
    first, second = content(np.uint16), content(np.uint16)[::-1]
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(first, metadata=None)
        file.write(second, metadata=None)
        file.write(first[::4, ::4], subfiletype=1, metadata=None)
    read = read_image_file(tmp_path / "a.tif")
    np.testing.assert_array_equal(read.pixels[..., 0], first)
    assert read.notes == ("only the first of 2 pages is read",)


@pytest.mark.parametrize("compression", [None, "zlib", "lzw", "packbits"])
@pytest.mark.parametrize("share", [0.3, 0.7, 0.99])
def test_a_truncated_file_is_refused(tmp_path, compression, share):
    path = write(tmp_path / "a.tif", content(np.uint16, 3), compression=compression, rowsperstrip=4)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    assert str(path) in refusal(lambda: read_tiff(path))


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_a_file_without_one_of_its_strips_is_refused(tmp_path, compression):
    path = write(tmp_path / "a.tif", content(np.uint16, 3), compression=compression, rowsperstrip=4)
    with tifffile.TiffFile(path, mode="r+") as file:
        tag = file.pages.first.tags[279]
        tag.overwrite([0, *tag.value[1:]])
    assert "missing" in refusal(lambda: read_tiff(path))


@pytest.mark.parametrize("compression", ["zlib", "lzma"])
def test_a_file_with_spoilt_data_is_refused(tmp_path, compression):
    path = write(tmp_path / "a.tif", content(np.uint16, 3), compression=compression, rowsperstrip=4)
    with tifffile.TiffFile(path) as file:
        start, count = file.pages.first.dataoffsets[2], file.pages.first.databytecounts[2]
    data = bytearray(path.read_bytes())
    data[start + count // 2 : start + count // 2 + 40] = bytes(40)
    path.write_bytes(data)
    assert str(path) in refusal(lambda: read_tiff(path))


def test_strips_that_are_too_short_are_refused(tmp_path):
    path = write(tmp_path / "a.tif", content(np.uint16, 3), rowsperstrip=4)
    with tifffile.TiffFile(path, mode="r+") as file:
        tag = file.pages.first.tags[279]
        tag.overwrite([*tag.value[:2], tag.value[2] // 2, *tag.value[3:]])
    assert str(path) in refusal(lambda: read_tiff(path))


def test_what_tifffile_complains_of_is_said_and_not_printed(tmp_path, capfd):
    path = write(tmp_path / "a.tif", content(np.uint8), software="a program of some length")
    data = path.read_bytes()
    # The tag of the software: its type, its length, and a place beyond the end of the file.
    place = data.index(struct.pack("<HH", 305, 2))
    path.write_bytes(data[: place + 8] + struct.pack("<I", 1 << 30) + data[place + 12 :])
    file = read_image_file(path)
    np.testing.assert_array_equal(file.pixels[..., 0], content(np.uint8))
    assert "may be damaged (tifffile says: " in file.notes[0]
    assert capfd.readouterr().err == ""


def test_several_widths_are_refused_before_memory_is_asked_for(tmp_path):
    path = write(tmp_path / "a.tif", content(np.uint8))
    data = path.read_bytes()
    # The width: its tag, its type, and how many numbers it has.
    place = data.index(struct.pack("<H", 256), 8)
    kind, one = struct.unpack_from("<HI", data, place + 2)
    assert one == 1
    path.write_bytes(data[: place + 2] + struct.pack("<HII", kind, 20, 8) + data[place + 12 :])
    assert "several widths" in refusal(lambda: read_tiff(path))
