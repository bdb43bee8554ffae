"""A film for each light: the power of a light is a knob of the camera."""

import numpy as np
import pytest
from images import assert_equal_means, layers
from jobs import station
from program import Refused, run
from test_scene import FIXED, index_of, restart_by

INFINITE = (
    FIXED
    + """
[[light]]
name = "sun"
kind = "sun"
irradiance = 2
direction = [1, 2, 0]

[environment]
radiance = 0.5
"""
)


def save(running, name, what=("exr",), **changes):
    body = {"what": list(what), "name": name, "camera": running.camera(**changes), "frame": 0}
    return running.post("save", body)["files"]


def saved_layers(running, name, **changes):
    return layers(running.folder / save(running, name, **changes)[0])


def start_mode(running, spp=1):
    """Switches the mode on, and waits for films of each light with so many samples per pixel."""
    before = running.wait_for_film(1)
    running.post("scene", {"per_light": True})
    return running.wait(
        lambda state: (
            state["scene"]["per_light"]["on"]
            and state["render"]["restarted"] > before["render"]["restarted"]
            and state["film"]["id"] > before["film"]["id"]
            and state["film"]["spp"] >= spp
        ),
        "films of the lights",
    )


def test_factors_of_lights_need_no_samples(view, tmp_path, open_page):
    running = view(job=FIXED)
    page = open_page(running)
    page.tab("scene")
    mode = running.state()["scene"]["per_light"]
    assert mode["on"] is False and mode["lights"] == 2
    # Films with copies: more than three times 200 bytes per pixel, and no gigabyte.
    assert 96 * 72 * 600 < mode["bytes"] < 1e9
    assert page.hidden("light-factors") and "2 lights" in page.text("per-light-memory")
    restart_by(running, page, lambda: page.click("per-light"))
    assert running.state()["scene"]["per_light"]["on"] is True and not page.hidden("light-factors")
    running.wait_for_film(64)
    page.click("pause")
    paused = running.wait(lambda state: state["render"]["state"] == "paused", "the pause")
    page.wait(lambda: page.film() == paused["film"]["id"], "the picture of the last film")
    both = page.frame()["header"]
    left, right = (index_of(running, "lights", name) for name in ["left", "right"])
    page.set(f"light-factor-value-{left}", "3")
    page.set(f"light-factor-value-{right}", "0.5")
    assert page.text("problems") == ""
    header = page.frame()["header"]
    assert header["film"] == both["film"] and header["mean_electrons"] > 1.2 * both["mean_electrons"]
    # The picture is the sum of the films times the factors.
    shown = saved_layers(running, "factors", lights={"left": 3, "right": 0.5})
    for channel in "RGB":
        total = 3 * shown[f"light.left.{channel}"].astype(float) + 0.5 * shown[f"light.right.{channel}"]
        assert np.allclose(shown[channel], total, rtol=1e-5)
    assert header["mean_electrons"] == pytest.approx(shown["electrons.Y"].mean(), rel=1e-6)
    # It is the picture of a job with this power.
    (tmp_path / "power.toml").write_text(
        station(sensor='exposure = "5ms"', left=1.5).replace("power = 0.5", "power = 0.25")
    )
    run("render", "power.toml", "--spp", "64", "-o", "power.png", "--exr", "power.exr", cwd=tmp_path)
    assert_equal_means(shown, layers(tmp_path / "power.exr"))
    # A light with the factor 0 is dark.
    page.set(f"light-factor-value-{left}", "0")
    dark = saved_layers(running, "dark", lights={"left": 0, "right": 0.5})
    assert np.allclose(dark["G"], 0.5 * shown["light.right.G"], rtol=1e-5)
    assert page.frame()["header"]["mean_electrons"] == pytest.approx(dark["electrons.Y"].mean(), rel=1e-6)
    # The noise is known, for these factors.
    running.wait(lambda state: (state["certificate"] or {}).get("p99") is not None, "a certificate")
    assert page.text("problems") == ""
    now = running.state()
    assert now["render"]["restarted"] == paused["render"]["restarted"] and now["film"] == paused["film"]
    page.click("pause")
    running.wait(lambda state: state["film"]["samples"] > paused["film"]["samples"], "samples after the pause")
    running.wait(lambda state: len(state["curve"]) > 1 and len(state["forecast"]) >= 4, "the curve and its forecast")
    restart_by(running, page, lambda: page.click("per-light"))
    assert page.hidden("light-factors") and running.state()["scene"]["per_light"]["on"] is False
    page.wait(lambda: page.js("return window.dunkelfeld.frame().header.film") > now["film"]["id"], "one film")
    assert not [name for name in saved_layers(running, "one") if name.startswith("light.")]
    # The factors are gone, with a message.
    assert page.text("problems").startswith("The factors of the lights of A and B are 1 again.")
    assert page.text("problems").count("Close") == 1
    page.assert_quiet_console()


