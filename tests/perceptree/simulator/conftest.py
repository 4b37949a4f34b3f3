"""Fixtures of the simulator's tests: fake frames without rendering, and small scenes."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import fake_synth
import pytest

from perceptree.simulator.dataset import generate, shards
from perceptree.simulator.dataset.generate import generate_dataset
from perceptree.simulator.geometry.assemble import SceneMesh, assemble
from perceptree.simulator.geometry.prototypes import Prototypes, make_prototypes
from perceptree.simulator.materials.textures import Textures, make_textures
from perceptree.simulator.scene.description import Scene, describe_scene
from perceptree.simulator.settings import (
    CameraSettings,
    ObjectSettings,
    SimulatorSettings,
    StandSettings,
)
from perceptree.simulator.settings.presets import PRESETS


@pytest.fixture(scope="session")
def synth() -> ModuleType:
    """The module ``fake_synth``."""
    return fake_synth


def _fake(synth: ModuleType, patch: pytest.MonkeyPatch) -> None:
    patch.setitem(sys.modules, synth.fake.__name__, synth.fake)
    patch.setattr(generate, "draw_scenes", synth.draw_here)
    patch.setattr(shards, "draw_scenes", synth.draw_here)


@pytest.fixture
def in_process(synth: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fake frames, made one after the other in this process.

    By the test's own `monkeypatch`, so that what the test replaces after it is put back before it.
    """
    _fake(synth, monkeypatch)


@pytest.fixture(scope="session")
def fake_dataset(
    synth: ModuleType, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[int], Path]:
    """Make a dataset of fake frames with seed 3 and two frames per scene."""

    def make(frames: int) -> Path:
        directory = tmp_path_factory.mktemp("forest")
        with pytest.MonkeyPatch.context() as patch:
            _fake(synth, patch)
            generate_dataset(directory, frames, synth.small_settings(), 3)
        return directory

    return make


SMALL = SimulatorSettings(
    camera=CameraSettings.of_size(320, 180), stand=StandSettings(stems_per_ha=(600.0, 600.0))
)


@pytest.fixture(scope="session")
def small_settings() -> SimulatorSettings:
    """The default settings at 320x180."""
    return SMALL


@pytest.fixture(scope="session")
def textures() -> Textures:
    return make_textures()


@pytest.fixture(scope="session")
def prototypes() -> Prototypes:
    return make_prototypes()


@pytest.fixture(scope="session")
def forests(prototypes: Prototypes) -> list[tuple[Scene, SceneMesh]]:
    """Two scenes and their triangles."""
    scenes = [describe_scene(SMALL, seed) for seed in (4, 7)]
    return [(scene, assemble(scene, prototypes)) for scene in scenes]


@pytest.fixture(scope="session")
def field_settings() -> SimulatorSettings:
    """The preset "field" at 320x180, with objects of every kind."""
    some = ObjectSettings(
        people=(3, 3),
        animals=(3, 3),
        machines=(1, 1),
        posts=(4, 4),
        logs=(3, 3),
        walls=(2, 2),
        shapes=(3, 3),
    )
    camera = CameraSettings.of_size(320, 180)
    return replace(PRESETS["field"].settings, camera=camera, objects=some)


@pytest.fixture(scope="session")
def field_forest(
    field_settings: SimulatorSettings, prototypes: Prototypes
) -> tuple[Scene, SceneMesh]:
    """A scene of the preset "field" and its triangles."""
    scene = describe_scene(field_settings, 21)
    return scene, assemble(scene, prototypes)
