"""Write the ROS and vtff environment into ``.venv``: as a shell script and for its Python.

Sourcing ``install/setup.bash`` starts several processes each time; ``vtff_environment.sh`` holds
the result, so that ``vtff`` and the tests start at once. It also names the library
folders of the ROS 2 wheels, which saves each Python start the re-execution that the
wheels' bootstrap would do.

``.venv/bin/python`` works without that script: a ``.pth`` file, which Python reads when it starts,
imports ``vtff_environment.py``, which starts Python again with the same environment. The loader of
shared libraries reads LD_LIBRARY_PATH only when a process starts, so there is no way without that.
"""

from __future__ import annotations

import os
import pathlib
import shlex
import subprocess
import sys
import sysconfig

#: Before `ros_wheels_bootstrapper.pth` in the alphabet, in whose order Python reads them.
PTH_FILE = "0_vtff_environment.pth"
VARIABLES = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH")


PYTHON_MODULE = '''"""Start Python again with the environment of vtff where it is not set.

Written by tools/write_environment.py; do not edit. A shell that has sourced `vtff_environment.sh`
or `install/setup.bash` is left alone. Another ROS that is sourced gives way, since its libraries
do not mix with the wheels; a PYTHONPATH without another ROS keeps its folders.
"""

import os
import sys

SCRIPT = {script!r}
PREFIX = {prefix!r}  # in AMENT_PREFIX_PATH where the environment is set
# Names the script of the environment for the process that is started again, so that a broken
# script cannot have it start for ever.
STARTED = "VTFF_ENVIRONMENT_STARTED"


def set_environment():
    """Replace this process by the same command in the environment of the script."""
    if os.environ.get(STARTED) == SCRIPT:
        del os.environ[STARTED]
        return
    ament = os.environ.get("AMENT_PREFIX_PATH", "")
    if PREFIX in ament.split(os.pathsep) or not os.path.isfile(SCRIPT):
        return
    import subprocess  # here, because every start of Python would wait for it

    command = ["bash", "-c", '. "$0" && exec env -0', SCRIPT]
    try:
        output = subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return
    items = (item.split("=", 1) for item in os.fsdecode(output).split("\\0") if "=" in item)
    environment = dict(items)
    environment.pop("_", None)
    environment[STARTED] = SCRIPT
    own = os.environ.get("PYTHONPATH")
    if own and not ament:
        environment["PYTHONPATH"] = own + os.pathsep + environment["PYTHONPATH"]
    sys.stdout.flush()
    os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], environment)


set_environment()
'''


def sourced_environment(root: pathlib.Path, prefix: pathlib.Path) -> dict[str, str]:
    """Environment after ``source install/setup.bash``, starting from an empty one."""
    clean = {
        "HOME": os.environ.get("HOME", str(root)),
        "PATH": f"{prefix / 'bin'}:/usr/bin:/bin",
        "AMENT_PREFIX_PATH": str(prefix),
        "CMAKE_PREFIX_PATH": str(prefix),
    }
    output = subprocess.run(
        ["bash", "-c", f"source {shlex.quote(str(root / 'install/setup.bash'))} && env -0"],
        env=clean,
        check=True,
        capture_output=True,
    ).stdout.decode()
    return dict(item.split("=", 1) for item in output.split("\0") if "=" in item)


def main() -> None:
    """Write the files into this environment."""
    root = pathlib.Path(__file__).resolve().parents[1]
    prefix = pathlib.Path(sys.prefix)
    environment = sourced_environment(root, prefix)
    wheel_libraries = sorted(pathlib.Path(sysconfig.get_paths()["purelib"]).glob("ros_*.libs"))
    libraries = [environment.get("LD_LIBRARY_PATH", "").strip(":"), str(prefix / "lib")]
    libraries += [str(path) for path in wheel_libraries]
    environment["LD_LIBRARY_PATH"] = ":".join(filter(None, libraries))
    local, network = (
        shlex.quote(str(root / "config/dds" / name))
        for name in ("fastdds.xml", "fastdds_network.xml")
    )
    log = shlex.quote(str(root / "log/ros"))
    lines = ["# Written by tools/write_environment.py; do not edit."]
    lines += [f"export {name}={shlex.quote(environment[name])}" for name in VARIABLES]
    lines += [
        "export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1",
        # pip has compiled no module: the first process that imports one does, for all later ones.
        "unset PYTHONDONTWRITEBYTECODE",
        f"export PYTHONPYCACHEPREFIX={shlex.quote(str(prefix / 'bytecode'))}",
        # What numba compiles goes with this environment, too.
        f"export NUMBA_CACHE_DIR=${{NUMBA_CACHE_DIR:-{prefix / 'machine_code'}}}",
        f'export PATH={shlex.quote(str(prefix / "bin"))}:"$PATH"',
        # More threads cost more than they give on small matrices; `vtff run` does the same.
        "export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}",
        "export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}",
        # CI and cron may lack HOME, without which ROS has no folder for its logs.
        f'[ -n "${{HOME:-}}${{ROS_HOME:-}}${{ROS_LOG_DIR:-}}" ] || export ROS_LOG_DIR={log}',
        # A run must not meet the graphs of other users of the same network.
        "export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}",
        f"export FASTRTPS_DEFAULT_PROFILES_FILE={local}",
        'if [ "$ROS_AUTOMATIC_DISCOVERY_RANGE" != LOCALHOST ]; then',
        f"export FASTRTPS_DEFAULT_PROFILES_FILE={network}",
        "fi",
    ]
    target = prefix / "vtff_environment.sh"
    target.write_text("\n".join(lines) + "\n", encoding="utf-8")
    packages = pathlib.Path(sysconfig.get_paths()["purelib"])
    module = PYTHON_MODULE.format(script=str(target), prefix=str(root / "install/vtff_msgs"))
    (packages / "vtff_environment.py").write_text(module, encoding="utf-8")
    (packages / PTH_FILE).write_text("import vtff_environment\n", encoding="utf-8")
    print(f"wrote {target}")


if __name__ == "__main__":
    main()
