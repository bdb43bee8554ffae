"""The tools, maps and measurements of the page, with a server of synthetic data."""

import math
import re

import numpy as np
from mock_data import JOB_CAMERA
from mock_page import FROZEN, HEIGHT, WIDTH
from page import tone_value
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

TABS = ["camera", "scene", "noise", "measure", "save"]
MAPS = ["ratio", "samples", "recent", "first_light", "render_sigma", "camera_sigma"]


def test_verdict_and_target(mock_page):
    page = mock_page("--freeze", "2.2")
    assert page.element("verdict").get_attribute("data-level") == "no" and "Not yet" in page.text("verdict-title")
    page.hold(18.4)
    page.wait(lambda: page.element("verdict").get_attribute("data-level") == "look", what="look")
    assert re.search(
        r"99 % of the pixels are hidden beneath the camera's noise at k = 0.5 after about 4\d s",
        page.text("verdict-time"),
    ), page.text("verdict-time")
    page.tab("noise")
    page.settle()
    # The line of the target by pointer.
    before = page.value("target")
    box = page.js(
        "const r = document.querySelector('#target-line .target').getBoundingClientRect(); return [r.left + r.width / 2, r.top]"
    )
    actions = ActionChains(page.driver, duration=30)
    pointer = actions.w3c_actions.pointer_action
    pointer.move_to_location(int(box[0]), int(box[1]))
    pointer.pointer_down()
    pointer.move_to_location(int(box[0]), int(box[1] - 15))
    pointer.move_to_location(int(box[0]), int(box[1] - 30))
    pointer.pointer_up()
    actions.perform()
    page.idle()
    dragged = float(page.value("target"))
    assert dragged > float(before) * 1.3 and page.mock.target == dragged
    # By keys on the line, and by keys of the page.
    page.keys(Keys.ARROW_DOWN, focus="target-line")
    page.idle()
    assert abs(page.mock.target - dragged / 1.1) < 0.01
    page.keys(Keys.ARROW_DOWN, focus=None)
    page.idle()
    assert abs(page.mock.target - dragged / 1.21) < 0.02, "the line keeps the focus"
    page.keys(".")
    page.idle()
    assert abs(page.mock.target - dragged / 1.1) < 0.02
    page.set("target", "1")
    page.settle()
    assert page.mock.target == 1 and re.search(r"at k = 1 since 1\d s", page.text("target-time")), page.text(
        "target-time"
    )
    for text in ["99", "0", ""]:
        page.set("target", text)
        page.idle()
        assert page.mock.target == 1 and page.value("target") == "1"
        assert "Type 0.05 to 4" in page.text("problems"), text
    page.set("target", "4")
    page.settle()
    assert page.mock.target == 4 and page.text("problems") == ""
    page.click("target-reset")
    page.idle()
    page.hold(70)
    page.wait(lambda: page.element("verdict").get_attribute("data-level") == "measure", what="measurement")
    more = 100 * (math.hypot(1, page.state()["curve"][-1]["k99"]) - 1)
    assert f"at most {more:.2g} % larger than that of the camera alone" in page.text("verdict-text")
    assert page.js("return document.querySelectorAll('#curve .measured').length") == 1
    assert page.js("return document.querySelectorAll('#curve .foretold-point').length") >= 1


