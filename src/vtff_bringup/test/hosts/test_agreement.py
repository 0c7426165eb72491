"""Clocks, silence and discovery of the hosts of a run."""

from __future__ import annotations

import random
import xml.etree.ElementTree as ElementTree

import pytest

from vtff_bringup.hosts.clock_comparison import ClockComparison, compare_clocks
from vtff_bringup.hosts.dds_profile import profile_text
from vtff_bringup.hosts.silence import LARGEST_SILENCE, NOTICED_SILENCE, SilenceWatch
from vtff_node.executables import share_file

NAMESPACE = {"dds": "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"}


@pytest.mark.parametrize("offset", [0.0, 0.25, -3.0])
def test_the_offset_is_within_its_uncertainty(offset):
    """Delays of both ways differ, as over a network with jitter."""
    drawn = random.Random(4)
    exchanges = []
    for second in range(10):
        there, back = drawn.uniform(0.003, 0.007), drawn.uniform(0.003, 0.007)
        exchanges.append((float(second), second + there + offset, second + there + back))
    comparison = compare_clocks(exchanges)
    assert abs(comparison.offset - offset) <= comparison.uncertainty < 0.007
    assert comparison.is_tolerated == (abs(offset) < 0.1)


def test_the_fastest_exchange_counts():
    assert compare_clocks([(0.0, 5.0, 1.0), (2.0, 2.11, 2.02)]).offset == pytest.approx(0.1)


def test_a_clock_that_may_agree_is_no_warning():
    assert ClockComparison(offset=0.3, uncertainty=0.25).is_tolerated


def test_a_silence_is_said_once_and_ends():
    now, lines = [0.0], []
    watch = SilenceWatch("'deputy' (192.0.2.2)", lines.append, lambda: now[0])
    now[0] = NOTICED_SILENCE
    assert not watch.is_lost() and not lines
    now[0] = NOTICED_SILENCE + 0.1
    assert not watch.is_lost() and not watch.is_lost()
    assert len(lines) == 1 and "host 'deputy' (192.0.2.2) is silent" in lines[0]
    now[0] = 10.0
    watch.note_heard()
    assert lines[1:] == ["host 'deputy' (192.0.2.2) is heard again after 10 s"]
    now[0] = 10.0 + LARGEST_SILENCE
    assert not watch.is_lost()
    now[0] += 0.1
    assert watch.is_lost()


def test_a_profile_names_the_addresses_and_no_group():
    general = share_file("vtff_bringup", "config/dds/fastdds_network.xml").read_text()
    text = profile_text(general, "192.0.2.2", ["192.0.2.1", "192.0.2.2", "192.0.2.3"], 5)
    root = ElementTree.fromstring(text)

    def texts(path):
        return [element.text for element in root.iterfind(path, NAMESPACE)]

    assert texts(".//dds:interfaceWhiteList/dds:address") == ["192.0.2.2"]
    peers = texts(".//dds:initialPeersList/dds:locator/dds:udpv4/dds:address")
    assert sorted(peers) == ["192.0.2.1", "192.0.2.2", "192.0.2.3"]
    assert texts(".//dds:metatrafficUnicastLocatorList//dds:address") == ["192.0.2.2"]
    assert int(texts(".//dds:maxInitialPeersRange")[0]) > 5
    assert "ulticast" not in "".join(element.tag for element in root.iter())
