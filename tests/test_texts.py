"""No public object dumps an array: neither its text nor an error is long."""

import importlib
import inspect
import tempfile
from functools import cache

import numpy as np
import pytest

import sonospline as ss
from force_hands import shaft
from igtl_values import OF_MESSAGES
from sonospline import (
    contact,
    elasticity,
    fem,
    fields,
    geometry,
    igtl,
    link,
    mechanics,
    models,
    simulator,
    tracking,
    training,
    ultrasound,
)
from sonospline.contact.laying import begun
from sonospline.geometry import BentNeedle, layered_block
from sonospline.models import elastic, spline
from sonospline.phantoms import KidneyPhantom

PACKAGES = [
    importlib.import_module(f"sonospline{name}")
    for name in (
        *("", ".geometry", ".fields", ".mechanics", ".models", ".models.elastic", ".models.spline"),
        *(".elasticity", ".contact", ".models.kelvinlet", ".ultrasound", ".fem", ".simulator", ".training"),
        *(".igtl", ".link", ".tracking", ".phantoms"),
    )
]
LONGEST = 200

GRID = ss.Grid(shape=(40, 50, 60), spacing=1.234567, origin=(1 / 3, 2 / 3, 1), direction=np.eye(3)[[1, 2, 0]])
PRESSED = ss.facing((50, 50, 10 / 3), depth=(0, 0, 1), right=(1, 0, 0))
BOX = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=4))
NEEDLE = ss.Needle((0, 48.3333333, 48), (200 / 3, 48, 48))
NAMES = {1: "liver", 2: "skin"}


class TRACKED:
    """A needle that has left a track."""

    tissue = ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=12.5))
    medium = contact.Medium(elasticity.ElasticSolver(tissue, mechanics.Material(10), nodes=9**3), width=10.0)
    displacement = medium.solver.rest.displacement
    needle = ss.Needle((0, 50, 50), (30, 50, 50))
    track = begun(medium, needle)
    answer = track.places, track.places


LABELS = ss.LabelMap(
    voxels=np.random.default_rng(0).integers(0, 3, (60, 50, 40)).astype(np.uint8), spacing=(2, 2, 2), names=NAMES
)
POSE = ss.facing((50, 50, 1), depth=(0, 0.1, 1), right=(1, 0, 0))
TISSUES = mechanics.TissueMap.of(LABELS)
PHANTOM = ss.Phantom.uniform("liver", size_mm=(60, 20, 60))
REGION = ultrasound.Region(0, 0, 399, 499, (1 / 3, 1 / 3))
PROBE = ss.Probe.linear(depth_mm=30, lines=64)


@cache
def insertion():
    made = ss.Insertion(BOX)
    made.advance(NEEDLE)
    return made


@cache
def incremental():
    made = ss.Insertion(BOX, ss.NeedleTissueModel.paper_incremental(100.0), accumulation="incremental")
    made.advance(NEEDLE)
    return made


@cache
def made_elastic():
    made = ss.ElasticInsertion(BOX, TISSUES, nodes=9**3)
    made.advance(NEEDLE)
    return made


@cache
def relaxing():
    series = dict.fromkeys(TISSUES.materials, mechanics.PronySeries()) | {1: mechanics.PronySeries.power_law(0.1)}
    return elasticity.RelaxingSolver(elasticity.ElasticSolver(BOX, TISSUES, nodes=9**3), series)


@cache
def pressing():
    solver = elasticity.ElasticSolver(ss.Tissue(BOX.grid, "z-"), nodes=1000)
    return elasticity.ProbeContact(solver, mechanics.Footprint(50, 20))


@cache
def moving():
    return elasticity.BackgroundMotion(
        pressing().solver, breathing=mechanics.Breathing(), cranial_face="x-", organ=[(50, 50, 60)]
    )


@cache
def plan():
    return mechanics.plan_landmarks(BOX, NEEDLE, ss.NeedleTissueModel.paper(100.0), max_landmarks=500)


@cache
def frame():
    return ss.Frame.placed(np.zeros((400, 300), np.uint8), spacing_mm=0.1, probe_to_reference=POSE)


@cache
def session():
    return ss.Session("cube", model="kelvinlet")


@cache
def stepwise_needle():
    points = np.linspace((1 / 3, 50, 50), (60, 50, 50), 30)
    return fem.StepwiseNeedle(fem.StepwiseTissue(BOX), entry=(0, 50, 50), points=points, width=3.6, bounds=50)


def attempt():
    tip = np.linspace((0, 0, 1 / 3), (0, 0, 30), 50)
    return training.Trace.of_needle(time_s=np.arange(50) / 3, entry=(0, 0, 0), tip=tip, target=(0, 0, 40))


