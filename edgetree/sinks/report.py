"""Reports as HTML pages: of all frames, or of the stems that were followed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

import cv2
import numpy as np

from basetree.counts import counted
from basetree.files.growing import keep_older
from basetree.files.reading import decode_image
from edgetree.frames.pipeline import FoundTrees, FrameResult
from edgetree.measure import TreeMeasurement
from edgetree.measure.volume import volume_by_dbh
from edgetree.report import ReportHead, report_file
from edgetree.results.pictures import encode_picture, picture_of
from edgetree.sinks.sink import FileSink

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult
    from edgetree.live.tracking.tracks import TreeTrack
    from edgetree.measure.volume import Species

_MOST_PICTURES: Final = 200  # 25 to 50 MB in the page, and about as much in memory
# A view takes the place of another if its error is this much smaller: each is encoded as JPEG.
_CLEARLY_BETTER: Final = 0.8
_UNMEASURED_STD_M: Final = 1.0


class ReportSink(FileSink[FrameResult]):
    """Writes a page with the picture of each frame and all trees, when it is closed.

    Args:
        path: The HTML file to write.
        source: What was measured, for the heading.
        trees_from: The model or the mask image that the trees come from, likewise.
        left_out: Why frames were left out, a line for each frame; read when the sink is closed.
        head: Title, place and area.

    Raises:
        InputError: The file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        source: str,
        trees_from: str,
        left_out: Sequence[str] = (),
        head: ReportHead | None = None,
    ) -> None:
        super().__init__()
        report = report_file(path, source, trees_from, left_out, head=head or ReportHead())
        self._add = self._files.enter_context(report)

    def write(self, result: FrameResult) -> None:
        """Add a frame."""
        self._add(result)


@dataclass(frozen=True, eq=False)
class _View:
    """A result without the arrays of its frame, and the picture as JPEG.

    Attributes:
        serial: Its number among all views.
    """

    serial: int
    result: LiveResult
    jpeg: bytes


@dataclass(eq=False)
class _Stem:
    """A stem as it is known now, and the view that shows it best.

    Attributes:
        std_m: Error of the diameter by this view alone.
        tree: Its index among the trees of the view.
    """

    track: TreeTrack
    view: _View
    std_m: float
    tree: int


class StemReportSink(FileSink["LiveResult"]):
    """Writes a page with one entry for each confirmed stem, when it is closed.

    A stem has its number, the values that all views say together, and the picture of its best
    view. Memory and page hold the 200 newest pictures; older stems are left out and counted.

    Args:
        path: The HTML file to write.
        source: Where the frames come from, for the heading.
        model: Name of the model file, likewise.
        keeps_older: Whether a file at the path is kept, see `basetree.files.growing.keep_older`.

    Raises:
        InputError: The file cannot be written.
    """

    def __init__(self, path: Path, source: str, model: str, *, keeps_older: bool = False) -> None:
        super().__init__()
        self._stems: dict[int, _Stem] = {}
        self._forgotten: set[int] = set()
        self._serial = 0
        self._keeps_older = keeps_older
        self._files.enter_context(self._written(path, source, model))

    @contextmanager
    def _written(self, path: Path, source: str, model: str) -> Iterator[None]:
        words = f"the model {model}; each stem has what all views say, and its best picture"
        left_out: list[str] = []
        with report_file(path, source, words, left_out, whole=False) as add:
            yield
            self._keep_confirmed(frozenset())
            for view in self._views():
                add(_result(view, [each for each in self._stems.values() if each.view is view]))
            older = self._forgotten - self._stems.keys()
            if older:
                left_out.append(
                    f"{counted(len(older), 'older stem')}: this page has the"
                    f" {_MOST_PICTURES} newest"
                    " pictures, the map and the table of --map and --csv have all stems"
                )
            if self._keeps_older:
                keep_older(path)

    def write(self, result: LiveResult) -> None:
        """Take the stems of one result."""
        view: _View | None = None
        for track in result.tracks:
            for number in track.absorbed:
                self._stems.pop(number, None)
                self._forgotten.discard(number)
            known = self._stems.get(track.number)
            if known is not None:
                known.track = track
            if track.tree is None:
                continue
            std_m = _std_m(result, track.tree)
            if known is None or std_m < _CLEARLY_BETTER * known.std_m:
                view = view or self._view(result)
                self._stems[track.number] = _Stem(track, view, std_m, track.tree)
        self._keep_confirmed({track.number for track in result.tracks})
        views = self._views()
        for old in views[: max(len(views) - _MOST_PICTURES, 0)]:
            forgotten = [number for number, stem in self._stems.items() if stem.view is old]
            self._forgotten |= {*forgotten}
            for number in forgotten:
                del self._stems[number]

    def _keep_confirmed(self, followed: set[int] | frozenset[int]) -> None:
        """Forget the stems that are not followed any more and were never confirmed."""
        self._stems = {
            number: stem
            for number, stem in self._stems.items()
            if number in followed or stem.track.state == "confirmed"
        }

    def _views(self) -> list[_View]:
        """The views that are kept, the oldest first."""
        views = {id(stem.view): stem.view for stem in self._stems.values()}
        return sorted(views.values(), key=lambda view: view.serial)

    def _view(self, result: LiveResult) -> _View:
        self._serial += 1
        bare = replace(result.frame, image=None, depth_m=None, filled_depth_m=None, cloud_m=None)
        jpeg = encode_picture(picture_of(result), ".jpg")
        return _View(self._serial, replace(result, frame=bare, tracks=[]), jpeg)


def _std_m(result: LiveResult, tree: int) -> float:
    """Error of the diameter in this frame alone."""
    diameter = None if result.measurements is None else result.measurements[tree].diameter_m
    return diameter.std if diameter else _UNMEASURED_STD_M


def _result(view: _View, stems: list[_Stem]) -> FrameResult:
    """The view as the result of a frame that has these stems alone."""
    of_frame = view.result
    image = decode_image(view.jpeg, cv2.IMREAD_COLOR)
    assert image is not None
    measured = of_frame.measurements
    given = {each.name: getattr(of_frame, each.name) for each in fields(FrameResult)}
    given["frame"] = replace(of_frame.frame, image=np.asarray(image, np.uint8))
    given["found"] = FoundTrees(
        of_frame.trees.select(np.array([stem.tree for stem in stems], np.intp)),
        tuple(stem.track.number for stem in stems),
    )
    if measured is not None:
        given["measurements"] = [_fused(measured[stem.tree], stem.track) for stem in stems]
    return FrameResult(**given)


def _fused(tree: TreeMeasurement, track: TreeTrack) -> TreeMeasurement:
    """The measurement in one view with the values that all views say together.

    The volume of the whole stem follows from the diameter at breast height, so it is theirs too.
    """
    evidence = replace(tree.evidence, warnings=(*track.warnings, *tree.evidence.warnings))
    return replace(
        tree,
        diameter_m=track.diameter_m,
        dbh_m=track.dbh_m,
        cut_height_m=track.cut_height_m,
        inclination_deg=track.inclination_deg,
        volume_m3=volume_by_dbh(cast("Species | None", tree.species), track.dbh_m),
        evidence=evidence,
    )
