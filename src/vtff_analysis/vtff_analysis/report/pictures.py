"""All plots of a report, each with the caption that explains it."""

from __future__ import annotations

import pathlib
from collections.abc import Mapping

import matplotlib as mpl
import numpy as np

from vtff_analysis.cluster.cluster_flight import ClusterFlight, cluster_of_run
from vtff_analysis.cluster.pictures import draw_paths, draw_sides
from vtff_analysis.evaluation.formation_flight import FormationFlight
from vtff_analysis.evaluation.navigation import navigation_error
from vtff_analysis.evaluation.receiver_comparison import compare_with_receiver
from vtff_analysis.page.page import Picture
from vtff_analysis.paper_reference import paper_plateau
from vtff_analysis.plot_style import STYLE
from vtff_analysis.recordings.attitude import AttitudeRecording
from vtff_analysis.recordings.history import (
    DeputyHistory,
    ReceiverHistory,
    RunHistory,
)
from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth
from vtff_analysis.recordings.settings import RunSettings
from vtff_analysis.recordings.topics import key_part
from vtff_analysis.report.guidance_section import draw_guidance
from vtff_analysis.report.plots import plot_formation, plot_receiver
from vtff_analysis.report.plots_attitude import plot_attitude, plot_dipole
from vtff_analysis.report.plots_details import (
    plot_compute_time,
    plot_navigation_error,
    plot_navigation_quality,
    plot_satellite_values,
    plot_sky,
)
from vtff_analysis.report.plots_ionosphere import (
    plot_density_profile,
    plot_edges,
    plot_plateau,
    plot_satellite_profiles,
    plot_scintillation_map,
    scenario_label,
)
from vtff_analysis.report.plots_receiver_ionosphere import plot_comparisons
from vtff_analysis.report.plots_survey import plot_survey
from vtff_control.cluster.potential_field import equilibrium_distance
from vtff_sim_bridge.atmosphere.walls import WallTruth

_LEAST_ALTITUDES = 2e3  # m that a profile of the density spans

_FORMATION_CAPTIONS = {
    "relative_position_and_thrust": (
        "Relative position and applied thrust, in the form of figure A1 of the paper. Dotted lines "
        "across the thrust are the largest; marks, in the paper's scenario, the closest in-track "
        "approaches of this run and of the paper."
    ),
    "relative_position": (
        "Relative position by axis. The vertical line is the begin of the keeping phase."
    ),
    "keeping_error": "Deviation from the target in the keeping phase, each axis on its own scale.",
}

_Panels = Mapping[str, tuple[str, str]]  # title and axis label by column

_SLANT_TEC_PANELS: _Panels = {
    "stec_tecu": ("slant TEC along each ray", "slant TEC (TECU)"),
    "vtec_tecu": ("vertical TEC at the pierce points", "vertical TEC (TECU)"),
}
_DIFFERENTIAL_PANELS: _Panels = {
    "stec_tecu": ("slant TEC of the deputy less that of the chief", "differential TEC (TECU)"),
}
_SCINTILLATION_PANELS: _Panels = {
    "s4": ("amplitude scintillation", "S4"),
    "sigma_phi": ("phase scintillation", "sigma phi (rad)"),
    "roti_tecu_per_minute": ("rate of TEC index", "ROTI (TECU/min)"),
}


