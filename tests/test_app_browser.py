"""The page in a real browser: what a person would do with eyes and a mouse."""

import ast
import re
import subprocess
import sys
from urllib.parse import urlparse

import numpy as np
import pytest
from browser import FLAGS, browser_path, keep, served
from test_files import REFUSED, put
from test_form import hidden_record

import preisach_jax as pj

pytest.importorskip("panel")
playwright = pytest.importorskip("playwright.sync_api")

pytestmark = pytest.mark.slow
PATIENCE_MS = 120_000


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """A stage that hides a delay of some milliseconds, as a file; short, so that fits are quick."""
    stage = pj.simulate_stage(seed=3, seconds=6.0, rate_hz=1000.0, effects=("delay",))
    path = tmp_path_factory.mktemp("stage") / "stage.csv"
    stage.save(path)
    return path


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    with served(folder=tmp_path_factory.mktemp("server")) as address:
        yield address


@pytest.fixture(scope="module")
def chromium():
    path = browser_path()
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def window(chromium):
    """What its pages have loaded and compiled once, they share."""
    context = chromium.new_context(viewport={"width": 1280, "height": 800})
    yield context
    context.close()


@pytest.fixture
def tab(window, address):
    """An open page that fails the test on an error of its scripts or a request to elsewhere."""
    page = window.new_page()
    page.set_default_timeout(PATIENCE_MS)
    wrong = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda request: wrong.extend(elsewhere(request.url, address)))
    page.on("dialog", lambda dialog: wrong.append(f"a dialog: {dialog.message}"))
    page.goto(address)
    button(page, "Find it for me").wait_for()
    yield page
    page.close()
    assert not wrong


def elsewhere(url, address):
    here = urlparse(url).netloc in {urlparse(address).netloc, ""}
    return [] if here else [url]


def button(page, name):
    return page.get_by_role("button", name=name, exact=True)


def drop(page, path):
    page.locator("input[type=file]").set_input_files(path)


def load(page, path):
    page.get_by_label("Preisach plane").select_option("13 levels")
    drop(page, path)
    page.locator("ol.ladder li").first.wait_for()


def rungs(page):
    """Names and errors, as they stand in the ladder."""
    names = page.locator("ol.ladder .name").all_inner_texts()
    values = page.locator("ol.ladder .value").all_inner_texts()
    return dict(zip(names, values, strict=True))


def nanometres(text):
    [(number, unit)] = re.findall(r"^([\d.]+) (\S+)", text)
    return float(number) * {"pm": 1e-3, "nm": 1.0, "µm": 1e3}[unit]


def test_a_hidden_effect_is_found_added_undone_and_exported(tab, stage, tmp_path):
    load(tab, stage)
    before = nanometres(rungs(tab)["Preisach model"])

    tab.locator(".mark").first.wait_for()
    first = tab.locator(".candidate").first
    assert first.locator("b").inner_text() == "delay"
    assert first.locator("details").text_content().count("the held-out mean square by") == 1
    left = first.locator(".leaves").inner_text()
    keep(tab, "record")
    keep(tab, "candidates")
    button(tab, "Add delay").click()
    tab.locator("ol.ladder").get_by_text("+ delay").wait_for()
    after = nanometres(rungs(tab)["+ delay"])
    assert after < before / 3
    assert nanometres(left.removeprefix("would leave ")) < before / 3
    names = tab.locator(".candidate b")
    playwright.expect(names.first).not_to_have_text("delay", timeout=PATIENCE_MS)
    keep(tab, "added")

    button(tab, "Undo").click()
    playwright.expect(tab.locator("ol.ladder li")).to_have_count(1, timeout=PATIENCE_MS)
    assert nanometres(rungs(tab)["Preisach model"]) == before
    playwright.expect(names.first).to_have_text("delay", timeout=PATIENCE_MS)
    button(tab, "Add delay").click()
    tab.locator("ol.ladder").get_by_text("+ delay").wait_for()
    assert nanometres(rungs(tab)["+ delay"]) == after

    report = download_of_export(tab, tmp_path)
    files = {name: download(tab, name, tmp_path) for name in ("repeat.py", "model.json")}
    assert "delay" in report
    assert "http://" not in re.sub(r'xmlns[:\w]*="[^"]*"', "", report)
    keep(tab, "exported")
    repeated = subprocess.run(
        [sys.executable, files["repeat.py"], stage],
        capture_output=True, text=True, cwd=tmp_path / "..", check=False,
    )  # fmt: skip
    assert repeated.returncode == 0, repeated.stderr
    assert "delay" in repeated.stdout
    told, again = (
        pj.Model.load(path) for path in (files["model.json"], tmp_path / ".." / "model.json")
    )
    assert again.parameters == told.parameters
    assert again.rms_validation == told.rms_validation
    error = float(repeated.stdout.splitlines()[-1].split()[-2])
    assert f"{1e3 * error:.4g} nm" in rungs(tab)["+ delay"]


