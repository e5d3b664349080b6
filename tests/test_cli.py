"""The command line as a user meets it: outputs, messages, exit codes, and nothing left behind."""

import contextlib
import io
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from builds import run_without
from sonospline import cli
from sonospline.geometry.layered_block import layered_block
from sonospline.geometry.volume import Volume
from sonospline.io.volumes import read_volume, to_sitk, write_volume

sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")

DATA = Path(__file__).parents[2] / "shared" / "data"
OUTPUTS = ["displacement.h5", "displacement.vti", "figure.png", "summary.json"]
SMALL = ["--nodes", "3000", "--steps", "3", "--quiet"]


@pytest.fixture(scope="module")
def volume_file(tmp_path_factory):
    """A small oblique-free volume on disk, 40 x 32 x 32 mm."""
    block = layered_block()
    path = tmp_path_factory.mktemp("input") / "block.nrrd"
    write_volume(
        Volume(voxels=block.voxels[::4, ::4, ::4], spacing=(1.25, 1.0, 1.0), origin=np.array([5.0, 6, 7])), path
    )
    return path


def insert(*arguments):
    return cli.main(["insert", *map(str, arguments)])


def test_without_a_volume_it_runs_on_the_phantom(tmp_path, capsys):
    assert insert("--out", tmp_path / "out", "--json", *SMALL) == 0
    printed = json.loads(capsys.readouterr().out)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [*OUTPUTS, "warped.nrrd"]
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert written == printed
    assert printed["volume"] == "phantom"
    assert printed["anchors"] == 89
    assert 0 < printed["landmarks"] <= 300
    assert printed["max_displacement_mm"] == pytest.approx(0.0266 * 83.25, rel=0.02)
    assert 0.5 < printed["smallest_det_jacobian"] < 1
    assert printed["inverse"]["unconverged_nodes"] == 0
    assert printed["nodes"] == np.prod(printed["grid_shape"])
    assert printed["versions"]["numpy"] == np.__version__
    assert printed["step_ms"]["median"] <= printed["step_ms"]["p95"]


def test_the_written_transform_gives_the_written_image(volume_file, tmp_path):
    assert insert("--volume", volume_file, "--entry", "5,20,22", "--target", "30,22,22", "--out", tmp_path, *SMALL) == 0
    image = to_sitk(read_volume(volume_file))
    transform = sitk.ReadTransform(str(tmp_path / "displacement.h5"))
    ours = sitk.ReadImage(str(tmp_path / "warped.nrrd"))
    resampled = sitk.GetArrayFromImage(sitk.Resample(image, image, transform, sitk.sitkLinear))
    inner = (slice(3, -3),) * 3
    difference = resampled[inner].astype(int) - sitk.GetArrayFromImage(ours)[inner]
    assert np.abs(difference).max() <= 1
    assert ours.GetSpacing() == image.GetSpacing()
    assert ours.GetOrigin() == image.GetOrigin()
    assert ours.GetPixelID() == image.GetPixelID()
    assert (sitk.GetArrayFromImage(ours) != sitk.GetArrayFromImage(image)).mean() > 0.2


@pytest.mark.slow
def test_the_three_frames_name_the_same_needle(volume_file, tmp_path):
    volume = read_volume(volume_file)
    entry, target = np.array([[5.0, 20, 22], [30.0, 22, 22]])
    points = {
        "RAS": (entry, target),
        "LPS": (entry * [-1, -1, 1], target * [-1, -1, 1]),
        "IJK": volume.index(np.stack([entry, target])),
    }
    reported = []
    for frame, (a, b) in points.items():
        where = [
            "--frame",
            frame,
            "--entry",
            ",".join(map(repr, map(float, a))),
            "--target",
            ",".join(map(repr, map(float, b))),
        ]
        assert insert("--volume", volume_file, *where, "--out", tmp_path / frame, *SMALL) == 0
        summary = json.loads((tmp_path / frame / "summary.json").read_text())
        reported.append(summary["entry_ras_mm"] + summary["target_ras_mm"])
    assert np.allclose(reported, [*entry, *target])


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits(tmp_path):
    for name in ("a", "b"):
        assert insert("--out", tmp_path / name, "--seed", 7, *SMALL) == 0
    assert insert("--out", tmp_path / "c", "--seed", 8, *SMALL) == 0
    images = [read_volume(tmp_path / name / "warped.nrrd").voxels for name in "abc"]
    assert np.array_equal(images[0], images[1])
    assert not np.array_equal(images[0], images[2])


