"""How users call the package, for mypy: everything here is checked, nothing is run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, assert_type

import numpy as np
from numpy.typing import NDArray

import sonospline as ss
from sonospline import models
from sonospline.fields import ImageWarp, NodeSlice, PlaneSlice
from sonospline.geometry import facing
from sonospline.mechanics import LineForce, TissueMap

Array = NDArray[np.float64]


def box() -> None:
    grid = ss.Grid(shape=(25, 30, 35), spacing=(2, 2, 2.5), origin=(0, 0, 0), direction=np.eye(3))
    ss.Grid(shape=[25, 30, 35], spacing=2.0, origin=np.zeros(3), direction=[[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    ss.Grid.covering((100, 50, 25), nodes=1000, origin=[0, 0, 0])
    tissue = ss.Tissue(grid, entry_face="y+")
    assert_type(grid.local((1, 2, 3)), Array)
    assert_type(grid.contains([[1, 2, 3]]), NDArray[np.bool_])
    assert_type(tissue.distance_to_pinned((1, 2, 3)), Array)
    ss.Needle([0, 1, 2], np.array([3, 4, 5])).project((1, 2, 3))
    {grid: 1, tissue: 2, ss.Needle((0, 0, 0), (1, 0, 0)): 3}


def fields(field: ss.Field, needle: ss.Needle, path: Path) -> None:
    assert_type(field.displacement((0.4, 0.5, 0.5)), Array)
    assert_type(field.forward([[0.4, 0.5, 0.5], [0.1, 0.2, 0.3]]), Array)
    assert_type(field.inverse(np.zeros((5, 3))), Array)
    x, report = field.inverse((0, 0, 0), return_report=True)
    assert_type(x, Array)
    assert_type(report, ss.InverseReport)
    assert_type(field.inverse((0, 0, 0), return_report=False), Array)
    assert_type(field.jacobian((0, 0, 0)), Array)
    assert_type(field.det_jacobian(), Array)
    assert_type(field.error_estimate, float | None)
    field.plot(through=needle)
    field.plot(through=(0.5, 0.5, 0.5), normal=(0, 0, 1), arrows=12)
    field.save("u.h5")
    field.save(path / "u.vti")
    assert_type(ss.GridField.of(field), ss.GridField)
    ss.GridField(ss.Grid.unit_cube(3), np.zeros((3, 3, 3, 3)))
    ImageWarp.of(field).save(path)
    NodeSlice.of(field, axis="x", at=1).plot()
    PlaneSlice.of(field, ss.ImagePlane(image_to_reference=np.eye(4), shape=(5, 5), spacing_mm=0.5)).plot(needle=needle)


def simulations(path: Path) -> None:
    labels = ss.read_labels("organs.nii.gz", names={1: "liver"})
    assert_type(ss.read_labels(path, names=path), ss.LabelMap)
    assert_type(labels.names, Mapping[int, str])
    sim = ss.Simulation(labels, model="elastic", entry_face="y+", materials={"liver": ss.Material(6.5)})
    ss.Simulation(ss.Grid.unit_cube(25), model="kelvinlet", drag_mm=0.02)
    ss.Simulation(labels, materials=path)
    response = sim.insert([0, 0, 0], np.ones(3), steps=5, progress=lambda made, steps: made / steps)
    assert_type(response, ss.Response)
    assert_type(response.field, ss.Field)
    assert_type(response.forces["needle"].axial_n, float)
    for step in sim.run((0, 0, 0), (1, 1, 1)):
        assert_type(step, ss.Response)
    sim.step({"a": ss.Needle((0, 0, 0), (1, 0, 0))}, dt=0.1)
    model = models.make("elastic", sim.tissue, TissueMap.of(labels), solver_nodes=1000)
    assert_type(model.step(model.rest, {}), ss.Response)
    assert_type(LineForce.for_cube(100).friction, float)


def pictures(response: ss.Response, field: ss.Field, labels: ss.LabelMap, volume: ss.Volume, path: Path) -> None:
    pose = facing((0, 0, 0), depth=[0, 0, 1], right=np.array([1, 0, 0]))
    probe = ss.Probe.linear(frequency_mhz=10, depth_mm=80, lines=128)
    assert_type(probe.tuned(depth_mm=60), ss.Probe)
    assert_type(probe.beam_coordinates((0, 10, 0)), Array)
    scanner = ss.Scanner(labels, probe, probe_to_reference=pose)
    liver = ss.Phantom.uniform("liver", size_mm=(9, 9, 9)).tissues[0]
    ss.Scanner(volume, probe, pose.tolist(), tissues={0: "gel", 1: liver})
    ss.Phantom(labels, {0: "gel", 1: "liver"})
    image = scanner.render(response)
    assert_type(image, ss.BMode)
    scanner.render(field, ss.Needle((0, 0, 0), (1, 0, 0)), frame=3)
    assert_type(scanner.moved(pose.tolist()).with_display(gain_db=-20), ss.Scanner)
    image.save("b.png")
    image.save(path)
    image.plot(cmap="magma")
    frame = ss.Frame.placed([[1, 2], [3, 4]], spacing_mm=(0.1, 0.2), probe_to_reference=pose)
    assert_type(frame.deform(field), ss.Frame)
    ss.Frame.read("b.mha", image_to_reference=pose)
    assert_type(ss.Reslicer(volume, seen=ss.swept(volume)).cut(frame.plane, field), ss.Frame)
    assert_type(volume.sample((1, 2, 3)), NDArray[Any])
    ss.Volume(voxels=np.zeros((5, 5, 5)), spacing=[1, 1, 1], origin=[0, 0, 0], direction=np.eye(3).tolist())
