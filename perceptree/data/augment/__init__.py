"""Random changes of training frames and their labels.

`frame` applies all changes. `settings` holds their strengths, `geometry` and `labels`
transform image and labels together, `colour` and `depth` simulate variations of the sensor,
`paste` adds trees of another frame, `randomness` draws random numbers fast.
"""

from perceptree.data.augment.frame import augment
from perceptree.data.augment.geometry import flip
from perceptree.settings.augmentation import PAPER_AUGMENT, VARIED_AUGMENT, AugmentSettings

__all__ = ["PAPER_AUGMENT", "VARIED_AUGMENT", "AugmentSettings", "augment", "flip"]
