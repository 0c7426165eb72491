#!/usr/bin/env bash
# Set up vtff: .venv with ROS 2 Jazzy from PyPI wheels, colcon build, environment file.
# With the argument "test" also what tests and checks need. Safe to call again: work that is done is
# not repeated. VTFF_PYTHON chooses the interpreter.
set -euo pipefail

unset CDPATH # with it, cd prints
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
venv="$root/.venv"
log="$root/log/setup.log"
packages_kib=1400000
test_packages_kib=700000
workspace_kib=200000

stop() {
  printf 'setup: %s\n' "$1" >&2
  exit 1
}

case "${1:-}" in
  "" | test) ;;
  *) stop "unknown argument '$1'; it is 'test' or nothing" ;;
esac

# An apt ROS that is sourced in this shell would mix with the wheels.
unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH PYTHONPATH LD_LIBRARY_PATH
unset ROS_DISTRO ROS_VERSION _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Nor may settings of the user's pip or Python lead out of the virtual environment.
unset PYTHONHOME PIP_TARGET PIP_PREFIX PIP_CONSTRAINT
export PIP_USER=0
# CI and cron may lack HOME; pip and colcon want one, and neither keeps anything of ours there.
export HOME="${HOME:-$root/log}"
export PIP_DISABLE_PIP_VERSION_CHECK=1
# Modules are compiled when they are first used, into .venv (see tools/write_environment.py).
unset PYTHONDONTWRITEBYTECODE
export PYTHONPYCACHEPREFIX="$venv/bytecode"

# Works for any interpreter, also Python 2: silent, or says why not.
python_check='
import os, sys
if not (3, 10) <= sys.version_info[:2] <= (3, 13): sys.exit("is Python %d.%d" % sys.version_info[:2])
if sys.implementation.name != "cpython": sys.exit("is not CPython")
if sys.maxsize < 2**32: sys.exit("is a 32-bit Python")
import sysconfig
if sysconfig.get_config_var("Py_GIL_DISABLED"): sys.exit("is a free-threaded Python")
try:
    import venv, ensurepip
except ImportError: sys.exit("lacks the venv module (Debian, Ubuntu: apt install python3-venv)")
if not os.path.isfile(os.path.join(sysconfig.get_paths()["include"], "Python.h")):
    sys.exit("lacks its C headers (Debian, Ubuntu: apt install python3-dev)")
'
python_identity='import sys; print(sys.version_info[:3], sys.base_prefix)'

