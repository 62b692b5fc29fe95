"""The page without a browser: what it keeps of a file, what it computes for its views, its jobs."""

import ast
import json
import re
import runpy
import threading
import time
import zipfile
from functools import partial
from io import BytesIO
from typing import Any

import numpy as np
import pytest

import preisach_jax as pj

pytest.importorskip("panel")

from bokeh.document import Document
from bokeh.io.doc import patch_curdoc
from panel.io.state import set_curdoc

from preisach_jax.app import panels, steps
from preisach_jax.app.columns import ColumnChoice
from preisach_jax.app.jobs import Job
from preisach_jax.app.layout import Dropper
from preisach_jax.app.opening import Content
from preisach_jax.app.page import Page
from preisach_jax.app.panels import failure, ladder, table, told, verdict
from preisach_jax.app.steps import Click, Walk, exports, packed, repeated, saved, script, unpacked
from preisach_jax.app.upload import Upload, harmless_name
from preisach_jax.app.views import Views
from preisach_jax.record.columns import ReadOptions
from preisach_jax.record.core import Record

EVIL = "<img src=x onerror=alert(1)>"


def csv(count=200, header="t_s,u_V,z_um"):
    t = np.arange(count) / 50
    u = 5 - 5 * np.cos(2 * np.pi * t / 1.3) * (1 - t / 20)
    rows = zip(t, u, u**1.1 + 0.02 * t, strict=True)
    lines = [header, *(f"{a:.4f},{b:.6f},{c:.6f}" for a, b, c in rows)]
    return "\n".join([*lines, ""]).encode()


@pytest.fixture(scope="module")
def step():
    t = np.arange(3000) / 100
    u = 5 - 5 * np.cos(t * (1 + t / 40))
    z = u**1.1 + 0.01 * t + 0.005 * np.random.default_rng(5).normal(size=t.size)
    record = pj.Record.from_arrays(t, u, z, units={"input": "V", "output": "um"}, name=EVIL)
    return pj.explore(record, ["drift", "hum"], levels=9).add("drift")


