"""The pictures and knobs of the page, with a server of synthetic data."""

import time
from itertools import pairwise

import numpy as np
import pytest
from mock_data import JOB_CAMERA
from mock_page import FROZEN, WIDTH, overlaps
from page import PATIENCE, tone_value
from selenium.webdriver.common.keys import Keys


def test_first_picture_and_tone(mock_page):
    page = mock_page(*FROZEN)
    frame = page.frame()
    header, data = page.mock.frame({"camera": JOB_CAMERA, "frame": 0, "tone": "gamma", "statistics": False})
    assert frame["values"] == np.frombuffer(data, "<u2").tolist()
    assert frame["header"]["film"] == header["film"] and frame["header"]["format"] == "gray16"
    page.click("one-to-one")
    x0, y0 = page.origin()
    before = len(page.log("/api/frame"))
    for name in ["gamma", "linear", "log"]:
        page.set("tone", name)
        page.settle()
        for x, y in [(10, 10), (160, 120), (300, 200), (91, 177)]:
            expected = tone_value(frame["values"][y * WIDTH + x], header, name)
            assert page.pixel(x0 + x, y0 + y) == [expected] * 3 + [255], (name, x, y)
    assert len(page.log("/api/frame")) == before, "the tone of a grey picture needs no request"


def test_progressive_one_in_flight(mock_page):
    page = mock_page("--speed", "3")
    page.mock.settings["delay"] = 0.12
    page.click("compare")
    page.set("map", "samples")
    films = set()
    end = time.monotonic() + PATIENCE
    while len(films) < 6 and time.monotonic() < end:
        films.add(page.film())
        assert films - {None} or page.frame() is None, "a picture that was shown is gone"
    page.mock.settings["frozen"] = page.mock.seconds()
    page.settle()
    assert len(films) >= 6, films
    pictures = [e for e in page.log() if e["path"] in ("/api/frame", "/api/map") and e["end"]]
    assert not overlaps(pictures), "more than one picture was requested at a time"
    # Each film is shown once behind A and once behind B; the first requests have no B.
    last = page.mock.film()["id"]
    assert len(page.log("/api/frame")) <= 2 * (last + 2), "a film was requested twice"


def test_newest_knob_counts(mock_page):
    page = mock_page(*FROZEN)
    page.mock.settings["delay"] = 0.2
    before = len(page.log("/api/frame"))
    page.js("""const e = document.getElementById('gain'); let n = 0;
        const t = setInterval(() => { e.value = String(n / 40); e.dispatchEvent(new Event('input')); if (++n > 20) { clearInterval(t); window.moved = true; } }, 15)""")
    page.wait(lambda: page.js("return window.moved"), "the end of the movement")
    page.settle()
    requests = page.log("/api/frame")[before:]
    # 21 positions in a third of a second, and 0.2 s for each answer.
    assert len(requests) < 15, len(requests)
    assert not overlaps(requests)
    final = float(page.value("gain-value"))
    assert abs(requests[-1]["body"]["camera"]["gain"] - final) < 1e-9 and abs(final - 10**0.5) < 0.05


def test_a_knob_does_not_wait_for_a_new_film(mock_page):
    page = mock_page(*FROZEN)
    page.settle()
    page.mock.settings["delay"] = 1.0
    before = len(page.log("/api/frame"))
    page.mock.settings["frozen"] += 1
    page.wait(lambda: len(page.log("/api/frame")) > before, "the request of the new film")
    page.set("gain-value", "2")
    page.settle()
    film, knob = page.log("/api/frame")[before:]
    assert (film["body"]["camera"]["gain"], knob["body"]["camera"]["gain"]) == (1, 2)
    # The answer of the first one takes longer.
    assert knob["start"] < film["start"] + 1.0
    assert page.text("problems") == "" and page.film() == page.state()["film"]["id"]
    page.assert_quiet_console()


