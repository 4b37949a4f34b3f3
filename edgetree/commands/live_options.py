"""The options of `edgetree live`, in groups."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import typer

from basetree.program.console import note
from edgetree.commands.option_groups import RigOptions
from edgetree.commands.options import (
    CAMERA,
    INPUT,
    MEASURING,
    Camera,
    Depth,
    DepthKind,
    DepthScale,
    GroundCover,
    Mounting,
    RigErrors,
    Right,
    Rotate,
    SpeciesName,
    StumpHeight,
    Up,
)
from edgetree.commands.reference_options import (
    CameraHeightText,
    GroundSlope,
    MarkerText,
    Pitch,
)

if TYPE_CHECKING:
    from calib.stereo import StereoPair
    from edgetree.frames.rig import Rig
    from edgetree.live.health import ServiceHealth
    from edgetree.live.page import PageServer
    from edgetree.live.recording import FrameRecorder
    from edgetree.live.tracking import StemTracker
    from edgetree.serve import Service
    from edgetree.sources.source import FrameSource

CLIENTS: Final = "clients"
"""The source that stands for programs that hand frames over."""


def names_no_path(source: str) -> bool:
    """Whether a source is a camera, or stands for programs."""
    from edgetree.sources.live import is_camera

    return source == CLIENTS or is_camera(source)


_TOPIC_ROLES: Final = ("colour", "depth", "right", "camera", "depth_camera", "imu")

Topic: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ROLE=NAME",
        help="Topic of a recording for a role: colour, depth (or point clouds), right (of a stereo"
        " pair, whose calibration is --camera), camera, depth_camera or imu.",
        show_default="found by their type, but for clouds",
    ),
]
Scene: TypeAlias = Annotated[
    int | None,
    typer.Option(metavar="N", help="Number of the drive, for a simulated dataset with several."),
]
_AsLive: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--as-live",
        help="Play a recording at its own pace and leave out frames that are not taken in time, as"
        " of a camera. Otherwise every frame is used, as fast as possible.",
    ),
]
_Loop: TypeAlias = Annotated[
    bool, typer.Option("--loop", help="Play a recording again and again, until Ctrl-C.")
]
_Page: TypeAlias = Annotated[
    bool, typer.Option("--page", help="Serve a page with picture, stems and plan for a browser.")
]
_Host: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="Address that the page listens on. Any other than this machine's own needs a token.",
    ),
]
_Port: TypeAlias = Annotated[int, typer.Option(help="Port of the page; 0 for any free one.")]
_Token: TypeAlias = Annotated[
    str | None,
    typer.Option(help="Token that the page asks for.", show_default="a random one if needed"),
]
_BlankAfter: TypeAlias = Annotated[
    float,
    typer.Option(
        metavar="SECONDS",
        min=0.1,
        max=60.0,
        help="Age from which the page blanks what it shows; more where a frame takes longer.",
    ),
]
_Serve: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Address where other programs of this machine hand frames over (source clients) and"
        " get the results: tcp://127.0.0.1:8430 or ipc:///run/FILE.",
    ),
]


_Odometry: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--odometry",
        help="In frames without a pose, find the camera's motion from the depth images too. Needs"
        " the package small_gicp.",
        rich_help_panel=MEASURING,
    ),
]


@dataclass(frozen=True)
class LiveSourceOptions:
    """The options about the source."""

    panel = INPUT

    depth: Depth = None
    right: Right = None
    topic: Topic = None
    scene: Scene = None
    as_live: _AsLive = False
    loop: _Loop = False

    @property
    def right_given(self) -> str | None:
        """The option that names the right camera of a stereo pair, if one does."""
        return "--right" if self.right is not None else right_topic(self.topic)

    def has_depth(self, source: str) -> bool:
        """Whether the frames of the source have depth, as those of programs may."""
        from edgetree.sources.depth_there import has_depth

        topics = topics_by_role(self.topic)
        return source == CLIENTS or has_depth(source, self.depth, self.right, topics=topics)

    def open(
        self,
        source: str,
        rig: Rig,
        takes_depth: bool,
        service: Service | None = None,
        pair: StereoPair | None = None,
    ) -> FrameSource:
        """Open the source for a model that takes depth, or colour; or that of a service."""
        from edgetree.sources.bags.names import is_bag
        from edgetree.sources.drive import is_drive
        from edgetree.sources.live import open_live_source
        from edgetree.sources.phones.opening import is_capture
        from edgetree.sources.playing import PacedSource

        if service is not None and source == CLIENTS:
            return service.open_source(rig)
        path = Path(source)
        are_files = path.exists() and not (is_bag(path) or is_drive(path) or is_capture(path))
        opened = open_live_source(
            source,
            depth=self.depth,
            right=self.right,
            rig=rig,
            topics=topics_by_role(self.topic),
            modality="depth" if are_files and takes_depth and self.depth is None else "both",
            scene=self.scene,
            loop=self.loop,
            pair=pair,
        )
        return PacedSource(opened) if self.as_live and not opened.is_live else opened

    def check(self, source: str, rig: Rig) -> None:
        """Raise InputError for an option that programs which hand frames over state themselves."""
        from edgetree.sources.opening import check_options

        if source != CLIENTS:
            return
        wrong = {
            "topics": bool(self.topic),
            "depth_scale_m": rig.depth_scale_m is not None,
            "depth_kind": rig.depth_kind != "depth",
            "depth": self.depth is not None,
            "right": self.right is not None,
            "loop": self.loop,
            "scene": self.scene is not None,
        }
        check_options(CLIENTS, wrong)


def topics_by_role(texts: list[str] | None) -> dict[str, str]:
    """The values of --topic by role.

    Raises:
        InputError: a value has another form, or the role is unknown.
    """
    from basetree.errors import InputError

    found: dict[str, str] = {}
    for text in texts or ():
        role, equals, name = text.partition("=")
        if not (equals and name and role in _TOPIC_ROLES):
            raise InputError(
                f"--topic is {text!r}: expected ROLE=NAME, where ROLE is"
                f" {', '.join(_TOPIC_ROLES[:-1])} or {_TOPIC_ROLES[-1]}"
            )
        found[role] = name
    return found


def right_topic(texts: list[str] | None) -> str | None:
    """The words for --topic if it names the right camera of a stereo pair."""
    return "--topic right" if "right" in topics_by_role(texts) else None


@dataclass(frozen=True)
class LiveRigOptions:
    """The options about the cameras."""

    panel = CAMERA

    camera: Camera = None
    up: Up = None
    mounting: Mounting = None
    depth_scale: DepthScale = None
    depth_kind: DepthKind = "depth"
    rotate: Rotate = None
    rig_errors: RigErrors = None
    pitch: Pitch = None

    def as_rig_options(self) -> RigOptions:
        """The same options as other commands have them."""
        return RigOptions(
            up=self.up,
            mounting=self.mounting,
            depth_scale=self.depth_scale,
            depth_kind=self.depth_kind,
            rotate=self.rotate,
            rig_errors=self.rig_errors,
            pitch=self.pitch,
        )


@dataclass(frozen=True)
class LiveMetresOptions(LiveRigOptions):
    """The options about cameras and metres."""

    stump_height: StumpHeight = None
    ground_cover: GroundCover = None
    species: SpeciesName = None
    camera_height: CameraHeightText = None
    ground_slope: GroundSlope = None
    marker: MarkerText = None
    odometry: _Odometry = False

    def tracker(self) -> StemTracker:
        """What follows the stems.

        Raises:
            MissingPackage: `odometry` is wanted and small_gicp is not installed.
        """
        from edgetree.live.tracking import DepthOdometry, StemTracker

        return StemTracker(odometry=DepthOdometry() if self.odometry else None)

    def as_rig_options(self) -> RigOptions:
        """The same options as other commands have them."""
        return replace(
            super().as_rig_options(),
            stump_height=self.stump_height,
            ground_cover=self.ground_cover,
            species=self.species,
            camera_height=self.camera_height,
            ground_slope=self.ground_slope,
            marker=self.marker,
        )


@dataclass(frozen=True)
class LivePageOptions:
    """The options of the page, and of the service for other programs."""

    panel = "Page"

    page: _Page = False
    host: _Host = "127.0.0.1"
    port: _Port = 8420
    token: _Token = None
    blank_after: _BlankAfter = 1.0
    serve: _Serve = None

    @contextmanager
    def listening(self, source: str) -> Iterator[Service | None]:
        """Listen for other programs during a block; yields None if it is not wanted.

        Raises:
            InputError: The address cannot be used.
            Unavailable: It is taken.
        """
        if self.serve is None:
            yield None
            return
        from edgetree.serve import Service

        with Service(self.serve, takes_frames=source == CLIENTS) as service:
            note(f"service: {service.address}")
            yield service

    def check(self, source: str) -> None:
        """Raise InputError if a value cannot be used."""
        from edgetree.live.page import PageServer

        PageServer(self.host, self.port, self.token, self.blank_after)
        self.check_service(source)

    def check_service(self, source: str) -> None:
        """Raise InputError for a wrong or missing address of the service, or options of no page."""
        from basetree.errors import InputError
        from edgetree.serve.router import endpoint

        names = ("host", "port", "token", "blank_after")
        given = [name for name in names if getattr(self, name) != getattr(type(self), name)]
        if given and not self.page:
            option = given[0].replace("_", "-")
            raise InputError(f"--{option} given without --page: expected both")
        if self.serve is not None:
            endpoint(self.serve)
        elif source == CLIENTS:
            raise InputError(
                f"the source is {CLIENTS} without --serve: expected the address where they"
                " connect, such as --serve tcp://127.0.0.1:8430"
            )

    @contextmanager
    def serving(
        self, recorder: FrameRecorder | None, health: ServiceHealth, *, waits: bool
    ) -> Iterator[PageServer | None]:
        """Serve the page during a block; yields None if it is not wanted.

        Args:
            recorder: Takes marks.
            health: Says how the service goes.
            waits: Whether a port that is taken is waited for.
        """
        if not self.page:
            yield None
            return
        from edgetree.live.page import PageServer

        page = PageServer(
            self.host,
            self.port,
            self.token,
            self.blank_after,
            recorder=recorder,
            health=health,
        )
        with closing(page):
            page.start(waits=waits, on_served=_tell_page)
            yield page


def _tell_page(address: str) -> None:
    """Say where the page is, with a token that nobody else knows."""
    note(f"page: {address}", tells_secret=True)