def test_a_form_of_what_no_effect_explains_is_looked_for(tab, tmp_path):
    record, _ = hidden_record("position times rate", 901)
    rows = np.column_stack([record.time, record.input, record.output])
    path = tmp_path / "coil.csv"
    np.savetxt(path, rows, delimiter=",", header="t_s,u_V,z_um", comments="")
    load(tab, path)
    button(tab, "Look for a form").click()
    words = tab.locator(".verdict .words")
    words.get_by_text("form, not cause").wait_for()
    assert "· u · u'" in words.inner_text()
    playwright.expect(button(tab, "Look for a form")).to_be_hidden()
    keep(tab, "form")
    report = download_of_export(tab, tmp_path)
    assert "This is a form, not a cause" in report


def download_of_export(page, folder):
    button(page, "Prepare export").click()
    return download(page, "report.html", folder).read_text()


def download(page, name, folder):
    with page.expect_download() as waiting:
        page.get_by_text(f"Download {name}").click()
    path = folder / name
    waiting.value.save_as(path)
    return path


def test_a_dropped_file_is_drawn_and_fitted_without_a_click(tab, stage):
    drop(tab, stage)
    tab.locator(".facts").wait_for()
    assert set(tab.evaluate(FIGURES)) >= {"Loop", "Output", "Input"}
    told = tab.locator(".facts").inner_text()
    for name, value in pj.look(stage).rows():
        assert name in told
        assert " ".join(value.split()) in " ".join(told.split())
    tab.locator(".error-size").wait_for()
    size, share = tab.locator(".error-size").inner_text(), tab.locator(".share").inner_text()
    assert nanometres(size) == pytest.approx(nanometres(rungs(tab)["Preisach model"]), rel=5e-3)
    record = pj.Record.load(stage)
    stroke = 1e3 * record.output_range
    assert float(share.split()[0]) == pytest.approx(100 * nanometres(size) / stroke, rel=0.05)
    assert height_of_letters(tab.locator(".error-size")) >= 24
    tab.locator(".verdict b").filter(has_text="Something is missing").wait_for()


DROPPED = """([name, text]) => {
  const dataTransfer = new DataTransfer()
  dataTransfer.items.add(new File([text], name))
  const options = { dataTransfer, bubbles: true, cancelable: true }
  document.body.dispatchEvent(new DragEvent("drop", options))
}"""


def test_files_are_dropped_anywhere_one_after_the_other(tab, stage):
    text = stage.read_text()
    tab.evaluate(DROPPED, ["first.csv", text])
    tab.locator(".told").get_by_text("first.csv: 6,000 rows").wait_for()
    half = "\n".join(text.splitlines()[:3001])
    tab.evaluate(DROPPED, ["second.csv", half])
    tab.locator(".told").get_by_text("second.csv: 3,000 rows").wait_for()


def test_a_column_is_changed_over_the_plot(tab, stage):
    load(tab, stage)
    button(tab, "Record").click()
    tab.get_by_label("Input", exact=True).select_option("z_um")
    tab.get_by_label("Output", exact=True).select_option("u_V")
    tab.get_by_text("input z_um").wait_for()
    tab.locator("ol.ladder li").first.wait_for()
    assert rungs(tab)["Preisach model"].endswith("V")


