"""``tools/check-wheels`` against an index made for the test: a folder of small packages."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

CHECK_WHEELS = Path(__file__).resolve().parents[2] / "tools" / "check-wheels"
HANG_S = 900  # so late that no load of the machine explains it
BACKEND = """
from zipfile import ZipFile
def build_wheel(folder, config_settings=None, metadata_directory=None):
    name = "{name}-1.0-py3-none-any.whl"
    with ZipFile(folder + "/" + name, "w") as wheel:
        for file, text in {files!r}.items():
            wheel.writestr(file, text)
    return name
"""


def wheel_files(name, needs=()):
    lines = ["Metadata-Version: 2.1", f"Name: {name}", "Version: 1.0", *(f"Requires-Dist: {one}" for one in needs)]
    info = f"{name}-1.0.dist-info"
    wheel = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    return {f"{info}/METADATA": "\n".join(lines) + "\n", f"{info}/WHEEL": wheel, f"{info}/RECORD": ""}


def add_wheel(index, name, tags, needs=()):
    with zipfile.ZipFile(index / f"{name}-1.0-{tags}.whl", "w") as wheel:
        for file, text in wheel_files(name, needs).items():
            wheel.writestr(file, text)


def add_source(index, name):
    """A source distribution of pure Python that needs nothing to be built."""
    folder = index.parent / f"{name}-1.0"
    folder.mkdir()
    project = '[build-system]\nrequires = []\nbuild-backend = "backend"\nbackend-path = ["."]\n'
    (folder / "pyproject.toml").write_text(project)
    (folder / "backend.py").write_text(BACKEND.format(name=name, files=wheel_files(name)))
    (folder / "PKG-INFO").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    with tarfile.open(index / f"{name}-1.0.tar.gz", "w:gz") as archive:
        archive.add(folder, folder.name)


@pytest.fixture
def index(tmp_path):
    """An index with numpy for aarch64, and autosar-e2e for this machine alone."""
    folder = tmp_path / "index"
    folder.mkdir()
    add_wheel(folder, "numpy", "cp311-cp311-manylinux_2_27_aarch64.manylinux_2_28_aarch64")
    add_wheel(folder, "autosar_e2e", "cp311-cp311-manylinux_2_17_x86_64.manylinux2014_x86_64")
    add_source(folder, "sdnotify")
    return folder


@pytest.fixture
def check(index, tmp_path):
    def run(*dependencies, python="3.11"):
        project = tmp_path / "pyproject.toml"
        project.write_text(f"[project]\ndependencies = {list(dependencies)}\n")
        plain = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
        settings = {"PIP_CONFIG_FILE": os.devnull, "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(index)}
        return subprocess.run(
            [sys.executable, CHECK_WHEELS, "--pyproject", project, "--python", python],
            capture_output=True,
            text=True,
            timeout=HANG_S,
            env=plain | settings,
        )

    return run


def test_wheels_and_sources_of_pure_python_are_enough(check):
    done = check("numpy>=1,<2", "sdnotify>=1,<2")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == (
        "Python 3.11, aarch64: 2 dependencies and theirs have wheels; of pure Python without a wheel: sdnotify\n"
    )


def test_autosar_e2e_among_the_dependencies_is_an_error(check):
    """It was there, for tests alone, and kept the package off aarch64."""
    done = check("numpy", "autosar-e2e>=1.0,<2")
    assert done.returncode == 1
    assert "autosar-e2e has no wheel, and is not of pure Python" in done.stdout


def test_a_dependency_of_a_dependency_counts(check, index):
    add_wheel(index, "decoder", "py3-none-any", needs=("autosar-e2e",))
    done = check("decoder")
    assert done.returncode == 1
    assert "autosar-e2e has no wheel" in done.stdout


def test_an_index_without_any_such_wheel_cannot_tell(check, index):
    next(index.glob("numpy-*")).unlink()
    done = check("autosar-e2e")
    assert done.returncode == 2
    assert "cannot tell" in done.stdout


def test_wrong_usage_exits_with_2(check):
    done = check("numpy", python="2.7")
    assert (done.returncode, done.stdout) == (2, "")
    assert "no list such as" in done.stderr
