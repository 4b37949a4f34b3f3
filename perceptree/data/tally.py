"""What was left out or read in another way than it stands in a label file."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

# Keys are kinds of findings of `perceptree data check`; each text follows a count.
LEFT_OUT = {
    "no_content": "annotations without box, mask and keypoints",
    "box_empty": "boxes without area",
    "polygon_short": "polygon parts of fewer than three points or without area",
    "mask_short": "annotations whose mask has such parts alone",
    "keypoints_alone": "annotations of the file with keypoints that fit no box of the other file",
}


@dataclass
class Tally:
    """Counts of what a reader of one file left out or took in another way.

    Attributes:
        outside: (annotation id, x, y) of keypoints outside their frame.
        left_out: (key of `LEFT_OUT`, annotation id).
        crowds: Run lengths with iscrowd 1 that are ignored regions.
        crowds_with_keypoints: Run lengths with iscrowd 1 that are trees because of their keypoints.
        crowds_taken: Run lengths with iscrowd 1 that are trees because the user says so.
        sized: Images whose size is that of their file.
        shared: Images whose file another image has, too.
    """

    outside: list[tuple[int, float, float]] = field(default_factory=list)
    left_out: list[tuple[str, int]] = field(default_factory=list)
    crowds: int = 0
    crowds_with_keypoints: int = 0
    crowds_taken: int = 0
    sized: int = 0
    shared: int = 0

    def notes(self) -> list[str]:
        """Return one message for each kind."""
        notes = [
            f"left out: {count} {LEFT_OUT[kind]}, the first of annotation {self._first(kind)}"
            for kind, count in Counter(kind for kind, _ in self.left_out).items()
        ]
        if self.outside:
            tree, x, y = self.outside[0]
            notes.append(
                f"{len(self.outside)} keypoints are outside their frame and count as not labelled,"
                f" the first at x = {x:.6g}, y = {y:.6g} of annotation {tree}"
            )
        messages = {
            "{} run lengths with iscrowd 1 are taken as trees, as they have keypoints and crowds"
            " have none": self.crowds_with_keypoints,
            "{} run lengths with iscrowd 1 are taken as trees, by --crowds-as-trees": (
                self.crowds_taken
            ),
            "{} run lengths with iscrowd 1 are crowds, neither trained nor counted; CVAT marks each"
            " mask painted with a brush so: --crowds-as-trees takes them as trees": self.crowds,
            "the file has no size of {} pictures: those of the pictures are taken": self.sized,
            "{} images name a picture that another image names, too": self.shared,
        }
        return notes + [text.format(count) for text, count in messages.items() if count]

    def _first(self, wanted: str) -> int:
        return next(number for kind, number in self.left_out if kind == wanted)
