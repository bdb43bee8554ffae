"""Knobs of the page that were lost, refused in silence or without effect, with a server of synthetic data."""

from mock_page import FROZEN, WIDTH
from page import tone_value
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys


def test_the_tone_of_this_moment_is_painted(mock_page):
    """A tone that changes while a frame is in flight is that of the frame."""
    page = mock_page(*FROZEN)
    page.click("one-to-one")
    x0, y0 = page.origin()
    page.mock.settings["delay"] = 0.5
    asked = len(page.log("/api/frame"))
    page.js("document.getElementById('next-frame').click()")
    page.wait(lambda: len(page.log("/api/frame")) > asked, "the request of the frame")
    page.set("tone", "log")
    page.settle()
    frame = page.frame()
    for x, y in [(10, 10), (160, 120), (300, 200)]:
        expected = tone_value(frame["values"][y * WIDTH + x], frame["header"], "log")
        assert page.pixel(x0 + x, y0 + y)[:3] == [expected] * 3, (x, y)


def test_storage_that_is_switched_off(driver, mock_page):
    page = mock_page(*FROZEN)
    script = (
        "Object.defineProperty(window, 'sessionStorage', {get() { throw new DOMException('off', 'SecurityError'); }})"
    )
    added = driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": script})
    try:
        page.refresh()
        page.settle()
        assert page.text("connection") == "connected" and page.film() == page.state()["film"]["id"]
        page.set("gain-value", "2")
        page.settle()
        assert page.camera()["gain"] == 2
    finally:
        driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)
    page.assert_quiet_console()


def test_broken_texts_in_the_storage(mock_page):
    page = mock_page(*FROZEN)
    page.set("gain-value", "2")
    kept = page.js("return sessionStorage.getItem('knobs of jobs/panel.toml')")
    for text in ["{", "null", "5", kept.replace('"camera":{', '"camera":{"old":1,'), kept.replace('"gain":2,', "")]:
        page.js("sessionStorage.setItem('knobs of jobs/panel.toml', arguments[0])", text)
        page.refresh()
        page.settle()
        assert page.value("gain-value") == "1" and page.camera()["gain"] == 1, text
    page.js("sessionStorage.setItem('knobs of jobs/panel.toml', arguments[0])", kept)
    page.refresh()
    page.settle()
    assert page.camera()["gain"] == 2
    page.assert_quiet_console()


def test_a_page_that_is_loaded_again_has_its_knobs(mock_page):
    page = mock_page(*FROZEN)
    page.click("keep")
    page.set("gain-value", "2")
    # After a change of the job.
    page.mock.settings["exposure"] = 0.004
    page.wait(lambda: page.value("exposure-value") == "4 ms", "the exposure of the job")
    page.refresh()
    page.settle()
    assert page.camera()["gain"] == 2 and page.camera()["exposure"] == 0.004
    # Before the job is loaded.
    page.mock.width = 0
    page.mock.settings |= {"frozen": 0.1, "exposure": None}
    page.refresh()
    page.mock.width = WIDTH
    page.mock.settings |= {"frozen": 18.4, "exposure": 0.004}
    page.wait(lambda: page.state()["width"] == WIDTH, "the job")
    page.settle()
    assert page.camera()["gain"] == 2 and page.camera()["exposure"] == 0.004
    # After an exchange.
    page.click("keep")
    page.set("gain-value", "3")
    page.click("swap")
    page.settle()
    assert page.camera()["gain"] == 2
    page.refresh()
    page.settle()
    assert page.camera()["gain"] == 2
    page.assert_quiet_console()


def test_numbers_of_the_scene_are_refused_with_a_message(mock_page):
    page = mock_page(*FROZEN)
    page.tab("scene")
    page.js("document.querySelectorAll('#materials details').forEach(d => d.open = true)")
    for knob, texts, largest in [
        ("light-power-0-value", ["-1", "2e6", ""], "1000000"),
        ("material-roughness-0-value", ["1.5", "-1", ""], "1"),
    ]:
        before = page.value(knob)
        for text in texts:
            # The field has the focus, as after Enter.
            page.js("document.getElementById(arguments[0]).focus()", knob)
            page.set(knob, text)
            words = "not a number" if text == "" else f"{text} is out of range"
            assert words in page.text("problems") and f"Type 0 to {largest}." in page.text("problems"), (knob, text)
            assert page.value(knob) == before, (knob, text)
    assert not page.log("/api/scene")
    page.set("material-roughness-0-value", "0.6")
    assert page.text("problems") == ""
    assert page.last("/api/scene") == {"materials": {"anodised aluminium": {"roughness": 0.6}}}
    page.assert_quiet_console()


def title(page, id_):
    """The tooltip of a control, or of its label."""
    return page.js("const e = document.getElementById(arguments[0]); return e.title || e.closest('label').title", id_)


def test_a_light_that_is_off_has_no_factor(mock_page):
    page = mock_page(*FROZEN)
    page.tab("scene")
    page.click("per-light")
    page.wait(lambda: not page.hidden("light-factors"), "factors")
    knobs = ["light-factor-1", "light-factor-value-1"]
    before = [title(page, knob) for knob in knobs]
    for on in [False, True]:
        page.click("light-on-1")
        page.wait(lambda on=on: page.state()["scene"]["lights"][1]["on"] is on, "the state of the light")
        for knob, text in zip(knobs, before):
            assert page.disabled(knob) is not on and not page.disabled("light-factor-0")
            assert title(page, knob) == text if on else "This light is off" in title(page, knob)
    page.assert_quiet_console()


