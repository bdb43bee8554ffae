"""The knobs of the scene, the control of the render, and changes of the job."""

import json

import numpy as np
import pytest
from images import assert_equal_means, layers, mean_and_variance
from jobs import station
from page import Page, wait_for
from program import ROOT, Refused

# Light of the left lamp only, at a fixed exposure, so that electrons are proportional to the light.
FIXED = station(sensor='exposure = "5ms"')


def save_layers(running, name, spp=16):
    """The layers of the film at this moment, which then has at least so many samples per pixel."""
    running.wait_for_film(spp)
    saved = running.post("save", {"what": ["exr"], "name": name, "camera": running.camera(), "frame": 0})
    return layers(running.folder / saved["files"][0])


def index_of(running, kind, name):
    """The place of a light, a material or an effect in the lists of the page."""
    return [part["name"] for part in running.state()["scene"][kind]].index(name)


def restart_by(running, page, change):
    """Makes a change on the page, and waits for the first picture of the new scene.

    The picture before stays until then: at no time there is none, or one with pixels without samples.
    """
    before = running.wait_for_film(1)
    change()

    def is_new():
        state = page.state()
        assert state["error"] is None, state["error"]
        assert page.film() is not None and not state["film"]["first"]
        return state["render"]["restarted"] > before["render"]["restarted"] and page.film() > before["film"]["id"]

    wait_for(is_new, "the picture of the changed scene")
    page.idle()


def test_lights(view, open_page):
    running = view(job=FIXED)
    page = open_page(running)
    page.tab("scene")
    both = save_layers(running, "both")
    left, right = (index_of(running, "lights", name) for name in ["left", "right"])
    restart_by(running, page, lambda: page.click(f"light-on-{right}"))
    one = save_layers(running, "left")
    assert mean_and_variance(one)[0] < mean_and_variance(both)[0]
    # The halves of the plate beyond ball and lid: the one at the side of the lamp is brighter.
    assert one["G"][:, :10].mean() > one["G"][:, -10:].mean()
    restart_by(running, page, lambda: page.set(f"light-power-{left}-value", "2"))
    double = save_layers(running, "double")
    assert_equal_means(double, one, factor=2)
    # Light adds: both lamps are the left one and the right one.
    restart_by(running, page, lambda: page.click(f"light-on-{right}"))
    restart_by(running, page, lambda: page.click(f"light-on-{left}"))
    other = save_layers(running, "right")
    # Without the body of a lamp that is off, less than a hundredth of the light comes another way.
    total = mean_and_variance(one)[0] + mean_and_variance(other)[0]
    noise = sum(mean_and_variance(exr)[1] for exr in (one, other, both)) ** 0.5
    assert abs(mean_and_variance(both)[0] - total) < 6.1 * noise + 0.01 * total
    page.wait(lambda: page.text("scene-restarts") == "Started again 4 times.", "the number of restarts")
    page.assert_quiet_console()


def test_materials(view, open_page):
    running = view(job=FIXED)
    page = open_page(running)
    page.tab("scene")
    before = save_layers(running, "before")
    plate = index_of(running, "materials", "plate")
    state = running.state()["scene"]["materials"][plate]
    assert (state["roughness"], state["metallic"], state["color"]) == (0.8, 0, [0.4, 0.4, 0.4])
    assert page.value(f"material-roughness-{plate}-value") == "0.8"
    # Lamps have knobs among the lights only.
    assert [material["name"] for material in running.state()["scene"]["materials"]] == ["plate", "ball", "lid"]
    page.js("document.querySelectorAll('#materials details').forEach(d => d.open = true)")
    restart_by(running, page, lambda: page.set(f"material-colour-{plate}", "#000000", "input"))
    dark = save_layers(running, "dark")
    lid = before["G"][30:42, 60:75].mean()
    assert dark["G"][:, :10].mean() < 0.3 * before["G"][:, :10].mean()
    assert dark["G"][30:42, 60:75].mean() > 0.8 * lid, "the lid has its own material"
    restart_by(running, page, lambda: page.set(f"material-metallic-{plate}-value", "1"))
    state = running.state()["scene"]["materials"][plate]
    assert (state["roughness"], state["metallic"], state["color"]) == (0.8, 1, [0, 0, 0])
    page.assert_quiet_console()


