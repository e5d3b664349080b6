"""What the core and its twin refuse at their border, and what they take: wrong shapes, types, layouts and numbers."""

import numpy as np
import pytest

from builds import INSTRUCTION_SETS, needs_core
from core_calls import ARRAYS, MULTIGRID, SOUND, SPACING, a_factor, prepared, rows, singles
from sonospline import _core

NAN, INF = np.nan, np.inf


def each(call, match, name, *values):
    """The same complaint about several values of one argument."""
    return [(call, {name: value}, match) for value in values]


def spoilt(call, match, name, *entries):
    """The same complaint about several entries (place, value) of one array."""
    faults = []
    for place, value in entries:
        array = SOUND[call][name].copy()
        array[place] = value
        faults.append((call, {name: array}, match))
    return faults


def cut(call, match, name, *places):
    """The same complaint about several parts of one array."""
    return each(call, match, name, *(SOUND[call][name][place].copy() for place in places))


def views(*values, at):
    """The numbers of a view, one of them changed."""
    probe = SOUND["EchoScene.choose"]["probe"]
    return [(*probe[:at], value, *probe[at + 1 :]) for value in values]


def levels(spacing=(1, 1, 1), lame=(4, 4, 4), shear=(4, 4, 4)):
    return [(spacing, np.ones(lame, np.float32), np.ones(shear, np.float32))]


