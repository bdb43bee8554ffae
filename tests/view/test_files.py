"""Files that the page saves, and files that it must not touch."""

import pytest
from images import assert_equal_means, layers
from jobs import station
from program import Refused, attempt, run


def save(running, name="saved", what=("png",), **changes):
    body = {"what": list(what), "name": name, "camera": running.camera(**changes), "frame": 0}
    return running.post("save", body)["files"]


def test_a_saved_job_makes_the_scene_again(view, tmp_path, open_page):
    running = view(job=station(sensor='exposure = "5ms"'))
    page = open_page(running)
    page.tab("scene")
    running.wait_for_film(1)
    page.set("light-power-0-value", "3")
    page.set("material-roughness-2-value", "0.2")
    running.wait(
        lambda state: state["scene"]["lights"][0]["factor"] == 3 and state["scene"]["materials"][2]["roughness"] == 0.2,
        "the changes",
    )
    running.wait_for_film(24)
    page.set("sensor", "imx174")
    page.set("gain-value", "1.5")
    page.set("exposure-value", "7 ms")
    page.set("noise", "matched")
    page.set("black-level", "96")
    page.set("save-name", "again")
    page.click("save-job")
    page.click("save-exr")
    page.click("save")
    assert page.text("problems") == "" and page.text("save-result") == "Saved 3 files."
    page.wait(lambda: "again.toml" in page.text("saved"), "the list of files")
    run("render", "again.toml", "--spp", "24", "-o", "cli.png", "--exr", "cli.exr", cwd=tmp_path)
    shown, rendered = layers(tmp_path / "again.exr"), layers(tmp_path / "cli.exr")
    assert_equal_means(rendered, shown)
    # The camera of the job is that of the page.
    ratio = rendered["electrons.Y"][rendered["electrons.Y"] > 0] / rendered["G"][rendered["electrons.Y"] > 0]
    wanted = shown["electrons.Y"][shown["electrons.Y"] > 0] / shown["G"][shown["electrons.Y"] > 0]
    assert abs(ratio.mean() / wanted.mean() - 1) < 0.01
    text = (tmp_path / "again.toml").read_text()
    assert "imx174" in text and "gain = 1.5" in text and '"0.007s"' in text and "matched" in text
    assert "black_level = 96" in text
    page.assert_quiet_console()


def test_a_save_of_the_picture_before_a_change_states_it(view, tmp_path):
    # The first picture of so many pixels takes a while after a restart.
    running = view(job=station(width=2400, height=1800))
    running.wait_for_film(1)
    body = {"what": ["job"], "name": "now", "camera": running.camera(), "frame": 0}
    assert running.post("save", body)["note"] is None
    running.post("scene", {"lights": {"left": {"on": False, "factor": 1}}})
    state = running.wait(lambda state: state["render"]["restarted"] == 1, "the restart")
    assert state["film"]["earlier"], "the earlier picture stays"
    note = running.post("save", {**body, "name": "earlier"})["note"]
    assert note == "The picture is that of the scene before its change."
    assert "enabled" not in (tmp_path / "earlier.toml").read_text()
    # A pause that comes before the new picture keeps the earlier one.
    running.post("render", {"action": "restart"})
    running.wait(lambda state: state["render"]["restarted"] == 2, "the next restart")
    assert running.pause()["film"]["earlier"]
    assert running.post("save", {**body, "name": "paused"})["note"] == note
    running.post("render", {"action": "resume"})
    running.wait_for_film(1)
    assert running.post("save", {**body, "name": "new"})["note"] is None
    assert "enabled = false" in (tmp_path / "new.toml").read_text()


@pytest.mark.parametrize("device", [3, 9])
def test_a_saved_exr_has_the_plan_of_its_film(view, tmp_path, device):
    """A replay of the plan in the EXR has the bits of the film: the seed of the device is no seed of the render."""
    running = view(job=station())
    running.wait_for_film(5)
    running.pause()
    save(running, what=["exr"], exposure=5e-3, device=device)
    run("render", "station.toml", "--replay", "saved.exr", "-o", "replay.png", "--exr", "replay.exr", cwd=tmp_path)
    shown, replayed = layers(tmp_path / "saved.exr"), layers(tmp_path / "replay.exr")
    for channel in ["R", "G", "B", "spp.Y", "depth.Z", "id.object"]:
        assert (shown[channel] == replayed[channel]).all(), channel


