"""The report of `edgetree run` and `measure`: pictures, all trees and diameter classes."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from html import escape
from importlib import resources
from pathlib import Path
from statistics import median
from typing import Final

import cv2

from basetree.counts import counted
from basetree.files.writing import text_file
from basetree.page import parts
from edgetree.drawing.primitives import Picture
from edgetree.frames.followed import are_followed
from edgetree.frames.pipeline import FrameResult
from edgetree.measure import Estimate
from edgetree.report.totals import StandTotals
from edgetree.report.tree_table import Reasons, class_chart, tree_row, tree_table
from edgetree.report.units import length_attributes, unit_buttons
from edgetree.results.csv_table import measurements_of
from edgetree.results.pictures import draw_frame
from edgetree.results.units import AMOUNTS

_MAX_SIDE_PX: Final = 1280
_MAX_BYTES: Final = 180_000  # 240 kB as text in the page: 24 MB for 100 frames
_QUALITIES: Final = (82, 70, 58, 46)


@dataclass(frozen=True)
class ReportHead:
    """What a report says about itself.

    Attributes:
        title: Its heading; "Trees in" and the source if None.
        place: Where the trees stand; None if it is not told.
        area_ha: Area that the trees stand on, in hectares, for the basal area; None without it.
    """

    title: str | None = None
    place: str | None = None
    area_ha: float | None = None


@contextmanager
def report_file(
    path: Path,
    source: str,
    trees_from: str,
    left_out: Sequence[str] = (),
    *,
    whole: bool = True,
    head: ReportHead = ReportHead(),
) -> Iterator[Callable[[FrameResult], None]]:
    """Write a report at the end of the block; yields a function that adds a frame to it.

    The pictures go to a temporary file as they come, so memory holds only the rows of the tables.
    If the block raises, nothing is written.

    Args:
        path: The HTML file to write.
        source: What was measured, for the heading.
        trees_from: The model or the mask image that the trees come from, likewise.
        left_out: Why frames were left out, a line for each frame, of which equal ones are shown
            once; read at the end of the block.
        whole: Whether all frames of the source are added or left out; if not, the page counts
            pictures and no frames.
        head: Title, place and area.

    Raises:
        InputError: The file cannot be written.
    """
    with (
        text_file(path) as page,
        tempfile.TemporaryFile(
            "w+", encoding="utf-8", errors="backslashreplace", dir=path.parent
        ) as figures,
    ):
        totals = _Totals(whole, head)

        def add(result: FrameResult) -> None:
            figures.write(totals.add(result))

        yield add
        figures.seek(0)
        page.write(parts.start(head.title or f"Trees in {source}", _asset("report.css")))
        page.write(totals.summary(source, trees_from, left_out))
        shutil.copyfileobj(figures, page)
        page.write(totals.tables())
        page.write(parts.end(_asset("report.js")))


def _asset(name: str) -> str:
    return resources.files("edgetree.report").joinpath(name).read_text("utf-8")


class _Totals:
    """What the report says about all frames."""

    def __init__(self, whole: bool, head: ReportHead) -> None:
        self._head = head
        self._trees, self._stems = StandTotals(head.area_ha), StandTotals(head.area_ha)
        self._whole = whole
        self._frames = 0
        self._rows: list[str] = []
        self._reasons = Reasons()
        self._tracks: set[int] = set()
        self._followed = 0

    @property
    def _counts_stems(self) -> bool:
        """Whether stems were followed, and not only a few of the trees, as in single frames."""
        return self._followed > 0 and are_followed(self._followed, len(self._rows))

    @property
    def _stand(self) -> StandTotals:
        return self._stems if self._counts_stems else self._trees

    def add(self, result: FrameResult) -> str:
        """Count a frame; returns its picture as HTML."""
        self._frames += 1
        anchor, name = f"frame-{self._frames}", result.frame.name
        measured = 0
        tracks = result.found.tracks
        for name_of_tree, track, score, tree, size in zip(
            result.found.names,
            [None] * len(result.trees) if tracks is None else tracks,
            result.trees.scores,
            measurements_of(result),
            result.pixel_sizes,
            strict=True,
        ):
            self._rows.append(tree_row(anchor, name, name_of_tree, float(score), tree, size))
            self._reasons.add(tree)
            self._trees.add(tree, len(self._rows))
            if track is not None:
                self._stems.add(tree, track)
                self._tracks.add(track)
                self._followed += 1
            measured += isinstance(tree.diameter_m, Estimate)
        words = f"{counted(len(result.trees), 'tree')}, {measured} with a diameter"
        if result.frame.depth_fault is not None:
            words += f"; {result.frame.depth_fault}"
        if result.trees.unlike is not None:
            words += f"; unlike the training pictures: {result.trees.unlike}"
        if result.trees.alone is not None:
            words += f"; {result.trees.alone}"
        caption = f"<b>{escape(name)}</b> {escape(words)}"
        return parts.figure(_embedded(draw_frame(result)), caption, f"{name}: {words}", anchor)

    def _counting(self) -> str:
        if self._counts_stems:
            return "each stem that was followed counts once, with the most certain of its values"
        if not self._whole:
            return "each stem counts once"
        return "a tree counts as often as it is in a picture"

    def summary(self, source: str, trees_from: str, left_out: Sequence[str]) -> str:
        """The page from its heading to the beginning of the pictures."""
        trees, diameters_m = len(self._rows), self._stand.values("diameter_m")
        shown = "frame" if self._whole else "picture"
        middle_html = "–"
        if diameters_m:
            value_m = median(diameters_m)
            text = AMOUNTS["diameter_m"].value(Estimate(value_m, 0.0))
            attributes = length_attributes("diameter_m", value_m)
            middle_html = f"<span {attributes}>{text} cm</span>"
        found = (str(trees), "tree found" if trees == 1 else "trees found")
        measured = (f"{len(diameters_m)} of {trees}", "trees with a measured diameter")
        if self._counts_stems:  # in a video, where the same trees are found again and again
            found = (f"about {len(self._tracks)}", f"different trees, found {trees} times")
            of_stems = f"{len(diameters_m)} of {len(self._tracks)}"
            measured = (of_stems, "different trees with a measured diameter")
        return (
            f"<h1>{escape(self._head.title or f'Trees in {source}')}</h1>"
            f'<p class="lead">{escape(self._lead(source, trees_from))}</p>{unit_buttons()}'
            + parts.tiles(
                [
                    (str(self._frames), f"{shown}{'' if self._frames == 1 else 's'}"),
                    found,
                    measured,
                    (middle_html, "median diameter at the felling cut"),
                ]
            )
            + self._stand.html(self._counting())
            + self._left_out(left_out)
            + self._classes()
            + self._reasons.html()
            + parts.heading(
                "Pictures",
                "Click a picture to enlarge it. A red dot is the felling cut, with its height"
                " above the ground; the white line is the diameter. Each label begins with the"
                " tree's number in the table, which in videos is that of the stem in all frames,"
                " after a #. A label with only the number means that nothing"
                " could be measured; an amber line that ends with ! has a warning. The table gives"
                " the reasons and warnings. Short white ticks at the edges of a stem mark the"
                " diameters of its profile, every 10 cm or in wider steps.",
            )
            + '<div class="grid wide">'
        )

    def _lead(self, source: str, trees_from: str) -> str:
        """Place, day, source and model, as sentences."""
        where = f"{self._head.place}, " if self._head.place else ""
        named = f" Pictures: {source}." if self._head.title else ""
        return f"{where}{date.today().isoformat()}.{named} Found by {trees_from}."

    def _classes(self) -> str:
        """The diameter classes."""
        charts = [
            chart
            for name, diameters_m in (
                ("Diameter at the cut", self._stand.values("diameter_m")),
                ("DBH (at breast height)", self._stand.values("dbh_m")),
            )
            if (chart := class_chart(name, diameters_m))
        ]
        if not charts:
            return ""
        return parts.heading("Diameter classes", "Trees in classes of 4 cm.") + parts.grid(charts)

    def tables(self) -> str:
        """The page from the end of the pictures to its end."""
        return (
            "</div>"
            + parts.heading(
                "All trees",
                "Click the head of a column to sort by it, and again for the opposite order. ± is"
                " one standard deviation; twice that holds the truth for 95 trees in 100. A"
                " profile in the remarks holds the diameters along the stem, its taper and the"
                " volume between the lowest and the highest of them.",
            )
            + tree_table(self._rows)
            + '<footer class="note">Made by edgetree. Apache License 2.0.</footer>'
        )

    def _left_out(self, reasons: Sequence[str]) -> str:
        """What is not in the report, with the reasons."""
        if not reasons:
            return ""
        count = f"{counted(len(reasons), 'frame')} left out" if self._whole else "Left out"
        lines = "".join(f"<li>{escape(reason)}</li>" for reason in dict.fromkeys(reasons))
        return parts.heading(count) + f"<ul>{lines}</ul>"


def _embedded(picture: Picture) -> parts.Jpeg:
    """A picture as JPEG of at most `_MAX_BYTES`.

    It is scaled down to `_MAX_SIDE_PX`. If it is still too large, first the quality is lowered,
    then the size.
    """
    scale = min(_MAX_SIDE_PX / max(picture.shape[:2]), 1.0)
    while True:
        size_px = [max(round(side * scale), 1) for side in picture.shape[1::-1]]
        shown = cv2.resize(picture, size_px, interpolation=cv2.INTER_AREA)
        for quality in _QUALITIES:
            jpeg = parts.jpeg_of(shown, quality)
            if len(jpeg.data) <= _MAX_BYTES:
                return jpeg
        scale *= 0.8