def test_words_of_the_time(mock_page):
    page = mock_page(*FROZEN)
    state = page.mock.state()

    def time_of(curve, forecast, k, rate=100):
        """Kind and time, words and verdict of a render with so many samples per pixel and second."""
        spp = [None if t is None else rate * t for _, t in forecast]
        changed = {
            **state,
            "certificate": None,
            "curve": [{"seconds": t, "spp": rate * t, "k99": level} for t, level in curve],
            "forecast": [{"k": level, "seconds": t, "spp": n} for (level, t), n in zip(forecast, spp)],
        }
        return page.driver.execute_async_script(
            "const done = arguments[2]; import('/assets/accuracy.js').then(m => done([m.timeOfLevel(arguments[0], arguments[1]), m.timeSentence(arguments[0], arguments[1]), m.verdict({...arguments[0], target: arguments[1]}, false).level]))",
            changed,
            k,
        )

    law = [(t, 2 / math.sqrt(t)) for t in (1, 4, 16)]
    found, words, level = time_of(law, [], 1)
    assert (
        found["kind"] == "since" and abs(found["seconds"] - 4) < 1e-6 and "since 4.0 s" in words and level == "measure"
    ), (found, words, level)
    found, _, _ = time_of([(1, 2.0), (2, 0.9), (3, 1.2), (4, 0.8)], [], 1)
    assert found["kind"] == "since" and 3 < found["seconds"] < 4, "a level that was lost does not count"
    found, _, level = time_of(law, [(0.5, None), (0.25, 64.0)], 0.3)
    assert found["kind"] == "after" and abs(found["seconds"] - (2 / 0.3) ** 2) < 1e-6 and level == "look"
    found, _, _ = time_of(law, [(0.25, 64.0)], 0.125)
    assert abs(found["seconds"] - 256) < 1e-6, "beyond the forecast the root law holds"
    # Before the forecast: the pilot has 32 samples per pixel.
    found, words, _ = time_of([(1, 2.0)], [], 0.5)
    assert found["kind"] == "unknown" and "is known after the next points" in words
    pilot = [(t, 2 / math.sqrt(t)) for t in (1, 2, 3, 4, 5)]
    found, words, _ = time_of(pilot, [], 0.5, rate=6)
    assert found["kind"] == "unknown" and "is known after the pilot (32 samples per pixel)" in words
    found, _, _ = time_of(pilot, [], 0.5)
    assert found["kind"] == "after" and abs(found["seconds"] - 16) < 1e-6
    found, words, level = time_of([(1, None)], [], 0.5)
    assert found["kind"] == "unknown" and level == "none" and "is not known." in words
    # A view does not reach each level.
    for forecast, k in [([(1, 4.0), (0.5, None)], 0.5), ([(1, 4.0), (0.5, None)], 0.3), ([(1, 4.0)], 0.05)]:
        found, words, _ = time_of([], forecast, k)
        assert found["kind"] == "never" and "is not reached in a view (more than 65\u2009536 samples" in words, (
            k,
            words,
        )
    found, _, _ = time_of([], [(1, 4.0), (0.5, None)], 0.8)
    assert found["kind"] == "after" and abs(found["seconds"] - 6.25) < 1e-6
    found, _, _ = time_of(law, [(1, 4.0), (0.5, None)], 0.7)
    assert found["kind"] == "since", "a measured level was reached, whatever was foretold"


def test_maps(mock_page):
    page = mock_page(*FROZEN)
    page.click("one-to-one")
    x0, y0 = page.origin()
    for name in MAPS:
        page.set("map", name)
        page.settle()
        assert page.last("/api/map")["map"] == name
        assert not page.js("return document.getElementById('legend').hidden")
        assert len(page.js("return [...document.querySelectorAll('#legend-ticks span')].map(e => e.textContent)")) == 5
        page.set("map", "none")
    page.set("map", "ratio")
    page.settle()
    _, data = page.mock.map({"camera": JOB_CAMERA, "map": "ratio"})
    ratio = np.frombuffer(data, "<f4").reshape(HEIGHT, WIDTH)
    for target in [0.5, 0.2]:
        page.set("target", target)
        page.settle()
        for x in range(20, 220, 7):
            red, _, blue, _ = page.pixel(x0 + x, y0 + 120)
            assert (blue > red) == (ratio[120, x] <= target), (x, ratio[120, x], red, blue)
    assert page.pixel(x0 + 3, y0 + 3)[:3] == page.pixel(x0 + 3, y0 + 3)[:1] * 3, "unknown pixels show the picture"
    full = page.pixel(x0 + 160, y0 + 120)
    page.set("map-opacity", "0.3", "input")
    page.settle()
    assert page.pixel(x0 + 160, y0 + 120) != full
    page.set("map", "samples")
    page.settle()
    viridis = page.pixel(x0 + 160, y0 + 120)
    page.set("map-colours", "cividis")
    page.settle()
    assert page.pixel(x0 + 160, y0 + 120) != viridis
    assert page.text("problems") == ""


