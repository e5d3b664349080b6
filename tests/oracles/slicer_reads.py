"""What 3D Slicer's own core makes of files: run by a Python that has slicer-core and trame-slicer; prints JSON."""

import json
import re
import sys
import tempfile

import slicer
import vtk
from trame_slicer.core import SlicerApp

app = SlicerApp()
scene = app.scene
messages = vtk.vtkStringOutputWindow()
vtk.vtkOutputWindow.SetInstance(messages)


def rows(matrix):
    return [[matrix.GetElement(i, j) for j in range(4)] for i in range(4)]


def described(node):
    """What a node is, and where in the world."""
    found = {"class": node.GetClassName(), "name": node.GetName()}
    if node.IsA("vtkMRMLTransformableNode"):
        matrix = vtk.vtkMatrix4x4()
        parent = node.GetParentTransformNode()
        if parent is None or parent.IsTransformToWorldLinear():
            slicer.vtkMRMLTransformNode.GetMatrixTransformBetweenNodes(parent, None, matrix)
            found["parent_to_world"] = rows(matrix)
    if node.IsA("vtkMRMLLinearTransformNode"):
        node.GetMatrixTransformToWorld(matrix)
        found["to_world"] = rows(matrix)
    if node.IsA("vtkMRMLModelNode") and node.GetPolyData():
        points = node.GetPolyData().GetPoints()
        found |= {"points": points.GetNumberOfPoints(), "cells": node.GetPolyData().GetNumberOfCells(),
                  "first": points.GetPoint(0), "last": points.GetPoint(points.GetNumberOfPoints() - 1)}  # fmt: skip
    if node.IsA("vtkMRMLScalarVolumeNode") and node.GetImageData():
        node.GetIJKToRASMatrix(matrix)
        data = node.GetImageData()
        found |= {"ijk_to_ras": rows(matrix), "size": data.GetDimensions(), "range": data.GetScalarRange()}
    if node.IsA("vtkMRMLMarkupsNode"):
        place, points = [0.0] * 3, []
        for number in range(node.GetNumberOfControlPoints()):
            node.GetNthControlPointPositionWorld(number, place)
            points.append([node.GetNthControlPointLabel(number), list(place)])
        found["points"] = points
    if node.IsA("vtkMRMLSegmentationNode"):
        found["segments"] = [segment_of(node, number) for number in range(node.GetSegmentation().GetNumberOfSegments())]
    if node.IsA("vtkMRMLSliceCompositeNode"):
        found["background"] = scene.GetNodeByID(node.GetBackgroundVolumeID()).GetName()
    if node.IsA("vtkMRMLSequenceNode"):
        steps = range(node.GetNumberOfDataNodes())
        found["steps"] = [[node.GetNthIndexValue(k), pose_of(node.GetNthDataNode(k))] for k in steps]
    if node.GetAttributeNames():
        found["attributes"] = {name: node.GetAttribute(name) for name in node.GetAttributeNames()}
    return found


def pose_of(node):
    matrix = vtk.vtkMatrix4x4()
    node.GetMatrixTransformToParent(matrix)
    return rows(matrix)


def segment_of(node, number):
    segment = node.GetSegmentation().GetNthSegment(number)
    labels = slicer.vtkOrientedImageData()
    node.GetBinaryLabelmapRepresentation(node.GetSegmentation().GetNthSegmentID(number), labels)
    tag = vtk.mutable("")
    segment.GetTag("TerminologyEntry", tag)
    histogram = vtk.vtkImageAccumulate()
    histogram.SetInputData(labels)
    histogram.IgnoreZeroOn()
    histogram.Update()
    return {"name": segment.GetName(), "voxels": histogram.GetVoxelCount(), "terminology": str(tag),
            "label": segment.GetLabelValue()}  # fmt: skip


