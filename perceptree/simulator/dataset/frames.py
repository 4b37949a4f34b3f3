"""Simulate the frames of a scene in memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from basetree.arrays import UInt8
from perceptree.simulator.geometry.assemble import assemble
from perceptree.simulator.geometry.negatives import NEGATIVES
from perceptree.simulator.geometry.prototypes import Prototypes, make_prototypes
from perceptree.simulator.labelling.frame import LabelledFrame, Motion, SceneRecord
from perceptree.simulator.labelling.labels import label_view
from perceptree.simulator.materials.textures import Textures, make_textures
from perceptree.simulator.photographs.dressing import dress
from perceptree.simulator.photographs.folder import PhotoFolder
from perceptree.simulator.rendering.drive import IMU_HZ, Drive, make_drive
from perceptree.simulator.rendering.foreground import with_foreground
from perceptree.simulator.rendering.render import Drawing, Renderer
from perceptree.simulator.rendering.view import View, random_view
from perceptree.simulator.scene.description import Scene, describe_scene
from perceptree.simulator.scene.objects import OBJECT_KINDS
from perceptree.simulator.sensors.caption import draw_caption
from perceptree.simulator.sensors.depth import measure_depth
from perceptree.simulator.sensors.fixed import fixed_sensors
from perceptree.simulator.sensors.imaging import (
    CameraFaults,
    apply_lens_faults,
    apply_processing_faults,
    draw_faults,
)
from perceptree.simulator.sensors.infrared_night import (
    InfraredNight,
    draw_night,
    light_beam,
    metered_luminance,
    night_picture,
)
from perceptree.simulator.sensors.precipitation import draw_precipitation
from perceptree.simulator.sensors.rgb import expose
from perceptree.simulator.settings import (
    ClutterSettings,
    ImagingSettings,
    NegativeSettings,
    ObjectSettings,
    RandomisationSettings,
    SimulatorSettings,
    TrapSettings,
    VegetationSettings,
)
from perceptree.simulator.streams import Stream, stream


@dataclass(frozen=True)
class Assets:
    """Textures and meshes that all scenes share; made once per process.

    Attributes:
        textures: Textures of all materials.
        prototypes: Shared meshes.
        photographs: Photographs that scenes show besides; None for none.
    """

    textures: Textures
    prototypes: Prototypes
    photographs: PhotoFolder | None = None


def make_assets(photographs: PhotoFolder | None = None) -> Assets:
    """Make the textures and the shared meshes, which are identical in every process."""
    return Assets(make_textures(), make_prototypes(), photographs)


def simulate_frames(
    settings: SimulatorSettings, seed: int, views: int, assets: Assets
) -> Iterator[LabelledFrame]:
    """Simulate the frames of one scene.

    Args:
        settings: Settings of the simulator.
        seed: Seed of the scene.
        views: Number of frames.
        assets: Textures and shared meshes.

    Yields:
        One frame after the other, with image, depth and labels.
    """
    scene = with_foreground(settings, describe_scene(settings, seed))
    renderer = _renderer(settings, scene, assets)
    drive = None
    if scene.circuit is not None:
        settings = fixed_sensors(stream(seed, Stream.SENSORS), settings)
        drive = make_drive(
            stream(seed, Stream.DRIVE),
            settings.drive,
            settings.camera,
            scene.terrain,
            scene.circuit,
            views,
        )
    for number in range(views):
        rng = stream(seed, Stream.VIEW, number)
        fault_rng = stream(seed, Stream.FAULTS, number if drive is None else 0)
        trap_rng = stream(seed, Stream.TRAP, number if drive is None else 0)
        view = random_view(rng, settings.camera, scene) if drive is None else drive.view(number)
        motion = None if drive is None else _motion_record(drive, number)
        rngs = (rng, fault_rng, trap_rng)
        yield _labelled_frame(rngs, settings, scene, view, renderer.draw(view), motion)


def _renderer(settings: SimulatorSettings, scene: Scene, assets: Assets) -> Renderer:
    mesh = assemble(scene, assets.prototypes)
    if assets.photographs is None:
        return Renderer(assets.textures, scene, mesh)
    own = dress(scene, mesh.layer, assets.textures, assets.photographs, settings.photographs)
    return Renderer(own.textures, scene, mesh, own.far_stand, own.far_forest)


def _motion_record(drive: Drive, number: int) -> Motion:
    """Camera pose of a drive's frame, and the IMU samples since the previous frame."""
    first = 0 if number == 0 else drive.sample(number - 1) + 1
    last = drive.sample(number)
    samples = slice(first, last + 1)
    times_s = np.arange(first, last + 1) / IMU_HZ
    imu = np.column_stack([times_s, drive.gyro_rad_per_s[samples], drive.accel_m_per_s2[samples]])
    return Motion(drive.time_s(number), drive.origin_m[last], drive.rotation[last], imu)


