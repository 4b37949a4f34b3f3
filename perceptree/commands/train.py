"""``perceptree train``: train a detector on a dataset."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from basetree.errors import SettingsError
from perceptree.commands.data import EntireTree, Fold
from perceptree.commands.progress import TrainingBar, bar, say
from perceptree.errors import DatasetError

if TYPE_CHECKING:
    from perceptree.models import ModelSpec
    from perceptree.training import Init, TrainReport, TrainSettings

_DEFAULT_MODEL = "edge-n"
_STEPS = 20_000
_MIX_SHARE = 0.5
_SETTINGS = (
    "steps",
    "minutes",
    "patience",
    "batch",
    "mix_share",
    "accumulate",
    "learning_rate",
    "evaluate_every_steps",
    "seed",
    "freeze_level",
    "frozen_norms",
    "frozen_steps",
    "backbone_rate_share",
    "keep_weights",
    "keep_features",
    "weight_bits",
)

_Model = Annotated[
    str | None,
    typer.Option(
        "--model",
        help="edge-n (the default), edge-s, edge-m, edge-l, or the paper's r50, r101, x101-32x8d,"
        " x101-32x4d.",
    ),
]
_Init = Annotated[
    str | None,
    typer.Option(
        "--init", help="Starting weights: imagenet, coco, or a checkpoint. By default random."
    ),
]
_InitHeads = Annotated[
    Path | None,
    typer.Option(help="Checkpoint for the starting weights of all but the backbone."),
]
_Modality = Annotated[
    str | None, typer.Option(help="Input of the model: depth (the default) or rgb.")
]
_Side = Annotated[int | None, typer.Option(help="Size of the input in px; by default the model's.")]
_HasBranch = Annotated[
    bool | None, typer.Option(help="Whether the model has this branch; by default the preset's.")
]
_FreezeLevel = Annotated[
    int | None,
    typer.Option(
        help="Freeze the backbone up to stride 2**N; by default 2 for the paper's backbones with"
        " starting weights, else 0."
    ),
]
_FrozenNorms = Annotated[
    bool | None,
    typer.Option(
        "--frozen-norms/--trained-norms",
        help="Freeze the backbone's batch norms; by default only for the paper's backbones with"
        " starting weights.",
    ),
]
_FrozenSteps = Annotated[
    int | None,
    typer.Option(help="Freeze all of the backbone for this many steps first; by default none."),
]
_BackboneRate = Annotated[
    float | None,
    typer.Option(
        "--backbone-rate",
        help="Learning rate of the backbone, as a share of that of the rest; by default the"
        " recipe's.",
    ),
]
_KeepWeights = Annotated[
    float | None,
    typer.Option(help="Pull of the backbone towards its starting weights; by default none."),
]
_KeepFeatures = Annotated[
    float | None,
    typer.Option(
        help="Weight of the loss that holds the backbone's maps near the starting ones; by default"
        " none."
    ),
]

_Recipe = Annotated[
    str | None,
    typer.Option(
        help="Training recipe: scratch (small networks from random weights; the default), varied"
        " (the same with stronger changes of light and colour, for RGB on real cameras) or paper"
        " (the default for the paper's backbones)."
    ),
]
_Steps = Annotated[
    int | None,
    typer.Option(
        help="Stop after this many steps; a larger number extends a run. By default 20000;"
        " 60000 with the recipe paper."
    ),
]
_Batch = Annotated[int | None, typer.Option(help="Frames per step, over all processes. [8]")]
_Rate = Annotated[float | None, typer.Option(help="Peak learning rate; by default the recipe's.")]
_Patience = Annotated[
    int | None,
    typer.Option(help="Stop if the box AP on val has not improved in this many evaluations."),
]
_EvaluateEvery = Annotated[
    int | None,
    typer.Option(
        "--evaluate-every",
        help="Steps between evaluations on val; by default the recipe's.",
    ),
]
_WeightBits = Annotated[
    int | None,
    typer.Option(
        help="Round the weights to so many bits while training; 7 if an int8 export then loses too"
        " much. By default exact weights."
    ),
]
_BranchedRun = Annotated[
    Path | None,
    typer.Option(
        "--branch",
        help="Folder of a run to continue from its state, with the learning rate decaying to 0"
        " over this run's steps or minutes.",
    ),
]
_Simulate = Annotated[
    int | None,
    typer.Option(
        help="Extend DATA, a folder of perceptree synth, to this many frames while training; half"
        " of the cores simulate. Needs --minutes."
    ),
]
_Mix = Annotated[
    Path | None,
    typer.Option(
        help="Folder of a second dataset to mix into each batch, so that the model does not forget"
        " what it knew. Only DATA is evaluated."
    ),
]
_MixShare = Annotated[
    float | None, typer.Option(help="Share of each batch that comes from --mix; 0.5 if not given.")
]
_Certain = Annotated[
    float | None,
    typer.Option(
        "--certain",
        help="Distance in metres beyond which labelled trees are ignored: they are neither trees"
        " nor background, in training and on val. Needs labels with distance_m.",
    ),
]
_Device = Annotated[str, typer.Option(help="cpu or cuda; use torchrun for several processes.")]
_Precision = Annotated[str, typer.Option(help="fp32, bf16, or auto (the faster one).")]
_Workers = Annotated[
    int | None,
    typer.Option(help="Processes that prepare batches; by default chosen by the number of cores."),
]
_Compile = Annotated[bool, typer.Option(help="Compile the network first; worthwhile on GPUs.")]
_Cache = Annotated[
    Path | None,
    typer.Option(help="Folder for decoded frames; by default .frame-cache next to the data."),
]


def train(
    data: Annotated[Path, typer.Argument(help="Folder of a dataset in any supported layout.")],
    out: Annotated[Path, typer.Option(help="Folder of the run; an interrupted run is resumed.")],
    fold: Fold = None,
    entire_tree: EntireTree = False,
    recipe: _Recipe = None,
    model: _Model = None,
    init: _Init = None,
    init_heads: _InitHeads = None,
    branch: _BranchedRun = None,
    modality: _Modality = None,
    height: _Side = None,
    width: _Side = None,
    masks: _HasBranch = None,
    keypoints: _HasBranch = None,
    freeze_level: _FreezeLevel = None,
    frozen_norms: _FrozenNorms = None,
    frozen_steps: _FrozenSteps = None,
    backbone_rate_share: _BackboneRate = None,
    keep_weights: _KeepWeights = None,
    keep_features: _KeepFeatures = None,
    minutes: Annotated[
        float | None, typer.Option(help="Stop after this training time in minutes.")
    ] = None,
    steps: _Steps = None,
    patience: _Patience = None,
    batch: _Batch = None,
    accumulate: Annotated[
        int, typer.Option(help="Number of parts that a batch is split into, to save memory.")
    ] = 1,
    learning_rate: _Rate = None,
    weight_bits: _WeightBits = None,
    evaluate_every_steps: _EvaluateEvery = None,
    mix: _Mix = None,
    mix_share: _MixShare = None,
    certain: _Certain = None,
    simulate: _Simulate = None,
    seed: Annotated[int, typer.Option(help="Seed of weights, order and augmentation.")] = 0,
    device: _Device = "cpu",
    precision: _Precision = "auto",
    workers: _Workers = None,
    compile: _Compile = False,  # noqa: A002
    cache: _Cache = None,
    skip_broken: Annotated[bool, typer.Option(help="Leave out broken frames.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Train a detector from random or published weights; keeps the best by box AP on val."""
    _run(dict(locals()))


