"""NaN and infinity: refused at the border, or shown as nothing; never cast to a number."""

from dataclasses import fields, replace

import numpy as np
import pytest

import sonospline as ss
from sonospline.elasticity import NotConvergedError
from sonospline.geometry import ImagePlane, facing
from sonospline.geometry.volume import Volume
from sonospline.mechanics import LineForce, Material, ShaftDisplacement
from sonospline.models.elastic import ElasticInsertion
from sonospline.simulator import ImageSettings
from sonospline.simulator.imaging import ReslicedImager, grey_range
from sonospline.ultrasound import Display, NeedleEcho, Phantom, Probe, Scanner
from sonospline.ultrasound.acoustics import TISSUES
from sonospline.ultrasound.frame import as_bytes
from sonospline.ultrasound.reslice import Reslicer

PARAMETERS = [
    NeedleEcho.trocar(), TISSUES["liver"], Probe.curvilinear(), Display(), LineForce(), Material(), ShaftDisplacement(),
    Material(stiffness_kpa=5), ss.NeedleTissueModel.paper(), ss.DragModel.kelvinlet(), ss.Kelvinlet(),
]  # fmt: skip
BAD = [np.nan, np.inf, -np.inf]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("parameters", PARAMETERS, ids=lambda parameters: type(parameters).__name__)
def test_no_parameter_takes_it(parameters, bad):
    numbers = [f.name for f in fields(parameters) if type(getattr(parameters, f.name)) in (int, float)]
    assert numbers
    for name in numbers:
        with pytest.raises(ValueError, match=name):
            replace(parameters, **{name: bad})


@pytest.mark.parametrize("bad", BAD)
def test_a_plane_refuses_it(bad):
    pose = facing((8, 8, 0), depth=(0, 0, 1), right=(1, 0, 0))
    with pytest.raises(ValueError, match=r"corner_mm = .* is not finite; give a finite number"):
        ImagePlane(image_to_reference=pose, shape=(4, 4), spacing_mm=1.0, corner_mm=(0, bad))


def resliced(voxels):
    volume = Volume(voxels=voxels, spacing=(1, 1, 1))
    seen = np.ones(voxels.shape, bool)
    pose = facing((8, 8, 0), depth=(0, 0, 1), right=(1, 0, 0))
    probe = Probe.linear(depth_mm=15, lines=32, aperture_mm=14)
    imager = ReslicedImager(Reslicer(volume, seen=seen), grey_range(voxels, seen), probe, pose, 1.0)
    still = ss.GridField(ss.Grid(shape=(5, 5, 5), spacing=4), np.zeros((5, 5, 5, 3), np.float32))
    return imager.render(still, None, frame=0, settings=ImageSettings(gain=0, depth=20, frequency=5, focus=20))


@pytest.mark.parametrize("bad", BAD)
def test_voxels_that_hold_it_are_black_and_leave_the_others_as_they_are(rng, bad):
    voxels = rng.random((16, 16, 16)).astype(np.float32)
    clean = voxels.copy()
    voxels[3, 3, 3] = bad
    shown, expected = resliced(voxels), resliced(clean)
    near = np.abs(shown.plane.project(shown.plane.points)[:, 0] + 5).reshape(shown.pixels.shape) < 2
    assert (shown.pixels[~near].astype(int) - expected.pixels[~near] <= 2).all()
    assert grey_range(np.full((4, 4, 4), bad, np.float32), np.ones((4, 4, 4), bool)) == (0.0, 1.0)


@pytest.mark.parametrize("bad", BAD)
def test_grey_levels_are_those_of_what_is_known(bad):
    pixels = np.array([[0.0, 0.5], [1.0, bad]])
    assert as_bytes(pixels)[0].tolist() == [0, 127]
    assert as_bytes(pixels)[1, 0] == 255
    assert as_bytes(np.full((2, 2), np.nan)).tolist() == [[0, 0], [0, 0]]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.usefixtures("backend")
def test_a_field_that_holds_it_ends_in_nan_not_in_a_crash(rng, order, bad):
    grid = ss.Grid.unit_cube(9)
    values = np.zeros((9, 9, 9, 3), np.float32)
    values[4, 4, 4, 0] = bad
    with np.errstate(invalid="ignore"):
        field = ss.GridField(grid, values, order=order)
        points = rng.random((50, 3)) * 0.1 + 0.45
        assert not np.isfinite(field.displacement(points)).all(axis=1).any()
        assert not np.isfinite(field.inverse(points)).all(axis=1).any()


@pytest.mark.parametrize("bad", BAD)
def test_a_scanner_shows_the_tissue_undeformed(caplog, bad):
    scanner = Scanner(
        Phantom.uniform("liver", size_mm=(30, 10, 30)), Probe.linear(depth_mm=25, lines=32, aperture_mm=20),
        facing((15, 5, 2), depth=(0, 0, 1), right=(1, 0, 0)),
    )  # fmt: skip
    grid = ss.Grid.covering((30, 10, 30), nodes=500)
    values = np.zeros((*grid.shape, 3), np.float32)
    values[2, 2, 2] = bad
    assert np.isfinite(scanner.render(ss.GridField(grid, values)).iq).all()
    assert "the tissue is shown undeformed" in caplog.text


def test_a_step_from_a_state_that_holds_it_is_an_error_and_leaves_the_field():
    insertion = ElasticInsertion(ss.Tissue(ss.Grid.unit_cube(9)), Material(), nodes=9**3)
    needle = ss.Needle((0, 0.5, 0.5), (0.5, 0.5, 0.5))
    insertion.advance(needle)
    good = insertion.field
    spoilt = replace(insertion.solution, displacement=np.full_like(insertion.solution.displacement, np.nan), error=0.1)
    insertion.response = replace(insertion.response, state=replace(insertion.state, solution=spoilt))
    with pytest.raises(NotConvergedError, match="the last field is kept"):
        insertion.advance(needle)
    assert insertion.field is good


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (ss.DragModel(drag=0.02, spacing=0.04, kernel=ss.Kelvinlet(width=1e-12)), "width = 1e-12: .* a wider kernel"),
        (ss.DragModel(drag=0.02, spacing=1e-12, kernel=ss.Kelvinlet()), "spacing = 1e-12: .* use a wider one"),
    ],
)
def test_a_kernel_too_fine_for_memory_is_refused(model, message):
    with pytest.raises(ValueError, match=message):
        ss.KelvinletInsertion(ss.Tissue(ss.Grid.unit_cube(9)), model).advance(ss.Needle((0, 0.5, 0.5), (0.5, 0.5, 0.5)))
