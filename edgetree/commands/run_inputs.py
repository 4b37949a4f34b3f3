"""The options of `edgetree run` that say what to detect in, and with what."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from basetree.program.quoting import quoted
from edgetree.commands.live_options import Scene, Topic, right_topic, topics_by_role
from edgetree.commands.options import INPUT, Camera, Cloud, Depth, ModelByInput, Right

if TYPE_CHECKING:
    from calib.stereo import StereoPair
    from edgetree.frames.rig import Rig
    from edgetree.runtime.detector import TreeDetector
    from edgetree.sources.source import FrameSource
    from edgetree.sources.source_list import SourceList

Source: TypeAlias = Annotated[
    list[Path],
    typer.Argument(
        metavar="SOURCE...",
        help="An image, a folder of images, a video, a point cloud (seen by virtual cameras all"
        " around), a ROS bag or MCAP file, a capture of a phone (.r3d, or the folder of Stray"
        " Scanner), or a simulated drive; or several of them, or patterns such as 'plot*/*.jpg';"
        " with --shards a folder or URL of images or of recordings.",
    ),
]
_Recursive: TypeAlias = Annotated[
    bool,
    typer.Option("--recursive", help="Take the pictures of the folders below each folder too."),
]
_StrictFrames: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--strict-frames",
        help="Stop at the first frame of a folder that cannot be read or measured, with exit code"
        " 2 and only the pictures so far. Otherwise such frames are left out, with exit code 1.",
    ),
]


@dataclass(frozen=True)
class RunInputs:
    """The options that say what to detect in, and with what."""

    panel = INPUT

    model: ModelByInput = None
    depth: Depth = None
    right: Right = None
    cloud: Cloud = None
    camera: Camera = None
    topic: Topic = None
    scene: Scene = None
    recursive: _Recursive = False
    strict_frames: _StrictFrames = False

    def open(
        self, sources: SourceList, rig: Rig, pair: StereoPair | None, detector: TreeDetector
    ) -> FrameSource:
        """Open the frames."""
        from edgetree.sources.opening import open_frames
        from edgetree.sources.several import open_several
        from edgetree.sources.stereo import open_stereo

        source = sources.one
        if source is not None and pair is not None and self.right is not None:
            return open_stereo(source, self.right, pair, rig=rig)

        def opened(path: Path) -> FrameSource:
            return open_frames(
                path,
                self.depth or self.cloud,
                rig=rig,
                detector=detector,
                topics=topics_by_role(self.topic),
                scene=self.scene,
                pair=pair,
            )

        if source is not None:
            return opened(source)
        takes_depth = detector.manifest.takes_depth
        depth = self.depth or self.cloud
        return open_several(sources, depth, rig=rig, open_one=opened, takes_depth=takes_depth)

    @property
    def right_given(self) -> str | None:
        """The option that names the right camera of a stereo pair, if one does."""
        return "--right" if self.right is not None else right_topic(self.topic)

    def sees_depth(self, sources: SourceList) -> bool:
        """Whether depth is given or comes with the sources, so that a model for depth suits."""
        if any(given is not None for given in (self.depth, self.right, self.cloud)):
            return True
        return sources.has_depth(topics_by_role(self.topic))

    def words(self) -> str:
        """The options about streams as they would be typed on the command line."""
        given = [("topic", name) for name in self.topic or ()]
        given += [] if self.right is None else [("right", str(self.right))]
        given += [] if self.cloud is None else [("cloud", str(self.cloud))]
        given += [] if self.scene is None else [("scene", str(self.scene))]
        words = "".join(f" --{name} {quoted(value)}" for name, value in given)
        return words + " --recursive" * self.recursive