check_place() {
  # Interpreter lines of scripts end at a blank, search paths at a colon.
  case "$root" in
    *[[:space:]:\;\'\"\\\$]*)
      stop "the path of this folder has a blank, colon, quote, \$ or backslash, which colcon and Python scripts cannot have: $root" ;;
  esac
  { mkdir -p "$root/log" && : >>"$log"; } 2>/dev/null || stop "cannot write to $root/log"
}

check_machine() {
  [ "$(uname -s)-$(uname -m)" = Linux-x86_64 ] ||
    stop "the ROS 2 wheels need x86-64 Linux; this is $(uname -s) $(uname -m). With ROS 2 Jazzy from apt use colcon build (docs/install.md)."
  local glibc
  glibc=$(getconf GNU_LIBC_VERSION 2>/dev/null | cut -d' ' -f2) || true
  if [ -z "$glibc" ] || [ "$(printf '%s\n2.35\n' "$glibc" | sort -V | head -n 1)" != 2.35 ]; then
    stop "glibc 2.35 or newer is needed (Ubuntu 22.04, Debian 12); found ${glibc:-none}."
  fi
  local tool
  for tool in cc c++ make; do
    command -v "$tool" >/dev/null ||
      stop "no C/C++ compiler: '$tool' not found (Debian, Ubuntu: apt install build-essential)"
  done
  # A compiler without the headers of the C library is found and cannot compile.
  cc -E -x c - <<<'#include <stdio.h>' >/dev/null 2>&1 ||
    stop "the C compiler 'cc' does not work (Debian, Ubuntu: apt install build-essential)"
}

check_disk() { # free space, KiB
  local free_kib
  free_kib=$(df -Pk "$root" | awk 'NR == 2 {print $4}')
  [ "$free_kib" -ge "$1" ] ||
    stop "not enough disk: $((free_kib / 1024)) MiB free, $(($1 / 1024)) MiB needed in $root"
}

choose_python() {
  local candidate reason
  if [ -n "${VTFF_PYTHON:-}" ]; then
    command -v "$VTFF_PYTHON" >/dev/null || stop "VTFF_PYTHON=$VTFF_PYTHON is not a program"
    reason=$("$VTFF_PYTHON" -c "$python_check" 2>&1 | tail -n 1) ||
      stop "VTFF_PYTHON=$VTFF_PYTHON ${reason:-does not run}; Python 3.10 to 3.13 is needed"
    echo "$VTFF_PYTHON"
    return
  fi
  # A version manager's shim may exist and fail, so each candidate is run.
  for candidate in python3 python3.12 python3.11 python3.13 python3.10; do
    if "$candidate" -c "$python_check" >/dev/null 2>&1; then
      echo "$candidate"
      return
    fi
  done
  reason="was not found"
  if command -v python3 >/dev/null; then
    reason=$(python3 -c "$python_check" 2>&1 | tail -n 1) || true
  fi
  stop "Python 3.10 to 3.13 is needed; python3 ${reason:-does not run}. Name another with VTFF_PYTHON=..."
}

# Run a step with its output in the log; on failure say in one line what and where.
step() {
  local what=$1
  shift
  printf 'setup: %s ...\n' "$what"
  "$@" >>"$log" 2>&1 || failed "$what"
}

failed() {
  local hint=""
  if tail -n 60 "$log" | grep -qiE 'No space left on device'; then
    hint="the disk is full"
  elif tail -n 60 "$log" | grep -qiE 'NewConnectionError|Failed to establish|Name or service not known|Temporary failure in name resolution|Network is unreachable|ConnectTimeout|ProxyError|No matching distribution'; then
    hint="packages could not be downloaded: no network, or the index lacks them"
  fi
  stop "$1 failed${hint:+: $hint}; details: ${log#"$root"/}"
}

fingerprint() { # of the files named on standard input
  xargs -r -d '\n' sha256sum | sha256sum | cut -d' ' -f1
}

packages_fingerprint() {
  printf '%s\n' requirements/lock.txt tools/patch_wheels.py | fingerprint
  echo "$root" # a virtual environment cannot be moved
}

test_packages_fingerprint() {
  printf '%s\n' requirements/lock_test.txt | fingerprint
}

# They are installed into .venv, and go with it.
test_packages_are_installed() {
  [ "$(cat "$venv/.vtff_test_packages" 2>/dev/null)" = "$(test_packages_fingerprint)" ]
}

packages_are_installed() {
  [ "$(cat "$venv/.vtff_packages" 2>/dev/null)" = "$(packages_fingerprint)" ] || return 1
  local identity
  identity=$("$venv/bin/python" -c "$python_identity" 2>/dev/null) || return 1
  [ -z "${VTFF_PYTHON:-}" ] || [ "$("$VTFF_PYTHON" -c "$python_identity" 2>/dev/null)" = "$identity" ]
}

# What a rebuild depends on. Python modules are linked into the build, so a change in them
# needs none.
workspace_fingerprint() {
  {
    find src -type f \( -name package.xml -o -name 'setup.*' -o -name CMakeLists.txt -o -name '*.msg' \
      -o -name '*.srv' -o -name '*.action' \)
    printf "%s\n" tools/setup.sh tools/write_environment.py
  } | LC_ALL=C sort | fingerprint
  # Folders and files that are only linked: their names count, not their content.
  {
    find src -type f \( -path '*/launch/*' -o -name __init__.py \)
    [ ! -d config ] || find config -type f
  } | LC_ALL=C sort | sha256sum
}

workspace_is_built() {
  [ -x "$venv/bin/vtff" ] && [ -f "$venv/vtff_environment.sh" ] &&
    [ "$(cat install/.vtff_workspace 2>/dev/null)" = "$(workspace_fingerprint)" ]
}

# Start a command beside this script, in a process group of its own and without lock and terminal.
background=()
start() {
  set -m
  "$@" 9>&- 8>&- </dev/null &
  set +m
  background+=($!)
}

# What is started must not outlive this script: Ctrl-C does not reach the other groups.
end_background() {
  local process
  for process in "${background[@]}"; do
    kill -- "-$process" 2>/dev/null || true
  done
}

# pip works in one thread and hardly waits for the network: each of two takes half of the packages.
# --no-deps: the lock is complete, and leaves out what override.txt names.
# --no-compile: a tenth of the modules is ever used; Python compiles those.
pip_install() { # a file of requirements
  local halves half failed=""
  halves="$root/log/${1##*/}.halves"
  rm -rf "$halves"
  mkdir "$halves"
  awk -v folder="$halves" '!/^#/ { print >(folder "/" (NR % 2 ? "first" : "second")) }' "$1"
  local -A processes=()
  for half in "$halves"/*; do
    start "$venv/bin/python" -m pip install --no-compile --no-deps -r "$half" >"$half.log" 2>&1
    processes[$half]=${background[-1]}
  done
  for half in "${!processes[@]}"; do
    wait "${processes[$half]}" || failed=$half
    cat "$half.log"
  done
  # The reason of a failure is looked for at the end of the log.
  [ -z "$failed" ] || { cat "$failed.log" && return 1; }
}

install_packages() {
  check_disk "$packages_kib"
  local python
  python=$(choose_python)
  rm -rf "$venv" build install
  step "making .venv with $("$python" --version)" "$python" -m venv "$venv"
  step "installing ROS 2 Jazzy and the libraries (one to three minutes)" \
    pip_install requirements/lock.txt
  step "correcting the wheels' CMake files" "$venv/bin/python" tools/patch_wheels.py
  packages_fingerprint >"$venv/.vtff_packages"
}

install_test_packages() {
  check_disk "$test_packages_kib"
  step "installing what the tests need (about one minute)" pip_install requirements/lock_test.txt
  test_packages_fingerprint >"$venv/.vtff_test_packages"
}

# The nodes are written in Python: C++ messages, half of the compiler's work, have no user.
message_options="-DVTFF_MESSAGES_FOR_PYTHON_ONLY=ON -DBUILD_TESTING=OFF"

# What an older build has linked may be gone, moved or a folder now, and then colcon fails. A package
# whose description or messages came or went is built from nothing; the others stay usable meanwhile.
remove_old_build() {
  local folder name description
  for folder in build/*/ install/*/; do
    name=${folder%/}
    [ -f "src/${name##*/}/package.xml" ] || rm -rf "$name"
  done
  for folder in src/*/; do
    name=${folder#src/} name=${name%/}
    description=$({
      sha256sum "src/$name"/{package.xml,setup.py,setup.cfg,CMakeLists.txt}
      find "src/$name" -name '*.msg' -o -name '*.srv' | LC_ALL=C sort
      echo "$message_options"
    } 2>/dev/null) || true
    if [ "$(cat "build/$name/.vtff_package" 2>/dev/null)" != "$description" ]; then
      rm -rf "build/$name" "install/$name"
      mkdir -p "build/$name"
      echo "$description" >"build/$name/.vtff_package"
    elif [ -f "src/$name/setup.py" ]; then
      # -delete goes from the inside to the outside.
      find "build/$name" "install/$name" \( -xtype l -o -type d -empty \) -delete 2>/dev/null || true
    fi
  done
}

build_workspace() {
  check_disk "$workspace_kib"
  rm -f install/.vtff_workspace # an interrupted build is none
  # Nor shall Python look for the old build while the new one is made (tools/write_environment.py).
  rm -f "$venv"/lib/python3*/site-packages/0_vtff_environment.pth
  remove_old_build
  step "building the workspace (half a minute)" env \
    AMENT_PREFIX_PATH="$venv" CMAKE_PREFIX_PATH="$venv" PATH="$venv/bin:$PATH" \
    "$venv/bin/colcon" build --symlink-install --event-handlers console_cohesion+ \
    --cmake-args $message_options
  step "writing the environment" "$venv/bin/python" tools/write_environment.py
  install_command
  step "compiling the modules of the nodes" import_nodes
  step "compiling what they calculate with (a minute)" fly
  workspace_fingerprint >install/.vtff_workspace
}

