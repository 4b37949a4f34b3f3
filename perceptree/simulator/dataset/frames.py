"""From settings and a scene's seed to frames in memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from perceptree.simulator.geometry.assemble import assemble
from perceptree.simulator.geometry.prototypes import Prototypes, make_prototypes
from perceptree.simulator.labelling.frame import Frame, PoseRecord, SceneRecord
from perceptree.simulator.labelling.labels import label_view
from perceptree.simulator.materials.textures import Textures, make_textures
from perceptree.simulator.rendering.render import Drawing, Renderer
from perceptree.simulator.rendering.view import View, random_view
from perceptree.simulator.scene.description import Scene, describe_scene
from perceptree.simulator.sensors.depth import measure_depth
from perceptree.simulator.sensors.precipitation import draw_precipitation
from perceptree.simulator.sensors.rgb import expose
from perceptree.simulator.settings import SimulatorSettings


@dataclass(frozen=True)
class Assets:
    """What every scene draws on and a process makes once: textures and shared meshes."""

    textures: Textures
    prototypes: Prototypes


def make_assets() -> Assets:
    """Draw the textures and grow the shared meshes; the same bytes in every process."""
    return Assets(make_textures(), make_prototypes())


def simulate_frames(
    settings: SimulatorSettings, seed: int, views: int, assets: Assets
) -> Iterator[Frame]:
    """The frames of one scene, one after the other: pictures, depth and labels in memory."""
    scene = describe_scene(settings, seed)
    renderer = Renderer(assets.textures, scene, assemble(scene, assets.prototypes))
    for number in range(views):
        rng = np.random.default_rng([seed, 2, number])
        view = random_view(rng, settings.camera, scene)
        yield _frame(rng, settings, scene, view, renderer.draw(view))


def _frame(
    rng: np.random.Generator, settings: SimulatorSettings, scene: Scene, view: View,
    drawing: Drawing,
) -> Frame:  # fmt: skip
    """What the sensors and the labels make of a drawing."""
    weather, pose = scene.weather, view.pose
    image = expose(rng, settings.rgb, drawing.samples, drawing.log_luminance, scene.light.darkness)
    image = draw_precipitation(
        rng,
        image,
        drawing.depth_m,
        view.intrinsics,
        weather.rain,
        weather.snowfall,
        view.up,
    )
    measured = measure_depth(rng, settings.depth, drawing.depth_m, view.intrinsics)
    stride = settings.depth.exact_stride_px
    exact_m = drawing.depth_m[::stride, ::stride]
    return Frame(
        image=image,
        depth_m=measured.depth_m,
        exact_depth_m=np.where(exact_m <= settings.depth.exact_range_m, exact_m, 0),
        labels=label_view(view, drawing, scene.near_trees, settings.labels),
        view=view,
        scene=_scene_record(scene),
        pose=PoseRecord(pose.carrier, pose.height_m, pose.pitch_deg, pose.roll_deg),
        depth_sensor={
            "kind": measured.kind, "baseline_m": measured.baseline_m, "noise": measured.noise,
            "range_m": measured.range_m,
        },
        exact_stride_px=stride,
    )  # fmt: skip


def _scene_record(scene: Scene) -> SceneRecord:
    return SceneRecord(
        scene.seed, scene.terrain.ground, scene.terrain.slope_deg, scene.stems_per_ha,
        scene.pattern, scene.weather.kind, scene.weather.strength, scene.light.time,
        scene.light.overcast,
    )  # fmt: skip