def test_camera_knobs(mock_page):
    page = mock_page(*FROZEN)
    for id_, value, key, expected in [
        ("exposure-value", "2 ms", "exposure", 0.002),
        ("exposure-value", "350us", "exposure", 350e-6),
        ("exposure-value", "0,1 s", "exposure", 0.1),
        ("gain-value", "2.5", "gain", 2.5),
        ("temperature-value", "41.5", "temperature", 41.5),
        ("black-level", "32", "black_level", 32),
        ("noise", "none", "noise", "none"),
        ("device", "7", "device", 7),
        ("denoise", "builtin", "denoise", "builtin"),
        ("sensor", "ccd-icx285", "sensor", "ccd-icx285"),
    ]:
        page.set(id_, value)
        page.settle()
        assert (
            page.camera()[key] == pytest.approx(expected)
            if isinstance(expected, float)
            else page.camera()[key] == expected
        ), (id_, value)
    for text, words in [
        ("abc", '"abc" is no exposure time.'),
        ("0", '"0" is no exposure time.'),
        ("3 m", '"3 m" is no exposure time.'),
        ("5 s", "The exposure time 5 s is out of range."),
    ]:
        page.set("exposure-value", text)
        assert page.value("exposure-value") == "100 ms"
        assert words in page.text("problems") and "10 µs to 1 s, for example 2 ms" in page.text("problems"), text
    page.set("exposure-value", "90 ms")
    assert page.text("problems") == "" and page.value("exposure-value") == "90 ms"
    options = page.js("return [...document.getElementById('sensor').options].map(e => e.text)")
    assert options[0] == "as in the job (imx250)"
    for id_, key in [
        ("exposure-auto", "exposure"),
        ("temperature-model", "temperature"),
        ("black-level-model", "black_level"),
    ]:
        page.click(id_)
        page.settle()
        assert page.camera()[key] is None, id_
    assert page.value("exposure-value").endswith("ms")
    page.click("exposure-auto")
    page.settle()
    assert page.camera()["exposure"] > 0
    page.click("vignetting")
    page.settle()
    assert page.camera()["vignetting"] is False
    page.click("device-next")
    page.settle()
    assert page.camera()["device"] == 8
    page.set("sensor", "")
    page.settle()
    assert page.camera()["sensor"] is None
    assert page.frame()["header"]["format"] == "rgb8" and page.element("gain").get_attribute("disabled")
    before = len(page.log("/api/frame"))
    page.set("tone", "linear")
    page.settle()
    assert page.last("/api/frame")["tone"] == "linear" and len(page.log("/api/frame")) == before + 1
    page.click("camera-reset")
    page.settle()
    assert page.camera() == JOB_CAMERA


def test_refused_camera(mock_page):
    page = mock_page(*FROZEN)
    old = page.frame()["values"]
    page.set("map", "samples")
    page.settle()
    page.set("denoise", "oidn")
    page.settle()
    assert "Open Image Denoise is not installed." in page.text("problems") and page.frame()["values"] == old
    page.hold(21.4)
    assert page.state()["film"]["id"] == 22
    assert len([e for e in page.log("/api/frame") if e["body"]["camera"]["denoise"] == "oidn"]) == 1, (
        "a refused request is not repeated"
    )
    page.set("denoise", "off")
    page.settle()
    assert page.text("problems") == "" and page.frame()["header"]["film"] == 22
    page.assert_quiet_console(refusals=True)


def test_numbers_out_of_range_are_refused_and_forgotten(mock_page):
    page = mock_page(*FROZEN)
    for knob, key, value in [("temperature-value", "temperature", "300"), ("gain-value", "gain", "0")]:
        before = page.log("/api/frame")[-1]["body"]["camera"]
        page.set(knob, value)
        assert "out of range" in page.text("problems")
        page.set("black-level", "100" if key == "gain" else "90")
        page.settle()
        after = page.log("/api/frame")[-1]["body"]["camera"]
        assert after[key] == before[key] and after["black_level"] != before["black_level"]
        assert page.text("problems") == ""
    for knob, value, words in [("black-level", "-1", '"-1" is no black level'), ("device", "-1", '"-1" is no device')]:
        before = page.value(knob)
        page.set(knob, value)
        assert words in page.text("problems") and page.value(knob) == before
        page.set("gain-value", "2" if knob == "device" else "3")
        page.settle()
        assert page.text("problems") == ""
    page.assert_quiet_console()


