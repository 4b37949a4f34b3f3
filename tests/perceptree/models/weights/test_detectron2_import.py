"""Import of Detectron2 checkpoints: recognition, weights, and errors for other networks."""

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from perceptree.errors import CheckpointError, PerceptreeError
from perceptree.models import ModelSpec, TreeRCNN, make_spec
from perceptree.models.presets import IMAGENET_MEAN, IMAGENET_STD, NINE_ANCHORS_PX
from perceptree.models.weights import Imported, import_checkpoint
from perceptree.models.weights.detectron2 import our_name, their_name
from perceptree.models.weights.recognition import ImportOptions, RecognisedNetwork, recognise

State = dict[str, Tensor]
Shapes = Callable[..., State]
States = Callable[[], State]
Write = Callable[[object], Path]

FILE = Path("their.pth")
CELLS = "proposal_generator.anchor_generator.cell_anchors"
SCORE, SHIFT = "roi_heads.box_predictor.cls_score", "roi_heads.box_predictor.bbox_pred"
HEAT = "roi_heads.keypoint_head.score_lowres"


def numbers(*shape: int) -> Tensor:
    return torch.zeros(()).expand(shape)


def recognised(state: State, **wanted: object) -> RecognisedNetwork:
    return recognise(FILE, state, ImportOptions(**wanted))  # type: ignore[arg-type]


def refused(state: State, **wanted: object) -> str:
    with pytest.raises(CheckpointError) as caught:
        recognised(state, **wanted)
    text = str(caught.value)
    assert text.startswith(f"{FILE}: ")
    assert "\n" not in text
    return text


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


def test_nine_anchors_are_known_by_their_number(detectron2_shapes: Shapes) -> None:
    state = detectron2_shapes("r50", anchor_sizes_px=NINE_ANCHORS_PX)
    assert recognised(state).spec.anchor_sizes_px == NINE_ANCHORS_PX
    state["proposal_generator.rpn_head.objectness_logits.weight"] = numbers(4, 256, 1, 1)
    assert "4 anchors per cell, expected 3 or 9" in refused(state)


SIZES_PX = ((32.0,), (64.0,), (128.0,), (256.0,), (512.0,))


def test_assumed_anchors_are_told_with_the_reason(detectron2_shapes: Shapes) -> None:
    sizes, ratios = recognised(detectron2_shapes("r50")).assumed[-2:]
    assert sizes == "anchor sizes 32,64,128,256,512 px (Detectron2's for 3 per cell)"
    assert ratios == "anchor ratios 0.5,1,2 (Detectron2's)"
    nine = recognised(detectron2_shapes("r50", anchor_sizes_px=NINE_ANCHORS_PX)).assumed
    assert any("(of the paper for 9 per cell)" in text for text in nine)


def test_stated_anchors_are_used_and_are_not_assumed(detectron2_shapes: Shapes) -> None:
    state, mine = detectron2_shapes("r50"), tuple((n / 2,) for (n,) in SIZES_PX)
    found = recognised(state, anchor_sizes_px=mine, anchor_ratios=(1.0, 2.0, 4.0))
    assert found.spec.anchor_sizes_px == mine
    assert found.spec.anchor_ratios == (1.0, 2.0, 4.0)
    assert "anchor" not in " ".join(found.assumed)
    found = recognised(state, anchor_ratios=(1.0,), anchor_sizes_px=NINE_ANCHORS_PX)
    assert found.spec.anchor_sizes_px == NINE_ANCHORS_PX
    found = recognised(state, anchor_ratios=(1.0, 2.0, 4.0))
    assert found.spec.anchor_sizes_px == SIZES_PX
    assert "anchor ratios" not in " ".join(found.assumed)


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"anchor_sizes_px": NINE_ANCHORS_PX}, "has 3 anchors per cell, but sizes 32/64/128,"),
        ({"anchor_sizes_px": SIZES_PX[:4]}, "expected 5 levels of 3 anchors"),
        ({"anchor_ratios": (0.5, 1.0)}, "has 3 anchors per cell, expected 2 or 6, or --anchor-"),
    ],
)
def test_stated_anchors_of_another_number_are_refused(
    wanted: dict[str, object], message: str, detectron2_shapes: Shapes
) -> None:
    assert message in refused(detectron2_shapes("r50"), **wanted)


