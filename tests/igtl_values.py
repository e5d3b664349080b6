"""One of each public class of OpenIGTLink, with long names and awkward numbers: what tests of their texts look at."""

import numpy as np

from sonospline import igtl

OF_MESSAGES = {
    igtl.Attribute: lambda: igtl.Attribute("x" * 200, np.ones((500, 3)), "vectors"),
    igtl.Capability: lambda: igtl.Capability(["TRANSFORM"] * 300),
    igtl.Command: lambda: igtl.Command(7, "x" * 100, "y" * 1000),
    igtl.CommandReply: lambda: igtl.CommandReply(7, "x" * 100, "y" * 1000),
    igtl.Get: lambda: igtl.Get("CAPABILITY"),
    igtl.Header: lambda: igtl.Header(1, "NDARRAY", "x" * 20, (1 << 64) - 1, 1 << 26, (1 << 64) - 1),
    igtl.Image: lambda: igtl.Image.of(np.zeros((30, 20, 10, 3), np.uint16), np.diag([1 / 3, 1 / 3, 1, 1])),
    igtl.ImageEntry: lambda: igtl.ImageEntry("x" * 20, (640, 480, 1), name="y" * 60),
    igtl.ImageList: lambda: igtl.ImageList([igtl.ImageEntry("x", (1, 1, 1))] * 300),
    igtl.LabelEntry: lambda: igtl.LabelEntry("x" * 20, 3, "y" * 60),
    igtl.LabelList: lambda: igtl.LabelList([igtl.LabelEntry("x", 1)] * 300),
    igtl.Message: lambda: igtl.Message(igtl.String("x" * 5000), "y" * 20),
    igtl.Nothing: lambda: igtl.Nothing("TRANSFORM"),
    igtl.NumberArray: lambda: igtl.NumberArray(np.zeros((3, 4, 5))),
    igtl.Point: lambda: igtl.Point((100 / 3, 200 / 3, 1), "x" * 60),
    igtl.Points: lambda: igtl.Points([igtl.Point((1, 2, 3))] * 300),
    igtl.PolyData: lambda: igtl.PolyData(np.zeros((900, 3)), polygons=np.zeros((500, 3), int)),
    igtl.Position: lambda: igtl.Position((100 / 3, 200 / 3, 1), (1 / 3, 2 / 3, 2 / 3, 0)),
    igtl.QuaternionTool: lambda: igtl.QuaternionTool("x" * 20, (100 / 3, 200 / 3, 1)),
    igtl.QuaternionTrackingData: lambda: igtl.QuaternionTrackingData([igtl.QuaternionTool("x" * 20, (1, 2, 3))] * 300),
    igtl.QuaternionTransform: lambda: igtl.QuaternionTransform((100 / 3, 200 / 3, 1)),
    igtl.Reply: lambda: igtl.Reply("TDATA", ok=False),
    igtl.Sensor: lambda: igtl.Sensor(np.arange(255) / 3, igtl.unit("newton")),
    igtl.Start: lambda: igtl.Start("TDATA", 50, "x" * 32),
    igtl.Status: lambda: igtl.Status(8, "x" * 1000, "y" * 20),
    igtl.Stop: lambda: igtl.Stop("TDATA"),
    igtl.String: lambda: igtl.String("x" * 1000),
    igtl.Tool: lambda: igtl.Tool("x" * 20, np.diag([1 / 3, 1 / 3, 1, 1])),
    igtl.TrackingData: lambda: igtl.TrackingData([igtl.Tool("x" * 20, np.eye(4))] * 300),
    igtl.Transform: lambda: igtl.Transform(np.diag([1 / 3, 1 / 3, 1, 1])),
}
