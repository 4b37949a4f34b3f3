"""COCO labels for labelling tools."""

from __future__ import annotations

import json

import numpy as np
import pytest

from calib import CocoLabels


def labels(runs: bool = False) -> CocoLabels:
    """One image without objects, and one with a post that has a keypoint outside the image."""
    made = CocoLabels("post", ("foot", "tip"), ((0, 1),), "found by a test", runs)
    made.add_image("a.jpg", 40, 30)
    made.add_image("b.jpg", 20, 10)
    mask = np.zeros((10, 20), bool)
    mask[2:9, 5:8] = True
    points = np.array([[6.5, 8.5, 0.7], [6.5, -1.0, 0.1]])
    made.add(np.array([5.0, 2.0, 8.0, 9.0]), 0.75, mask, points)
    return made


def test_labels_are_a_complete_coco_data_set() -> None:
    content = json.loads(json.dumps(labels().to_dict()))
    assert [image["file_name"] for image in content["images"]] == ["a.jpg", "b.jpg"]
    (post,) = content["annotations"]
    assert post["image_id"] == content["images"][1]["id"]
    assert content["images"][1]["width"] == 20
    assert post["bbox"] == [5, 2, 3, 7]
    assert post["area"] == 21
    assert post["score"] == 0.75
    assert sorted(post["segmentation"][0]) == sorted([5, 2, 5, 9, 8, 9, 8, 2])
    (category,) = content["categories"]
    assert category["id"] == post["category_id"]
    assert (category["name"], category["keypoints"]) == ("post", ["foot", "tip"])
    assert category["skeleton"] == [[1, 2]]  # counted from 1


def test_keypoints_are_pixel_indices_and_not_labelled_outside_the_image() -> None:
    (post,) = labels().to_dict()["annotations"]
    assert post["keypoints"] == [6.0, 8.0, 2, 0, 0, 0]
    assert post["num_keypoints"] == 1


def test_pycocotools_reads_run_lengths_and_polygons() -> None:
    coco = pytest.importorskip("pycocotools.coco")
    for runs in (False, True):
        tools = coco.COCO()
        tools.dataset = labels(runs).to_dict()
        tools.createIndex()
        (post,) = tools.loadAnns(tools.getAnnIds())
        assert tools.annToMask(post).sum() == 21


def test_boxes_alone_are_labels_too() -> None:
    made = CocoLabels("post")
    made.add_image("a.jpg", 40, 30)
    made.add(np.array([1.0, 2.0, 11.0, 22.0]), 0.5)
    content = made.to_dict()
    assert content["annotations"][0]["area"] == 200
    assert content["annotations"][0]["segmentation"] == []
    assert "keypoints" not in content["annotations"][0]
    assert "keypoints" not in content["categories"][0]


def test_an_empty_mask_is_replaced_by_the_box() -> None:
    made = CocoLabels("post")
    made.add_image("a.jpg", 40, 30)
    made.add(np.array([1.0, 2.0, 11.0, 22.0]), 0.5, np.zeros((30, 40), bool))
    (post,) = made.to_dict()["annotations"]
    assert post["area"] == 200
    assert sorted(post["segmentation"][0]) == sorted([1, 2, 1, 22, 11, 22, 11, 2])
