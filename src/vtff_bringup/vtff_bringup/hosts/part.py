"""What both kinds of parts of a run on several machines share."""

from __future__ import annotations

import pathlib
from collections.abc import Mapping
from typing import Any

from vtff_bringup.hosts.dds_profile import write_profile
from vtff_bringup.run.domain import DOMAIN_VARIABLE, PROFILES_VARIABLE, RANGE_VARIABLE
from vtff_bringup.run.host_session import HostSession
from vtff_bringup.system.description import HostDescription, SystemDescription

__all__ = [
    "CONCLUSION_LIMIT",
    "STAGE_LIMIT",
    "WAITING_INTERVAL",
    "HostPart",
    "checked_counts",
    "quote_host",
    "recording_host",
]

#: Time between two lines that say for what a part waits, s.
WAITING_INTERVAL = 5.0

#: Longest wait for the other hosts to end one stage, s: their processes have 35 s.
STAGE_LIMIT = 50.0

#: Longest wait for the word of the host that records, s.
CONCLUSION_LIMIT = 60.0

#: Variables of ROS and DDS that would lead the nodes past the profile of the run.
_STATIC_PEERS = "ROS_STATIC_PEERS"
_DISCOVERY_SERVER = "ROS_DISCOVERY_SERVER"


class HostPart(HostSession):
    """One part of a run on several machines."""

    @property
    def is_main(self) -> bool:
        """Whether this host runs the node that ends the run."""
        return self.host == self.description.hosts[0].name

    @property
    def records(self) -> bool:
        """Whether this host records the bag."""
        return self.host == recording_host(self.description)

    def add_dds_settings(self, environment: dict[str, str], run_directory: pathlib.Path) -> None:
        """Let the nodes of this host find those of the others, and nobody else.

        Raises
        ------
        OSError
            If the profile cannot be written into the run folder.
        """
        hosts = self.description.hosts
        largest = max(
            sum(node.host == host.name for node in self.description.nodes) for host in hosts
        )
        own = next(host.address for host in hosts if host.name == self.host)
        profile = write_profile(run_directory, own, [host.address for host in hosts], largest)
        for name in (_STATIC_PEERS, _DISCOVERY_SERVER):
            environment.pop(name, None)
        environment[PROFILES_VARIABLE] = str(profile)
        environment[RANGE_VARIABLE] = "SYSTEM_DEFAULT"  # ROS adds nothing to the profile
        environment[DOMAIN_VARIABLE] = str(self.domain)


def recording_host(description: SystemDescription) -> str:
    """Return the name of the host whose recorder writes the bag; empty without a recorder."""
    return next((node.host for node in description.nodes if node.own_process), "")


def checked_counts(content: Mapping[str, Any]) -> dict[str, str]:
    """Return what of a message may become files of the run folder: plain names with texts."""
    return {
        name: text
        for name, text in content.items()
        if name.endswith(".json") and "/" not in name and isinstance(text, str)
    }


def quote_host(host: HostDescription) -> str:
    """Return name and address of a host for messages."""
    return f"'{host.name}' ({host.address})"
