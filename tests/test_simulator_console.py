"""The console: what a command becomes, the read-outs, passes, freeze, reset, and its inverse."""

import numpy as np
import pytest
from msgspec.structs import replace

import sonospline as ss
from simulator_scenes import SMALL
from sonospline.models.elastic import ElasticInsertion
from sonospline.simulator import Console, SceneFile, Session, make_scene
from sonospline.simulator.skin_frame import SkinFrame, room_along
from sonospline.ultrasound import Artefacts, Display, Scanner


class Clock:
    """Time that passes when told to."""

    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL))


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def console(scene, clock):
    return Console(Session(scene), clock=clock)


def at_depth(console, depth):
    return console.scene.start.with_needle(depth=depth)


def the_needle(scene, command):
    entry = scene.frame.entry(command.needle)
    return ss.Needle(entry, entry + command.needle.depth * scene.frame.direction(command.needle))


def test_the_needle_is_where_the_protocol_says(scene):
    command = replace(scene.start.needle, u=3.0, v=-2.0, angle=60.0, swing=10.0, depth=20.0)
    skin = scene.frame
    assert skin.entry(command) == pytest.approx([63, 32, 0])  # n = r x d = -y
    c, s = np.cos(np.radians(10)), np.sin(np.radians(10))
    assert skin.direction(command) == pytest.approx([c * 0.5, -s, c * np.sqrt(3) / 2])


