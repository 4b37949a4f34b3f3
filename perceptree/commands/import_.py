"""`perceptree import`: convert a published checkpoint."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from basetree.errors import SettingsError
from basetree.program.console import print_json, tell
from basetree.program.options import expand_groups
from basetree.program.quoting import quoted
from perceptree.commands.options import Json
from perceptree.commands.progress import say
from perceptree.errors import CheckpointError

if TYPE_CHECKING:
    from perceptree.models.weights import Imported


@dataclass(frozen=True)
class NetworkOptions:
    """What the file does not tell of its network, and what is made of it."""

    modality: Annotated[
        str, typer.Option(metavar="NAME", help="Input of the model: rgb or depth.")
    ] = "rgb"
    height: Annotated[
        int | None, typer.Option(help="Height of the frames in px.", show_default="720")
    ] = None
    width: Annotated[
        int | None, typer.Option(help="Width of the frames in px.", show_default="1280")
    ] = None
    stride_in: Annotated[
        str, typer.Option(metavar="NAME", help="Convolution with the stride: auto, 1x1 or 3x3.")
    ] = "auto"
    pixel_std: Annotated[
        str, typer.Option(metavar="NAME", help="Divisor of the pixels: auto, unit or imagenet.")
    ] = "auto"
    as_init: Annotated[
        bool,
        typer.Option(
            "--as-init", help="Keep matching tensors only, as starting weights for training."
        ),
    ] = False
    anchor_sizes: Annotated[
        str | None,
        typer.Option(
            metavar="PX,...",
            help="Anchor sizes of the five levels, such as 32,64,128,256,512; several of a level"
            " as 32/48.",
            show_default="the file's, or the usual ones for its number of anchors",
        ),
    ] = None
    anchor_ratios: Annotated[
        str | None,
        typer.Option(
            metavar="RATIO,...",
            help="Height over width of the anchors.",
            show_default="the file's, or 0.5,1,2",
        ),
    ] = None
    mask_convolutions: Annotated[
        int, typer.Option(help="Convolutions of the mask head, if it has one.")
    ] = 4
    keypoint_convolutions: Annotated[
        int, typer.Option(help="Convolutions of the keypoint head, if it has one.")
    ] = 8

    def arguments(self) -> dict[str, Any]:
        """The keyword arguments of `import_checkpoint`; raises SettingsError."""
        values = asdict(self)
        sizes_px = _groups("--anchor-sizes", values.pop("anchor_sizes"))
        ratios = _numbers("--anchor-ratios", values.pop("anchor_ratios"))
        return {**values, "anchor_sizes_px": sizes_px, "anchor_ratios": ratios}


@expand_groups
def import_(
    checkpoint: Annotated[
        Path,
        typer.Argument(
            metavar="CKPT", help="Checkpoint of Detectron2, .pth, or of its model zoo, .pkl."
        ),
    ],
    *,
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write.",
            show_default="CKPT's name with .safetensors, in this folder",
        ),
    ] = None,
    network: NetworkOptions,
    as_json: Json = False,
) -> None:
    """Import a Detectron2 Mask R-CNN checkpoint; code in the file is not executed."""
    if not checkpoint.exists():
        raise CheckpointError(f"{checkpoint}: no such file, expected a .pth or .pkl file")
    out = out or Path(checkpoint.stem + ".safetensors")
    if out.resolve() == checkpoint.resolve():
        raise CheckpointError(f"{out}: is the input file, expected another --out")

    from perceptree.models import save_checkpoint
    from perceptree.models.weights import import_checkpoint

    imported = import_checkpoint(checkpoint, **network.arguments())
    save_checkpoint(out, imported.model, imported.training)
    if imported.assumed:
        assumed = ", ".join(imported.assumed)
        say(f"{checkpoint} does not contain these settings, assumed: {assumed}")
    facts = _facts(imported, out)
    if as_json:
        print_json({"schema": "perceptree.import/1", **facts})
        return
    _show(facts)


def _groups(option: str, text: str | None) -> list[list[float]] | None:
    """Numbers by level: levels after commas, several of a level after slashes."""
    if text is None:
        return None
    return [_numbers(option, level.replace("/", ",")) or [] for level in text.split(",")]


def _numbers(option: str, text: str | None) -> list[float] | None:
    if text is None:
        return None
    try:
        numbers = [float(value) for value in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not all(0.0 < value < math.inf for value in numbers):
        raise SettingsError(f"{option} is {text!r}, expected numbers above 0, after commas")
    return numbers


def _facts(imported: Imported, out: Path) -> dict[str, Any]:
    """Return what was recognised and written, as JSON values."""
    spec, training = imported.model.spec, imported.training
    return {
        "checkpoint": str(out),
        "model": imported.preset,
        "backbone": spec.backbone,
        "modality": spec.modality,
        "height": spec.height,
        "width": spec.width,
        "stride_in": "1x1" if spec.stride_in_1x1 else "3x3",
        "pixel_mean": list(spec.mean),
        "pixel_std": list(spec.std),
        "anchors_per_cell": spec.anchors_per_cell,
        "anchor_sizes_px": [list(sizes) for sizes in spec.anchor_sizes_px],
        "anchor_ratios": list(spec.anchor_ratios),
        "masks": spec.masks,
        "keypoints": spec.keypoints,
        "parameters": sum(value.numel() for value in imported.model.parameters()),
        "assumed": list(imported.assumed),
        "init_only": training["init_only"],
        "fresh": training["fresh"],
        "sha256": training["sha256"],
    }


def _show(facts: dict[str, Any]) -> None:
    std = ", ".join(f"{value:g}" for value in facts["pixel_std"])
    branches = ["boxes"] + [name for name in ("masks", "keypoints") if facts[name]]
    tell(f"{facts['model']}: {facts['backbone']}, stride in the {facts['stride_in']}")
    tell(f"input: {facts['modality']}, {facts['width']}x{facts['height']}, pixel std {std}")
    tell(
        f"predicts: {', '.join(branches)}; {facts['anchors_per_cell']} anchors per cell, "
        f"{facts['parameters'] / 1e6:.2f} M parameters"
    )
    sizes = ", ".join("/".join(f"{px:g}" for px in level) for level in facts["anchor_sizes_px"])
    ratios = ", ".join(f"{ratio:g}" for ratio in facts["anchor_ratios"])
    tell(f"anchors: {sizes} px at the levels 2 to 6, ratios {ratios}")
    tell(f"sha256 of the imported file: {facts['sha256']}")
    out = facts["checkpoint"]
    if facts["init_only"]:
        tell(f"fresh: {len(facts['fresh'])} tensors with random values, to be trained")
    tell(out)
    if facts["init_only"]:
        tell(f"next: perceptree train DATA --init {quoted(out)} --out RUN")
        return
    tell(f"next: perceptree eval {quoted(out)} DATA")
    tell(f"      edgetree export {quoted(out)} --data DATA --out model.onnx")