def test_the_time_line_leads_back_and_on_by_keyboard(tab, stage):
    load(tab, stage)
    tab.locator(".mark").first.wait_for()
    add = button(tab, "Add delay")
    add.focus()
    tab.keyboard.press("Enter")
    tab.locator("ol.ladder").get_by_text("+ delay").wait_for()
    plain = tab.get_by_role("button", name=re.compile(r"^Preisach model: "))
    plain.press("Enter")  # on the button itself: the line is drawn anew while the page still works
    playwright.expect(tab.locator("ol.ladder li")).to_have_count(1, timeout=PATIENCE_MS)
    tab.get_by_role("button", name=re.compile(r"^\+ delay: ")).click()
    playwright.expect(tab.locator("ol.ladder li")).to_have_count(2, timeout=PATIENCE_MS)


def test_a_project_is_saved_and_opened_again(tab, chromium, address, stage, tmp_path):
    load(tab, stage)
    tab.locator(".mark").first.wait_for()
    button(tab, "Add delay").click()
    tab.locator("ol.ladder").get_by_text("+ delay").wait_for()
    before = rungs(tab)
    button(tab, "Save project").click()
    path = download(tab, "stage.preisach", tmp_path)
    other = chromium.new_page()
    other.set_default_timeout(PATIENCE_MS)
    other.goto(address)
    button(other, "Find it for me").wait_for()
    drop(other, path)
    other.locator("ol.ladder").get_by_text("+ delay").wait_for()
    assert rungs(other) == before
    assert other.locator(".error").count() == 0
    other.close()


def test_dark_mode_changes_paper_and_plots(tab, stage):
    load(tab, stage)
    paper = "() => getComputedStyle(document.body).backgroundColor"
    light = tab.evaluate(paper)
    button(tab, "Dark or light").click()
    dark = tab.evaluate(paper)
    assert brightness(light) > 0.9
    assert brightness(dark) < 0.2
    keep(tab, "dark")
    button(tab, "Dark or light").click()
    assert tab.evaluate(paper) == light


WIDTHS = (375, pytest.param(900, marks=pytest.mark.campaign), 1400)
SERIOUS = (375, *(pytest.param(width, marks=pytest.mark.campaign) for width in (900, 1400)))


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_lies_beside_the_window_or_over_something_else(tab, stage, width):
    tab.set_viewport_size({"width": width, "height": 800})
    load(tab, stage)
    tab.locator(".mark").first.wait_for()
    assert tab.evaluate("() => document.documentElement.scrollWidth") <= width
    boxes = [tab.locator(".verdict"), tab.get_by_label("Output", exact=True),
             button(tab, "Add delay"), button(tab, "Find it for me")]  # fmt: skip
    for each in boxes:
        each.scroll_into_view_if_needed()
        box = each.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
    figures = tab.evaluate(FIGURE_BOXES)
    assert len(figures) == 4
    for k, (left, top, right, bottom) in enumerate(figures):
        assert right - left >= 240
        assert bottom - top >= 200
        for other in figures[:k]:
            beside = right <= other[0] + 1 or left >= other[2] - 1
            assert beside or bottom <= other[1] + 1 or top >= other[3] - 1
    keep(tab, f"width_{width}")


@pytest.mark.parametrize("width", SERIOUS)
def test_axe_finds_nothing_serious(tab, stage, width):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    tab.set_viewport_size({"width": width, "height": 800})
    found = serious(axe.Axe().run(tab))
    load(tab, stage)
    tab.locator(".mark").first.wait_for()
    found |= serious(axe.Axe().run(tab))
    button(tab, "Record").click()
    tab.locator(".facts").wait_for()
    button(tab, "Dark or light").click()
    found |= serious(axe.Axe().run(tab))
    assert not found


def serious(results):
    return {
        (wrong["id"], node["html"][:120])
        for wrong in results.response["violations"]
        if wrong["impact"] in {"serious", "critical"}
        for node in wrong["nodes"]
    }


def brightness(colour):
    return sum(map(int, re.findall(r"\d+", colour)[:3])) / (3 * 255)


def height_of_letters(located):
    return float(located.evaluate("e => getComputedStyle(e).fontSize").removesuffix("px"))


FIGURES = """() => Bokeh.documents.flatMap((d) => [...d._all_models.values()])
  .filter((m) => m.type === "Figure").map((m) => m.title.text)"""

