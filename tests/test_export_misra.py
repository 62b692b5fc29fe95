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

needs_cppcheck = pytest.mark.skipif(not shutil.which("cppcheck"), reason="no cppcheck here")


def broken(folder, text):
    """What cppcheck finds: rules of MISRA that are broken, and complaints of its own."""
    file = folder / "preisach_model.c"
    file.write_text(text)
    words = ["--std=c99", "--enable=warning,style,performance,portability", "--addon=misra"]
    done = subprocess.run(
        ["cppcheck", *words, "-DPREISACH_DOUBLE", str(file)],
        capture_output=True, text=True, check=True, cwd=folder,
    )  # fmt: skip
    lines = re.findall(r"^\S+preisach_model\.[ch]:\d+:\d+: .*$", done.stderr, re.MULTILINE)
    rules = {found[1] for line in lines if (found := re.search(r"misra-c2012-([\d.]+)", line))}
    return rules, [line for line in lines if "misra" not in line]


@needs_cppcheck
@pytest.mark.parametrize("hysteron", CHAINS)
def test_no_required_rule_is_broken(hysteron, tmp_path):
    made = files(drawn(CHAINS[hysteron].split(), 7, 9, hysteron), 1 / STEP_S)
    for name, text in made.items():
        (tmp_path / name).write_text(text)
    rules, others = broken(tmp_path, made["preisach_model.c"])
    assert rules <= ADVISORY
    assert others == []
    assert all(f"| {rule} |" in made["README.md"] for rule in rules)


@needs_cppcheck
def test_a_broken_rule_is_seen(tmp_path):
    made = files(drawn([], 7, 9, "ramp"), 1 / STEP_S)
    for name, text in made.items():
        (tmp_path / name).write_text(text)
    worse = made["preisach_model.c"].replace("(void)memset(", "memset(", 1)
    assert worse != made["preisach_model.c"]
    rules, _ = broken(tmp_path, worse)
    assert rules - ADVISORY == {"17.7"}
