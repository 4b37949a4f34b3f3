"""A map of the stems in a source whose frames have poses, for commands that follow none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from basetree.errors import InputError
from edgetree.frames.pipeline import FrameResult
from edgetree.live.results import followed
from edgetree.live.tracking.tracker import StemTracker
from edgetree.sinks.maps import open_map
from edgetree.sinks.sink import FileSink

_MOST_WITHOUT_POSE_S: Final = 2.0  # at the beginning of a recording


class PosedMapSink(FileSink[FrameResult]):
    """Follows the stems through frames with poses, and writes a map of them when it is closed.

    Frames before the first pose are left out.

    Args:
        path: The file to write, .geojson or .gpkg.

    Raises:
        InputError: The file cannot be written; when results are written or the sink is closed, if
            there are no poses.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._map = self._files.enter_context(open_map(path))
        self._files.enter_context(self._with_poses())
        self._tracker = StemTracker()
        self._first: FrameResult | None = None
        self._has_poses = False

    @contextmanager
    def _with_poses(self) -> Iterator[None]:
        yield
        self._check_poses()

    def write(self, result: FrameResult) -> None:
        """Take the result of one frame."""
        self._first = self._first or result
        self._has_poses = self._has_poses or result.frame.pose is not None
        if self._has_poses:
            self._map.write(followed(result, self._tracker))
        elif result.frame.stamp_s - self._first.frame.stamp_s > _MOST_WITHOUT_POSE_S:
            self._check_poses()

    def _check_poses(self) -> None:
        if self._first is not None and not self._has_poses:
            raise InputError(
                f"frame {self._first.frame.name} and those after it have no pose: expected a source"
                " with poses for a map; `edgetree live` follows stems without them"
            )