def test_probe_and_keys(mock_page):
    page = mock_page(*FROZEN)
    page.click("one-to-one")
    x0, y0 = page.origin()
    page.mouse((x0 + 100, y0 + 80), (x0 + 150, y0 + 110))
    page.wait(lambda: page.text("probe-place") == "150, 110", "the values of the pixel")
    page.idle()
    values = page.frame()["values"]
    assert page.text("probe-value") == f"{values[110 * 320 + 150]} DN"
    assert page.text("probe-material") == "PMMA cover <clear>"
    height = page.element("probe").size["height"]
    page.mouse((x0 + 20, y0 + 30), drag=True)
    page.idle()
    assert page.text("probe-place") == "20, 30"
    page.mouse((x0 + 100, y0 + 100))
    assert page.text("probe-place") == "20, 30", "the pin holds"
    page.chord(Keys.SHIFT, Keys.ARROW_RIGHT)
    page.chord(Keys.SHIFT, Keys.ARROW_DOWN)
    page.idle()
    assert page.text("probe-place") == "21, 31" and page.last("/api/probe")["x"] == 21
    assert page.element("probe").size["height"] == height
    page.keys(Keys.ESCAPE)
    assert page.element("unpin").get_attribute("disabled")
    # Pan and zoom.
    page.keys("z")
    assert page.text("zoom") == "100 %"
    page.keys("+")
    assert page.text("zoom") == "200 %"
    page.keys("-", "-")
    assert page.text("zoom") == "66.7 %"
    page.keys("f")
    fit = page.text("zoom")
    for _ in range(14):
        page.keys("+")
    assert page.text("zoom") == "9600 %"
    page.settle()
    page.keys("f")
    assert page.text("zoom") == fit
    page.keys("t")
    assert page.value("tone") == "linear"
    page.keys("m")
    assert page.value("map") == "ratio"
    page.chord(Keys.SHIFT, "m")
    assert page.value("map") == "none"
    for key, button in [("c", "compare"), ("l", "live"), ("h", "path")]:
        page.keys(key)
        assert page.element(button).get_attribute("aria-pressed") == "true", key
        page.keys(key)
        assert page.element(button).get_attribute("aria-pressed") == "false", key
    for key, tool in [("r", "tool-region1"), ("i", "tool-line"), ("v", "tool-move")]:
        page.keys(key)
        assert page.element(tool).get_attribute("aria-pressed") == "true"
    page.chord(Keys.SHIFT, "r")
    assert page.element("tool-region2").get_attribute("aria-pressed") == "true"
    for number, name in enumerate(TABS, 1):
        page.keys(str(number))
        assert page.element(f"tab-{name}").get_attribute("aria-selected") == "true"
    page.keys(Keys.ARROW_LEFT, focus="tab-save")
    assert page.element("tab-measure").get_attribute("aria-selected") == "true"
    page.keys("e")
    page.settle()
    assert page.camera()["exposure"] is not None
    number = page.last("/api/frame")["frame"]
    page.keys("n")
    page.settle()
    assert page.last("/api/frame")["frame"] == number + 1
    page.keys("p")
    page.idle()
    assert page.last("/api/render") == {"action": "pause"}
    page.keys("?")
    assert page.js("return document.getElementById('help').open")
    page.click("keys-on")
    page.click("help-close")
    tone_now = page.value("tone")
    page.keys("t")
    assert page.value("tone") == tone_now, "single keys are off"
    # Letters in a text belong to the text.
    page.js("document.getElementById('help').querySelector('#keys-on').click()")
    page.keys("t", focus="tab-save")
    page.tab("save")
    tone_now = page.value("tone")
    page.keys("t", focus="save-name")
    assert page.value("tone") == tone_now and page.value("save-name").endswith("t")


def test_pan_and_wheel(mock_page):
    page = mock_page(*FROZEN)
    page.click("one-to-one")
    page.keys("+", "+", "+")  # 400 %
    x0, y0 = page.origin(4)
    page.mouse((300, 200), (340, 230), (360, 240), drag=True)
    page.settle()
    values, header = page.frame()["values"], page.frame()["header"]
    x, y = (300 - x0 - 60) // 4, (200 - y0 - 40) // 4
    corner = x0 + 60 + 4 * x, y0 + 40 + 4 * y
    expected = tone_value(values[y * WIDTH + x], header, "gamma")
    for dx, dy in [(0, 0), (3, 3), (0, 3)]:
        assert page.pixel(corner[0] + dx, corner[1] + dy)[0] == expected, "pixels are squares of one value"
    before = page.text("zoom")
    page.js(
        "const c = document.getElementById('image'); const r = c.getBoundingClientRect(); c.dispatchEvent(new WheelEvent('wheel', {deltaY: -240, clientX: r.left + 100, clientY: r.top + 100, cancelable: true}))"
    )
    assert float(page.text("zoom").split()[0]) > float(before.split()[0]) * 1.4
    assert not page.log("/api/regions")


