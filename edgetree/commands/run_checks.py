"""What `edgetree run` refuses before the work starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from edgetree.commands.options import check_distances, check_extrinsic, check_report, model_file

if TYPE_CHECKING:
    from edgetree.commands.option_groups import RigOptions
    from edgetree.commands.run_inputs import RunInputs
    from edgetree.commands.run_outputs import RunOutputs
    from edgetree.commands.sharding import ShardOptions
    from edgetree.sources.source_list import SourceList


def check_options(
    sources: SourceList,
    inputs: RunInputs,
    rig_options: RigOptions,
    outputs: RunOutputs,
    shards: ShardOptions,
) -> None:
    """Raise InputError if outputs overwrite files or do not fit the source."""
    from basetree.errors import InputError
    from basetree.files.places import check_paths
    from edgetree.sources.drive import is_drive
    from edgetree.sources.opening import is_stream
    from edgetree.sources.videos import is_video, is_video_name

    check_paths(
        {f"--{name}": path for name, path in vars(outputs).items()},
        {
            **sources.by_name(),
            "--depth": inputs.depth,
            "--right": inputs.right,
            "--cloud": inputs.cloud,
            "--model": model_file(inputs.model),
            **rig_options.files(inputs.camera),
        },
    )
    check_report(outputs.report)
    without_depth = rig_options.references() is not None
    check_distances(inputs.depth, inputs.right, inputs.cloud, without_depth=without_depth)
    for source in sources.paths:
        if not is_stream(source):
            check_extrinsic(
                rig_options.extrinsic, source if source.is_file() else None, inputs.cloud
            )
        if outputs.coco and is_video(source):
            raise InputError(f"source {source} is a video: expected images, as --coco is given")
        if outputs.coco and is_stream(source) and not is_drive(source):
            raise InputError(f"source {source} is a recording: expected images, as --coco is given")
        if outputs.map and not (shards.are_given or is_stream(source)):
            raise InputError(
                f"source {source} has no poses: expected a recording or a drive with poses, as"
                " --map is given; `edgetree live` follows stems without them, with depth or"
                " --camera-height"
            )
    if shards.are_given and inputs.words():
        raise InputError(f"{inputs.words().split()[0]} given with --shards: expected one of them")
    if shards.are_given and inputs.strict_frames:
        raise InputError(
            "--strict-frames given with --shards: expected one of them, as shards leave out frames"
            " that cannot be read, and say so"
        )
    one = sources.one
    is_in_order = one is not None and (is_video(one) or is_stream(one))
    if outputs.out and is_video_name(outputs.out) and not is_in_order:
        raise InputError(
            f"--out is {outputs.out} and source {sources.name} has pictures in no order: expected a"
            " folder, or a video or recording to draw a video of"
        )
    if one is None:
        _check_several(sources, inputs, outputs, shards)


def _check_several(
    sources: SourceList, inputs: RunInputs, outputs: RunOutputs, shards: ShardOptions
) -> None:
    """Raise InputError if an option is given that is for one source."""
    from basetree.errors import InputError

    given = {
        "--right": inputs.right is not None,
        "--map": outputs.map is not None,
        "--scene": inputs.scene is not None,
        "--shards": shards.are_given,
    }
    for option, is_given in given.items():
        if is_given:
            raise InputError(
                f"{option} given with {len(sources.paths)} sources: expected one source"
            )
