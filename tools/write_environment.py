"""Write ``.venv/vtff_environment.sh``: the ROS and vtff environment as plain exports.

Sourcing ``install/setup.bash`` starts several processes each time; this file holds
the result, so that ``vtff`` and the tests start at once. It also names the library
folders of the ROS 2 wheels, which saves each Python start the re-execution that the
wheels' bootstrap would do.
"""

from __future__ import annotations

import os
import pathlib
import shlex
import subprocess
import sys
import sysconfig

VARIABLES = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH")


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
    """Write the file into this environment."""
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
    lines = ["# Written by tools/write_environment.py; do not edit."]
    lines += [f"export {name}={shlex.quote(environment[name])}" for name in VARIABLES]
    lines += [
        "export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1",
        # pip has compiled no module: the first process that imports one does, for all later ones.
        "unset PYTHONDONTWRITEBYTECODE",
        f"export PYTHONPYCACHEPREFIX={shlex.quote(str(prefix / 'bytecode'))}",
        f'export PATH={shlex.quote(str(prefix / "bin"))}:"$PATH"',
        # More threads cost more than they give on small matrices; `vtff run` does the same.
        "export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}",
        "export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}",
        # A run must not meet the graphs of other users of the same network.
        "export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}",
        f"export FASTRTPS_DEFAULT_PROFILES_FILE={local}",
        'if [ "$ROS_AUTOMATIC_DISCOVERY_RANGE" != LOCALHOST ]; then',
        f"export FASTRTPS_DEFAULT_PROFILES_FILE={network}",
        "fi",
    ]
    target = prefix / "vtff_environment.sh"
    target.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"wrote {target}")


if __name__ == "__main__":
    main()