def test_stated_anchors_that_contradict_the_file_are_refused(detectron2_shapes: Shapes) -> None:
    boxes = {f"{CELLS}.{n}": cell_anchors(px, (0.5, 1.0, 2.0)) for n, px in enumerate(SIZES_PX)}
    state = detectron2_shapes("r50") | boxes
    agreed = recognised(state, anchor_sizes_px=SIZES_PX, anchor_ratios=(0.5, 1.0, 2.0))
    assert agreed.spec.anchor_sizes_px == SIZES_PX
    text = refused(state, anchor_ratios=(1.0, 2.0, 4.0))
    assert "* has 0.5,1,2, but --anchor-ratios is 1,2,4, expected the same" in text
    text = refused(state, anchor_sizes_px=((30.0,), *SIZES_PX[1:]))
    assert "but --anchor-sizes is 30,64,128,256,512, expected the same" in text


def cell_anchors(sizes_px: tuple[float, ...], ratios: tuple[float, ...]) -> Tensor:
    """Anchor boxes centred at 0 as Detectron2 makes them."""
    boxes = []
    for size in sizes_px:
        for ratio in ratios:
            w = math.sqrt(size**2 / ratio)
            boxes.append([-w / 2, -ratio * w / 2, w / 2, ratio * w / 2])
    return torch.tensor(boxes)


@pytest.mark.parametrize("ratios", [(0.5, 1.0, 2.0), (1 / 3, 1.0, 4.5), (2.0,)])
@pytest.mark.parametrize("scales", [(1.0,), (1.0, 2 ** (1 / 3), 2 ** (2 / 3)), (1.0, 0.5)])
def test_anchors_in_the_file_count(
    ratios: tuple[float, ...], scales: tuple[float, ...], detectron2_shapes: Shapes
) -> None:
    sizes = tuple(tuple(32.0 * 2**n * scale for scale in scales) for n in range(5))
    state = detectron2_shapes("r50", anchor_sizes_px=sizes, anchor_ratios=ratios)
    for n, level in enumerate(sizes):
        state[f"{CELLS}.{n}"] = cell_anchors(level, ratios)
    spec = recognised(state).spec
    assert spec.anchor_ratios == pytest.approx(ratios, rel=1e-5)
    for found, wanted in zip(spec.anchor_sizes_px, sizes, strict=True):
        assert found == pytest.approx(wanted, rel=1e-5)


def test_anchors_that_are_no_grid_are_refused(detectron2_shapes: Shapes) -> None:
    boxes = cell_anchors((32.0,), (0.5, 1.0, 2.0))

    def with_cells(*levels: Tensor) -> State:
        return detectron2_shapes("r50") | {f"{CELLS}.{n}": v for n, v in enumerate(levels)}

    assert recognised(with_cells(*[boxes] * 5)).spec.anchor_ratios == (0.5, 1.0, 2.0)
    for wrong in (
        [boxes] * 4,
        [*[boxes] * 4, boxes + 1.0],
        [*[boxes] * 4, boxes.flip(0)],
        [*[boxes] * 4, boxes[:2]],
        [boxes[:, :3]] * 5,
        [boxes * 0.0] * 5,
        [cell_anchors((32.0, 64.0), (0.5, 1.0, 2.0))] * 5,
    ):
        assert "cell_anchors.*, expected 3 boxes" in refused(with_cells(*wrong))


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


def persons(state: State) -> State:
    """The same network for COCO's persons: 17 keypoints and other last layers."""
    channels = state[f"{HEAT}.weight"].shape[0]
    width = state[f"{SCORE}.weight"].shape[1]
    return state | {
        f"{SCORE}.weight": torch.ones(81, width),
        f"{SCORE}.bias": torch.ones(81),
        f"{SHIFT}.weight": torch.ones(320, width),
        f"{SHIFT}.bias": torch.ones(320),
        f"{HEAT}.weight": torch.ones(channels, 17, 4, 4),
        f"{HEAT}.bias": torch.ones(17),
    }


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
    with pytest.raises(PerceptreeError) as caught:
        import_checkpoint(write(thin_state()), **wanted)  # type: ignore[arg-type]
    assert message in str(caught.value)