def test_cameras_and_effects(view, open_page):
    job = (
        FIXED.replace("[camera]", '[[camera]]\nname = "above"', 1)
        + """
[[camera]]
name = "beside"
position = ["400mm", "100mm", 0]
look_at = [0, 0, 0]
vertical_fov = "30deg"
"""
    )
    running = view(job=job)
    page = open_page(running)
    page.tab("scene")
    assert running.state()["scene"]["camera"] == "above"
    above = save_layers(running, "above")
    restart_by(running, page, lambda: page.set("scene-camera", "beside"))
    beside = save_layers(running, "beside")
    # The plate fills the view from above. From the side, the upper rows see beyond it.
    assert np.isfinite(above["depth.Z"]).all() and (above["depth.Z"] > 0).all()
    assert beside["depth.Z"].max() > above["depth.Z"].max()
    assert running.state()["scene"]["camera"] == "beside"
    effect = index_of(running, "effects", "smooth-normals")
    assert page.checked(f"effect-{effect}")
    restart_by(running, page, lambda: page.click(f"effect-{effect}"))
    assert running.state()["scene"]["effects"][effect] == {
        "name": "smooth-normals", "title": "smooth normals", "used": True, "left_out": True,
    }  # fmt: skip
    flat = save_layers(running, "flat")
    # The normals of the ball are those of its triangles, so fewer directions remain.
    of_ball = (
        beside["id.object"] == np.bincount(beside["id.object"].ravel()[beside["id.object"].ravel() < 100]).argmin()
    )
    assert of_ball.any()
    assert not np.allclose(flat["normal.Y"], beside["normal.Y"], atol=1e-3)
    # The change of the camera is not lost by that of the effect.
    assert running.state()["scene"]["camera"] == "beside"
    restart_by(running, page, lambda: page.click(f"effect-{effect}"))
    assert running.state()["scene"]["effects"][effect]["left_out"] is False
    page.assert_quiet_console()


def test_two_changes_at_once_are_both_made(view):
    running = view(job=FIXED)
    running.wait_for_film(1)
    for _ in range(5):
        running.post("scene", {"lights": {"left": {"on": False, "factor": 1}}})
        running.post("scene", {"materials": {"lid": {"roughness": 0.9}}})
        running.post("scene", {"lights": {"left": {"on": True, "factor": 3}}})
        state = running.wait(lambda state: state["scene"]["lights"][0]["factor"] == 3, "the last change")
        assert state["scene"]["lights"][0]["on"] is True
        assert next(m for m in state["scene"]["materials"] if m["name"] == "lid")["roughness"] == 0.9
        running.post("scene", {"lights": {"left": None}, "materials": {"lid": None}})
        running.wait(lambda state: state["scene"]["lights"][0]["factor"] == 1, "the scene of the job")
    assert running.state()["error"] is None


def test_pause_and_target(view, open_page):
    running = view(job=FIXED)
    page = open_page(running)
    running.wait_for_film(2)
    page.click("pause")
    paused = running.wait(lambda state: state["render"]["state"] == "paused", "the pause")
    # The knobs of the camera work during the pause, and a path is traced.
    page.wait(lambda: page.film() == paused["film"]["id"], "the picture of the last film")
    page.set("gain-value", "2")
    assert page.text("problems") == ""
    assert running.post("path", {"x": 30, "y": 36, "index": 0, "camera": running.camera()})["vertices"]
    again = running.state()
    assert again["film"] == paused["film"] and again["render"]["elapsed"] == paused["render"]["elapsed"]
    page.wait(lambda: page.state()["render"]["state"] == "paused", "the pause on the page")
    page.click("pause")
    running.wait(lambda state: state["film"]["samples"] > paused["film"]["samples"], "samples after the pause")
    # A change ends a pause: the picture would be that of the scene before it.
    running.pause()
    running.post("scene", {"lights": {"left": {"on": False, "factor": 1}}})
    running.wait(lambda state: state["render"]["restarted"] == 1, "the change")
    running.wait_for_film(4)


