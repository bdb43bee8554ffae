"""Answers of the server without the page: states before a picture, ranges, colours, lenses, messages of the terminal."""

import numpy as np
import pytest
from images import grey_values, picture, write_exr
from jobs import COLOUR_SENSOR, station
from page import wait_for
from program import Refused, attempt, run


def test_a_request_before_the_first_picture_is_early(view, tmp_path):
    running = view(job="scene = 'missing.glb'\n")
    running.wait(lambda state: state["error"], "the error")
    for path, body in [
        ("frame", {"frame": 0, "tone": "gamma"}),
        ("probe", {"frame": 0, "x": 0, "y": 0}),
        ("regions", {"frame": 0, "regions": [[0, 0, 1, 1]]}),
        ("save", {"what": ["png"], "name": "early", "frame": 0}),
    ]:
        with pytest.raises(Refused) as caught:
            running.post(path, {**body, "camera": running.camera()})
        assert caught.value.status == 409, path
    assert "missing.glb" in wait_for(lambda: "error: " in running.text() and running.text(), "the message")
    assert "help: " in running.text()


def test_knobs_have_the_ranges_of_a_job(view):
    running = view(job=station(width=32, height=24))
    running.wait_for_film(1)
    ranges = running.state()["ranges"]
    for knob, values in [
        ("temperature", ranges["temperature"]),
        ("gain", ranges["gain"]),
        ("exposure", ranges["exposure"]),
    ]:
        for value in values:
            # No camera has the least exposure of a job.
            if (knob, value) != ("exposure", values[0]):
                running.frame(**{knob: value})
        for value in [values[0] - 1, values[1] + 1]:
            with pytest.raises(Refused, match=f"the {knob}") as caught:
                running.frame(**{knob: value})
            assert caught.value.status == 422
    state = running.state()
    assert state["max_spp"] == 65536
    assert state["sensors"][0]["label"].startswith("as in the job (")


def test_noise_and_denoised_mean_are_prepared(view):
    running = view(job=station(width=64, height=48))
    running.wait_for_film(2)
    running.pause()
    running.wait(lambda state: state["prepared"] >= 2, "an analysis that no page has asked for")
    # They may be those of the film before the pause.
    assert running.frame(noise="matched", exact=False)[0]["matched"] is not None
    for changes in [{"noise": "matched"}, {"denoise": "builtin"}, {"denoise": "auto"}]:
        header, exact = running.frame(device=9, **changes)
        assert header["analysis"] == "exact"
        # The analysis of one device is that of the others.
        again, values = running.frame(device=9, exact=False, **changes)
        assert again["analysis"] == "exact" and np.array_equal(values, exact)
    # Another exposure has another analysis, which replaces the converted one.
    changes = {"noise": "matched", "exposure": 0.002}
    first, converted = running.frame(exact=False, **changes)
    exact = running.frame(**changes)[1]
    if first["analysis"] == "earlier":
        plain = running.frame(noise="plain", exposure=0.002)[1].astype(float)
        assert np.mean((converted - exact.astype(float)) ** 2) < 0.5 * np.mean((plain - exact) ** 2)
    header, values = running.frame(exact=False, **changes)
    assert header["analysis"] == "exact" and np.array_equal(values, exact)


def test_the_picture_of_a_pause_is_the_film_that_is_saved(view, tmp_path):
    running = view(job=station(width=64, height=48))
    for step in range(4):
        running.wait_for_film(step + 0.5)
        state = running.pause()
        name = f"paused-{step}"
        what = {"what": ["film", "exr"], "name": name, "camera": running.camera(), "frame": 0}
        running.post("save", what)
        stored = view(tmp_path / f"{name}.film")
        assert stored.state()["film"]["samples"] == state["film"]["samples"]
        place = {"camera": running.camera(), "frame": 0, "x": 20, "y": 30}
        assert stored.post("probe", place)["radiance"] == running.post("probe", place)["radiance"]
        running.post("render", {"action": "resume"})


