"""Damaged image files, and a reader in a process of its own that may hang or die without harm."""

import gzip
import json
import select
import struct
import subprocess
import sys

import numpy as np

from sonospline._extras import require
from sonospline.geometry.volume import Volume
from sonospline.io.volumes import to_sitk

FORMATS = ("raw.mha", "packed.mha", "apart.mhd", "raw.nrrd", "packed.nrrd", "apart.nhdr", "plain.nii", "packed.nii.gz")
HOSTILE = (
    "-1", "0", "4294967297", "18446744073709551615", "9223372036854775808", "99999999999999999999999", "2147483648",
    "1e308", "-1e308", "1e160", "1e-320", "nan", "inf", "-inf", "1e999", "0x7fffffff", "", "%d", "%s%n", "LIST",
    "LOCAL", "/dev/zero", "../..", "True", "(1,0", "none", "1_0",
)  # fmt: skip
HOSTILE += (
    '"mm" ' * 300,
    '"' + "m" * 5000,
    "1 " * 500,
    "(" * 300,
    "(1,0,0) " * 40,
    "9" * 400,
    "a" * 40_000,
    "domain " * 99,
)
KEYS = (
    "NDims", "DimSize", "ElementType", "TransformMatrix", "HeaderSize", "CompressedData", "CompressedDataSize",
    "ElementNumberOfChannels", "ElementSpacing", "ElementSize", "Position", "CenterOfRotation", "ElementMin", "Name",
    "Comment", "ObjectSubType", "Color", "ID", "AnatomicalOrientation", "DistanceUnits", "Modality", "ImagePosition",
    "SequenceID", "sizes", "dimension", "space directions", "byte skip", "line skip", "type", "encoding", "spacings",
    "space origin", "measurement frame", "data file", "endian", "units", "labels", "kinds", "centers", "thicknesses",
    "axis mins", "axis maxs", "content", "space units", "sample units", "space dimension", "number", "block size",
    "min", "old max",
)  # fmt: skip
_NIFTI_FIELDS = [("h", 40 + 2 * k) for k in range(8)] + [("f", 76 + 4 * k) for k in range(8)]
_NIFTI_FIELDS += [
    ("h", 70),
    ("h", 72),
    ("f", 108),
    ("f", 112),
    ("f", 116),
    ("h", 252),
    ("h", 254),
    ("i", 0),
    ("i", 344),
]
_NIFTI_FIELDS += [("f", 256 + 4 * k) for k in range(18)] + [("i", 344), ("i", 348), ("i", 352), ("b", 123)]
_WORKER = """
import json, resource, sys
import numpy as np
from sonospline.io.volumes import read_volume
from sonospline.ultrasound.frame import Frame
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
read = [read_volume, lambda path: Frame.read(path, image_to_reference=np.eye(4), spacing_mm=1.0)]
print("ready", flush=True)
for line in sys.stdin:
    path, answers = json.loads(line), []
    for reader in read:
        try:
            reader(path)
            answers.append(["read", ""])
        except ValueError as error:
            answers.append(["refused", str(error)])
        except BaseException as error:
            answers.append([type(error).__name__, str(error)])
    print(json.dumps(answers), flush=True)
"""


class Reader:
    """Reads files in another process; one that hangs or dies is told of and made anew."""

    def __init__(self, limit_s=20.0):
        self.limit_s, self.process = limit_s, None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._end()

    def read(self, path):
        """Return what each reader made of a file, or what became of the process."""
        if self.process is None:
            command = [sys.executable, "-c", _WORKER]
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            self.process = subprocess.Popen(command, text=True, **pipes)
            assert self._line(60) == "ready\n"
        self.process.stdin.write(json.dumps(str(path)) + "\n")
        self.process.stdin.flush()
        answer = self._line(self.limit_s)
        if answer:
            return json.loads(answer)
        died = self.process.poll() is not None or answer == ""
        self._end()
        return [["died" if died else "hung", ""]]

    def _line(self, limit_s):
        ready, _, _ = select.select([self.process.stdout], [], [], limit_s)
        return self.process.stdout.readline() if ready else None

    def _end(self):
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
            self.process = None


