"""Recognition of Detectron2 checkpoints, and errors for other networks."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from their_networks import FILE, numbers, persons, recognised, refused
from torch import Tensor

from basetree.errors import InputError
from perceptree.models import TreeRCNN, make_spec
from perceptree.models.presets import IMAGENET_MEAN, IMAGENET_STD
from perceptree.models.weights import import_checkpoint
from perceptree.models.weights.detectron2 import our_name, their_name

State = dict[str, Tensor]
Shapes = Callable[..., State]
States = Callable[[], State]
Write = Callable[[object], Path]


@pytest.mark.parametrize("preset", ["r50", "r101", "x101-32x8d", "x101-32x4d"])
def test_each_published_backbone_is_recognised(preset: str, detectron2_shapes: Shapes) -> None:
    found = recognised(detectron2_shapes(preset))
    assert found.preset == preset
    assert found.spec == make_spec(preset)


@pytest.mark.parametrize(
    ("name", "preset"), [("R50", "r50"), ("R101", "r101"), ("X101", "x101-32x8d")]
)
def test_detectron2s_own_names_and_shapes_are_those_of_the_preset(
    name: str, preset: str, shared_path: Callable[[str], Path]
) -> None:
    path = shared_path(f"golden/{name}_shapes.json")
    state = {key: numbers(*shape) for key, shape in json.loads(path.read_text()).items()}
    found = recognised(state)
    assert found.spec == make_spec(preset)
    with torch.device("meta"):
        ours = TreeRCNN(found.spec).state_dict()
    expected = {k: v.shape for k, v in ours.items() if not k.endswith("num_batches_tracked")}
    assert {our_name(key): value.shape for key, value in state.items()} == expected
    assert all(their_name(our_name(key)) == key for key in state)


@pytest.mark.parametrize("masks", [True, False])
@pytest.mark.parametrize("keypoints", [True, False])
def test_branches_and_widths_are_those_of_the_file(
    masks: bool, keypoints: bool, detectron2_shapes: Shapes
) -> None:
    widths = {"fpn_width": 32, "box_head_width": 40}
    widths |= {"mask_head_widths": (8, 16)} if masks else {}
    widths |= {"keypoint_head_widths": (8, 12, 16)} if keypoints else {}
    branches = {"masks": masks, "keypoints": keypoints}
    state = detectron2_shapes("r50", **widths, **branches)
    depths = {"mask_convolutions": 2, "keypoint_convolutions": 3}
    spec = recognised(state, modality="depth", height=90, width=150, **depths).spec
    assert spec == make_spec("r50", "depth", 90, 150, **widths, **branches)


# Position of the stride and std for combinations of the user's options and the file's values.
NORMALISATIONS = [
    ("r50", {}, None, True, (1.0,) * 3),
    ("r50", {"stride_in": "3x3"}, None, False, IMAGENET_STD),
    ("r50", {"pixel_std": "imagenet"}, None, False, IMAGENET_STD),
    ("r50", {"stride_in": "3x3", "pixel_std": "unit"}, None, False, (1.0,) * 3),
    ("r50", {}, IMAGENET_STD, False, IMAGENET_STD),
    ("r50", {}, (1.0,) * 3, True, (1.0,) * 3),
    ("r50", {"stride_in": "1x1"}, IMAGENET_STD, True, IMAGENET_STD),
    ("r50", {"pixel_std": "unit"}, IMAGENET_STD, True, (1.0,) * 3),
    ("x101-32x8d", {}, None, False, IMAGENET_STD),
    ("x101-32x8d", {"pixel_std": "unit"}, None, False, (1.0,) * 3),
    ("x101-32x8d", {"stride_in": "1x1"}, IMAGENET_STD, True, IMAGENET_STD),
    ("x101-32x8d", {}, (50.0, 51.0, 52.0), False, (50.0, 51.0, 52.0)),
]


@pytest.mark.parametrize(("preset", "wanted", "kept", "in_1x1", "std"), NORMALISATIONS)
def test_stride_and_normalisation_are_the_users_the_files_or_the_usual(
    preset: str,
    wanted: dict[str, str],
    kept: tuple[float, ...] | None,
    in_1x1: bool,
    std: tuple[float, ...],
    detectron2_shapes: Shapes,
) -> None:
    state = detectron2_shapes(preset)
    if kept is not None:
        state["pixel_std"] = torch.tensor(kept)[:, None, None]
        state["pixel_mean"] = torch.tensor((100.0, 110.0, 120.5))[:, None, None]
    found = recognised(state, **wanted)
    assert found.spec.stride_in_1x1 is in_1x1
    assert found.spec.std == pytest.approx(std)
    assert found.spec.mean == (IMAGENET_MEAN if kept is None else (100.0, 110.0, 120.5))
    told = " ".join(found.assumed)
    assert ("pixel mean" in told) is (kept is None)
    assert ("pixel std" in told) is (kept is None and "pixel_std" not in wanted)
    assert ("stride" in told) is ("stride_in" not in wanted)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("pixel_mean", (0.406, 0.456, 0.485), "is 0.406, 0.456, 0.485, expected the mean of pixel"),
        ("pixel_mean", (103.5, 116.3, 256.0), "is 103.5, 116.3, 256, expected"),
        ("pixel_mean", (103.5, -116.3, 123.7), "is 103.5, -116.3, 123.7, expected"),
        ("pixel_std", (0.225, 0.224, 0.229), "is 0.225, 0.224, 0.229, expected 1 to 255"),
        ("pixel_std", (57.4, 0.0, 58.4), "is 57.4, 0, 58.4, expected 1 to 255"),
    ],
)
def test_a_normalisation_of_other_pixels_is_refused(
    name: str, values: tuple[float, ...], message: str, detectron2_shapes: Shapes
) -> None:
    state = detectron2_shapes("r50") | {name: torch.tensor(values)[:, None, None]}
    assert f"{name} {message}" in refused(state)
    if name == "pixel_std":
        assert recognised(state, pixel_std="imagenet").spec.std == IMAGENET_STD


@pytest.mark.parametrize("mean", [(0.0, 0.0, 0.0), (127.5, 127.5, 127.5)])
def test_other_means_of_8_bit_pixels_are_accepted(
    mean: tuple[float, ...], detectron2_shapes: Shapes
) -> None:
    said = {"pixel_mean": torch.tensor(mean), "pixel_std": torch.full((3,), 255.0)}
    assert recognised(detectron2_shapes("r50") | said).spec.mean == mean


@pytest.mark.parametrize("as_init", [True, False])
@pytest.mark.parametrize(
    ("last", "head"),
    [("mask_fcn4", "mask_head"), ("conv_fcn8", "keypoint_head")],
)
def test_a_head_without_its_last_convolution_is_refused(
    last: str, head: str, as_init: bool, detectron2_shapes: Shapes
) -> None:
    state = detectron2_shapes("r50")
    begin, count = f"roi_heads.{head}.{last}", int(last[-1])
    fewer = {name: value for name, value in state.items() if not name.startswith(begin)}
    branch = head.removesuffix("_head")
    text = refused(fewer, as_init=as_init)
    assert f"{begin}.weight is missing, expected {count} convolutions" in text
    assert text.endswith(f"--{branch}-convolutions {count - 1}")
    stated = {f"{branch}_convolutions": count - 1}
    found = recognised(fewer, as_init=as_init, **stated).spec
    assert len(getattr(found, f"{branch}_head_widths")) == count - 1
    assert f"{begin}.weight is unexpected" in refused(state, as_init=as_init, **stated)


@pytest.mark.parametrize(
    "layer", ["mask_head.deconv", "mask_head.predictor", "keypoint_head.score_lowres"]
)
def test_starting_weights_need_the_layers_after_the_convolutions(
    layer: str, detectron2_shapes: Shapes
) -> None:
    state = detectron2_shapes("r50")
    del state[f"roi_heads.{layer}.weight"]
    assert f"roi_heads.{layer}.weight is missing" in refused(state, as_init=True)


OTHERS = {
    "a torchvision detector": ("backbone.body.conv1.weight", "rpn.head.conv.0.0.weight"),
    "an mmdetection network": ("backbone.layer1.0.conv1.weight", "neck.lateral_convs.0.conv.bias"),
    "a Caffe2 network": ("conv1_w", "res2_0_branch2a_w"),
    "a C4 network": ("backbone.res2.0.conv1.weight", "roi_heads.res5.0.conv1.weight"),
    "a DC5 network": ("backbone.res2.0.conv1.weight", "backbone.res5.0.conv1.weight"),
    "a RetinaNet": ("backbone.fpn_lateral3.weight", "head.cls_subnet.0.weight"),
    "a Cascade R-CNN": ("backbone.fpn_lateral3.weight", "roi_heads.box_predictor.0.cls_score.bias"),
    "a bare backbone": ("stem.conv1.weight", "res2.0.conv1.weight"),
    "a network": ("encoder.weight", "decoder.weight"),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_other_networks_are_named_with_what_was_found_and_expected(kind: str) -> None:
    text = refused({name: numbers(2, 2) for name in OTHERS[kind]})
    assert f"{FILE}: {kind}" in text
    assert OTHERS[kind][0] in text
    assert "expected Detectron2's Mask R-CNN with FPN" in text


def test_other_depths_and_groupings_are_refused(detectron2_shapes: Shapes) -> None:
    state = detectron2_shapes("r50")
    more = state | {"backbone.bottom_up.res4.6.conv1.weight": numbers(256, 1024, 1, 1)}
    assert "the backbone has (3, 4, 7, 3) blocks with 1 groups of 64" in refused(more)
    grouped = state | {"backbone.bottom_up.res2.0.conv2.weight": numbers(128, 4, 3, 3)}
    assert "(3, 4, 6, 3) blocks with 32 groups of 4 channels, expected" in refused(grouped)
    flat = state | {"backbone.bottom_up.res2.0.conv2.weight": numbers(64)}
    assert "res2.0.conv2.weight has shape (64,), expected 4 axes" in refused(flat)
    bare = state | {"roi_heads.mask_head.mask_fcn2.weight": torch.tensor(1.0)}
    assert "mask_fcn2.weight has shape (), expected 4 axes" in refused(bare)


def test_other_classes_and_keypoints_are_for_starting_weights_only(
    detectron2_shapes: Shapes,
) -> None:
    state = persons(detectron2_shapes("r50"))
    assert "80 classes and 17 keypoints, expected 1 and 5" in refused(state)
    assert "--as-init" in refused(state)
    assert recognised(state, as_init=True).spec == make_spec("r50")


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"height": 10}, "the input is 10x1280"),
        ({"modality": "radar"}, "--modality is 'radar', expected one of: rgb, depth"),
        ({"stride_in": "2x2"}, "--stride-in is '2x2', expected one of: auto, 1x1, 3x3"),
        ({"pixel_std": "two"}, "--pixel-std is 'two', expected one of: auto, unit, imagenet"),
    ],
)
def test_settings_that_make_no_sense_are_refused(
    wanted: dict[str, object], message: str, thin_state: States, write: Write
) -> None:
    with pytest.raises(InputError) as caught:
        import_checkpoint(write(thin_state()), **wanted)  # type: ignore[arg-type]
    assert message in str(caught.value)
