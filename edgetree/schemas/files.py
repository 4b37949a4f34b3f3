"""Types of the files of shards, signatures and recordings, and of the state of a service."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import Meta

from basetree.schemas import Count, Sha256, Share, Triple
from calib.schemas import Camera
from edgetree.measure import MeasureSettings
from edgetree.measure.rig_uncertainty import RigUncertainty
from edgetree.results.service_state import StateName
from edgetree.schemas.commands import Rotated
from edgetree.schemas.results import Frame


class State(TypedDict):
    """The state of `edgetree live`, in messages and lines; `sequence` in datagrams."""

    schema: Literal["edgetree.live.state/1"]
    state: StateName
    reason: str
    since: str | None
    results: Count
    sequence: NotRequired[Count]


class Job(TypedDict):
    """`shards/job.json`."""

    schema: Literal["edgetree.job/1"]
    kind: str
    job: Sha256
    frames: Count
    block: Annotated[int, Meta(ge=1)]
    identity: dict[str, Any]


class Shard(TypedDict):
    """The manifest of a finished shard."""

    schema: Literal["edgetree.shard/1"]
    kind: str
    job: Sha256
    frames: Count
    block: Annotated[int, Meta(ge=1)]
    folder: str
    identity: dict[str, Any]
    shard: str
    parts: dict[str, Sha256]


class Part(TypedDict):
    """The results of one unit of `edgetree run --shards`."""

    schema: Literal["edgetree.part/1"]
    frames: list[Frame]
    csv: str
    profiles: str
    left_out: list[str]


class TrustedKey(TypedDict):
    """A key whose signatures are accepted."""

    name: str
    public_key: str
    valid_until: str | None


class Trust(TypedDict):
    """A trust file."""

    schema: Literal["edgetree.trust/1"]
    require_signature: bool
    keys: list[TrustedKey]


class UsedVersion(TypedDict):
    """The highest version of a model that was used."""

    name: str
    version: Count
    file_sha256: Sha256


class UsedVersions(TypedDict):
    """The versions of signed models that an account has used."""

    schema: Literal["edgetree.used-versions/1"]
    latest_time: str | None
    models: list[UsedVersion]


class ModelSignature(TypedDict):
    """The payload of a model's signature."""

    schema: Literal["edgetree.model-signature/1"]
    name: str
    version: Annotated[int, Meta(ge=1)]
    file_bytes: Annotated[int, Meta(ge=1)]
    file_sha256: Sha256
    valid_from: str
    valid_until: str | None


class DepthErrors(TypedDict):
    """What a source knows of the errors of its depth, see `edgetree.frames.DepthNoise`."""

    noise_per_m: float | None
    noise_m: float | None
    bias_per_m: float | None
    correlation_px: float | None


class RecordingFrame(TypedDict):
    """Images, camera, vertical and noise of a frame of a recording, to the last digit."""

    schema: Literal["edgetree.recording.frame/1"]
    stamp_ns: int
    camera: Camera | None
    up_camera: Triple | None
    depth_noise: NotRequired[DepthErrors | None]
    rotation_deg: NotRequired[Literal[0, 90, 180, 270] | None]
    images: NotRequired[list[Literal["colour", "depth"]]]


class RecordedModel(TypedDict):
    """The model file of a recording."""

    file: str
    sha256: Sha256


class RecordedRig(TypedDict):
    """The cameras of a recording; null where nothing was given."""

    camera: Camera | None
    up_camera: Triple | None
    mounting: Rotated | None
    uncertainty: RigUncertainty


class Recording(TypedDict):
    """What `edgetree live --record` says of the run, on the topic /edgetree/recording."""

    schema: Literal["edgetree.recording/1"]
    edgetree: str
    source: str
    model: RecordedModel
    score_threshold: Share
    rig: RecordedRig
    measure: MeasureSettings
    frames: Count
    left_out: Count
    marks: list[Any]


class WrittenShard(TypedDict):
    """`edgetree run --shard --json` and that of `perceptree`: where a finished shard is."""

    schema: Literal["edgetree.written-shard/1"]
    store: str
    shard: str
    manifest: str


class Signed(TypedDict):
    """A signature of a payload."""

    keyid: str
    sig: str


class SignatureFile(TypedDict):
    """A model's `.sig` file, an envelope in the form DSSE; no key `schema`."""

    payloadType: str
    payload: str
    signatures: list[Signed]