def draw_pictures(
    history: RunHistory,
    settings: RunSettings,
    flights: Mapping[str, FormationFlight],
    folder: pathlib.Path,
    run_name: str,
    truth: IonosphereTruth | None = None,
    wall_truth: WallTruth | None = None,
) -> list[Picture]:
    """Draw the plots of every subject that a run has.

    Parameters
    ----------
    history, settings, flights
        The run, its settings, and the flight of each deputy that has one.
    folder
        Folder of the PNG files; must exist.
    run_name
        Name of the run for the titles.
    truth
        The true ionosphere; None where it is not recorded.
    wall_truth
        Emulated plasma and true crossings of a survey; None in a run without one.

    Returns
    -------
    list of Picture
        In the order in which they are to be shown.
    """
    scenario = history.simulator.scenario if history.simulator is not None else ""
    labelled = f"{run_name}{scenario_label(scenario)}"
    pictures: list[Picture] = []
    for name, flight in flights.items():
        prefix = f"{key_part(name)}_" if len(flights) > 1 else ""
        cap = settings.controller(name).acceleration_cap
        deputy = history.deputies[name]
        pictures += _draw_formation(flight, folder, prefix, run_name, scenario, cap)
        pictures += _draw_navigation_error(deputy, folder, prefix, run_name)
        pictures += _draw_navigation_quality(deputy, folder, prefix, run_name)
    pictures += draw_guidance(history, folder, run_name)
    for name, attitude in history.attitude.items():
        prefix = f"{key_part(name)}_" if len(history.attitude) > 1 else ""
        title = f"{run_name}: attitude of {name}"
        pictures += _draw_attitude(attitude, history.start_time, folder, prefix, title)
    for receiver in history.receivers.values():
        pictures += _draw_tracking(receiver, folder, run_name)
        pictures += _draw_sky(receiver, folder, run_name)
    if history.survey is not None and history.survey.decisions and wall_truth is not None:
        pictures += _draw_survey(history, wall_truth, folder, labelled)
    cluster = cluster_of_run(history)
    if cluster is not None:
        pictures += _draw_cluster(cluster, folder)
    pairs = history.pair_histories()
    for pair in pairs:
        prefix = f"{key_part(pair.deputy)}_" if len(pairs) > 1 else ""
        pictures += _draw_density(pair, truth, folder, prefix, labelled, scenario)
    pictures += _draw_scintillation_maps(pairs[0], truth, folder, labelled, scenario)
    pictures += _draw_satellite_values(history, folder, labelled)
    pictures += _draw_comparisons(history, folder, labelled)
    pictures += _draw_timing(history, folder, run_name)
    return pictures


def _draw_formation(
    flight: FormationFlight,
    folder: pathlib.Path,
    prefix: str,
    run_name: str,
    scenario: str,
    cap: float | None,
) -> list[Picture]:
    paths = plot_formation(flight, folder, prefix, run_name, scenario, cap)
    captions = (_FORMATION_CAPTIONS[path.stem.removeprefix(prefix)] for path in paths)
    return [
        Picture(path, _told_of(flight.name, prefix, caption), "formation")
        for path, caption in zip(paths, captions, strict=True)
    ]


def _told_of(deputy: str, prefix: str, caption: str) -> str:
    """Return a caption that names its deputy, in a run with several."""
    return f"{deputy}: {caption[0].lower()}{caption[1:]}" if prefix else caption


def _draw_attitude(
    recording: AttitudeRecording, start_time: int, folder: pathlib.Path, prefix: str, title: str
) -> list[Picture]:
    attitude, dipole = folder / f"{prefix}attitude.png", folder / f"{prefix}dipole.png"
    plot_attitude(recording, start_time, attitude, title)
    plot_dipole(recording, start_time, dipole, title)
    return [
        Picture(
            attitude,
            "Roll, pitch and yaw to the orbit axes, error of the estimate beside its sigma, rates; "
            "dotted lines: changes of mode.",
            "attitude",
        ),
        Picture(
            dipole,
            "Residual dipole as estimated, speed of the wheel, pulses of the rods.",
            "attitude",
        ),
    ]


def _draw_survey(
    history: RunHistory,
    truth: WallTruth,
    folder: pathlib.Path,
    run_name: str,
) -> list[Picture]:
    assert history.survey is not None
    path, title = folder / "survey.png", f"{run_name}: survey of plasma bubbles, emulated"
    plot_survey(history.survey, truth, (history.start_time, history.end_time), path, title)
    return [
        Picture(
            path,
            "Walls of plasma bubbles that the formation has crossed, against the emulated truth: "
            "their longitudes, a map, the altitudes of the crossings, and the zonal drift. Dotted "
            "lines: changes of the formation, with their reasons.",
            "ionosphere",
        )
    ]


