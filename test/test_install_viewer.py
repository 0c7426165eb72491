"""tools/install_viewer.sh with stand-ins for npm: what it installs, and how it does without."""

import json
import os
import pathlib
import shutil
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
WEB = "src/vtff_analysis/vtff_analysis/view/web"
REAL_TOOLS = ("bash", "sha256sum", "cut", "cat", "dirname", "mkdir", "rm", "cp", "mv")
NPM = """\
#!/bin/sh
echo "npm $*" >>"$CALLS"
build=node_modules/cesium/Build/Cesium
mkdir -p $build/Assets $build/ThirdParty $build/Widgets $build/Workers
echo code >$build/index.js; echo again >$build/Cesium.js; echo terms >node_modules/cesium/LICENSE.md
"""


@pytest.fixture
def tree(tmp_path):
    for part in ("tools/viewer", WEB):
        ignored = shutil.ignore_patterns("cesium", "node_modules")
        shutil.copytree(ROOT / part, tmp_path / "checkout" / part, ignore=ignored)
    shutil.copy(ROOT / "tools/install_viewer.sh", tmp_path / "checkout/tools")
    (tmp_path / "bin").mkdir()
    for tool in REAL_TOOLS:
        (tmp_path / "bin" / tool).symlink_to(shutil.which(tool))
    return tmp_path


def give_npm(tree, text):
    (tree / "bin/npm").write_text(text)
    (tree / "bin/npm").chmod(0o755)


def install(tree, *arguments):
    (tree / "calls").write_text("")
    done = subprocess.run(
        ["bash", "tools/install_viewer.sh", *arguments],
        cwd=tree / "checkout",
        env={"PATH": str(tree / "bin"), "CALLS": str(tree / "calls"), "HOME": os.devnull},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr  # the set-up goes on without a globe
    return done.stdout, (tree / "calls").read_text().count("npm ci")


def test_installed_once_and_again_for_another_version(tree):
    give_npm(tree, NPM)
    assert install(tree)[1] == 1
    cesium = tree / "checkout" / WEB / "cesium"
    assert (cesium / "index.js").read_text() == "code\n"
    assert sorted(path.name for path in cesium.iterdir()) == [
        *(".version", "Assets", "LICENSE.md", "ThirdParty", "Widgets", "Workers", "index.js")
    ]
    assert install(tree) == ("", 0)
    with open(tree / "checkout/tools/viewer/package-lock.json", "a") as lock:
        lock.write(" ")
    assert install(tree)[1] == 1
    assert not list((tree / "checkout").rglob("node_modules"))


def test_without_npm_one_line_says_so(tree):
    said, _ = install(tree, "--quiet-retry")
    assert said.count("\n") == 1 and "npm not found" in said
    assert install(tree, "--quiet-retry") == ("", 0)
    give_npm(tree, NPM)
    assert install(tree)[1] == 1


def test_failure_is_said_and_not_repeated_at_each_set_up(tree):
    give_npm(tree, '#!/bin/sh\necho "npm $*" >>"$CALLS"\nexit 1\n')
    said, tries = install(tree, "--quiet-retry")
    assert "could not be installed" in said and tries == 1
    assert install(tree, "--quiet-retry") == ("", 0)
    assert install(tree)[1] == 1


def test_version_is_pinned_and_no_registry_is_named():
    package = json.loads((ROOT / "tools/viewer/package.json").read_text())
    lock = json.loads((ROOT / "tools/viewer/package-lock.json").read_text())
    pinned = package["dependencies"]["cesium"]
    assert lock["packages"]["node_modules/cesium"]["version"] == pinned
    packages = [entry for name, entry in lock["packages"].items() if name]
    assert all(entry["integrity"].startswith("sha512-") for entry in packages)
    assert not any("resolved" in entry for entry in packages)
