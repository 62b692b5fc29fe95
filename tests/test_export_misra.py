"""Generated C keeps the required rules of MISRA C:2012, as far as cppcheck knows them."""

import re
import shutil
import subprocess

import pytest
from exported import STEP_S, drawn

from preisach_jax.export.c import files

ADVISORY = {"2.5", "8.7", "8.9", "12.1", "12.3", "15.5", "17.8"}
"""Rules that the README of the code tells to be broken; all of them are advisory."""

# Every effect of the library in one of its forms
CHAINS = {
    "ramp": "creep output_lag aux:load_N slew_limit resonance hum eddy_currents drift_waves "
    "ripples",
    "relay": "rate_corners_all input_lag reptation operator_creep input_quantisation delay moving "
    "ageing output_nonlinearity",
}


@pytest.mark.skipif(not shutil.which("cppcheck"), reason="no cppcheck here")
@pytest.mark.parametrize("hysteron", CHAINS)
def test_no_required_rule_is_broken(hysteron, tmp_path):
    made = files(drawn(CHAINS[hysteron].split(), 7, 9, hysteron), 1 / STEP_S)
    for name, text in made.items():
        (tmp_path / name).write_text(text)
    words = ["--std=c99", "--enable=warning,style,performance,portability", "--addon=misra"]
    done = subprocess.run(
        ["cppcheck", *words, "-DPREISACH_DOUBLE", str(tmp_path / "preisach_model.c")],
        capture_output=True, text=True, check=True, cwd=tmp_path,
    )  # fmt: skip
    lines = re.findall(r"^\S+preisach_model\.[ch]:\d+:\d+: .*$", done.stderr, re.MULTILINE)
    rules = {found[1] for line in lines if (found := re.search(r"misra-c2012-([\d.]+)", line))}
    assert rules  # those that are left show that cppcheck looks for them
    assert rules <= ADVISORY
    assert [line for line in lines if "misra" not in line] == []
    assert all(f"| {rule} |" in made["README.md"] for rule in rules)