def _labelled_frame(
    rngs: tuple[np.random.Generator, np.random.Generator, np.random.Generator],
    settings: SimulatorSettings,
    scene: Scene,
    view: View,
    drawing: Drawing,
    motion: Motion | None,
) -> LabelledFrame:
    """Apply the sensor models to a rendered view, and label it.

    `rngs` are for the view's sensors, for camera faults and for camera traps.
    """
    rng, fault_rng, trap_rng = rngs
    faults = draw_faults(fault_rng, settings.imaging)
    captioned = trap_rng.random() < settings.trap.caption_share
    night = draw_night(trap_rng, settings.trap) if scene.light.infrared else None
    if night is not None:
        faults = replace(faults, infrared=True)
    image = _picture(rngs, settings, scene, view, drawing, faults, night)
    if captioned:
        image = draw_caption(trap_rng, image)
    measured = measure_depth(
        rng, settings.depth, drawing.depth_m, view.intrinsics, scene.weather.haze_per_m
    )
    stride = settings.depth.exact_stride_px
    exact_m = drawing.depth_m[::stride, ::stride]
    return LabelledFrame(
        image=image,
        depth_m=measured.depth_m,
        exact_depth_m=np.where(exact_m <= settings.depth.exact_range_m, exact_m, 0),
        labels=label_view(view, drawing, scene.near_trees, settings.labels),
        view=view,
        scene=_scene_record(scene),
        depth_sensor={name: v for name, v in vars(measured).items() if name != "depth_m"},
        exact_stride_px=stride,
        realism=_realism(settings, scene, faults, captioned),
        motion=motion,
    )


def _picture(
    rngs: tuple[np.random.Generator, np.random.Generator, np.random.Generator],
    settings: SimulatorSettings,
    scene: Scene,
    view: View,
    drawing: Drawing,
    faults: CameraFaults,
    night: InfraredNight | None,
) -> UInt8:
    """Take the colour picture, (H, W, 3) uint8 BGR, without a caption."""
    rng, fault_rng, trap_rng = rngs
    samples, log_luminance = drawing.samples, drawing.log_luminance
    if night is not None:
        samples = light_beam(night, samples)
        log_luminance = metered_luminance(night, samples)
    image = expose(
        rng,
        settings.rgb,
        samples,
        log_luminance,
        scene.light.darkness,
        2.0**faults.exposure_stops,
        partial(apply_lens_faults, fault_rng, faults.strength) if faults.strength else None,
    )
    image = draw_precipitation(
        rng,
        image,
        drawing.depth_m,
        view.intrinsics,
        scene.weather.rain,
        scene.weather.snowfall,
        view.up,
    )
    if night is not None:
        image = night_picture(trap_rng, night, image)
    return apply_processing_faults(fault_rng, faults, image)


def _realism(
    settings: SimulatorSettings, scene: Scene, faults: CameraFaults, captioned: bool
) -> dict[str, float | bool]:
    """Additions beyond the paper's conditions in a frame; those that are off are left out."""
    values: dict[str, float | bool] = {}
    if settings.objects != ObjectSettings():
        values |= _counts(scene, OBJECT_KINDS)
    if settings.negatives != NegativeSettings():
        values |= _counts(scene, tuple(NEGATIVES))
    if settings.trap != TrapSettings():
        values |= {"infrared_night": scene.light.infrared, "caption": captioned}
    if settings.clutter != ClutterSettings():
        values |= {"dead_twigs": scene.dead_twigs, "backdrop": scene.backdrop}
    if settings.imaging != ImagingSettings():
        values |= {
            "camera_faults": faults.strength,
            "exposure_stops": faults.exposure_stops,
            "infrared": faults.infrared,
        }
    if settings.randomisation != RandomisationSettings():
        values["recoloured"] = scene.appearance.changed
    if settings.vegetation != VegetationSettings():
        values |= {
            "grass_cover": scene.vegetation.grass_cover,
            "grass_height_m": scene.vegetation.grass_height_m,
            "hedges": scene.vegetation.hedges,
            "snow_depth_m": scene.vegetation.snow_depth_m,
        }
    return values


def _counts(scene: Scene, kinds: tuple[str, ...]) -> dict[str, float | bool]:
    """Number of a scene's objects by kind."""
    return {
        kind: sum(len(placed.scale) for placed in scene.undergrowth if placed.kind == kind)
        for kind in kinds
    }


def _scene_record(scene: Scene) -> SceneRecord:
    return SceneRecord(
        scene.seed,
        scene.terrain.ground,
        scene.terrain.slope_deg,
        scene.stems_per_ha,
        scene.pattern,
        scene.weather.kind,
        scene.weather.strength,
        scene.light.time,
        scene.light.overcast,
    )