def test_verdict(view, open_page):
    running = view(job=station(width=64, height=48, sensor='exposure = "5ms"'))
    page = open_page(running)
    page.tab("noise")
    running.wait_for_film(16)
    # In the dark the noise of the camera hides any noise of the render.
    page.set("exposure-value", "20 us")
    page.wait(lambda: page.attribute("verdict", "data-level") == "measure", "a hidden noise")
    certificate = running.state()["certificate"]
    assert certificate["k"] == 0.5 and certificate["hidden"] >= 0.99 and certificate["p99"] <= 0.5
    # Ratios of one film: the share of the pixels below a level, and its quantiles.
    page.set("exposure-value", "2 ms")
    paused = running.pause()
    camera = running.camera(exposure=2e-3)
    header, ratios = running.picture("map", {"camera": camera, "map": "ratio"})

    def is_certified(state):
        """The certificate of the last film, with the camera of the page: its median is the one of the ratios."""
        certificate = state["certificate"] or {"film": None}
        is_last = certificate["film"] == paused["film"]["id"]
        return is_last and certificate["median"] == pytest.approx(np.nanmedian(ratios), rel=0.01)

    certificate = running.wait(is_certified, "the certificate of the last film")["certificate"]
    assert header["film"] == certificate["film"]
    # The certificate leaves saturated pixels out.
    assert np.nanquantile(ratios, 0.98) <= certificate["p99"] <= np.nanquantile(ratios, 0.995)
    level = float(np.clip(np.nanquantile(ratios, 0.3), 0.05, 4))
    running.post("target", {"k": level})
    assert running.state()["certificate"]["hidden"] == pytest.approx(np.mean(ratios <= level), abs=0.01)
    running.post("render", {"action": "resume"})
    # In bright light the noise of the camera hides less.
    page.set("target", "0.05")
    page.set("exposure-value", "5 ms")
    page.wait(lambda: page.attribute("verdict", "data-level") == "no", "a noise that is not hidden")
    assert running.state()["target"] == 0.05
    # The curve and its values are those of the server.
    running.wait(lambda state: len(state["curve"]) >= 3, "a curve")
    page.wait(lambda: page.js("return document.querySelectorAll('#curve .measured').length") == 1, "the curve")
    page.assert_quiet_console()


def test_forecast_of_another_camera(view):
    """The expected samples of a camera that is not that of the job are those at which it reaches the level."""
    running = view(job=station(width=48, height=36, sensor='exposure = "5ms"'))
    state = running.wait(lambda state: state["forecast"] and state["forecast_from"] == "plan", "the plan")
    assert state["forecast"][-1]["k"] == 0.25
    # A shot of the page makes its camera the one that is shown. In less light the camera hides more.
    running.frame(exposure=1e-3)
    state = running.wait(lambda state: state["forecast_from"] == "points" and state["forecast"], "another forecast")
    level = state["forecast"][0]
    assert level["spp"] > state["film"]["spp"] or level["k"] < state["curve"][-1]["k99"]
    running.pause()
    running.post("render", {"action": "resume"})
    running.wait(lambda state: state["render"]["state"] == "running", "the render after the pause")

    def reached(state):
        return state["curve"] and state["curve"][-1]["k99"] is not None and state["curve"][-1]["k99"] <= level["k"]

    state = running.wait(reached, "the level")
    first = next(point for point in state["curve"] if point["k99"] is not None and point["k99"] <= level["k"])
    # The level is between this point and the one before, which may have half as many samples.
    assert 0.4 < level["spp"] / first["spp"] < 2.5, (level, first)
    assert state["render"]["state"] == "running"


