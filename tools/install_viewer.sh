#!/usr/bin/env bash
# Put CesiumJS beside the page of `vtff view`, from npm, in the version of tools/viewer/package-lock.json.
# Safe to call again. Without npm or without a network the page shows a map instead of the globe.
# `--quiet-retry`: after a failure do not try again until the version changes (used by setup.sh).
set -euo pipefail

unset CDPATH
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
target="$root/src/vtff_analysis/vtff_analysis/view/web/cesium"
state="$root/log/viewer"
work="$state/npm"
version=$(sha256sum "$root/tools/viewer/package-lock.json" | cut -d' ' -f1)

say() {
  printf 'viewer: %s\n' "$1"
}

if [ -f "$target/index.js" ] && [ "$(cat "$target/.version" 2>/dev/null)" = "$version" ]; then
  exit 0
fi
mkdir -p "$state"
if [ "${1:-}" = --quiet-retry ] && [ "$(cat "$state/failed" 2>/dev/null)" = "$version" ]; then
  exit 0
fi
if ! command -v npm >/dev/null; then
  say "npm not found: vtff view shows a map instead of the globe (then: tools/install_viewer.sh)"
  echo "$version" >"$state/failed"
  exit 0
fi

say "installing CesiumJS for vtff view ..."
rm -rf "$work"
mkdir -p "$work"
cp "$root/tools/viewer/package.json" "$root/tools/viewer/package-lock.json" "$work/"
# No scripts, no browser download; a registry that does not answer is given up soon.
if ! (cd "$work" && npm ci --ignore-scripts --no-audit --no-fund --fetch-retries=1 \
  --fetch-retry-mintimeout=1000 --fetch-retry-maxtimeout=2000 --fetch-timeout=30000) >"$state/npm.log" 2>&1; then
  say "CesiumJS could not be installed (${state#"$root"/}/npm.log): vtff view shows a map instead of the globe"
  echo "$version" >"$state/failed"
  rm -rf "$work"
  exit 0
fi

# Its module, workers and imagery; not the two other forms of the same code.
rm -rf "$target" "$target.new"
mkdir -p "$target.new"
build="$work/node_modules/cesium/Build/Cesium"
cp -r "$build/Assets" "$build/ThirdParty" "$build/Widgets" "$build/Workers" "$build/index.js" "$target.new/"
cp "$work/node_modules/cesium/LICENSE.md" "$target.new/"
echo "$version" >"$target.new/.version"
mv "$target.new" "$target"
rm -rf "$work" "$state/failed"