BRICK, LINE_STEP = 17, 5  # their places in a view
GEOMETRY, NUMBERS = SOUND["BmodePlan"]["geometry"], SOUND["EchoScene"]["interfaces"]
FEW_PATTERNS = {name: SOUND["EchoScene"][name][:3].copy() for name in ("places", "signs")}
FAULTS = [
    *each("sum_at_points_f32", "kernel", "kernel", 2, -1),
    *each("sum_on_lattice_f64", "kernel", "kernel", 2),
    *each("gradient_at_points", "kernel", "kernel", 2),
    *each("kernel_matrix", "kernel", "kernel", -1),
    *each("sum_at_points_f64", "centres and weights", "weights", rows(4), rows(6)),
    *each("sum_on_lattice_f32", "centres and weights", "weights", rows(0)),
    *each("gradient_at_points", "centres and weights", "centres", rows(6)),
    *each("kelvinlet_sum", "centres and forces", "forces", rows(4)),
    *each("sample_lattice", "order", "order", 2, -1),
    *each("sample_lattice", "values has fewer nodes", "values", singles(6, 3, 7, 3), singles(0, 4, 4, 3)),
    ("sample_lattice", {"values": singles(6, 1, 7, 3), "order": 1}, "values has fewer nodes"),
    *each("sample_lattice", "spacing", "spacing", (1, 0, 1), (1, 1, -1), (NAN, 1, 1), (1, INF, 1)),
    *each("gradient_lattice", "values has fewer nodes", "coefficients", singles(6, 5, 0, 3)),
    *each("invert_lattice", "most", "most", -1, 2**31 - 1),
    *each("invert_lattice", "spacing", "spacing", (NAN, 1, 1)),
    ("resample_lattice", {"values": singles(3, 3, 6, 4), "x": singles(8, 5)}, "values has fewer than 4"),
    ("resample_lattice", {"values": singles(3, 5, 6, 0), "z_transposed": singles(0, 5)}, "values has fewer than 4"),
    *each("resample_lattice", "x, y or z_transposed", "x", singles(8, 8), singles(8, 0)),
    *each("resample_lattice", "x, y or z_transposed", "y", singles(9, 7)),
    *each("resample_lattice", "x, y or z_transposed", "z_transposed", singles(5, 5)),
    *each("reslice", "seen", "seen", np.ones((6, 7, 9), np.uint8)),
    *each("reslice", "values has fewer than 2", "values", singles(1, 5, 7, 3)),
    ("reslice", {"voxels": singles(0, 7, 8), "seen": None}, "voxels"),
    *each("reslice", "most", "most", -1, 10**9),
    *each("reslice", "spacing", "spacing", (1, 1, 0)),
    *each("MultilevelPlan", "shape", "shape", (0, 9, 9), (2**40, 1, 1), (2**24, 2**24, 1)),
    *each("MultilevelPlan", "spacing", "spacing", (1, 0, 1), (1, -1, 1), (1, NAN, 1)),
    *each("MultilevelPlan", "tolerance", "tolerance", 0, -1, NAN),
    *each("MultilevelPlan", "orders", "orders", [], [5], [4] * 4),
    *spoilt("MultilevelPlan.evaluate", "centre_index", "centre_index", ((3, 0), 12), ((19, 2), -1), ((0, 1), 2**40)),
    *each("MultilevelPlan.evaluate", "depth", "depth", -1, 2, 1000),
    *each("MultilevelPlan.evaluate", "centre_index and weights", "weights", rows(19)),
    *each("MultilevelPlan.evaluate", "out", "out", singles(12, 9, 13, 3)),
    *each("CholeskyFactor.append", "rows", "rows", np.eye(2), np.ones((2, 7)), np.ones((3, 6))),
    *each("CholeskyFactor.solve", "first", "first", 5),
    *each("CholeskyFactor.solve", "x is not", "x", np.ones((3, 5))),
    *each("ElasticMultigrid", "levels", "levels", []),
    *each("ElasticMultigrid", "lame and shear", "levels", levels(shear=(4, 4, 3))),
    *each("ElasticMultigrid", "lame", "levels", levels(lame=(4, 0, 4), shear=(4, 0, 4))),
    *each("ElasticMultigrid", "spacing", "levels", levels(spacing=(1, 0, 1)), levels(spacing=(1, NAN, 1))),
    *each("ElasticMultigrid", "degree", "degree", 0, -3, 10**6),
    *each("ElasticMultigrid", "coarse_inverse", "coarse_inverse", singles(53, 53), singles(54, 53), singles(1, 1)),
    *each("ElasticMultigrid", "layered and excess", "excess", singles(1, 6, 6)),
    *each("ElasticMultigrid", "springs are not over the nodes", "springs", singles(3, 5, 5, 4), singles(3, 4, 5, 5)),
    *spoilt("ElasticMultigrid", "layered has a cell", "layered", ((0, 1), -1), ((1, 0), 4), ((1, 2), 2**40)),
    *each("ElasticMultigrid.iterate", "values", "load", singles(3, 5, 5, 6)),
    *each("ElasticMultigrid.iterate", "values", "start", singles(3, 5, 5, 6)),
    *each("ElasticMultigrid.iterate", "iterations", "iterations", -1, 10**9),
    *each("ElasticMultigrid.product", "values", "values", singles(3, 4, 5, 5)),
    *each("nodal_forces", "shape", "shape", (0, 5, 7), (1, 5, 7)),
    *each("nodal_forces", "points and amounts", "amounts", np.zeros(3)),
    *each("nodal_forces", "points are not finite", "points", np.full((6, 3), NAN)),
    *each("nodal_forces", "width", "width", 0, -1, NAN),
    *each("nodal_force_vectors", "shape", "shape", (0, 5, 7), (1, 5, 7)),
    *each("nodal_force_vectors", "points and forces", "forces", rows(5)),
    *each("nodal_force_vectors", "points are not finite", "points", np.full((6, 3), NAN)),
    *each("nodal_force_vectors", "width", "width", 0, -1, NAN),
    *each("displacement_at", "x, y or z", "y", np.zeros((7, 5)), np.zeros((6, 6))),
    *each("displacement_at", "points are not finite", "points", np.full((6, 3), NAN)),
    *each("displacement_at", "spacing", "spacing", (1, 0, 1)),
    *each("followed", "start is not", "start", np.zeros((3, 5, 5, 4))),
    *each("followed", "change is not", "change", np.zeros((3, 4, 5, 5))),
    *each("followed", "forgotten and taken_up", "forgotten", np.zeros(3), np.zeros(0)),
    *each("followed", "forgotten and taken_up", "taken_up", np.zeros(5)),
    *each("clipped_forces", "compliance is not square", "compliance", np.eye(4), np.ones((5, 6))),
    *each("clipped_forces", "no diagonal", "compliance", np.zeros((5, 5))),
    *each("clipped_forces", "low, high or start", "start", np.zeros(4)),
    *each("clipped_forces", "low is above high", "low", np.ones(5), np.full(5, NAN)),
    *each("clipped_forces", "sweeps", "sweeps", -1, 10**9),
    *each("cut_on", "compliance is not square", "compliance", np.eye(4), np.ones((5, 6))),
    *each("cut_on", "diagonal below 0", "compliance", -np.eye(5)),
    *each("cut_on", "anchors or axial", "anchors", np.zeros(6)),
    *each("cut_on", "anchors or axial", "axial", np.zeros(4)),
    *each("cut_on", "sliding or used", "sliding", np.zeros(4, np.uint8)),
    *each("cut_on", "sliding or used", "used", np.zeros(6, np.uint8)),
    *each("cut_on", "bond is not one longer", "bond", np.ones(5)),
    *each("cut_on", "bond is not above 0", "bond", np.zeros(6), np.full(6, NAN)),
    *each("cut_on", "resistance is not four", "resistance", np.ones((4, 6))),
    *each("cut_on", "resistance or rupture", "resistance", np.full((4, 5), -1.0), np.full((4, 5), NAN)),
    *each("cut_on", "resistance or rupture", "rupture", -1.0, NAN),
    *each("cut_on", "slow", "slow", -1.0, NAN),
    *each("cut_on", "sweeps or most", "sweeps", -1, 10**9),
    *each("cut_on", "sweeps or most", "most", -1, 10**9),
    *each("held_across", "compliance is not square", "compliance", np.eye(4), np.ones((12, 13))),
    *each("held_across", "places, offsets or lateral", "places", rows(2)),
    *each("held_across", "places, offsets or lateral", "offsets", rows(0)),
    *each("held_across", "places, offsets or lateral", "lateral", rows(5)),
    *each("held_across", "share", "share", 0.0, NAN),
    *each("held_across", "bond, soft or least", "bond", -1.0, NAN),
    *each("held_across", "bond, soft or least", "soft", -1.0, NAN),
    *each("held_across", "bond, soft or least", "least", -1.0),
    *each("ForceLaw", "hands", "hands", 0, -1, 10**9),
    *each("ForceLaw", "options are not", "options", np.ones(16), np.full(17, -1.0), np.full(17, NAN), np.zeros(17)),
    *each("ForceLaw", "period", "options", np.ones(17)),
    *each("ForceLaw", "sweeps", "sweeps", 0, 10**6),
    *each("ForceLaw.renew", "compliance is not square", "compliance", np.eye(3), np.ones((4, 5))),
    *each("ForceLaw.renew", "no diagonal", "compliance", np.zeros((4, 4))),
    *each("ForceLaw.renew", "compliance is not finite", "compliance", np.full((4, 4), NAN)),
    *each("ForceLaw.renew", "length of places", "forces", np.zeros(3)),
    *each("ForceLaw.renew", "is not finite", "anchors", np.full(4, NAN), np.full(4, 1e300)),
    *each("ForceLaw.renew", "low is above 0", "low", np.full(4, 0.1)),
    *each("ForceLaw.renew", "tip is neither", "tip", 4, -2),
    *each("ForceLaw.renew", "axis is not of length 1", "axis", np.ones(3), np.zeros(3)),
    *each("ForceLaw.renew", "lateral_stiffness", "lateral_stiffness", -1.0, NAN),
    *each("ForceLaw.tick", "positions or device_age", "positions", rows(3)),
    *each("undeformed_points", "x, y or z", "y", np.zeros((7, 5)), np.zeros((6, 6))),
    *each("undeformed_points", "points are not finite", "points", np.full((6, 3), NAN)),
    *each("undeformed_points", "start and points", "start", np.zeros((5, 3))),
    *each("undeformed_points", "iterations", "iterations", -1, 10**9),
    *each("undeformed_points", "spacing", "spacing", (1, 0, 1)),
    *each("nodal_forces", "spacing", "spacing", (1, 0, 1)),
    *each("EchoScene", "spacing", "spacing", (1, 0, 1)),
    *each("EchoScene", "texture is", "texture", singles(1, 4, 4, 5), singles(1, 1, 1, 1)),
    *each("EchoScene", "texture_kind", "texture_kind", np.full(256, 4.0), np.full(256, -1.0), np.full(256, NAN)),
    ("EchoScene", FEW_PATTERNS, "power of two"),
    *cut("EchoScene", "places and signs", "signs", np.s_[:, :500]),
    *each("EchoScene", "interfaces", "interfaces", *((s, *NUMBERS[1:]) for s in (0, NAN, 1e9))),
    *each("EchoScene.choose", "probe|brick_mm", "probe", *views(0, -1, NAN, INF, 1e-12, at=BRICK)),
    *each("EchoScene.choose", "line_step", "probe", *views(0, at=LINE_STEP)),
    *each("EchoScene.choose", "affine", "to_cell", np.full((3, 4), INF)),
    *each("EchoScene.choose", "shape", "shape", (3, 0, 3), (2**40, 3, 3)),
    *each("EchoScene.choose", "spacing", "spacing", (1, NAN, 1)),
    *each("EchoScene.choose", "power", "power", np.ones(1), np.ones(0)),
    *each("BmodePlan", "geometry", "geometry", (NAN, *GEOMETRY[1:])),
    *each("BmodePlan", "lines|samples|lateral", "lines", 1, -32, 2**30),
    *each("BmodePlan", "samples|lateral", "samples", 0, 150, -160, 2**30),
    *each("BmodePlan", "axial", "axial", singles(0), singles(10), singles(129)),
    *each("BmodePlan", "lateral", "lateral", singles(4, 160), singles(5, 159), singles(0, 160)),
    *each("BmodePlan", "ray_samples", "ray_samples", 0, 250, 2**30),
    *each("BmodePlan", "ray", "rays", 0, -1),
    *spoilt("BmodePlan", "smoothing_first", "smoothing_first", (0, -1), (31, 90), (5, 2**31 - 1)),
    *each("BmodePlan", "smoothing", "smoothing", singles(31, 3)),
    *cut("BmodePlan", "smoothing", "smoothing_first", np.s_[:31]),
    *spoilt("BmodePlan", "pixel", "pixel", ((3, 3), 31 * 160 - 1), ((39, 35), 2**31 - 1)),
    ("BmodePlan", {"pixel": np.zeros((0, 36), np.int32), "fraction": np.zeros((0, 36, 2), np.uint8)}, "pixel"),
    *cut("BmodePlan", "pixel|fraction", "fraction", np.s_[:, 1:]),
    *spoilt("BmodePlan.aim", "starts|place", "starts", (0, -1), (5, 2**30), (-1, 2**30)),
    *cut("BmodePlan.aim", "frames", "starts", np.s_[1:]),
    *cut("BmodePlan.aim", "frames", "frames", np.s_[1:], np.s_[:, 1:]),
    *spoilt("BmodePlan.aim", "nodes", "nodes", ((2, 0), -1), ((2, 3), -1)),
    *cut("BmodePlan.aim", "place", "place", np.s_[:, 1:]),
    *cut("BmodePlan.aim", "place", "amplitude", np.s_[1:]),
    *cut("BmodePlan.aim", "ray_start", "ray_start", np.s_[1:]),
    *cut("BmodePlan.aim", "ray_start", "ray_step", np.s_[1:]),
    *each("BmodePlan.render", "values has fewer", "values", singles(3, 3, 3, 3), singles(900, 1, 1, 3)),
    *cut("BmodePlan.render", "noise", "noise", np.s_[1:]),
    *cut("BmodePlan.render", "shadow", "shadow", np.s_[:, 1:], np.s_[1:]),
    *cut("BmodePlan.render", "offset_db", "offset_db", np.s_[1:]),
    *each("BmodePlan.render", "spacing", "spacing", (1, 1, 0)),
]


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize(("call", "given", "match"), FAULTS, ids=[f"{call}-{match}" for call, _, match in FAULTS])
def test_what_does_not_fit_is_refused(call, given, match):
    function, arguments = prepared(_core.active, call)
    with pytest.raises(ValueError, match=match):
        function(**arguments | given)