def _run(options: dict[str, Any]) -> None:
    """Train with the options of the command."""
    _check_options(options)
    start = _starting_weights(options["init"])

    from perceptree.training import DataSource, Engine, Preparing, train_while_simulating
    from perceptree.training import train as run_training

    changes = {name: options[name] for name in ("height", "width", "masks", "keypoints")}
    spec = _spec(options["model"], options["modality"], start, _given(changes))
    settings = _settings(spec, options, start)
    engine = Engine(
        cache=None if options["cache"] is None else str(options["cache"]),
        **{
            name: options[name]
            for name in ("device", "precision", "workers", "compile", "skip_broken")
        },
    )
    # Only one of torchrun's processes prints.
    is_main = os.environ.get("RANK", "0") == "0"
    shown = is_main and not options["as_json"]
    chosen = (options[name] for name in ("data", "fold", "entire_tree", "mix", "certain"))
    source = DataSource(*chosen)
    with bar("caching frames", shown) as cached:
        preparing = Preparing(cached, say if is_main else lambda line: None)
        if options["simulate"] is None:
            report = run_training(
                spec,
                settings,
                source,
                options["out"],
                TrainingBar(shown),
                start,
                engine,
                options["branch"],
                preparing,
                options["init_heads"],
            )
        else:
            report = train_while_simulating(
                spec,
                settings,
                options["data"],
                options["simulate"],
                options["out"],
                TrainingBar(shown),
                start,
                engine,
                preparing,
            )
    if is_main:
        _print_result(report, options["data"], options["as_json"])