def write_samples(folder):
    """Write one sound file of each format."""
    voxels = np.random.default_rng(0).integers(0, 4000, (9, 8, 7)).astype(np.int16)
    turned = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    volume = Volume(voxels=voxels, spacing=(1.0, 1.5, 2.0), origin=np.array([3.0, -4, 5]), direction=turned)
    for name in FORMATS:
        require("SimpleITK").WriteImage(to_sitk(volume), str(folder / name), useCompression=name.startswith("packed"))


def damaged(content, name, rng):
    """Return the bytes of a sound file, damaged in one of many ways, and what was done."""
    ways = [_flip, _cut, _insert, _drop, _hostile, _hostile, _hostile, _lines, _key]
    way = ways[rng.integers(len(ways))]
    if way is not _cut and name.endswith(".gz") and rng.random() < 0.8:
        return gzip.compress(way(gzip.decompress(content), "plain.nii", rng), 1), way.__name__
    return way(content, name, rng), way.__name__


def _header_length(content, name):
    if name.endswith((".nii", ".gz")):
        return min(len(content), 352)
    for mark in (b"LOCAL\n", b"\n\n"):
        if mark in content:
            return content.index(mark) + len(mark)
    return len(content)


def _flip(content, name, rng):
    spoilt = bytearray(content)
    for _ in range(rng.integers(1, 9)):
        spoilt[rng.integers(_header_length(content, name))] = rng.integers(256)
    return bytes(spoilt)


def _cut(content, name, rng):
    return content[: rng.integers(len(content))]


def _insert(content, name, rng):
    at = int(rng.integers(_header_length(content, name)))
    return content[:at] + rng.bytes(int(rng.integers(1, 40))) + content[at:]


def _drop(content, name, rng):
    at = int(rng.integers(_header_length(content, name)))
    return content[:at] + content[at + int(rng.integers(1, 40)) :]


def _hostile(content, name, rng):
    if name.endswith((".nii", ".gz")):
        spoilt = bytearray(content)
        for _ in range(rng.integers(1, 4)):
            code, at = _NIFTI_FIELDS[rng.integers(len(_NIFTI_FIELDS))]
            if code == "f":
                value = rng.choice([np.nan, np.inf, -np.inf, 1e38, -1e38, 1e-38, 0.0, -1.0, 353.0, 1e10])
            else:
                bits = 8 * struct.calcsize(code) - 1
                value = int(rng.choice([-1, 0, 1, 7, 8, 127, -(2**bits), 2**bits - 1, int(rng.integers(0, 2**bits))]))
            struct.pack_into("<" + code, spoilt, at, value)
        return bytes(spoilt)
    return _changed_line(content, name, rng, lambda words: _one_replaced(words, rng))


def _one_replaced(words, rng):
    separators = [k for k, word in enumerate(words) if word in (b"=", b":") or word.endswith(b":")]
    values = range(separators[0] + 1 if separators else 0, len(words))
    if len(values):
        words[rng.choice(values)] = HOSTILE[rng.integers(len(HOSTILE))].encode()
    return words


def _changed_line(content, name, rng, change):
    end = _header_length(content, name)
    lines = content[:end].split(b"\n")
    k = int(rng.integers(len(lines)))
    lines[k] = b" ".join(change(lines[k].split(b" ")))
    return b"\n".join(lines) + content[end:]


def _lines(content, name, rng):
    end = _header_length(content, name)
    lines = content[:end].split(b"\n")
    a, b = rng.integers(len(lines), size=2)
    if rng.random() < 0.5:
        lines.insert(a, lines[b])
    else:
        lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines) + content[end:]


def _key(content, name, rng):
    key, value = KEYS[rng.integers(len(KEYS))], HOSTILE[rng.integers(len(HOSTILE))]
    line = f"{key} = {value}" if "m" in name.rpartition(".")[2] else f"{key}: {value}"
    end = _header_length(content, name)
    lines = content[:end].split(b"\n")
    lines.insert(int(rng.integers(1, len(lines))) if len(lines) > 1 else 0, line.encode())
    return b"\n".join(lines) + content[end:]
