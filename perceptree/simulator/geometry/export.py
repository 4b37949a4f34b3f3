"""Export a scene to a file for 3D programs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from perceptree.simulator.geometry.assemble import SceneMesh, assemble
from perceptree.simulator.geometry.gltf import scene_nodes, write_gltf
from perceptree.simulator.geometry.prototypes import make_prototypes
from perceptree.simulator.materials.layers import FIRST_GROUND
from perceptree.simulator.materials.textures import make_textures
from perceptree.simulator.rendering.foreground import with_foreground
from perceptree.simulator.scene.description import Scene, describe_scene
from perceptree.simulator.settings import SimulatorSettings


def export_scene(path: Path, settings: SimulatorSettings, seed: int) -> tuple[int, int]:
    """Write a scene as binary glTF.

    Args:
        path: File to write.
        settings: Settings of the simulator.
        seed: Seed of the scene.

    Returns:
        Number of trees and number of triangles.

    Raises:
        DatasetError: If the file cannot be written.
    """
    scene = with_foreground(settings, describe_scene(settings, seed))
    mesh = with_one_ground(assemble(scene, make_prototypes()), scene)
    nodes = scene_nodes(mesh, [tree.stem.model.name for tree in scene.trees])
    write_gltf(path, mesh, nodes, make_textures())
    return len(scene.trees), len(mesh.faces)


def with_one_ground(mesh: SceneMesh, scene: Scene) -> SceneMesh:
    """Give the whole ground its main cover, because blending of covers is done by the renderer."""
    layer = mesh.layer.copy()
    layer[: mesh.instance_start[1]] = FIRST_GROUND + int(np.argmax(scene.terrain.cover))
    return replace(mesh, layer=layer)