def judged():
    exercise = training.Exercise.shipped("lesion-biopsy")
    marks = tuple(training.Judged(name, 100 / 3, mark) for name, mark in exercise.pass_mark.items())
    return training.Result(exercise, 1, "on target", attempt(), {}, marks)


@cache
def recorded():
    with tempfile.TemporaryDirectory() as folder, training.Recorder(f"{folder}/a.mcap", session().scene) as recorder:
        recorder.add(ss.Session(session().scene, model="kelvinlet").step())
        recorder.close()
        return recorder, training.Recording.read(f"{folder}/a.mcap")


MAKERS = {
    training.Metric: lambda: training.METRICS["passes"],
    training.Task: lambda: training.Task(forbidden=("colon*",)),
    training.ToolMotion: lambda: training.ToolMotion(np.arange(50) / 3, np.broadcast_to(POSE, (50, 4, 4))),
    training.Trace: attempt,
    training.Exercise: lambda: training.Exercise.shipped("calyx-breathing"),
    training.Judged: lambda: judged().marks[0],
    training.Result: judged,
    training.Recorder: lambda: recorded()[0],
    training.Recording: lambda: recorded()[1],
    training.Band: lambda: training.Band.of([1.0, 2.0]),
    training.Replayed: lambda: next(training.replay(recorded()[1], session().scene)),
    training.Step: lambda: recorded()[1].steps[0],
    ss.AcousticTissue: lambda: ultrasound.TISSUES["kidney cortex"],
    ss.BMode: lambda: ss.Scanner(PHANTOM, PROBE, POSE).render(),
    ss.Biharmonic: ss.Biharmonic,
    ss.CarriedField: lambda: ss.CarriedField(incremental().field, incremental().field),
    ss.ComposedField: lambda: incremental().field,
    ss.Display: ss.Display,
    ss.DragModel: ss.DragModel.kelvinlet,
    ss.ElasticInsertion: made_elastic,
    ss.Frame: frame,
    ss.Grid: lambda: GRID,
    ss.GridField: lambda: ss.GridField.of(insertion().field),
    ss.ImagePlane: lambda: frame().plane,
    ss.ImageWarp: lambda: ss.ImageWarp.of(insertion().field),
    ss.Insertion: insertion,
    ss.InverseReport: lambda: insertion().field.inverse(BOX.grid.points[:5000], return_report=True)[1],
    ss.Kelvinlet: lambda: ss.DragModel.kelvinlet(100 / 3).kernel,
    ss.KelvinletField: lambda: ss.KelvinletInsertion(BOX).tissue_model.solve(NEEDLE),
    ss.KelvinletInsertion: lambda: ss.KelvinletInsertion(BOX),
    ss.KernelField: lambda: insertion().field,
    ss.LabelMap: lambda: LABELS,
    ss.LineForce: ss.LineForce,
    ss.Material: ss.Material,
    ss.MaterialTable: ss.MaterialTable.assumed,
    ss.Needle: lambda: NEEDLE,
    BentNeedle: lambda: BentNeedle([(0, 48.3333333, 48), (100 / 3, 48, 48), (200 / 3, 48, 49)]),
    ss.NeedleEcho: ss.NeedleEcho.trocar,
    ss.NeedleForce: lambda: models.NeedleForce.along((0, 0, 1), np.full(3, 1 / 3)),
    ss.NeedleTissueModel: lambda: ss.NeedleTissueModel.paper(100 / 3),
    ss.Phantom: lambda: PHANTOM,
    ss.PolyharmonicSpline: lambda: ss.PolyharmonicSpline(np.random.default_rng(0).random((500, 3))),
    ss.Probe: lambda: PROBE,
    ss.Reslicer: lambda: ss.Reslicer(layered_block()),
    ss.Response: lambda: made_elastic().response,
    ss.Scanner: lambda: ss.Scanner(PHANTOM, PROBE, POSE),
    ss.Session: session,
    ss.Simulation: lambda: ss.Simulation(BOX, model="paper"),
    ss.State: lambda: ss.KelvinletInsertion(BOX).state,
    ss.Tissue: lambda: BOX,
    ss.TissueForce: lambda: ss.TissueForce(tissues=TISSUES),
    ss.TissueMap: lambda: TISSUES,
    ss.Triharmonic: ss.Triharmonic,
    ss.Volume: lambda: ss.Volume(voxels=np.zeros((200, 20, 30)), spacing=(1 / 3, 1 / 7, 2), origin=(1 / 3, 1 / 7, 2)),
    geometry.Projection: lambda: NEEDLE.project(BOX.grid.points),
    fields.NodeSlice: lambda: fields.NodeSlice.of(insertion().field, at=40),
    fields.PlaneSlice: lambda: fields.PlaneSlice.of(insertion().field, frame().plane),
    fields.Strain: lambda: made_elastic().largest_strain(),
    fields.TheoryError: lambda: made_elastic().largest_strain().theory_error,
    mechanics.AxialForce: lambda: ss.TissueForce(tissues=TISSUES).along(NEEDLE),
    mechanics.PointForces: lambda: ss.TissueForce(tissues=TISSUES).along(NEEDLE).at_points(NEEDLE.depth, 3.0),
    mechanics.AmortisedParameters: mechanics.AmortisedParameters.shipped,
    mechanics.Breathing: lambda: mechanics.Breathing().held(100 / 3),
    mechanics.BreathHold: lambda: mechanics.BreathHold(100 / 3, 50),
    mechanics.Spread: lambda: mechanics.Spread(100 / 3, 5, 10, 50),
    mechanics.Stiffening: lambda: mechanics.Stiffening(5.0),
    mechanics.Footprint: lambda: mechanics.Footprint(100 / 3, 10, 60),
    elasticity.Background: lambda: moving().at(1.5, PRESSED),
    elasticity.BackgroundMotion: lambda: moving(),
    elasticity.Dent: lambda: pressing().dent(PRESSED),
    elasticity.FaceCompliance: lambda: pressing().face,
    elasticity.ProbeContact: lambda: pressing(),
    elasticity.ProbeDents: lambda: elasticity.ProbeDents(pressing()),
    mechanics.Blocked: lambda: mechanics.Blocked("needle", "rib_left_8", 100 / 3),
    mechanics.History: lambda: plan().history,
    mechanics.Moduli: lambda: TISSUES.moduli(ss.Grid(shape=(30, 30, 30), spacing=2)),
    mechanics.Obstacle: lambda: mechanics.Obstacle(7, "rib_left_8", 100 / 3, NEEDLE.tip),
    mechanics.Creep: lambda: mechanics.PronySeries.power_law(0.1).creep,
    mechanics.ExponentialStep: lambda: mechanics.PronySeries.power_law(0.1).creep.step(1 / 60),
    mechanics.PronySeries: lambda: mechanics.PronySeries.power_law(0.1),
    mechanics.Shaft: lambda: mechanics.Shaft.undeformed(NEEDLE),
    mechanics.ShaftDisplacement: mechanics.ShaftDisplacement,
    models.ElasticModel: lambda: made_elastic().tissue_model,
    contact.Answer: lambda: contact.Answer(*TRACKED.answer),
    contact.Medium: lambda: TRACKED.medium,
    contact.Motion: lambda: contact.Motion.of(NEEDLE, NEEDLE, 1 / 30),
    contact.Push: lambda: contact.Push(TRACKED.medium, "needle", contact.Motion(NEEDLE, NEEDLE), TRACKED.displacement),
    contact.Touched: lambda: contact.Touched("needle", "rib 11"),
    contact.Punctured: lambda: contact.Punctured("needle", "renal capsule", 100 / 3),
    contact.Held: lambda: contact.Held("needle", "muscle", 0.25),
    contact.Left: lambda: contact.Left("needle", "renal capsule"),
    contact.Track: lambda: TRACKED.track,
    mechanics.Membrane: lambda: mechanics.Membrane("renal capsule", ["kidney*"] * 9, 100 / 3),
    elasticity.ElasticSolver: lambda: made_elastic().solver,
    elasticity.RelaxingSolver: relaxing,
    elasticity.RelaxingState: lambda: relaxing().rest,
    models.Identity: lambda: made_elastic().state.model,
    models.KelvinletModel: lambda: ss.KelvinletInsertion(BOX).tissue_model,
    models.ModelSpec: lambda: models.spec("elastic"),
    models.NeedleInsertion: lambda: models.NeedleInsertion(models.make("kelvinlet", BOX)),
    models.Option: lambda: models.spec("elastic").options[0],
    models.SplineModel: lambda: insertion().tissue_model,
    models.UnknownForces: lambda: insertion().response.forces,
    elasticity.ElasticState: lambda: made_elastic().solution,
    elastic.ElasticTissueState: lambda: made_elastic().state,
    mechanics.LandmarkPlan: plan,
    spline.SplineState: lambda: incremental().state,
    ultrasound.Clip: lambda: ultrasound.Clip(
        np.zeros((50, 40, 30), np.uint8), (ultrasound.Region(0, 0, 9, 9, (1, 1)),), 40
    ),
    KidneyPhantom: lambda: ss.kidney_phantom(spacing_mm=3),
    ultrasound.ColourFlow: lambda: ultrasound.ColourFlow(np.zeros((2, 2)), np.zeros((2, 2)), (0, 0), 20 / 3, []),
    ultrasound.Region: lambda: REGION,
    fem.FiniteElementModel: lambda: fem.FiniteElementModel(BOX),
    fem.StepTimes: lambda: fem.StepTimes(*[1 / 3] * len(fem.StepTimes._fields)),
    fem.StepwiseNeedle: stepwise_needle,
    fem.StepwiseNeedleState: lambda: stepwise_needle().rest,
    fem.StepwiseTissue: lambda: fem.StepwiseTissue(BOX),
    fem.StepwiseTissueState: lambda: fem.StepwiseTissue(BOX).rest,
    link.ClientInfo: lambda: link.ClientInfo("127.0.0.1:50000", 2, 10**9, 10**9, 10**9, 10**9),
    link.Coupling: lambda: link.Coupling(delay_ms=100 / 31),
    link.DeviceLimits: lambda: link.DeviceLimits(10 / 3),
    link.DeviceState: lambda: link.DeviceState((1 / 3, 2 / 3, 1 / 7)),
    link.FakeDevice: lambda: link.FakeDevice((0, 0, 0), hands=1000),
    link.Felt: lambda: link.FakeDevice((0, 0, 0)).move(lambda now: (1, 2, 3), seconds=0.1),
    link.ForceReading: lambda: link.ForceReading((1 / 3, 0.0, 0.0), 0.0, 0.0, 0.0, 1e-7 / 3, "felt"),
    link.ForceTiming: lambda: link.ForceTiming(600_000, 0, 1 / 30, 1 / 3, 2 / 3, False),
    tracking.TransformRepository: tracking.TransformRepository,
    tracking.Clutch: tracking.Clutch,
    tracking.PoseTrack: tracking.PoseTrack,
    contact.FrozenContact: lambda: shaft(tip_mm=(100 / 3, 0, 0), axis=(1, 1, 1)),
    link.PageDevice: lambda: link.PageDevice(10 / 3),
    link.PageForce: lambda: link.PageForce((1 / 3, 0.0, 0.0), 1 / 3, 1 / 3, 1 / 7),
    **OF_MESSAGES,
    simulator.Console: lambda: simulator.Console(session()),
    simulator.ConsoleFrame: lambda: simulator.Console(session()).step(),
    simulator.NeedleCommand: lambda: simulator.Console(session()).command.needle,
    simulator.ProbeCommand: lambda: simulator.Console(session()).command.probe,
    simulator.ImageSettings: lambda: simulator.Console(session()).command.image,
    simulator.HubForce: lambda: simulator.HubForce(10 / 3, 1 / 3, 200 / 3),
    simulator.Readouts: lambda: session().step().readouts,
    simulator.TissueSettings: lambda: simulator.TissueSettings(breathing="free"),
    simulator.Scene: lambda: session().scene,
    simulator.SimulatedFrame: lambda: session().step(),
}
LEFT_OUT = {
    *(ultrasound.Artefacts, ultrasound.Doppler, ultrasound.Flow),  # levels and lengths, few of them
    *(
        link.ForceDevice,
        link.ForceLoop,
        link.HaplyInverse,
        link.CoordinateDefinition,
        link.LinkServer,
        link.PageLink,
        link.TrackerDevice,
        link.Scanner,
        link.ScannerNames,
        link.UdpDevice,
    ),  # a protocol; what needs a core, a service, a port
    *(simulator.Command, simulator.Knobs, simulator.SceneFile, simulator.Constrained),  # settings, all of them scalars
    igtl.Framer,  # a stream
    *(tracking.LinkClient, tracking.RecordedHand),  # a service, a thread
    *(training.Attempt, training.Expert, training.Hand, training.Novice),  # which hold no arrays
    *(training.GrowingTrace, training.ReplayPlayer),
    *(simulator.Runner, simulator.Stamp, simulator.Subscription),  # which hold no arrays
}


