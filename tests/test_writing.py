"""Files on a disk that fills up: whole under their name or not there, said in one line, and no crash."""

import json
import os
import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from sonospline.io import writing

sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
pytest.importorskip("matplotlib", reason="needs the extra 'plot'")

KINDS = (
    *("v.nii", "v.nii.gz", "v.nrrd", "v.nhdr", "v.mha", "v.mhd", "frame.png", "frame.mha"),
    *(
        "u.h5",
        "u.tfm",
        "u.nrrd",
        "u.mha",
        "u.vti",
        "u.npz",
        "warp.h5",
        "figure.png",
        "cine.igs.mha",
        "cine.gif",
        "table.csv",
        "summary.json",
    ),
)

WRITERS = '''
"""Every writer of the package, under a limit on the size of files that stands for a full disk."""
import json, resource, sys
from pathlib import Path
import numpy as np
import sonospline as ss
from sonospline.io.canvas import picture
from sonospline.fields.grid_field import GridField
from sonospline.fields import ImageWarp
from sonospline.io.volumes import write_volume
from sonospline.io.writing import write_json
from sonospline.ultrasound.acoustics import TISSUES, write_table
from sonospline.ultrasound.cine import write_gif, write_sequence
from sonospline.ultrasound.frame import Frame
from sonospline.geometry import ImagePlane
from sonospline.geometry.volume import Volume

folder, shares = Path(sys.argv[1]), json.loads(sys.argv[2])
random = np.random.default_rng(0)
voxels = random.integers(0, 4000, (24, 20, 18)).astype(np.int16)
voxels[:, :, 12:] = 0  # ends in zeros, which a reader that pads would not miss
volume = Volume(voxels=voxels, spacing=(1.0, 1.5, 2.0))
tissue = ss.Tissue(ss.Grid.unit_cube(9), entry_face="x-")
field = ss.Insertion(tissue).advance(ss.Needle((0, 0.45, 0.55), (0.6, 0.5, 0.5)))
warp = ImageWarp.of(field)
plane = ImagePlane.crossing(volume.lattice, normal=(0, 0, 1), through=(10, 10, 10), right=(1, 0, 0))
frame = Frame(random.integers(0, 255, plane.shape).astype(np.uint8), plane)

def figure(path):
    with picture(path, 4, 3) as drawn:
        drawn.subplots().plot(voxels[0, 0])

volumes = ("v.nii", "v.nii.gz", "v.nrrd", "v.nhdr", "v.mha", "v.mhd")
write = {
    **{name: lambda path: write_volume(volume, path) for name in volumes},
    "frame.png": frame.save, "frame.mha": frame.save, "warp.h5": warp.save, "figure.png": figure,
    **{name: field.save for name in ("u.h5", "u.tfm", "u.nrrd", "u.mha", "u.vti", "u.npz")},
    "cine.igs.mha": lambda path: write_sequence([frame] * 3, path),
    "cine.gif": lambda path: write_gif([frame] * 3, path),
    "table.csv": lambda path: write_table(path, enumerate(TISSUES.values())),
    "summary.json": lambda path: write_json(path, {"numbers": list(range(500))}),
}
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
answers = []
for name, writer in write.items():
    writer(folder / name)
    whole = {file.name: file.read_bytes() for file in folder.iterdir()}
    largest = max(map(len, whole.values()))
    for share in shares:
        for file in folder.iterdir():
            file.write_bytes(b"earlier")
        limit = max(0, largest - 1 if share == 1 else int(share * largest))
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        try:
            writer(folder / name)
            said = None
        except OSError as error:
            said = str(error)
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
        left = {file.name: file.read_bytes() for file in folder.iterdir()}
        kept = left == dict.fromkeys(whole, b"earlier")
        answers.append([name, limit, largest, said, kept, len(left) == len(whole)])
    for file in folder.iterdir():
        file.unlink()
print(json.dumps(answers))
'''


