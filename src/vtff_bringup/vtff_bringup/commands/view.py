"""`vtff view`: a run on a globe, in the formation's frame and as plots, in the browser."""

from __future__ import annotations

import contextlib
import functools
import os
import pathlib
import time
import webbrowser
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer
from rich.console import Console

from vtff_bag.file.errors import BagError
from vtff_bag.run.folder import RunFolderError, chosen_file
from vtff_bringup.discover.completion import complete_run
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error, print_note
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_USAGE

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from vtff_analysis.view.foxglove_server import FoxgloveServer
    from vtff_analysis.view.scene import Scene
    from vtff_node.process.stop_signals import StopRequest

POLL_INTERVAL = 0.1  # s of wall time
TEXT_INTERVAL = 1.0  # s of wall time between lines of a live run
FOXGLOVE_PORT = 8765  # what Foxglove looks for


def view(
    bag: Annotated[
        Optional[pathlib.Path],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Argument(
            help="Run folder, bag directory or .mcap file.", autocompletion=complete_run
        ),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="A run that is being published in ROS_DOMAIN_ID.")
    ] = False,
    text: Annotated[
        bool, typer.Option("--text", help="Lines of text in the terminal instead of a page.")
    ] = False,
    beside: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(
            help="A second run, grey behind the first in the plots and the formation.",
            autocompletion=complete_run,
        ),
    ] = None,
    export: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="Write the page with the run in it to one HTML file, and end."),
    ] = None,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Print the address, start no browser.")
    ] = False,
    port: Annotated[
        int, typer.Option(help="Port of the page; 0: a free one.", min=0, max=65535)
    ] = 0,
    foxglove: Annotated[
        bool,
        typer.Option(
            "--foxglove", help="Also offer the topics to Foxglove; a bag is played in a loop."
        ),
    ] = False,
    foxglove_port: Annotated[
        int, typer.Option(help="Port for Foxglove; 0: a free one.", min=0, max=65535)
    ] = FOXGLOVE_PORT,
) -> None:
    """Show a run on a globe and in plots, in the browser.

    Shown are spacecraft, orbits, GNSS links, pierce points and TEC. The page is served by this
    program to this machine only and loads nothing from elsewhere, so that it works offline. Space
    plays and pauses, the arrows go 10 s back and forward, n and p go through the events, a click
    in a plot goes to its time, a drag there zooms; ? shows all keys. With --live the page follows
    a run or a `vtff replay` in the same ROS_DOMAIN_ID; its controls also move the replay. Ctrl-C
    ends. An exported file has a map in place of the globe.

    Examples: vtff view bags/sample;  ROS_DOMAIN_ID=5 vtff view --live;
    vtff view RUN --beside OTHER;  vtff view RUN --export run.html
    """
    console = make_console()
    if (bag is None) == (not live):
        raise exit_with_error(
            console, "give either a bag, or --live for a run that goes on", EXIT_USAGE
        )
    if live and (beside is not None or export is not None):
        raise exit_with_error(console, "--beside and --export are for recorded runs", EXIT_USAGE)
    try:
        if bag is not None and export is not None:
            code = _export(console, bag, beside, export)
        elif bag is not None:
            code = _view_bag(console, bag, beside, text, not no_open, port, foxglove, foxglove_port)
        else:
            code = _view_live(console, text, not no_open, port, foxglove, foxglove_port)
    except (BagError, RunFolderError) as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    except (OSError, RuntimeError, ImportError) as error:
        raise exit_with_error(console, error, EXIT_FAILURE) from error
    raise typer.Exit(code)


def _read(console: Console, bag: pathlib.Path, beside: pathlib.Path | None) -> Scene:
    """Read a bag and the run beside it, with progress, and print what is missing."""
    from rich.progress import Progress

    from vtff_analysis.view.bag_scene import read_scene

    scenes = []
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        for path in filter(None, (bag, beside)):
            task = progress.add_task(f"reading {path}", total=1.0)
            scenes.append(read_scene(path, functools.partial(_show_progress, progress, task)))
    scene = scenes[0]
    if len(scenes) > 1:
        scene.beside = scenes[1]
    for read in scenes:
        for note in read.notes:
            print_note(console, note)
    return scene


def _show_progress(progress: Progress, task: TaskID, part: float) -> None:
    progress.update(task, completed=part)


