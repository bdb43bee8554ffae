"""The page follows the job, and shows the statistics of its own picture, with a server of synthetic data."""

import time

import numpy as np
from mock_data import JOB_CAMERA
from mock_page import FROZEN, HEIGHT, WIDTH


def test_statistics_are_those_of_picture_a(mock_page):
    page = mock_page(*FROZEN)
    page.tab("noise")
    page.click("keep")
    page.set("gain-value", "0.3")
    page.click("compare")
    page.settle()
    asked = [entry["body"] for entry in page.log("/api/frame")]
    assert [body["camera"]["gain"] for body in asked if body["statistics"]] == [1, 0.3], "picture B has no statistics"
    # Another frame of the same knobs takes no statistics from another page.
    page.mock.log.clear()
    page.click("next-frame")
    page.settle()
    assert not any(entry["body"]["statistics"] for entry in page.log("/api/frame"))
    page.click("swap")
    page.settle()
    page.wait(lambda: page.state()["statistics_of"]["gain"] == 1, "the statistics of the new A")
    level = page.text("noise-k99")
    assert page.attribute("verdict", "data-level") != "none" and float(level) > 0
    # A state with the statistics of another camera has no verdict for this one.
    page.mock.settings["other_camera"] = True
    page.wait(lambda: page.state()["statistics_of"]["gain"] == 77, "the statistics of another camera")
    assert page.attribute("verdict", "data-level") == "none" and page.text("noise-k99") == "–"
    assert page.text("noise-hidden") == "–"
    assert page.js("return document.querySelectorAll('#curve .measured-point').length") == 0
    page.mock.settings["other_camera"] = False
    page.wait(lambda: page.text("noise-k99") == level, "its own statistics")
    # The noise of the picture changes no statistics.
    page.set("noise", "matched")
    page.settle()
    assert page.text("noise-k99") == level
    page.assert_quiet_console()


def test_the_frame_follows_the_job(mock_page):
    page = mock_page(*FROZEN)
    page.mock.settings["frame"] = 7
    page.wait(lambda: page.text("frame-rate") == "frame 7", "the frame of the job")
    page.settle()
    assert page.last("/api/frame")["frame"] == 7
    # A frame that the user chose stays.
    page.click("next-frame")
    page.mock.settings["frame"] = 9
    page.wait(lambda: page.state()["frame"] == 9, "the next job")
    page.settle()
    assert page.text("frame-rate") == "frame 8" and page.last("/api/frame")["frame"] == 8


def test_a_timed_exposure_is_that_of_the_job(mock_page):
    page = mock_page(*FROZEN)
    page.set("exposure-value", "1 ms")
    page.click("keep")
    page.set("exposure-value", "3 ms")
    page.settle()
    page.mock.settings["timed"] = "the samples of moving objects are made for this exposure"
    page.mock.settings["exposure"] = 0.005
    page.wait(lambda: "5 ms" in page.text("problems"), "the message")
    assert "moving objects" in page.text("problems") and page.disabled("exposure-value")
    page.settle()
    assert page.camera()["exposure"] == 0.005 and page.value("exposure-value") == "5 ms"
    assert page.text("kept-facts") == "the same as A"
    # The page that is loaded again has no refused knob either.
    page.refresh()
    page.settle()
    assert page.camera()["exposure"] == 0.005 and page.text("problems") == ""


def test_factors_without_films_are_dropped_with_a_message(mock_page):
    page = mock_page("--speed", "3")
    page.tab("scene")
    page.click("per-light")
    page.wait(lambda: not page.hidden("light-factors"), "factors")
    page.wait(lambda: page.mock.film() is not None, "a film")
    page.set("light-factor-value-1", "3")
    page.click("keep")
    page.set("light-factor-value-1", "1")
    assert page.text("problems") == ""
    page.click("per-light")
    page.wait(lambda: "factors of the lights" in page.text("problems"), "the message")
    assert page.text("kept-facts") == "the same as A"


def test_the_legend_counts_as_the_certificate(mock_page):
    """Saturated pixels are left out, and those of unknown noise are above the target."""
    page = mock_page(*FROZEN)
    page.set("exposure-value", "1 s")
    page.set("target", "2")
    page.set("map", "ratio")
    page.settle()
    camera = {**JOB_CAMERA, "exposure": 1.0}
    _, data = page.mock.map({"camera": camera, "map": "ratio"})
    ratio = np.frombuffer(data, "<f4").reshape(HEIGHT, WIDTH)
    counted = ~np.isnan(ratio)
    assert 0 < counted.sum() < ratio.size and np.isinf(ratio).sum() == 144
    share = 100 * (ratio <= 2)[counted].sum() / counted.sum()
    note = page.text("legend-note")
    assert abs(float(note.split(" %")[0]) - share) < 0.06, (note, share)
    assert "saturated (" in note and "unknown (" in note


def hide(page, is_hidden):
    """Tells the page that it is hidden, as a browser does for a page in the background."""
    page.js(
        "Object.defineProperty(document, 'hidden', {configurable: true, value: arguments[0]});"
        "document.dispatchEvent(new Event('visibilitychange'))",
        is_hidden,
    )


def test_a_hidden_page_frees_its_connection(mock_page):
    """A browser has six connections to one server, so that each page that nobody sees must give its own back."""
    page = mock_page("--speed", "3")
    page.js(
        "window.lost = false; new MutationObserver(() => { window.lost ||= !document.getElementById('connection')"
        ".textContent.startsWith('connected'); }).observe(document.getElementById('connection'), "
        "{childList: true, characterData: true, subtree: true})"
    )
    assert page.mock.streams == 1
    # A short look at another tab closes nothing.
    hide(page, True)
    time.sleep(1)
    hide(page, False)
    hidden = time.monotonic()
    hide(page, True)
    page.wait(lambda: not page.mock.streams, "the end of the stream", seconds=30)
    assert time.monotonic() - hidden > 9
    film = page.state()["film"]["id"]
    assert page.text("connection") == "connected"
    shown = page.mock.film()["id"]
    assert shown >= film
    hide(page, False)
    page.wait(lambda: page.mock.streams == 1, "the stream")
    page.wait(lambda: page.film() > shown, "the picture of a newer film")
    assert page.text("connection") == "connected" and not page.js("return window.lost")
    # Another server has begun meanwhile.
    page.set("gain-value", "2")
    hide(page, True)
    page.wait(lambda: not page.mock.streams, "the end of the stream", seconds=30)
    page.stop()
    page.start(page.port, "--freeze", "2.2")
    hide(page, False)
    page.wait(lambda: page.film() == 3, "the picture of the other server")
    page.settle()
    assert page.camera()["gain"] == 2
    assert page.text("connection") == "connected"
    page.console()