def test_no_file_is_replaced(view, tmp_path, open_page):
    running = view()
    page = open_page(running)
    page.set("save-name", "one")
    page.click("save")
    first = (tmp_path / "one.png").read_bytes()
    page.click("next-frame")
    page.click("save")
    assert "one.png exists" in page.text("problems") and page.text("save-result") == "Nothing was saved."
    assert (tmp_path / "one.png").read_bytes() == first
    # Of several files none is written if one exists. The job of the view is a file too.
    for name, what in [("one", ["tiff", "png"]), ("station", ["tiff", "job"]), ("twice", ["png", "png"])]:
        with pytest.raises(Refused) as refusal:
            save(running, name, what)
        assert refusal.value.status == 422 and "exists" in refusal.value.fault["problem"]
        assert not (tmp_path / f"{name}.tif").exists()
    # A link that leads nowhere is a file: its target is not made.
    (tmp_path / "link.png").symlink_to(tmp_path / "target.png")
    with pytest.raises(Refused):
        save(running, "link")
    assert not (tmp_path / "target.png").exists()
    page.assert_quiet_console(refusals=True)


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../out", "a/b", "/out", "a\\b", ".hidden", "a\0b", "a\nb", "C:out", "x" * 101, "a*"]
)
def test_names_stay_in_the_folder(view, tmp_path, name):
    folder = tmp_path / "inner"
    folder.mkdir()
    (folder / "station.toml").write_text(station(width=16, height=16))
    running = view(folder / "station.toml", "--output", str(folder))
    running.wait_for_film(1)
    with pytest.raises(Refused) as refusal:
        save(running, name, ["png", "job"])
    assert refusal.value.status == 422
    assert {file.name for file in tmp_path.rglob("*")} == {"inner", "station.toml", "messages.txt"}


def test_folder_of_the_outputs(view, tmp_path):
    # A folder that does not exist is a fault of the command, before the page is opened.
    (tmp_path / "station.toml").write_text(station())
    run("view", "--no-open", "station.toml", "--output", "missing", cwd=tmp_path, expected=2)
    run("view", "--no-open", "station.toml", "--output", "station.toml", cwd=tmp_path, expected=2)
    (tmp_path / "out").mkdir()
    running = view(tmp_path / "station.toml", "--output", "out")
    running.wait_for_film(1)
    assert save(running, "a", ["png", "film"]) == ["out/a.png", "out/a.film"]
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"a.png", "a.film"}


def test_a_view_that_does_not_fit_into_memory(view, tmp_path):
    """The account of a view contains its copies of the film, which that of a render does not have."""
    job = station(width=1024, height=1024, more='[budget]\nmemory = "600MB"\n')
    running = view(job=job)
    error = running.wait(lambda state: state["error"] or state["film"], "the account")["error"]
    assert error and "600 MB" in error["problem"] and "kept films" in error["problem"], error
    # The command itself fits.
    run("render", "station.toml", "--spp", "0.01", "-o", "small.png", cwd=tmp_path)


def test_outputs_of_a_job_are_not_written(view, tmp_path):
    running = view(job=station(more='[output]\nimage = "picture.png"\nexr = "layers.exr"\nstats = "stats.json"\n'))
    state = running.wait(lambda state: state["film"] and state["film"]["seconds"] > 1.5, "a longer render")
    assert state["error"] is None
    running.interrupt()
    assert {file.name for file in tmp_path.iterdir()} == {"station.toml", "messages.txt"}


@pytest.mark.parametrize(("source", "word"), [
    ("missing.toml", "missing.toml"), ("missing.film", "missing.film"), ("broken.film", "broken.film"),
    ("broken.exr", "broken.exr"), ("station.toml", "listen"),
])  # fmt: skip
def test_faults_of_the_command(tmp_path, view, source, word):
    for name in ["broken.film", "broken.exr"]:
        (tmp_path / name).write_bytes(b"no such data" * 40)
    (tmp_path / "station.toml").write_text(station(width=16, height=16))
    flags = []
    if word == "listen":
        flags = ["--port", str(view(tmp_path / "station.toml").port)]
    found = attempt("view", "--no-open", source, *flags, cwd=tmp_path)
    assert found.returncode == 2 and word in found.stderr and "help:" in found.stderr, found.stderr
    assert found.stdout == "" and "panicked" not in found.stderr


def test_jobs_of_line_scans_and_parts_of_the_film(view, tmp_path, open_page):
    more = '[line_scan]\nline_rate = "10kHz"\n'
    job = station(sensor='exposure = "80us"', more=more)
    job = job.replace("height = 72\n", "height = 72\nroi = [16, 8, 64, 40]\n")
    running = view(job=job)
    page = open_page(running)
    state = running.wait_for_film(2)
    assert state["error"] is None and (state["width"], state["height"]) == (64, 40)
    assert page.frame()["header"]["width"] == 64 and page.text("problems") == ""
    save(running, "line", ["png", "job", "film"])
    run("render", "line.toml", "--spp", "1", "-o", "line-cli.png", cwd=tmp_path)
    page.assert_quiet_console()
