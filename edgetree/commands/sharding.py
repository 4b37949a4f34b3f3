"""Frames on several machines: the options of `run` and `measure`, and what they do."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from basetree.counts import counted
from basetree.program.console import note, print_json
from basetree.program.quoting import quoted
from edgetree.commands.option_groups import RigOptions, SessionOptions

if TYPE_CHECKING:
    from basetree.jobs import Job, Store
    from edgetree.shards.merging import MergedFrames, Outputs


@dataclass(frozen=True)
class ShardOptions:
    """The options about several machines."""

    panel = "Several machines"

    shards: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER|URL",
            help="Where finished parts of the results are kept, for --shard and --ray: a folder, or"
            " an object store such as s3://bucket/folder.",
        ),
    ] = None
    shard: Annotated[
        str | None,
        typer.Option(
            metavar="I/N",
            help="Do only the I-th of N shares of the frames, such as 3/64; `edgetree merge` joins"
            " the shares.",
        ),
    ] = None
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS|local",
            help="Share the frames out on a cluster of Ray, or on this machine's cores by Ray.",
        ),
    ] = None

    @property
    def are_given(self) -> bool:
        """Whether any of them is given."""
        return any(value is not None for value in (self.shards, self.shard, self.ray))

    def outputs(self, paths: Mapping[str, Path | None]) -> Outputs:
        """Check that the options fit each other and the files to write.

        Args:
            paths: Paths of the options for files, by name.

        Returns:
            The files of the merged results.

        Raises:
            InputError: They do not fit.
        """
        from basetree.errors import InputError
        from edgetree.shards.merging import Outputs

        if self.shard is not None and self.ray is not None:
            raise InputError("--shard given with --ray: expected one of them")
        if self.shards is None:
            option = "--shard" if self.ray is None else "--ray"
            raise InputError(
                f"{option} given without --shards: expected the folder or URL to keep parts in"
            )
        given = {name: path for name, path in paths.items() if path is not None}
        if self.shard is not None and given:
            raise InputError(
                f"--{min(given)} given with --shard: expected it with `edgetree merge`"
            )
        known = {field.name for field in fields(Outputs)}
        if given.keys() - known:
            expected = ", ".join(f"--{name}" for name in sorted(known))
            raise InputError(
                f"--{min(given.keys() - known)} given with --shards: expected {expected}"
            )
        return Outputs(**given)


@dataclass(frozen=True)
class ShardedFrames:
    """The options that say what to detect and measure.

    Attributes:
        source: Value of SOURCE.
        depth: Value of --depth.
        camera: Value of --camera.
        model: Name or file of the model.
        rig_options: The options about the cameras.
        session: The options about running the model.
        score_threshold: Value of --score-threshold.
    """

    source: Path
    depth: Path | None
    camera: Path | None
    model: str
    rig_options: RigOptions
    session: SessionOptions
    score_threshold: float

    def identity(self) -> dict[str, Any]:
        """The options that decide on the results, with the content of files by SHA-256."""
        from basetree.files.regular import read_regular

        files = {
            name: None if path is None else hashlib.sha256(read_regular(path)).hexdigest()
            for name, path in self.rig_options.files(self.camera).items()
        }
        values = {
            name: value
            for name, value in asdict(self.rig_options).items()
            if f"--{name.replace('_', '-')}" not in files
        }
        if files["--depth-scale"] is None:
            values["depth_scale"] = self.rig_options.depth_scale
        names = self.rig_options.names_in_files(self.camera)
        return {"files": files, "names": names, **values, "score_threshold": self.score_threshold}


def run_sharded(
    frames: ShardedFrames,
    options: ShardOptions,
    paths: Mapping[str, Path | None],
    *,
    as_json: bool,
) -> None:
    """Do a shard of the frames; with Ray, or without --shard, do all and merge them.

    Args:
        frames: What to do.
        options: Where, and which shard.
        paths: Paths of the options for files, by name.
        as_json: Whether to print one JSON object.

    Raises:
        InputError: Options contradict each other, or files cannot be used.
        InputError: a store or a cluster cannot be used.
        CheckFailed: Frames were left out of the merged results.
    """
    from basetree.jobs import Progress, Shard, open_store, read_manifests, run_shard
    from edgetree.shards.merging import merge_frames

    outputs = options.outputs(paths)
    assert options.shards is not None
    shard = Shard() if options.shard is None else Shard.parse(options.shard)
    store = open_store(_seen(options.shards, options.ray))
    job, start, cores = _job(frames, store, options.ray)
    progress = Progress("detecting", cores)
    if options.ray is not None:
        from basetree.jobs.on_ray import RayEngine

        with RayEngine(options.ray, cores) as engine:
            engine.run(job, start, progress)
    else:
        run_shard(job, start, shard, progress)
    if options.shard is None:
        parts = read_manifests([store], (job.kind,))
        print_merged(merge_frames(parts, outputs, lines_to_stdout=not as_json), outputs, as_json)
        return
    if as_json:
        values = {"store": store.where, "shard": str(shard), "manifest": shard.file}
        print_json({"schema": "edgetree.written-shard/1", **values})
    note(f"shard {shard}: {store.where}/{shard.file}")
    note(
        f"next, when all shards are finished: edgetree merge {quoted(store.where)} --csv trees.csv"
    )


def _seen(place: Path, ray: str | None) -> Path:
    """A folder or URL; folders are absolute for processes of Ray, which work elsewhere."""
    from basetree.jobs import is_url

    return place.absolute() if ray is not None and not is_url(place) else place


def _job(frames: ShardedFrames, store: Store, ray: str | None) -> tuple[Job, Any, int]:
    """The job, what starts a worker, and the cores that a worker keeps busy."""
    from basetree.errors import InputError
    from edgetree.catalogue import find_model
    from edgetree.commands.frame_results import warnings_shown
    from edgetree.runtime.detector import TreeDetector
    from edgetree.shards.inputs import list_frames
    from edgetree.shards.work import BLOCK_FRAMES, FrameWork, frames_job, model_files

    session = frames.session
    if ray is not None and session.provider != "cpu":
        raise InputError(f"--provider is {session.provider} with --ray: expected cpu")
    threads = session.threads or (1 if ray is not None else None)
    given = {"threads": threads, "score_threshold": frames.score_threshold}
    loaded = {**session.load_options(), **given}
    model = find_model(frames.model)
    detector = TreeDetector.load(model, **loaded)  # a wrong file ends the command here
    typed = [place for place in (frames.source, frames.depth) if place is not None]
    source = _seen(frames.source, ray)
    depth = None if frames.depth is None else _seen(frames.depth, ray)
    with warnings_shown():
        listed = list_frames(source, depth, takes_depth=detector.manifest.takes_depth)
    work = FrameWork(
        source,
        depth,
        {str(_seen(place, ray)): str(place) for place in typed},
        listed.digest,
        model.absolute(),
        model_files(model),
        frames.rig_options.rig(frames.camera, frames.depth),
        frames.rig_options.settings(),
        loaded,
    )
    block = 1 if listed.are_recordings else BLOCK_FRAMES
    job = frames_job(work, store, len(listed.entries), block, frames.identity())
    return job, work, threads or os.cpu_count() or 1


def print_merged(merged: MergedFrames, outputs: Outputs, as_json: bool) -> None:
    """Say what was merged, and where it is.

    Raises:
        CheckFailed: Frames were left out.
    """
    from edgetree.commands.frame_results import LeftOut, note_files

    if as_json:
        paths = {name: path and str(path) for name, path in vars(outputs).items()}
        values = {"frames": merged.frames, "trees": merged.trees, **paths}
        print_json({"schema": "edgetree.merge/1", **values, "left_out": merged.left_out})
    left_out = LeftOut(strict=False)
    for reason in merged.left_out:
        left_out.add(ValueError(reason))
    left_out.check_some(merged.frames)
    note(f"{counted(merged.trees, 'tree')} in {counted(merged.frames, 'frame')}")
    files = {"JSON lines": outputs.jsonl, "table": outputs.csv, "profiles": outputs.profiles}
    note_files(files)
    left_out.check_none(merged.frames)
