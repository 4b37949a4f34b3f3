"""Training and detection on a GPU give what they give on the CPU; skipped where there is none."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from perceptree.data import FrameStore, read_split
from perceptree.evaluation import predict_with
from perceptree.models import ModelSpec, SampleSettings, TreeRCNN, load_checkpoint
from perceptree.training import Engine, TrainSettings, train
from perceptree.training.batches import SeededDraws, collate

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU for torch")

Make = Callable[..., ModelSpec]
Plan = Callable[..., TrainSettings]


@pytest.fixture(autouse=True)
def _full_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without TF32, whose rounding is a thousand times that of float32."""
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", False)


def losses_on(device: str, model: TreeRCNN, store: FrameStore) -> dict[str, float]:
    """Losses of the first frames with the gradient, on a device."""
    batch = collate([(store[number], number, str(number)) for number in range(4)])
    assert batch.targets is not None
    targets = batch.targets.unpack(torch.device(device))
    model.to(device).train().zero_grad()
    losses: dict[str, Tensor] = model.losses(
        batch.images.to(device), targets, SampleSettings(), SeededDraws(batch.seeds)
    )
    torch.stack(list(losses.values())).sum().backward()  # type: ignore[no-untyped-call]
    return {name: loss.item() for name, loss in losses.items()}


def gradient_of(model: TreeRCNN) -> Tensor:
    """The gradient of all weights in one row, on the CPU."""
    parts = [p.grad.flatten().cpu() for p in model.parameters() if p.grad is not None]
    return torch.cat(parts).double()


@pytest.mark.parametrize("modality", ["depth", "rgb"])
def test_losses_and_gradients_are_those_of_the_cpu(
    posts: Path, narrow: Make, modality: str
) -> None:
    torch.manual_seed(0)
    model = TreeRCNN(narrow(modality))
    store = FrameStore(read_split(posts, "train"), model.spec)
    on_cpu = losses_on("cpu", model, store)
    gradient = gradient_of(model)
    assert losses_on("cuda", model, store) == pytest.approx(on_cpu, rel=1e-3)
    # Rounding moves single values behind a ReLU or the choice of a region, not the direction.
    alike = torch.cosine_similarity(gradient, gradient_of(model), dim=0)
    assert alike > 0.99


def test_a_training_of_the_cpu_goes_on_on_a_gpu(
    posts: Path, tmp_path: Path, narrow: Make, plan: Plan
) -> None:
    run = tmp_path / "run"
    train(narrow(), plan(steps=2), posts, run)
    report = train(narrow(), plan(steps=6), posts, run, engine=Engine(device="cuda", workers=1))
    assert report.steps == 6
    _, record = load_checkpoint(report.checkpoint)
    assert record["training"]["device"] == torch.cuda.get_device_name()
    assert record["training"]["val"]["box_ap"] == report.metrics.box_ap


def test_trees_found_on_a_gpu_are_those_of_the_cpu(
    posts: Path, tmp_path: Path, narrow: Make, plan: Plan
) -> None:
    model, _ = load_checkpoint(train(narrow(), plan(), posts, tmp_path / "run").checkpoint)
    images = FrameStore(read_split(posts, "val"), model.spec).image(0)[None]
    on_cpu, on_gpu = (predict_with(model.eval().to(device))(images) for device in ("cpu", "cuda"))
    assert on_gpu.scores == pytest.approx(on_cpu.scores, abs=1e-3)
    assert on_gpu.boxes == pytest.approx(on_cpu.boxes, abs=0.05)