def test_regions_line_path_transfer(mock_page):
    page = mock_page(*FROZEN)
    page.click("one-to-one")
    x0, y0 = page.origin()
    page.tab("measure")
    page.click("tool-region1")
    page.mouse((x0 + 120, y0 + 90), (x0 + 150, y0 + 100), (x0 + 179, y0 + 129), drag=True)
    page.settle()
    assert page.value("region1") == "120 90 180 130"
    values = np.array(page.frame()["values"]).reshape(HEIGHT, WIDTH)[90:130, 120:180]
    assert (
        page.text("region1-mean") == f"{values.mean():.5g}"
        and page.text("region1-pixels").replace("\u2009", "") == "2400"
    )
    page.set("region2", "10, 10, 40, 40")
    page.settle()
    assert page.last("/api/regions")["regions"] == [[120, 90, 180, 130], [10, 10, 40, 40]]
    assert page.text("cnr") != "–" and page.text("contrast").endswith("DN")
    assert page.js("return document.querySelectorAll('#histogram path').length") == 2
    page.click("region1-clear")
    page.settle()
    assert page.text("region1-mean") == "–" and page.text("region2-mean") != "–" and page.text("cnr") == "–"
    page.set("region2", "nonsense")
    assert page.value("region2") == "10 10 40 40"
    page.click("tool-line")
    page.mouse((x0 + 10, y0 + 10), (x0 + 60, y0 + 60), (x0 + 110, y0 + 85), drag=True)
    page.settle()
    assert page.last("/api/line")["from"] == [10, 10] and page.last("/api/line")["to"] == [110, 85]
    assert (
        page.js("return document.querySelectorAll('#profile .band, #profile .value, #profile .expected').length") == 3
    )
    page.click("path")
    page.click("tool-move")
    page.mouse((x0 + 200, y0 + 200), drag=True)
    page.settle()
    # The factors of the lights are those of this page.
    assert page.last("/api/path") == {"x": 200, "y": 200, "index": None, "camera": page.camera()}
    items = page.js("return [...document.querySelectorAll('#path-list li')].map(e => e.textContent)")
    assert len(items) == 5 and "behind the camera" in items[2]
    page.click("transfer-on")
    page.settle()
    assert page.js("return document.querySelectorAll('#transfer .point').length") == 40
    assert page.text("transfer-gain").endswith("DN/e⁻")
    # A new frame measures the regions again.
    count = len(page.log("/api/regions"))
    page.click("next-frame")
    page.wait(lambda: len(page.log("/api/regions")) > count, "the regions of the new frame")


def test_touch_on_a_tablet(driver, mock_page):
    page = mock_page(*FROZEN)
    driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 5})
    driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 1024, "height": 768, "deviceScaleFactor": 2, "mobile": True}
    )
    try:
        page.refresh()
        page.settle()
        assert page.js("return matchMedia('(pointer: coarse)').matches")
        assert page.js("return document.documentElement.scrollWidth") == 1024
        left, top, width, height = page.canvas()
        assert page.js("return document.getElementById('image').width") == 2 * width
        x, y = left + width / 2, top + height / 2

        def touch(kind, *points):
            touched = [{"x": px, "y": py, "id": i} for i, (px, py) in enumerate(points)]
            driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touched})

        before = float(page.text("zoom").split()[0])
        page.click("tool-region1")
        touch("touchStart", (x - 40, y))
        touch("touchStart", (x - 40, y), (x + 40, y))
        for step in range(1, 9):
            touch("touchMove", (x - 40 - 5 * step, y), (x + 40 + 5 * step, y))
        touch("touchEnd", (x - 80, y))
        touch("touchMove", (x - 10, y + 60))
        touch("touchEnd")
        page.settle()
        assert abs(float(page.text("zoom").split()[0]) / before - 2) < 0.15, (
            "two fingers at twice the distance zoom by 2"
        )
        assert page.value("region1") == "", "a pinch draws no region"
        page.click("tool-move")
        touch("touchStart", (x, y))
        touch("touchEnd")
        page.settle()
        assert page.text("probe-place") != "–" and not page.element("unpin").get_attribute("disabled"), "a tap pins"
    finally:
        driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
