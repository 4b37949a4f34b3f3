"""How far a training is: steps, time, running losses and the best metrics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from perceptree.evaluation import Metrics
from perceptree.settings.training import TrainSettings

_SECONDS_PER_MINUTE = 60.0
# Weight of the newest loss in the running means.
_LOSS_MEAN_RATE = 0.02


@dataclass(frozen=True)
class Status:
    """Progress of a training.

    Attributes:
        done: Completed fraction, 0 to 1.
        step: Number of completed steps.
        losses: Running mean of each loss.
        elapsed_s: Training time, s.
        waiting_share: Fraction of the training time spent waiting for data.
        frames_per_s: Frames per second.
        rate: Learning rate.
        box_ap: Latest box AP on val; None before the first evaluation.
    """

    done: float
    step: int
    losses: dict[str, float]
    elapsed_s: float
    waiting_share: float
    frames_per_s: float
    rate: float
    box_ap: float | None


Progress = Callable[[Status], None]


@dataclass
class Counts:
    """How far a training is.

    Attributes:
        step: Number of completed steps, those of the run it branched from included.
        first_step: The step that this run started at.
        elapsed_s: Training time, s.
        waited_s: Time spent waiting for data, s.
        means: Running mean of each loss.
        best: Metrics of the best weights so far.
        stale: Number of evaluations since the best one.
        evaluated_at: Step of the last evaluation, -1 before the first.
        latest_ap: Box AP of the last evaluation in this process; None before the first.
    """

    step: int = 0
    first_step: int = 0
    elapsed_s: float = 0.0
    waited_s: float = 0.0
    means: dict[str, float] = field(default_factory=dict)
    best: Metrics | None = None
    stale: int = 0
    evaluated_at: int = -1
    latest_ap: float | None = None

    @classmethod
    def of_state(cls, state: Mapping[str, Any]) -> Counts:
        """The counts of a state, as `to_state` gives them."""
        known = {name: state[name] for name in cls().to_state()}
        best = known.pop("best")
        return cls(**known, best=None if best is None else Metrics(**best))

    def to_state(self) -> dict[str, Any]:
        """What a state holds of the counts."""
        values = asdict(self)
        del values["latest_ap"]
        return values

    def done(self, settings: TrainSettings) -> float:
        """Completed fraction of the training, 0 to 1."""
        if settings.patience is not None and self.stale >= settings.patience:
            return 1.0
        if settings.minutes is not None:
            return min(1.0, self.elapsed_s / (settings.minutes * _SECONDS_PER_MINUTE))
        return min(1.0, (self.step - self.first_step) / (settings.steps or 1))

    def status(self, settings: TrainSettings, rate: float) -> Status:
        """The status after a step with a learning rate."""
        steps, elapsed_s = self.step - self.first_step, max(self.elapsed_s, 1e-9)
        return Status(
            self.done(settings),
            self.step,
            dict(self.means),
            self.elapsed_s,
            self.waited_s / elapsed_s,
            steps * settings.batch / elapsed_s,
            rate,
            self.latest_ap,
        )

    def add_losses(self, losses: Mapping[str, float]) -> None:
        """Take the losses of a step, already counted, into the running means."""
        taken = self.step - self.first_step
        for name, value in losses.items():
            known = self.means.get(name, value)
            self.means[name] = known + (value - known) * max(_LOSS_MEAN_RATE, 1 / taken)

    def add_metrics(self, metrics: Metrics) -> bool:
        """Take the metrics of an evaluation; returns whether none before were better."""
        self.latest_ap, self.evaluated_at = metrics.box_ap, self.step
        risen = self.best is None or metrics.box_ap > self.best.box_ap
        self.stale = 0 if risen else self.stale + 1
        equal_or_better = self.best is None or metrics.box_ap >= self.best.box_ap
        if equal_or_better:
            self.best = metrics
        return equal_or_better

    def forget_best(self) -> None:
        """Take the next weights that are evaluated as the best; at the end there is one more."""
        self.best, self.evaluated_at = None, -1