def test_colours_have_their_own_statistics(view, tmp_path):
    """The pixels of a colour are those of the pattern; their statistics are those of numpy."""
    (tmp_path / "colour.toml").write_text(COLOUR_SENSOR)
    running = view(job=station(width=64, height=48).replace('"imx250"', '"colour.toml"'))
    running.wait_for_film(2)
    running.pause()
    camera, region = running.camera(), [8, 6, 40, 30]
    found = running.post("regions", {"camera": camera, "frame": 0, "regions": [region], "channel": None})
    whole = found["regions"][0]
    assert whole["pixels"] == 32 * 24
    total = 0.0
    by_channel = {}
    for channel in ["red", "green", "blue"]:
        answer = running.post("regions", {"camera": camera, "frame": 0, "regions": [region], "channel": channel})
        by_channel[channel] = answer["regions"][0]
        total += by_channel[channel]["pixels"] * by_channel[channel]["mean"]
    assert [by_channel[c]["pixels"] for c in ["red", "green", "blue"]] == [192, 384, 192]
    assert total / whole["pixels"] == pytest.approx(whole["mean"], rel=1e-12)
    values = {}
    for y in (10, 11):
        for x in (20, 21):
            probe = running.post("probe", {"camera": camera, "frame": 0, "x": x, "y": y})
            values.setdefault(probe["channel"], []).append(probe["value"])
    assert {channel: len(list_) for channel, list_ in values.items()} == {"red": 1, "green": 2, "blue": 1}
    square = {"camera": camera, "frame": 0, "regions": [[20, 10, 22, 12]]}
    for channel, expected in values.items():
        answer = running.post("regions", {**square, "channel": channel})["regions"][0]
        assert answer["mean"] == pytest.approx(np.mean(expected))


def test_the_lens_of_an_exr(view, tmp_path):
    rng = np.random.default_rng(5)
    colours = {c: (0.2 + rng.random((40, 64))).astype(np.float32) for c in "RGB"}
    colours["R"][3, 4] = np.nan
    write_exr(tmp_path / "other.exr", **colours)
    lens = ["--f-number", "8", "--transmission", "0.8", "--magnification", "0.1"]
    running = view(tmp_path / "other.exr", *lens)
    _, values = running.frame(exposure=0.004, device=11)
    flags = ["--linear", "other.tif", "--exposure", "4ms", "--seed", "11", *lens]
    run("expose", "other.exr", *flags, cwd=tmp_path, expected=1)
    assert np.array_equal(values, grey_values(tmp_path / "other.tif"))
    body = {"camera": running.camera(exposure=0.004, device=11), "frame": 0}
    running.post("save", {**body, "what": ["png", "tiff"], "name": "saved"})
    assert np.array_equal(values, grey_values(tmp_path / "saved.tif"))
    run("expose", "other.exr", "-o", "other.png", *flags[2:], cwd=tmp_path, expected=1)
    assert np.array_equal(picture(tmp_path / "saved.png"), picture(tmp_path / "other.png"))
    for kind in ["exr", "film", "job"]:
        with pytest.raises(Refused, match="no samples"):
            running.post("save", {**body, "what": [kind], "name": "refused"})
    state = running.state()
    assert state["sensors"][0]["label"].startswith("as opened (")
    assert [note["text"] for note in state["notes"] if "1 pixel" in note["text"]]
    assumed = view(tmp_path / "other.exr").state()["notes"]
    assert any("f/4" in note["text"] and "--f-number" in note["help"] for note in assumed)


def test_matched_noise_of_an_exr_with_binned_pixels(view, tmp_path):
    job = station(width=64, height=48).replace("height = 48", "height = 48\nbinning = 2")
    (tmp_path / "binned.toml").write_text(job)
    run("render", "binned.toml", "--spp", "24", "-o", "binned.png", "--exr", "binned.exr", cwd=tmp_path)
    running = view(tmp_path / "binned.exr")
    for exposure in ["0.5ms", "4ms"]:
        changes = {"noise": "matched", "exposure": float(exposure[:-2]) / 1000, "device": 5}
        _, values = running.frame(**changes)
        flags = ["--exposure-noise", "matched", "--exposure", exposure, "--seed", "5", "--linear", "frame.tif"]
        run("expose", "binned.exr", *flags, cwd=tmp_path)
        assert np.array_equal(values, grey_values(tmp_path / "frame.tif")), exposure
        (tmp_path / "frame.tif").unlink()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["folder"], "is a folder"),
        (["part.step"], "STEP"),
        (["picture.png"], "picture.png"),
        (["missing.glb"], "cannot be read"),
        (["job.toml", "--f-number", "8"], "the lens"),
        (["other.exr", "--f-number", "0.1"], "--f-number"),
    ],
)
def test_files_that_are_no_scenes(tmp_path, arguments, words):
    (tmp_path / "folder").mkdir()
    (tmp_path / "part.step").write_text("ISO-10303-21;\n")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n")
    (tmp_path / "job.toml").write_text(station())
    write_exr(tmp_path / "other.exr", **{c: np.ones((4, 4), np.float32) for c in "RGB"})
    found = attempt("view", "--no-open", *arguments, cwd=tmp_path)
    assert found.returncode == 2 and words in found.stderr and "help" in found.stderr, found.stderr