def test_provisional_pictures_are_asked_for_again(mock_page):
    page = mock_page(*FROZEN)
    page.set("noise", "plain")
    page.settle()
    assert page.text("frame-analysis") == "–"
    page.mock.settings["analysis"] = "none"
    page.set("denoise", "auto")
    page.settle()
    assert page.text("frame-analysis") == "not ready: not denoised"
    page.set("denoise", "off")
    page.set("noise", "matched")
    page.settle()
    assert page.text("frame-analysis") == "not ready: plain noise"
    page.mock.settings |= {"analysis": "earlier", "prepared": 0.5}
    page.wait(lambda: page.text("frame-analysis") == "of an earlier one", "an analysis")
    page.settle()
    asked = len(page.log("/api/frame"))
    assert page.text("frame-analysis") == "of an earlier one"
    page.mock.settings |= {"analysis": "exact", "prepared": 1}
    page.wait(lambda: page.text("frame-analysis") == "of this picture", "the newer analysis")
    page.settle()
    assert len(page.log("/api/frame")) == asked + 1
    # Plain noise needs no analysis.
    page.set("noise", "plain")
    page.settle()
    asked = len(page.log("/api/frame"))
    page.mock.settings["prepared"] = 2
    page.wait(lambda: page.state()["prepared"] == 2, "the next analysis")
    page.settle()
    assert len(page.log("/api/frame")) == asked and page.text("frame-analysis") == "–"
    page.assert_quiet_console()


def test_scene_debounce(mock_page):
    page = mock_page()
    page.tab("scene")
    before = page.mock.restarted
    page.js("""const e = document.getElementById('light-power-0');
        for (let n = 0; n < 6; n++) { e.value = String(n / 10); e.dispatchEvent(new Event('input')); }""")
    changed = time.time()
    page.idle()
    requests = page.log("/api/scene")
    assert len(requests) == 1 and requests[0]["start"] - changed > 0.2
    lights = requests[0]["body"]["lights"]
    # Only the light that has changed: another page may change another one at the same moment.
    assert set(lights) == {"ring light"} and abs(lights["ring light"]["factor"] - 10**0.5) < 0.02
    assert page.mock.restarted == before + 1
    page.js("document.querySelectorAll('#materials details').forEach(d => d.open = true)")
    page.js("""for (const [id, value] of [['material-roughness-0', '0.8'], ['material-colour-2', '#ff8000']]) {
          const e = document.getElementById(id); e.value = value; e.dispatchEvent(new Event('input')); }
        for (const id of ['effect-0', 'light-on-1']) document.getElementById(id).click()""")
    page.idle()
    body = page.last("/api/scene")
    assert len(page.log("/api/scene")) == 2 and set(body) == {"materials", "effects", "lights"}
    # Values that the user did not change follow the files of the scene.
    assert set(body["materials"]) == {"anodised aluminium", "solder mask"} and body["effects"] == {"covers": False}
    assert body["materials"]["anodised aluminium"] == {"roughness": 0.8}
    assert set(body["materials"]["solder mask"]) == {"color"}
    colour = body["materials"]["solder mask"]["color"]
    assert abs(colour[0] - 1) < 1e-6 and abs(colour[1] - 0.2159) < 1e-3 and colour[2] == 0
    assert body["lights"] == {"bar left": {"on": False, "factor": 1}}
    # The states of the server no longer contain the effect, so the box stays empty.
    page.wait(lambda: page.state()["scene"]["effects"][0]["left_out"], "the state without the effect")
    assert page.checked("effect-0") is False
    # A further change contains no earlier one: another page may have taken that back.
    page.wait(
        lambda: page.state()["scene"]["materials"][0]["changed"] == {"roughness": 0.8}, "the state with the change"
    )
    page.js(
        """const e = document.getElementById('material-metallic-0'); e.value = '0.5'; e.dispatchEvent(new Event('input'));"""
    )
    page.idle()
    assert page.last("/api/scene") == {"materials": {"anodised aluminium": {"metallic": 0.5}}}
    page.set("scene-camera", "oblique 30°")
    page.idle()
    assert page.last("/api/scene") == {"camera": "oblique 30°"}
    page.wait(lambda: page.text("scene-restarts") == "Started again 4 times.", what="count of restarts")
    # A knob that is moved and moved back changes nothing.
    page.wait(lambda: page.checked("light-on-1") is False, "the state of the server")
    page.js("for (let n = 0; n < 2; n++) document.getElementById('light-on-1').click()")
    page.idle()
    assert len(page.log("/api/scene")) == 4 and page.checked("light-on-1") is False


