"""What is given away: the wheel holds what it must and nothing else, and works where it lies."""

import re
import subprocess
import sys
import venv
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_the_wheel_holds_the_package_alone_and_is_imported_from_where_it_lies(tmp_path):
    pytest.importorskip("hatchling")
    if not (ROOT / "LICENSE").exists():
        pytest.skip("this is no checkout")
    script = "import sys; from hatchling import build; build.build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], cwd=ROOT, check=True)
    home = tmp_path / "environment"
    venv.create(home, system_site_packages=True, with_pip=False, symlinks=True)
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
        (entry,) = (name for name in archive.namelist() if name.endswith("entry_points.txt"))
        assert "preisach = preisach_jax.cli:main" in archive.read(entry).decode()
        packages = home / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}"
        archive.extractall(packages / "site-packages")  # what an installer does to a pure wheel
    assert held == {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "preisach_jax").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert not [name for name in held if re.search(r"\.(pyc|part|pem|key)$|/\.|~$", name)]
    # The environment of this test stands behind the new one, in which the package itself comes
    # first; the isolated mode keeps the checkout out of it.
    behind = [path for path in sys.path if path.endswith(("site-packages", "dist-packages"))]
    program = (
        f"import sys; sys.path += {behind!r}; import preisach_jax; print(preisach_jax.__file__); "
        "from preisach_jax.cli import main; sys.exit(main(['--version']))"
    )
    done = subprocess.run(
        [home / "bin" / "python", "-I", "-c", program],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    where, told = done.stdout.splitlines()
    assert Path(where).is_relative_to(home)
    assert told == f"preisach {version('preisach_jax')}"