HAS_POINTS = """count => Bokeh.documents.some(document =>
  Array.from(document._all_models.values()).some(model => model.type === "ColumnDataSource"
    && Object.values(model.data)[0]?.length === count))"""

FIGURE_BOXES = """() => {
  const found = []
  const walk = (element) => {
    if (element.classList?.contains("bk-Figure") && element.getBoundingClientRect().width > 0) {
      const box = element.getBoundingClientRect()
      found.push([box.left, box.top, box.right, box.bottom])
    }
    for (const child of [...(element.shadowRoot?.children ?? []), ...element.children]) walk(child)
  }
  walk(document.body)
  return found
}"""


@pytest.mark.campaign
def test_the_whole_search_runs_before_the_eyes(tab, stage):
    load(tab, stage)
    button(tab, "Find it for me").click()
    tab.locator("ol.ladder li").first.wait_for()
    tab.locator(".verdict").filter(has_text="is found").wait_for()
    assert "+ delay" in rungs(tab)
    keep(tab, "found")


def test_a_search_can_be_cancelled_and_leaves_what_was_there(tab, stage, tmp_path):
    load(tab, stage)
    tab.get_by_text("Drag over any view").wait_for()
    error = rungs(tab)["Preisach model"]
    button(tab, "Find it for me").click()
    playwright.expect(button(tab, "Prepare export")).to_be_disabled()
    button(tab, "Cancel").click()
    playwright.expect(button(tab, "Prepare export")).to_be_enabled(timeout=PATIENCE_MS)
    assert rungs(tab) == {"Preisach model": error}
    # A file that cannot be read takes nothing away either.
    broken = tmp_path / "broken.csv"
    broken.write_text("t_s,u_V,z_um\n0,1,2\n1,2\n")
    tab.locator("input[type=file]").set_input_files(broken)
    tab.locator(".error").wait_for()
    assert rungs(tab) == {"Preisach model": error}


def test_a_brush_lights_up_all_views_at_once(tab, stage):
    load(tab, stage)
    tab.get_by_text("Drag over any view").wait_for()
    tab.add_script_tag(content=f"window.brushed = {BRUSH}")
    rows, cells, corners = tab.evaluate("window.brushed('Time', 1.0, 2.0)")
    assert rows == pytest.approx(1000, abs=2)
    assert cells > 10
    assert corners >= 2
    tab.get_by_text("rows chosen, 1.0").wait_for()
    keep(tab, "brushed")
    # The residual against another axis shows all of that axis, and forgets what was chosen.
    tab.get_by_label("Residual against").select_option("input")
    tab.get_by_text("Drag over any view").wait_for()
    low, high = tab.evaluate(RESIDUAL_RANGE)
    assert low < 0.0
    assert 75.0 < high < 80.0
    # A drag of the mouse over the view of time chooses rows as well.
    left, top, right, bottom = max(tab.evaluate(FIGURE_BOXES), key=lambda box: (box[0], -box[1]))
    tab.mouse.move(0.7 * left + 0.3 * right, 0.5 * (top + bottom))
    tab.mouse.down()
    tab.mouse.move(0.4 * left + 0.6 * right, 0.5 * (top + bottom), steps=4)
    tab.mouse.up()
    tab.get_by_text("rows chosen").wait_for()
    keep(tab, "dragged")
    # On the plane a rectangle of cells chooses the rows that switch them, and no others.
    rows, _, _ = tab.evaluate("window.brushed('Preisach plane', 20, 30, 40, 50)")
    record = pj.Record.load(stage)
    assert rows == switching_rows(record.input, (20, 30), (40, 50))


RESIDUAL_RANGE = """() => {
  const models = [...Bokeh.documents.flatMap((d) => [...d._all_models.values()])]
  const figure = models.find((m) => m.type === "Figure" && m.title.text.startsWith("Residual"))
  return [figure.x_range.start, figure.x_range.end]
}"""

BRUSH = """async (title, x0, x1, y0 = -1e9, y1 = 1e9) => {
  const found = (m) => m.js_event_callbacks.selectiongeometry && m.title.text.startsWith(title)
  const figures = [...Bokeh.documents.flatMap((d) => [...d._all_models.values()])]
  const figure = figures.find((m) => m.type === "Figure" && found(m))
  const script = figure.js_event_callbacks.selectiongeometry[0]
  await script.execute({ final: true, geometry: { type: "rect", x0, x1, y0, y1 } })
  const { cells, staircase, told } = script.args
  const rows = Number(told.text.split(" ")[0].replaceAll(",", ""))
  return [rows, cells.data.x.length, staircase.data.x.length]
}"""