def _check_options(options: dict[str, Any]) -> None:
    """Reject invalid options before torch is loaded, which takes seconds."""
    if options["modality"] not in (None, "rgb", "depth"):
        raise SettingsError(f"--modality is {options['modality']!r}: expected rgb or depth")
    if options["mix"] is None and options["mix_share"] is not None:
        raise SettingsError("--mix-share is given without --mix: expected a dataset to mix in")
    if options["simulate"] is None:
        for data in (options["data"], options["mix"]):
            if data is not None and not data.exists():
                raise DatasetError(
                    f"{data}: no such file or folder, expected a dataset; simulate one with"
                    f" perceptree synth --out {data}"
                )
        return
    for name in ("branch", "mix", "fold", "entire_tree", "certain", "init_heads"):
        if options[name] not in (None, False):
            option = name.replace("_", "-")
            raise SettingsError(f"--simulate excludes --{option}: expected one of the two")


def _given(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _settings(spec: ModelSpec, options: dict[str, Any], start: Init | None) -> TrainSettings:
    """Return the recipe's settings with the changes from the options."""
    from perceptree.training import PAPER_FREEZING, PAPER_STEPS, recipe_settings

    changes = _given({name: options[name] for name in _SETTINGS})
    if options["mix"] is not None:
        changes.setdefault("mix_share", _MIX_SHARE)
    paper = _is_paper(spec)
    recipe = options["recipe"] or ("paper" if paper else "scratch")
    if paper and start is not None:
        changes = PAPER_FREEZING | changes
    if "minutes" not in changes and "steps" not in changes:
        changes["steps"] = PAPER_STEPS if recipe == "paper" else _STEPS
    if options["branch"] is not None:
        changes["schedule"] = "decay"
    return recipe_settings(recipe, **changes)


def _starting_weights(init: str | None) -> Init | None:
    if init is None:
        return None
    if init == "imagenet":
        return "imagenet"
    if init == "coco":
        return "coco"
    if not Path(init).is_file():
        raise SettingsError(f"--init is {init!r}: expected imagenet, coco or a checkpoint file")
    return Path(init)


def _is_paper(spec: ModelSpec) -> bool:
    from perceptree.models import PAPER_PRESETS

    return spec.backbone in {preset["backbone"] for preset in PAPER_PRESETS.values()}


def _spec(
    model: str | None, modality: str | None, start: Init | None, changes: dict[str, Any]
) -> ModelSpec:
    """Return the spec of the preset or the starting file; ``changes`` are fields of ModelSpec.

    Another preset than that of the starting file sets the input size. The anchors of light models
    grow with the width.
    """
    from perceptree.models import load_checkpoint, make_spec

    named = make_spec(model or _DEFAULT_MODEL, "rgb" if modality == "rgb" else "depth", **changes)
    if not isinstance(start, Path):
        # Published weights were trained with the stride in the 3x3 convolutions.
        return dataclasses.replace(named, stride_in_1x1=False) if start else named
    own = load_checkpoint(start)[0].spec
    for field in ("backbone", "levels") if model is not None else ():
        asked, found = getattr(named, field), getattr(own, field)
        if asked != found:
            raise SettingsError(
                f"--model is {model}, of {field} {asked}, but {start} holds {found}: "
                "expected the same, or no --model"
            )
    if modality is not None and modality != own.modality:
        raise SettingsError(
            f"--modality is {modality}, but {start} is for {own.modality}: expected the same, "
            "or no --modality"
        )
    if model is not None and named.name != own.name:
        changes = {"name": named.name, "height": named.height, "width": named.width} | changes
    if not _is_paper(own):
        growth = changes.get("width", own.width) / own.width
        sizes_px = tuple(tuple(growth * side for side in level) for level in own.anchor_sizes_px)
        changes = {"anchor_sizes_px": sizes_px} | changes
    return dataclasses.replace(own, **changes)


def _print_result(report: TrainReport, data: Path, as_json: bool) -> None:
    metrics = report.metrics
    if as_json:
        result = {
            "checkpoint": str(report.checkpoint),
            "steps": report.steps,
            "elapsed_s": round(report.elapsed_s, 1),
            "val": metrics.to_dict(),
        }
        typer.echo(json.dumps(result))
        return
    typer.echo(f"val: box AP {metrics.box_ap:.1f}, AP50 {metrics.box_ap50:.1f}")
    typer.echo(f"{report.checkpoint}")
    typer.echo(f"next: edgetree export {report.checkpoint} --data {data} --out model.onnx")
