"""The kernels' gradients equal torch's for any number of threads."""

from collections.abc import Iterator
from typing import Any

import pytest
import torch
from torch import nn
from torch.nn import functional

from perceptree.models.backbones import DepthwiseConv
from perceptree.models.cpu_gradients import depthwise_conv, weighted_sums


@pytest.fixture(params=[1, 2])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


@pytest.mark.parametrize("layout", [torch.channels_last, torch.contiguous_format])
@pytest.mark.parametrize(("channels", "side", "stride"), [(5, 3, 1), (32, 5, 2), (17, 5, 1)])
def test_a_depthwise_convolution_has_torchs_gradients(
    threads: int, channels: int, side: int, stride: int, layout: torch.memory_format
) -> None:
    torch.manual_seed(0)
    x = torch.randn(2, channels, 11, 14).to(memory_format=layout).requires_grad_()
    weight = torch.randn(channels, 1, side, side, requires_grad=True)
    wanted = functional.conv2d(x, weight, None, stride, side // 2, groups=channels)
    found = depthwise_conv(x, weight, stride, side // 2)
    assert torch.equal(found, wanted)
    chosen = torch.randn(found.shape)
    expected = torch.autograd.grad((wanted * chosen).sum(), [x, weight])
    for ours, torchs in zip(
        torch.autograd.grad((found * chosen).sum(), [x, weight]), expected, strict=True
    ):
        torch.testing.assert_close(ours, torchs, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize(
    "changes",
    [
        {"kernel_size": (1, 3), "padding": (0, 1)},
        {"stride": (1, 2)},
        {"dilation": 2},
        {"bias": True},
        {"padding": 0},
        {"padding_mode": "reflect"},
        {"out_channels": 8},
    ],
)
def test_any_depthwise_module_has_torchs_gradients(changes: dict[str, Any]) -> None:
    torch.manual_seed(0)
    settings: dict[str, Any] = {
        "out_channels": 4,
        "kernel_size": 3,
        "padding": 1,
        "groups": 4,
        "bias": False,
    }
    ours = DepthwiseConv(4, **settings | changes)
    torchs = nn.Conv2d(4, **settings | changes)
    torchs.load_state_dict(ours.state_dict())
    x = torch.randn(2, 4, 9, 8)
    for conv in (ours, torchs):
        conv(x).square().sum().backward()
    for name, parameter in ours.named_parameters():
        torch.testing.assert_close(parameter.grad, torchs.get_parameter(name).grad)


def test_weighted_sums_have_torchs_gradients(threads: int) -> None:
    torch.manual_seed(0)
    rows = torch.randn(40, 7, requires_grad=True)
    row_indices, weights = torch.randint(40, (60,)), torch.rand(60)
    starts = torch.tensor([0, 0, 12, 30, 60])  # two empty sums
    chosen = torch.randn(5, 7)
    ends = [*starts.tolist()[1:], 60]
    parts = [
        (rows[row_indices[a:b]] * weights[a:b, None]).sum(0)
        for a, b in zip(starts.tolist(), ends, strict=True)
    ]
    (wanted,) = torch.autograd.grad((torch.stack(parts) * chosen).sum(), rows)
    found = weighted_sums(rows, row_indices, starts, weights)
    torch.testing.assert_close(found, torch.stack(parts))
    torch.testing.assert_close(torch.autograd.grad((found * chosen).sum(), rows)[0], wanted)