class TestUpload:
    @pytest.mark.parametrize(
        "name", ["../../etc/passwd", "..\\..\\boot.ini", "a\0b.csv", "", "x" * 400, "-rf.csv"]
    )
    def test_no_name_leaves_the_folder(self, name, tmp_path):
        path = tmp_path / harmless_name(name)
        assert path.resolve().parent == tmp_path.resolve()
        path.write_bytes(b"x")
        assert [found.name for found in tmp_path.iterdir()] == [path.name]

    def test_a_file_is_read_and_its_columns_are_guessed(self):
        upload = Upload.of("My stage.csv", csv())
        assert upload.guess == {"time": "t_s", "input": "u_V", "output": "z_um"}
        assert not upload.question
        assert upload.unit("z_um") == "um"
        names, rows = upload.first_rows()
        assert names == ["t_s", "u_V", "z_um"]
        assert float(rows[3][0]) == pytest.approx(0.06)
        (record,) = upload.records({"time": "t_s", "input": "u_V", "output": "z_um"})
        assert record.name == "My stage.csv"
        assert len(record) == 200
        upload = Upload.of("scope.csv", csv(header="TIME,CH1,CH2"))
        assert upload.guess == {"time": "TIME", "input": "CH1", "output": "CH2"}
        upload = Upload.of("scope.csv", csv(header="TIME,CH1,probe"))
        assert upload.guess == {"time": "TIME", "input": None, "output": None}
        assert "choose" in upload.question
        choice: ReadOptions = {"time": None, "input": "CH1", "output": "probe", "rate": 100.0}
        assert upload.records(choice)[0].step_s == pytest.approx(0.01)

    def test_messages_name_the_file_and_not_where_it_is_kept(self):
        with pytest.raises(pj.InputError, match=r"broken one\.csv, row 3") as caught:
            Upload.of("broken one.csv", b"t,u,z\n0,1,2\n1,2\n")
        assert "preisach-app-" not in str(caught.value)
        upload = Upload.of("text.csv", csv() + b"4.1,oops,3\n")
        with pytest.raises(pj.InputError, match=r"text\.csv, column u_V, row 202") as caught:
            upload.records({"time": "t_s", "input": "u_V", "output": "z_um"})
        assert "preisach-app-" not in str(caught.value)

    def test_tables_are_several_records_or_the_one_that_is_chosen(self, tmp_path, monkeypatch):
        name, content = "tester.csv", csv() + b"\nTable 2\n" + csv(150)
        upload, taken = Upload.of(name, content), []
        choosing = ColumnChoice(upload, taken.append)
        choice = choosing.first()
        assert choice is not None
        both = Content.of(upload, choice)
        assert [len(run) for run in (both.record.stretches, upload.tables)] == [2, 2]
        assert (both.first.name, len(both.record)) == ("tester.csv, table 1", 350)
        walk = Walk(pj.explore(both.record, levels=5), (Click("fit", 5),))
        choosing._table.value = 2
        assert len(Content.of(upload, taken[-1]).record) == 150
        again: Any = ColumnChoice(upload, taken.append, unpacked("x", packed(
            name, content, taken[-1], (), None
        )).choice)  # fmt: skip
        assert again.first()["table"] == 2
        (tmp_path / name).write_bytes(content)
        monkeypatch.chdir(tmp_path)
        (tmp_path / "repeat.py").write_text(script(name, both.choice, walk.way, walk.step))
        monkeypatch.setattr("sys.argv", ["repeat.py"])
        done = runpy.run_path("repeat.py")
        assert done["step"].fit.rms_validation == walk.step.fit.rms_validation

    def test_the_page_reads_what_the_command_line_reads(self, tmp_path):
        """A rate in place of the time joins what the time had cut, and two clocks are one."""
        head, _, rows = csv().decode().partition("\n")
        by_time: Any = {"time": "t_s", "input": "u_V", "output": "z_um"}
        by_rate: Any = {**by_time, "time": None, "rate": 50.0}
        t, u = np.arange(400) / 100, np.sin(np.arange(400) / 9)
        clocks = np.column_stack([t, u, t + 0.004, u**3]).tolist()
        two = "t1_s,u_V,t2_s,z_um\n" + "".join(",".join(map(repr, row)) + "\n" for row in clocks)
        path, runs = tmp_path / "runs.csv", f"{head}\n{rows}{rows}"
        for text, given, count in ((runs, by_time, 2), (runs, by_rate, 1), (two, None, 1)):
            path.write_text(text)
            upload = Upload.of("runs.csv", text.encode())
            choice: Any = given or ColumnChoice(upload, lambda chosen: None).first()
            assert choice is not None
            digests = [record.sha256 for record in upload.records(choice)]
            assert digests == [record.sha256 for record in Record.load_all(path, **choice)]
            assert len(digests) == count
        assert digests == [Record.load(path).sha256]

    def test_where_the_columns_are_a_question_each_pair_is_a_loop_to_press(self):
        t = np.arange(400) / 100
        u, z = np.sin(5 * t), np.cos(5 * t)
        rows = np.column_stack([t, u, z, u + 2 * z**3])
        content = "".join(",".join(f"{v:.5f}" for v in row) + "\n" for row in rows).encode()
        upload, taken = Upload.of("plain.csv", content), []
        choosing: Any = ColumnChoice(upload, taken.append)
        pairs = choosing._pictures.objects
        assert choosing.first() is None
        assert [pair.label for pair in pairs] == ["2 → 3", "2 → 4", "3 → 4"]
        x, y = np.array(
            [p.split(",") for p in re.findall(r"[\d.]+,[\d.]+", pairs[0].icon.split("points")[1])],
            float,
        ).T  # a circle, on its head in the picture
        assert np.ptp(np.hypot(x - 36, y - 36)) < 1
        pairs[2].clicks += 1
        assert [taken[-1][role] for role in ("time", "input", "output")] == ["1", "3", "4"]
        assert not choosing._pictures.visible
        refused = ColumnChoice(Upload.of("t.csv", b"t_s,u_V\n0,1\n1,2\n2,1\n"), taken.append)
        assert not refused._pictures.objects
        assert "one signal only" in refused._told.object

    def test_what_is_saved_is_what_was_read(self, tmp_path):
        """Not a broken file of the same name, nor what has become of a file since."""
        path = tmp_path / "stage.csv"
        path.write_bytes(csv())
        page = Page()
        page._fit = lambda: None  # what is saved is of matter here
        page.open_file(path)
        while page._look is None:
            time.sleep(0.02)
        path.write_bytes(b"another one now")
        for name in ("stage.csv", "stage?.csv"):
            page._on_drop(name, b"t,u,z\n0,1,2\n1,2\n")  # broken
            wait_for(page)
        assert page._upload is not None
        assert page._choice is not None
        [kept] = saved(page._upload, page._choice, None).values()
        assert unpacked("x.preisach", kept).content == csv()
        page.close()