def test_a_changed_job_is_loaded_again(view, tmp_path, open_page):
    running = view(job=FIXED)
    page = open_page(running)
    job = tmp_path / "station.toml"
    before = running.wait_for_film(2)
    # A knob of the user stays, the others follow the job.
    page.set("gain-value", "2")
    assert page.value("exposure-value") == "5 ms"
    job.write_text(station(width=80, sensor='exposure = "8ms"', left=1.5))
    running.wait(lambda state: state["width"] == 80 and state["film"]["id"] > before["film"]["id"], "the new job")
    page.wait(lambda: page.frame()["header"]["width"] == 80, "a picture of the new job")
    assert page.value("exposure-value") == "8 ms" and page.value("gain-value") == "2"
    assert running.state()["scene"]["lights"][0]["power"] == "1.500 W"
    # A new light has its knobs, and lights that are gone have none.
    more = '[[light]]\nname = "third"\nkind = "point"\nposition = [0, "250mm", 0]\npower = 0.1\n'
    job.write_text(station(more=more).replace('name = "right"', 'name = "front"'))
    names = ["left", "front", "third"]
    running.wait(lambda state: [light["name"] for light in state["scene"]["lights"]] == names, "the new lights")
    page.wait(lambda: page.js("return document.querySelectorAll('#lights input[type=checkbox]').length") == 3, "knobs")
    # The knob of the vignetting follows the job.
    assert page.checked("vignetting") is False
    job.write_text(station(more='[lens]\nvignetting = "cos4"\n'))
    page.wait(lambda: page.checked("vignetting"), "the knob of the vignetting")
    page.wait(lambda: page.film() == page.state()["film"]["id"], "a picture with vignetting")
    page.idle()
    assert page.text("problems") == ""
    page.assert_quiet_console(refusals=True)


def test_a_broken_job_states_its_error_until_it_is_mended(view, tmp_path, open_page):
    running = view(job=FIXED)
    page = open_page(running)
    job = tmp_path / "station.toml"
    for broken, word in [('scene = "none', "station.toml"), ('scene = "none"\nwide = 3\n', "wide"), ("", "scene")]:
        film = running.wait_for_film(1)["film"]["id"]
        job.write_text(broken)
        page.wait(lambda word=word: word in page.text("problems"), "the error")
        assert page.frame() is not None, "the picture before the fault stays"
        job.write_text(FIXED)
        page.wait(lambda film=film: page.text("problems") == "" and page.film() > film, "the mended job")
    page.assert_quiet_console()


def test_a_job_that_is_broken_from_the_start(view, tmp_path, driver):
    running = view(job='scene = "none"\n[film]\nwidth = "wide"\n')
    page = Page(driver, running.url)
    page.wait(lambda: "width" in page.text("problems"), "the error")
    assert page.frame() is None
    (tmp_path / "station.toml").write_text(FIXED)
    page.wait(lambda: page.frame() is not None and page.text("problems") == "", "the mended job")
    # The knobs are those of the job, not those of the time without one.
    assert page.value("sensor") == "as in the job" and page.value("exposure-value") == "5 ms"
    assert page.value("device") == "3"
    page.assert_quiet_console()


def test_a_scene_file_that_is_broken_from_the_start(view, tmp_path, driver):
    """The fault is in a file that the scene names, not in the job: it is watched too."""
    vertices = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]], "<f4").tobytes()
    gltf = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [0.3, 0.3, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "part.bin", "byteLength": 36}],
    }  # fmt: skip
    (tmp_path / "part.gltf").write_text(json.dumps(gltf))
    (tmp_path / "part.bin").write_bytes(vertices[:18])
    running = view(job=FIXED.replace('scene = "none"', 'scene = "part.gltf"'))
    page = Page(driver, running.url)
    page.wait(lambda: "part.gltf" in page.text("problems"), "the error")
    assert page.frame() is None
    (tmp_path / "part.bin").write_bytes(vertices)
    page.wait(lambda: page.frame() is not None and page.text("problems") == "", "the corrected scene")
    page.assert_quiet_console()


