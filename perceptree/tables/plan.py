"""Definition of a table: models, seeds, rows and tested claims."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from basetree.errors import SettingsError
from perceptree.models import PAPER_PRESETS, ModelSpec, load_checkpoint, make_spec
from perceptree.models.spec import Modality
from perceptree.tables.paper import (
    BOTH,
    KEYPOINT_ONLY,
    MASK_ONLY,
    MEASURES,
    TABLE_2,
    TABLE_3,
    PaperRow,
)
from perceptree.training import PAPER_FREEZING, Init, TrainSettings, recipe_settings

TABLES = (2, 3)
_MODALITIES: tuple[Modality, ...] = ("rgb", "depth")
_DEPTH_AND_RGB: tuple[Modality, ...] = ("depth", "rgb")

_DEFAULT_MODELS = {2: ("r50", "r101", "x101-32x8d"), 3: ("edge-n",)}
_TASKS = {MASK_ONLY: "masks", BOTH: "both", KEYPOINT_ONLY: "keypoints"}
_PUBLISHED = ("imagenet", "coco")
# Evaluate at the end only, when the learning rate has decayed.
_NEVER = 10**9


@dataclass(frozen=True)
class TableModel:
    """A model of a table.

    Attributes:
        preset: Model preset.
        modality: "rgb" or "depth".
        tasks: Which branches it has, in the paper's words.
    """

    preset: str
    modality: Modality
    tasks: str

    @property
    def name(self) -> str:
        """Prefix of its runs' folder names, before the seed."""
        return f"{self.preset}-{self.modality}-{_TASKS[self.tasks]}"


@dataclass(frozen=True)
class Row:
    """One of our models, and the corresponding row of the paper, if any."""

    model: TableModel
    paper: PaperRow | None


@dataclass(frozen=True)
class Claim:
    """The claim that a measure of one model is higher or lower than that of another.

    Attributes:
        text: The claim in words.
        measure: Field of `perceptree.evaluation.Metrics`.
        model: The first model.
        other: The model it is compared with.
        rises: Whether the claim is that `model` is higher.
        paper_difference: Difference in the paper, if it gives both numbers.
    """

    text: str
    measure: str
    model: TableModel
    other: TableModel
    rises: bool
    paper_difference: float | None