def switching_rows(u, beta, alpha):
    """How many samples switch a hysteron of a rectangle, from the states of a fine grid of them."""
    betas, alphas = (np.linspace(low, high, 201) for low, high in (beta, alpha))
    on = np.zeros((201, 201), dtype=bool) | (u[0] >= alphas[:, None])
    count = 0
    for value in u[1:]:
        rising = on | (value >= alphas[:, None])
        new = rising & ~(value <= betas[None, :])
        count += bool((new != on).any())
        on = new
    return pytest.approx(count, rel=0.01)


VISIBLE_TITLES = """() => Bokeh.documents.flatMap((d) => [...d._all_models.values()])
  .filter((m) => m.type === "Figure" && m.visible).map((m) => m.title.text)"""


def to_drive(page, path):
    """Open a file, and the view "Drive" as soon as there is a model."""
    load(page, path)
    button(page, "Drive").click()
    button(page, "Find the drive").wait_for()


def test_a_typed_shape_is_driven_and_taken_away(tab, stage, tmp_path):
    button(tab, "Drive").click()
    tab.get_by_text("Drop a record above").wait_for()
    to_drive(tab, stage)
    tab.get_by_label("Wanted course").select_option("Sine")
    tab.get_by_label("Frequency (Hz)").fill("7")
    tab.keyboard.press("Tab")
    button(tab, "Find the drive").click()
    told = tab.locator(".outcome")
    told.get_by_text("straight line").wait_for()
    assert nanometres(told.locator(".size").inner_text()) > 0
    assert {"Drive", "Error (wanted minus expected)"} <= set(tab.evaluate(VISIBLE_TITLES))
    keep(tab, "drive")
    drive = np.genfromtxt(download(tab, "drive.csv", tmp_path), delimiter=",", names=True)
    wanted = np.genfromtxt(download(tab, "wanted.csv", tmp_path), delimiter=",", names=True)
    assert len(drive) == len(wanted) == 1 + 3500 // 7
    model = pj.Model.load(download(tab, "model.json", tmp_path))
    course = pj.Record.from_arrays(wanted["t_s"], 0 * wanted["t_s"], wanted["z_um"])
    np.testing.assert_allclose(drive["u"], pj.compensate(model, course).drive, atol=1e-5)


def test_a_course_that_cannot_be_reached_is_told_and_the_page_goes_on(tab, stage, tmp_path):
    to_drive(tab, stage)
    tab.get_by_label("Highest drive (V)").fill("20")
    button(tab, "Find the drive").click()
    tab.locator(".outcome.unmet").get_by_text("rows cannot be reached").wait_for()
    tab.get_by_text("--limits=0,20").wait_for()
    keep(tab, "drive_unreached")
    tab.get_by_label("Highest drive (V)").fill("-5")
    button(tab, "Find the drive").click()
    tab.locator(".error").get_by_text("give two numbers, the lower one first").wait_for()
    assert tab.locator(".outcome").count() == 0
    # A course in a file: one that lacks its column is refused by a line, the next is driven.
    tab.get_by_label("Highest drive (V)").fill("")
    tab.get_by_label("Wanted course").select_option("From a file")
    tab.locator("input[type=file]").nth(1).wait_for(state="attached")
    course = tmp_path / "course.csv"
    for column in ("position", "z_um"):
        rows = "".join(f"{k / 1000},{10 + 5 * np.sin(k / 50):.6f}\n" for k in range(800))
        course.write_text(f"t_s,{column}\n{rows}")
        tab.locator("input[type=file]").nth(1).set_input_files(course)
        if column == "position":
            tab.locator(".error").get_by_text("position").wait_for()
    playwright.expect(tab.locator(".error")).to_have_count(0, timeout=PATIENCE_MS)
    button(tab, "Find the drive").click()
    tab.get_by_text("preisach compensate model.json course.csv").wait_for()
    assert rungs(tab)  # what was open is still there