class TestTexts:
    def test_nothing_from_a_file_is_taken_for_html(self, step):
        texts = [
            table([EVIL], [[EVIL]], EVIL), str(failure(pj.InputError(EVIL))),
            str(failure(OSError(EVIL))), str(told(step.record, [EVIL])), ladder(step, None),
        ]  # fmt: skip
        assert all("<img" not in text for text in texts)
        assert all("&lt;img" in text for text in texts[:4])


class TestForm:
    def test_it_is_offered_where_something_remains_and_shown_once(self, step, monkeypatch):
        monkeypatch.setattr(steps, "find_form", partial(pj.find_form, draws=3))
        walk = Walk(step.before, (Click("fit", 9),))
        step.before.budget()
        step.before.candidates()
        assert walk.asks_for_form
        after = walk.with_form(lambda text, share: None)
        assert not after.asks_for_form
        assert after.diagnosis is not None
        form = after.diagnosis.form
        assert form is not None
        assert form.offered
        assert "t" in {state.symbol for term in form.terms for state in term.states}
        assert "form, not cause" in verdict(after.step, after.diagnosis)
        step.budget()
        step.candidates()
        assert not walk.on(step, Click("add", effect="drift")).asks_for_form


class TestScript:
    def test_it_repeats_the_clicks_and_refuses_another_record(self, tmp_path, monkeypatch, capsys):
        (tmp_path / "stage.csv").write_bytes(csv(700))
        record = pj.Record.load(tmp_path / "stage.csv")
        now = pj.explore(record, levels=5).add("drift")
        clicks = [
            Click("fit", 5), Click("add", effect="hum"), Click("undo"), Click("add", effect="drift")
        ]  # fmt: skip
        text = script("stage.csv", {"time": "t_s", "input": "u_V", "output": "z_um"}, clicks, now)
        assert "hum" not in text
        (tmp_path / "repeat.py").write_text(text, encoding="utf-8")
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.argv", ["repeat.py"])
        runpy.run_path("repeat.py", run_name="__main__")
        errors = [float(line.split()[-2]) for line in capsys.readouterr().out.splitlines()]
        assert errors == [rung.rms_validation for rung in now.ladder]
        assert pj.Model.load("model.json").rms_validation == now.fit.model.rms_validation
        again = repeated(record, clicks, lambda text, done: None)
        assert again.step.fit.rms_validation == now.fit.rms_validation
        (tmp_path / "other.csv").write_bytes(csv(300))
        monkeypatch.setattr("sys.argv", ["repeat.py", "other.csv"])
        with pytest.raises(SystemExit, match="not the record"):
            runpy.run_path("repeat.py", run_name="__main__")

    def test_names_stand_in_it_as_text_only(self, step):
        evil = "z'''\"\n__import__('os').system('true')  #"
        choice: ReadOptions = {
            "time": evil, "input": evil, "output": evil, "aux": (evil,), "units": {"input": evil}
        }  # fmt: skip
        text = script(evil, choice, [Click("fit", 9), Click("add", effect=evil)], step)
        calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
        called = " ".join(ast.unparse(node.func) for node in calls)
        assert not re.search("__import__|eval|exec|system", called)