def test_effects(mock_page):
    page = mock_page(*FROZEN)
    page.tab("scene")
    fold = "return document.querySelector('#effects-unused summary').textContent"
    assert page.js(fold) == "1 effect that the scene does not use"
    listed = page.js(
        "return [...document.querySelectorAll('#effects input')].map(e => [e.id, e.closest('details') !== null])"
    )
    assert listed == [["effect-0", False], ["effect-1", False], ["effect-3", False], ["effect-2", True]]
    assert page.disabled("effect-2") and page.attribute("effect-3", "data-effect") == "every-light"
    for index, word in [(1, "Depth of field"), (3, "takes a sample of each light")]:
        title = page.js("return document.getElementById(arguments[0]).closest('label').title", f"effect-{index}")
        assert word in title and "starts again" in title
    page.click("effect-3")
    page.idle()
    page.wait(lambda: page.state()["scene"]["effects"][3]["left_out"], "the state without the effect")
    assert page.checked("effect-3") is False and not page.disabled("effect-3")
    assert page.js(fold) == "1 effect that the scene does not use"


def test_per_light(mock_page):
    page = mock_page("--speed", "3")
    page.tab("scene")
    assert "22.1 MB" in page.text("per-light-memory") and "3 lights" in page.text("per-light-memory")
    assert page.js("return document.getElementById('light-factors').hidden")
    page.click("per-light")
    page.idle()
    assert page.last("/api/scene") == {"per_light": True}
    page.wait(lambda: not page.js("return document.getElementById('light-factors').hidden"), what="factors")
    page.wait(lambda: page.mock.film() is not None, "a film")
    before = page.value("light-factor-value-1")
    for text in ["-1", "2e6"]:
        page.set("light-factor-value-1", text)
        assert "Type 0 to 1000000" in page.text("problems") and page.value("light-factor-value-1") == before
    page.set("light-factor-value-1", "0")
    page.settle()
    wanted = {"ring light": 1, "bar left": 0, "room": 1}
    page.wait(lambda: page.camera()["lights"] == wanted, what="frame with the factors")
    page.click("keep")
    assert page.text("kept-facts") == "the same as A"
    page.set("light-factor-value-2", "0.3")
    page.set("light-factor-value-1", "2")
    assert page.text("kept-facts") == "bar left × 0, room × 1"
    page.set("light-factor-value-2", "1")
    page.click("per-light")
    page.idle()
    page.wait(lambda: page.mock.film() is not None, "a film")
    page.wait(lambda: page.camera()["lights"] is None, what="camera without lights")


def test_compare(mock_page):
    page = mock_page(*FROZEN)
    page.click("one-to-one")
    x0, y0 = page.origin()
    page.click("keep")
    page.set("gain-value", "0.3")
    page.click("compare")
    page.settle()
    assert page.text("kept-facts") == "gain 1.00"
    gains = {entry["body"]["camera"]["gain"] for entry in page.log("/api/frame")[-2:]}
    assert gains == {0.3, 1}
    assert page.pixel(x0 + 120, y0 + 120)[0] < page.pixel(x0 + 200, y0 + 120)[0] - 40
    bright = page.pixel(x0 + 200, y0 + 120)
    _, _, width, height = page.canvas()
    page.mouse((width / 2, height / 2), (width / 2 + 60, height / 2), (width * 0.75, height / 2), drag=True)
    page.settle()
    assert page.pixel(x0 + 200, y0 + 120) != bright, "A covers the place now"
    assert abs(int(page.element("divider").get_attribute("aria-valuenow")) - 75) <= 1
    page.keys(Keys.HOME, focus="divider")
    page.settle()
    assert page.pixel(x0 + 200, y0 + 120) == bright
    page.keys("x")
    page.settle()
    assert page.value("gain-value") == "1"


def test_live(mock_page):
    page = mock_page(*FROZEN)
    page.js("document.getElementById('live').click()")
    page.wait(lambda: len(page.log("/api/frame")) >= 6, "frames")
    assert page.text("frame-rate").endswith("frames/s"), page.text("frame-rate")
    numbers = [entry["body"]["frame"] for entry in page.log("/api/frame")]
    assert numbers == sorted(numbers) and len(set(numbers)) == len(numbers)
    page.mock.settings["delay"] = 0.4
    slow = len(page.log("/api/frame")) + 1
    page.wait(lambda: len(page.log("/api/frame")) >= slow + 4, "slow frames")
    requests = page.log("/api/frame")[slow : slow + 4]
    assert not overlaps(requests[:-1])
    steps = [b["body"]["frame"] - a["body"]["frame"] for a, b in pairwise(requests)]
    assert min(steps) >= 2, "a slow server must not get a queue of frames"
    page.click("live")
    page.settle()
    assert page.attribute("live", "aria-pressed") == "false" and page.text("frame-rate").startswith("frame ")
    last = page.last("/api/frame")["frame"]
    assert page.text("frame-rate").split()[-1] == str(last)