def test_light_from_infinitely_far_away(view, open_page):
    sun = '[[light]]\nname = "sun"\nkind = "sun"\nirradiance = 2\ndirection = [1, 2, 0]\n'
    running = view(job=FIXED + sun + "[environment]\nradiance = 0.5\n")
    page = open_page(running)
    page.tab("scene")
    before = save_layers(running, "before", 4)
    lights = {light["name"]: light["kind"] for light in running.state()["scene"]["lights"]}
    assert {"left", "right", "sun"} < set(lights) and "environment" in lights.values()
    index = index_of(running, "lights", "sun")
    # The view cannot change its power, nor switch off the environment: the page has no such knobs, and the server refuses.
    assert page.disabled(f"light-power-{index}-value") and not page.disabled(f"light-on-{index}")
    assert "no power" in page.attribute(f"light-power-{index}-value", "title")
    listed = enumerate(running.state()["scene"]["lights"])
    index, sky = next((i, light["name"]) for i, light in listed if light["kind"] == "environment")
    assert page.disabled(f"light-on-{index}") and page.disabled(f"light-power-{index}")
    for name, on, factor in [("sun", True, 2), (sky, False, 1), (sky, True, 2)]:
        with pytest.raises(Refused, match="no power|no switch"):
            running.post("scene", {"lights": {name: {"on": on, "factor": factor}}})
    assert running.state()["render"]["restarted"] == 0 and running.state()["error"] is None
    # All lights but the environment are off: its radiance on a white surface is the most that remains.
    for name in ["left", "right", "sun"]:
        index = index_of(running, "lights", name)
        restart_by(running, page, lambda index=index: page.click(f"light-on-{index}"))
        assert page.text("problems") == "", name
    rest = save_layers(running, "rest", 4)
    assert before["G"].mean() > 0.5 and rest["G"].mean() < 0.5
    page.assert_quiet_console(refusals=True)


def test_the_inspection_scene(view, tmp_path, open_page):
    """A scene with a cover of clear plastic: all tabs, maps and measurements of the page, without a message."""
    text = (ROOT / "scenes/inspection/inspection.toml").read_text()
    text = text.replace('"inspection.glb"', json.dumps(str(ROOT / "scenes/inspection/inspection.glb")))
    running = view(job=text.replace("= 512", "= 96"))
    page = open_page(running)
    running.wait_for_film(4)
    page.wait(lambda: page.state()["certificate"] is not None, "a certificate")
    for name in ["ratio", "samples", "recent", "first_light", "render_sigma", "camera_sigma", "none"]:
        page.set("map", name)
        assert page.text("problems") == "", name
    page.set("region1", "10 10 40 40")
    page.set("region2", "50 50 60 60")
    page.set("line", "0 48 95 48")
    page.click("transfer-on")
    page.click("path")
    page.mouse(*[(x, 100) for x in (200, 220)], drag=True)
    for name in ["scene", "noise", "measure", "save", "camera"]:
        page.tab(name)
    assert page.text("problems") == ""
    assert page.text("region1-mean") != "\u2013" and page.text("cnr") != "\u2013"
    materials = [material["name"] for material in running.state()["scene"]["materials"]]
    assert "pmma" in materials
    restart_by(running, page, lambda: page.set(f"material-roughness-{materials.index('pmma')}-value", "0.4"))
    page.click("live")
    shown = page.text("frame-rate")
    page.wait(lambda: page.text("frame-rate") not in (shown, "0.0 frames/s"), "live frames")
    page.js("document.getElementById('live').click()")
    assert page.text("problems") == ""
    # A path that is asked for during the restart is refused.
    page.assert_quiet_console(refusals=True)
