"""Detect and measure the trees in a block of frames; the result is one part."""

from __future__ import annotations

import hashlib
import io
import json
import logging
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from basetree.errors import InputError
from basetree.files.regular import read_regular
from basetree.jobs import Job, JobError, Store, StoreError
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FrameResult, process
from edgetree.frames.rig import Rig
from edgetree.live.results import numbered_stems
from edgetree.live.tracking.picture_tracker import PictureTracker
from edgetree.measure import StemViews
from edgetree.results.csv_table import PROFILES, TREES
from edgetree.results.json_records import frame_record
from edgetree.shards.inputs import FramesOfUnit, list_frames
from edgetree.sources.source import INCOMPLETE

if TYPE_CHECKING:
    from edgetree.measure import MeasureSettings
    from edgetree.runtime.detector import TreeDetector

KIND: Final = "edgetree.run"
BLOCK_FRAMES: Final = 32
_SIGNATURE: Final = ".sig"


@dataclass(frozen=True)
class FrameWork:
    """What a worker needs to detect and measure; sent to the machines that work.

    Attributes:
        source: Folder or URL of images or recordings, or one recording, as this machine sees it.
        depth: Folder or URL of the depth images; None if there are none.
        shown: Source and depth as the user typed them, by what they are here; for results.
        files_sha256: Digest of the names of the files.
        model: The model file.
        model_files: Content of the model file and of its signature, by name.
        rig: The cameras.
        settings: Settings of the measurement; the defaults if None.
        session: Options of `TreeDetector.load`.
    """

    source: Path
    depth: Path | None
    shown: Mapping[str, str]
    files_sha256: str
    model: Path
    model_files: Mapping[str, bytes]
    rig: Rig
    settings: MeasureSettings | None
    session: Mapping[str, Any]

    def __call__(self) -> Callable[[int], bytes]:
        """List the files and open the model; returns what does a unit.

        Raises:
            JobError: This machine does not see the same files.
            EdgetreeError: The model cannot be opened.
        """
        from edgetree.runtime.detector import TreeDetector

        with tempfile.TemporaryDirectory() as folder:
            detector = TreeDetector.load(self._model_here(Path(folder)), **self.session)
        with _without_warnings():  # the command that started this has told them
            files = list_frames(self.source, self.depth, takes_depth=detector.manifest.takes_depth)
        if files.digest != self.files_sha256:
            raise JobError(
                f"source {files.source.where}: a worker sees other files than the command that"
                " started it; expected a folder that all machines share, or a URL, that does not"
                " change meanwhile"
            )
        block = 1 if files.are_recordings else BLOCK_FRAMES

        def work(unit: int) -> bytes:
            with ExitStack() as stack:
                try:
                    opened = stack.enter_context(files.frames(unit * block, block, self.rig))
                except InputError as error:
                    if not files.are_recordings or isinstance(error, StoreError):
                        raise
                    # As of a frame that cannot be read: the other recordings are still wanted.
                    part = _part_of([], "", "", [_one_line(error)])
                else:
                    part = self._part(opened, detector, follows=files.are_recordings)
            return json.dumps(part, allow_nan=False).encode()

        return work

    def _model_here(self, folder: Path) -> Path:
        """The model file, or a copy of it where this machine has another file or none."""
        try:
            if self.model.read_bytes() == self.model_files[self.model.name]:
                return self.model
        except OSError:
            pass
        from basetree.jobs import LocalStore

        for name, content in self.model_files.items():
            LocalStore(folder).write(name, content)
        return folder / self.model.name

    def _part(
        self, opened: FramesOfUnit, detector: TreeDetector, *, follows: bool
    ) -> dict[str, Any]:
        """The results of a unit: records, rows of the tables, and what was left out.

        Args:
            opened: The frames.
            detector: The model.
            follows: Whether the frames are those of one recording, whose stems are numbered.
        """
        table, profiles = io.StringIO(newline=""), io.StringIO(newline="")
        records, left_out = [], []
        shown = {here: _as_shown(where, self.shown) for here, where in opened.folders.items()}
        stems, views = (PictureTracker(), StemViews()) if follows else (None, None)
        for outcome in self._outcomes(opened.frames, detector, views):
            if isinstance(outcome, FrameResult):
                outcome = outcome if stems is None else numbered_stems(outcome, stems)
                record = frame_record(outcome)
                records.append({**record, "path": _as_shown(record["path"], shown)})
                TREES.write_rows(table, outcome)
                PROFILES.write_rows(profiles, outcome)
            else:
                left_out.append(_as_shown(_one_line(outcome), shown))
        counts, where = opened.source.counts, _as_shown(opened.source.name, shown)
        left_out += [f"{where}: {counts[name]} {name}" for name in INCOMPLETE if counts.get(name)]
        return _part_of(records, table.getvalue(), profiles.getvalue(), left_out)

    def _outcomes(
        self, frames: Iterator[Frame], detector: TreeDetector, views: StemViews | None
    ) -> Iterator[FrameResult | Exception]:
        """The result of each frame, or why it cannot be read or measured."""
        while True:
            try:
                yield process(next(frames), detector, self.rig, self.settings, views)
            except StopIteration:
                return
            except InputError as error:
                yield error


def _part_of(
    records: list[dict[str, Any]], csv: str, profiles: str, left_out: list[str]
) -> dict[str, Any]:
    return {
        "schema": "edgetree.part/1",
        "frames": records,
        "csv": csv,
        "profiles": profiles,
        "left_out": left_out,
    }


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


@contextmanager
def _without_warnings() -> Iterator[None]:
    log = logging.getLogger("edgetree.sources")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def _as_shown(text: str, shown: Mapping[str, str]) -> str:
    """A text with the places that the user typed instead of those on this machine."""
    for here, place in shown.items():
        text = text.replace(here, place)
    return text


def frames_job(
    work: FrameWork, store: Store, files: int, block: int, identity: Mapping[str, Any]
) -> Job:
    """The job of doing all units.

    Args:
        work: What a worker needs.
        store: Where the parts are kept.
        files: Number of images or recordings.
        block: Files of a unit.
        identity: The options that decide on the results.
    """
    model_sha256 = hashlib.sha256(work.model_files[work.model.name]).hexdigest()
    whole = {**identity, "files_sha256": work.files_sha256, "model_sha256": model_sha256}
    return Job(store, KIND, whole, files, block)


def model_files(model: Path) -> dict[str, bytes]:
    """Content of a model file and of its signature if it has one, by name.

    Raises:
        OSError: The model cannot be read.
    """
    signature = Path(f"{model}{_SIGNATURE}")
    paths = [model, *([signature] if signature.is_file() else [])]
    return {path.name: read_regular(path) for path in paths}