def test_all_lights_add_up(view):
    """Suns and environments have films too. Their factors are those of a camera, as they have no power."""
    running = view(job=INFINITE)
    running.wait_for_film(32)
    one = saved_layers(running, "one")
    start_mode(running, 32)
    all_lights = saved_layers(running, "all", lights=None)
    assert_equal_means(all_lights, one)
    names = {name.split(".")[1] for name in all_lights if name.startswith("light.")}
    assert names == {"left", "right", "sun", "environment"}
    half = saved_layers(running, "half", lights={"sun": 0.5, "environment": 2, "left": 0, "right": 0})
    total = 0.5 * half["light.sun.G"].astype(float) + 2 * half["light.environment.G"]
    assert np.allclose(half["G"], total, rtol=1e-5) and half["G"].mean() > 0
    # A job has no key for these factors.
    for lights in [{"sun": 0.5}, {"environment": 0}]:
        with pytest.raises(Refused) as refusal:
            save(running, "job", ["job"], lights=lights)
        assert refusal.value.status == 422 and next(iter(lights)) in refusal.value.fault["problem"]
    for lights in [{"sun": -1}, {"sun": 1e7}]:
        with pytest.raises(Refused):
            running.frame(lights=lights)


def test_files_and_measurements_of_the_sum(view, tmp_path):
    running = view(job=FIXED)
    start_mode(running, 32)
    state = running.pause()
    factors = {"left": 2.0, "right": 0.25}
    shown = saved_layers(running, "shown", lights=factors)
    # The maps of samples and noise are those of the picture.
    header, samples = running.picture("map", {"camera": running.camera(lights=factors), "map": "samples"})
    assert header["film"] == state["film"]["id"] and samples.sum() == state["film"]["samples"]
    assert (samples == shown["spp.Y"]).all()
    _, ratio = running.picture("map", {"camera": running.camera(lights=factors), "map": "ratio"})
    known = np.isfinite(ratio)
    assert known.mean() > 0.9
    assert np.allclose(ratio[known] ** 2, shown["hidden.Y"][known], rtol=1e-4)
    # Without light there is no noise of the render.
    _, dark = running.picture("map", {"camera": running.camera(lights={"left": 0, "right": 0}), "map": "ratio"})
    assert (dark == 0).all()
    # The path of the heaviest sample.
    x, y = 20, 10
    probe = running.post("probe", {"camera": running.camera(lights=factors), "frame": 0, "x": x, "y": y})
    assert probe["object"] == "plate" and probe["material"] == "plate" and probe["samples"] == samples[y, x]
    assert probe["radiance"][1] == pytest.approx(shown["G"][y, x], rel=1e-5)
    assert probe["electrons"] == pytest.approx(shown["electrons.Y"][y, x], rel=1e-6)
    for light in ["left", "right"]:
        camera = running.camera(lights={"left": 0, "right": 0, light: 1})
        probe = running.post("probe", {"camera": camera, "frame": 0, "x": x, "y": y})
        path = running.post("path", {"x": x, "y": y, "index": None, "camera": camera})
        assert path["index"] == probe["heaviest"]["index"]
    probe = running.post("probe", {"camera": running.camera(), "frame": 0, "x": x, "y": y})
    path = running.post("path", {"x": x, "y": y, "index": None, "camera": running.camera()})
    # The share of the sample is its luminance over that of all samples.
    mean = np.dot([0.2126, 0.7152, 0.0722], probe["radiance"])
    count = path["luminance"] / (probe["heaviest"]["share"] * mean)
    assert path["index"] == probe["heaviest"]["index"] and count == pytest.approx(samples[y, x], rel=1e-4)
    # Matched noise holds, and a denoiser works.
    header, _ = running.frame(lights=factors, noise="matched")
    assert header["matched"] > 0
    header, _ = running.frame(lights=factors, denoise="builtin")
    assert header["mean_electrons"] == pytest.approx(shown["electrons.Y"].mean(), rel=0.02)
    # A job has the factors as power, a film file has the light of the scene.
    save(running, "job", ["job", "png", "tiff"], lights=factors)
    run("render", "job.toml", "--spp", "32", "-o", "job.png", "--exr", "job.exr", cwd=tmp_path)
    assert_equal_means(layers(tmp_path / "job.exr"), shown)
    with pytest.raises(Refused) as refusal:
        save(running, "film", ["film"], lights=factors)
    assert refusal.value.status == 422 and not (tmp_path / "film.film").exists()
    save(running, "film", ["film"])
    assert (tmp_path / "film.film").exists()


