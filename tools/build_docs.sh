#!/usr/bin/env bash
# Build the documentation site into docs/html and check it: notebooks and doctests run, warnings are
# errors, every link leads somewhere, every public function is in it. Called by "make docs" after
# set-up. What it needs beside .venv is installed into .venv/documentation.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
packages="$root/.venv/documentation"
log="$root/log/docs.log"
mkdir -p "$root/log"
: >"$log"

stop() {
  printf 'docs: %s\n' "$1" >&2
  exit 1
}

fingerprint=$(sha256sum requirements/lock_docs.txt)
if [ "$(cat "$packages/.vtff_docs" 2>/dev/null)" != "$fingerprint" ]; then
  echo "docs: installing Sphinx and the notebook kernel (half a minute) ..."
  rm -rf "$packages"
  .venv/bin/python -m pip install --no-deps --no-compile --target "$packages" \
    -r requirements/lock_docs.txt >"$log" 2>&1 || stop "installing failed; details: log/docs.log"
  echo "$fingerprint" >"$packages/.vtff_docs"
fi

# shellcheck disable=SC1091
. .venv/vtff_environment.sh
export PYTHONPATH="$packages:$PYTHONPATH"
unset MPLBACKEND # the kernel shows figures by its own
# Nothing of the user's Jupyter may lead to another kernel.
export JUPYTER_PREFER_ENV_PATH=1 IPYTHONDIR="$packages/.ipython"
started=$SECONDS
echo "docs: running the tutorials and writing the pages (two to four minutes) ..."
rm -rf docs/html
build() { # a builder, its folder
  python -m sphinx -W --keep-going -q -w "$log.warnings" -b "$1" -d docs/html/.doctrees docs "$2" \
    >>"$log" 2>&1
}
build html docs/html || { cat "$log.warnings" && stop "the pages have faults; details: log/docs.log"; }
echo "docs: running the examples of the docstrings ..."
mapfile -t examples < <(grep -rl --include='*.py' '>>> ' src/*/vtff_*)
python -m doctest "${examples[@]}" || stop "an example does not give what it says (above)"
(cd docs && python -m site_pages.check_site html) || stop "the site has faults (above)"
echo "docs: docs/html/index.html ($((SECONDS - started)) s)"