@pytest.mark.parametrize("width", SERIOUS)
def test_a_course_is_drawn_with_the_mouse_and_fits_the_window(tab, stage, width):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    tab.set_viewport_size({"width": width, "height": 800})
    to_drive(tab, stage)
    tab.get_by_label("Wanted course").select_option("Drawn points")
    points = tab.get_by_label("Points:")
    points.wait_for()
    before = points.input_value().splitlines()
    tab.wait_for_function(HAS_POINTS, arg=len(before), timeout=PATIENCE_MS)
    tab.wait_for_timeout(1000)  # until the figure has its place
    points.scroll_into_view_if_needed()
    [(left, top, right, bottom)] = tab.evaluate(FIGURE_BOXES)
    tab.mouse.click(0.2 * left + 0.8 * right, 0.5 * (top + bottom))
    playwright.expect(points).not_to_have_value("\n".join(before), timeout=PATIENCE_MS)
    assert len(points.input_value().splitlines()) == len(before) + 1
    button(tab, "Find the drive").click()
    tab.locator(".outcome").wait_for()
    assert tab.evaluate("() => document.documentElement.scrollWidth") <= width
    found = serious(axe.Axe().run(tab))
    button(tab, "Dark or light").click()
    # Behind what is scrolled out of its box, axe sees colours that nobody does.
    tab.locator("input[type=file]").first.evaluate("e => e.scrollIntoView()")
    tab.wait_for_timeout(1000)  # until the colours have changed over
    found |= serious(axe.Axe().run(tab))
    assert not found
    keep(tab, f"drive_{width}")


@pytest.mark.campaign
def test_two_tabs_do_not_disturb_each_other(tab, chromium, address, stage, tmp_path):
    other = chromium.new_page()
    other.set_default_timeout(PATIENCE_MS)
    other.goto(address)
    button(other, "Find it for me").wait_for()
    load(tab, stage)
    mine = tmp_path / "broken.csv"
    mine.write_text("t_s,u_V,z_um\n0,1,2\n1,2\n")
    drop(other, mine)
    other.locator(".error").wait_for()
    assert other.locator("ol.ladder li").count() == 0
    assert tab.locator(".error").count() == 0
    other.close()


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("empty.csv", b"", "empty"),
        ("picture.csv", b"\x89PNG\r\n\x1a\n" + bytes(2000), "binary"),
        ("short.csv", b"t_s,u_V,z_um\n0,1,2\n1,2\n", "row 3"),
        ("model.pkl", b"\x80\x04cos\nsystem\n(S'touch /tmp/owned'\ntR.", ""),
    ],
)
def test_a_broken_file_is_refused_with_a_remedy(tab, tmp_path, name, content, expected):
    path = tmp_path / name
    path.write_bytes(content)
    drop(tab, path)
    told = tab.locator(".error")
    told.wait_for()
    assert name in told.inner_text()
    assert expected in told.inner_text()
    assert "/" not in told.inner_text().replace("CSV/", "")
    keep(tab, f"refused_{path.stem}")


def test_what_is_open_stays_when_a_bad_file_comes(tab, stage, tmp_path):
    pytest.importorskip("openpyxl")
    pytest.importorskip("nptdms")
    load(tab, stage)
    before = rungs(tab)
    for name in UNTAKEN:
        case = REFUSED[name]
        put(tmp_path / name, case.content)
        drop(tab, tmp_path / name)
        told = tab.locator(".error").filter(has_text=name)
        told.wait_for()
        assert any(word in told.inner_text() for word in case.refused[0].split("|"))
        assert rungs(tab) == before
        assert tab.get_by_label("Input", exact=True).input_value() == "u_V"


UNTAKEN = (
    "password.xlsx", "macros.xlsm", "broken.tdms", "many.zip", "bomb.csv.gz", "bomb.zip",
    "bomb.xlsx", "million_columns.csv", "mixed.csv", "login_page.csv",
)  # fmt: skip


