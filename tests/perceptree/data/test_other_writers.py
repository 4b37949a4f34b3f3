"""COCO files in the dialects of other programs: ids, encodings, polygons, paths, sizes."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from perceptree.data import read_dataset, read_split
from perceptree.data.check import Check
from perceptree.data.pictures import path_parts
from perceptree.errors import DatasetError

Content = dict[str, Any]
Edit = Callable[[Path, str, Callable[[Content], None]], None]


def _numbers(posts: Path) -> list[list[int]]:
    """Numbers of the trees of each frame of train, and whether its picture is there."""
    frames = read_split(posts, "train")
    assert all(frame.image_path.is_file() for frame in frames)
    return [[tree.number for tree in frame.trees] for frame in frames]


@pytest.mark.parametrize(
    ("image", "owner", "category", "labelled"),
    [
        ("{:06d}".format, "{:06d}".format, str, int),
        (float, float, float, float),
        (int, str, str, str),
        (str, int, int, int),
        ("{:06d}".format, int, "tree-{}".format, "a{}".format),
        ("frame {}".format, "frame {}".format, int, lambda number: None),
        (lambda number: number + 2**70, lambda number: number + 2**70, int, int),
    ],
)
def test_ids_of_any_kind_that_fit_together(
    posts: Path,
    edit_split: Edit,
    image: Callable[[int], Any],
    owner: Callable[[int], Any],
    category: Callable[[int], Any],
    labelled: Callable[[int], Any],
) -> None:
    expected = _numbers(posts)

    def change(content: Content) -> None:
        for one in content["images"]:
            one["id"] = image(one["id"])
        for one in content["annotations"]:
            one["image_id"], one["id"] = owner(one["image_id"]), labelled(one["id"])
            one["category_id"] = category(one["category_id"])
        content["categories"][0]["id"] = category(1)

    edit_split(posts, "train", change)
    assert _numbers(posts) == expected
    assert len({frame.image_id for frame in read_split(posts, "train")}) == 6


def test_texts_that_mean_the_same_number_stay_different_ids(posts: Path, edit_split: Edit) -> None:
    def change(content: Content) -> None:
        names = {0: "1", 1: "01", 2: "001", 3: "x", 4: "y", 5: "z"}
        for one in content["images"]:
            one["id"] = names[one["id"]]
        for one in content["annotations"]:
            one["image_id"] = names[one["image_id"]]

    expected = _numbers(posts)
    edit_split(posts, "train", change)
    assert _numbers(posts) == expected
    edit_split(posts, "train", lambda content: content["annotations"][0].update(image_id=1))
    with pytest.raises(DatasetError, match="image_id of annotation 1 is 1, expected one of"):
        read_split(posts, "train")


@pytest.mark.parametrize("wrong", [[], {}, None, True, 1.5, "", [1], float("nan"), 10**400])
@pytest.mark.parametrize("field", ["image_id", "category_id"])
def test_ids_that_are_none_are_named(posts: Path, edit_split: Edit, field: str, wrong: Any) -> None:
    edit_split(posts, "train", lambda content: content["annotations"][1].update({field: wrong}))
    if field == "category_id" and wrong is None:
        assert len(_numbers(posts)) == 6, "the only category is meant"
        return
    with pytest.raises(DatasetError, match=f"{field} of annotation 2 is .*, expected"):
        read_split(posts, "train")
    (finding,) = Check(posts).run().findings
    assert (finding.kind, finding.count) == ("entry", 1)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be", "utf-32"])
def test_byte_order_marks_and_wide_characters(posts: Path, encoding: str) -> None:
    path, expected = posts / "train_RGB.json", _numbers(posts)
    path.write_text(path.read_text("utf-8"), encoding)
    assert _numbers(posts) == expected
    path.rename(posts / "result.json")
    for split in ("val", "test"):
        (posts / f"{split}_RGB.json").unlink()
    assert read_dataset(posts, "test").labels.path.name == "result.json"


SQUARE = [20, 10, 30, 10, 30, 40, 20, 40]


@pytest.mark.parametrize(
    "segmentation",
    [
        SQUARE,
        [float(number) for number in SQUARE],
        [[20, 10], [30, 10], [30, 40], [20, 40]],
        [[[20, 10], [30, 10], [30, 40], [20, 40]]],
    ],
)
def test_flat_polygons_and_points(posts: Path, edit_split: Edit, segmentation: Any) -> None:
    edit_split(posts, "train", lambda c: c["annotations"][0].update(segmentation=segmentation))
    frame = read_split(posts, "train")[0]
    assert frame.mask(frame.trees[0]).sum() == 300


def test_keypoints_as_a_list_of_points(posts: Path, edit_split: Edit) -> None:
    expected = read_split(posts, "train")[0].trees[0].keypoints

    def change(content: Content) -> None:
        listed = content["annotations"][0]["keypoints"]
        content["annotations"][0]["keypoints"] = [listed[n : n + 3] for n in range(0, 15, 3)]

    edit_split(posts, "train", change)
    assert (read_split(posts, "train")[0].trees[0].keypoints == expected).all()


@pytest.mark.parametrize(
    "form",
    [
        "/home/someone/trees/{}",
        "/home/someone/posts/images/{}",
        "C:\\Users\\someone\\trees\\{}",
        "\\\\server\\share\\{}",
        "images\\{}",
        "./images/{}",
        "../{}",
        "https://example.org/store/{}?token=a%2Fb.c",
        "s3://bucket/trees/{}",
        "file:///home/someone/{}",
        "/data/local-files/?d=trees/{}",
        "/data/local-files/?d=trees%5C{}",
        "/data/upload/3/{}",
    ],
)
def test_the_last_part_of_a_path_that_leads_nowhere(
    posts: Path, edit_split: Edit, form: str
) -> None:
    def change(content: Content) -> None:
        for image in content["images"]:
            image["file_name"] = form.format(Path(image["file_name"]).name)

    edit_split(posts, "train", change)
    assert [len(numbers) for numbers in _numbers(posts)] == [1, 2] * 3
    assert Check(posts).run().findings == ()


@pytest.mark.parametrize(
    ("stored", "named"),
    [
        ("B\u00e4ume {}.png", "Ba\u0308ume {}.png"),
        ("Ba\u0308ume {}.png", "B\u00e4ume {}.png"),
        ("tree {}.png", "tree%20{}.png"),
        ("100%20 {}.png", "100%20 {}.png"),
    ],
)
def test_names_that_tools_write_otherwise(
    posts: Path, edit_split: Edit, stored: str, named: str
) -> None:
    expected = _numbers(posts)
    paths = [frame.image_path for frame in read_split(posts, "train")]
    for number, path in enumerate(paths):
        path.rename(path.with_name(stored.format(number)))

    def change(content: Content) -> None:
        for number, one in enumerate(content["images"]):
            folder = Path(one["file_name"]).parent
            one["file_name"] = (folder / named.format(number)).as_posix()

    edit_split(posts, "train", change)
    assert _numbers(posts) == expected


@pytest.mark.parametrize("name", ["%2e%2e%2fout.png", "..%2fout.png", "%2e%2e", "a%00.png"])
def test_percent_signs_never_lead_out_of_the_folder(
    posts: Path, edit_split: Edit, name: str
) -> None:
    shutil.copy(read_split(posts, "train")[0].image_path, posts.parent / "out.png")
    edit_split(posts, "train", lambda content: content["images"][0].update(file_name=name))
    assert not read_split(posts, "train")[0].image_path.is_file()


def test_equal_names_in_two_folders_stay_two_pictures(posts: Path, edit_split: Edit) -> None:
    def change(content: Content) -> None:
        for number, image in enumerate(content["images"]):
            inside = f"{'ab'[number % 2]}/{number // 2}.png"
            (posts / inside).parent.mkdir(exist_ok=True)
            shutil.copy(posts / image["file_name"], posts / inside)
            image["file_name"] = "D:\\set\\" + inside.replace("/", "\\")

    edit_split(posts, "train", change)
    dataset = read_dataset(posts, "train")
    assert [frame.image_path.relative_to(posts).as_posix() for frame in dataset.frames] == [
        f"{'ab'[number % 2]}/{number // 2}.png" for number in range(6)
    ]
    assert not any("another image" in note for note in dataset.notes)


def test_images_that_name_one_picture_are_told(posts: Path, edit_split: Edit) -> None:
    edit_split(posts, "train", lambda c: c["images"][1].update(c["images"][0] | {"id": 1}))
    assert "1 images name a picture that another image names, too" in (
        read_dataset(posts, "train").notes
    )


def test_a_path_out_of_the_folder_is_never_followed(posts: Path, edit_split: Edit) -> None:
    outside = posts.parent / "000000.png"
    shutil.copy(posts / "images/000001.png", outside)
    edit_split(posts, "train", lambda c: c["images"][0].update(file_name=str(outside)))
    assert read_split(posts, "train")[0].image_path == posts / "images/000000.png"
    (posts / "images/000000.png").unlink()
    with pytest.raises(DatasetError, match=r"file_name of image 0 is .*in the dataset's folder"):
        read_split(posts, "train")
    edit_split(posts, "train", lambda c: c.update(images=c["images"][:1], annotations=[]))
    with pytest.raises(DatasetError, match=r"no usable images \(file_name of image 0 is '/"):
        Check(posts)


def test_parts_of_a_hostile_name() -> None:
    assert path_parts("https://a/..%2F..%2Fetc/b%00c/d.png?x=1") == ["https:", "a", "etc", "d.png"]
    assert path_parts("///") == path_parts("..") == path_parts("\0") == []


@pytest.mark.parametrize("size", ["{}", "{}.0", '"{}"'])
def test_sizes_in_other_forms(posts: Path, edit_split: Edit, size: str) -> None:
    def change(content: Content) -> None:
        for image in content["images"]:
            for key in ("width", "height"):
                image[key] = json.loads(size.format(image[key]))

    edit_split(posts, "train", change)
    assert [(frame.width, frame.height) for frame in read_split(posts, "train")] == [(128, 72)] * 6


@pytest.mark.parametrize("missing", [None, 0, ""])
def test_a_missing_size_is_that_of_the_picture(posts: Path, edit_split: Edit, missing: Any) -> None:
    def change(content: Content) -> None:
        for image in content["images"]:
            image.update(width=missing, height=missing)

    edit_split(posts, "train", change)
    dataset = read_dataset(posts, "train")
    assert [(frame.width, frame.height) for frame in dataset.frames] == [(128, 72)] * 6
    assert dataset.notes[0].startswith("the file has no size of 6 pictures")
    dataset.frames[0].image_path.unlink()
    with pytest.raises(DatasetError, match=r"width of image 0 is .*, expected"):
        read_split(posts, "train")
