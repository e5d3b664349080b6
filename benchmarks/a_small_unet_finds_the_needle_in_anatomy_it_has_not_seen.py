"""A small U-Net that segments the needle, trained on a data set of drawn blocks, judged on anatomies it has not seen.

Claim: Dice of at least 0.7 over the test split, after less than ten minutes of training on two processors from 5,000
samples: the labels are where the images are.

    python benchmarks/a_small_unet_finds_the_needle_in_anatomy_it_has_not_seen.py [samples] [folder]

Makes the data set in the folder first, or what is missing of it; by default 5,000 samples in a folder of its own. Needs
PyTorch. Ends with 1 where the claim is missed.
"""

import sys
import tempfile
import time

import torch
from torch import nn

from sonospline.dataset import DataSet, Specification, make_dataset, torch_samples

TEXT = """
name = "Echogenic needles in drawn blocks"
samples = {samples}
seed = 20
[[sources]]
kind = "block"
[anatomy]
samples = 50
[view]
samples = 25
sweep_mm = [-0.5, 0.5]
[target]
off_mm = [0, 1]
[needle]
look = "echogenic-2mm"
angle_deg = [15, 55]
swing_deg = [-2, 2]
[stored]
displacement = false
"""
EPOCHS, BATCH, LEAST, MOST_S = 4, 16, 0.7, 600.0


def block(channels_in, channels):
    layers = [nn.Conv2d(channels_in, channels, 3, padding=1), nn.BatchNorm2d(channels), nn.ReLU()]
    return nn.Sequential(*layers, nn.Conv2d(channels, channels, 3, padding=1), nn.BatchNorm2d(channels), nn.ReLU())


class UNet(nn.Module):
    """Four levels below a stem that halves the image; some 120,000 weights."""

    def __init__(self, widths=(8, 16, 32, 48)):
        super().__init__()
        self.stem = nn.Conv2d(1, widths[0], 4, stride=2, padding=1)
        self.down = nn.ModuleList(block(a, b) for a, b in zip((widths[0], *widths), widths, strict=False))
        self.up = nn.ModuleList(block(a + b, b) for a, b in zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.head = nn.ConvTranspose2d(widths[0], 1, 4, stride=2, padding=1)

    def forward(self, image):
        x, kept = self.stem(image), []
        for level, layer in enumerate(self.down):
            x = layer(x if level == 0 else nn.functional.max_pool2d(x, 2))
            kept.append(x)
        kept.pop()
        for layer in self.up:
            x = layer(torch.cat([nn.functional.interpolate(x, scale_factor=2), kept.pop()], 1))
        return self.head(x)[:, 0]


def batches(data, split, shuffle=None):
    for batch in torch.utils.data.DataLoader(torch_samples(data, split, ["image", "needle"], shuffle=shuffle), BATCH):
        yield batch["image"][:, None].float() / 255 - 0.3, batch["needle"].float()


def loss_of(logits, shaft):
    sure = torch.sigmoid(logits)
    dice = (2 * (sure * shaft).sum() + 1) / (sure.sum() + shaft.sum() + 1)
    return nn.functional.binary_cross_entropy_with_logits(logits, shaft) + 1 - dice


def trained(data):
    torch.manual_seed(0)
    net = UNet()
    optimiser = torch.optim.AdamW(net.parameters(), 3e-3)
    for epoch in range(EPOCHS):
        for group in optimiser.param_groups:
            group["lr"] = 3e-3 * 0.4**epoch
        for image, shaft in batches(data, "train", shuffle=epoch):
            optimiser.zero_grad()
            loss_of(net(image), shaft).backward()
            optimiser.step()
    return net.eval()


@torch.no_grad()
def dice(net, data, split):
    """Over all pixels of a split."""
    both = ours = true = 0.0
    for image, shaft in batches(data, split):
        found = net(image) > 0
        both, ours, true = both + float((found * shaft).sum()), ours + float(found.sum()), true + float(shaft.sum())
    return 2 * both / (ours + true)


def main(samples, folder):
    torch.set_num_threads(2)
    make_dataset(Specification.parse(TEXT.format(samples=samples)), folder)
    data = DataSet(folder)
    began = time.perf_counter()
    net = trained(data)
    seconds = time.perf_counter() - began
    found = dice(net, data, "test")
    print(f"{samples:,} samples, {data.manifest['splits']}, {sum(p.numel() for p in net.parameters()):,} weights")
    print(f"training {seconds:6.0f} s     at most {MOST_S:.0f}")
    print(f"Dice     {found:6.3f}       at least {LEAST}   (train {dice(net, data, 'train'):.3f})")
    return found < LEAST or seconds > MOST_S


if __name__ == "__main__":
    asked = int(sys.argv[1]) if sys.argv[1:] else 5000
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(main(asked, sys.argv[2] if sys.argv[2:] else folder))
