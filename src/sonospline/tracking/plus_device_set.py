"""A device set of PLUS that has our scanner and its tracker as devices."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree

PLUS_PORT = 18945
"""Where PLUS then serves: 18944 is the scanner's."""


def plus_device_set(
    *,
    port: int = 18944,
    host: str = "localhost",
    tools: Iterable[str] = ("Probe", "Needle", "NeedleTip"),
    reference: str = "Reference",
    rate: float = 30.0,
    orientation: str = "MF",
) -> str:
    """Return the XML file that PlusServer opens to take its images and poses from a link of ours.

    Its own clients find images, transforms and recordings at port 18945.

    Examples
    --------
    >>> from sonospline.tracking import plus_device_set
    >>> plus_device_set(port=18950).count('ServerPort="18950"')
    2
    """
    root = ElementTree.Element("PlusConfiguration", version="2.3")
    collection = ElementTree.SubElement(root, "DataCollection", StartupDelaySec="1.0")
    description = "Images and poses of a simulated scanner of Sonospline, by OpenIGTLink. Not for clinical use."
    ElementTree.SubElement(collection, "DeviceSet", Name="PlusServer: Sonospline", Description=description)
    received = {
        "ServerAddress": host, "ServerPort": str(port), "IgtlMessageCrcCheckEnabled": "true",
        "UseReceivedTimestamps": "true", "ReconnectOnReceiveTimeout": "true", "ReceiveTimeoutSec": "5",
        "AcquisitionRate": f"{rate:g}",
    }  # fmt: skip
    found = list(tools)
    tracker = _device(collection, "TrackerDevice", "OpenIGTLinkTracker", MessageType="TRANSFORM", **received,
                      ToolReferenceFrame=reference)  # fmt: skip
    _sources(tracker, [{"Type": "Tool", "Id": tool} for tool in found])
    _channel(tracker, "TrackerStream", found)
    video = _device(collection, "VideoDevice", "OpenIGTLinkVideo", MessageType="IMAGE", **received,
                    ImageMessageEmbeddedTransformName=f"ImageTo{reference}")  # fmt: skip
    _sources(video, [{"Type": "Video", "Id": "Video", "PortUsImageOrientation": orientation}])
    _channel(video, "VideoStream", [], VideoDataSourceId="Video")
    mixer = _device(collection, "TrackedVideoDevice", "VirtualMixer")
    _inputs(mixer, "TrackerStream", "VideoStream")
    _channel(mixer, "TrackedVideoStream", [])
    capture = _device(collection, "CaptureDevice", "VirtualCapture", BaseFilename="Recording.igs.mha",
                      EnableCapturingOnStart="FALSE")  # fmt: skip
    _inputs(capture, "TrackedVideoStream")
    _server(root, found, reference)
    ElementTree.indent(root)
    return f"{ElementTree.tostring(root, encoding='unicode')}\n"


def _device(collection: ElementTree.Element, id_: str, kind: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(collection, "Device", {"Id": id_, "Type": kind, **attributes})


def _sources(device: ElementTree.Element, sources: list[dict[str, str]]) -> None:
    held = ElementTree.SubElement(device, "DataSources")
    for source in sources:
        ElementTree.SubElement(held, "DataSource", source)


def _inputs(device: ElementTree.Element, *channels: str) -> None:
    held = ElementTree.SubElement(device, "InputChannels")
    for channel in channels:
        ElementTree.SubElement(held, "InputChannel", Id=channel)


def _channel(device: ElementTree.Element, id_: str, sources: list[str], **attributes: str) -> None:
    held = ElementTree.SubElement(device, "OutputChannels")
    channel = ElementTree.SubElement(held, "OutputChannel", {"Id": id_, **attributes})
    for source in sources:
        ElementTree.SubElement(channel, "DataSource", Id=source)


def _server(root: ElementTree.Element, tools: list[str], reference: str) -> None:
    server = ElementTree.SubElement(
        root, "PlusOpenIGTLinkServer", ListeningPort=str(PLUS_PORT), OutputChannelId="TrackedVideoStream",
        SendValidTransformsOnly="true",
    )  # fmt: skip
    info = ElementTree.SubElement(server, "DefaultClientInfo")
    types = ElementTree.SubElement(info, "MessageTypes")
    for kind in ("IMAGE", "TRANSFORM"):
        ElementTree.SubElement(types, "Message", Type=kind)
    names = ElementTree.SubElement(info, "TransformNames")
    for tool in tools:
        ElementTree.SubElement(names, "Transform", Name=f"{tool}To{reference}")
    images = ElementTree.SubElement(info, "ImageNames")
    ElementTree.SubElement(images, "Image", Name="Image", EmbeddedTransformToFrame=reference)
