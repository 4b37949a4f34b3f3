"""Build the triangles of a scene from its description."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, Float32, Int32, Int64, UInt8
from perceptree.simulator.geometry.crowns import fit_crown
from perceptree.simulator.geometry.ground import ground_mesh
from perceptree.simulator.geometry.mesh import Mesh
from perceptree.simulator.geometry.prototypes import Prototypes
from perceptree.simulator.geometry.sky import sky_visibility
from perceptree.simulator.geometry.stems import stem_mesh
from perceptree.simulator.scene.description import Scene, Tree
from perceptree.simulator.scene.scatter import Placement


@dataclass(frozen=True)
class SceneMesh:
    """All triangles of a scene. World axes are x east, y north and z up, in metres.

    The instances are the ground, then stem and crown (and dead twigs) of each tree, then the
    undergrowth, grass and hedges. The faces of an instance are consecutive.

    Attributes:
        vertices: (V, 3) m.
        normals: (V, 3) directions; not all have unit length.
        uv: (V, 2) texture coordinates, in repeats.
        tint: (V,) brightness factors.
        sky: (V,) visibility of the sky, 0 to 1.
        faces: (F, 3) vertex numbers.
        layer: (F,) texture layers.
        object_id: (F,) number (from 1) of the tree whose labelled stem a face belongs to, else 0.
        instance_start: (I + 1,) first face of each instance, and F.
        instance_centre: (I, 3) centres of the instances' bounding spheres, m.
        instance_radius: (I,) radii of the instances' bounding spheres, m.
        tree_start: (T + 1,) first face of each tree of the scene, and of what follows the last.
    """

    vertices: Float32
    normals: Float32
    uv: Float32
    tint: Float32
    sky: Float32
    faces: Int32
    layer: UInt8
    object_id: Int32
    instance_start: Int64
    instance_centre: Float
    instance_radius: Float
    tree_start: Int64


class _Assembly:
    """Collects placed meshes and concatenates them."""

    def __init__(self) -> None:
        self._columns: dict[str, list[NDArray[Any]]] = defaultdict(list)
        self._face_counts: list[Int64] = []
        self._vertex_count = 0
        self._tree_start: list[int] = []

    def begin_tree(self) -> None:
        """Mark the start of the next tree, or of what follows the last tree."""
        self._tree_start.append(sum(int(counts.sum()) for counts in self._face_counts))

    def add(
        self,
        mesh: Mesh,
        position_m: Float,
        rotation: Float,
        scale: Float,
        tint: Float,
        object_id: int = 0,
    ) -> None:
        """Place n copies of a mesh: position (n, 3), rotation (n, 3, 3), scale and tint (n,)."""
        count, size = len(position_m), len(mesh.vertices)
        turn = rotation.astype(np.float32).transpose(0, 2, 1)
        corners = np.asarray(mesh.vertices, np.float32) @ turn
        placed = corners * scale[:, None, None].astype(np.float32) + position_m[:, None]
        normals = np.asarray(mesh.normals, np.float32) @ turn
        shift = self._vertex_count + np.arange(count)[:, None, None] * size
        low, high = placed.min(1), placed.max(1)
        columns = {
            "vertices": placed.reshape(-1, 3).astype(np.float32),
            "normals": normals.reshape(-1, 3),
            "uv": np.tile(mesh.uv, (count, 1)).astype(np.float32),
            "tint": (mesh.tint * tint[:, None]).ravel().astype(np.float32),
            "faces": (mesh.faces[None] + shift).reshape(-1, 3).astype(np.int32),
            "layer": np.tile(mesh.layer, count),
            "object_id": np.tile(mesh.labelled * np.int32(object_id), count),
            "instance_centre": (low + high) / 2,
            "instance_radius": np.linalg.norm(high - low, axis=-1) / 2,
        }
        for name, values in columns.items():
            self._columns[name].append(values)
        self._face_counts.append(np.full(count, len(mesh.faces), np.int64))
        self._vertex_count += count * size

    def place(self, mesh: Mesh, position_m: Float, tint: float = 1.0, object_id: int = 0) -> None:
        """Place one copy of a mesh without rotation or scaling."""
        self.add(mesh, position_m[None], np.eye(3)[None], np.ones(1), np.array([tint]), object_id)

    def scene_mesh(self) -> SceneMesh:
        """The concatenated arrays of everything placed so far."""
        columns = {name: np.concatenate(parts) for name, parts in self._columns.items()}
        return SceneMesh(
            **columns,
            sky=sky_visibility(columns["vertices"], columns["faces"], columns["layer"]),
            instance_start=np.concatenate([[0], np.cumsum(np.concatenate(self._face_counts))]),
            tree_start=np.array(self._tree_start, np.int64),
        )


def assemble(scene: Scene, prototypes: Prototypes) -> SceneMesh:
    """Build the triangles of a scene.

    Args:
        scene: The description.
        prototypes: The shared meshes.
    """
    assembly = _Assembly()
    assembly.place(ground_mesh(scene.terrain, scene.vegetation.snow_m), np.zeros(3))
    number = 0
    for tree in scene.trees:
        number += tree.near
        assembly.begin_tree()
        _add_tree(assembly, tree, prototypes, scene, number if tree.near else 0)
    assembly.begin_tree()
    for placement in scene.undergrowth + scene.vegetation.placements:
        _add_undergrowth(assembly, placement, prototypes.undergrowth[placement.kind])
    return assembly.scene_mesh()


def _add_tree(
    assembly: _Assembly, tree: Tree, prototypes: Prototypes, scene: Scene, number: int
) -> None:
    bark = stem_mesh(tree.stem, tree.label_heights_m, tree.near)
    assembly.place(bark, tree.position_m, tree.tint, number)
    if not tree.dead:
        crowns = prototypes.crowns_of(tree.stem.model, tree.near, scene.leaves, scene.fine_crowns)
        crown = crowns[int(tree.crown * len(crowns))]
        assembly.place(fit_crown(crown, tree.stem, tree.turn_rad, tree.tint), tree.position_m)
    if tree.near and tree.stem.model.conifer:
        twigs = prototypes.twigs_of(100 * scene.dead_twigs * (0.4 + 1.2 * tree.crown))
        if twigs is not None:
            dry = fit_crown(twigs, tree.stem, tree.turn_rad, tree.tint)
            assembly.place(dry, tree.position_m)


def _add_undergrowth(assembly: _Assembly, placement: Placement, meshes: list[Mesh]) -> None:
    which = (placement.choice * len(meshes)).astype(int)
    for index, mesh in enumerate(meshes):
        chosen = which == index
        if chosen.any():
            assembly.add(
                mesh,
                placement.position_m[chosen],
                placement.rotation[chosen],
                placement.scale[chosen],
                placement.tint[chosen],
            )