class TestJobs:
    def started(self, work):
        events, done = [], threading.Event()

        def ended(*event):
            events.append(event)
            done.set()

        job = Job(
            work, hand_over=lambda report: report(), on_done=partial(ended, "done"),
            on_error=partial(ended, "error"), on_progress=lambda *event: events.append(event),
        )  # fmt: skip
        job.start()
        return job, events, done

    def test_a_result_its_progress_and_an_error_arrive(self):
        _, events, done = self.started(lambda progress: progress("half", 0.5) or 42)
        assert done.wait(60)
        assert events == [("half", 0.5), ("done", 42)]
        _, events, done = self.started(lambda progress: 1 / 0)
        assert done.wait(60)
        assert [(kind, type(error)) for kind, error in events] == [("error", ZeroDivisionError)]

    def test_a_cancelled_job_ends_at_its_next_word_and_says_nothing(self):
        begun, ended = threading.Event(), threading.Event()

        def work(progress):
            begun.set()
            try:
                for _ in range(1000):
                    time.sleep(0.01)
                    progress("on", 0.1)
            finally:
                ended.set()

        job, events, done = self.started(work)
        assert begun.wait(60)
        job.cancel()
        assert ended.wait(60)
        time.sleep(0.05)
        assert not done.is_set()
        assert all(kind == "on" for kind, _ in events)


class TestViews:
    def test_every_view_shows_the_numbers_of_the_step(self, step):
        views = Views(step)
        data = views.source.data
        record = step.record
        np.testing.assert_allclose(data["model"], step.fit.prediction)
        np.testing.assert_allclose(data["residual"], 1e3 * step.fit.residual, rtol=1e-12)
        np.testing.assert_allclose(data["plain"], 1e3 * step.before.fit.residual, rtol=1e-12)
        np.testing.assert_array_equal(data["input"], record.input)
        model = step.fit.model
        [prefix] = re.findall(r"density \((\S)m/V²\)", views.plane.figure.title.text)
        per_shown = {"p": 1e-6, "n": 1e-3, "µ": 1.0}[prefix]
        mass = per_shown * np.nansum(views.plane.density.data["value"]) * model.plane.delta_x**2
        visited = np.asarray(model.visited, dtype=bool)
        assert mass == pytest.approx(np.asarray(model.weights)[visited].sum())


def test_the_export_holds_all_and_agrees(step):
    choice: ReadOptions = {"time": "t", "input": "u", "output": "z"}
    files = exports(step, None, "x.csv", choice, [Click("fit", 9)], lambda text, done: None)
    assert set(files) == {
        "report.html", "model.json", "diagnosis.json", "figures.zip", "repeat.py"
    }  # fmt: skip
    assert EVIL.encode() not in files["report.html"]
    with zipfile.ZipFile(BytesIO(files["figures.zip"])) as archive:
        assert "waterfall.png" in archive.namelist()
        assert archive.read("waterfall.png").startswith(b"\x89PNG")


def test_a_step_by_hand_is_concluded_honestly(step):
    found = step.conclude()
    assert found.verdict == "explained"
    assert found.effects == ("drift",)
    assert any("by hand" in note for note in found.notes)
    assert found.findings[0].rms_after == step.fit.rms_validation
    assert step.before.conclude().verdict == "unexplained"


def wait_for(page, seconds=120):
    deadline = time.monotonic() + seconds
    while page._job is not None and time.monotonic() < deadline:
        time.sleep(0.05)
    assert page._job is None


CHOICE: ReadOptions = {
    "time": "t_s", "input": "u_V", "output": "z_um", "aux": (), "rate": None,
    "units": {"input": "V"}, "table": None,
}  # fmt: skip


