"""Several pages of one render, and changes at awkward moments."""

import time

import numpy as np
import OpenEXR
import pytest
from images import layers
from jobs import station
from page import wait_for
from program import Refused, run

FIXED = station(width=48, height=36, sensor='exposure = "5ms"')
SPOT = '\n[[light]]\nname = "spot"\nkind = "point"\nposition = [0, "150mm", 0]\npower = 0.2\n'
MOVED = FIXED.replace('["-40mm", "25mm", 0]', '["-40mm", "25mm", 0]\nvelocity = ["1m/s", 0, 0]')


def level_of(running, camera):
    """The level of 99 % of the pixels that a certificate counts."""
    _, ratios = running.picture("map", {"camera": camera, "map": "ratio"})
    return np.quantile(ratios[~np.isnan(ratios)], 0.99)


def test_the_statistics_are_those_of_the_last_camera(view):
    running = view(job=FIXED)
    running.wait_for_film(40)
    running.pause()
    film = running.state()["film"]["id"]
    body = {"frame": 0, "tone": "gamma"}
    levels = []
    for exposure in [2e-4, 2e-3]:
        camera = running.camera(exposure=exposure)
        running.picture("frame", {**body, "camera": camera})
        state = running.wait(lambda state: (state["certificate"] or {}).get("film") == film, "the certificate")
        assert state["statistics_of"]["exposure"] == exposure and state["curve"]
        levels.append(state["certificate"]["p99"])
        assert levels[-1] == pytest.approx(level_of(running, camera), rel=0.03)
    # More light: the noise of the camera hides less.
    assert levels[0] < 0.8 * levels[1]
    # Picture B changes nothing.
    running.picture("frame", {**body, "camera": running.camera(exposure=1e-2), "statistics": False})
    assert running.state()["statistics_of"]["exposure"] == 2e-3
    # The target has the exact share of this camera.
    running.post("target", {"k": 0.3})
    _, ratios = running.picture("map", {"camera": camera, "map": "ratio"})
    counted = ratios[~np.isnan(ratios)]
    certificate = running.state()["certificate"]
    assert certificate["k"] == 0.3 and certificate["hidden"] == pytest.approx(np.mean(counted <= 0.3), abs=1e-3)
    assert certificate["saturated"] == np.isnan(ratios).sum()


def test_a_target_that_is_not_reached_is_not_complete(view):
    running = view(job=FIXED)
    running.post("target", {"k": 1})
    levels, end = set(), time.monotonic() + 8
    while time.monotonic() < end:
        state = running.state()
        levels |= {point["k"] for point in state["forecast"]}
        reached = state["curve"] and (state["curve"][-1]["k99"] or 9) <= 1
        if state["render"]["state"] == "running" and not reached:
            assert state["render"]["fraction"] < 1 and state["render"]["remaining"] != 0
    # Levels above that of the plan, too.
    assert {1.4, 1, 0.7, 0.5, 0.25} <= levels


def test_changes_of_absent_parts_are_kept(view, tmp_path):
    running = view(job=FIXED + SPOT)
    running.wait_for_film(1)

    def factors():
        return {light["name"]: light["factor"] for light in running.state()["scene"]["lights"]}

    # Two pages at the same moment.
    running.post("scene", {"lights": {"spot": {"on": True, "factor": 3}}})
    running.post("scene", {"lights": {"left": {"on": True, "factor": 2}}})
    running.wait(lambda _: factors() == {"spot": 3, "left": 2, "right": 1}, "both changes")
    running.post("scene", {"effects": {"punctual-lights": False}})
    running.wait(lambda _: "spot" not in factors(), "the scene without the spot")
    running.post("scene", {"effects": {"punctual-lights": True}})
    running.wait(lambda _: factors() == {"spot": 3, "left": 2, "right": 1}, "the spot with its factor")
    # A change while the job is broken is made when it is mended.
    job = tmp_path / "station.toml"
    text = job.read_text()
    job.write_text(text + "\nnonsense = [\n")
    running.wait(lambda state: state["error"], "the error")
    running.post("scene", {"lights": {"right": {"on": True, "factor": 4}}, "materials": {"lid": {"roughness": 0.9}}})
    running.wait(lambda _: factors()["right"] == 4, "the change that waits")
    job.write_text(text)
    state = running.wait(lambda state: state["error"] is None and state["render"]["state"] == "running", "the render")
    assert factors() == {"spot": 3, "left": 2, "right": 4}
    assert next(m for m in state["scene"]["materials"] if m["name"] == "lid")["roughness"] == 0.9
    # Null is as in the job.
    running.post("scene", {"lights": {name: None for name in ["spot", "left", "right"]}, "materials": {"lid": None}})
    running.wait(lambda _: set(factors().values()) == {1}, "the scene of the job")


