"""Network heads for pooled regions: box, mask and keypoints (He et al. 2017, Mask R-CNN)."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.models.spec import CLASS_NAMES

# RoIAlign output of the box head, and of the mask and keypoint heads.
BOX_CELLS = 7
ROI_CELLS = 14
# Weights of the box offsets in ``boxes.encode_boxes``; Detectron2's values.
BOX_WEIGHTS = (10.0, 10.0, 5.0, 5.0)


class BoxHead(nn.Module):
    """Two fully connected layers that classify a region and refine its box."""

    def __init__(self, in_channels: int, width: int) -> None:
        super().__init__()
        hidden = (nn.Linear(in_channels * BOX_CELLS**2, width), nn.Linear(width, width))
        self.hidden = nn.ModuleList(hidden)
        self.score = nn.Linear(width, len(CLASS_NAMES) + 1)
        self.shift = nn.Linear(width, 4 * len(CLASS_NAMES))
        for layer in hidden:
            nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu")
        nn.init.normal_(self.score.weight, std=0.01)
        nn.init.normal_(self.shift.weight, std=0.001)
        for linear in (*hidden, self.score, self.shift):
            nn.init.zeros_(linear.bias)

    def forward(self, regions: Tensor) -> tuple[Tensor, Tensor]:
        """Classify regions.

        Args:
            regions: (R, C, 7, 7) pooled features.

        Returns:
            Logits (R, 2) of tree and background, and box offsets (R, 4), both float32.
        """
        x = regions.flatten(1)
        for layer in self.hidden:
            x = functional.relu(layer(x), inplace=True)
        return self.score(x).float(), self.shift(x).float()

    def scale_scores(self, slope: float, offset: float) -> None:
        """Change the weights so that logit(new score) = slope * logit(old score) + offset."""
        self.score.weight.data.mul_(slope)
        self.score.bias.data.mul_(slope)
        self.score.bias.data[0] += offset


class RegionTower(nn.Module):
    """3x3 convolutions with ReLU, then a transposed convolution that doubles the resolution.

    Args:
        in_channels: Channels of the pooled features.
        widths: Channels of the 3x3 convolutions.
        out_channels: Channels of the transposed convolution.
        kernel: Kernel size of the transposed convolution, 2 or 4.
    """

    def __init__(
        self, in_channels: int, widths: tuple[int, ...], out_channels: int, kernel: int
    ) -> None:
        super().__init__()
        inputs = (in_channels, *widths[:-1])
        self.convs = nn.ModuleList(
            nn.Conv2d(a, b, 3, padding=1) for a, b in zip(inputs, widths, strict=True)
        )
        self.up = nn.ConvTranspose2d(
            widths[-1], out_channels, kernel, stride=2, padding=kernel // 2 - 1
        )
        for layer in (*self.convs, self.up):
            nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")
            nn.init.zeros_(layer.bias)

    def forward(self, regions: Tensor) -> Tensor:
        """Map (R, C, 14, 14) to (R, out_channels, 28, 28)."""
        x = regions
        for layer in self.convs:
            x = functional.relu(layer(x), inplace=True)
        doubled: Tensor = self.up(x)
        return doubled


class MaskHead(nn.Module):
    """Predicts the visible pixels of the stem inside its box."""

    def __init__(self, in_channels: int, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.tower = RegionTower(in_channels, widths, widths[-1], kernel=2)
        self.score = nn.Conv2d(widths[-1], len(CLASS_NAMES), 1)
        nn.init.normal_(self.score.weight, std=0.01)
        nn.init.zeros_(self.score.bias)  # type: ignore[arg-type]

    def forward(self, regions: Tensor) -> Tensor:
        """Map (R, C, 14, 14) to logits (R, 28, 28) float32."""
        logits: Tensor = self.score(functional.relu(self.tower(regions), inplace=True))
        return logits[:, 0].float()


class KeypointHead(nn.Module):
    """Predicts one heat map per keypoint over the enlarged box."""

    def __init__(self, in_channels: int, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.tower = RegionTower(in_channels, widths, len(KEYPOINT_NAMES), kernel=4)
        nn.init.normal_(self.tower.up.weight, std=0.001)

    def forward(self, regions: Tensor) -> Tensor:
        """Map (R, C, 14, 14) to logits (R, 5, 56, 56) float32."""
        maps = self.tower(regions).float()
        return functional.interpolate(maps, scale_factor=2.0, mode="bilinear")
