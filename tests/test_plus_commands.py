"""Commands as clients of PLUS send them, and replies as they expect them."""

from xml.etree import ElementTree

import pytest

from link_client import LinkClient
from sonospline import igtl
from sonospline.link import LinkServer
from sonospline.link.plus_commands import CommandDesk, Outcome, parameters_xml


@pytest.fixture
def server():
    done = []

    def version(command):
        return Outcome(f"call {len(done)}", {"SonosplineVersion": "1"})

    def depth(command):
        done.append(command.attribute("UsDeviceId"))
        values = {name: value or None for name, value in command.parameters.items()}
        return Outcome("", {}, xml=parameters_xml(values, shows=True))

    desk = CommandDesk({"Version": version, "SetUsParameter": depth})
    with LinkServer(port=0, receive=lambda message, client: desk.answer(message, client) or ()) as made:
        made.done = done
        yield made


def asked(client, number, text):
    """Ask as PlusRemote does, and return what the reply says."""
    client.send(igtl.String(text), f"CMD_{number}")
    return ElementTree.fromstring(client.wait_for("STRING", f"ACK_{number}").content.text).attrib


def test_commands_in_strings(server):
    with LinkClient(server.port) as client:
        assert asked(client, 1, '<Command Name="Version" />') == {"Status": "SUCCESS", "Message": "call 0"}
        parameter = '<Parameter Name="DepthMm" Value="60"/>'
        said = asked(client, 2, f'<Command Name="setusparameter" UsDeviceId="Scanner">{parameter}</Command>')
        assert server.done == ["Scanner"]
        [parameter] = ElementTree.fromstring(said["Message"])
        assert parameter.attrib == {"Name": "DepthMm", "Success": "true", "Value": "60"}


def test_commands_in_commands(server):
    with LinkClient(server.port, 2) as client:
        client.send(igtl.Command(7, "Version", '<Command Name="Version" />'), "PlusServer")
        message = client.wait_for("RTS_COMMAND")
        assert (message.content.number, message.content.name, message.device) == (7, "Version", "PlusServer")
        assert ElementTree.fromstring(message.content.text).attrib["Status"] == "SUCCESS"
        assert message.metadata == {"Message": "call 0", "SonosplineVersion": "1", "Status": "SUCCESS"}
        client.send(igtl.Command(8, "SetUsParameter"), "PlusServer")
        failed = client.wait_for("RTS_COMMAND").metadata
        assert "no attribute UsDeviceId" in failed["Error"] == failed["ErrorMessage"]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('<Command Name="Conquer" />', "Unknown command: 'Conquer'"),
        ("<Command", "no XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><Command Name="&b;" />', "declares entities"),
        ("", "Unknown command"),
        ('<Command Name="SetUsParameter" />', "no attribute UsDeviceId"),
    ],
)
def test_what_cannot_be_done_is_said(server, text, why):
    with LinkClient(server.port) as client:
        said = asked(client, 5, text)
        assert said["Status"] == "FAIL"
        assert why in said["Message"]


def test_a_repeated_command_is_done_once(server):
    text = '<Command Name="SetUsParameter" UsDeviceId="x" />'
    with LinkClient(server.port) as client, LinkClient(server.port) as other:
        asked(client, 1, text)
        client.send(igtl.String(text), "CMD_1")
        asked(client, 2, text)
        assert server.done == ["x"] * 2
        asked(other, 1, text)  # numbers are each client's own
        assert server.done == ["x"] * 3