@pytest.mark.parametrize("width", SERIOUS)
def test_records_and_models_are_compared(tab, stage, tmp_path, width):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    tab.set_viewport_size({"width": width, "height": 800})
    load(tab, stage)
    button(tab, "Compare").click()
    later = pj.simulate_stage(seed=3, seconds=6.0, rate_hz=1000.0, effects=("creep",))
    later.save(tmp_path / "later.csv")
    (tmp_path / "again.csv").write_bytes(stage.read_bytes())
    box = tab.locator("input[type=file]").nth(1)
    box.set_input_files([tmp_path / "later.csv", tmp_path / "again.csv"])
    table = tab.locator(".preview table").filter(has_text="in the model's band")
    table.get_by_text("again.csv").wait_for()
    assert table.locator("tbody tr").count() == 3
    cells = table.locator("tbody tr td:nth-child(3)").all_inner_texts()
    assert cells[0] == cells[2] != cells[1]  # the same record, and another one
    picture = tab.locator("img.overlay")
    picture.scroll_into_view_if_needed()
    assert picture.evaluate("e => e.complete && e.naturalWidth > 500")
    tab.get_by_text("preisach compare page-model.json stage.csv later.csv again.csv").wait_for()
    assert tab.evaluate("() => document.documentElement.scrollWidth") <= width
    keep(tab, f"compare_{width}")
    assert not serious(axe.Axe().run(tab))
    button(tab, "Take away later.csv").click()
    playwright.expect(table.locator("tbody tr")).to_have_count(2, timeout=PATIENCE_MS)
    assert rungs(tab)


def test_a_header_cannot_run_anything(tab, tmp_path):
    evil = "<img src=x onerror=alert(1)>\"'$$\\int$$"
    path = tmp_path / "evil<b>.csv"
    rows = "".join(f"{k / 100};{k % 40};{(k % 40) ** 2 / 9:.3f}\n" for k in range(400))
    path.write_text(f"t {evil} [s];u {evil} [V];z {evil} [um]\n{rows}", encoding="utf-8")
    drop(tab, path)
    tab.get_by_text("evil<b>.csv").first.wait_for()
    for label, option in (("Time", 1), ("Input", 2), ("Output", 3)):
        tab.get_by_label(label, exact=True).select_option(index=option)
    tab.locator(".facts").wait_for()
    assert tab.locator("img[src=x]").count() == 0
    keep(tab, "evil_header")


def test_the_script_is_python(stage):
    from preisach_jax.app.script import Click, script

    step = pj.explore(pj.Record.load(stage), ["delay"], levels=5)
    evil = "z'''\"\n__import__('os')"
    text = script(
        evil,
        {"time": "t_s", "input": "u_V", "output": evil},
        [Click("fit", 5), Click("undo")],
        step,
    )
    tree = ast.parse(text)
    called = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    assert "__import__" not in called


def test_a_report_is_zoomed_and_printed(chromium, stage, tmp_path):
    from preisach_jax.report import write_report

    step = pj.explore(pj.Record.load(stage), ["delay"], levels=9).add("delay")
    write_report(step.conclude(), tmp_path)
    page = chromium.new_page(viewport={"width": 1280, "height": 800})
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((tmp_path / "report.html").as_uri())
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    page.set_viewport_size({"width": 1280, "height": 720})
    first = page.locator(".first")
    for each in (".verdict", ".size", ".next code", "figure img"):  # all on the first screen
        box = first.locator(each).first.bounding_box()
        assert box["y"] + box["height"] <= 720, each
    figures = page.locator("figure img")
    keep(page, "report")
    figures.first.focus()
    page.keyboard.press("Enter")
    opened = page.locator("dialog img")
    playwright.expect(opened).to_be_visible()
    width = opened.bounding_box()["width"]
    page.mouse.move(640, 400)
    page.mouse.wheel(0, -400)
    page.wait_for_function(
        "width => document.querySelector('dialog img').clientWidth > 2 * width", arg=width
    )
    keep(page, "report_zoomed")
    page.keyboard.press("Escape")
    playwright.expect(opened).to_be_hidden()
    printed = page.pdf(prefer_css_page_size=True)
    assert printed.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) == 2
    (tmp_path / "report.pdf").write_bytes(printed)
    page.set_viewport_size({"width": 375, "height": 740})
    assert page.evaluate("document.documentElement.scrollWidth") <= 375
    assert (tmp_path / "report.html").stat().st_size < 6_000_000
    page.close()
