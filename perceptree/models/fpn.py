"""The feature pyramid of Lin et al. (2017), with batch norm after each convolution."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional


def _conv_norm(in_channels: int, width: int, kernel: int) -> nn.Sequential:
    conv = nn.Conv2d(in_channels, width, kernel, padding=kernel // 2, bias=False)
    nn.init.kaiming_uniform_(conv.weight, a=1.0)
    return nn.Sequential(conv, nn.BatchNorm2d(width))


class FeaturePyramid(nn.Module):
    """Maps of one width at every level, each enriched from the coarser ones."""

    def __init__(self, in_channels: tuple[int, ...], width: int) -> None:
        super().__init__()
        self.lateral = nn.ModuleList(_conv_norm(c, width, 1) for c in in_channels)
        self.output = nn.ModuleList(_conv_norm(width, width, 3) for _ in in_channels)

    def forward(self, maps: list[Tensor]) -> list[Tensor]:
        """Backbone maps, finest first -> as many (B, width, h, w)."""
        merged = [lateral(x) for lateral, x in zip(self.lateral, maps, strict=True)]
        for i in range(len(merged) - 1, 0, -1):
            up = functional.interpolate(merged[i], scale_factor=2.0, mode="nearest")
            merged[i - 1] = merged[i - 1] + up
        return [output(x) for output, x in zip(self.output, merged, strict=True)]