@dataclass(frozen=True)
class TableSettings:
    """Settings of a table.

    Attributes:
        table: 2 or 3.
        models: Model presets; empty for the table's defaults.
        modality: Modality of table 3's ablation; the model with both tasks is also trained for the
            other modality.
        seeds: Seeds; each run is made once for each.
        steps: Steps of a run.
        minutes: Minutes of a run, instead of steps.
        recipe: Training recipe; None for the model's default.
        init: Starting weights: "imagenet", "coco" or a checkpoint file, in whose name {model} and
            {modality} are replaced; None for random weights.
        height: Input height in px; None for the model's default.
        width: Input width in px; None for the model's default.
        batch: Frames per step; None for the recipe's default.

    Raises:
        SettingsError: If a value is invalid.
    """

    table: int
    models: tuple[str, ...] = ()
    modality: Modality = "depth"
    seeds: tuple[int, ...] = (0, 1)
    steps: int | None = None
    minutes: float | None = None
    recipe: str | None = None
    init: str | None = None
    height: int | None = None
    width: int | None = None
    batch: int | None = None

    def __post_init__(self) -> None:
        if self.table not in TABLES:
            raise SettingsError(f"table is {self.table}: expected one of 2, 3")
        if self.modality not in _MODALITIES:
            raise SettingsError(f"modality is {self.modality!r}: expected rgb or depth")
        if not self.models:
            object.__setattr__(self, "models", _DEFAULT_MODELS[self.table])
        for name in ("models", "seeds"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                raise SettingsError(
                    f"{name} are {values}: expected at least one, without repetitions"
                )
        if self.table == 3 and len(self.models) > 1:
            raise SettingsError(f"models are {self.models}: expected one for table 3")
        for row, seed in itertools.product(self.rows(), self.seeds):
            self.training(row.model, seed)  # raises SettingsError for values out of range

    def rows(self) -> list[Row]:
        """Return the rows in the paper's order; table 3 ends with the other modality."""
        if self.table == 2:
            return [
                Row(TableModel(preset, modality, BOTH), TABLE_2.get((preset, modality)))
                for preset in self.models
                for modality in _MODALITIES
            ]
        ablation = [
            Row(TableModel(self.models[0], self.modality, tasks), paper)
            for tasks, paper in TABLE_3.items()
        ]
        other: Modality = "rgb" if self.modality == "depth" else "depth"
        paper = TABLE_3[BOTH] if other == "rgb" else TABLE_2["x101-32x8d", "depth"]
        return [*ablation, Row(TableModel(self.models[0], other, BOTH), paper)]

    def claims(self) -> list[Claim]:
        """Return the paper's claims; table 3 also tests that depth is better than RGB."""
        modality_claims = [
            _depth_claim(preset, preset if self.table == 2 else "x101-32x8d")
            for preset in self.models
        ]
        if self.table == 2:
            return modality_claims
        mask_only, both, keypoint_only = (row.model for row in self.rows()[:3])
        branch_claims = [
            _branch_claim("the mask branch raises", "box_ap", both, keypoint_only, True),
            _branch_claim("the mask branch raises", "keypoint_ap", both, keypoint_only, True),
            _branch_claim("the keypoint branch lowers", "box_ap", both, mask_only, False),
            _branch_claim("the keypoint branch lowers", "mask_ap", both, mask_only, False),
        ]
        return branch_claims + modality_claims

    def start(self, model: TableModel) -> Init | None:
        """Return a model's starting weights.

        Raises:
            SettingsError: If the checkpoint file does not exist.
        """
        if self.init is None or self.init in _PUBLISHED:
            return self.init  # type: ignore[return-value]
        name = self.init.replace("{model}", model.preset).replace("{modality}", model.modality)
        if not Path(name).is_file():
            raise SettingsError(
                f"init is {name!r}: expected imagenet, coco or a checkpoint file, in whose name"
                " {model} and {modality} are replaced"
            )
        return Path(name)

    def spec(self, model: TableModel) -> ModelSpec:
        """Return the spec of a model: its preset, or that of its starting checkpoint.

        Raises:
            SettingsError: If the checkpoint has another backbone or modality.
        """
        changes: dict[str, Any] = {
            "masks": model.tasks != KEYPOINT_ONLY,
            "keypoints": model.tasks != MASK_ONLY,
        }
        named = make_spec(model.preset, model.modality, self.height, self.width, **changes)
        start = self.start(model)
        if isinstance(start, Path):
            own = load_checkpoint(start)[0].spec
            changes |= {
                "height": own.height if self.height is None else self.height,
                "width": own.width if self.width is None else self.width,
            }
            if (own.backbone, own.modality) != (named.backbone, named.modality):
                raise SettingsError(
                    f"{start}: holds {own.backbone} for {own.modality}, expected"
                    f" {named.backbone} for {named.modality}"
                )
            return dataclasses.replace(own, **changes)
        # Published weights were trained with the stride in the 3x3 convolutions.
        return dataclasses.replace(named, stride_in_1x1=False) if start else named

    def recipe_of(self, model: TableModel) -> str:
        """Return the name of a model's training recipe."""
        return self.recipe or ("paper" if model.preset in PAPER_PRESETS else "scratch")

    def training(self, model: TableModel, seed: int) -> TrainSettings:
        """Return the training settings of a run; the learning rate decays along a cosine."""
        changes: dict[str, Any] = {
            "steps": self.steps,
            "minutes": self.minutes,
            "seed": seed,
            "schedule": "cosine",
            "rate_steps": (),
            "evaluate_every_steps": _NEVER,
        }
        if self.batch is not None:
            changes["batch"] = self.batch
        if model.preset in PAPER_PRESETS and self.init is not None:
            changes |= PAPER_FREEZING
        return recipe_settings(self.recipe_of(model), **changes)


def _branch_claim(
    text: str, measure: str, model: TableModel, other: TableModel, rises: bool
) -> Claim:
    of_paper = TABLE_3[model.tasks].scores[measure] - TABLE_3[other.tasks].scores[measure]
    return Claim(f"{text} {MEASURES[measure]}", measure, model, other, rises, of_paper)


def _depth_claim(preset: str, paper_preset: str) -> Claim:
    depth, rgb = (TABLE_2.get((paper_preset, modality)) for modality in _DEPTH_AND_RGB)
    of_paper = depth.scores["box_ap"] - rgb.scores["box_ap"] if depth and rgb else None
    compared = f" (the paper: {depth.backbone}, table 2)" if depth else ""
    model, other = (TableModel(preset, modality, BOTH) for modality in _DEPTH_AND_RGB)
    text = f"{preset}: depth has a higher {MEASURES['box_ap']} than RGB{compared}"
    return Claim(text, "box_ap", model, other, True, of_paper)