@pytest.fixture(scope="module")
def imported(thin_state: States, tmp_path_factory: pytest.TempPathFactory) -> Imported:
    """The narrow network for 64x96 px, imported from a file."""
    counter = {"backbone.bottom_up.stem.conv1.norm.num_batches_tracked": torch.tensor(7)}
    path = tmp_path_factory.mktemp("thin") / "their model.pth"
    torch.save({"model": thin_state() | counter, "iteration": 3}, path)
    return import_checkpoint(path, height=64, width=96)


def test_every_weight_arrives(
    imported: Imported,
    thin_spec: ModelSpec,
    thin_state: States,
    detectron2_state: Callable[..., State],
) -> None:
    state = thin_state()
    assert imported.model.spec == dataclasses.replace(thin_spec, height=64, width=96)
    assert not imported.model.training
    assert imported.preset == "r50"
    found = detectron2_state(imported.model)
    assert found.keys() == state.keys()
    for name, value in state.items():
        assert torch.equal(found[name], value), name
    assert imported.model.get_buffer("backbone.trunk.bn1.num_batches_tracked") == 0
    assert imported.training["data"] == "imported from their model.pth"
    assert imported.training["fresh"] == []
    assert not imported.training["init_only"]
    assert len(imported.training["sha256"]) == 64


def test_half_precision_becomes_float32(thin_state: States, write: Write) -> None:
    state = {name: value.half() for name, value in thin_state().items()}
    imported = import_checkpoint(write(state), modality="depth")
    found = imported.model.backbone.trunk.conv1.weight
    assert found.dtype == torch.float32
    assert torch.equal(found, state["backbone.bottom_up.stem.conv1.weight"].float())


@pytest.mark.parametrize("dtype", [torch.int8, torch.int64, torch.bool])
def test_tensors_of_whole_numbers_are_refused(
    dtype: torch.dtype, thin_state: States, write: Write
) -> None:
    state, name = thin_state(), "backbone.fpn_output3.weight"
    path = write(state | {name: (100 * state[name]).to(dtype)})
    kind = str(dtype).removeprefix("torch.")
    with pytest.raises(CheckpointError) as caught:
        import_checkpoint(path)
    assert str(caught.value) == f"{path}: {name} is {kind}, expected floating-point numbers"


def test_a_weight_with_a_flipped_exponent_bit_is_refused(thin_state: States, write: Write) -> None:
    state, name = thin_state(), "roi_heads.box_head.fc1.weight"
    changed = state[name].clone()
    changed.flatten().view(torch.int32)[0] ^= 1 << 30
    path = write(state | {name: changed})
    with pytest.raises(CheckpointError) as caught:
        import_checkpoint(path)
    assert str(caught.value).startswith(f"{path}: {name} holds ")
    assert "expected -1e+06 to 1e+06; the file may be damaged" in str(caught.value)


def test_a_negative_variance_is_refused(thin_state: States, write: Write) -> None:
    state, name = thin_state(), "backbone.bottom_up.stem.conv1.norm.running_var"
    with pytest.raises(CheckpointError, match=r"running_var holds -1, expected 0 to 1e\+12"):
        import_checkpoint(write(state | {name: -state[name]}))
    path = write(state | {name: 1e7 * state[name]})
    assert import_checkpoint(path, height=64, width=96).preset == "r50"


def test_a_network_that_took_rgb_sees_the_same_in_our_bgr(
    imported: Imported, thin_state: States, write: Write
) -> None:
    state = thin_state()
    stem = "backbone.bottom_up.stem.conv1.weight"
    mean, std = torch.tensor(IMAGENET_MEAN), torch.tensor((1.0, 1.0, 1.0))
    state |= {stem: state[stem].flip(1), "pixel_mean": mean.flip(0), "pixel_std": std}
    turned = import_checkpoint(write(state), height=64, width=96)
    image = torch.randint(0, 256, (1, 64, 96, 3), dtype=torch.uint8)
    with torch.inference_mode():
        expected, found = (one.model.features(image)[0][3] for one in (imported, turned))
    assert torch.allclose(found, expected, atol=1e-5)