def test_parameters_come_from_a_file_and_from_the_command_line(tmp_path, capsys):
    (tmp_path / "model.toml").write_text("shaft_displacement = 1.0\ntip_displacement = 1.5\n")
    options = ["--parameters", tmp_path / "model.toml", "--set", "tip_displacement=3"]
    assert insert(*options, "--out", tmp_path / "out", "--json", *SMALL) == 0
    model = json.loads(capsys.readouterr().out)["model_mm"]
    assert model["shaft_displacement"] == 1.0
    assert model["tip_displacement"] == 3.0
    assert model["shaft_radius"] == pytest.approx(ss.NeedleTissueModel.paper(83.25).shaft_radius)


@pytest.mark.slow
def test_the_moving_mesh_reading_runs(tmp_path, capsys):
    assert insert("--accumulation", "incremental", "--kernel", "triharmonic", "--out", tmp_path, "--json", *SMALL) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["accumulation"] == "incremental"
    assert summary["max_displacement_mm"] > 0.1


BAD = {
    "entry outside": (["--entry", "-1,30,42", "--target", "62,44,42"], "entry = [-1.0, 30.0, 42.0] lies outside"),
    "target outside": (["--entry", "0,30,42", "--target", "962,44,42"], "target = [962.0"),
    "entry equals target": (["--entry", "0,30,42", "--target", "0,30,42"], "--target 0,30,42 equals --entry"),
    "two numbers": (["--entry", "0,30", "--target", "5,5,5"], "--entry '0,30' is not a point"),
    "not a number": (["--entry", "0,30,up", "--target", "5,5,5"], "--entry '0,30,up' is not a point"),
    "NaN": (["--entry", "0,30,nan", "--target", "5,5,5"], "--entry contains NaN"),
    "target missing": (["--entry", "0,30,42"], "--target is missing"),
    "zero steps": (["--steps", "0"], "steps = 0 is too small"),
    "too few nodes": (["--nodes", "3"], "--nodes = 3 is too small"),
    "unknown face": (["--entry-face", "left"], "entry_face = 'left'"),
    "one anchor": (["--anchors", "1"], "--anchors = 1 is out of range"),
    "no landmarks": (["--max-landmarks", "0"], "--max-landmarks = 0 is out of range"),
    "negative smoothing": (["--smoothing", "-1"], "--smoothing = -1 is out of range"),
    "negative seed": (["--seed", "-1"], "seed = -1 is too small"),
    "negative parameter": (["--set", "shaft_pull=-1"], "shaft_pull = -1 is out of range"),
    "zero radius": (["--set", "shaft_radius=0"], "shaft_radius = 0 is out of range"),
    "unknown parameter": (["--set", "f_max=1"], "f_max is no option of model = 'paper'"),
    "no value": (["--set", "shaft_pull"], "--set 'shaft_pull' is not NAME=VALUE"),
    "no such parameter file": (["--parameters", "nowhere.toml"], "--parameters = 'nowhere.toml' does not exist"),
    "no such volume": (
        ["--volume", "nowhere.nrrd", "--entry", "1,1,1", "--target", "2,2,2"],
        "volume = 'nowhere.nrrd'",
    ),
    "kind of no volume": (["--volume-kind", "labels"], "--volume-kind labels belongs to --volume"),
    "unknown file type": (["--volume", __file__], "unknown file type"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_exit_code_2_and_no_output(case, tmp_path, capsys):
    arguments, message = BAD[case]
    assert insert(*arguments, "--out", tmp_path / "out") == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert list(tmp_path.iterdir()) == []


def test_a_parameter_file_that_is_not_toml_is_refused(tmp_path, capsys):
    (tmp_path / "model.toml").write_text("shaft_displacement: 1")
    assert insert("--parameters", tmp_path / "model.toml", "--out", tmp_path / "out") == 2
    assert "is not TOML" in capsys.readouterr().err


def test_an_output_folder_that_cannot_be_made_is_refused(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert insert("--out", tmp_path / "file" / "out", *SMALL) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert insert("--out", tmp_path / "file", *SMALL) == 2


def test_an_unknown_option_is_exit_code_2():
    with pytest.raises(SystemExit) as refusal:
        cli.main(["insert", "--depth", "3"])
    assert refusal.value.code == 2


def test_doctor_says_what_is_in_use(capsys):
    assert cli.main(["doctor", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["self_check"]["passed"]
    assert report["backend"] in ("core", "numpy")
    assert report["extras"]["SimpleITK"] == sitk.Version().VersionString()
    assert cli.main(["doctor"]) == 0
    assert "self-check: passed" in capsys.readouterr().out


def test_a_missing_extra_is_one_clear_line(tmp_path):
    """In a process where SimpleITK cannot be found."""
    done = run_without("SimpleITK", "insert", "--out", tmp_path / "out", *SMALL)
    assert done.returncode == 1
    assert done.stderr == "sonospline insert: SimpleITK is not installed; run: pip install 'sonospline[io]'\n"
    assert list(tmp_path.iterdir()) == []


def test_importing_the_package_brings_nothing_heavy():
    heavy = ("scipy", "SimpleITK", "vtkmodules", "matplotlib", "rich", "pymoo", "distributed")
    code = f"import sonospline, sys; print([m for m in {heavy} if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.parametrize(
    ("name", "entry", "target", "suffix"),
    [
        ("spine_phantom_us.mha", "73,0,52", "73,70,60", ".mha"),
        ("abdomen_ct.nii.gz", "8,40,15", "40,45,15", ".nii.gz"),
    ],
)
def test_on_real_images(name, entry, target, suffix, tmp_path, capsys):
    if not (DATA / name).exists():
        pytest.skip(f"{name} is not beside the checkout")
    where = ["--volume", DATA / name, "--frame", "IJK", "--entry", entry, "--target", target]
    assert insert(*where, "--out", tmp_path, "--json", "--nodes", 20000, "--steps", 5) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["smallest_det_jacobian"] > 0.5
    assert summary["inverse"]["unconverged_nodes"] == 0
    before, after = sitk.ReadImage(str(DATA / name)), sitk.ReadImage(str(tmp_path / f"warped{suffix}"))
    assert after.GetSize() == before.GetSize()
    assert np.allclose(after.GetDirection(), before.GetDirection())
    transform = sitk.ReadTransform(str(tmp_path / "displacement.h5"))
    again = sitk.GetArrayFromImage(sitk.Resample(before, before, transform, sitk.sitkLinear))
    inner = (slice(3, -3),) * 3
    assert np.abs(again[inner].astype(int) - sitk.GetArrayFromImage(after)[inner]).max() <= 1


INSIDE = st.tuples(*[st.floats(8, 30)] * 3).map(lambda p: ",".join(map(repr, p)))
ODD = st.sampled_from(["nan", "inf", "-inf", "", "x", "1e400", "--", "0x1", "-3", "700"])
ANYTHING = st.lists(ODD, min_size=1, max_size=4).map(",".join)


@given(
    entry=INSIDE | ANYTHING,
    target=INSIDE | ANYTHING,
    frame=st.sampled_from(["RAS", "RAS", "LPS", "IJK"]),
    steps=st.integers(-1, 3),
    radius=st.floats(-1, 30).map(repr) | st.just("wide"),
)
@settings(max_examples=60)
def test_any_needle_either_works_or_is_refused_in_one_line(volume_file, entry, target, frame, steps, radius):
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(io.StringIO()) as said:
        out = Path(folder) / "out"
        code = cli.main(
            [
                *("insert", f"--volume={volume_file}", f"--entry={entry}", f"--target={target}", f"--frame={frame}"),
                *(f"--steps={steps}", f"--set=shaft_radius={radius}", "--nodes=300", f"--out={out}", "--quiet"),
            ]
        )
        assert code in (0, 2)
        assert out.exists() == (code == 0)
        if code == 2:
            assert said.getvalue().count("\n") == 1


@pytest.mark.parametrize("model", [pytest.param("kelvinlet", marks=pytest.mark.slow), "elastic"])
def test_every_model_runs_on_the_phantom(model, tmp_path, capsys):
    assert insert("--model", model, "--out", tmp_path / "out", "--json", *SMALL) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["model"] == model
    assert 0.5 < printed["max_displacement_mm"] < 5
    assert printed["inverse"]["unconverged_nodes"] == 0
    if model == "elastic":
        assert printed["error_estimate"] <= 5e-3
        assert printed["boundary_drift_mm"] < 1e-3


@pytest.fixture
def label_files(tmp_path):
    """A label image of fat over liver with a stone in it, and the names of its labels."""
    voxels = np.ones((24, 20, 20), np.uint8)
    voxels[8:], voxels[14:18, 8:12, 8:12] = 2, 3
    write_volume(Volume(voxels=voxels, spacing=(2.0, 2.0, 2.0), origin=np.zeros(3)), tmp_path / "organs.nii.gz")
    (tmp_path / "organs.csv").write_text("label,name,voxels\n1,fat,3200\n2,liver,6336\n3,bone,64\n")
    return tmp_path / "organs.nii.gz"


PATH = ["--entry", "0,18,18", "--target", "24,20,20"]


def test_a_label_image_becomes_a_running_simulation(label_files, tmp_path, capsys):
    arguments = ("--labels", label_files, "--model", "elastic", *PATH, "--out", tmp_path / "out", *SMALL)
    assert insert(*arguments, "--allow-folds") == 0
    said = capsys.readouterr().out
    assert "finite elements on" in said
    assert "linear theory is off by some" in said
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["young_kpa"] == pytest.approx([3, 6])  # of what deforms: the stone is bone
    assert summary["max_displacement_mm"] > 1
    assert not summary["small_strain"]  # a needle of 0.7 N in fat
    assert 0.01 < summary["theory_error"]["mean"][0] < summary["theory_error"]["peak"][1]


@pytest.mark.slow
def test_a_field_that_folds_is_no_result_unless_it_is_asked_for(label_files, tmp_path, capsys):
    """The needle pushes into a jelly, beyond anything a linear theory says."""
    (tmp_path / "jelly.toml").write_text("[liver]\nstiffness_kpa = 0.3\n")
    tissue = ("--labels", label_files, "--materials", tmp_path / "jelly.toml")
    arguments = (*tissue, "--model", "elastic", *PATH, "--out", tmp_path / "out", "--json", *SMALL)
    assert insert(*arguments) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert "the tissue folds over: det J = -" in printed.err and "--allow-folds" in printed.err
    assert not (tmp_path / "out").exists()
    assert insert(*arguments, "--allow-folds") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["smallest_det_jacobian"] < 0 < summary["folded_nodes"]
    where = [float(x) for x in printed.err.split("at (")[1].split(")")[0].split(",")]
    vti = pytest.importorskip("vtkmodules.vtkIOXML").vtkXMLImageDataReader()
    vti.SetFileName(str(tmp_path / "out" / "displacement.vti"))
    vti.Update()
    at = vti.GetOutput().FindPoint(-where[0], -where[1], where[2])
    value = vti.GetOutput().GetPointData().GetArray("det_jacobian").GetValue(at)
    assert value == pytest.approx(summary["smallest_det_jacobian"])


@pytest.mark.slow
def test_without_a_path_the_needle_comes_from_the_front(label_files, tmp_path, capsys):
    assert insert("--labels", label_files, "--model", "elastic", "--out", tmp_path / "out", "--json", *SMALL) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["entry_ras_mm"] == [23.0, 38.0, 19.0]
    assert printed["target_ras_mm"] == [23.0, 19.0, 19.0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--model", "elastic", "--set", "shaft_radius=3"], "shaft_radius is no option of model = 'elastic'"),
        (["--drag-mm", "2"], "--drag-mm belongs to --model kelvinlet"),
        (["--model", "elastic", "--poisson", "0.5"], "poissons_ratio = 0.5 is out of range"),
        (["--model", "elastic", "--stiffness", "0"], "stiffness_kpa = 0"),
        (["--model", "elastic", "--labels", "absent.nii.gz"], "'absent.nii.gz' does not exist"),
    ],
)
def test_a_model_refuses_what_is_not_its_own(arguments, message, tmp_path, capsys):
    assert insert(*arguments, "--out", tmp_path / "out", *SMALL) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_nameless_label_is_refused_and_named(label_files, tmp_path, capsys):
    label_files.with_name("organs.csv").write_text("label,name\n1,fat\n2,liver\n")
    assert insert("--labels", label_files, "--model", "elastic", "--out", tmp_path / "out", *SMALL) == 2
    assert "labels [3] have no name" in capsys.readouterr().err


def beside_the_labels(tmp_path, x):
    """An image on another lattice than the labels, that begins at x."""
    path = tmp_path / "image.nii.gz"
    write_volume(
        Volume(voxels=np.zeros((30, 32, 28), np.int16), spacing=(1.5, 1.2, 1.7), origin=np.array([x, -5, 3])), path
    )
    return path


@pytest.mark.slow
def test_labels_of_another_geometry_than_the_image_are_resampled(label_files, tmp_path):
    image, path = beside_the_labels(tmp_path, 10.0), ("--entry", "10,18,18", "--target", "24,20,20")
    arguments = ("--labels", label_files, "--model", "elastic", "--out", tmp_path / "out", *SMALL)
    assert insert("--volume", image, *path, *arguments, "--allow-folds") == 0


def test_labels_beside_the_image_are_refused(label_files, tmp_path, capsys):
    image, path = beside_the_labels(tmp_path, 500.0), ("--entry", "500,18,18", "--target", "524,20,20")
    arguments = ("--labels", label_files, "--model", "elastic", "--out", tmp_path / "out", *SMALL)
    assert insert("--volume", image, *path, *arguments) == 2
    assert "labels do not overlap the tissue's box" in capsys.readouterr().err


@pytest.mark.slow
def test_a_real_abdomen_in_one_command(shared_data, tmp_path, capsys):
    labels = shared_data / "abdomen_labels.nii.gz"
    assert insert("--labels", labels, "--model", "elastic", "--out", tmp_path / "out", "--json", *SMALL) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["error_estimate"] <= 5e-3 and printed["max_displacement_mm"] > 0.5
