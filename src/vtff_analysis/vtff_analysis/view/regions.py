"""Where plasma bubbles are: regions of the GNSS simulator's configuration, and the dip equator."""

from __future__ import annotations

import math
import pathlib

from vtff_analysis.view.scene import Region, Scene
from vtff_bag.run.description import RunDescription
from vtff_dynamics.attitude.dip_equator import dip_equator
from vtff_dynamics.time.timescales import GpsTime
from vtff_sim_bridge.gnss.configuration import load_gnss_configuration

GNSS_ARGUMENT = "gnss"
_STEP = 60.0  # s; over this time the motion of the sides is computed
_IONOSPHERE = 350e3  # m; altitude of the dip equator that is drawn


def irregularity_regions(described: RunDescription, start: int) -> tuple[Region, ...]:
    """Return the irregularity regions of the simulated ionosphere.

    Parameters
    ----------
    described
        The run; its argument ``gnss`` names the file of the GNSS simulator.
    start
        Start of the scene, ns since 1970.

    Returns
    -------
    tuple of Region
        Empty where the run names no file, or the file is not on this machine.

    Raises
    ------
    ValueError
        If the file is wrong.
    """
    named = described.arguments.get(GNSS_ARGUMENT)
    path = pathlib.Path(str(named)) if named else None
    if path is None or not path.is_file():
        return ()
    time = GpsTime.from_unix_nanoseconds(start)
    regions = []
    for region in load_gnss_configuration(path).regions:
        west, width = region.longitude_limits(time)
        if region.drift_east is None:
            later, _ = region.longitude_limits(time + _STEP)
            turn = math.remainder(later - west, 2.0 * math.pi)
        else:
            turn = float(region.drift_angle(_STEP))
        regions.append(
            Region(
                name=region.name,
                latitude_south_deg=math.degrees(region.latitude_south),
                latitude_north_deg=math.degrees(region.latitude_north),
                longitude_west_deg=math.degrees(math.remainder(west, 2.0 * math.pi)),
                width_deg=math.degrees(width),
                longitude_rate_deg=math.degrees(turn) / _STEP,
                altitude_bottom=region.altitude_bottom,
                altitude_top=region.altitude_top,
                s4=region.s4,
            )
        )
    return tuple(regions)


def add_dip_equator(scene: Scene) -> None:
    """Put the dip equator at the start of a scene into it; without a model of the field, a note."""
    try:
        points = dip_equator(GpsTime.from_unix_nanoseconds(scene.start), _IONOSPHERE)
    except ValueError as error:
        scene.notes.append(f"the dip equator is left out: {error}")
        return
    scene.dip_equator = points.round(2).tolist()
