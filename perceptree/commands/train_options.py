"""The options of `perceptree train`, in groups."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from basetree.errors import SettingsError
from basetree.program.options import given, option_of
from perceptree.commands.options import Side
from perceptree.errors import DatasetError
from perceptree.settings.training import DataSource, TrainSettings

if TYPE_CHECKING:
    from perceptree.models import ModelSpec
    from perceptree.models.spec import Modality
    from perceptree.training import Init
    from perceptree.training.branching import BranchedRun

_DEFAULT_MODEL = "edge-n"
_STEPS = 20_000
_MIX_SHARE = 0.5
_PAPER_START = "for the paper's backbones with starting weights"
_TRANSFER = "with the recipe transfer"

_HasBranch = Annotated[
    bool | None,
    typer.Option(help="Whether the model has this branch.", show_default="the preset's"),
]


@dataclass(frozen=True)
class DataOptions:
    """What is learned from, beside the dataset itself."""

    panel = "Data"

    fields_of = DataSource

    fold: int | None = None
    entire_tree: bool = False
    mix: Path | None = None
    mix_share: Annotated[
        float | None, option_of(TrainSettings, "mix_share", default=f"{_MIX_SHARE} with --mix")
    ] = None
    certain_m: float | None = None
    crowds_as_trees: bool = False
    exact_depth: bool = False
    simulate: Annotated[
        int | None,
        typer.Option(
            help="Extend DATA, a folder of perceptree synth, to this many frames while training;"
            " half of the cores simulate. Needs --minutes."
        ),
    ] = None

    def source(self, data: Path) -> DataSource:
        """The dataset `data` with these options."""
        return DataSource(data, **given(self, DataSource))

    def check(self, data: Path, start: StartOptions) -> None:
        """Check what needs no other settings; raises SettingsError or DatasetError."""
        if self.mix is None and self.mix_share is not None:
            raise SettingsError("--mix-share is given without --mix: expected a dataset to mix in")
        if self.simulate is not None:
            self._check_simulation(start)
            return
        for folder in (data, self.mix):
            if folder is not None and not folder.exists():
                raise DatasetError(
                    f"{folder}: no such file or folder, expected a dataset; simulate one with"
                    f" perceptree synth --out {folder}"
                )

    def _check_simulation(self, start: StartOptions) -> None:
        others = {
            "branch": start.branch,
            "mix": self.mix,
            "fold": self.fold,
            "entire-tree": self.entire_tree or None,
            "certain": self.certain_m,
            "crowds-as-trees": self.crowds_as_trees or None,
            "exact-depth": self.exact_depth or None,
            "init-heads": start.init_heads,
            "init-colour": start.init_colour,
        }
        for option, value in others.items():
            if value is not None:
                raise SettingsError(f"--simulate excludes --{option}: expected one of the two")


@dataclass(frozen=True)
class ModelOptions:
    """What is trained."""

    panel = "Model"

    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="edge-n, edge-s, edge-m, edge-l, or the paper's r50, r101, x101-32x8d,"
            " x101-32x4d.",
            show_default=_DEFAULT_MODEL,
        ),
    ] = None
    modality: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Input of the model: depth, rgb, or both.",
            show_default="depth",
        ),
    ] = None
    height: Side = None
    width: Side = None
    masks: _HasBranch = None
    keypoints: _HasBranch = None

    def check(self) -> None:
        """Check what needs no PyTorch; raises SettingsError."""
        if self.modality not in (None, "rgb", "depth", "both"):
            raise SettingsError(f"--modality is {self.modality!r}: expected rgb, depth or both")

    def spec(self, start: Init | None, branched: BranchedRun | None = None) -> ModelSpec:
        """The spec of the preset, of the starting file, or of the run that is branched.

        Another preset than that of the starting file sets the input size. The anchors of light
        models grow with the width.

        Raises:
            SettingsError: If the options do not fit the starting file.
        """
        from perceptree.models import ModelSpec, load_checkpoint, make_spec
        from perceptree.models.branches import joined_spec
        from perceptree.training.starting import Branches

        changes = given(self, ModelSpec)
        usual = "both" if isinstance(start, Branches) else "depth"
        modality = cast("Modality", changes.pop("modality", usual))
        named = make_spec(self.model or _DEFAULT_MODEL, modality, **changes)
        if isinstance(start, Branches):
            depth, colour = (load_checkpoint(path)[0].spec for path in (start.depth, start.colour))
            return self._resized(
                joined_spec(depth, colour, named.name), named, changes, start.depth
            )
        if start is None and branched is not None:
            return self._resized(branched.spec, named, changes, branched.folder)
        if not isinstance(start, Path):
            # Published weights were trained with the stride in the 3x3 convolutions.
            return dataclasses.replace(named, stride_in_1x1=False) if start else named
        return self._resized(load_checkpoint(start)[0].spec, named, changes, start)

    def _resized(
        self, own: ModelSpec, named: ModelSpec, changes: dict[str, Any], start: Path
    ) -> ModelSpec:
        """The spec of a starting file with the input size of the options."""
        self._check_fit(named, own, start)
        if self.model is not None and named.name != own.name:
            changes = {"name": named.name, "height": named.height, "width": named.width} | changes
        if not is_paper(own):
            growth = changes.get("width", own.width) / own.width
            sizes_px = tuple(tuple(growth * px for px in level) for level in own.anchor_sizes_px)
            changes = {"anchor_sizes_px": sizes_px} | changes
        return dataclasses.replace(own, **changes)

    def _check_fit(self, named: ModelSpec, own: ModelSpec, start: Path) -> None:
        """Compare the preset of --model and --modality with the spec of the starting file."""
        for field in ("backbone", "levels") if self.model is not None else ():
            asked, found = getattr(named, field), getattr(own, field)
            if asked != found:
                raise SettingsError(
                    f"--model is {self.model}, of {field} {asked}, but {start} holds {found}: "
                    "expected the same, or no --model"
                )
        if self.modality not in (None, own.modality):
            raise SettingsError(
                f"--modality is {self.modality}, but {start} is for {own.modality}: expected the"
                " same, or no --modality"
            )


@dataclass(frozen=True)
class StartOptions:
    """From where a training starts, and what it keeps of the start."""

    panel = "Start"

    fields_of = TrainSettings

    init: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Starting weights: imagenet, coco, or a checkpoint.",
            show_default="random",
        ),
    ] = None
    init_colour: Annotated[
        Path | None,
        typer.Option(
            help="Checkpoint of an rgb model whose backbone a model of both inputs takes; --init is"
            " then one of a depth model."
        ),
    ] = None
    init_heads: Annotated[
        Path | None,
        typer.Option(help="Checkpoint for the starting weights of all but the backbone."),
    ] = None
    branch: Annotated[
        Path | None,
        typer.Option(
            help="Folder of a run to continue from its state, with its model and settings where"
            " none are given; the learning rate falls to a hundredth over this run's steps or"
            " minutes."
        ),
    ] = None
    freeze_level: Annotated[
        int | None,
        option_of(
            TrainSettings, "freeze_level", default=f"2 {_PAPER_START} or {_TRANSFER}, else 0"
        ),
    ] = None
    frozen_norms: Annotated[
        bool | None,
        option_of(TrainSettings, "frozen_norms", default=f"only {_PAPER_START} or {_TRANSFER}"),
    ] = None
    frozen_steps: int | None = None
    backbone_rate_share: float | None = None
    keep_weights: float | None = None
    keep_features: Annotated[
        float | None, option_of(TrainSettings, "keep_features", default=f"0; 1 {_TRANSFER}")
    ] = None

    def weights(self) -> Init | None:
        """The starting weights; None for random ones. Raises SettingsError."""
        if self.init_colour is not None:
            return self._branches(self.init_colour)
        if self.init is None:
            return None
        if self.init == "imagenet":
            return "imagenet"
        if self.init == "coco":
            return "coco"
        if not Path(self.init).is_file():
            raise SettingsError(
                f"--init is {self.init!r}: expected imagenet, coco or a checkpoint file"
            )
        return Path(self.init)

    def _branches(self, colour: Path) -> Init:
        from perceptree.training.starting import Branches

        if self.init is None or not Path(self.init).is_file():
            raise SettingsError(
                f"--init is {self.init!r} with --init-colour: expected a checkpoint of a depth"
                " model"
            )
        return Branches(Path(self.init), colour)


@dataclass(frozen=True)
class ScheduleOptions:
    """How long and how fast it is learned."""

    panel = "Schedule"

    fields_of = TrainSettings

    recipe: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Training recipe: scratch (small networks from random weights),"
            " varied (the same with stronger changes of light and colour, for RGB on real cameras),"
            " transfer (varied, with a backbone that is kept near its starting weights) or paper"
            ".",
            show_default="scratch; paper for the paper's backbones",
        ),
    ] = None
    minutes: float | None = None
    steps: Annotated[
        int | None,
        option_of(TrainSettings, "steps", default=f"{_STEPS}; 60000 with the recipe paper"),
    ] = None
    patience: int | None = None
    batch: int | None = None
    accumulate: int | None = None
    learning_rate: Annotated[
        float | None, option_of(TrainSettings, "learning_rate", default="the recipe's")
    ] = None
    weight_bits: int | None = None
    evaluate_every_steps: Annotated[
        int | None, option_of(TrainSettings, "evaluate_every_steps", default="the recipe's")
    ] = None
    seed: int | None = None


def train_settings(
    spec: ModelSpec,
    data: DataOptions,
    start: StartOptions,
    schedule: ScheduleOptions,
    branched: BranchedRun | None = None,
) -> TrainSettings:
    """The settings of the recipe with the changes from the options.

    Those of a branch without a recipe of its own are the settings of the run that it branches.

    Raises:
        SettingsError: If the recipe is unknown or a value is out of range.
    """
    from perceptree.training import PAPER_FREEZING, PAPER_STEPS, recipe_settings

    changes: dict[str, Any] = {}
    for group in (data, start, schedule):
        changes |= given(group, TrainSettings)
    before = {} if branched is None else branched.values
    if data.mix is not None:
        changes.setdefault("mix_share", before.get("mix_share") or _MIX_SHARE)
    recipe = schedule.recipe or ("paper" if is_paper(spec) else "scratch")
    if is_paper(spec) and start.init is not None and branched is None:
        changes = PAPER_FREEZING | changes
    if "minutes" not in changes and "steps" not in changes:
        changes["steps"] = PAPER_STEPS if recipe == "paper" else _STEPS
    if branched is None:
        return recipe_settings(recipe, **changes)
    changes["schedule"] = "decay"
    if schedule.recipe is not None:
        return recipe_settings(recipe, **{"learning_rate": branched.learning_rate} | changes)
    return branched.settings(**{"mix_share": 0.0, **_usual(recipe), **changes})


def _usual(recipe: str) -> dict[str, Any]:
    """What a recipe says of the settings that a branch does not take from its run."""
    from perceptree.training import RECIPES

    name = "evaluate_every_steps"
    return {name: RECIPES[recipe][name]} if name in RECIPES[recipe] else {}


def is_paper(spec: ModelSpec) -> bool:
    """Whether a model has one of the paper's backbones."""
    from perceptree.models import PAPER_PRESETS

    return spec.backbone in {preset["backbone"] for preset in PAPER_PRESETS.values()}