def test_save(mock_page):
    page = mock_page(*FROZEN)
    page.tab("save")
    # The job of the view does not collide with the job that is shown.
    assert page.value("save-name") == "panel-view"
    page.set("save-name", "a<i>b")
    for kind in ["tiff", "job"]:
        page.click(f"save-{kind}")
    page.click("save")
    page.idle()
    assert page.last("/api/save")["what"] == ["png", "tiff", "job"]
    page.wait(lambda: "a<i>b.png" in page.text("saved"), what="list")
    assert page.js("return document.querySelectorAll('#saved i').length") == 0
    page.click("save")
    page.idle()
    assert "exists" in page.text("problems") and "Nothing" in page.text("save-result")
    page.set("save-name", "../x")
    page.click("save")
    assert "folder" in page.text("save-result") and len(page.log("/api/save")) == 2
    assert page.text("problems") == "", "a new attempt removes the message of the one before"
    page.set("save-name", "second")
    page.chord(Keys.CONTROL, "s")
    page.idle()
    assert page.last("/api/save")["name"] == "second" and page.text("problems") == ""
    page.assert_quiet_console(refusals=True)


def test_reconnect(mock_page):
    page = mock_page(*FROZEN)
    assert page.text("connection") == "connected"
    page.stop()
    page.wait(lambda: page.text("connection") == "disconnected: reconnecting", "a lost connection")
    before = page.film()
    page.set("gain-value", "2")
    page.settle()
    page.start(page.port, "--freeze", "5.2")
    page.wait(lambda: page.text("connection") == "connected", "the connection")
    page.wait(lambda: page.film() == 6, what="picture of the new server")
    assert before != 6 and page.camera()["gain"] == 2
    # A new server with the same number of its film: its picture is another one.
    page.stop()
    page.wait(lambda: page.text("connection") != "connected", "a lost connection")
    page.start(page.port, "--freeze", "5.2")
    page.wait(lambda: page.log("/api/frame"), "the picture of the third server")
    # The browser itself writes the lost connection to the console.
    page.console()


def test_nothing_is_asked_before_the_first_state(mock_page):
    """A server that has just started has no film yet, whatever the server before had."""
    page = mock_page(*FROZEN)
    page.set("region1", "10 10 60 60")
    page.set("map", "samples")
    page.click("compare")
    page.settle()
    assert page.text("region1-mean") != "–"
    page.stop()
    page.wait(lambda: page.text("connection") != "connected", "a lost connection")
    page.start(page.port, "--mute", "--freeze", "0.1")
    page.wait(lambda: page.mock.connected, "the stream of events")
    page.set("gain-value", "3")
    page.idle()
    assert page.text("connection") != "connected" and not page.mock.log
    # Without a film, the picture and the values of the server before are gone.
    page.mock.settings["mute"] = False
    page.wait(lambda: page.text("connection") == "connected", "the first state")
    page.idle()
    assert page.frame() is None and "Waiting" in page.text("empty") and page.text("zoom") == "–"
    assert page.text("region1-mean") == "–" and page.text("frame-mean") == "–" and not page.mock.log
    assert page.state()["film"] is None and page.value("region1") == "10 10 60 60"
    # The film of the state may be gone when the request arrives: that refuses no knob.
    page.mock.settings |= {"no_picture": True, "frozen": 4.2}
    page.wait(lambda: any(entry.get("status") == 409 for entry in page.log("/api/frame")), "an early request")
    page.idle()
    assert page.text("problems") == "" and page.frame() is None
    page.mock.settings |= {"no_picture": False, "frozen": 5.2}
    page.wait(lambda: page.film() == 6, "the next film")
    page.wait(lambda: page.text("region1-mean") != "–", "the region of the new server")
    page.settle()
    assert page.value("gain-value") == "3" and page.text("problems") == ""
    gains = {entry["body"]["camera"]["gain"] for entry in page.log("/api/frame")[-2:]}
    assert gains == {1, 3} and page.log("/api/map"), "A, B and the map are asked for again"
    page.console()