@pytest.mark.usefixtures("backend")
def test_a_plan_that_was_not_aimed_renders_nothing():
    with pytest.raises(ValueError, match="aim first"):
        _core.active.BmodePlan(**SOUND["BmodePlan"]).render(**SOUND["BmodePlan.render"])


@pytest.mark.usefixtures("backend")
def test_the_error_of_more_levels_than_there_are_is_not_told():
    plan = _core.active.MultilevelPlan((9, 9, 9), SPACING, 3e-2, [4])
    assert plan.error_per_weight(0) == 0
    for depth in (-1, plan.max_depth + 1, 1000):
        with pytest.raises(ValueError, match="depth"):
            plan.error_per_weight(depth)


@needs_core
@pytest.mark.parametrize("shape", [(2**40,) * 3, (2**62, 2, 2), (2**60, 1, 1)], ids=str)
@pytest.mark.parametrize("call", ["sum_on_lattice_f32", "sum_on_lattice_f64", "nodal_forces"])
def test_a_result_larger_than_any_memory_is_refused(call, shape):
    function, arguments = prepared(_core.native, call)
    with pytest.raises((MemoryError, ValueError)):
        function(**arguments | {"shape": shape})


@needs_core
@pytest.mark.parametrize("argument", ARRAYS, ids=str)
def test_another_number_of_axes_or_a_type_without_order_is_refused(argument):
    function, arguments = prepared(_core.native, argument.call)
    array = arguments[argument.name]
    for wrong in (array[None], array[..., None], array.ravel()[0], array.astype(complex), array.astype(str), None):
        if wrong is None and argument.name in ("seen", "out", "springs"):
            continue
        with pytest.raises((TypeError, ValueError)):
            function(**arguments | {argument.name: wrong})


