"""The run of `edgetree live`: its source, its outputs, and what is said of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, TypeAlias

from basetree.errors import EdgetreeError, InputError
from basetree.program.console import note
from basetree.program.interrupts import interrupt_afterwards
from edgetree.commands.frame_results import different_words
from edgetree.commands.guarded_outputs import GuardedOutputs
from edgetree.commands.live_options import LiveSourceOptions
from edgetree.commands.live_outputs import LiveOutputs
from edgetree.frames.rig import Rig
from edgetree.live.health import ServiceHealth, StateReporter
from edgetree.live.pipeline import LivePipeline
from edgetree.measure.estimates import Failure
from edgetree.results.csv_style import CsvStyle
from edgetree.sources.source import FrameSource

if TYPE_CHECKING:
    from calib.stereo import StereoPair
    from edgetree.live.page import PageServer
    from edgetree.live.recording import FrameRecorder
    from edgetree.live.results import LiveResult
    from edgetree.serve import Service
    from edgetree.sinks import MqttSettings

_STATUS_EVERY_S: Final = 5.0

_Write: TypeAlias = "Callable[[LiveResult], object]"


@dataclass
class LiveSource:
    """Opens the source; called again after it was lost.

    Attributes:
        is_live: Whether it is a camera, or stands for programs. Known once it is open.
    """

    text: str
    options: LiveSourceOptions
    rig: Rig
    takes_depth: bool
    service: Service | None
    recorder: FrameRecorder | None
    pair: StereoPair | None = None
    is_live: bool = False

    def __call__(self) -> FrameSource:
        """Open it."""
        opened = self.options.open(self.text, self.rig, self.takes_depth, self.service, self.pair)
        self.is_live = opened.is_live
        if self.recorder is not None:
            self.recorder.wait_for_disk(waits=not self.is_live)
        return opened


@dataclass
class LiveRun:
    """Hands each result of the pipeline to all outputs.

    The files are opened with the first result, so that a source without any replaces no file.

    Attributes:
        pipeline: Gives the results.
        source: Opens the source of the pipeline.
        guarded: The outputs.
        outputs: The options for them.
        to_stdout: Whether JSON lines go to stdout.
        shown: The source as it is shown.
        model: Name of the model file.
        style: How the table is written.
        recorder: Records the input.
        service: Sends the results to programs.
        page: Shows the results.
    """

    pipeline: LivePipeline
    source: LiveSource
    guarded: GuardedOutputs
    outputs: LiveOutputs
    to_stdout: bool
    shown: str
    model: str
    style: CsvStyle
    recorder: FrameRecorder | None
    service: Service | None
    page: PageServer | None
    _writes: list[_Write] = field(default_factory=list)

    def follow(self, health: ServiceHealth, mqtt: MqttSettings) -> None:
        """Run it to its end, with the state told to all outputs.

        Args:
            health: Says how it goes.
            mqtt: How messages go to the broker.

        Raises:
            InputError: The source gives no result.
            EdgetreeError: The source or an output cannot be used any more.
            KeyboardInterrupt: After the outputs are complete.
        """
        try:
            with closing(self.guarded):
                self.outputs.open_controllers(self.guarded, mqtt)
                with StateReporter(health, self.guarded.tell):
                    self._write_all()
        except KeyboardInterrupt:
            for line in self.guarded.missing():
                note(line)
            raise
        except (InputError, OSError) as error:
            if not self._writes or isinstance(error, BrokenPipeError):
                raise
            # A set-up that gave results is not wrong: the exit code lets a supervisor start again.
            raise EdgetreeError(str(error)) from error

    def tell_end(self) -> None:
        """Say how it went."""
        note(self.pipeline.status.line())
        if self.pipeline.in_picture is not None and self.pipeline.in_picture.frames > 1:
            found = self.pipeline.in_picture.different()
            note(
                f"trees not counted: {found.reason}"
                if isinstance(found, Failure)
                else different_words(found)
            )

    def tell_files(self) -> None:
        """Say where the results are; files are opened with the first one."""
        if not self._writes:
            return
        for option, path in self.outputs.paths.items():
            if path.exists():
                note(f"{'table' if option == '--csv' else option.removeprefix('--')}: {path}")

    def _write_all(self) -> None:
        """Hand on the results, and say every few seconds how it goes."""
        said_s, number = time.monotonic(), 0
        with closing(iter(self.pipeline)) as results:
            for number, result in enumerate(results, 1):
                with interrupt_afterwards():
                    self._writes = self._writes or self._open_files()
                    for write in self._writes:
                        write(result)
                    if time.monotonic() - said_s > _STATUS_EVERY_S:
                        note(self._status())
                        said_s = time.monotonic()
                if number == self.outputs.frames:
                    return
        if number == 0:
            status = self.pipeline.status.line()
            raise InputError(f"{status}: expected a frame that can be used")

    def _open_files(self) -> list[_Write]:
        """Open the files; returns what takes the results."""
        self.outputs.open_files(
            self.guarded,
            self.shown,
            self.model,
            self.style,
            to_stdout=self.to_stdout,
            states=self.source.is_live,
        )
        writes: list[_Write] = [self.guarded.write]
        writes += [] if self.recorder is None else [self.recorder.write]
        writes += [] if self.service is None else [self.service.write]
        writes += [] if self.page is None else [self.page.publish]
        return writes

    def _status(self) -> str:
        parts = [self.pipeline.status.line()]
        parts += [] if self.recorder is None else [self.recorder.status.line()]
        if self.page is not None and self.pipeline.status.age_ms > 1000 * self.page.stale_s:
            parts.append(
                "the page is blank, as results come later than --blank-after"
                f" {self.page.stale_s:g} allows"
            )
        return ", ".join([*parts, *self.guarded.missing()])