def test_a_server_with_a_smaller_film(mock_page):
    page = mock_page(*FROZEN)
    page.set("region1", "10 10 60 60")
    page.set("region2", "250 10 300 60")
    page.set("line", "10 10 300 200")
    page.click("one-to-one")
    x0, y0 = page.origin()
    page.mouse((x0 + 300, y0 + 200), drag=True)
    page.settle()
    assert page.text("probe-place") == "300, 200" and page.text("probe-value") != "–"
    page.mouse((2, 2))
    page.stop()
    page.wait(lambda: page.text("connection") != "connected", "a lost connection")
    page.start(page.port, "--freeze", "2.2", "--width", "160", "--height", "120")
    page.wait(lambda: page.film() == 3, "the picture of the smaller film")
    page.wait(lambda: page.text("region1-mean") != "–", "the region")
    page.settle()
    assert page.frame()["header"]["width"] == 160 and page.text("problems") == ""
    assert [page.value(id_) for id_ in ("region1", "region2", "line")] == ["10 10 60 60", "", ""]
    assert page.last("/api/regions")["regions"] == [[10, 10, 60, 60]] and not page.log("/api/line")
    assert page.text("probe-place") == "–" and page.text("probe-value") == "–" and page.disabled("unpin")
    page.console()


def test_film_source(mock_page):
    page = mock_page("--source", "film", *FROZEN)
    page.tab("scene")
    assert page.hidden("scene-knobs") and "finished samples" in page.text("scene-none")
    assert page.disabled("pause")
    # The certificate has the verdict: the points of a film have no times.
    level = page.state()["certificate"]["p99"]
    assert page.attribute("verdict", "data-level") == "look" and page.text("verdict-k") == f"(k = {level:.2g})"
    page.set("target", "0.25")
    page.settle()
    assert f"needs about {(level / 0.25) ** 2:.2g} times the samples" in page.text("verdict-time")
    page.tab("noise")
    page.settle()
    assert page.js("return document.querySelectorAll('#curve .measured-point').length") == 1
    page.set("target", "1")
    page.settle()
    assert page.text("target-time") == "99 % of the pixels are hidden beneath the camera's noise at k = 1."
    assert page.disabled("save-film") and page.disabled("save-job") and not page.disabled("save-exr")
    assert "no scene" in page.js("return document.getElementById('save-job').closest('label').title")


def test_exr_source(mock_page):
    page = mock_page("--source", "exr", *FROZEN)
    assert page.attribute("verdict", "data-level") == "none" and "contains no samples" in page.text("verdict-text")
    assert page.text("verdict-time") == ""
    for kind in ["exr", "film", "job"]:
        assert page.disabled(f"save-{kind}") and not page.checked(f"save-{kind}"), kind
    assert not page.disabled("save-png") and not page.disabled("save-tiff")


def test_no_film_and_error(mock_page):
    page = mock_page("--freeze", "0.1")
    assert page.frame() is None and "Waiting" in page.text("empty") and not page.log("/api/frame")
    page.mock.settings["error"] = {
        "problem": "The mesh <b>x</b> is empty.",
        "place": "scene.gltf: mesh 3",
        "help": "Export it again.",
    }
    page.wait(lambda: "The mesh <b>x</b> is empty." in page.text("problems"), what="error")
    assert page.text("zoom") == "–", "there is nothing to scale"
    assert "not loaded" in page.text("scene-none") and page.hidden("scene-knobs")
    page.mock.settings["error"] = None
    page.mock.settings["frozen"] = 0.5
    page.wait(lambda: page.frame() is not None, what="coarse picture")
    assert "coarse picture" in page.text("stage-text")
    page.mock.settings["earlier_picture"] = True
    page.wait(lambda: "earlier picture" in page.text("stage-text"), what="the picture before a restart")
    page.mock.settings["earlier_picture"] = False
    page.wait(lambda: "coarse picture" in page.text("stage-text"), what="the picture of the render")
    assert page.element("verdict").get_attribute("data-level") == "none"
    page.click("notes-open")
    assert "<b>bolt</b>" in page.text("notes-list")
