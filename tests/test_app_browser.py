"""The page in a real browser: the gestures that matter. What it computes, test_app.py tests."""

import re
from urllib.parse import urlparse

import pytest
import world
from browser import FLAGS, browser_path, keep, served

import preisach_jax as pj

pytest.importorskip("panel")
playwright = pytest.importorskip("playwright.sync_api")
axe = pytest.importorskip("axe_playwright_python.sync_playwright")

pytestmark = pytest.mark.slow
PATIENCE_MS = 120_000

FEW = """
from preisach_jax.diagnosis import selection
known = selection.library
selection.library = lambda: {name: known()[name] for name in ("delay", "drift")}
from preisach_jax.app import layout
layout.LEVELS["13 levels"] = 9
"""
"""What the server runs first: two effects are compared, on the plane of most tests."""


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """A stage that hides a delay of some milliseconds, as a file; short, so that fits are quick."""
    drive = world.excitation("rich", 6.0, 500.0, 2)
    stage = pj.simulate_stage(seed=3, drive=drive, rate_hz=500.0, effects=("delay",))
    path = tmp_path_factory.mktemp("stage") / "stage.csv"
    stage.save(path)
    return path


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    with served(folder=tmp_path_factory.mktemp("server"), before=FEW) as address:
        yield address


@pytest.fixture(scope="module")
def window():
    """What its pages have loaded and compiled once, they share."""
    path = browser_path()
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=FLAGS)
        yield browser.new_context(viewport={"width": 1280, "height": 800})
        browser.close()


@pytest.fixture
def tab(window, address):
    """An open page that fails the test on an error of its scripts or a request to elsewhere."""
    page = window.new_page()
    page.set_default_timeout(PATIENCE_MS)
    wrong, hosts = [], {urlparse(address).netloc, ""}
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda r: urlparse(r.url).netloc in hosts or wrong.append(r.url))
    page.on("dialog", lambda dialog: wrong.append(f"a dialog: {dialog.message}"))
    page.goto(address)
    button(page, "Find it for me").wait_for()
    yield page
    page.close()
    assert not wrong


def button(page, name):
    return page.get_by_role("button", name=name, exact=True)


def drop(page, path):
    page.locator("input[type=file]").first.set_input_files(path)


def load(page, path):
    page.get_by_label("Preisach plane").select_option("13 levels")
    drop(page, path)
    page.locator("ol.ladder li").first.wait_for()


def rungs(page):
    """Names and errors in nm, as they stand in the ladder."""
    names = page.locator("ol.ladder .name").all_inner_texts()
    values = map(nanometres, page.locator("ol.ladder .value").all_inner_texts())
    return dict(zip(names, values, strict=True))


def nanometres(text):
    [(number, unit)] = re.findall(r"^([\d.]+) (\S+)", text)
    return float(number) * {"pm": 1e-3, "nm": 1.0, "µm": 1e3}[unit]


DROPPED = """([name, text]) => {
  const dataTransfer = new DataTransfer()
  dataTransfer.items.add(new File([text], name))
  const options = { dataTransfer, bubbles: true, cancelable: true }
  document.body.dispatchEvent(new DragEvent("drop", options))
}"""

FIGURES = """() => Bokeh.documents.flatMap((d) => [...d._all_models.values()])
  .filter((m) => m.type === "Figure").map((m) => m.title.text)"""


def test_a_file_that_is_dropped_anywhere_is_seen(tab, stage):
    tab.get_by_label("Preisach plane").select_option("13 levels")
    tab.evaluate(DROPPED, ["stage.csv", stage.read_text()])
    tab.locator(".told").get_by_text("stage.csv: 3,000 rows").wait_for()
    tab.locator(".facts").wait_for()
    assert set(tab.evaluate(FIGURES)) >= {"Loop", "Output", "Input"}
    tab.locator(".error-size").wait_for()
    size = nanometres(tab.locator(".error-size").inner_text())
    assert size == pytest.approx(rungs(tab)["Preisach model"], rel=5e-3)
    # A drag of the mouse over the view of time chooses rows in all views.
    tab.get_by_text("Drag over any view").wait_for()
    boxes = [each.bounding_box() for each in tab.locator(".bk-Figure").all() if each.is_visible()]
    box = max(boxes, key=lambda box: (box["x"], -box["y"]))
    middle = box["y"] + box["height"] / 2
    tab.mouse.move(box["x"] + 0.3 * box["width"], middle)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 0.6 * box["width"], middle, steps=4)
    tab.mouse.up()
    tab.get_by_text("rows chosen").wait_for()
    keep(tab, "seen")
    wrong = axe.Axe().run(tab).response["violations"]
    assert not [each["id"] for each in wrong if each["impact"] in {"serious", "critical"}]
    tab.set_viewport_size({"width": 375, "height": 800})
    button(tab, "Dark or light").click()
    tab.wait_for_timeout(1000)  # until the colours have changed over
    assert tab.evaluate("() => document.documentElement.scrollWidth") <= 375
    keep(tab, "narrow_and_dark")