@needs_core
@pytest.mark.parametrize("argument", [a for a in ARRAYS if a.sound.dtype.kind in "iu"], ids=str)
def test_fractions_are_no_numbers_of_nodes_or_labels(argument):
    function, arguments = prepared(_core.native, argument.call)
    with pytest.raises(TypeError):
        function(**arguments | {argument.name: arguments[argument.name].astype(float)})


FILLED = {("CholeskyFactor.solve", "x"), ("MultilevelPlan.evaluate", "out")}


def flat(result):
    """All numbers of a result; of nothing, and of an object, nothing."""
    parts = result if isinstance(result, tuple | list) else [result]
    return [np.asarray(part) for part in parts if isinstance(part, np.ndarray | float | int | bool | list)]


def other_layouts(array):
    """The same values backwards in memory, every second one of more, off their alignment, and swapped."""
    bytes_ = bytearray(array.nbytes + 1)
    misaligned = np.frombuffer(bytes_, np.uint8)[1 : array.nbytes + 1].view(array.dtype).reshape(array.shape)
    misaligned[...] = array
    yield np.ascontiguousarray(array[::-1])[::-1]
    yield np.asfortranarray(array)
    yield np.repeat(array, 2, axis=-1)[..., ::2]
    yield misaligned
    yield array.astype(array.dtype.newbyteorder())


