"""The frame cache: equal to decoding, and rebuilt when data change."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from perceptree.data import FrameStore, read_split
from perceptree.data.cache import FrameCache, open_cache
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec, make_spec


def spec(modality: str = "depth", height: int = 64) -> ModelSpec:
    return make_spec("edge-n", modality, height, 128)  # type: ignore[arg-type]


def opened(data: Path, folder: Path, **changes: object) -> FrameCache:
    return open_cache(read_split(data, "train"), spec(), folder, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("modality", ["depth", "rgb", "both"])
def test_a_cached_frame_equals_the_decoded_one(posts: Path, tmp_path: Path, modality: str) -> None:
    frames = read_split(posts, "train")
    cache = open_cache(frames, spec(modality), tmp_path / "cache")
    store = FrameStore(frames, spec(modality))
    assert (len(cache), cache.trees) == (len(store), store.trees)
    for number in range(len(store)):
        found, expected = cache[number], store[number]
        np.testing.assert_array_equal(found.image, expected.image)
        np.testing.assert_allclose(found.boxes, expected.boxes, atol=1e-4)
        np.testing.assert_allclose(found.keypoints, expected.keypoints, atol=1e-4)
        assert expected.masks is not None
        assert expected.masks.any(axis=(1, 2)).all()
        np.testing.assert_array_equal(found.masks, expected.masks)


def test_a_cache_is_reused_until_an_image_changes(posts: Path, tmp_path: Path) -> None:
    folder, decoded = tmp_path / "cache", []

    def count(done: int, total: int) -> None:
        decoded.append(done)

    first = opened(posts, folder, progress=count)
    again = opened(posts, folder, progress=count)
    assert decoded == [1, 2, 3, 4, 5, 6]
    assert again.key == first.key
    path = posts / "depth8/000002.png"
    nearer = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) // 2
    cv2.imwrite(str(path), nearer)
    changed = opened(posts, folder, progress=count)
    assert decoded[6:] == [1, 2, 3, 4, 5, 6]
    assert changed.key != first.key
    assert changed[2].image[0, 0] < first[2].image[0, 0]
    assert [path.name for path in tmp_path.glob("cache*")] == ["cache"]


@pytest.mark.parametrize("changed", ["images/000002.png", "depth8/000002.png"])
def test_a_cache_of_both_images_is_rebuilt_for_either(
    posts: Path, tmp_path: Path, changed: str
) -> None:
    frames = read_split(posts, "train")
    first = open_cache(frames, spec("both"), tmp_path / "cache")
    assert first[0].image.shape == (64, 128, 4)
    nearer = cv2.imread(str(posts / changed), cv2.IMREAD_UNCHANGED) // 2
    cv2.imwrite(str(posts / changed), nearer)
    assert open_cache(frames, spec("both"), tmp_path / "cache").key != first.key


def test_a_change_of_labels_or_size_rebuilds_the_cache(
    posts: Path, tmp_path: Path, edit_split: Callable[..., None]
) -> None:
    first = opened(posts, tmp_path / "cache")
    edit_split(posts, "train", lambda content: content["annotations"].pop())
    second = opened(posts, tmp_path / "cache")
    assert second.trees == first.trees - 1
    other = open_cache(read_split(posts, "train"), spec(height=96), tmp_path / "cache")
    assert other[0].image.shape == (96, 128)


def test_a_damaged_cache_is_named(posts: Path, tmp_path: Path) -> None:
    opened(posts, tmp_path / "cache")
    pictures = tmp_path / "cache/images.bin"
    content = bytearray(pictures.read_bytes())
    content[3 * 64 * 128 + 5] ^= 1
    pictures.write_bytes(content)
    cache = opened(posts, tmp_path / "cache")
    assert cache[2].image.shape == (64, 128)
    with pytest.raises(
        DatasetError, match=r"cache: the cached frame 000003\.png does not match its checksum"
    ):
        cache[3]


def test_a_broken_image_is_named_or_left_out(posts: Path, tmp_path: Path) -> None:
    (posts / "depth8/000001.png").write_bytes(b"nothing")
    (posts / "depth8/000004.png").unlink()
    with pytest.raises(DatasetError, match=r"000001\.png: missing or not a readable image"):
        opened(posts, tmp_path / "cache")
    assert list(tmp_path.glob("cache*")) == []
    cache = opened(posts, tmp_path / "cache", skip_broken=True)
    assert cache.names == [f"00000{n}.png" for n in (0, 2, 3, 5)]
    assert [entry.name for entry in cache.skipped] == ["000001.png", "000004.png"]
    assert "000004.png: missing" in cache.skipped[1].reason
    np.testing.assert_array_equal(
        cache[3].image, FrameStore(read_split(posts, "train"), spec())[5].image
    )


def test_frames_without_masks_are_cached(
    posts: Path, tmp_path: Path, edit_split: Callable[..., None]
) -> None:
    def strip(content: dict[str, list[dict[str, object]]]) -> None:
        for annotation in content["annotations"]:
            del annotation["segmentation"]

    edit_split(posts, "train", strip)
    cache = opened(posts, tmp_path / "cache")
    assert cache[1].masks is None
    assert len(cache[1].boxes) == 2


def test_a_folder_that_cannot_be_written_is_named(posts: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match=r"file.*: cannot be written .*--cache"):
        opened(posts, tmp_path / "file/cache")