class TestProject:
    clicks = (Click("fit", 9), Click("add", effect="drift"))

    def test_it_comes_back_as_it_was_saved(self, step):
        content = packed("../My stage.csv", csv(), CHOICE, self.clicks, step)
        project = unpacked("x.preisach", content)
        assert (project.name, project.content) == ("My stage.csv", csv())  # leaves no folder
        assert (project.choice, project.clicks) == (CHOICE, self.clicks)
        assert list(project.errors) == [each.fit.rms_validation for each in step.steps]
        with zipfile.ZipFile(BytesIO(content)) as archive:
            models = sorted(name for name in archive.namelist() if name.startswith("models/"))
            assert len(models) == 2
            model = pj.Model.from_json(json.loads(archive.read(models[1])))
        assert model.rms_validation == step.fit.model.rms_validation

    @pytest.mark.parametrize(
        ("change", "expected"),
        [
            ({"format": 99}, "99"),
            ({"clicks": [{"what": "exec", "levels": None, "effect": ""}]}, "what is 'exec'"),
            ({"clicks": [{"what": "fit", "levels": "9", "effect": ""}]}, "levels is '9'"),
            ({"errors": ["1.5"]}, "errors"),
            ({"choice": {**CHOICE, "rate": "100"}}, "choice.rate is '100'"),
            ({"choice": {**CHOICE, "units": {"input": 1}}}, "choice.units"),
            ({"record": "record/other.csv"}, "other.csv"),
            ({"choice": None}, "the project file is damaged"),
        ],
    )  # fmt: skip
    def test_a_wrong_one_is_refused_by_one_line(self, step, change, expected):
        content = packed("stage.csv", csv(), CHOICE, self.clicks, step)
        changed = BytesIO()
        with zipfile.ZipFile(BytesIO(content)) as old, zipfile.ZipFile(changed, "w") as new:
            for name in old.namelist():
                told = old.read(name)
                if name == "project.json":
                    told = json.dumps({**json.loads(told), **change}).encode()
                new.writestr(name, told)
        with pytest.raises(pj.InputError) as caught:
            unpacked("x.preisach", changed.getvalue())
        said = str(caught.value)
        assert said.startswith("x.preisach: ")
        assert expected in said
        assert "\n" not in said

    def test_one_that_lies_about_its_size_is_refused_before_it_is_unpacked(self, step, monkeypatch):
        content = packed("stage.csv", csv(), CHOICE, self.clicks, step)
        size = len(csv()).to_bytes(4, "little")
        for other in (1, 2**31 - 1):
            changed = content.replace(size, other.to_bytes(4, "little"))
            assert changed != content
            with pytest.raises(pj.InputError, match="the project file is damaged"):
                unpacked("x.preisach", changed)
        monkeypatch.setattr("preisach_jax.app.steps.MOST_BYTES", len(csv()) - 1)
        with pytest.raises(pj.InputError, match="command line"):
            unpacked("x.preisach", content)
        with pytest.raises(pj.InputError, match="the project file is damaged"):
            unpacked("x.preisach", b"PK not a ZIP")


class TestDropper:
    def test_pieces_become_files_and_what_came_before_is_let_go(self):
        taken, refused = [], []
        box = Dropper(lambda name, content: taken.append((name, content)), refused.append, 9, "")

        def send(name, number, data, size):
            box._handle_msg({"name": name, "number": number, "data": data, "size": size})

        send("a.csv", 1, b"12345", 9)
        send("b.csv", 2, b"6789", 8)  # dropped while the first one was on its way
        send("b.csv", 2, b"0123", 8)
        send("b.csv", 3, b"again", 5)
        send("empty.csv", 4, b"", 0)
        assert taken == [("b.csv", b"67890123"), ("b.csv", b"again"), ("empty.csv", b"")]
        send("great.csv", 5, b"", 10_000_000)
        assert len(taken) == 3
        [error] = refused
        assert "great.csv has 10 MB" in str(error)
        assert "preisach diagnose" in str(error)


def test_tabs_that_are_opened_at_once_share_no_model():
    tabs = [Document() for _ in range(4)]
    faults = []

    def open_tab(tab):
        try:
            with patch_curdoc(tab), set_curdoc(tab):
                page = Page()
                tab.add_root(page.view.get_root(tab))
                for text in ("a", "b"):
                    page._layout.cards.objects = [*page._layout.cards.objects, panels.pane(text)]
        except Exception as error:
            faults.append(error)

    threads = [threading.Thread(target=open_tab, args=(tab,)) for tab in tabs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert not faults
    models = [model for tab in tabs for model in tab.models]
    assert len(models) == len(set(models))
    assert all(model.document in tabs for model in models)
