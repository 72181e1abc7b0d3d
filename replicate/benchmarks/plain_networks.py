"""The networks' training step as one would write it first, in plain torch: what ours is compared with."""

import torch
from jaxtyping import Float
from torch import nn
from torch.nn import functional

from replicate.approximation.cnn import MapNetwork
from replicate.approximation.deformation_map import sample
from replicate.approximation.losses import FacialLoss, reference_loss
from replicate.timing.plain_evaluation import read_full_maps


class FullMaps(nn.Module):
    """A `MapNetwork` as in Fig. 3, layer by layer: maps in full, which the vertices then read."""

    def __init__(self, network: MapNetwork):
        super().__init__()
        self.network = network

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return read_full_maps(self.network, params)


class Rewritten(nn.Module):
    """The same with our exact rewrites (DEVIATIONS D14) and torch's own layers: no compiled kernel.

    Upsampling and the 3×3 convolution after it are one transposed convolution of stride 2, and the vertices read the
    features before the last 1×1 convolution.
    """

    def __init__(self, network: MapNetwork):
        super().__init__()
        self.network = network
        spread = torch.tensor([[1.0, 0, 0], [1, 1, 0], [0, 1, 1], [0, 0, 1]])  # 4×4 taps of 3×3 ones, along an axis
        self.register_buffer("spread", spread, persistent=False)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        network = self.network
        x = network._start(params).permute(0, 3, 1, 2)
        for layer in network.upsampled:
            taps = torch.einsum("pr,qs,oirs->iopq", self.spread, self.spread, layer.weight.flip(2, 3))
            x = functional.conv_transpose2d(x, taps, layer.bias, stride=2, padding=1)
            x = functional.leaky_relu(x, network.slope)
        features = functional.leaky_relu(network.last(x), network.slope).permute(0, 2, 3, 1)
        read = sample(features, network.pixels, network.shares)
        return functional.linear(read, network.output.weight[:, :, 0, 0], network.output.bias)


class PlainLoss:
    """Eq. 1 in plain torch, with the numbers of a `FacialLoss`."""

    def __init__(self, loss: FacialLoss):
        self.neutral, self.faces = torch.from_numpy(loss.neutral), torch.from_numpy(loss.faces).long()
        self.numbers = (loss.normal_weight, loss.vertex_count, loss.face_count)

    def __call__(self, offsets: Float[torch.Tensor, "b n 3"], target: Float[torch.Tensor, "b n 3"]) -> torch.Tensor:
        return reference_loss(self.neutral + offsets, self.neutral + target, self.faces, *self.numbers)
