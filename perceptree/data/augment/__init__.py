"""Random changes of a training frame that leave its labels true.

``frame`` takes a frame through all of them. ``settings`` says what may change, ``geometry`` and
``labels`` move picture and labels alike, ``colour`` and ``depth`` change what the sensor made of
the scene, ``paste`` adds trees of another frame, ``randomness`` draws fast.
"""

from perceptree.data.augment.frame import augment
from perceptree.data.augment.geometry import flip
from perceptree.data.augment.settings import PAPER_AUGMENT, AugmentSettings

__all__ = ["PAPER_AUGMENT", "AugmentSettings", "augment", "flip"]
