"""Compiled code is kept between runs of the command line, where nothing else was asked for."""

import signal
import subprocess
import sys
import time

import jax
import pytest

from preisach_jax.cli import process
from preisach_jax.cli.process import folder, kept_between_runs


def asked_for():
    return getattr(jax.config, "jax_compilation_cache_dir")  # noqa: B009 - it is not declared


@pytest.fixture
def nothing_asked(monkeypatch, tmp_path):
    """As for a user: no cache is configured, and the user's folder is empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    before = asked_for()
    jax.config.update("jax_compilation_cache_dir", None)
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def test_compiled_code_is_kept_unless_a_folder_was_asked_for_or_none_can_be_made(
    nothing_asked, monkeypatch
):
    asked = str(nothing_asked / "mine")
    jax.config.update("jax_compilation_cache_dir", asked)
    with kept_between_runs() as first:
        assert (first, asked_for()) == (False, asked)
    assert not folder().exists()
    jax.config.update("jax_compilation_cache_dir", None)
    with kept_between_runs() as first:
        assert (first, asked_for()) == (True, str(folder()))
        (folder() / "compiled").touch()
    assert asked_for() is None
    with kept_between_runs() as first:
        assert not first
    (nothing_asked / "file").touch()
    monkeypatch.setattr(process, "_user_cache", lambda: nothing_asked / "file" / "below")
    with kept_between_runs() as first:
        assert (first, asked_for()) == (False, None)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_an_interruption_ends_what_the_interpreter_cannot():
    """A single call that takes minutes, as compiled code may."""
    code = (
        "from preisach_jax.cli.process import listen\n"
        "import hashlib\n"
        "listen()\n"
        "print('ready', flush=True)\n"
        "hashlib.pbkdf2_hmac('sha256', b'word', b'salt', 2_000_000_000)\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "ready\n"
    time.sleep(0.2)
    child.send_signal(signal.SIGINT)
    _, told = child.communicate(timeout=60)  # the call takes longer
    assert child.returncode == 130
    assert told == "preisach: interrupted\n"
