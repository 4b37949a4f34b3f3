"""Depth encoding in 8 bits, and depth files."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from basetree.errors import InputFileError
from calib import DepthEncoding, DepthError, decode_depth, encode_depth, read_depth, write_depth


def test_the_default_encoding_is_linear_to_20_metres() -> None:
    depth_m = np.array([[0.0, 0.02, 5.0, 10.0, 20.0, 40.0]], np.float32)
    grey = encode_depth(depth_m, DepthEncoding())
    assert grey.dtype == np.uint8
    assert grey.tolist() == [[255, 0, 64, 128, 255, 255]]


def test_missing_readings_are_encoded_as_invalid() -> None:
    encoding = DepthEncoding(1.0, 9.0, 10, 200, 3)
    depth_m = np.array([[0.0, -1.0, math.nan, math.inf, 0.5, 1.0, 9.0, 12.0]])
    assert encode_depth(depth_m, encoding).tolist() == [[3, 3, 3, 3, 10, 10, 200, 200]]


@pytest.mark.parametrize("encoding", [DepthEncoding(), DepthEncoding(near_value=255, far_value=0)])
@pytest.mark.parametrize("metres", [20.0, 65504.0, 1e8, 1e10, 1e30, 3e38])
def test_what_is_far_is_never_encoded_as_near(metres: float, encoding: DepthEncoding) -> None:
    # Renderers write 1e10 where nothing is hit; in 32 bits that overflows.
    grey = encode_depth(np.array([[metres, 1.0]], np.float32), encoding)
    assert grey[0, 0] == encoding.far_value
    assert grey[0, 1] != encoding.far_value


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_rows_are_encoded_independently(dtype: type[np.floating]) -> None:
    depth_m = np.random.default_rng(0).uniform(-5, 25, (101, 7)).astype(dtype)
    depth_m[::3, 2] = np.nan
    alone = [encode_depth(row[None], DepthEncoding()) for row in depth_m]
    np.testing.assert_array_equal(encode_depth(depth_m, DepthEncoding()), np.concatenate(alone))


@pytest.mark.parametrize(
    "encoding",
    [DepthEncoding(), DepthEncoding(0.5, 12.0, 250, 5, 0), DepthEncoding(0, 8, 1, 255, 0)],
)
def test_decoding_is_accurate_to_half_a_grey_level(encoding: DepthEncoding) -> None:
    step_m = (encoding.far_m - encoding.near_m) / abs(encoding.far_value - encoding.near_value)
    depth_m = np.linspace(encoding.near_m + 0.01, encoding.far_m - step_m, 500)[None]
    back = decode_depth(encode_depth(depth_m, encoding), encoding)
    assert back.dtype == np.float32
    assert np.abs(back - depth_m).max() <= step_m / 2 + 1e-5


def test_far_and_invalid_values_decode_to_no_reading() -> None:
    encoding = DepthEncoding(0.0, 20.0, 10, 200, 3)
    grey = np.array([[3, 200, 255, 5, 105]], np.uint8)
    assert decode_depth(grey, encoding).tolist() == [[0.0, 0.0, 0.0, 0.0, 10.0]]


def test_an_encoding_dict_round_trips() -> None:
    encoding = DepthEncoding(0.5, 12.0, 250, 5, 0)
    assert DepthEncoding.from_dict(encoding.to_dict()) == encoding


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"near_m": 20.0}, "expected 0 <= near_m < far_m"),
        ({"far_m": math.inf}, "expected 0 <= near_m < far_m"),
        ({"far_value": 256}, "far_value is 256: expected 0 to 255"),
        ({"far_value": 0}, "near_value and far_value are both 0: expected different values"),
        ({"near_m": "0"}, "depth encoding field near_m is '0': expected a number"),
        ({"far_m": 10**400}, "depth encoding field far_m is 10000"),
        ({"extra": 1}, "depth encoding has fields"),
    ],
)
def test_invalid_encodings_are_rejected(change: dict[str, object], message: str) -> None:
    with pytest.raises(DepthError) as caught:
        DepthEncoding.from_dict({**DepthEncoding().to_dict(), **change})
    assert message in str(caught.value)


def test_a_depth_file_round_trips_to_a_millimetre(tmp_path: Path) -> None:
    path = tmp_path / "depth.png"
    depth_m = np.array([[0.0, 1.2345, 65.535], [65.6, math.nan, -2.0]], np.float32)
    write_depth(path, depth_m)
    back = read_depth(path)
    assert back.dtype == np.float32
    expected = [[0.0, 1.234, 65.535], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(back, expected, atol=6e-4)
    stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    assert stored.dtype == np.uint16
    assert list(tmp_path.iterdir()) == [path]


def test_unsupported_images_are_described(tmp_path: Path) -> None:
    path = tmp_path / "grey.png"
    cv2.imwrite(str(path), np.zeros((4, 4), np.uint8))
    with pytest.raises(DepthError, match=r"grey\.png holds integers of 8 bits, whose unit cannot"):
        read_depth(path)
    cv2.imwrite(str(path), np.zeros((4, 4, 3), np.uint16))
    with pytest.raises(DepthError, match=r"grey\.png has shape \(4, 4, 3\) of uint16: expected"):
        read_depth(path)
    np.save(tmp_path / "many.npy", np.zeros((2, 4, 4, 1), np.float32))
    with pytest.raises(DepthError, match=r"many\.npy has shape \(2, 4, 4, 1\) of float32"):
        read_depth(tmp_path / "many.npy")


STEPS = np.array([[0, 1234], [5000, 65535]], np.uint16)
METRES = np.array([[-1.0, 1.234], [math.nan, math.inf]], np.float32)


@pytest.mark.parametrize("name", ["depth.png", "depth.tiff", "depth.npy"])
@pytest.mark.parametrize(
    ("scale", "expected"),
    [
        (0.001, [[0.0, 1.234], [5.0, 65.535]]),
        (0.00025, [[0.0, 0.3085], [1.25, 16.38375]]),
        (1 / 256, [[0.0, 4.8203125], [19.53125, 255.99609375]]),
    ],
)
def test_16_bit_values_are_multiplied_by_the_scale(
    tmp_path: Path, name: str, scale: float, expected: list[list[float]]
) -> None:
    save(tmp_path / name, STEPS)
    depth_m = read_depth(tmp_path / name, scale)
    assert depth_m.dtype == np.float32
    np.testing.assert_allclose(depth_m, expected, rtol=1e-7)


@pytest.mark.parametrize("name", ["depth.tiff", "depth.npy"])
def test_floats_are_metres_unless_a_scale_is_given(tmp_path: Path, name: str) -> None:
    save(tmp_path / name, METRES)
    assert read_depth(tmp_path / name).tolist() == [[0.0, METRES[0, 1]], [0.0, 0.0]]
    assert read_depth(tmp_path / name, 0.5).tolist() == [[0.0, METRES[0, 1] / 2], [0.0, 0.0]]
    save(tmp_path / name, METRES[..., None])
    assert read_depth(tmp_path / name).shape == (2, 2)


@pytest.mark.filterwarnings("error")
def test_other_byte_orders_are_read(tmp_path: Path) -> None:
    path = tmp_path / "depth.npy"
    np.save(path, STEPS.astype(">u2"))
    np.testing.assert_allclose(read_depth(path), [[0.0, 1.234], [5.0, 65.535]], rtol=1e-7)
    np.save(path, np.array([[1.5, 1e300, 0.0]], ">f8"))
    depth_m = read_depth(path)
    assert depth_m.tolist() == [[1.5, 0.0, 0.0]]
    assert depth_m.dtype.isnative


def save(path: Path, values: np.ndarray) -> None:
    if path.suffix == ".npy":
        np.save(path, values)
    else:
        assert cv2.imwrite(str(path), values)


@pytest.mark.parametrize("scale", [0.0, -0.001, math.nan, math.inf, 1e300, 1e-300])
def test_invalid_scales_are_rejected(tmp_path: Path, scale: float) -> None:
    with pytest.raises(DepthError, match="expected metres per unit, 1e-06 to 1000"):
        read_depth(tmp_path / "depth.png", scale)


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=r"nothing\.png: no such file"):
        read_depth(tmp_path / "nothing.png")
    (tmp_path / "text.png").write_text("no image")
    with pytest.raises(InputFileError, match=r"text\.png: not a readable image"):
        read_depth(tmp_path / "text.png")
    header = b"\x93NUMPY\x01\x00v\x00{'descr': %b, 'fortran_order': False, 'shape': %b}"
    arrays = [
        (header % claim).ljust(127) + b"\n" + bytes(64)
        for claim in (
            (b"'0f4'", b"(2, 2)"),
            (b"'O'", b"(2, 2)"),
            (b"'<f4'", b"(%b)" % (b"1," * 40)),
        )
    ]
    for content in (b"no array", b"", b"\x93NUMPY\x01\x00", *arrays):
        (tmp_path / "text.npy").write_bytes(content)
        with pytest.raises(InputFileError, match=r"text\.npy: not a readable \.npy file"):
            read_depth(tmp_path / "text.npy")
    np.savez(tmp_path / "two.npz", STEPS, METRES)
    (tmp_path / "two.npz").rename(tmp_path / "two.npy")
    with pytest.raises(InputFileError, match=r"two\.npy: several arrays, expected one"):
        read_depth(tmp_path / "two.npy")
    with pytest.raises(InputFileError, match="cannot be written"):
        write_depth(tmp_path / "no folder" / "d.png", np.ones((2, 2), np.float32))


def test_an_array_of_arrays_is_no_depth(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    header = b"{'descr': '(4,)u1', 'fortran_order': False, 'shape': (2, 2), }"
    start = b"\x93NUMPY\x01\x00" + (len(header) + 1).to_bytes(2, "little")
    path.write_bytes(start + header + b"\n" + bytes(16))
    with pytest.raises(InputFileError, match=r"not a readable \.npy file"):
        read_depth(path)


def test_depth_that_jpeg_changed_is_refused_whatever_its_scale(tmp_path: Path) -> None:
    path = tmp_path / "depth.jpg"
    cv2.imwrite(str(path), np.full((40, 60), 50, np.uint8))
    with pytest.raises(InputFileError, match=r"depth\.jpg: JPEG, whose compression.*expected"):
        read_depth(path, 0.02)


def test_depth_as_openexr_says_how_to_convert_it(tmp_path: Path) -> None:
    path = tmp_path / "depth.exr"
    path.write_bytes(bytes.fromhex("762f3101") + bytes(200))
    with pytest.raises(InputFileError, match=r"depth\.exr: OpenEXR.*OPENCV_IO_ENABLE_OPENEXR=1"):
        read_depth(path)