def public_classes():
    for package in PACKAGES:
        for name in package.__all__:
            found = getattr(package, name)
            if inspect.isclass(found) and not issubclass(found, BaseException) and not inspect.isabstract(found):
                yield found


def test_every_public_class_is_looked_at():
    missing = {found.__qualname__ for found in public_classes()} - {
        known.__qualname__ for known in {*MAKERS, *LEFT_OUT}
    }
    assert not missing


@pytest.mark.parametrize("kind", MAKERS, ids=lambda kind: kind.__name__)
def test_its_text_is_one_short_line(kind, tmp_path, monkeypatch):
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path))
    value = MAKERS[kind]()
    assert type(value) is kind or issubclass(type(value), kind)
    text = repr(value)
    assert len(text) < LONGEST
    assert len(text.splitlines()) == 1
    assert text.startswith(kind.__name__ if type(value) is kind else type(value).__name__)
    assert "array" not in text
    assert "object at 0x" not in text


HUGE = np.random.default_rng(0).random((300, 300))
WRONG = {
    "Needle": lambda: ss.Needle(HUGE, (0, 0, 0)),
    "Needle text": lambda: ss.Needle("x" * 5000, (0, 0, 0)),
    "Grid shape": lambda: ss.Grid(shape=HUGE, spacing=1),
    "Grid spacing": lambda: ss.Grid(shape=(5, 5, 5), spacing=HUGE),
    "Grid direction": lambda: ss.Grid(shape=(5, 5, 5), spacing=1, direction=HUGE),
    "Grid direction list": lambda: ss.Grid(shape=(5, 5, 5), spacing=1, direction=HUGE.tolist()),
    "Tissue": lambda: ss.Tissue(HUGE),
    "entry_face": lambda: ss.Tissue(GRID, HUGE),
    "entry_face text": lambda: ss.Tissue(GRID, "x" * 5000),
    "facing": lambda: ss.facing(HUGE, depth=(0, 0, 1), right=(1, 0, 0)),
    "ImagePlane": lambda: ss.ImagePlane(image_to_reference=HUGE, shape=(5, 5), spacing_mm=1),
    "ImagePlane NaN": lambda: ss.ImagePlane(image_to_reference=np.full((4, 4), np.nan), shape=(5, 5), spacing_mm=1),
    "ImagePlane shape": lambda: ss.ImagePlane(image_to_reference=POSE, shape=HUGE, spacing_mm=1),
    "ImagePlane spacing": lambda: ss.ImagePlane(image_to_reference=POSE, shape=(5, 5), spacing_mm=HUGE),
    "Volume": lambda: ss.Volume(voxels=HUGE, spacing=(1, 1, 1)),
    "LabelMap": lambda: ss.LabelMap(voxels=HUGE[None].repeat(2, axis=0), spacing=(1, 1, 1)),
    "Phantom": lambda: ss.Phantom(HUGE, {}),
    "Scanner": lambda: ss.Scanner(HUGE, PROBE, POSE),
    "Scanner probe": lambda: ss.Scanner(PHANTOM, HUGE, POSE),
    "Scanner pose": lambda: ss.Scanner(PHANTOM, PROBE, HUGE),
    "render": lambda: ss.Scanner(PHANTOM, PROBE, POSE).render(HUGE),
    "Reslicer": lambda: ss.Reslicer(HUGE),
    "Probe": lambda: ss.Probe.linear(depth_mm=HUGE),
    "Probe kind": lambda: ss.Probe(kind="x" * 5000, frequency_mhz=5, depth_mm=50, aperture_mm=30),
    "Insertion": lambda: ss.Insertion(HUGE),
    "Simulation": lambda: ss.Simulation(HUGE),
    "Simulation materials": lambda: ss.Simulation(BOX, materials=HUGE),
    "Simulation labels": lambda: ss.Simulation(LABELS, materials=HUGE),
    "ElasticInsertion": lambda: ss.ElasticInsertion(BOX, HUGE),
    "TissueMap": lambda: ss.TissueMap(HUGE, {}),
    "TissueForce": lambda: ss.TissueForce(tissues=HUGE),
    "Material": lambda: ss.Material(HUGE),
    "GridField": lambda: ss.GridField(GRID, HUGE),
    "GridField order": lambda: ss.GridField(GRID, np.zeros((*GRID.shape, 3)), order=HUGE),
    "points": lambda: insertion().field.displacement(HUGE),
    "step": lambda: insertion().tissue_model.step(HUGE),
    "needles": lambda: insertion().tissue_model.step(insertion().tissue_model.rest, {"needle": HUGE}),
    "advance": lambda: insertion().advance(HUGE),
    "read_labels": lambda: ss.read_labels("x" * 260 + ".nrrd"),
}


@pytest.mark.parametrize("name", WRONG)
def test_an_error_is_one_short_line(name):
    with pytest.raises(ValueError) as error:
        WRONG[name]()
    text = str(error.value)
    assert len(text.splitlines()) == 1
    assert len(text) < 400