def _draw_cluster(flight: ClusterFlight, folder: pathlib.Path) -> list[Picture]:
    sides, paths = folder / "cluster_sides.png", folder / "cluster_paths.png"
    with mpl.rc_context(STYLE):
        draw_sides([flight], equilibrium_distance(), sides)
        draw_paths([flight], paths)
    return [
        Picture(
            sides,
            "Distances of all pairs of the cluster; dotted: equilibrium of the potential, dashed: "
            "the smallest distance that is allowed.",
            "formation",
        ),
        Picture(
            paths,
            "Paths of the chasers about the lead, from the circles to the squares.",
            "formation",
        ),
    ]


def _draw_tracking(receiver: ReceiverHistory, folder: pathlib.Path, run_name: str) -> list[Picture]:
    path = plot_receiver(receiver, folder, f"{key_part(receiver.name)}_", run_name)
    caption = f"Satellites that {receiver.name} tracked, coloured by the strongest signal."
    return [] if path is None else [Picture(path, caption, "gnss")]


def _draw_sky(receiver: ReceiverHistory, folder: pathlib.Path, run_name: str) -> list[Picture]:
    title = f"{run_name}: sky of {receiver.name}"
    path = plot_sky(receiver, folder, f"{key_part(receiver.name)}_", title)
    caption = (
        f"Sky of {receiver.name}: azimuth around, elevation from the zenith outwards, from "
        "recorded ephemerides and position fixes; labels stand where a satellite was first seen."
    )
    return [] if path is None else [Picture(path, caption, "gnss")]


def _draw_comparisons(history: RunHistory, folder: pathlib.Path, run_name: str) -> list[Picture]:
    comparisons = compare_with_receiver(history)
    if not comparisons:
        return []
    path = folder / "receiver_ionosphere.png"
    plot_comparisons(comparisons, path, f"{run_name}: ours against the receiver's own")
    caption = "TEC and scintillation of the ionosphere processor against the receiver's own."
    return [Picture(path, caption, "ionosphere")]


def _draw_timing(history: RunHistory, folder: pathlib.Path, run_name: str) -> list[Picture]:
    if not any(times.size for times in history.compute_time.values()):
        return []
    path = plot_compute_time(history.compute_time, folder, f"{run_name}: time per step")
    caption = "Wall time that nodes took for a step, of those that acknowledge steps."
    return [Picture(path, caption, "timing")]


def _draw_navigation_error(
    deputy: DeputyHistory, folder: pathlib.Path, prefix: str, run_name: str
) -> list[Picture]:
    error = navigation_error(deputy)
    if error is None:
        return []
    title = f"{run_name}: navigation of {deputy.name} minus truth"
    path = plot_navigation_error(error, folder, prefix, title)
    caption = "Navigated minus true state of each axis"
    inside = error.fraction_within_three_sigma()
    if inside is not None:
        shares = " / ".join(f"{100.0 * share:.1f} %" for share in inside)
        caption += f"; of the positions {shares} (R/T/N) lie within the stated 3 sigma"
    return [Picture(path, _told_of(deputy.name, prefix, f"{caption}."), "navigation")]


def _draw_navigation_quality(
    deputy: DeputyHistory, folder: pathlib.Path, prefix: str, run_name: str
) -> list[Picture]:
    if deputy.navigation is None or not deputy.navigation.time.size:
        return []
    states = deputy.truth or deputy.estimate
    assert states is not None
    title = f"{run_name}: quality of the navigation of {deputy.name}"
    path = plot_navigation_quality(deputy.navigation, int(states.time[0]), folder, prefix, title)
    caption = "Kind of solution, satellites and fixed ambiguities, and normalised innovations."
    return [Picture(path, _told_of(deputy.name, prefix, caption), "navigation")]