def test_an_effect_is_added_by_keyboard_taken_back_and_exported(tab, stage, tmp_path):
    load(tab, stage)
    before = rungs(tab)
    tab.locator(".mark").first.wait_for()
    assert tab.locator(".candidate b").first.inner_text() == "delay"
    button(tab, "Add delay").focus()
    tab.keyboard.press("Enter")
    tab.locator("ol.ladder").get_by_text("+ delay").wait_for()
    assert rungs(tab)["+ delay"] < before["Preisach model"] / 3
    button(tab, "Undo").click()
    playwright.expect(tab.locator("ol.ladder li")).to_have_count(1, timeout=PATIENCE_MS)
    assert rungs(tab) == before
    tab.get_by_role("button", name=re.compile(r"^\+ delay: ")).click()  # on the time line
    playwright.expect(tab.locator("ol.ladder li")).to_have_count(2, timeout=PATIENCE_MS)
    button(tab, "Prepare export").click()
    with tab.expect_download() as waiting:
        tab.get_by_text("Download report.html").click()
    waiting.value.save_as(tmp_path / "report.html")
    assert "delay" in (tmp_path / "report.html").read_text()


def test_what_is_missing_is_found(tab, stage):
    load(tab, stage)
    button(tab, "Find it for me").click()
    tab.locator(".verdict b").filter(has_text="was found").wait_for()
    assert "+ delay" in rungs(tab)
    keep(tab, "found")


BAD = {
    "empty.csv": (b"", "empty"),
    "short.csv": (b"t_s,u_V,z_um\n0,1,2\n1,2\n", "row 3"),
    "model.pkl": (b"\x80\x04cos\nsystem\n(S'touch /tmp/owned'\ntR.", ""),
}


def test_a_bad_file_is_refused_and_what_is_open_stays(tab, tmp_path):
    # What is open has a header that cannot run anything: the tab fails on a dialog.
    evil = "<img src=x onerror=alert(1)>\"'$$\\int$$"
    rows = "".join(f"{k / 100};{k % 40};{(k % 40) ** 2 / 9:.3f}\n" for k in range(400))
    (tmp_path / "evil<b>.csv").write_text(f"t {evil} [s];u {evil} [V];z {evil} [um]\n{rows}")
    tab.get_by_label("Preisach plane").select_option("13 levels")
    drop(tab, tmp_path / "evil<b>.csv")
    tab.get_by_text("evil<b>.csv").first.wait_for()
    for label, option in (("Time", 1), ("Input", 2), ("Output", 3)):
        tab.get_by_label(label, exact=True).select_option(index=option)
    tab.locator("ol.ladder li").first.wait_for()
    assert tab.locator("img[src=x]").count() == 0
    before = rungs(tab)
    for name, (content, expected) in BAD.items():
        (tmp_path / name).write_bytes(content)
        drop(tab, tmp_path / name)
        told = tab.locator(".error").filter(has_text=name)
        told.wait_for()
        assert expected in told.inner_text()
        assert "/" not in told.inner_text().replace("CSV/", "")
        assert rungs(tab) == before
    keep(tab, "refused")
    # A file whose columns are a question takes its place, and nothing of it stays.
    (tmp_path / "plain.csv").write_text(
        "".join(f"{k},{k % 7},{k % 5},{k % 3}\n" for k in range(99))
    )
    drop(tab, tmp_path / "plain.csv")
    tab.get_by_text("press the loop that is right").wait_for()
    assert tab.locator("ol.ladder li, .verdict").count() == 0
    keep(tab, "asked")
