"""What is given away: the wheel and the sdist hold what they must, and can be installed."""

import re
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]

# What must stay at home: caches, results of runs, environments, and what tools keep for themselves.
NOT_GIVEN_AWAY = re.compile(
    r"(^|/)(\.jax_cache|__pycache__|\.pytest_cache|\.hypothesis|\.ruff_cache|\.venv|\.git|\.ci|\.env)"
    r"(/|$)|\.pyc$|\.part$|(^|/)(build|dist|shared|preisach-report|preisach-demo)(/|$)|~$|\.pem$|\.key$"
)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The wheel and the sdist, built by the backend that is installed."""
    pytest.importorskip("hatchling")
    if not (ROOT / "LICENSE").exists():
        pytest.skip("this is no checkout")
    out = tmp_path_factory.mktemp("dist")
    script = (
        "import sys; from hatchling import build; "
        "print(build.build_wheel(sys.argv[1])); print(build.build_sdist(sys.argv[1]))"
    )
    command = [sys.executable, "-c", script, str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,), (sdist,) = out.glob("*.whl"), out.glob("*.tar.gz")
    return wheel, sdist


@pytest.fixture(scope="module")
def in_wheel(built):
    with zipfile.ZipFile(built[0]) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def in_sdist(built):
    with tarfile.open(built[1]) as archive:
        names = {member.name for member in archive.getmembers() if member.isfile()}
    return {name.split("/", 1)[1] for name in names}


def package_files():
    """All files of the package in the checkout but compiled ones."""
    return {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "preisach_jax").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_the_wheel_holds_the_package_and_nothing_else(in_wheel):
    own = {name for name in in_wheel if ".dist-info/" not in name}
    assert own == package_files()
    for kind in ("preisach_jax/report/report.html.j2", "preisach_jax/app/linking.js",
                 "preisach_jax/app/style.css", "preisach_jax/bundled/LICENSE.pmagpy",
                 "preisach_jax/py.typed"):  # fmt: skip
        assert kind in own
    licences = [name for name in in_wheel if ".dist-info/licenses/" in name]
    assert len(licences) == 2


def test_the_sdist_holds_what_builds_and_tests_it(in_sdist):
    assert package_files() <= in_sdist
    assert {"pyproject.toml", "README.md", "LICENSE", "requirements.lock", "PKG-INFO"} <= in_sdist
    assert "tests/conftest.py" in in_sdist


def test_nothing_is_given_away_that_belongs_at_home(in_wheel, in_sdist):
    for name in in_wheel | in_sdist:
        assert not NOT_GIVEN_AWAY.search(name), name


def asked_for(requirements):
    """Bounds of versions by package, as the recipe of conda calls them."""
    split = (re.fullmatch(r"([A-Za-z0-9_-]+) ?(\S*)", text) for text in requirements)
    return {m[1].lower().replace("_", "-"): m[2] for m in split if m is not None}


@pytest.fixture(scope="module")
def project():
    if not (ROOT / "recipe").exists():
        pytest.skip("this is no checkout")
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def recipe():
    """The recipe of conda, its templates filled in."""
    text = (ROOT / "recipe" / "meta.yaml").read_text(encoding="utf-8")
    (number,) = re.findall(r'{% set version = "(.*)" %}', text)
    text = re.sub(r"{%.*%}", "", text).replace("{{ version }}", number)
    return yaml.safe_load(text.replace("{{ PYTHON }}", "python"))


def test_conda_and_the_python_index_ask_for_the_same(project, recipe):
    wanted = asked_for(project["dependencies"]) | {"python": project["requires-python"]}
    run = asked_for(recipe["requirements"]["run"])
    run["matplotlib"] = run.pop("matplotlib-base")
    assert run == wanted
    used = ("files", "parquet", "xarray", "control", "app")
    extras = asked_for(each for name in used for each in project["optional-dependencies"][name])
    assert asked_for(recipe["requirements"]["run_constrained"]) == extras
    assert recipe["build"]["entry_points"] == [f"preisach = {project['scripts']['preisach']}"]


def test_what_keeps_compiled_code_is_asked_for(project):
    # Without it, each command of a plain installation warns, and compiles everything anew.
    assert "filelock" in asked_for(project["dependencies"])
    import jax

    assert hasattr(jax.config, "jax_compilation_cache_max_size")


def test_one_version_stands_everywhere(project, recipe):
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert str(cited["version"]) == project["version"] == recipe["package"]["version"]
    assert version("preisach_jax") == project["version"]
    assert cited["license"] == project["license"] == recipe["about"]["license"]
    assert recipe["about"]["summary"] == project["description"]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = re.findall(r"(?m)^## \[(\d[^\]]*)\]", changes)
    assert not released or released[0] == project["version"]
    assert "## [Unreleased]" in changes or released


@pytest.mark.parametrize(
    "name", [".jax_cache/entry", "tests/__pycache__/a.pyc", "a/.git/config", "preisach-report/x"]
)
def test_what_belongs_at_home_is_recognised(name):
    assert NOT_GIVEN_AWAY.search(name)


def test_the_wheel_is_installed_and_imported_from_where_it_lies(built, tmp_path):
    home = tmp_path / "environment"
    venv.create(home, system_site_packages=True, with_pip=False, symlinks=True)
    with zipfile.ZipFile(built[0]) as archive:
        (entry,) = (name for name in archive.namelist() if name.endswith("entry_points.txt"))
        assert "preisach = preisach_jax.cli:main" in archive.read(entry).decode()
        packages = home / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}"
        archive.extractall(packages / "site-packages")  # what an installer does to a pure wheel
    # The environment of this test stands behind the new one, in which the package itself comes
    # first; the isolated mode keeps the checkout out of it.
    behind = [path for path in sys.path if path.endswith(("site-packages", "dist-packages"))]
    program = (
        f"import sys; sys.path += {behind!r}; import preisach_jax; print(preisach_jax.__file__); "
        "from preisach_jax.cli import main; sys.exit(main(['--version']))"
    )
    python = home / "bin" / "python"
    done = subprocess.run(
        [python, "-I", "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    where, told = done.stdout.splitlines()
    assert Path(where).is_relative_to(home)
    assert told == f"preisach {version('preisach_jax')}"
