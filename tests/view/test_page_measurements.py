"""Values of the page that must be of what is shown: after errors, at colour sensors and beyond saturation."""

import numpy as np
from mock_page import FROZEN, HEIGHT, WIDTH
from selenium.webdriver.common.keys import Keys

UNKNOWN = "–"


def values_of(page):
    return np.array(page.mock.expose(page.camera(), page.last("/api/frame")["frame"], page.mock.film())["dn"])


def test_refused_measurements_have_no_values(mock_page):
    page = mock_page(*FROZEN)
    page.set("region1", "10 10 60 60")
    page.settle()
    assert page.text("region1-mean") != UNKNOWN
    page.mock.settings["regions"] = "The region <b>is odd</b>."
    page.click("next-frame")
    page.wait(lambda: "The region <b>is odd</b>." in page.text("problems"), "the fault")
    page.settle()
    assert page.text("region1-mean") == UNKNOWN and not page.js("return document.querySelector('#histogram .bars1')")
    # New frames do not repeat what was refused; another region is asked for.
    count = len(page.log("/api/regions"))
    probes = len(page.log("/api/probe"))
    page.js("document.getElementById('image').focus()")
    page.keys(Keys.ENTER)
    for _ in range(3):
        page.click("next-frame")
        page.settle()
    assert len(page.log("/api/regions")) == count and len(page.log("/api/probe")) > probes
    page.mock.settings["regions"] = None
    page.set("region1", "10 10 61 61")
    page.settle()
    assert page.text("region1-mean") != UNKNOWN and page.text("problems") == ""
    # A removed region takes its fault along.
    page.mock.settings["regions"] = "No."
    page.set("region1", "10 10 62 62")
    page.settle()
    assert page.text("problems") != ""
    page.click("region1-clear")
    page.settle()
    assert page.text("problems") == ""
    page.assert_quiet_console(refusals=True)


def test_texts_of_regions_are_taken_or_refused(mock_page):
    page = mock_page(*FROZEN)
    page.set("region1", "10 10 60 60")
    page.set("line", f"0,0; {WIDTH - 1}, {HEIGHT - 1}")
    page.settle()
    assert page.value("region1") == "10 10 60 60" and page.value("line") == f"0 0 {WIDTH - 1} {HEIGHT - 1}"
    assert page.text("problems") == ""
    size = f"{WIDTH} x {HEIGHT}"
    cases = [
        ("region1", "10 10 60", "four whole numbers"),
        ("region1", "10 10 60 60 70", "four whole numbers"),
        ("region1", "10 10 60 6o", "four whole numbers"),
        ("region1", "10.5 10 60 60", "four whole numbers"),
        ("region1", "1e1 10 60 60", "four whole numbers"),
        ("region1", "60 10 10 60", "contains no pixel"),
        ("region1", f"10 10 {WIDTH + 1} 60", size),
        ("region1", "-1 10 60 60", size),
        ("line", f"0 0 {WIDTH} 5", size),
        ("line", "left", "four whole numbers"),
    ]
    count = len(page.log("/api/regions"))
    before = {id_: page.value(id_) for id_ in ("region1", "line")}
    for id_, text, part in cases:
        page.set(id_, text)
        page.settle()
        assert part in page.text("problems") and "for example" in page.text("problems"), (text, page.text("problems"))
        assert page.value(id_) == before[id_], text
        assert page.text("region1-pixels") != UNKNOWN
    assert len(page.log("/api/regions")) == count
    page.set("region1", f"0 0 {WIDTH} {HEIGHT}")
    page.settle()
    assert page.text("problems") == "" and page.last("/api/regions")["regions"] == [[0, 0, WIDTH, HEIGHT]]
    page.assert_quiet_console()


def test_a_black_picture_is_not_good_enough(mock_page):
    page = mock_page(*FROZEN)
    page.set("target", "4")
    page.wait(lambda: page.attribute("verdict", "data-level") != "none", "a verdict")
    page.mock.settings["black"] = True
    page.click("next-frame")
    page.wait(lambda: page.attribute("verdict", "data-level") == "none", "the verdict of a black picture")
    assert page.text("verdict-name") == "Black picture" and "Check the lights" in page.text("verdict-text")
    # k would be 0, and all pixels hidden at once.
    assert page.text("verdict-k") == "" and page.text("verdict-time") == ""
    page.mock.settings |= {"black": False, "saturated": 0.75}
    page.click("next-frame")
    page.wait(lambda: page.text("verdict-name") == "Saturated picture", "the verdict of a saturated picture")
    assert page.text("verdict-text").startswith("75.0 % of the pixels are saturated") and page.text("verdict-k") == ""
    page.mock.settings["saturated"] = None
    page.click("next-frame")
    page.wait(lambda: page.attribute("verdict", "data-level") != "none", "the verdict of a picture with light")
    assert page.text("verdict-k") != ""


def test_a_restart_measures_again(mock_page):
    page = mock_page(*FROZEN)
    page.mock.settings["regions"] = "No."
    page.set("region1", "10 10 60 60")
    page.settle()
    assert "No." in page.text("problems") and page.text("region1-mean") == UNKNOWN
    page.mock.settings["regions"] = None
    page.set("line", "10 10 60 60")
    lines = len(page.log("/api/line"))
    page.click("restart")
    page.wait(lambda: page.text("region1-mean") != UNKNOWN, "the region after the restart")
    page.wait(lambda: len(page.log("/api/line")) > lines, "the line after the restart")
    assert page.text("problems") == ""
    page.assert_quiet_console(refusals=True)