@pytest.mark.parametrize(
    ("job", "word"),
    [
        (
            station(width=32, height=24, sensor='exposure = "5ms"').replace(
                "power = 0.5", 'power = 0.5\nstrobe = "1ms"'
            ),
            "strobe",
        ),
        (
            station(width=32, height=24, sensor='exposure = "5ms"', more="").replace(
                'translate = ["-40mm", "25mm", 0]', 'translate = ["-40mm", "25mm", 0]\nvelocity = ["1m/s", 0, 0]'
            ),
            "move",
        ),
    ],
)
def test_samples_of_an_exposure_are_shown_with_it_alone(view, tmp_path, job, word):
    running = view(job=job)
    running.wait_for_film(1)
    state = running.state()
    assert word in state["timed"] and state["camera"]["exposure"] == 0.005
    running.frame()
    running.frame(sensor="imx174")
    for exposure in [0.002, 0.02, None]:
        with pytest.raises(Refused, match="exposure of 0.005 s") as caught:
            running.frame(exposure=exposure)
        assert caught.value.status == 422
        body = {"what": ["job"], "name": "other", "camera": running.camera(exposure=exposure), "frame": 0}
        with pytest.raises(Refused, match="exposure"):
            running.post("save", body)
    running.post("save", {"what": ["job"], "name": "same", "camera": running.camera(gain=2.0), "frame": 0})
    job = tmp_path / "same.toml"
    run("render", job, "--spp", 1, "-o", tmp_path / "same.png", cwd=tmp_path)


def test_exposures_have_the_range_of_a_job(view):
    running = view(job=station(width=32, height=24, sensor='exposure = "200s"'))
    running.wait_for_film(1)
    assert running.frame()[0]["exposure"] == 200
    assert running.frame(exposure=5e-5)[0]["exposure"] == 5e-5
    with pytest.raises(Refused, match="below the shortest"):
        running.frame(exposure=5e-7)
    assert running.state()["timed"] is None


def test_large_seeds_keep_their_digits(view, open_page):
    seed = 2**53 + 1
    running = view(job=station(width=32, height=24).replace("seed = 3", f"seed = {seed}"))
    running.wait_for_film(1)
    assert running.camera()["device"] == str(seed)
    page = open_page(running)
    page.idle()
    page.click("device-next")
    page.idle()
    assert page.js("return window.dunkelfeld.frame().camera.device") == str(seed + 1)
    page.set("device", "77")
    page.idle()
    assert page.js("return window.dunkelfeld.frame().camera.device") == 77
    # A larger one than that of a job is none.
    page.set("device", str(2**63))
    page.idle()
    assert page.js("return window.dunkelfeld.frame().camera.device") == 77
    # A page that is loaded again keeps the knobs.
    page.driver.refresh()
    page.wait(lambda: page.frame() is not None, "a picture")
    assert page.js("return window.dunkelfeld.frame().camera.device") == 77


def test_changes_that_cannot_be_rendered_are_refused(view):
    running = view(job=station(width=32, height=24))
    running.wait_for_film(1)
    scene = running.state()["scene"]
    effects = [effect["name"] for effect in scene["effects"]]
    assert "textures" in effects and "color" not in effects, effects
    with pytest.raises(Refused, match="color"):
        running.post("scene", {"effects": {"color": False}})
    dark = {light["name"]: {"on": False, "factor": 1} for light in scene["lights"]}
    with pytest.raises(Refused, match="no light is on"):
        running.post("scene", {"per_light": True, "lights": dark})
    assert running.state()["render"]["restarted"] == 0
    # Without films of their own, all lights can be off. The change ends a pause.
    running.pause()
    running.post("scene", {"lights": dark})
    running.wait(
        lambda state: state["render"]["restarted"] == 1 and state["render"]["state"] == "running", "the render"
    )


def test_the_first_frame_is_that_of_the_samples(view, tmp_path, open_page):
    running = view(job=station(width=32, height=24).replace("seed = 3", "seed = 3\nframe = 9"))
    running.wait_for_film(1)
    running.pause()
    page = open_page(running)
    page.idle()
    assert running.state()["frame"] == 9 and page.text("frame-rate") == "frame 9"
    body = {"what": ["tiff", "film", "job"], "name": "x", "camera": running.camera()}
    assert running.post("save", {**body, "frame": 9})["note"] is None
    assert "frame = 9\n" in (tmp_path / "x.toml").read_text()