def test_changes_of_the_scene_in_the_mode(view):
    running = view(job=FIXED)
    started = start_mode(running)
    # Power and switch of the scene render again. A light that is off has no film.
    running.post("scene", {"lights": {"left": {"on": False, "factor": 1}, "right": {"on": True, "factor": 2}}})
    state = running.wait(
        lambda state: (
            state["render"]["restarted"] > started["render"]["restarted"]
            and state["film"]["id"] > started["film"]["id"]
            and state["film"]["spp"] >= 16
        ),
        "the change",
    )
    assert state["scene"]["per_light"]["on"] is True and state["scene"]["per_light"]["lights"] == 1
    shown = saved_layers(running, "right", lights={"left": 5, "right": 0.5})
    assert [name for name in shown if name.startswith("light.")] == [f"light.right.{c}" for c in "BGR"]
    assert np.allclose(shown["G"], 0.5 * shown["light.right.G"], rtol=1e-5)
    # Without any light there is nothing to render, so the last one stays on.
    with pytest.raises(Refused, match="no light is on"):
        running.post("scene", {"lights": {name: {"on": False, "factor": 1} for name in ["left", "right"]}})
    before = running.state()["film"]["id"]
    running.post("scene", {"lights": {"left": None, "right": None}})
    state = running.wait(lambda state: state["film"]["id"] > before and state["error"] is None, "both lights")
    assert state["scene"]["per_light"]["lights"] == 2


def test_factors_without_the_mode(view):
    running = view(job=FIXED)
    running.wait_for_film(1)
    with pytest.raises(Refused) as refusal:
        running.frame(lights={"left": 2})
    assert "one film for all lights" in refusal.value.fault["problem"]
    header, _ = running.frame(lights={"left": 1})
    assert header["film"] > 0


def test_too_little_memory(view):
    tight = view(job=FIXED.replace("width = 96", "width = 960") + '[budget]\nmemory = "190MB"\n')
    tight.wait_for_film(0.1)
    with pytest.raises(Refused) as refusal:
        tight.post("scene", {"per_light": True})
    assert refusal.value.status == 422 and "190 MB" in refusal.value.fault["problem"]
    assert tight.state()["render"]["restarted"] == 0 and tight.state()["error"] is None
    film = tight.state()["film"]
    tight.wait(lambda state: state["film"]["id"] > film["id"], "the next film of the render that goes on")