def test_values_go_with_the_pin(mock_page):
    page = mock_page(*FROZEN)
    page.keys(Keys.ENTER)
    page.settle()
    assert page.text("probe-value") != UNKNOWN
    page.keys(Keys.ESCAPE)
    page.settle()
    names = ["place", "value", "electrons", "camera-sigma", "render-sigma", "ratio", "samples", "depth", "object"]
    assert [page.text(f"probe-{name}") for name in names] == [UNKNOWN] * len(names)
    # The pointer leaves the image.
    page.click("one-to-one")
    x0, y0 = page.origin()
    page.mouse((x0 + 100, y0 + 80), (x0 + 150, y0 + 110))
    page.wait(lambda: page.text("probe-value") != UNKNOWN, "the values of the pixel")
    page.mouse((x0 + 100, y0 + 80), (x0 - 20, y0 + 80))
    page.settle()
    assert page.text("probe-place") == UNKNOWN and page.text("probe-value") == UNKNOWN


def test_colour_sensors(mock_page):
    page = mock_page(*FROZEN)
    page.tab("measure")
    page.set("region1", "20 20 61 61")
    page.set("line", "10 10 60 60")
    page.keys(Keys.ENTER)
    page.settle()
    assert page.hidden("measure-channel-row") and page.hidden("probe-channel-cell")
    assert page.last("/api/regions")["channel"] is None and page.last("/api/line")["channel"] is None
    page.set("sensor", "imx264-colour")
    page.settle()
    page.wait(lambda: page.last("/api/line")["channel"] == "green", "the line of the green pixels")
    page.settle()
    assert not page.hidden("measure-channel-row") and page.value("measure-channel") == "green"
    assert page.text("frame-mean").endswith(" DN")
    x, y = map(int, page.text("probe-place").split(", "))
    assert page.text("probe-channel") == [["red", "green"], ["green", "blue"]][y % 2][x % 2]
    assert not page.hidden("probe-channel-cell")
    # Each colour has the pixels of its filter.
    for channel, (row, column) in [("red", (0, 0)), ("blue", (1, 1))]:
        page.set("measure-channel", channel)
        page.settle()
        assert page.last("/api/regions")["channel"] == channel and page.last("/api/line")["channel"] == channel
        inside = values_of(page)[20:61, 20:61][row::2, column::2]
        assert page.text("region1-pixels") == str(inside.size)
        assert page.text("region1-mean") == f"{inside.mean():#.5g}"
    page.set("sensor", "")
    page.settle()
    assert page.hidden("measure-channel-row") and page.hidden("probe-channel-cell")
    assert page.text("frame-mean") == UNKNOWN, "without a sensor there are no grey values"


def test_beyond_saturation(mock_page):
    page = mock_page(*FROZEN)
    page.click("one-to-one")
    x0, y0 = page.origin()
    page.mouse((x0 + 150, y0 + 110), drag=True)
    page.settle()
    assert page.text("probe-electrons-name") == "Electrons" and page.attribute("probe", "data-saturated") == "false"
    assert page.text("frame-electrons-name") == "Mean electrons"
    page.set("exposure-value", "200 ms")
    page.settle()
    page.wait(lambda: page.attribute("probe", "data-saturated") == "true", "the saturated pixel")
    assert page.text("probe-electrons-name") == "Before saturation" and page.text("probe-value") == "4095 DN"
    assert float(page.text("probe-electrons").split()[0]) > page.state()["sensors"][0]["saturation"]
    assert page.text("probe-ratio") == "saturated"
    assert page.text("probe-camera-sigma") == UNKNOWN and page.text("probe-render-sigma") == UNKNOWN
    assert page.text("frame-electrons-name") == "Mean electrons before saturation"
    # A dark pixel of the same frame counts.
    dark = np.argwhere(values_of(page)[:, 20:-20] < 3000)[0] + [0, 20]
    page.mouse((x0 + dark[1], y0 + dark[0]), drag=True)
    page.settle()
    assert page.attribute("probe", "data-saturated") == "false" and page.text("probe-ratio") != "saturated"


def test_histograms_have_common_bins(mock_page):
    page = mock_page(*FROZEN)
    page.tab("measure")
    page.set("region1", "20 20 60 60")
    page.set("region2", f"2 2 12 {HEIGHT}")
    page.settle()
    paths = page.js(
        "return [...document.querySelectorAll('#histogram path')].map(e => e.getAttribute('d').split('M').length)"
    )
    assert len(paths) == 2 and paths[0] == paths[1]
    labels = page.js("return [...document.querySelectorAll('#histogram .axis')].map(e => e.textContent)")
    assert labels == ["grey value [DN]", "% of the pixels per bin"]
    assert "region 2" in page.js("return document.getElementById('cnr').previousElementSibling.textContent")


def test_maps_are_of_a(mock_page):
    page = mock_page(*FROZEN)
    page.click("one-to-one")
    x0, y0 = page.origin()
    page.click("compare")
    page.set("map", "samples")
    page.settle()

    def is_grey(x, y):
        return len(set(page.pixel(x0 + x, y0 + y)[:3])) == 1

    assert not is_grey(60, 120) and is_grey(WIDTH - 60, 120), "B has no map"
    assert page.text("legend-title").endswith("of A")
    page.click("compare")
    page.settle()
    assert not is_grey(WIDTH - 60, 120) and not page.text("legend-title").endswith("of A")