def under_limits(folder, shares):
    command = [sys.executable, "-c", WRITERS, str(folder), json.dumps(shares)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=1000)
    assert done.returncode == 0, done.stderr  # a library that crashes at exit counts
    assert done.stderr == ""
    answers = json.loads(done.stdout)
    assert {name for name, *_ in answers} == set(KINDS)
    for name, limit, largest, said, kept, nothing_else in answers:
        where = f"{name} under a limit of {limit} of {largest} bytes"
        assert said is not None, f"{where}: was written"
        assert kept and nothing_else, f"{where}: the earlier file is not as it was"
        assert said.startswith(name) and "could not be written whole" in said and "\n" not in said, where


@pytest.mark.slow
def test_no_writer_leaves_half_a_file_or_touches_the_earlier_one(tmp_path):
    under_limits(tmp_path, [0, 0.5, 1])


@pytest.mark.slow
def test_no_writer_leaves_half_a_file_under_any_limit(tmp_path):
    under_limits(tmp_path, [*np.linspace(0, 1, 60), *(1 - np.geomspace(1e-5, 0.1, 20))])


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".png"])
def test_what_is_not_whole_is_seen(suffix, tmp_path):
    """A file cut by one byte, or with one byte changed, is not what was meant."""
    voxels = np.random.default_rng(0).integers(0, 255, (9, 8, 7) if suffix != ".png" else (9, 8)).astype(np.uint8)
    voxels[-1] = 0
    image, path = sitk.GetImageFromArray(voxels), tmp_path / f"v{suffix}"
    writing.write_image(image, path)
    writing._compare(path, sitk.GetArrayViewFromImage(image))
    data = max(tmp_path.iterdir(), key=lambda file: file.stat().st_size)
    whole = data.read_bytes()
    for damaged in (whole[:-1], whole[: len(whole) // 2], whole[:-40] + bytes([whole[-40] ^ 1]) + whole[-39:]):
        data.write_bytes(damaged)
        with pytest.raises((ValueError, EOFError, OSError, RuntimeError)):
            writing._compare(path, sitk.GetArrayViewFromImage(image))


def test_threads_that_write_at_once_leave_stderr_as_it_was(tmp_path):
    """Image libraries are kept silent while they write; each thread has images of its own, for SimpleITK's are copied
    when somebody looks at their voxels."""
    before = os.fstat(2).st_ino

    def write(k):
        writing.write_image(sitk.GetImageFromArray(np.ones((5, 6, 7), np.int16)), tmp_path / f"{k}.nii")

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write, range(40)))
    assert os.fstat(2).st_ino == before
    assert len(list(tmp_path.iterdir())) == 40


def test_an_image_with_its_data_in_another_file_names_it(tmp_path):
    image = sitk.GetImageFromArray(np.ones((5, 6, 7), np.int16))
    for name in ("v.mhd", "w.nhdr"):
        writing.write_image(image, tmp_path / name)
        assert np.array_equal(sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / name))), np.ones((5, 6, 7)))
    assert len(list(tmp_path.iterdir())) == 4


def test_the_transform_is_the_one_itk_itself_would_write(a_deformed_field, tmp_path):
    from sonospline.fields import ImageWarp

    warp = ImageWarp.of(a_deformed_field)
    warp.save(tmp_path / "ours.h5")
    sitk.WriteTransform(warp.to_sitk(), str(tmp_path / "itk.h5"))
    ours, theirs = (sitk.ReadTransform(str(tmp_path / name)) for name in ("ours.h5", "itk.h5"))
    assert ours.GetName() == theirs.GetName()
    assert ours.GetFixedParameters() == theirs.GetFixedParameters()
    assert ours.GetParameters() == theirs.GetParameters()


VERBS = {
    "insert": ["insert", "--nodes", "2000", "--steps", "2"],
    "insert .nii": ["insert", "--nodes", "2000", "--steps", "2", "--entry", "0,30,42", "--target", "62,44,42"],
    "image": ["image", "--voxel", "2", "--nodes", "4000", "--cine", "2", "--depth", "60"],
    "tune": ["tune", "--side", "9", "--steps", "1", "--population", "4", "--generations", "1", "--workers", "1"],
}