def test_lights_without_power_or_switch(mock_page):
    page = mock_page(*FROZEN)
    page.tab("scene")
    knobs = ["light-power-2", "light-power-2-value", "light-on-2"]
    before = [title(page, knob) for knob in knobs]
    assert not any(page.disabled(knob) for knob in knobs)
    page.mock.settings["light_fields"] = {"room": {"has_power": False}}
    page.wait(lambda: page.disabled("light-power-2"), "a sun")
    assert page.disabled("light-power-2-value") and not page.disabled("light-on-2")
    assert title(page, "light-power-2-value") == (
        "This light comes from infinitely far away, and has no power: change it in the job"
    )
    page.mock.settings["light_fields"] = {"room": {"has_power": False, "has_switch": False}}
    page.wait(lambda: page.disabled("light-on-2"), "an environment")
    assert title(page, "light-on-2") == (
        "The environment has no switch: write `radiance = 0` or `scale = 0` in [environment] of the job"
    )
    page.mock.settings["light_fields"] = {}
    page.wait(lambda: not page.disabled("light-on-2"), "a lamp")
    assert [title(page, knob) for knob in knobs] == before
    page.assert_quiet_console()


def test_durations(mock_page):
    page = mock_page(*FROZEN)
    words = {
        0.4: "0.4 s",
        9.97: "10 s",
        89.4: "89 s",
        200: "3 min 20 s",
        599.4: "9 min 59 s",
        599.6: "10 min",
        3569: "59 min",
        3595: "1 h 0 min",
        7190: "2 h 0 min",
        7500: "2 h 5 min",
        172795: "2 days",
    }
    found = page.driver.execute_async_script(
        "const done = arguments[1]; import('/assets/format.js').then(m => done(arguments[0].map(m.duration)))",
        list(words),
    )
    assert found == list(words.values())


def test_knobs_of_the_model_start_from_its_values(mock_page):
    page = mock_page(*FROZEN)
    for sensor, temperature in [("imx250", 35), ("ccd-icx285", 25)]:
        page.set("sensor", sensor)
        page.settle()
        assert page.value("temperature") == str(temperature) and page.value("temperature-value") == ""
        page.click("temperature-model")
        page.settle()
        assert page.camera()["temperature"] == temperature and page.value("temperature-value") == str(temperature)
        page.click("temperature-model")
    # A colour sensor has a black level too.
    page.set("sensor", "imx264-colour")
    page.settle()
    frame = page.frame()
    assert frame["header"]["format"] == "rgb8" and page.value("black-level") == str(frame["header"]["black"]) == "4"
    page.set("sensor", "")
    page.settle()
    assert page.value("black-level") == "" and page.disabled("black-level")
    page.assert_quiet_console()


def test_a_legend_of_one_value(mock_page):
    page = mock_page(*FROZEN)
    page.mock.settings["samples"] = 16
    page.set("map", "samples")
    page.settle()
    assert page.js("return [...document.querySelectorAll('#legend-ticks span')].map(e => e.textContent)") == ["16"]


def test_the_result_of_a_save_by_key_is_seen(mock_page):
    page = mock_page(*FROZEN)
    page.chord(Keys.CONTROL, "s")
    assert not page.hidden("panel-save") and page.text("save-result") == "Saved 1 file."
    assert page.js("return document.activeElement.id") == "image", "arrow keys still move the image"
    # A number that is being typed belongs to the picture that is saved.
    page.tab("camera")
    page.js("document.getElementById('gain-value').select()")
    page.set("save-name", "typed")
    ActionChains(page.driver).send_keys("2").key_down(Keys.CONTROL).send_keys("s").key_up(Keys.CONTROL).perform()
    page.settle()
    body = page.last("/api/save")
    assert body["name"] == "typed" and body["camera"]["gain"] == 2 and not page.hidden("panel-save")
    assert page.js("return document.activeElement.id") == "tab-save"
    page.assert_quiet_console()


def test_an_exr_has_no_knobs_without_effect(mock_page):
    page = mock_page("--source", "exr", *FROZEN)
    assert page.disabled("denoise") and title(page, "denoise") == (
        "An EXR is shown as it is: denoise it by `dunkelfeld denoise`"
    )
    assert page.disabled("vignetting") and title(page, "vignetting") == "The lens is that of the EXR"
    for name in ["samples", "recent", "ratio", "camera_sigma"]:
        is_disabled = page.js(f"return document.querySelector('#map option[value={name}]').disabled")
        assert is_disabled == (name in ("samples", "recent")), name
    page.set("region1", "10 10 60 60")
    page.keys(Keys.ENTER)
    page.settle()
    assert page.text("probe-value") != "–" and page.text("probe-samples") == "–"
    page.tab("noise")
    assert page.text("forecast-note") == ""
    page.assert_quiet_console()


def test_the_words_of_the_dashed_line_go_with_it(mock_page):
    page = mock_page("--source", "film", *FROZEN)
    page.tab("noise")
    assert not page.disabled("denoise") and not page.disabled("vignetting")
    for target, has_line in [("0.25", True), ("3", False)]:
        page.set("target", target)
        page.settle()
        assert (page.js("return document.querySelectorAll('#curve .foretold-point').length") == 1) is has_line
        assert ("dashed line" in page.text("forecast-note")) is has_line
    page.assert_quiet_console()