def test_a_page_takes_back_no_material_of_another(view, open_page):
    running = view(job=FIXED)
    running.wait_for_film(1)
    running.post("scene", {"materials": {"plate": {"roughness": 0.2}}})
    running.wait(lambda state: changes(state)["plate"], "the change")
    page = open_page(running)
    page.wait(lambda: changes(page.state())["plate"] == {"roughness": 0.2}, "the change on the page")
    # This page changes the lid, and the other one takes the plate back before the page has sent its request.
    move = """const e = document.getElementById('material-roughness-2'); e.value = arguments[0];
        e.dispatchEvent(new Event('input', {bubbles: true}))"""
    page.js(move, "0.9")
    running.post("scene", {"materials": {"plate": None}})
    running.wait(lambda state: changes(state)["lid"] == {"roughness": 0.9}, "the change of the page")
    page.idle()
    assert changes(running.state()) == {"plate": {}, "ball": {}, "lid": {"roughness": 0.9}}
    # Another value of the same material.
    page.wait(lambda: changes(page.state()) == changes(running.state()), "the state on the page")
    page.js(move, "0.8")
    running.post("scene", {"materials": {"lid": {"metallic": 1}}})
    running.wait(lambda state: changes(state)["lid"] == {"roughness": 0.8, "metallic": 1}, "both changes")


def changes(state):
    """The changed values of the materials."""
    return {material["name"]: material["changed"] for material in state["scene"]["materials"]}


def test_a_change_of_nothing_starts_no_render(view):
    running = view(job=FIXED)
    running.wait_for_film(1)
    running.post("scene", {"lights": {"left": {"on": True, "factor": 2}}})
    running.wait(lambda state: state["render"]["restarted"] == 1, "the change")
    running.pause()
    same = {"lights": {"left": {"on": True, "factor": 2}, "right": {"on": True, "factor": 1}}, "per_light": False}
    for request in [
        {},
        {"lights": {}},
        {"lights": {"right": None}, "materials": {"lid": None}, "effects": {"textures": True}},
        same,
    ]:
        running.post("scene", request)
        # The pause is kept too.
        running.picture("frame", {"camera": running.camera(), "frame": 0, "tone": "gamma"})
        assert running.state()["render"]["state"] == "paused", request
    running.post("scene", {"lights": {"left": None}})
    running.wait(lambda state: state["render"]["restarted"] == 2, "a change")


def test_the_state_has_a_change_that_is_not_made_yet(view):
    running = view(job=station(width=400, height=300))
    running.wait_for_film(1)
    running.post("scene", {"effects": {"textures": False}, "lights": {"left": {"on": False, "factor": 1}}})
    state = running.state()
    assert state["film"]["earlier"]
    assert next(effect for effect in state["scene"]["effects"] if effect["name"] == "textures")["left_out"]
    assert not next(light for light in state["scene"]["lights"] if light["name"] == "left")["on"]
    # A later request for another effect keeps this one.
    running.post("scene", {"effects": {"environment": False}})
    running.wait_for_film(1)
    left_out = [effect["name"] for effect in running.state()["scene"]["effects"] if effect["left_out"]]
    assert sorted(left_out) == ["environment", "textures"]


def test_a_change_during_an_error_of_the_lens(view, tmp_path):
    """The file can be read, and its lens does not fit."""
    running = view(job=FIXED)
    running.wait_for_film(1)
    job = tmp_path / "station.toml"
    job.write_text(FIXED + "\n[lens]\ndistortion = [-5, 0, 0, 0, 0]\n")
    running.wait(lambda state: state["error"], "the error")
    running.post("scene", {"lights": {"right": {"on": True, "factor": 4}}})

    def factor(state):
        return next(light["factor"] for light in state["scene"]["lights"] if light["name"] == "right")

    running.wait(lambda state: state["error"] and factor(state) == 4, "the change that waits")
    job.write_text(FIXED)
    state = running.wait(lambda state: state["error"] is None and state["render"]["state"] == "running", "the render")
    assert factor(state) == 4


def test_a_change_of_a_light_that_gets_a_mixed_name(view, tmp_path):
    running = view(job=FIXED + SPOT)
    running.wait_for_film(1)
    running.post("scene", {"lights": {"spot": {"on": False, "factor": 1}}})
    job = tmp_path / "station.toml"

    def spot(state):
        return next(light for light in state["scene"]["lights"] if light["name"] == "spot")

    running.wait(lambda state: state["render"]["restarted"] == 1 and not spot(state)["on"], "the change")
    job.write_text((FIXED + SPOT).replace('name = "left"', 'name = "spot"'))
    state = running.wait(lambda state: state["render"]["restarted"] == 2, "the new names")
    # Lights with and without a surface: none is changed, and the page states it.
    assert spot(state)["on"] and spot(state)["power"] == "0.700 W"
    assert any("is not made" in note["text"] and "spot" in note["text"] for note in state["notes"])
    body = {"what": ["job"], "name": "mixed", "camera": running.camera(), "frame": 0}
    running.wait_for_film(1)
    running.post("save", body)
    assert "enabled" not in (tmp_path / "mixed.toml").read_text()
    # The change is made again for the light that was changed.
    job.write_text(FIXED + SPOT)
    state = running.wait(lambda state: state["render"]["restarted"] == 3, "the old names")
    assert not spot(state)["on"] and not any("is not made" in note["text"] for note in state["notes"])