def command_of(name, folder):
    arguments = list(VERBS[name])
    if name.endswith(".nii"):
        from sonospline.geometry.layered_block import layered_block
        from sonospline.io.volumes import write_volume

        if not (folder / "block.nii").exists():
            write_volume(layered_block(), folder / "block.nii")
        arguments += ["--volume", str(folder / "block.nii")]
    return [sys.executable, "-m", "sonospline", *arguments, "--quiet"]


def ran_whole_or_not_at_all(done, out, files):
    """Whether a run says what it left: everything with exit code 0, or nothing with 1 and one line."""
    left = sorted(file.name for file in out.iterdir()) if out.exists() else []
    if done.returncode == 0:
        assert left == files == json.loads((out / "summary.json").read_text())["files"]
    else:
        assert done.returncode == 1, done.stderr
        assert left == []
        assert done.stderr.count("\n") == 1, done.stderr
        assert done.stdout == ""
    return done.returncode == 0


def run_limited(name, folder, limit):
    environment = {**os.environ, "SONOSPLINE_CACHE": str(folder / "cache")}
    out = folder / f"out{limit}"
    return out, subprocess.run(
        [*command_of(name, folder), "--out", str(out)], capture_output=True, text=True, check=False, env=environment,
        preexec_fn=lambda: limit is None or resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )  # fmt: skip


def each_limit(name, folder, shares):
    """Run a verb without a limit, then under limits that are shares of its largest file."""
    out, done = run_limited(name, folder, None)
    assert done.returncode == 0, done.stderr
    sizes = {file.name: file.stat().st_size for file in out.iterdir()}
    outcomes = [
        ran_whole_or_not_at_all(done, out, sorted(sizes))
        for out, done in (run_limited(name, folder, int(share * max(sizes.values()))) for share in shares)
    ]
    assert outcomes[-1], "more than the largest file is enough"
    assert not all(outcomes)


@pytest.mark.slow
def test_a_verb_on_a_full_disk_leaves_nothing_and_says_so_in_one_line(tmp_path):
    command_of("insert .nii", tmp_path)  # makes the input, which is as large as what is written
    out, done = run_limited("insert .nii", tmp_path, (tmp_path / "block.nii").stat().st_size - 1)
    assert not ran_whole_or_not_at_all(done, out, [])
    assert "warped.nii could not be written whole" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", VERBS)
def test_a_verb_under_every_limit_is_whole_or_not_there(name, tmp_path):
    each_limit(name, tmp_path, [0, 1e-3, 0.02, 0.3, 0.6, 0.9, 0.9999, 1.5])


@pytest.fixture
def small_disk(tmp_path):
    """A function that mounts a disk of so many bytes; skips where that is not allowed."""
    mounted = []

    def mount(size):
        folder = tmp_path / f"disk{len(mounted)}"
        folder.mkdir()
        options = ["-t", "tmpfs", "-o", f"size={size},nr_inodes=100", "none", str(folder)]
        if subprocess.run(["mount", *options], capture_output=True, check=False).returncode:
            pytest.skip("mounting a small disk is not allowed here")
        mounted.append(folder)
        return folder

    yield mount
    for folder in mounted:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", VERBS)
def test_a_verb_on_small_disks_is_whole_or_not_there(name, tmp_path, small_disk):
    out, done = run_limited(name, tmp_path, None)
    files = sorted(file.name for file in out.iterdir())
    whole = sum(file.stat().st_size for file in out.iterdir())
    outcomes = []
    for share in (0.02, 0.4, 0.95, 1.05, 4):
        disk = small_disk(max(4096, int(share * whole)))
        environment = {**os.environ, "SONOSPLINE_CACHE": str(tmp_path / "cache")}
        command = [*command_of(name, tmp_path), "--out", str(disk / "out")]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        outcomes.append(ran_whole_or_not_at_all(done, disk / "out", files))
    assert outcomes[-1] and not outcomes[0]
    assert not list(Path(tmp_path).rglob(".partial-*"))
