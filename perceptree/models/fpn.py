"""The feature pyramid network of Lin et al. (2017)."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional


def _convolution(in_channels: int, width: int, kernel: int, norm: bool) -> nn.Module:
    conv = nn.Conv2d(in_channels, width, kernel, padding=kernel // 2, bias=not norm)
    nn.init.kaiming_uniform_(conv.weight, a=1.0)
    if norm:
        return nn.Sequential(conv, nn.BatchNorm2d(width))
    nn.init.zeros_(conv.bias)  # type: ignore[arg-type]
    return conv


class FeaturePyramid(nn.Module):
    """Combine the backbone's maps top-down into maps of equal width.

    Args:
        in_channels: Channels of the backbone's maps, finest first.
        width: Channels of every output map.
        norm: Use batch norm after each convolution, in place of a bias.
        level_6: Add a level: the coarsest map subsampled by 2.
    """

    def __init__(self, in_channels: tuple[int, ...], width: int, norm: bool, level_6: bool) -> None:
        super().__init__()
        self.lateral = nn.ModuleList(_convolution(c, width, 1, norm) for c in in_channels)
        self.output = nn.ModuleList(_convolution(width, width, 3, norm) for _ in in_channels)
        self.upsample = nn.Upsample(scale_factor=2.0, mode="nearest")
        self.level_6 = level_6

    def forward(self, maps: list[Tensor], lateral: bool = False) -> list[Tensor]:
        """Map the backbone's maps, finest first, to one (B, width, h, w) map per level.

        Args:
            maps: The maps.
            lateral: Whether they have been through `laterals`.
        """
        merged = list(maps) if lateral else self.laterals(maps)
        for i in range(len(merged) - 1, 0, -1):
            merged[i - 1] = merged[i - 1] + self.upsample(merged[i])
        made = [output(x) for output, x in zip(self.output, merged, strict=True)]
        if self.level_6:
            made.append(functional.max_pool2d(made[-1], kernel_size=1, stride=2))
        return made

    def laterals(self, maps: list[Tensor]) -> list[Tensor]:
        """Map the backbone's maps, finest first, to maps of the pyramid's width."""
        return [lateral(x) for lateral, x in zip(self.lateral, maps, strict=True)]