def test_tensors_that_do_not_fit_are_named_as_in_the_file(thin_state: States, write: Write) -> None:
    state = thin_state()
    del state["backbone.bottom_up.res3.1.conv2.norm.running_var"]
    state["roi_heads.stranger"] = torch.zeros(1)
    state["backbone.fpn_lateral4.bias"] = torch.zeros(9)
    with pytest.raises(CheckpointError) as caught:
        import_checkpoint(write(state))
    text = str(caught.value)
    assert "backbone.bottom_up.res3.1.conv2.norm.running_var is missing" in text
    assert "roi_heads.stranger is unexpected" in text
    assert "backbone.fpn_lateral4.bias has shape (9,), expected (16,)" in text
    state["another"] = state["one more"] = torch.zeros(1)
    with pytest.raises(CheckpointError, match=r"and 2 more$"):
        import_checkpoint(write(state))


def test_a_width_that_only_one_tensor_claims_takes_no_memory(
    thin_state: States, write: Write
) -> None:
    state = thin_state() | {"backbone.fpn_output2.weight": torch.zeros(500_000, 1, 1, 1)}
    with pytest.raises(CheckpointError, match="fpn_width is 500000, expected 1 to 4096"):
        import_checkpoint(write(state))


def test_starting_weights_leave_what_was_learnt_of_others_fresh(
    thin_spec: ModelSpec, thin_state: States, write: Write, detectron2_state: Callable[..., State]
) -> None:
    state = persons(thin_state())
    fitting = {f"{SCORE}.weight": torch.ones(2, 24), f"{SCORE}.bias": torch.ones(2)}
    state |= fitting  # for another class, although the shape is the same
    path = write({"model": state})
    torch.manual_seed(1)
    first = import_checkpoint(path, as_init=True)
    torch.manual_seed(2)
    rolled = torch.rand(3)
    torch.manual_seed(2)
    second = import_checkpoint(path, as_init=True)
    assert torch.equal(torch.rand(3), rolled)
    assert first.model.spec == thin_spec
    found, again = detectron2_state(first.model), detectron2_state(second.model)
    fresh = {f"{layer}.{kind}" for layer in (SCORE, SHIFT, HEAT) for kind in ("weight", "bias")}
    assert {their_name(name) for name in first.training["fresh"]} == fresh
    assert first.training["init_only"]
    for name, value in found.items():
        assert torch.equal(value, again[name]), name
        assert name in fresh or torch.equal(value, state[name]), name
    assert 0.005 < found[f"{SCORE}.weight"].std() < 0.02


def test_starting_weights_may_lack_branches_or_classes(thin_state: States, write: Write) -> None:
    state = persons(thin_state())
    bare = {k: v for k, v in state.items() if "mask_head" not in k and "keypoint_head" not in k}
    imported = import_checkpoint(write(bare), as_init=True)
    assert imported.model.spec.masks
    assert imported.model.spec.keypoints
    fresh = imported.training["fresh"]
    assert {name.split(".")[0] for name in fresh} == {"box_head", "mask_head", "keypoint_head"}
    assert "mask_head.tower.convs.0.weight" in fresh
    state["roi_heads.mask_head.predictor.weight"] = torch.ones(80, 8, 1, 1)
    state["roi_heads.mask_head.predictor.bias"] = torch.ones(80)
    fresh = import_checkpoint(write(state), as_init=True).training["fresh"]
    assert [name for name in fresh if name.startswith("mask_head")] == [
        "mask_head.score.weight",
        "mask_head.score.bias",
    ]
    fcn1 = "roi_heads.keypoint_head.conv_fcn1.bias"
    with pytest.raises(CheckpointError, match=r"conv_fcn1.bias is missing"):
        import_checkpoint(write({k: v for k, v in state.items() if k != fcn1}), as_init=True)
    del state["backbone.fpn_lateral3.weight"]
    with pytest.raises(CheckpointError, match=r"fpn_lateral3.weight is missing"):
        import_checkpoint(write(state), as_init=True)