def test_the_probe_is_where_the_protocol_says(scene):
    frame, probe = scene.frame, scene.start.probe
    at_rest = frame.probe_to_reference(probe, 2.0)
    assert at_rest[:3, 3] == pytest.approx(frame.origin + 2 * frame.depth)
    assert at_rest[:3, :3] == pytest.approx(np.column_stack([frame.right, frame.depth, frame.out]))
    moved = frame.probe_to_reference(replace(probe, slide=5.0, sweep=-3.0, rotate=30.0, fan=20.0), 0.0)
    assert moved[:3, 3] == pytest.approx(frame.origin + 5 * frame.right - 3 * frame.out)
    assert moved[:3, :3].T @ moved[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(moved[:3, :3]) == pytest.approx(1)
    fanned = frame.probe_to_reference(replace(probe, fan=20.0), 0.0)
    assert fanned[:3, 1] @ frame.out == pytest.approx(np.sin(np.radians(20)))  # towards +n


def test_a_frame_refuses_a_direction_square_to_its_face():
    with pytest.raises(ValueError, match="square to the entry face z-"):
        SkinFrame.on_face(ss.Grid.unit_cube(5), "z-", at=None, right=(0, 0, 1))


def test_room_is_counted_to_the_wall():
    grid = ss.Grid.unit_cube(5)
    assert room_along(grid, np.array([0, 0.5, 0.5]), np.array([1.0, 0, 0])) == pytest.approx(1)
    slanted = np.array([0.6, 0.0, 0.8])
    assert room_along(grid, np.array([0.7, 0.5, 0.0]), slanted) == pytest.approx(0.5)


@pytest.mark.parametrize("model", ["paper", "kelvinlet", "elastic"])
def test_the_target_moves_as_the_library_computes(scene, model):
    """The issue's 0.01 mm, for the same pose, however the needle got there."""
    console = Console(Session(scene, model=model))
    for depth in (10.0, 30.0, 50.0, 41.0):
        console.step(at_depth(console, depth))
    frame = console.settle()
    needle = the_needle(scene, frame.command)
    if model == "elastic":
        insertion = ElasticInsertion(scene.tissue, scene.tissues, nodes=scene.spec.model.solver_nodes)
        insertion.advance(needle)
        field = insertion.settle(1e-5)
    elif model == "kelvinlet":
        field = ss.KelvinletInsertion(scene.tissue).advance(needle)
    else:
        field = ss.Insertion(scene.tissue).advance(needle)
    moved = field.displacement(scene.targets["vessel"][None])[0]
    assert np.linalg.norm(moved) > 0.2
    assert frame.target_now - frame.target_rest == pytest.approx(moved, abs=0.01)
    assert frame.readouts.moved == pytest.approx(np.linalg.norm(moved), abs=0.01)
    parts = [moved @ d for d in (scene.frame.right, scene.frame.depth, scene.frame.out)]
    assert frame.readouts.moved_parts == pytest.approx(parts, abs=0.01)
    to_target = np.linalg.norm(scene.targets["vessel"] + moved - needle.tip)
    assert frame.readouts.tip_to_target == pytest.approx(to_target, abs=0.01)


def test_pulling_back_returns_to_rest(console):
    at_rest = console.step()
    console.step(at_depth(console, 40.0))
    out = console.step(at_depth(console, 0.0))
    assert out.readouts.moved == 0
    assert out.needle is None
    assert (out.target_now == at_rest.target_now).all()
    assert not out.field.values.any()


def test_every_pixel_is_the_librarys(scene):
    console = Console(Session(scene))
    console.step()
    console.step(at_depth(console, 25.0))
    console.settle()
    command = at_depth(console, 33.0).with_probe(slide=2.0, fan=4.0).with_image(gain=3.0)
    frame = console.step(command)
    pose = scene.frame.probe_to_reference(command.probe, scene.spec.probe.press_mm)
    seen = scene.see(scene.probe, pose)._scanner
    scanner = Scanner(
        seen.phantom, scene.probe, pose, margin_mm=8.0, display=Display(noise_db=-70), artefacts=Artefacts()
    )
    scanner = scanner.with_display(gain_db=scanner.display.gain_db + 3.0)
    field = ss.GridField.of(frame.response.field)
    expected = scanner.render(field, the_needle(scene, command), frame=frame.number).frame
    assert (frame.image.pixels == expected.pixels).all()
    assert frame.image.pixels.std() > 5


def test_probe_and_knobs_change_the_picture(console):
    rest = console.step()
    swept = console.step(console.command.with_probe(sweep=4.0))
    assert (swept.image.pixels != rest.image.pixels).mean() > 0.3
    assert swept.readouts.out_of_plane == pytest.approx(-4.0)  # the tip stayed, the plane went towards the viewer
    deeper = console.step(console.command.with_image(depth=40.0, frequency=2.5, focus=15.0))
    assert deeper.image.plane.spacing_mm[0] > rest.image.plane.spacing_mm[0]
    louder = console.step(console.command.with_image(gain=10.0))
    assert louder.image.pixels.mean() > deeper.image.pixels.mean() + 5


def test_what_is_physically_blocked_is_clamped(console):
    long = console.step(at_depth(console, 80.0))
    assert (long.blocked, long.command.needle.depth) == ("end of needle", 80.0)
    console.undo_pass()
    steep = at_depth(console, 79.0).with_needle(angle=90.0)
    through = console.step(steep)
    assert through.blocked == "leaves the tissue"
    assert through.command.needle.depth == pytest.approx(70.0, abs=0.01)
    assert console.scene.tissue.grid.contains(through.tip).all()


def test_a_needle_inside_keeps_its_entry_and_turns_a_little(console):
    console.step(at_depth(console, 30.0))
    frame = console.step(console.command.with_needle(u=-20.0, angle=60.0))
    assert frame.blocked == "needle inside"
    assert (frame.command.needle.u, frame.command.needle.angle) == (-34.0, 43.0)
    assert console.step(at_depth(console, 31.0).with_needle(angle=40.0)).blocked is None
    out = console.step(console.command.with_needle(u=-20.0, angle=60.0, depth=0.0))
    assert (out.blocked, out.command.needle.u, out.command.needle.angle) == (None, -20.0, 60.0)


@pytest.mark.parametrize(
    ("part", "change"),
    [("needle", {"depth": float("nan")}), ("needle", {"u": 1e9}), ("probe", {"fan": 91.0}), ("image", {"depth": 0.0})],
)
def test_nonsense_is_refused_and_changes_nothing(console, part, change):
    before = console.step(at_depth(console, 20.0))
    with pytest.raises(ValueError, match=rf"{part}.{next(iter(change))} = .* is out of range; give"):
        console.step(getattr(console.command, f"with_{part}")(**change))
    assert console.command == before.command
    assert console.last is before


def test_a_pass_is_counted(console, clock):
    console.step()
    for depth in (10.0, 20.0, 15.0):
        clock.now += 1
        frame = console.step(at_depth(console, depth).with_probe(sweep=0.0))
    assert frame.metrics.passes == 1
    assert frame.metrics.time_s == pytest.approx(2.0)
    console.step(at_depth(console, 0.0))
    assert console.step(at_depth(console, 5.0)).metrics.passes == 2


def test_undo_takes_a_pass_back(console):
    console.step(at_depth(console, 20.0))
    first = console.step(at_depth(console, 0.0)).metrics
    console.step(at_depth(console, 35.0))
    console.undo_pass()
    frame = console.step()
    assert frame.needle is None
    assert frame.metrics.passes == first.passes
    console.undo_pass()
    assert console.step().metrics.passes == 0


def test_freeze_holds_everything(console, clock):
    console.step(at_depth(console, 20.0))
    frame = console.step(at_depth(console, 20.0))
    frozen = console.step(replace(at_depth(console, 40.0).with_probe(sweep=5.0), frozen=True))
    assert frozen.command == replace(frame.command, frozen=True)
    assert frozen.image is frame.image
    clock.now += 50
    again = console.step(replace(console.command, frozen=False))
    assert again.command.needle.depth == 20.0
    assert again.metrics.time_s < 1  # frozen time does not count


def test_a_reset_can_be_undone_for_a_while(console, clock):
    moved = console.step(at_depth(console, 25.0).with_probe(sweep=2.0))
    console.reset()
    start = console.step()
    assert start.command == console.scene.start
    assert start.metrics.passes == 0
    clock.now += 7.9
    console.restore()
    back = console.step()
    assert back.command == moved.command
    assert back.metrics.passes == 1
    assert back.readouts.moved == pytest.approx(moved.readouts.moved, abs=0.1)
    with pytest.raises(ValueError, match="no reset of the last 8 s"):
        console.restore()
    console.reset()
    clock.now += 8.1
    with pytest.raises(ValueError, match="no reset"):
        console.restore()


def test_models_switch_at_the_same_pose(console):
    frames = {}
    for model in ("elastic", "paper", "kelvinlet", "elastic"):
        console.session.switch(model)
        frames[model] = console.settle(at_depth(console, 36.0))
    assert len({frame.command for frame in frames.values()}) == 1
    assert len({round(frame.readouts.moved, 3) for frame in frames.values()}) == 3
    assert frames["paper"].readouts.estimate is None
    assert 0 < frames["elastic"].readouts.estimate < 1e-3
    with pytest.raises(ValueError, match="model = 'magic' is not known; choose one of paper"):
        console.session.switch("magic")


def test_targets_are_chosen(console):
    console.session.choose_target("beside")
    frame = console.step(at_depth(console, 30.0))
    assert frame.target_rest == pytest.approx([70, 34, 20])
    with pytest.raises(ValueError, match="target = 'nowhere' is not known"):
        console.session.choose_target("nowhere")


def test_folding_tissue_is_seen(scene):
    from sonospline.fields.fold_check import folds

    grid, needle = scene.tissue.grid, the_needle(scene, scene.start.with_needle(depth=30.0))
    values = np.zeros((*grid.shape, 3), np.float32)
    assert not folds(ss.GridField(grid, values), needle)
    node = np.rint(grid.local(needle.tip[None])[0] / grid.spacing).astype(int)
    values[tuple(node)][0] = 1.2 * grid.spacing[0]
    assert folds(ss.GridField(grid, values), needle)