def _export(
    console: Console, bag: pathlib.Path, beside: pathlib.Path | None, file: pathlib.Path
) -> int:
    from vtff_analysis.view.page_file import write_page

    file = chosen_file(file, ".html")
    write_page(_read(console, bag, beside).as_json(), file)
    size = file.stat().st_size / 1e6
    console.print(f"{file}: {size:.1f} MB, opens in any browser", markup=False, soft_wrap=True)
    return 0


def _view_bag(
    console: Console,
    bag: pathlib.Path,
    beside: pathlib.Path | None,
    text: bool,
    opens: bool,
    port: int,
    foxglove: bool,
    foxglove_port: int,
) -> int:
    from vtff_analysis.view.text import scene_text

    scene = _read(console, bag, beside)
    if text:
        print(scene_text(scene))
        return 0
    from vtff_analysis.view.server import ViewerServer
    from vtff_node.process.stop_signals import StopRequest

    content = scene.as_json()
    stop = StopRequest()
    stop.install()
    foxglove_server = _start_foxglove(console, foxglove, foxglove_port)
    server = ViewerServer(lambda: content, port=port)
    replay = _make_replay(bag, foxglove_server) if foxglove_server is not None else None
    with _serve_page(console, server, opens):
        while not stop.requested:
            if replay is not None:
                replay.advance()
            time.sleep(0.005 if replay is not None else POLL_INTERVAL)
    if foxglove_server is not None:
        foxglove_server.stop()
    return EXIT_INTERRUPTED


def _make_replay(bag: pathlib.Path, foxglove_server: FoxgloveServer) -> Any:
    from vtff_bag.file.reader import BagReader
    from vtff_bag.player.messages_in_order import Replay

    reader = BagReader(bag)
    return Replay(
        reader,
        list(reader.topics),
        lambda raw: foxglove_server.send(raw.topic, raw.type, raw.serialized, raw.log_time),
        loop=True,
    )


def _view_live(
    console: Console, text: bool, opens: bool, port: int, foxglove: bool, foxglove_port: int
) -> int:
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from vtff_analysis.view.live import LiveScene, ViewerNode
    from vtff_analysis.view.server import ViewerServer
    from vtff_node.main import make_executor
    from vtff_node.process.stop_signals import StopRequest

    stop = StopRequest()
    stop.install()
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    console.print(f"listening in ROS_DOMAIN_ID {domain}")
    foxglove_server = _start_foxglove(console, foxglove, foxglove_port)
    scene = LiveScene(f"live, domain {domain}")
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = ViewerNode(scene, foxglove_server.send if foxglove_server is not None else None)
    executor = make_executor()
    executor.add_node(node)
    try:
        if text:
            _print_live(console, scene, executor, stop)
        else:
            server = ViewerServer(scene.as_json, scene.news, node.command, port)
            with _serve_page(console, server, opens):
                while not stop.requested:
                    executor.spin_once(timeout_sec=POLL_INTERVAL)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
        if foxglove_server is not None:
            foxglove_server.stop()
    return EXIT_INTERRUPTED


def _print_live(console: Console, live: Any, executor: Any, stop: StopRequest) -> None:
    """Print a line for each deputy each second while the scene grows."""
    from vtff_analysis.view.text import heading, scene_lines

    print(heading())
    shown, due = -1.0, time.monotonic()
    while not stop.requested:
        executor.spin_once(timeout_sec=POLL_INTERVAL)
        scene: Scene = live.scene
        if time.monotonic() >= due and scene.duration != shown and scene.series:
            due, shown = time.monotonic() + TEXT_INTERVAL, scene.duration
            print(*scene_lines(scene, scene.duration), sep="\n", flush=True)


def _start_foxglove(console: Console, foxglove: bool, port: int) -> FoxgloveServer | None:
    if not foxglove:
        return None
    from vtff_analysis.view.foxglove_server import FoxgloveServer

    server = FoxgloveServer(port)
    console.print(f"Foxglove: open connection {server.address}")
    return server


@contextlib.contextmanager
def _serve_page(console: Console, server: Any, opens: bool) -> Any:
    """Serve the page in a context, and open it in a browser if `opens`."""
    from vtff_analysis.view.server import cesium_is_installed

    server.start()
    try:
        console.print(f"{server.address}   (Ctrl-C ends)")
        if not cesium_is_installed():
            console.print("no globe, a map instead: tools/install_viewer.sh brings Cesium")
        if opens and not webbrowser.open(server.address):
            console.print("no browser was found: open the address yourself, or use --text")
        yield
    finally:
        server.stop()