def load(path):
    if path.endswith(".mrb"):
        said = slicer.vtkMRMLMessageCollection()
        scene.ReadFromMRB(path, True, said)
        errors = [text for text in re.split(r"^- ", said.GetAllMessagesAsString(), flags=re.MULTILINE) if text.strip()]
        unknown.extend(re.findall(r"Failed to CreateNodeByClass: (\w+)", said.GetAllMessagesAsString()))
        return len(errors) == len(unknown)
    kinds = {".seg.nrrd": ("vtkMRMLSegmentationNode", "vtkMRMLSegmentationStorageNode"),
             ".mrk.json": ("vtkMRMLMarkupsFiducialNode", "vtkMRMLMarkupsJsonStorageNode"),
             ".h5": ("vtkMRMLTransformNode", "vtkMRMLTransformStorageNode"),
             ".igs.mha": ("vtkMRMLSequenceNode", "vtkMRMLLinearTransformSequenceStorageNode"),
             ".mha": ("vtkMRMLScalarVolumeNode", "vtkMRMLVolumeArchetypeStorageNode"),
             ".nrrd": ("vtkMRMLScalarVolumeNode", "vtkMRMLVolumeArchetypeStorageNode")}  # fmt: skip
    kind, storage = next(value for suffix, value in kinds.items() if path.endswith(suffix))
    node, store = scene.AddNewNodeByClass(kind), scene.AddNewNodeByClass(storage)
    store.SetFileName(path)
    return store.ReadData(node)


def harden(name, file):
    node = scene.GetFirstNodeByName(name)
    done = node.HardenTransform() and node.GetParentTransformNode() is None
    store = node.GetStorageNode()
    store.SetFileName(file)
    return bool(done and store.WriteData(node))


def recorded(names):
    """What a browser of sequences has of nodes after two moments; in between the first, a transform, moves by 5 mm."""
    logic = slicer.vtkSlicerSequencesLogic()
    logic.SetMRMLScene(scene)
    browser = scene.AddNewNodeByClass("vtkMRMLSequenceBrowserNode")
    nodes = [scene.GetFirstNodeByName(name) for name in names]
    sequences = [logic.AddSynchronizedNode(None, node, browser) for node in nodes]
    browser.SetRecording(None, True)
    browser.SetRecordingSamplingMode(browser.SamplingAll)
    browser.SetRecordingActive(True)
    browser.SaveProxyNodesState()
    matrix = vtk.vtkMatrix4x4()
    nodes[0].GetMatrixTransformToParent(matrix)
    matrix.SetElement(0, 3, matrix.GetElement(0, 3) + 5)
    nodes[0].SetMatrixTransformToParent(matrix)
    while min(sequence.GetNumberOfDataNodes() for sequence in sequences) < 2:  # a moment has a millisecond
        browser.SaveProxyNodesState()
    found = {}
    for name, sequence in zip(names, sequences, strict=True):
        ends = [sequence.GetNthDataNode(number) for number in (0, sequence.GetNumberOfDataNodes() - 1)]
        found[name] = {"classes": [node.GetClassName() for node in ends]}
        if name == names[0]:
            found[name]["poses"] = [pose_of(node) for node in ends]
    return found


unknown = []
"""Classes of nodes that only extensions know."""
order = json.load(sys.stdin)
loaded = [int(load(path)) for path in order["load"]]
nodes = [scene.GetNthNode(number) for number in range(scene.GetNumberOfNodes())]
answer = {
    "loaded": loaded,
    "nodes": [described(node) for node in nodes],
    "messages": messages.GetOutput(),
    "unknown": unknown,
}
if "from_parent" in order:  # as the core sets the grid up, and with the interpolation of ITK
    back = scene.GetFirstNodeByClass("vtkMRMLTransformNode").GetTransformFromParent()
    answer["interpolation"] = back.GetInterpolationModeAsString()
    answer["from_parent"] = [back.TransformPoint(point) for point in order["from_parent"]]
    back.SetInterpolationModeToLinear()
    answer["from_parent_linearly"] = [back.TransformPoint(point) for point in order["from_parent"]]
    back.SetInterpolationModeToCubic()
if "record" in order:
    answer["recorded"] = recorded(order["record"])
if "harden" in order:  # nodes by name, each into a file
    answer["hardened"] = [harden(name, file) for name, file in order["harden"].items()]
if "save" in order:  # a segmentation as 3D Slicer itself writes it
    store = scene.GetFirstNodeByClass("vtkMRMLSegmentationStorageNode")
    store.SetFileName(order["save"])
    answer["saved"] = store.WriteData(scene.GetFirstNodeByClass("vtkMRMLSegmentationNode"))
with tempfile.NamedTemporaryFile("w", suffix=".json", delete=False) as file:
    json.dump(answer, file)
sys.stdout.write(f"{file.name}\n")
