"""PLUS's own scene of a simulated scanner, SimulatedUltrasound_3DSlicer: what it asks for and sends, it finds here.

The names are facts from the XML of PlusLibData, commit 51dcbb7: the device set
ConfigFiles/PlusDeviceSet_Server_SimulatedUltrasound_3DSlicer.xml, and the scene of 3D Slicer that belongs to it, the
.mrml in ConfigFiles/SimulatedUltrasound_Scene.mrb.
"""

import numpy as np
import pytest

import sonospline as ss
from link_client import LinkClient
from link_poses import SMALL_BLOCK, turned
from sonospline import igtl
from sonospline.geometry.pose import pose_along
from sonospline.link import LinkServer, Scanner, ScannerNames
from sonospline.simulator import SceneFile, make_scene

INCOMING = {"Image_Reference": "IMAGE", "NeedleTipToReference": "TRANSFORM", "ProbeToReference": "TRANSFORM"}
"""Nodes of the connector that is a client of port 18944, which are what the device set's server sends."""
OUTGOING = ("ProbeToTracker", "NeedleToTracker", "ReferenceToTracker")
"""Nodes of the connector that is a server, pushed when somebody connects: the tools of the device set's tracker."""


@pytest.mark.slow
def test_its_connectors_get_what_they_listen_to():
    """In headers of version 1; probe and needle follow the transforms to the tracker, and the image the probe."""
    scene = make_scene(SceneFile.parse(SMALL_BLOCK))
    reference = turned(4)
    tip = pose_along(scene.frame.origin + 12 * scene.frame.depth, scene.frame.depth)
    probe = np.array(scene.frame.probe_to_reference(scene.start.probe, 0.0))
    probe[:3, 3] += 3 * probe[:3, 0]
    poses = dict(zip(OUTGOING, (reference @ probe, reference @ tip, reference), strict=True))
    with LinkServer(port=0) as slicer:
        names = ScannerNames().with_tracker(f"127.0.0.1:{slicer.port}")
        with (
            Scanner(ss.Session(scene, model="kelvinlet"), port=0, names=names) as scanner,
            LinkClient(scanner.server.port) as client,
        ):
            found = {}

            def there():
                slicer.publish(*(igtl.Message(igtl.Transform(pose), name, igtl.now()) for name, pose in poses.items()))
                found.update({name: client.wait_for(kind, name).content for name, kind in INCOMING.items()})
                places = (found["ProbeToReference"].matrix, found["NeedleTipToReference"].matrix)
                return all(np.allclose(a, b, atol=1e-3) for a, b in zip(places, (probe, tip), strict=True))

            for _ in range(500):
                if there():
                    break
            else:
                pytest.fail("probe and needle do not follow")
            image = client.wait_for("IMAGE", "Image_Reference").content
            assert set(client.versions) == {1}
    assert (image.voxels.ndim, image.voxels.dtype, image.size[2]) == (3, np.uint8, 1)
    plane = image.ijk_to_reference
    assert abs(plane[:3, 2] @ (probe[:3, 3] - plane[:3, 3])) < 0.05  # the probe's face lies in the image's plane
    assert abs(plane[:3, 0] @ probe[:3, 0]) == pytest.approx(np.linalg.norm(plane[:3, 0]), rel=1e-4)
