"""Labels of pictures, caches and settings of datasets, logs and results of trainings."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from edgetree.export.frames import _test_split_names
from formats.form import Format
from perceptree.data.cache import _key_in, open_cache, read_cache
from perceptree.data.check.pictures import _read
from perceptree.data.coco import FrameRecord
from perceptree.data.content import has_keypoints, is_coco
from perceptree.data.dataset import read_labels
from perceptree.data.exchange.reading import read_any
from perceptree.data.layouts import LabelFile
from perceptree.data.stated import labelled_reach_m
from perceptree.evaluation.shards import read_predictions
from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.models import make_spec
from perceptree.simulator import SimulatorSettings
from perceptree.simulator.dataset.frozen import _label_figures
from perceptree.simulator.dataset.generate import _digest_in
from perceptree.simulator.photographs import dataset_credits
from perceptree.simulator.settings.reading import read_settings
from perceptree.tables.build import read_tables
from perceptree.tables.results import read_result
from perceptree.training.plot import read_curves

_SETTINGS = b'{"stand": {"stems_per_ha": [400, 500]}, "camera": {"mast_share": 0.5}}'
_REACH = (b'{"reach_m": 10.0}', b'{"settings": {"labels": {"reach_m": 8}}}')
_CREDITS = b'{"sha256": "a", "textures": [{"kind": "bark", "licence": "CC0", "names": ["a"]}]}'
_RESULT = (
    b'{"schema": "perceptree.table-run/1", "training": {}, "made": {}, "test": 1, "metrics": 2}'
)
_TABLES = b'{"schema": "perceptree.tables/1", "tables": {}}'
_LOG = (
    b'{"step": 10, "elapsed_s": 2.5, "losses": {"box": 1.5}, "rate": 0.1, "frames_per_s": 3.0,'
    b' "waiting_share": 0.5}\n'
    b'{"step": 10, "elapsed_s": 3.5, "val": {"box_ap": 1.5, "mask_ap": null, "keypoint_ap": 2.0}}\n'
)
_PREDICTIONS = (
    b'[{"boxes": [[1, 2, 3, 4]], "scores": [0.5], "keypoints": null,'
    b' "masks": [{"size": [4, 8], "counts": "48d0"}]}]'
)
_SIZE = {"width": 8, "height": 4}


def _coco(**changes: Any) -> bytes:
    """Labels of three trees, with changed fields of each."""
    tree = {"image_id": 1, "category_id": 1, "iscrowd": 0, "area": 8}
    tree |= {"bbox": [1, 0, 2, 4], "keypoints": [1, 3, 2] * len(KEYPOINT_NAMES)}
    masks = [
        {"size": [4, 8], "counts": [4, 8, 20]},
        {"size": [4, 8], "counts": "48d0"},
        [[1, 0, 3, 0, 3, 4, 1, 4]],
    ]
    content = {
        "images": [{"id": 1, "file_name": "0.png", **_SIZE, "camera": {"fx": 500}}],
        "categories": [{"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES)}],
        "annotations": [
            tree | {"id": number, "segmentation": mask} | changes
            for number, mask in enumerate(masks)
        ],
    }
    return json.dumps(content).encode()


_LABELS = (
    _coco(),
    _coco(iscrowd=1),
    _coco(image_id="1", segmentation=[1, 0, 3, 0, 3, 4, 1, 4], bbox=None).replace(
        b'"0.png"', b'"https://a.b/c/?d=trees%2F0.png"'
    ),
    b"\xef\xbb\xbf" + _coco(segmentation=[[1, 0, 3, 0], [1, 0, 3, 0, 3, 4]], bbox=[1, 0, 0, 4]),
)


def _read_coco(path: Path, keypoints: Path | None = None) -> None:
    dataset = read_labels(LabelFile("train", None, False, path, path.parent, keypoints))
    for frame in dataset.frames:
        for tree in frame.trees:
            if tree.segmentation:
                frame.mask(tree)


def _join_coco(path: Path) -> int:
    masks = path.with_name("masks.json")
    masks.write_bytes(_coco(keypoints=[]))
    _read_coco(masks, path)
    return 1


def _in_folder(name: str, read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """Read a folder that holds the file under a name."""

    def placed(path: Path) -> Any:
        folder = path.with_name(f"with-{name}")
        folder.mkdir(exist_ok=True)
        (folder / name).write_bytes(path.read_bytes())
        return read(folder)

    return placed


def _key_of(path: Path) -> object:
    folder = path.with_name("key")
    folder.mkdir(exist_ok=True)
    (folder / "cache.json").write_bytes(path.read_bytes())
    return (_key_in(folder),)


def _figures(folder: Path) -> object:
    return _test_split_names(folder), _label_figures(folder)


@cache
def _cache() -> tempfile.TemporaryDirectory[str]:
    """The folder of a whole cache of one frame."""
    folder = tempfile.TemporaryDirectory()
    picture = Path(folder.name, "0.png")
    cv2.imwrite(str(picture), np.zeros((40, 64, 3), np.uint8))
    frame = FrameRecord(1, picture, None, None, 64, 40, {}, ())
    open_cache([frame], make_spec("edge-n", "rgb", 32, 64), Path(folder.name, "cache"))
    return folder


def _cache_of(name: str) -> Format:
    """A cache whose file of this name is another."""

    def read(path: Path) -> Any:
        whole = Path(_cache().name, "cache")
        folder = path.with_name("cache")
        folder.mkdir(exist_ok=True)
        for file in whole.iterdir():
            (folder / file.name).write_bytes(
                path.read_bytes() if file.name == name else file.read_bytes()
            )
        found = read_cache(folder)
        return [found[index] for index in range(len(found))] if found else []

    return Format((Path(_cache().name, "cache", name).read_bytes(),), read)


def _checked(path: Path) -> object:
    """Decode a picture as `perceptree data check` does."""
    return [_read(path, flag)[1] for flag in (cv2.IMREAD_COLOR, cv2.IMREAD_UNCHANGED)]


def _converted(name: str) -> Callable[[Path], Any]:
    """Read a folder of a labelling tool that holds the file under a name beside a picture."""

    def read(path: Path) -> Any:
        folder = path.with_name(f"tool-{name.replace('/', '-')}")
        for inside in ("images", "labels"):
            (folder / inside).mkdir(parents=True, exist_ok=True)
        for picture in ("a.png", "images/a.png"):
            (folder / picture).write_bytes(_PICTURES[0])
        if name == "labels/a.txt":
            (folder / "data.yaml").write_bytes(_YOLO)
        elif name in ("data.yaml", "classes.txt"):
            (folder / "labels/a.txt").write_bytes(_YOLO_LINES if name == "data.yaml" else _OUTLINES)
        (folder / name).write_bytes(path.read_bytes())
        datasets = read_any(folder)
        for _, dataset in datasets:
            for frame in dataset.frames:
                for tree in frame.trees:
                    if tree.segmentation:
                        frame.mask(tree)
        return datasets

    return read


_YOLO = b"train: images\nnames: [tree]\nkpt_shape: [1, 3]\nkpt_names: {0: [felling_cut]}\n"
_YOLO_LINES = b"0 0.5 0.5 0.5 0.5 0.5 0.5 2\n0 0.5 0.5 0.5 0.5\n"
_OUTLINES = b"0 0.1 0.1 0.9 0.1 0.5 0.9\n"
_CLASSES = b"tree\nspruce\n"
_LABELME = (
    b'{"shapes": [{"label": "tree", "points": [[1, 0], [3, 0], [3, 4]], "group_id": 1},'
    b' {"label": "tree", "shape_type": "circle", "points": [[3, 2], [4, 2]], "group_id": null},'
    b' {"label": "felling_cut", "shape_type": "point", "points": [[2, 3]], "flags": {}}],'
    b' "imagePath": "a.png", "imageHeight": 4, "imageWidth": 8}'
)
_CVAT = tuple(
    b'<annotations><image name="a.png" width="8" height="4">' + shapes + b"</image></annotations>"
    for shapes in (
        b'<mask label="tree" rle="0, 4" left="1" top="1" width="2" height="2" group_id="1"/>'
        b'<skeleton label="tree" group_id="1"><points label="felling_cut" points="2,2"/></skeleton>'
        b'<polygon label="tree" points="1,0;3,0;3,4"/>',
        b'<box label="tree" xtl="4" ytl="0" xbr="6" ybr="3"/>',
    )
)
_TASKS = tuple(
    b'[{"id": 1, "data": {"image": "a.png"}, "annotations": [{"result": [' + results + b"]}]}]"
    for results in (
        b'{"id": "r", "type": "rectanglelabels", "original_width": 8, "original_height": 4,'
        b' "value": {"x": 10, "y": 10, "width": 40, "height": 80, "rectanglelabels": ["tree"]}}',
        b'{"id": "b", "type": "brushlabels", "original_width": 8, "original_height": 4,'
        b' "value": {"rle": [0, 0, 0, 128, 59, 51, 52, 255, 254], "brushlabels": ["tree"]}},'
        b'{"id": "k", "type": "keypointlabels", "original_width": 8, "original_height": 4,'
        b' "value": {"x": 20, "y": 50, "keypointlabels": ["felling_cut"]}}',
    )
)

_PICTURES = tuple(
    cv2.imencode(suffix, np.zeros((4, 8, 3), np.uint8))[1].tobytes() for suffix in (".png", ".jpg")
)
_SIMULATED = b'{"images": [{"file_name": "a.jpg"}], "annotations": [{"visible_fraction": 0.5}]}'

FORMATS = {
    "checked": Format(_PICTURES, _checked),
    "cache.key": Format((Path(_cache().name, "cache", "cache.json").read_bytes(),), _key_of),
    "simulated": Format((_SIMULATED,), _in_folder("test_RGB.json", _figures)),
    "digest": Format((b'{"sha256": "00"}',), lambda path: (_digest_in(path),)),
    "coco.json": Format(_LABELS, _read_coco),
    "keypoints.json": Format((_coco(segmentation=[]),), _join_coco),
    "yolo.yaml": Format((_YOLO,), _converted("data.yaml")),
    "yolo.txt": Format((_YOLO_LINES, _OUTLINES), _converted("labels/a.txt")),
    "classes.txt": Format((_CLASSES,), _converted("classes.txt")),
    "labelme.json": Format((_LABELME,), _converted("a.json")),
    "cvat.xml": Format(_CVAT, _converted("a.xml")),
    "tasks.json": Format(_TASKS, _converted("a.json")),
    "any.json": Format(_LABELS, lambda path: (is_coco(path), has_keypoints(path))),
    "settings": Format((_SETTINGS,), lambda path: read_settings(path, SimulatorSettings())),
    "reach": Format(
        _REACH, _in_folder("settings.json", lambda folder: labelled_reach_m((folder,)))
    ),
    "credits": Format((_CREDITS,), dataset_credits),
    "log.jsonl": Format((_LOG,), _in_folder("log.jsonl", lambda run: read_curves(run, "run"))),
    "predictions": Format((_PREDICTIONS,), lambda path: read_predictions(path.read_bytes(), "a")),
    "result": Format((_RESULT,), read_result),
    "tables": Format((_TABLES,), read_tables),
    "cache.json": _cache_of("cache.json"),
    "tree_starts.npy": _cache_of("tree_starts.npy"),
    "boxes.npy": _cache_of("boxes.npy"),
}