def test_files_of_one_request_are_of_one_film(view, tmp_path):
    running = view(job=FIXED)
    running.wait_for_film(40)
    what = {"what": ["job", "film", "exr"], "camera": running.camera(), "frame": 0}
    running.post("save", {**what, "name": "same"})
    spp = layers(tmp_path / "same.exr")["spp.Y"]
    state = view("same.film").wait(lambda state: state["film"], "the film")
    assert state["film"]["samples"] == spp.sum()


def test_a_job_that_gets_motion_has_its_exposure(view, tmp_path, open_page):
    running = view(job=FIXED)
    page = open_page(running)
    page.set("exposure-value", "1 ms")
    job = tmp_path / "station.toml"
    job.write_text(MOVED)
    page.wait(lambda: "5 ms" in page.text("problems"), "the message")
    page.wait(lambda: page.js("return window.dunkelfeld.frame().camera.exposure") == 0.005, "the exposure of the job")
    state = running.wait(lambda state: state["timed"] and state["film"] and not state["film"]["first"], "a film")
    page.wait(lambda: page.film() >= state["film"]["id"], "pictures")
    assert "5 ms" in page.text("problems") and page.text("problems").count("Close") == 1
    # Another exposure in the job: no picture is refused for good.
    job.write_text(MOVED.replace('"5ms"', '"2ms"'))
    page.wait(lambda: page.js("return window.dunkelfeld.frame().camera.exposure") == 0.002, "the new exposure")
    # A sensor that is removed and restored.
    job.write_text(FIXED.replace('model = "imx250"', 'model = "none"').replace('exposure = "5ms"', ""))
    page.wait(lambda: page.js("return window.dunkelfeld.frame().camera.sensor") is None, "a picture without a sensor")
    job.write_text(FIXED)
    sensor = "return window.dunkelfeld.frame().camera.sensor"
    page.wait(lambda: page.js(sensor) == "as in the job", "a picture with the sensor")
    page.idle()
    assert "sensor" not in page.text("problems"), page.text("problems")


def test_a_page_without_a_sensor_follows_a_job_that_gets_motion(view, tmp_path, open_page):
    running = view(job=FIXED)
    page = open_page(running)
    camera = "return window.dunkelfeld.frame().camera"
    page.set("exposure-value", "1 ms")
    page.set("sensor", "")
    page.wait(lambda: page.js(camera)["sensor"] is None, "a picture without a sensor")
    (tmp_path / "station.toml").write_text(MOVED)
    running.wait(lambda state: state["timed"] and state["render"]["restarted"] == 1, "the job")
    running.wait_for_film(1)
    film = running.pause()["film"]["id"]
    page.wait(lambda: page.state()["render"]["state"] == "paused" and page.film() == film, "the last picture")
    # Its first picture with the sensor has the exposure of the job: no later state needs to mend it.
    page.set("sensor", "as in the job")
    assert (page.js(camera)["sensor"], page.js(camera)["exposure"]) == ("as in the job", 0.005)


def test_the_help_for_an_exr_is_for_the_page(view, tmp_path):
    grey = np.full((8, 8), 0.5, np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {name: grey for name in "RGB"}).write(str(tmp_path / "grey.exr"))
    running = view("grey.exr")
    running.wait(lambda state: state["film"], "the image")
    with pytest.raises(Refused) as refusal:
        running.frame(noise="matched")
    assert "--" not in refusal.value.fault["help"] and "plain noise" in refusal.value.fault["help"]


@pytest.mark.parametrize("file", ["layers.exr", "stored.film"])
def test_a_camera_of_long_ago_is_analysed_again(view, tmp_path, file):
    (tmp_path / "station.toml").write_text(FIXED)
    command = ["render", "station.toml", "--spp", "16", "-o", "x.png"]
    run(*command, "--exr", "layers.exr", "--checkpoint", "stored.film", cwd=tmp_path)
    running = view(file)
    running.wait(lambda state: state["film"], "the image")
    is_film = file == "stored.film"

    def shown(exposure):
        """The analysis of the picture and the certificate for a page with this exposure, once it has both."""
        camera = running.camera(exposure=exposure, noise="matched")

        def ready():
            body = {"camera": camera, "frame": 0, "tone": "gamma"}
            header, _ = running.picture("frame", body)
            # An EXR has no certificate.
            certificate = running.state()["certificate"] if is_film else 0
            return header["analysis"] == "exact" and certificate is not None and [certificate]

        return wait_for(ready, f"the analysis for {exposure} s")

    # More cameras than those whose analyses are kept.
    exposures = [1e-3 * (2 + step) for step in range(12)]
    first = [shown(exposure) for exposure in exposures]
    assert [shown(exposure) for exposure in exposures] == first