@needs_core
@pytest.mark.parametrize("argument", ARRAYS, ids=str)
def test_the_layout_of_an_array_does_not_matter_unless_it_is_filled(argument):
    function, arguments = prepared(_core.native, argument.call)
    expected = flat(function(**arguments))
    if (argument.call, argument.name) in FILLED:
        for layout in other_layouts(arguments[argument.name]):
            if not (layout.flags.c_contiguous and layout.flags.aligned and layout.dtype.isnative):
                with pytest.raises(TypeError):
                    function(**arguments | {argument.name: layout})
        return
    for layout in other_layouts(arguments[argument.name]):
        function = prepared(_core.native, argument.call)[0]
        found = flat(function(**arguments | {argument.name: layout}))
        assert len(found) == len(expected)
        assert all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(found, expected, strict=True))


@needs_core
@pytest.mark.parametrize("name", ["x", "out"])
def test_what_is_filled_must_be_writable(name):
    call = {"x": "CholeskyFactor.solve", "out": "MultilevelPlan.evaluate"}[name]
    function, arguments = prepared(_core.native, call)
    locked = arguments[name].copy()
    locked.setflags(write=False)
    with pytest.raises(TypeError):
        function(**arguments | {name: locked})


@needs_core
@pytest.mark.parametrize("argument", [a for a in ARRAYS if a.sound.dtype.kind == "f"], ids=str)
@pytest.mark.parametrize("value", [NAN, INF, -INF, 1e300, -1e300], ids=str)
def test_numbers_out_of_all_bounds_are_refused_or_lead_nowhere_wrong(native, argument, value):
    """What became of them is the same, whatever the instruction set, wherever a result is not made of them alone."""
    found = []
    with np.errstate(over="ignore"):
        for isa in INSTRUCTION_SETS:
            native.use_instruction_set(isa)
            function, arguments = prepared(native, argument.call)
            array = arguments[argument.name].copy()
            array.reshape(-1)[:: max(1, array.size // 3)] = value
            try:
                found.append(flat(function(**arguments | {argument.name: array})))
            except ValueError as refusal:
                found.append(str(refusal))
    for other in found[1:]:
        assert type(other) is type(found[0])
        if isinstance(other, str):
            assert other == found[0]
        else:
            assert [a.shape for a in other] == [a.shape for a in found[0]]
            whole = [(a, b) for a, b in zip(other, found[0], strict=True) if a.dtype.kind in "iub"]
            assert all(np.abs(a.astype(int) - b).max(initial=0) <= 1 for a, b in whole)


@pytest.mark.usefixtures("backend")
def test_a_place_that_is_no_number_has_no_displacement():
    """Not that of node 0, which would look like one."""
    function, arguments = prepared(_core.active, "sample_lattice")
    for order in (1, 3):
        places = np.array([[NAN, 1, 1], [1, 1, 1], [INF, -INF, 1]])
        seen = function(**arguments | {"points": places, "order": order})
        assert np.isnan(seen[0]).all()
        assert np.isfinite(seen[1:]).all()


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_image_of_one_slice_is_resliced(axis):
    """Along an axis of one voxel, that one is as far as half its size."""
    function, arguments = prepared(_core.active, "reslice")
    voxels = np.ones(np.where(np.arange(3) == axis, 1, 8), np.float32)
    pixel = np.roll(np.array([[0, 0, 0.2], [0.5, 0, 0], [0, 0.5, 0]]), axis, axis=0)
    still = np.zeros_like(arguments["values"])
    given = arguments | {"voxels": voxels, "seen": None, "pixel": pixel, "shape": (9, 9), "values": still}
    grey, seen = function(**given)
    assert seen.all()
    assert (grey == 1).all()
    _, seen = function(**given | {"pixel": pixel + 0.5 * np.eye(3)[axis][:, None] * [0, 0, 1]})
    assert not seen.any()


@needs_core
@pytest.mark.filterwarnings("ignore:nanobind:RuntimeWarning")
@pytest.mark.parametrize("name", ["BmodePlan", "EchoScene", "ElasticMultigrid", "MultilevelPlan"])
def test_an_object_is_made_once_before_it_is_used(name):
    made = getattr(_core.native, name)
    for call, arguments in SOUND.items():
        if call.startswith(f"{name}."):
            with pytest.raises(TypeError):
                getattr(made, call.partition(".")[2])(made.__new__(made), **arguments)
    again = made(**SOUND[name])
    with pytest.raises(TypeError):
        again.__init__(**SOUND[name])


@needs_core
def test_thin_tissue_with_many_nodes_is_solved():
    """Three nodes across, too many in all for one thread: its slabs must not vanish."""
    cells = (2, 140, 140)
    levels = [((1.0, 1.0, 1.0), np.full(cells, 3, np.float32), np.ones(cells, np.float32))]
    arguments = MULTIGRID | {"levels": levels, "coarse_inverse": np.zeros((0, 0), np.float32)}
    arguments |= {"layered": np.zeros((0, 3), np.int64), "excess": singles(0, 6, 6), "springs": None}
    load = np.zeros((3, *np.add(cells, 1)), np.float32)
    load[0, 2, 70, 70] = 1
    u, errors, sound_ = _core.native.ElasticMultigrid(**arguments).iterate(load, np.zeros_like(load), 4, True)
    assert sound_
    assert np.isfinite(errors).all()
    assert u[0, 2, 70, 70] > 0


@needs_core
def test_a_factor_grows_from_what_it_is_now():
    factor = a_factor(_core.native)
    assert factor.size == 4
    factor.truncate(2**60)
    assert factor.size == 4
    with pytest.raises(MemoryError):
        factor.reserve(2**62)
    assert factor.size == 4