def _draw_density(
    history: RunHistory,
    truth: IonosphereTruth | None,
    folder: pathlib.Path,
    prefix: str,
    run_name: str,
    scenario: str,
) -> list[Picture]:
    """Draw figures 8, 9 and 11 of the paper of the chief and one deputy."""
    with_name = f" with {history.deputy}" if prefix else ""
    density = history.density
    if density is None:
        return []
    pictures = []
    edges = plot_edges(
        history,
        truth,
        folder / f"{prefix}edges.png",
        f"{run_name}: edges of irregularities{with_name}",
    )
    if edges is not None:
        caption = "Every edge that was found, against the true ones; the table of all is below."
        pictures.append(Picture(edges, caption, "ionosphere"))
    printed = paper_plateau(scenario)
    plateau = plot_plateau(
        history,
        truth,
        folder / f"{prefix}vertical_tec.png",
        f"{run_name}: vertical TEC of single satellites",
        printed,
    )
    if plateau is not None:
        caption = "Vertical TEC above each spacecraft (figure 8 of the paper)."
        if printed:
            numbers = " and ".join(f"{value:.2f}" for value in printed)
            caption += f" Dotted: {numbers} TECU, the paper's plateau."
        pictures.append(Picture(plateau, caption, "ionosphere"))
    if history.satellite_density is not None:
        single = plot_satellite_profiles(
            history.satellite_density,
            density,
            truth,
            folder / f"{prefix}electron_density_satellites.png",
            f"{run_name}: electron density{with_name} from one satellite",
        )
        if single is not None:
            caption = "Density from single satellites, rising (figure 9 of the paper)."
            pictures.append(Picture(single, caption, "ionosphere"))
    if np.ptp(density.altitude) < _LEAST_ALTITUDES:
        return pictures
    path = plot_density_profile(
        history,
        density,
        truth,
        folder / f"{prefix}electron_density.png",
        f"{run_name}: electron density{with_name}",
    )
    caption = "Density from differential TEC of all satellites (figures 9 and 11 of the paper)."
    pictures.append(Picture(path, caption, "ionosphere"))
    return pictures


def _draw_scintillation_maps(
    history: RunHistory,
    truth: IonosphereTruth | None,
    folder: pathlib.Path,
    run_name: str,
    scenario: str,
) -> list[Picture]:
    """Draw figure 10 of the paper of each spacecraft."""
    density = history.density
    if density is None:
        return []
    pictures = []
    for topic, columns in history.scintillation.items():
        mapped = plot_scintillation_map(
            columns,
            density,
            truth,
            scenario,
            folder / f"{key_part(topic)}_map.png",
            f"{run_name}: {topic} against place",
        )
        if mapped is not None:
            caption = f"{topic} against altitude and place (figure 10 of the paper)."
            pictures.append(Picture(mapped, caption, "ionosphere"))
    return pictures


def _draw_satellite_values(
    history: RunHistory, folder: pathlib.Path, run_name: str
) -> list[Picture]:
    pictures = []
    for topics, panels, content in (
        (history.slant_tec, _SLANT_TEC_PANELS, "electron content"),
        (history.scintillation, _SCINTILLATION_PANELS, "scintillation"),
    ):
        for topic, columns in topics.items():
            own_panels = _panels_of(topic, panels)
            drawn = plot_satellite_values(
                columns,
                own_panels,
                history.start_time,
                folder / f"{key_part(topic)}.png",
                f"{run_name}: {topic}",
                has_medians=own_panels is _DIFFERENTIAL_PANELS,
            )
            if drawn is not None:
                caption = f"{topic}: {content}, one colour a satellite."
                pictures.append(Picture(drawn, caption, "ionosphere"))
    return pictures


def _panels_of(topic: str, panels: _Panels) -> _Panels:
    return _DIFFERENTIAL_PANELS if topic.endswith("/differential_tec") else panels