# Python compiles what it imports for the first time; nodes that all did so at once in the first run
# could be late for its start.
import_nodes() (
  . "$venv/vtff_environment.sh"
  "$venv/bin/python" -c '
import importlib, pathlib
for path in sorted(pathlib.Path("src").glob("vtff_*/vtff_*/*_node.py")):
    importlib.import_module(f"{path.parent.name}.{path.stem}")
'
)

# Each process compiles what its node calculates with, before the first step.
fly() (
  runs=$(mktemp -d)
  trap 'rm -rf "$runs"' EXIT
  for system in esf realistic; do
    "$venv/bin/vtff" run "$system" --distributed --duration 5 --no-report --out "$runs/$system"
  done
)

install_command() {
  cat >"$venv/bin/vtff" <<COMMAND
#!/usr/bin/env bash
# The vtff command with the environment of this workspace; written by tools/setup.sh.
. "$venv/vtff_environment.sh"
exec "$venv/bin/python" -m vtff_bringup.cli "\$@"
COMMAND
  chmod +x "$venv/bin/vtff"
}

# The globe of `vtff view`. Everything else works without, so no failure here ends the set-up.
install_viewer() {
  tools/install_viewer.sh --quiet-retry || true
}

# Two set-ups at once would delete each other's work; the second waits, and then finds it done.
wait_for_others() {
  command -v flock >/dev/null || return 0
  exec 9>"$root/log/setup.lock"
  flock -n 9 && return
  echo "setup: waiting for another set-up of this folder ..."
  flock 9
}

check_place
wait_for_others
: >"$log"
exec 8>&2 # the output of the step that is interrupted goes into the log
trap 'stop "interrupted; call it again" 2>&8' INT TERM
trap end_background EXIT
start install_viewer
viewer=${background[-1]}
if ! packages_are_installed; then
  check_machine
  install_packages
fi
if ! workspace_is_built; then
  check_machine
  build_workspace
fi
if [ "${1:-}" = test ] && ! test_packages_are_installed; then
  install_test_packages
fi
wait "$viewer"
