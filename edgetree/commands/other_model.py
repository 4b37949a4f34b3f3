"""The model for the other kind of image, tried where the chosen one finds little."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from basetree.counts import counted
from basetree.errors import EdgetreeError
from edgetree.catalogue import suited_model
from edgetree.measure import Estimate

if TYPE_CHECKING:
    from edgetree.commands.option_groups import SessionOptions
    from edgetree.frames.pipeline import FrameResult
    from edgetree.runtime.detector import TreeDetector

_MOST_TRIALS: Final = 5


class OtherModel:
    """Tries the packaged model for colour in place of one for depth, or the other way round.

    It is tried on the first frames that have both kinds of image and in which the model in use
    measures nothing, finds nothing, or sees a picture unlike those of its training.

    Args:
        used: The model in use.
        session: The options about running models.
    """

    def __init__(self, used: TreeDetector, session: SessionOptions) -> None:
        self._used, self._session = used, session
        self._name = suited_model(with_depth=not used.manifest.takes_depth)
        self._opened: tuple[TreeDetector, Path] | None = None
        self._trials = self._better = 0
        self._first = self._fault = ""

    def opened(self) -> tuple[TreeDetector, Path]:
        """The model and its file.

        Raises:
            EdgetreeError: It cannot be opened.
        """
        if self._opened is None:
            self._opened = self._session.open_model(self._name, self._used.score_threshold)
        return self._opened

    def look(
        self, result: FrameResult, process: Callable[[TreeDetector], FrameResult]
    ) -> FrameResult | None:
        """Try it on a frame, if that is called for.

        Args:
            result: What the model in use found.
            process: Detects and measures the same frame with another model.

        Returns:
            The result of the other model if it found more, else None.
        """
        if self._trials >= _MOST_TRIALS or not self._is_called_for(result):
            return None
        self._trials += 1
        try:
            theirs = process(self.opened()[0])
        except EdgetreeError as error:  # no reason to end: the user did not ask for it
            self._fault = str(error)
            self._trials = _MOST_TRIALS
            return None
        mine_found, found = _found(result), _found(theirs)
        if found <= mine_found:
            return None
        self._better += 1
        what = "tree" if result.measurements is None else "diameter"
        used = Path(self._used.session.name).stem
        self._first = self._first or (
            f"{self._name} {_verb(what)} {counted(found, what)}, {used} {mine_found}"
        )
        return theirs

    def line(self, *, is_taken: bool) -> str | None:
        """What the trial of a command's only frame says; None if no more was found.

        Args:
            is_taken: Whether its result is taken.
        """
        if not self._better:
            return next(self.lines(), None)
        if is_taken:
            used = Path(self._used.session.name).stem
            return f"measured with {self._name}: {self._first}; --model {used} takes that one"
        return f"{self._first}: give --model {self._name}"

    def lines(self) -> Iterator[str]:
        """What the trials say, with the option to give, or why there were none."""
        if self._better:
            times = f"{self._better} of {counted(self._trials, 'frame')} tried"
            yield f"--model {self._name} is better in {times}, in the first: {self._first}"
        if self._fault:
            yield f"--model {self._name} was not tried, although it may find more: {self._fault}"

    def _is_called_for(self, result: FrameResult) -> bool:
        frame = result.frame
        manifest = self._used.manifest
        if manifest.takes_both:
            return False
        takes_depth = manifest.takes_depth
        if frame.depth_fault is not None or (frame.image if takes_depth else frame.depth_m) is None:
            return False
        return result.trees.unlike is not None or not _found(result)


def better_result(
    result: FrameResult,
    opened: tuple[TreeDetector, Path],
    session: SessionOptions,
    process: Callable[[TreeDetector], FrameResult],
    *,
    may_replace: bool,
) -> tuple[FrameResult, tuple[TreeDetector, Path], str | None]:
    """The result of a command's only frame, of the other model where that finds more.

    Args:
        result: What the model in use found.
        opened: That model and its file.
        session: The options about running models.
        process: Detects and measures the frame with a model.
        may_replace: Whether the result of the other model is taken if it is better.

    Returns:
        The result, the model that it is from with its file, and what to tell; None if nothing.
    """
    other = OtherModel(opened[0], session)
    theirs = other.look(result, process)
    line = other.line(is_taken=may_replace)
    if theirs is None or not may_replace:
        return result, opened, line
    return theirs, other.opened(), line


def _found(result: FrameResult) -> int:
    """Number of measured diameters; of trees where nothing is measured."""
    if result.measurements is None:
        return len(result.trees)
    return sum(isinstance(tree.diameter_m, Estimate) for tree in result.measurements)


def _verb(what: str) -> str:
    return "finds" if what == "tree" else "measures"
