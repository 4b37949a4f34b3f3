"""Training from random or published weights, on CPUs and GPUs."""

from perceptree.settings.training import DataSource, Engine, TrainSettings
from perceptree.training.counts import Status
from perceptree.training.growing import train_while_simulating
from perceptree.training.recipes import PAPER_FREEZING, PAPER_STEPS, RECIPES, recipe_settings
from perceptree.training.run import train
from perceptree.training.source import Preparing
from perceptree.training.starting import Init
from perceptree.training.trainer import TrainReport

__all__ = [
    "PAPER_FREEZING",
    "PAPER_STEPS",
    "RECIPES",
    "DataSource",
    "Engine",
    "Init",
    "Preparing",
    "Status",
    "TrainReport",
    "TrainSettings",
    "recipe_settings",
    "train",
    "train_while_simulating",
]
