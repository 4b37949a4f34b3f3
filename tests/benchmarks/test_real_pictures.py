"""Models compared with boxes that people have drawn."""

import json
from pathlib import Path

import pytest

pytest.importorskip("pycocotools")

from benchmarks.real_pictures import compare, ground_truth


@pytest.fixture
def labels(tmp_path: Path) -> Path:
    """A picture with a certain stem and one that is not certain."""
    boxes = {1: ([10, 10, 20, 50], True), 2: ([60, 10, 20, 50], False)}
    content = {
        "images": [{"id": 1, "file_name": "a.jpg", "width": 100, "height": 100}],
        "categories": [{"id": 1, "name": "tree"}],
        "annotations": [
            {"id": number, "image_id": 1, "category_id": 1, "bbox": box, "certain": certain}
            for number, (box, certain) in boxes.items()
        ],
    }
    path = tmp_path / "instances.json"
    path.write_text(json.dumps(content))
    return path


def test_a_certain_stem_counts_and_an_uncertain_one_is_ignored(labels: Path) -> None:
    found = [
        {"image_id": 1, "category_id": 1, "bbox": box, "score": score}
        for box, score in (([10, 10, 20, 50], 0.6), ([60, 10, 20, 50], 0.9), ([40, 60, 9, 9], 0.5))
    ]
    matched = compare(ground_truth(labels), found)
    assert (matched.ap50, matched.stems) == (100.0, 1)
    assert matched.scores.tolist() == [0.6, 0.5]
    assert matched.right.tolist() == [True, False]


def test_a_model_that_finds_nothing_has_a_precision_of_nothing(labels: Path) -> None:
    matched = compare(ground_truth(labels), [])
    assert (matched.ap50, matched.stems, len(matched.scores)) == (0.0, 1, 0)
